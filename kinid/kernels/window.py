"""The last samples of a stream, and a cubic through those on both sides of an instant that is a little older than now.

A difference of the samples so far is late or noisy; a polynomial that is fitted around an instant is not late (Savitzky
& Golay 1964), but has to wait until what comes after that instant is there. What is estimated from a motion can wait.
A cubic over ± 8 ms follows the velocity of a motion of 10 Hz to 0.02 %, over ± 16 ms to 0.2 %, its acceleration to 2
and 8 %, and white noise of positions comes into a velocity with a third and a sixth of what it has behind the
low-passes of 40 Hz of `kinid.kernels.causal`.

Noise of velocities falls with the number of samples and with the window's length, what is cut off a motion rises with
its length: so it is `FEW` samples on each side, but no less than `DELAY` of a fast stream and no more than `LONGEST` of
a slow one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: half of the window, which is what a sample waits for: usual number of samples, and least and longest time [s]
FEW, DELAY, LONGEST = 8, 8e-3, 16e-3
#: by how much stamps may differ from these times [s]: no usual sample time has a multiple within that of the ends, so
#: that the rounding of stamps decides nothing
SLACK = 3e-4
#: samples on each side in any case, a cubic through five has one to spare; and at most
LEAST, MOST = 2, 24
#: a step so many times the usual one is a gap, as in `kinid.data`: no polynomial goes over it
GAP = 3.5
#: samples that there is room for; the more, the more seldom they are moved
SLOTS = 128

#: places of the head: samples in it; the next to be worked on; what there is besides them (see `kinid.kernels.causal`);
#: time of the last that was worked on [s]
FILLED, NEXT, PENDING, AT = range(4)
_HEAD, _WORK, _WEIGHTS = 4, 28, 3 * (2 * MOST + 1)
#: rows of samples besides positions and velocities: time, wrench
_TIME, _WRENCH = 1, 6
#: numbers of a window, and of each joint in it
FIXED, EACH = _HEAD + _WORK + _WEIGHTS + (_TIME + _WRENCH) * SLOTS, 2 * SLOTS


class Parts(NamedTuple):
    """Views of a window."""

    work: Array  # (4, 7)
    weights: Array  # for value and both derivatives, (3, 2 MOST + 1)
    times: Array  # (SLOTS,)
    q: Array  # (N, SLOTS)
    dq: Array  # (N, SLOTS), NaN where there are none
    wrench: Array  # (6, SLOTS)


@njit(error_model="numpy", forceinline=True)
def parts(window: Array, joints: int) -> Parts:
    """The parts of a window."""
    rows, n = window[_HEAD + _WORK + _WEIGHTS :], joints * SLOTS
    return Parts(
        window[_HEAD : _HEAD + _WORK].reshape(4, 7),
        window[_HEAD + _WORK : _HEAD + _WORK + _WEIGHTS].reshape(3, 2 * MOST + 1),
        rows[:SLOTS],
        rows[SLOTS : SLOTS + n].reshape(joints, SLOTS),
        rows[SLOTS + n : SLOTS + 2 * n].reshape(joints, SLOTS),
        rows[SLOTS + 2 * n :].reshape(_WRENCH, SLOTS),
    )


@njit(error_model="numpy", forceinline=True)
def clear(window: Array) -> None:
    """Forget all samples."""
    window[FILLED] = window[NEXT] = 0.0


@njit(error_model="numpy", forceinline=True)
def push(t: float, q: Array, dq: Array, wrench: Array, columns: Array, window: Array) -> None:
    """Take in a sample, and forget those before a gap.

    Args:
        t: time [s], which has grown. q: positions, (N,), in the log's order; dq velocities, or of length 0.
        wrench: (6,). columns: places of the chain's joints in the log's order.
    """
    n, filled = len(columns), int(window[FILLED])
    p = parts(window, n)
    if filled > 1:
        step, usual = t - p.times[filled - 1], (p.times[filled - 1] - p.times[0]) / (filled - 1)
        if step > GAP * usual or (filled == 2 and usual > GAP * step):
            filled = 0
            clear(window)
    if filled == SLOTS:
        # where nobody asks for what is due, the oldest go all the same
        first = max(int(window[NEXT]) - MOST, SLOTS - 3 * MOST)
        rows = window[_HEAD + _WORK + _WEIGHTS :]
        for start in range(0, len(rows), SLOTS):
            for k in range(first, SLOTS):
                rows[start + k - first] = rows[start + k]
        filled -= first
        window[NEXT] = max(window[NEXT] - first, 0.0)
    p.times[filled] = t
    for j in range(n):
        p.q[j, filled] = q[int(columns[j])]
        p.dq[j, filled] = dq[int(columns[j])] if len(dq) > 0 else np.nan
    for i in range(_WRENCH):
        p.wrench[i, filled] = wrench[i]
    window[FILLED] = filled + 1


@njit(error_model="numpy", forceinline=True)
def _is_whole(samples: int, span: float) -> bool:
    """Whether so many samples of so much time [s] are all of a window's side."""
    long_enough = span >= LONGEST - SLACK or (samples >= FEW and span >= DELAY - SLACK)
    return samples >= MOST or (samples >= LEAST and long_enough)


@njit(error_model="numpy", forceinline=True)
def _is_inside(samples: int, span: float) -> bool:
    """Whether the sample that is so many away, and so much time [s], is in the window."""
    near = span <= DELAY + SLACK or (samples <= FEW and span <= LONGEST + SLACK)
    return samples <= LEAST or (samples <= MOST and near)


@njit(error_model="numpy", forceinline=True)
def due(window: Array, joints: int) -> int:
    """The next sample that has all of its window around it, −1 where none has; each comes once."""
    times, filled = parts(window, joints).times, int(window[FILLED])
    while window[NEXT] < filled:
        k = int(window[NEXT])
        if not _is_whole(filled - 1 - k, times[filled - 1] - times[k]):
            return -1
        window[NEXT] = k + 1.0
        if _is_whole(k, times[k] - times[0]):
            return k
    return -1


@njit(error_model="numpy", forceinline=True)
def _weigh(times: Array, at: int, low: int, high: int, work: Array, weights: Array) -> None:
    """Weights of samples low…high (inclusive) for value, first and second derivative at `at` of a cubic through them.

    Args:
        work: scratch (4, 7): the normal equations, in times of order one. weights: (3, ≥ high − low + 1).
    """
    scale = 1.0 / max(times[high] - times[at], times[at] - times[low])
    work[:] = 0.0
    for i in range(low, high + 1):
        u = scale * (times[i] - times[at])
        v, w = u * u, u * u * u
        work[0, 0] += 1.0
        work[0, 1] += u
        work[0, 2] += v
        work[0, 3] += w
        work[1, 3] += v * v
        work[2, 3] += v * w
        work[3, 3] += w * w
    work[1, 1], work[1, 2], work[2, 2] = work[0, 2], work[0, 3], work[1, 3]
    for m in range(3):
        work[m, 4 + m] = 1.0
    # elimination of a symmetric matrix, of which the upper half is kept
    for k in range(4):
        for i in range(k + 1, 4):
            factor = work[k, i] / work[k, k]
            for j in range(i, 7):
                work[i, j] -= factor * work[k, j]
    for m in range(4, 7):
        for k in range(3, -1, -1):
            for j in range(k + 1, 4):
                work[k, m] -= work[k, j] * work[j, m]
            work[k, m] /= work[k, k]
    for i in range(low, high + 1):
        u = scale * (times[i] - times[at])
        size = 1.0
        for m in range(3):
            weights[m, i - low] = size * (
                work[0, 4 + m] + u * (work[1, 4 + m] + u * (work[2, 4 + m] + u * work[3, 4 + m]))
            )
            size *= scale * (m + 1)


@njit(error_model="numpy", forceinline=True)
def move_to(k: int, window: Array, joints: int, motion: Array) -> None:
    """Positions, velocities and accelerations (3, N) at sample k.

    Where velocities were given, they and their derivative; else those of the positions.
    """
    p = parts(window, joints)
    times, weights, last = p.times, p.weights, int(window[FILLED]) - 1
    low, high = k, k
    while low > 0 and _is_inside(k - low + 1, times[k] - times[low - 1]):
        low -= 1
    while high < last and _is_inside(high + 1 - k, times[high + 1] - times[k]):
        high += 1
    _weigh(times, k, low, high, p.work, weights)
    for j in range(joints):
        x, v, a = 0.0, 0.0, 0.0
        for i in range(high - low + 1):
            q = p.q[j, low + i]
            x += weights[0, i] * q
            v += weights[1, i] * q
            a += weights[2, i] * q
        if abs(p.dq[j, k]) < np.inf:
            given, change = 0.0, 0.0
            for i in range(high - low + 1):
                dq = p.dq[j, low + i]
                given += weights[0, i] * dq
                change += weights[1, i] * dq
            if abs(given) < np.inf:
                v, a = given, change
        motion[0, j], motion[1, j], motion[2, j] = x, v, a
