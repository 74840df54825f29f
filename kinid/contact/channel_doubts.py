"""Channels of the wrench, or single readings, that no sensor gives: copies, zeros, jumps, one that stood still."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import WRENCH
from kinid.signal.noise import white_noise
from kinid.signal.stuck import jumps, noisy, one_frozen

Array = NDArray[np.float64]

UNITS = 3 * ("N",) + 3 * ("N·m",)
#: a jump is further than this share of the usual range; logs of fewer samples say nothing
OF_RANGE, FEWEST_SAMPLES = 0.3, 20
#: a channel of one sign is cut off where it is exactly zero in more than this share of samples; others are so many
CUT, FEWEST = 0.01, 50
#: labels of phases are fewer than this
MOST_PHASES = 50
#: a channel is cut off at an end of its readings where so many in a row are exactly there, and so many times those that
#: repeat anywhere else
IN_A_ROW, LONGER = 20, 5.0
#: a reading of exactly zero is a lost one where those around it are so many times the noise away
ZERO_NOISE = 10.0


def channel_doubts(log: Log) -> list[str]:
    """At most one sentence.

    Args:
        log: with joints and a wrench.
    """
    if log.wrench is None or log.q is None or not log.valid.any():
        return []
    wrench, t = np.asarray(log.wrench)[log.valid], log.t[log.valid]
    if len(t) < FEWEST_SAMPLES:
        return []
    return (
        _phases(log)
        or _copies(wrench, np.asarray(log.q)[log.valid])
        or _binary(wrench)
        or _lost(t, wrench)
        or _cut_off(wrench)
        or _frozen(t, wrench)
        or _jumps(t, wrench)
    )


def _phases(log: Log) -> list[str]:
    """Labels of what was done that are as many as readings are."""
    labels = set() if log.phase is None else set(log.phase.tolist())
    if log.phase is None or len(labels) <= MOST_PHASES:
        return []
    return [
        f"phase holds {len(labels)} different labels, as {str(log.phase[0])[:20]}: it is another column; name its own "
        "in [columns] of the rig, or leave it out"
    ]


def _copies(wrench: Array, q: Array) -> list[str]:
    """Two channels that hold the same numbers."""
    names = [*WRENCH, *(f"q{j + 1}" for j in range(q.shape[1]))]
    columns = np.hstack([wrench, q]).T
    live = [k for k, column in enumerate(columns) if np.ptp(column) > 0.0]
    some = columns[:, :: max(1, columns.shape[1] // 100)]
    for i, k in combinations(live, 2):
        if (some[i] == some[k]).all() and (columns[i] == columns[k]).all():
            return [
                f"{names[i]} and {names[k]} hold the same numbers throughout: one of them is a copy; name its own "
                "column in [columns] of the rig"
            ]
    return []


def _binary(wrench: Array) -> list[str]:
    """A channel that knows two values alone."""
    for name, column in zip(WRENCH, wrench.T):
        low, high = column.min(), column.max()
        if low < high and np.all((column == low) | (column == high)):
            return [
                f"{name} is {low:g} or {high:g} and nothing between: a flag, not a reading; name another column in "
                "[columns] of the rig"
            ]
    return []


def _lost(t: Array, wrench: Array) -> list[str]:
    """Readings of exactly zero among others that are far from it."""
    for name, column in zip(WRENCH, wrench.T):
        zero = column == 0.0
        one_sided = 0.0 in (column.min(), column.max())
        if one_sided and CUT * len(zero) < zero.sum() < len(zero) - FEWEST and noisy(column[~zero]):
            return [
                f"{name} is exactly 0 in {100.0 * np.mean(zero):.2g} % of the samples and has one sign alone: it is "
                "cut off at 0, or holds no readings there; record it whole"
            ]
        if not 0 < zero.sum() < 0.5 * len(zero) or not noisy(column[~zero]):
            continue
        around = np.interp(t[zero], t[~zero], column[~zero])
        far = np.abs(around) > ZERO_NOISE * white_noise(column[~zero])
        many = int(far.sum())
        if many:
            return [
                f"{name} is exactly 0 in {many} sample{'s' * (many > 1)} (the first at "
                f"{t[zero][far][0]:.4g} s) between readings that are far from it: lost ones, or cut off; leave them "
                "empty"
            ]
    return []


def _cut_off(wrench: Array) -> list[str]:
    """A channel that shows noise but at one end of its readings, or both, where many are exactly the same."""
    ends_of = np.stack([wrench.min(axis=0), wrench.max(axis=0)])
    many = np.maximum(*(np.count_nonzero(wrench == level, axis=0) for level in ends_of))
    for k in np.flatnonzero(many > IN_A_ROW):
        name, unit, column, levels = WRENCH[k], UNITS[k], wrench[:, k], ends_of[:, k]
        starts = np.flatnonzero(np.diff(column, prepend=np.nan) != 0.0)
        runs, values = np.diff(np.r_[starts, len(column)]), column[starts]
        inside = ~np.isin(values, levels)
        usual = max(IN_A_ROW, LONGER * float(runs[inside].max(initial=0)))
        ends = [level for level in levels if runs[values == level].max() > usual]
        if ends and noisy(column[~np.isin(column, ends)]):
            said = " and ".join(f"{level:.4g} {unit} in {np.sum(column == level)} samples" for level in ends)
            return [
                f"{name} is exactly {said}, and shows noise elsewhere: it is cut off there, by the range that sensor "
                "or amplifier was set to; set it higher, or leave these readings empty"
            ]
    return []


def _frozen(t: Array, wrench: Array) -> list[str]:
    """One channel that repeats a reading while the others go on."""
    changed = np.diff(wrench, axis=0, prepend=wrench[:1]) != 0.0
    held = one_frozen(t, wrench, lambda k: np.delete(changed, k, axis=1).any(axis=1))
    if held is None:
        return []
    channel, since, duration = held
    return [
        f"{WRENCH[channel]} repeats one reading for {duration:.2g} s from {since:.4g} s on, while the sensor's other "
        "channels go on: that channel stood still; leave it empty in these rows, or record anew"
    ]


def _jumps(t: Array, wrench: Array) -> list[str]:
    """Readings that jump and return at once, further than the channel usually ranges."""
    for name, unit, column in zip(WRENCH, UNITS, wrench.T):
        usual = float(np.ptp(np.quantile(column, [0.01, 0.99])))
        found = jumps(column, OF_RANGE * usual) if noisy(column) else None
        if found is not None:
            many, row, size = found
            return [
                f"{name} jumps by {size:.3g} {unit} and returns at once ({many} sample{'s' * (many > 1)}, the largest "
                f"at {t[row]:.4g} s), as no touch does: spikes on the line; leave these readings empty"
            ]
    return []
