"""How strongly a point's jerk varies along the way: Kalman filters of several intensities, and scores of one that
varies.

The state, its motion and its measurements are those of `state_space`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.kernels.state_space import LEAST, ORDER, model, moved, updated

Array = NDArray[np.float64]

#: squared innovations count to so many times their variance
MOST = 1e12
#: log-likelihoods so far below the greatest are all alike
UNLIKELY = -40.0
RARE = np.exp(UNLIKELY)
#: a gain that changes by no more than this share from sample to sample has settled: of the slowest filter it is then
#: within a millionth of where it goes to
SETTLED = 1e-10


@njit(cache=True, nogil=True, error_model="numpy")
def bank(
    tau: Array, y: Array, noise: Array, levels: Array, start: Array, spread: Array, out: NDArray[np.float32]
) -> None:
    """Log-likelihood of each position, predicted from those before it, for several intensities that stay as they are.

    Args:
        tau: step before each sample, (n,). y: positions, (n,). noise: their variances, (n,). levels: intensities, (m,).
        start: state before the first, (d,). spread: its covariance, (d, d). out: (n, m).
    """
    m = levels.shape[0]
    x, p = np.empty((ORDER, m)), np.empty((ORDER, ORDER, m))
    gain, move, added = np.empty((ORDER, m)), np.empty(ORDER), np.empty((ORDER, ORDER))
    f, e, entropy = np.empty(m), np.empty(m), np.empty(m)
    for j in range(m):
        x[:, j] = start
        p[:, :, j] = spread
    last, noise_before = -1.0, -1.0
    moving, before, slope = m, 0.0, 0.0  # gains of the levels below `moving` haven't settled: those above are faster
    for t in range(tau.shape[0]):
        z, r = y[t], noise[t]
        if tau[t] != last:
            last, moving = tau[t], m
            model(last, move, added)
        if r != noise_before:
            noise_before, moving = r, m
        if last > 0.0:
            _predict(x, p, move, added, levels, moving)
        for j in range(moving):
            f[j] = 1.0 / (max(p[0, 0, j], 0.0) + r + LEAST)
            entropy[j] = np.log(f[j])
        for j in range(m):
            e[j] = z - x[0, j]
        _update(x, p, e, f, r, gain, moving)
        for j in range(m):
            out[t, j] = 0.5 * (entropy[j] - min(e[j] * e[j] * f[j], MOST))
        if moving > 0:
            now, steep = gain[0, moving - 1], gain[ORDER - 1, moving - 1]
            if abs(now - before) <= SETTLED * now and abs(steep - slope) <= SETTLED * steep:
                moving -= 1
                before = slope = 0.0
            else:
                before, slope = now, steep


# the innermost loops below run over the intensities, whose numbers lie side by side: they compile to SIMD instructions


@njit(cache=True, nogil=True, error_model="numpy")
def _predict(x: Array, p: Array, move: Array, added: Array, levels: Array, moving: int) -> None:
    """Of each intensity: states (d, m) before the next sample, as `state_space.moved`; covariances (d, d, m) of the
    first `moving` of them.
    """
    m = levels.shape[0]
    for i in range(ORDER):
        for k in range(i + 1, ORDER):
            g = move[k - i]
            for j in range(m):
                x[i, j] += g * x[k, j]
            for b in range(ORDER):
                for j in range(moving):
                    p[i, b, j] += g * p[k, b, j]
    for i in range(ORDER):
        for b in range(i, ORDER):
            for k in range(b + 1, ORDER):
                g = move[k - b]
                for j in range(moving):
                    p[i, b, j] += g * p[i, k, j]
            q = added[i, b]
            for j in range(moving):
                p[i, b, j] += q * levels[j]
                p[b, i, j] = p[i, b, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _update(x: Array, p: Array, e: Array, f: Array, r: float, gain: Array, moving: int) -> None:
    """Of each intensity: after a position with innovations e, one over their variances f, and noise r; gains and
    covariances of the first `moving` of them.
    """
    for i in range(ORDER):
        for j in range(moving):
            gain[i, j] = p[0, i, j] * f[j]
        for j in range(e.shape[0]):
            x[i, j] += gain[i, j] * e[j]
    for i in range(1, ORDER):
        for b in range(i, ORDER):
            for j in range(moving):
                p[i, b, j] -= gain[i, j] * p[0, b, j]
                p[b, i, j] = p[i, b, j]
    for i in range(ORDER):
        for j in range(moving):
            p[0, i, j] = p[i, 0, j] = r * gain[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def local_level(loglik: NDArray[np.float32], switch: float, out: Array) -> None:
    """Mean number of the level that is at work at each sample, levels that follow each other as a hidden Markov chain.

    From one sample to the next a level goes up or down by one with the probability `switch` (Rabiner 1989).

    Args:
        loglik: (n, m); gets the probabilities of the levels. out: (n,).
    """
    n, m = loglik.shape
    keep = 1.0 - 2.0 * switch
    a, b = np.full(m, 1.0 / m), np.empty(m)
    like = np.empty(m)
    for k in range(n):  # what the past says, kept in the place of the likelihood
        most = loglik[k, 0]
        for j in range(1, m):
            most = max(most, loglik[k, j])
        total = 0.0
        for j in range(m):
            like[j] = np.exp(loglik[k, j] - most) if loglik[k, j] - most > UNLIKELY else RARE
            went = keep * a[j] + switch * (a[max(j - 1, 0)] + a[min(j + 1, m - 1)])
            b[j] = went * like[j]
            total += b[j]
        for j in range(m):
            a[j] = b[j] / total
            loglik[k, j] = a[j]
    b[:] = 1.0  # b: probability after this sample over what the past alone foretells
    for k in range(n - 1, -1, -1):
        mean, total = 0.0, 0.0
        for j in range(m):
            a[j] = loglik[k, j]
            if k < n - 1:
                a[j] *= keep * b[j] + switch * (b[max(j - 1, 0)] + b[min(j + 1, m - 1)])
            total += a[j]
        for j in range(m):
            a[j] /= total
            mean += j * a[j]
        out[k] = mean
        if k > 0:
            for j in range(m):
                before = keep * loglik[k - 1, j] + switch * (
                    loglik[k - 1, max(j - 1, 0)] + loglik[k - 1, min(j + 1, m - 1)]
                )
                b[j] = a[j] / max(before, 1e-300)


@njit(cache=True, nogil=True, error_model="numpy")
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
    x, p = start.copy(), spread.copy()
    move, added = np.empty(ORDER), np.empty((ORDER, ORDER))
    total, last = 0.0, -1.0
    for k in range(n):
        if tau[k] != last:
            last = tau[k]
            model(last, move, added)
        if last > 0.0:
            moved(x, p, move, added, drive[k])
        total += _measured(x, p, z[k], noise[k], work[k])
    r, big, through = np.zeros(ORDER), np.zeros((ORDER, ORDER)), np.empty(ORDER)
    fits[:] = 0.0
    for k in range(n - 1, -1, -1):
        for c in range(kinds - 1, -1, -1):
            if noise[k, c] < np.inf:
                _measured_back(work[k, c], c, noise[k, c], r, big, through, fits[c])
        if tau[k] != last:
            last = tau[k]
            model(last, move, added)
        found, expected = 0.0, 0.0
        for i in range(ORDER):
            for j in range(ORDER):
                found += added[i, j] * r[i] * r[j]
                expected += added[i, j] * big[i, j]
        out[k, 0], out[k, 1] = drive[k] * found, drive[k] * expected
        _moved_back(move, r, big)
    return 0.5 * total


@njit(cache=True, nogil=True, error_model="numpy")
def _measured(x: Array, p: Array, z: Array, noise: Array, out: Array) -> float:
    """Take in what was measured at a sample; twice its log-likelihood, and e, f, K of each part, (c, 2 + d)."""
    total = 0.0
    for c in range(len(z)):
        if noise[c] < np.inf:
            e, f = updated(x, p, c, z[c], noise[c], out[c, 2:])
            total += np.log(f) - e * e * f
            out[c, 0], out[c, 1] = e, f
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _measured_back(measured: Array, c: int, noise: float, r: Array, big: Array, through: Array, fit: Array) -> None:
    """Backwards past a measurement: r ← (1 − K H)ᵀ r + Hᵀ e f; N ← (1 − K H)ᵀ N (1 − K H) + Hᵀ H f.

    Only what stands beside H changes.

    Args:
        measured: e, f and K of part c, (2 + d,). through: scratch, (d,). fit: gets the two sums of its noise, (2,).
    """
    e, f, gain = measured[0], measured[1], measured[2:]
    along, twice = 0.0, 0.0
    for i in range(ORDER):  # N K, Kᵀ r and Kᵀ N K
        through[i] = 0.0
        for j in range(ORDER):
            through[i] += big[i, j] * gain[j]
        along += gain[i] * r[i]
    for i in range(ORDER):
        twice += gain[i] * through[i]
    u, d = e * f - along, f + twice
    fit[0] += noise * u * u
    fit[1] += noise * d
    r[c] += u
    for i in range(ORDER):
        if i != c:
            big[i, c] -= through[i]
            big[c, i] = big[i, c]
    big[c, c] += d - 2.0 * through[c]


@njit(cache=True, nogil=True, error_model="numpy")
def _moved_back(move: Array, r: Array, big: Array) -> None:
    """Backwards past a step: r ← Fᵀ r, N ← Fᵀ N F."""
    for i in range(ORDER - 1, -1, -1):
        for j in range(i):
            r[i] += move[i - j] * r[j]
            for b in range(ORDER):
                big[i, b] += move[i - j] * big[j, b]
    for b in range(ORDER):
        for i in range(ORDER - 1, -1, -1):
            for j in range(i):
                big[b, i] += move[i - j] * big[b, j]


@njit(cache=True, nogil=True, error_model="numpy")
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
