"""Readings that stand still while a live sensor would at least show its noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from kinid.signal.noise import is_noise, white_noise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: of a live channel, the greatest share of readings that repeat the one before: above it the noise is below a step
LIVE = 0.5
#: a stretch of repeated readings is one that froze from this duration on [s], if it is so many times the usual one
FROZEN, UNUSUAL = 0.2, 10.0
#: samples of the median that a jump stands out of, by so many times the noise
BESIDE, JUMP_NOISE = 5, 50.0


def constant(readings: Array) -> Mask:
    """Channels of readings (n, k) that never change, (k,); what isn't a number doesn't count."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.fmax.reduce(readings, axis=0) <= np.fmin.reduce(readings, axis=0))


def noisy(channel: Array) -> bool:
    """Whether a channel (n,) shows noise from one reading to the next: one that is dead would show it, too."""
    channel = channel[np.isfinite(channel)]
    return len(channel) > 1 and float(np.mean(np.diff(channel) == 0.0)) < LIVE and is_noise(channel)


def frozen(t: Array, readings: Array, moving: Mask) -> tuple[float, float] | None:
    """Begin and duration [s] of the longest stretch of readings that repeat in all channels while something moves.

    Of a stream that is slower than the rows and held between, every reading repeats for a while: what counts is a
    stretch far longer than the usual one.

    Args:
        t: time [s], (n,). readings: of a sensor that shows noise, (n, k). moving: rows before which something else
            moved, (n,).

    Returns:
        None where there is none.
    """
    stretch = longest_repeat((readings[1:] == readings[:-1]).all(axis=1))
    if stretch is None:
        return None
    begin, last = stretch
    duration = float(t[last] - t[begin])
    return (float(t[begin]), duration) if duration > FROZEN and np.mean(moving[begin + 1 : last + 1]) > LIVE else None


def one_frozen(t: Array, readings: Array, moving: Callable[[int], Mask]) -> tuple[int, float, float] | None:
    """The first channel that repeats a reading while others go on: which, since when and for how long [s].

    One that repeats the end of its range is cut off, not frozen.

    Args:
        t: time [s], (n,). readings: (n, k). moving: rows before which something beside a channel moved, (n,).
    """
    for k, channel in enumerate(readings.T):
        held = frozen(t, channel[:, None], moving(k))
        if held is None:
            continue
        inside = (t >= held[0]) & (t <= held[0] + held[1])
        if channel[inside][0] not in (channel.min(), channel.max()) and noisy(channel[~inside]):
            return k, *held
    return None


def jumps(channel: Array, least: float) -> tuple[int, int, float] | None:
    """Readings (n,) that jump and return at once, further than `least` and many times the noise: how many, the row and
    the size of the largest.
    """
    # a median is a neighbour, at most BESIDE // 2 steps away: without a step of that share there is no jump
    steps = float(np.max(np.abs(np.diff(channel)), initial=0.0)) * (BESIDE // 2)
    if steps <= least:
        return None
    least = max(least, JUMP_NOISE * white_noise(channel))
    jump = np.abs(channel - median_filter(channel, BESIDE, mode="nearest"))
    many = int(np.sum(jump > least))
    row = int(np.argmax(jump))
    return (many, row, float(jump[row])) if many else None


def longest_repeat(same: Mask) -> tuple[int, int] | None:
    """First and last row of the longest stretch of repeated readings; None where it is no longer than usual ones.

    Args:
        same: whether each row after the first repeats the one before, (n − 1,).
    """
    begins = np.flatnonzero(~np.r_[False, same])
    length = np.diff(np.r_[begins, len(same) + 1])
    longest = int(np.argmax(length))
    if length[longest] <= UNUSUAL * np.median(length):
        return None
    return int(begins[longest]), int(begins[longest] + length[longest] - 1)
