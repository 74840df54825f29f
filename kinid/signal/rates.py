"""Logged velocities and accelerations against those of the positions: bias, gain, delay, and noise with its memory.

ẋ_logged(t) = b + g ẋ(t − δ) + noise. The estimate that the logged rate is held against must not know of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.state_space import ORDER
from kinid.signal.axis import Axis
from kinid.signal.noise import DIGITS, FLOOR, ROBUST, is_noise, lattice, white

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: blocks that standard errors are told from, and those by which what is off must exceed them
BLOCKS, SURE = 24, 4.0
#: a gain closer to 1 than this is 1: rates come from the encoder that positions come from, in the wrong unit or in the
#: right one
GAIN = 0.05
#: no unit is so many times another: what has such a gain is no rate of the positions
ALIEN = 1e7
#: rounds of learning; each puts the clock right to second order of what it is off
ROUNDS = 3
#: means over so many samples show a memory in the noise, but over no longer than this [s]
SIZES, LONGEST = (1, 2, 4, 8, 16, 32, 64, 128, 256), 0.5
#: what the estimate says of its own variance is trusted to this share
TRUSTED = 0.3
#: variances closer than this are alike: rounding must not choose among samples
SAMENESS = 1.01
#: samples over which what is left is looked at locally, and how much more than expected it must be there
NEARBY, UNUSUAL = 15, 2.0
#: turns that the estimate smooths are sharper than it says by about this
LAG = 2.0
#: rates whose noise correlates this much with that of the positions, at one of so many lags, are made of them
SAME, MIXED = 0.3, 4


@dataclass(frozen=True, eq=False)
class Learnt:
    """What is known of one axis' logged rate.

    Attributes:
        bias [unit of the rate], gain [1], delay [s]: as they are taken out; 0, 1, 0 where they can't be told from
        nothing.
        scale: the gain as it was found, whether it is taken out or not.
        noise: standard deviation of white noise that weighs as much as what is left. memory: its variance over that of
            a sample.
        lag: what is left follows the next derivative but one, so many times: a filter that is no plain delay [s²].
        errors: standard errors of bias, gain and delay, infinite where nothing tells them, (3,).
        quieter: share of its variance that it may turn out to have.
        local: for each piece, how many times the variance is greater nearby, (n,).
    """

    bias: float
    gain: float
    delay: float
    scale: float
    noise: float
    memory: float
    lag: float
    errors: Array
    quieter: float
    local: list[NDArray[np.float32]] = field(repr=False)

    def measurements(self, t: Array, logged: Array, piece: int) -> tuple[Array, Array]:
        """The rate of one piece put right, (n,), and its variance, infinite where there is none."""
        value = _shifted(t, logged, self.delay)
        good = np.isfinite(value)
        variance = np.where(good, (self.noise / self.gain) ** 2 * self.local[piece], np.inf)
        return np.where(good, (value - self.bias) / self.gain, 0.0), variance


def figures(several: Sequence[Learnt]) -> dict[str, object]:
    """What is known of all axes, as plain types."""
    names = ("bias", "gain", "delay", "scale", "noise", "memory")
    out: dict[str, object] = {name: [float(getattr(one, name)) for one in several] for name in names}
    return out | {"errors": [one.errors.tolist() for one in several]}


def learn(t: Array, x: Array, pieces: Sequence[tuple[Rows, Axis]], logged: Array, order: int, unit: float) -> Learnt:
    """Hold a logged rate (n,) of this order against the pieces' estimate of it; `x` are the logged positions."""
    states = [axis.smoothed()[:2] for _, axis in pieces]
    positions = [x[rows] - state[:, 0] for (rows, _), (state, _) in zip(pieces, states)]
    times = [t[rows] for rows, _ in pieces]
    rate = [state[:, order] / unit**order for state, _ in states]
    after = [state[:, order + 1] / unit ** (order + 1) for state, _ in states]
    variance = [sd[:, order] ** 2 / unit ** (2 * order) for _, sd in states]
    below = [sd[:, order - 1] ** 2 / unit ** (2 * order - 2) for _, sd in states]
    jerk = [state[:, order + 2] / unit ** (order + 2) for state, _ in states] if order + 2 < ORDER else []
    del states  # the largest of all
    bias, gain, delay, errors = 0.0, 1.0, 0.0, np.full(3, np.inf)
    noise, scale = 0.0, 1.0
    for _ in range(ROUNDS):
        seen = [_shifted(at, logged[rows], delay) for at, (rows, _) in zip(times, pieces)]
        one, a, d, own = (np.concatenate(x) for x in (seen, rate, after, variance))
        good = np.isfinite(one)
        if good.sum() < 8:
            return Learnt(
                0.0, 1.0, 0.0, 1.0, np.inf, 1.0, 0.0, errors, 1.0, [np.ones(len(at), np.float32) for at in times]
            )
        bias, gain, more, scale, errors, noise = _regress(one[good], a[good], d[good], own[good], noise, bias, scale)
        delay = delay + more
        if abs(more) < 0.02 * unit:
            break
    left = [(z - bias) / gain - a for z, a in zip(seen, rate)]
    # whatever the estimate is like, differences of neighbours and a lattice tell what is there at least
    plain = np.concatenate([logged[rows] for rows, _ in pieces])
    plain = plain[np.isfinite(plain)]
    step = lattice(plain) / 12**0.5 / abs(gain)
    floor = (FLOOR * float(np.ptp(plain)) + DIGITS * float(np.abs(plain).max(initial=0.0)) + 1e-100) / abs(gain)
    least = max(white(plain) / abs(gain), step, floor)
    noise, memory = _noise(left, variance, below, plain / gain, unit, least)
    quieter = min(1.0, (max(step, floor) / noise) ** 2) if noise < UNUSUAL * least else 1.0
    if not 1.0 / ALIEN < abs(scale) < ALIEN or _derived(
        [x[rows] for rows, _ in pieces], positions, left, pieces[0][1].tau
    ):
        noise = np.inf
    # what is not known of the rate, and a lag that is no delay, stay in it as errors; those of offset and gain last,
    # and weigh as white noise does that leads as far away
    lasting = (LONGEST / unit) ** 0.5 if unit < LONGEST else 1.0
    known = np.where(np.isfinite(errors), errors, 0.0) / abs(scale or 1.0)
    lag, spread = 0.0, [lasting * (known[0] + known[1] * np.abs(a)) for a in rate]
    if jerk:
        lag = _lag(np.concatenate(left), np.concatenate(jerk), np.concatenate(variance), noise)
        spread = [LAG * lag * np.abs(j) + s for s, j in zip(spread, jerk)]
    clock = errors[2] if np.isfinite(errors[2]) else 0.0  # its error is one of time, whatever the gain
    spread = [s + clock * np.abs(d) for s, d in zip(spread, after)]
    local = [_nearby(e, v, s, noise) for e, v, s in zip(left, variance, spread)]
    return Learnt(bias, gain, delay, scale, noise * abs(gain), memory, lag, errors, quieter, local)


def together(several: Sequence[Learnt]) -> list[Learnt]:
    """Axes share a clock: one that can't tell its delay has that of the others."""
    known = [one for one in several if one.delay and np.isfinite(one.errors[2])]
    if not known:
        return list(several)
    weight = np.array([1.0 / one.errors[2] ** 2 for one in known])
    common = float(weight @ [one.delay for one in known] / weight.sum())
    return [
        one if one.delay else replace(one, delay=common) if abs(common) < SURE * one.errors[2] else one
        for one in several
    ]


def _regress(
    z: Array, rate: Array, after: Array, own: Array, noise: float, bias: float, scale: float
) -> tuple[float, float, float, float, Array, float]:
    """Bias, gain and delay that are surely there, the gain as found, their standard errors, and the noise that is left.

    Blocks that are left out in turn tell the errors, whatever memory the noise has (Künsch 1989).
    """
    design = np.stack([np.ones_like(rate), rate, -after])
    first = z - bias - scale * rate
    spread = ROBUST * float(np.median(np.abs(first - np.median(first)))) + 1e-300
    for _ in range(2):  # the second time without what stands out
        weight = 1.0 / (spread**2 + own)
        keep = np.abs(first) < 6.0 * np.sqrt(spread**2 + own) + (np.inf if noise == 0.0 else 0.0)
        weight = weight * keep
        edges = np.linspace(0, len(z), BLOCKS + 1).astype(int)
        squares = np.array([(design[:, a:b] * weight[a:b]) @ design[:, a:b].T for a, b in zip(edges[:-1], edges[1:])])
        products = np.array([(design[:, a:b] * weight[a:b]) @ z[a:b] for a, b in zip(edges[:-1], edges[1:])])
        values, errors = _jackknife(squares, products)
        first = z - values @ design
        noise = spread = ROBUST * float(np.median(np.abs(first - np.median(first)))) + 1e-300
    # what the estimate does not know of its own rate makes a gain of its own
    own_gain = float(weight @ np.minimum(own, rate**2 + own.min()) / max(float(weight @ rate**2), 1e-300))
    errors[:2] += own_gain * np.array([abs(float(weight @ rate)) / max(float(weight.sum()), 1e-300), abs(values[1])])
    delay = values[2] / values[1] if values[1] else 0.0
    errors = np.array([errors[0], errors[1], errors[2] / max(abs(values[1]), 1e-300)])
    bias = float(values[0]) if abs(values[0]) > SURE * errors[0] else 0.0
    gain = float(values[1]) if abs(values[1] - 1.0) > max(SURE * errors[1], GAIN) and values[1] != 0.0 else 1.0
    return bias, gain, float(delay) if abs(delay) > SURE * errors[2] else 0.0, float(values[1]), errors, noise


def _jackknife(squares: Array, products: Array) -> tuple[Array, Array]:
    """Least squares of blocks' sums, (3,), and its standard errors from leaving out one block in turn, (3,)."""
    whole, right = squares.sum(axis=0), products.sum(axis=0)
    size = np.sqrt(np.diag(whole))
    excited = size > 0
    excited[1:] &= size[1:] > 0
    values, errors = np.array([0.0, 1.0, 0.0]), np.full(3, np.inf)
    at = np.flatnonzero(excited)
    scale = np.outer(size[at], size[at])
    if not len(at) or np.linalg.cond(whole[np.ix_(at, at)] / scale) > 1e8:
        return values, errors

    def solve(a: Array, b: Array) -> Array:
        out: Array = np.linalg.lstsq(a[np.ix_(at, at)] / scale, b[at] / size[at], rcond=1e-10)[0] / size[at]
        return out

    others = np.array([solve(whole - a, right - b) for a, b in zip(squares, products)])
    many = len(others)
    values[at] = solve(whole, right)
    errors[at] = np.sqrt((many - 1) / many * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    return values, errors


def _lag(left: Array, jerk: Array, own: Array, noise: float) -> float:
    """How much of what is left goes with the next derivative but one, with twice its error [s²].

    A rate that was filtered is v + κ v̈ with κ > 0 beside its delay; what the estimate itself smoothed away has the
    other sign.
    """
    good = np.isfinite(left) & np.isfinite(jerk) & np.isfinite(own)
    if good.sum() < BLOCKS or not noise < np.inf:
        return 0.0
    weight = 1.0 / (own[good] + noise**2)
    squares, products = (
        np.add.reduceat(x, np.linspace(0, good.sum(), BLOCKS + 1).astype(int)[:-1])
        for x in (weight * jerk[good] ** 2, weight * jerk[good] * left[good])
    )
    if not squares.sum() > 0.0:
        return 0.0
    found = products.sum() / squares.sum()
    error = float(np.sqrt(((products - found * squares) ** 2).sum()) / squares.sum())
    return float(found + 2.0 * error) if found > 2.0 * error else 0.0


def _noise(
    left: Sequence[Array], own: Sequence[Array], below: Sequence[Array], logged: Array, unit: float, least: float
) -> tuple[float, float]:
    """Standard deviation of white noise that weighs as much as what is left, and how many times its variance is a
    sample's.

    Means over m samples have the variance s²/m of white noise; what has a memory has more. Of the estimate's own error
    they hold little, for its integral is the position's error: 2 P/(m h)². Where positions tell too little, differences
    of the logged rate's own means tell its memory (Allan 1966), as far as what is left allows it.
    """
    variance, noisy = least**2, True
    sample = variance
    for m in SIZES:
        if m > 1 and m * unit > LONGEST:
            break
        means = np.concatenate([_means(e, m) for e in left])
        expected = np.concatenate([_means(v, m) for v in own])
        if m > 1:
            ends = np.concatenate([_means(p, m) for p in below])
            expected = np.minimum(expected, 2.0 * ends / (m * unit) ** 2)
        good = np.isfinite(means) & np.isfinite(expected)
        if good.sum() < 16:
            break
        means, expected = means[good], expected[good]
        # of half of the samples, those whose rate the positions know best
        best = expected <= SAMENESS * np.median(expected)
        found = (ROBUST * float(np.median(np.abs(means[best])))) ** 2
        theirs = float(np.median(expected[best]))
        doubt = (found + theirs) * (2.0 / best.sum()) ** 0.5 + TRUSTED * theirs
        variance = max(variance, m * (found - theirs - doubt))
        noisy = noisy and is_noise(_means(logged, m))
        if noisy:
            variance = max(variance, m * min(found, white(_means(logged, m)) ** 2))
        sample = variance if m == 1 else sample
    return variance**0.5, variance / sample


def _derived(x: Sequence[Array], off: Sequence[Array], left: Sequence[Array], tau: Array) -> bool:
    """Whether the noise of the rates, `left`, is that of the positions, `off`: such rates tell nothing new."""
    if not is_noise(x[0], tau) and not lattice(np.concatenate(x)):
        return False
    theirs, ours = [], []
    for d, e in zip(off, left):
        if len(e) > 8:
            theirs.append(np.diff(d, n=3))
            ours.append(np.diff(e, n=2))
    if not theirs:
        return False
    for lag in range(-MIXED, MIXED + 1):
        a, b = np.concatenate([_cut(p, lag) for p in theirs]), np.concatenate([_cut(o[1:], -lag) for o in ours])
        good = np.isfinite(a) & np.isfinite(b)
        a, b = a[good], b[good]
        if len(a) < 50:
            return False
        a, b = _bounded(a), _bounded(b)
        size = float(a.std() * b.std())
        if size > 0.0 and abs(float(np.mean((a - a.mean()) * (b - b.mean())))) > SAME * size:
            return True
    return False


def _bounded(x: Array) -> Array:
    """Without what stands out: motion that isn't smooth."""
    most = 3.0 * ROBUST * float(np.median(np.abs(x))) or 3.0 * float(np.std(x))
    return np.clip(x, -most, most)


def _cut(x: Array, lag: int) -> Array:
    """Without so many at the beginning, or at the end, and as many less elsewhere that all lags are of one length."""
    return x[max(lag, 0) : len(x) + min(lag, 0)]


def _nearby(left: Array, own: Array, spread: Array, noise: float) -> NDArray[np.float32]:
    """How many times the variance is greater nearby, at least 1, (n,): where turns are filtered away, or noise comes
    and goes.

    Args:
        left: of the rate beside the estimate. own: variance of the estimate. spread: of what is known to be uncertain,
            (n,).
    """
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    if not len(left) or not 0.0 < noise < np.inf:
        return np.ones(len(left), np.float32)
    squares = uniform_filter1d(np.where(np.isfinite(left), left, 0.0) ** 2, NEARBY, mode="nearest")
    expected = noise**2 + uniform_filter1d(own, NEARBY, mode="nearest")
    least = 1.0 + (spread / noise) ** 2
    most = np.where(squares > UNUSUAL * expected, np.maximum(squares / noise**2, least), least)
    out: NDArray[np.float32] = np.minimum(maximum_filter1d(most, NEARBY, mode="nearest"), 1e30).astype(np.float32)
    return out


def _means(x: Array, m: int) -> Array:
    """Means over m neighbours each."""
    n = len(x) // m * m
    out: Array = x[:n].reshape(-1, m).mean(axis=1)
    return out


def _shifted(t: Array, x: Array, delay: float) -> Array:
    """What was logged a delay later, (n,); NaN beyond the last sample."""
    if delay == 0.0 or len(t) < 2:
        return np.array(x, dtype=np.float64)
    # what is no number makes what is interpolated beside it none: nothing is interpolated over what is missing
    return np.interp(t + delay, t, np.where(np.isfinite(x), x, np.nan), left=np.nan, right=np.nan)
