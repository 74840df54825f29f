"""When positions were measured: as stamped, at an even clock, or where all axes together say that it was.

A sampler that ticks evenly is often stamped when a message arrives; messages come late, or bring what the one before
brought. Each such error moves all axes along their motion at once, which nothing else does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from kinid.signal.noise import DIGITS, FLOOR, ROBUST, divided_differences, evenly, lattice, weighted_differences, white

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: stamps are looked at that are this far from an even clock, in samples; noise that an even one takes off, on a
#: logarithmic scale
JITTER, EVEN = 1e-6, -0.4
#: digits to which steps of an even clock are rounded, in samples: where they are the same number, filters settle
ROUND = 8
#: noise of the axes that times of their own take off: of two axes that move together, any noise can lose half of its
#: variance
OWN_TIMES, FEW = -0.6, 0.95
#: order of the differences that a smooth motion has next to none of; turns in which times, speeds and noise are found
ORDER, TURNS = 4, 6
#: samples of a window that tells speeds; fewest samples and least step of time, in samples
WINDOW, FEWEST, LEAST_STEP = 15, 60, 0.02
#: share of an axis' noise that is its own to begin with, and at least
OWN, LEFT = 0.3, 1e-3
#: degrees of freedom of Student's distribution of errors of time: most are small, few are a whole message
TAIL = 4.0
#: errors of time that are smaller are none, in samples
UNSEEN = 1e-3


def time_steps(t: Array, value: Array, runs: Sequence[Rows], unit: float) -> list[Array]:
    """Steps of time of each run, in units of the median one; the first of each is 0.

    Args:
        t: stamps [s], (n,). value: positions, (n, k). runs: rows without a gap. unit: median step [s].
    """
    stamped = [np.diff(t[rows], prepend=t[rows[0]]) / unit for rows in runs]
    if not runs:
        return stamped
    even = [evenly(t[rows], unit) for rows in runs]
    longest = max(range(len(runs)), key=lambda i: len(runs[i]))
    rows, steps = runs[longest], stamped
    if np.abs(stamped[longest] - even[longest]).max(initial=0.0) <= JITTER:
        return [np.round(tick, ROUND) for tick in stamped]
    if _quieter(value[rows], value[rows], stamped[longest], even[longest]) < EVEN:
        scale = float(stamped[longest].sum() / even[longest].sum())
        steps = [tick * scale for tick in even]
    if value.shape[1] > 1 and len(rows) >= FEWEST:
        late = _late(value[rows], steps[longest])
        if late is not None:
            return [
                _moved(tau, own)
                for tau, own in zip(steps, (_late(value[r], tau, ask=False) for r, tau in zip(runs, steps)))
            ]
    return steps


def _moved(tau: Array, late: Array | None) -> Array:
    """Steps of time where each sample is so much later than its stamp, in samples."""
    if late is None:
        return tau
    least = LEAST_STEP * np.arange(len(tau))
    return np.diff(np.maximum.accumulate(np.cumsum(tau) + late - least) + least, prepend=late[0])


def _quieter(before: Array, after: Array, tau: Array, other: Array) -> float:
    """Logarithm of the noise of positions (n, k) at other times over that at these, the mean of all axes."""
    gain = [
        np.log(max(white(y, other), least) / max(white(x, tau), least))
        for x, y, least in zip(before.T, after.T, _least(before))
    ]
    return float(np.mean(gain))


def _rarely_quieter(before: Array, after: Array, at: Array) -> float:
    """The same of the one difference in twenty that is the largest: where few stamps are wrong, by much."""
    weights = divided_differences(at, ORDER)

    def size(x: Array) -> Array:
        largest = np.quantile(np.abs(weighted_differences(x, weights)), FEW, axis=0)
        out: Array = np.maximum(0.5 * largest, _least(before))
        return out

    return float(np.mean(np.log(size(after) / size(before))))


def _least(x: Array) -> Array:
    """Least noise that positions (n, k) have, (k,)."""
    return np.array([FLOOR * np.ptp(row) + DIGITS * np.abs(row).max() + lattice(row) / 12**0.5 + 1e-100 for row in x.T])


def _late(x: Array, tau: Array, ask: bool = True) -> Array | None:
    """How much later than its stamp each row was measured, in samples, (n,); None where that explains too little of the
    noise.

    Positions less the way since their stamp, y = x − v δ, are to be smooth: δ minimises Σ |D (x − v δ)|²/s² + Σ δ²/σ²,
    D divided differences, s the noise of each axis that is left, σ² = (ν σ₀² + δ²)/(ν + 1) with the usual size σ₀ of δ,
    as Student's distribution has it (K. L. Lange et al., J. Am. Stat. Assoc. 84, 1989).

    Args:
        x: positions (n, k). tau: steps of time. ask: whether it must explain most of the noise.
    """
    x = x[:, np.ptp(x, axis=0) > 0.0]  # axes that stand still know nothing of time
    n, k = x.shape
    if n < FEWEST or not k:
        return None
    at, least = np.cumsum(tau), _least(x)
    noise = np.maximum([white(column, tau) for column in x.T], least)
    left, late = np.maximum(OWN * noise, least), np.zeros(n)
    v = _speed(x, at, late)
    size = np.full(n, np.median(noise / np.maximum(np.sqrt(np.mean(v**2, axis=0)), 1e-300)))
    if size[0] < UNSEEN:
        return None
    for turn in range(TURNS):
        if turn:  # few are far off: what all share they have from their stamps
            v = _speed(x - late[:, None] * v, at, np.zeros(n))
            usual = max(UNSEEN, ROBUST * float(np.median(np.abs(late))))
            size = np.sqrt((TAIL * usual**2 + late**2) / (TAIL + 1.0))
        try:
            late = _least_squares(x, v, at, left, size)
        except np.linalg.LinAlgError:  # numbers that differ too much in size
            return None
        y = x - late[:, None] * v
        left = np.maximum(np.maximum([white(column, tau) for column in y.T], LEFT * noise), least)
    if ask and min(_quieter(x, y, tau, tau), _rarely_quieter(x, y, at)) > OWN_TIMES:
        return None
    return late


def _speed(x: Array, at: Array, late: Array) -> Array:
    """Speeds of rows (n, k), in positions a sample."""
    window = min(WINDOW, (len(x) - 1) // 2 * 2 + 1)
    from scipy.signal import savgol_filter  # it brings scipy.stats, which takes longer to load than most commands run

    way = savgol_filter(x, window, 3, deriv=1, axis=0)
    steps = savgol_filter(at + late, window, 3, deriv=1)
    return np.asarray(way / np.maximum(steps, LEAST_STEP)[:, None])


def _least_squares(x: Array, v: Array, at: Array, noise: Array, size: Array) -> Array:
    """The δ of `_late`, (n,)."""
    n, weights = len(x), divided_differences(at, ORDER)  # (ORDER + 1, m)
    m = weights.shape[1]
    speed = np.ascontiguousarray((v / noise).T)
    curved = weighted_differences(x / noise, weights).T
    band, right = np.zeros((ORDER + 1, n)), np.zeros(n)
    for i, w in enumerate(weights):
        right[i : i + m] += w * np.einsum("km,km->m", curved, speed[:, i : i + m])
    for lag in range(ORDER + 1):  # upper band: row ORDER is the diagonal
        squared = np.einsum("kn,kn->n", speed[:, : n - lag], speed[:, lag:])
        for i in range(ORDER + 1 - lag):
            band[ORDER - lag, i + lag : i + lag + m] += weights[i] * weights[i + lag] * squared[i : i + m]
    band[ORDER] += 1.0 / size**2
    return np.asarray(solveh_banded(band, right))
