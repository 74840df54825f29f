"""Noise of measured positions: white noise from differences, and a lattice of steps."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

Array = NDArray[np.float64]

#: orders of the differences that white noise is told from: of a faster motion the higher ones hold less
ORDERS = (3, 4, 5, 6)
#: share of the noise of the lowest order that the highest one finds where there is noise
NOISY = 0.7
#: normal standard deviations in a median absolute deviation
ROBUST = 1.4826
#: variance of a third difference of white noise of variance 1
THIRD_DIFFERENCE = 20.0
#: noise is at least this share of the range of the positions, and of their size, which is what 64 bits hold
FLOOR, DIGITS = 1e-9, 4e-16
#: of its size, what a number is off by rounding
REPEATED = 2e-16
#: samples that a lattice is looked for in
LOOKED_AT = 20_000
#: share of gaps between neighbouring values that are whole steps of a lattice
WHOLE = 0.98
#: gaps that a step is refined by, in steps: each time further, as it is better known
REACHES = (3.5, 10.5, 30.5)
#: a lattice has at least this number of values in use
FEWEST = 3
#: … or two, where so many samples have them
RESTING = 50
#: from so many gaps on a step is believed that no two neighbours are apart, found by so many descents
MANY, DESCENTS = 12, 8
#: an axis has moved on from a repeated position by so many times its noise, and so many times the steps before and
#: after
MOVED_ON, CAUGHT_UP = 6.0, 1.5
#: a position that stands alone is off by so many times the noise
ALONE = 8.0
#: share of the differences below the largest, and what that quantile of |N(0, 1)| is
LARGE, NORMAL_90 = 0.9, 1.645
#: the edge of a step is known to within this share of it: no lattice is even
EDGE = 0.03


def white_noise(signal: Array) -> float:
    """Standard deviation of the white noise on a smooth signal (n,): from third differences, robustly; 0 of fewer than
    8 samples.

    Of a smooth signal a third difference has next to nothing, and the median absolute deviation ignores the few samples
    at impacts.
    """
    if len(signal) < 8:
        return 0.0
    return float(ROBUST * np.median(np.abs(np.diff(signal, n=3))) / np.sqrt(THIRD_DIFFERENCE))


def white(x: Array, tau: Array | None = None) -> float:
    """Standard deviation of white noise on smooth positions (n,), robustly, from the least of several orders of
    differences.

    Args:
        x: positions, (n,). tau: steps of time before each, (n,); None: all alike.
    """
    return min((size for size in _spread(x, tau).values()), default=0.0)


def is_noise(x: Array, tau: Array | None = None) -> bool:
    """Whether differences of positions hold noise; of a motion alone, higher orders hold ever less."""
    sizes = list(_spread(x, tau).values())
    return len(sizes) == len(ORDERS) and sizes[-1] > NOISY * sizes[0] > 0.0


def evenly(t: Array, unit: float) -> Array:
    """Steps of time before each sample, in median ones, (n,), of a clock that ticks evenly and drops samples."""
    steps = np.diff(t, prepend=t[0]) / unit
    return np.where(steps > 0.5, np.maximum(np.round(steps), 1.0), steps)


def _spread(x: Array, tau: Array | None, moved: bool = False) -> dict[int, float]:
    """Noise as each order of differences tells it."""
    x = x[:LOOKED_AT]
    even = tau is None or len(tau) < 2 or np.ptp(tau[1:LOOKED_AT]) < 1e-9
    t = None if even or tau is None else np.cumsum(tau[:LOOKED_AT])
    out, difference = {}, x
    for order in range(1, max(ORDERS) + 1):
        if t is None:
            difference = np.diff(difference)
            unit = comb(2 * order, order) ** 0.5
        elif order in ORDERS and len(x) > order:
            difference, unit = weighted_differences(x, divided_differences(t, order)), 1.0
        if order in ORDERS and len(difference) >= 5 and len(x) > order:
            size = np.abs(difference)
            if moved:  # what rests on one number tells nothing of noise
                size = size[size > REPEATED * 2**order * np.abs(x).max()]
            out[order] = ROBUST * float(np.median(size)) / unit if len(size) else 0.0
    return out


def divided_differences(t: Array, order: int) -> Array:
    """Weights of divided differences over uneven times (n,), of variance 1 for white noise of 1, (order + 1, m)."""
    m = len(t) - order
    if m > 1 and not np.ptp(np.diff(t)):  # even times: all are as the first
        return np.broadcast_to(divided_differences(t[: order + 1], order), (order + 1, m))
    at = [t[i : i + m] for i in range(order + 1)]
    weights = np.ones((order + 1, m))
    for i in range(order + 1):
        for j in range(order + 1):
            if j != i:
                weights[i] /= at[i] - at[j]
    out: Array = weights / np.sqrt((weights**2).sum(axis=0))
    return out


def weighted_differences(x: Array, weights: Array) -> Array:
    """Differences of positions (n,) or (n, k) with weights of `divided_differences`, (m,) or (m, k)."""
    m = weights.shape[1]
    return np.asarray(sum((w * x[i : i + m].T).T for i, w in enumerate(weights)))


def lattice(x: Array) -> float:
    """Step of the lattice that positions (n,) lie on; 0 for none."""
    values = np.unique(x if len(x) <= LOOKED_AT else x[:: -(-len(x) // LOOKED_AT)])
    gaps = np.diff(values)
    size = float(np.abs(values).max(initial=0.0))
    gaps = gaps[gaps > 1e-13 * size]  # the same number, once more rounded
    if len(gaps) < FEWEST - 1:  # of an axis at rest, a sensor shows the neighbouring value now and then
        return float(gaps[0]) if len(gaps) and len(x) > RESTING else 0.0
    step = float(gaps.min())
    for _ in range(DESCENTS if len(gaps) >= MANY else 1):
        step = float(np.median(gaps[gaps < 1.5 * step])) if (gaps < 1.5 * step).any() else step
        # numbers that were written with few digits tell a step the better, the more of them a gap spans
        for reach in REACHES:
            near = gaps[gaps < reach * step]
            step = float(near.sum() / max(1.0, np.round(near / step).sum())) if len(near) else step
        left = np.abs(gaps - step * np.round(gaps / step))
        off = left > 0.02 * step
        if np.mean(~off) >= WHOLE:
            return step
        step = float(left[off].min())  # Euclid's way to the common measure
        if step < 1e-12 * size:
            break
    return 0.0


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of one axis as measurements: values and variances (n,), noise of a sample, the step, least noise."""

    value: Array
    variance: Array
    noise: float
    step: float
    least: float


def positions(x: Array, tau: Array | None = None, every: int = 1) -> Positions:
    """What positions (n,) say, and how surely; `tau` are the steps of time before them, (n,), None where all are alike.

    On a lattice, samples that rest on one value are one measurement: each has the variance of the step, d²/12, times
    their number m. Where one value gives way to the next, the position is at the edge between them, to within the way
    d/m that it goes in a sample. Samples interpolated between others so many times slower are taken one in so many,
    with steps interpolated.
    """
    step = lattice(x)
    least = FLOOR * float(np.ptp(x)) + DIGITS * float(np.abs(x).max(initial=0.0)) + 1e-100
    noise = max(white(x, tau), least)
    if not step and every > 1:
        sizes = _spread(x[::every], None if tau is None else np.diff(np.cumsum(tau)[::every], prepend=0.0), moved=True)
        noise = least = max(noise, min(sizes.values(), default=0.0))
    if not step:
        return Positions(x, np.full(len(x), noise**2), noise, 0.0, least)
    noise = max(noise, step / 12**0.5)
    edges = np.flatnonzero(np.diff(x)) + 1
    length = np.diff(np.r_[0, edges, len(x)])
    value, variance = x.copy(), np.repeat(length * step**2 / 12.0, length)
    many = np.minimum(length[:-1], length[1:])
    jump = x[edges] - x[edges - 1]
    single = np.abs(jump) < 1.5 * step
    edges, many, jump = edges[single], many[single], jump[single]
    value[edges] = x[edges] - 0.5 * jump * (1.0 - 1.0 / many)
    variance[edges] = step**2 * (1.0 / (12.0 * many**2) + np.where(many > 1, EDGE**2, 0.0))
    # dithered by more than a step, positions hold white noise as well
    return Positions(value, np.maximum(variance, noise**2 if noise > step else 0.0), noise, step, least)


def rough(x: Array) -> Positions:
    """What positions (n,) say whose noise hides from most of their differences, as of steps that were interpolated.

    Most such positions repeat, or differ by a sliver of a step; the largest tenth of the differences shows the step.
    """
    size = np.abs(np.diff(x, n=3))
    noise = float(np.quantile(size, LARGE)) / NORMAL_90 / THIRD_DIFFERENCE**0.5 if len(size) else 0.0
    noise = max(noise, FLOOR * float(np.ptp(x)) + DIGITS * float(np.abs(x).max(initial=0.0)) + 1e-100)
    return Positions(x, np.full(len(x), noise**2), noise, 0.0, noise)


def wrong(x: Array, tau: Array, noise: float, grid: float) -> NDArray[np.bool_]:
    """Positions (n,) that stand alone, or repeat the one before them while the axis moves on, (n,).

    Differences of order four show a single position that is off as their own weights. Where the motion itself turns at
    once, what is left beside that is more than noise.

    Args:
        x: positions. tau: steps of time before them. noise: of a position. grid: step of the lattice that they lie on,
            or 0.
    """
    out, size = np.zeros(len(x), np.bool_), max(noise, grid)
    same = np.diff(x, prepend=np.nan) == 0.0
    ends = np.flatnonzero(same & ~np.r_[same[1:], True])  # the last of each run that repeats, where the log goes on
    begins = np.flatnonzero(same & ~np.r_[False, same[:-1]])[: len(ends)]
    step = np.abs(np.diff(x, append=np.nan))
    # a hold ends with a step that those after it are as long as, and a leap there and back is one of the sensor
    around = np.maximum(step[ends + 1], step[np.maximum(begins - 2, 0)])
    moved_on = (step[ends] > MOVED_ON * size) & (step[ends] > CAUGHT_UP * around)
    for begin, end in zip(begins[moved_on], ends[moved_on]):
        out[begin : end + 1] = True
    order = 4
    kept = np.flatnonzero(~out)
    if len(kept) <= 2 * order or not size > 0.0:
        return out
    weights = divided_differences(np.cumsum(tau)[kept], order)
    m = weights.shape[1]
    x = x[kept]
    differences = weighted_differences(x, weights)
    seen, amount, energy = np.zeros(len(x)), np.zeros(len(x)), np.zeros(len(x))
    for i, w in enumerate(weights):
        seen[i : i + m] += w * w
        amount[i : i + m] += w * differences
        energy[i : i + m] += differences**2
    explained = amount**2 / np.maximum(seen, 1e-300)
    alone = (explained > ALONE**2 * size**2) & (energy - explained < 5 * (3.0 * size) ** 2)
    alone[:order] = alone[-order:] = False
    alone &= explained == maximum_filter1d(explained, 2 * order + 1)
    out[kept[alone]] = True
    return out
