"""How strongly a point's jerk varies along the way: Kalman filters of several intensities, and scores of one that
varies.

The state, its motion and its measurements are those of `state_space`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel
from kinid.kernels.state_space import (
    ORDER,
    Covariance,
    State,
    around,
    dot,
    further,
    given,
    inlined,
    model,
    moved,
    moved_back,
    part,
    plus,
    raised,
    read,
    row,
    times,
    updated,
    with_row,
    write,
)

Array = NDArray[np.float64]

#: squared innovations count to so many times their variance
MOST = 1e12
#: log-likelihoods so far below the greatest are all alike
UNLIKELY = -40.0
RARE = np.exp(UNLIKELY)
#: a gain that changes by no more than this share from sample to sample has settled: of the slowest filter it is then
#: within a millionth of where it goes to
SETTLED = 1e-10
#: intensities that a bank works on side by side, and where their numbers begin in its scratch: behind the state and its
#: covariance come the gain, one over the variance of the innovation, its logarithm, the log-likelihood, the intensity
LANES = 16
GAIN, WEIGHT, ENTROPY, LIKELY, LEVEL = (row * LANES for row in (14, 18, 19, 20, 21))
ROWS = 22


@kernel
def bank(
    tau: Array, y: Array, noise: Array, levels: Array, start: Array, spread: Array, out: NDArray[np.float32]
) -> None:
    """Log-likelihood of each position, predicted from those before it, for several intensities that stay as they are.

    Args:
        tau: step before each sample, (n,). y: positions, (n,). noise: their variances, (n,). levels: intensities, (m,).
        start: state before the first, (d,). spread: its covariance, (d, d). out: (n, m).
    """
    m = levels.shape[0]
    if m > LANES:
        raise ValueError("more intensities than a bank has lanes")
    w, last, r = np.zeros(ROWS * LANES), 0.0, -1.0
    x, p = given(start, spread)
    for j in range(LANES):  # those that are left over are the last one once more
        write(x, p, w, j, LANES)
        w[LEVEL + j] = levels[min(j, m - 1)]
    move, added = model(last)
    moving, before, slope = m, 0.0, 0.0  # gains of the levels below `moving` haven't settled: those above are faster
    for t in range(tau.shape[0]):
        if tau[t] != last:
            last, moving = tau[t], m
            move, added = model(last)
        if noise[t] != r:
            r, moving = noise[t], m
        if moving > 0:
            _gains(w, move, added, r)
            for j in range(m):
                w[ENTROPY + j] = np.log(w[WEIGHT + j])
        _states(w, move, y[t])
        for j in range(m):
            out[t, j] = w[LIKELY + j]
        if moving > 0:
            now, steep = w[GAIN + moving - 1], w[GAIN + (ORDER - 1) * LANES + moving - 1]
            if abs(now - before) <= SETTLED * now and abs(steep - slope) <= SETTLED * steep:
                moving -= 1
                before = slope = 0.0
            else:
                before, slope = now, steep


# loops over the lanes of one array whose rows lie a constant number apart compile to SIMD instructions


@inlined
def _gains(w: Array, move: State, added: Covariance, noise: float) -> None:
    """Of each lane: covariance after the next sample, its gain, and one over the variance of its innovation."""
    for j in range(LANES):
        x, p = read(w, j, LANES)
        _, p, _, f, gain = updated(x, plus(around(p, move), w[LEVEL + j], added), 0, 0.0, noise)
        write(x, p, w, j, LANES)
        w[GAIN + j], w[GAIN + LANES + j], w[GAIN + 2 * LANES + j], w[GAIN + 3 * LANES + j] = gain
        w[WEIGHT + j] = f


@inlined
def _states(w: Array, move: State, position: float) -> None:
    """Of each lane: state after a position, and the log-likelihood of that."""
    for j in range(LANES):
        x = moved((w[j], w[LANES + j], w[2 * LANES + j], w[3 * LANES + j]), move)
        gain = (w[GAIN + j], w[GAIN + LANES + j], w[GAIN + 2 * LANES + j], w[GAIN + 3 * LANES + j])
        e = position - x[0]
        w[j], w[LANES + j], w[2 * LANES + j], w[3 * LANES + j] = further(x, e, gain)
        w[LIKELY + j] = 0.5 * (w[ENTROPY + j] - min(e * e * w[WEIGHT + j], MOST))


@kernel
def local_level(loglik: NDArray[np.float32], switch: float, out: Array) -> None:
    """Mean number of the level that is at work at each sample, levels that follow each other as a hidden Markov chain.

    From one sample to the next a level goes up or down by one with the probability `switch` (Rabiner 1989).

    Args:
        loglik: (n, m); gets the probabilities of the levels. out: (n,).
    """
    n, m = loglik.shape
    keep = 1.0 - 2.0 * switch
    a, b = np.full(m, 1.0 / m), np.empty(m)
    for k in range(n):  # what the past says, kept in the place of the likelihood
        most = loglik[k, 0]
        for j in range(1, m):
            most = max(most, loglik[k, j])
        total = 0.0
        for j in range(m):
            like = np.exp(loglik[k, j] - most) if loglik[k, j] - most > UNLIKELY else RARE
            went = keep * a[j] + switch * (a[max(j - 1, 0)] + a[min(j + 1, m - 1)])
            b[j] = went * like
            total += b[j]
        share = 1.0 / total
        for j in range(m):
            a[j] = b[j] * share
            loglik[k, j] = a[j]
    b[:] = 1.0  # b: probability after this sample over what the past alone foretells
    for k in range(n - 1, -1, -1):
        mean, total = 0.0, 0.0
        for j in range(m):
            a[j] = loglik[k, j]
            if k < n - 1:
                a[j] *= keep * b[j] + switch * (b[max(j - 1, 0)] + b[min(j + 1, m - 1)])
            total += a[j]
            mean += j * a[j]
        share = 1.0 / total
        out[k] = mean * share
        if k > 0:
            for j in range(m):
                before = keep * loglik[k - 1, j] + switch * (
                    loglik[k - 1, max(j - 1, 0)] + loglik[k - 1, min(j + 1, m - 1)]
                )
                b[j] = share * a[j] / max(before, 1e-300)


@kernel
def score(
    tau: Array, z: Array, noise: Array, drive: Array, start: Array, spread: Array, work: Array, out: Array, fits: Array
) -> float:
    """Log-likelihood, and what it says of the intensity at each sample and of the noise of each kind of measurement.

    With r and N of the disturbance smoother (de Jong 1989; Durbin & Koopman 2012, 4.5) the derivative of the
    log-likelihood by the logarithm of a sample's intensity s is ½ (s rᵀ Q r − s tr Q N): the energy found there, less
    what was to be expected of it. Their quotient, over a window, is the factor by which the intensity there is to grow.

    Args:
        tau: (n,). z: measurements of position, velocity and acceleration, or of the first c of these, (n, c).
        noise: their variances, (n, c). drive: intensities of the steps, (n,).
        start, spread: before the first sample, (d,) and (d, d). work: (n, c, 2 + d), to write into.
        out: energy found and expected, in units of a degree of freedom, (n, 2).
        fits: for each kind of measurement the same two sums of its noise, (c, 2).
    """
    n, kinds = z.shape
    x, p = given(start, spread)
    last, total = 0.0, 0.0
    move, added = model(last)
    for k in range(n):
        if tau[k] != last:
            last = tau[k]
            move, added = model(last)
        if last > 0.0:
            x, p = moved(x, move), plus(around(p, move), drive[k], added)
        for c in range(kinds):
            if noise[k, c] < np.inf:
                x, p, e, f, gain = updated(x, p, c, z[k, c], noise[k, c])
                total += np.log(f) - e * e * f
                work[k, c, 0], work[k, c, 1] = e, f
                work[k, c, 2], work[k, c, 3], work[k, c, 4], work[k, c, 5] = gain
    r: State = (0.0, 0.0, 0.0, 0.0)
    big: Covariance = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    fits[:] = 0.0
    for k in range(n - 1, -1, -1):
        for c in range(kinds - 1, -1, -1):
            if noise[k, c] < np.inf:
                gain = (work[k, c, 2], work[k, c, 3], work[k, c, 4], work[k, c, 5])
                r, big, u, d = _measured_back(work[k, c, 0], work[k, c, 1], gain, c, r, big)
                fits[c, 0] += noise[k, c] * u * u
                fits[c, 1] += noise[k, c] * d
        if tau[k] != last:
            last = tau[k]
            move, added = model(last)
        out[k, 0], out[k, 1] = drive[k] * dot(r, times(added, r)), drive[k] * _trace(added, big)
        r, big = _moved_back(move, r, big)
    return 0.5 * total


@inlined
def _trace(a: Covariance, b: Covariance) -> float:
    """Trace of the product of two symmetric matrices."""
    beside = a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[5] * b[5] + a[6] * b[6] + a[8] * b[8]
    return a[0] * b[0] + a[4] * b[4] + a[7] * b[7] + a[9] * b[9] + 2.0 * beside


@inlined
def _measured_back(
    e: float, f: float, gain: State, c: int, r: State, big: Covariance
) -> tuple[State, Covariance, float, float]:
    """Backwards past a measurement: r ← (1 − K H)ᵀ r + Hᵀ e f; N ← (1 − K H)ᵀ N (1 − K H) + Hᵀ H f.

    Only what stands beside H changes. After r and N come the estimate of the measurement's error over its variance, and
    the variance of that.
    """
    through = times(big, gain)
    u, d = e * f - dot(gain, r), f + dot(gain, through)
    new = raised(further(row(big, c), -1.0, through), c, d - part(through, c))
    return raised(r, c, u), with_row(big, c, new), u, d


@inlined
def _moved_back(move: State, r: State, big: Covariance) -> tuple[State, Covariance]:
    """Backwards past a step: r ← Fᵀ r, N ← Fᵀ N F, which is F of the parts in the other order."""
    return moved_back(r, move), _turned(around(_turned(big), move))


@inlined
def _turned(p: Covariance) -> Covariance:
    """A symmetric matrix with its rows and columns in the other order."""
    return p[9], p[8], p[6], p[3], p[7], p[5], p[2], p[4], p[1], p[0]


@kernel
def in_windows(found: Array, expected: Array, width: float, out: Array) -> None:
    """Quotient of what was found and expected over windows that hold `width` degrees of freedom, (n,).

    A window is centred where as many degrees of freedom lie before as after; both sums begin with one that was as
    expected.
    """
    n = found.shape[0]
    upto, energy = np.empty(n + 1), np.empty(n + 1)
    upto[0], energy[0] = 0.0, 0.0
    for k in range(n):
        upto[k + 1], energy[k + 1] = upto[k] + expected[k], energy[k] + found[k]
    a, b = 0, 0
    for k in range(n):
        middle = 0.5 * (upto[k] + upto[k + 1])
        while a < k and upto[a + 1] < middle - 0.5 * width:
            a += 1
        while b < n and (b <= k or upto[b] < middle + 0.5 * width):
            b += 1
        out[k] = (energy[b] - energy[a] + 1.0) / (upto[b] - upto[a] + 1.0)
