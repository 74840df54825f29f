"""Joints whose positions stop in the middle of a log: a stream that stood still, which no robot does at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from kinid.data.log import Log
from kinid.robotics.motion import STATIC_PERIOD
from kinid.signal.noise import white_noise
from kinid.signal.stuck import LIVE, longest_repeat

Array = NDArray[np.float64]

#: duration from which repeated positions are a state that stood still [s]
FROZEN = 0.5
#: a joint stops at once where its last step was this share of its usual ones, and so many of its smallest; it has gone
#: on unseen where the step after the stretch is so many times the next ones
AT_ONCE, STEPS, JUMPS = 0.3, 10.0, 5.0
#: all joints stand still under a force that rises and falls by so many times its noise
TOUCHED = 30.0
#: a touch lasts for more than half of so many samples
SPIKE = 5


def frozen_joints(log: Log) -> list[str]:
    """At most one sentence: of one joint while others move, or of all while the force rises and falls.

    Args:
        log: with joints and a wrench.
    """
    assert log.q is not None
    assert log.wrench is not None
    rows = np.flatnonzero(log.valid)
    if log.period >= STATIC_PERIOD or len(rows) < 100:
        return []
    t, q, wrench = log.t[rows], np.asarray(log.q)[rows], np.asarray(log.wrench)[rows]
    step = np.abs(np.diff(q, axis=0))
    everything = _stretch(t, ~(step != 0.0).any(axis=1))
    if everything is not None:
        begin, last = everything
        if step.any() and _rises_and_falls(wrench[begin : last + 1, :3]):
            return [_said("all joints repeat their positions", t, begin, last, "the force rises and falls")]
    for j in range(q.shape[1]):
        stretch = _stretch(t, step[:, j] == 0.0)
        if stretch is None or not step[:, j].any():
            continue
        begin, last = stretch
        others = np.delete(step, j, axis=1).sum(axis=1)
        if _stops(step[:, j], begin, last) and np.mean(others[begin:last] > 0.0) > LIVE:
            return [_said(f"q{j + 1} repeats one position", t, begin, last, "the other joints go on")]
    return []


def _stretch(t: Array, same: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and last row of a stretch of repeated positions that is long, in time t [s] (n,) and beside usual ones."""
    stretch = longest_repeat(same)
    return stretch if stretch is not None and t[stretch[1]] - t[stretch[0]] >= FROZEN else None


def _stops(step: Array, begin: int, last: int) -> bool:
    """Whether a joint stops at once, in the middle of a motion, or has gone on unseen: one step is then far larger than
    its neighbours.

    Args:
        step: sizes of its steps, (n − 1,). begin, last: rows of the stretch.
    """
    other = np.delete(step, np.arange(max(begin - 1, 0), min(last + 1, len(step))))
    other = other[other > 0.0]
    if not len(other):
        return False
    # a step or two of a coarse encoder are no jump
    least = max(AT_ONCE * float(np.sqrt(np.mean(other**2))), STEPS * float(other.min()))
    after = step[last + 1 : last + 4]
    stopped = begin > 0 and step[begin - 1] > least
    return bool(stopped or (len(after) and step[last] > max(least, JUMPS * float(after.max()))))


def _rises_and_falls(force: Array) -> bool:
    """Whether the force that changes most does so both ways: one that relaxes, or creeps, goes one way, and a reading
    that stands alone is none of a touch.
    """
    force = without_spikes(force)
    one = force[:, int(np.argmax(np.ptp(force, axis=0)))]
    noise = white_noise(one)
    rise = float(np.max(one - np.minimum.accumulate(one)))
    fall = float(np.max(np.maximum.accumulate(one) - one))
    return min(rise, fall) > TOUCHED * noise > 0.0


def without_spikes(force: Array) -> Array:
    """Forces (n, 3) without readings that stand alone among others."""
    out: Array = median_filter(force, (SPIKE, 1), mode="nearest")
    return out


def _said(what: str, t: Array, begin: int, last: int, while_what: str) -> str:
    return (
        f"{what} for {t[last] - t[begin]:.3g} s from {t[begin]:.4g} s on, while {while_what}: "
        "the robot's state stood still; leave q of these rows empty, or record anew"
    )
