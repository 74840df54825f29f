"""A contact law behind an arm that gives way: the force at which law and arm agree, sample by sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinid.effects._signals import Array, Signals
from kinid.kernels.memory import forwards

#: steps after which a search that goes on is left as it is; a power law takes five, laws with a long memory some twenty
MOST_STEPS = 30
#: … and after so many that each were greater than the one before: damping that gives energy has no such force
GROWING = 4
#: slopes are worked out anew where a step is more than this share of the one before
SLOW = 0.3
#: a tool that the arm holds back from the material is this share of the greatest depth inside: a law that jumps acts there
LEAST = 1e-12
#: a step of this share of the greatest force ends the search
SETTLED = 1e-10


def press_through(s: Signals, compliance: float, press: Callable[[Signals], None]) -> None:
    """Replace depth, rate and normal force by those behind a compliance C: N = L(x, ẋ), x = δ − C N, ẋ = δ̇ − C Ṅ.

    A Newton search for all samples at once. A law's slope over depth and rate at one sample, its memory of the others as
    it is, comes from a probe that alternates in sign from sample to sample: memory averages it out. Ṅ is the difference
    to the sample before, and is solved for forwards in time, so that a dashpot behind a soft arm settles as it does in
    nature. Where a law jumps at touch (a dashpot), the arm follows: N = δ/C, until the law's force is reached.

    Args:
        s: with `depth` and `depth_rate` as the arm has them.
        compliance: C [m/N], > 0.
        press: sets `elastic` and `normal` of signals from their depth and its rate.
    """
    depth, rate, c = s.depth, s.depth_rate, compliance
    n = len(depth)
    force, none = np.zeros(n), np.zeros(n)
    sign = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    deep = max(float(np.abs(depth).max(initial=0.0)), 1e-9)
    # of the deepest, and of the fastest: far above rounding, far below what bends a law
    h, v = 1e-7 * deep * sign, 1e-7 * max(float(np.abs(rate).max(initial=0.0)), 1e-9) * sign
    touched = depth > 0.0

    def pressed(x: Array, speed: Array) -> Array:
        s.depth, s.depth_rate = x, speed
        press(s)
        return s.normal

    slope, loss, last, stale, share, grew = force, force, np.inf, True, np.full(n, 0.1), 0
    for _ in range(MOST_STEPS):
        x, speed = depth - c * force, rate - c * _rate(force, s.dt)
        here, recall = pressed(x, speed), s.recall
        if stale:
            slope = np.maximum((pressed(x + h, speed) - here) / h, 0.0)
            loss = np.maximum((pressed(x, speed + v) - here) / v, 0.0)
        step = np.empty(n)
        size, keep, gain = (none, none, none) if recall is None else (recall.size, recall.keep, c * recall.gain)
        forwards(force - here, s.dt, c * slope, c * loss, size, keep, gain, step)
        # the material is not left by a step that overshoots; where steps want to leave it again and again, the arm follows
        most = np.where(touched, (depth - np.maximum(share * x, LEAST * deep)) / c, np.inf)
        trial = np.minimum(force - step, most)
        share = np.where(trial < most, 0.1, share**2)
        moved = float(np.abs(trial - force).max(initial=0.0))
        force = trial
        grew = grew + 1 if moved > last else 0
        if grew == GROWING or moved <= SETTLED * float(np.abs(force).max(initial=0.0)):
            break
        stale, last = moved > SLOW * last, moved
    pressed(depth - c * force, rate - c * _rate(force, s.dt))
    s.normal = force


def _rate(force: Array, dt: Array) -> Array:
    """Change since the sample before, over time; 0 where there is none."""
    change = np.diff(force, prepend=force[:1])
    return np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)
