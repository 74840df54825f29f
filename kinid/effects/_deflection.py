"""A contact law behind an arm that gives way: the force at which law and arm agree, sample by sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinid.effects._signals import Agreement, Array, Recall, Signals
from kinid.kernels.recall import forwards, remembered

#: steps after which a search that goes on is left as it is; a power law takes five, laws with a long memory some twenty
MOST_STEPS = 30
#: … and after so many that each were greater than the one before: damping that gives energy has no such force
GROWING = 4
#: a bond that tears lets go of the arm where it gives way faster than the arm follows: to this share of that, slopes are believed
SNAP = 0.5
#: slopes are worked out anew where a step is more than this share of the one before
SLOW = 0.05
#: … not within so many steps, at first, and twice as many each time: where memory makes steps slow, new slopes are the old ones
AGED = 1
#: after so many steps, a sample that goes back by this share of the step before is torn between two places, as where a bond
#: lets go at once: it is taken half as far each time, to the place between them, and left there with this share of its steps
PATIENT, TORN, LOST = 5, 0.7, 0.02
#: a tool that the arm holds back from the material is this share of the greatest depth inside: a law that jumps acts there
LEAST = 1e-12
#: what is less than this share of the greatest force is no step any more; beside an agreement that is known, what is less than
#: this share of the first step, all samples together: of the difference between the two
SETTLED, NEARBY = 1e-10, 1e-4


def press_through(s: Signals, compliance: float, press: Callable[[Signals], None]) -> None:
    """Replace depth, rate and normal force by those behind a compliance C: N = L(x, ẋ), x = δ − C N, ẋ = δ̇ − C Ṅ.

    A Newton search for all samples at once. A law's slope over depth and rate at one sample, its memory of the others as
    it is, comes from a probe that alternates in sign from sample to sample: what a law says that it remembers of it is taken
    off, and other memory averages it out. Ṅ is the difference to the sample before, and is solved for forwards in time, so
    that a dashpot behind a soft arm settles as it does in nature. Where a law jumps at touch (a dashpot), the arm follows:
    N = δ/C, until the law's force is reached.

    Args:
        s: with `depth` and `depth_rate` as the arm has them; `agreed` to begin with, which becomes what was agreed on.
        compliance: C [m/N], > 0.
        press: sets `elastic` and `normal` of signals from their depth and its rate.
    """
    depth, rate, c = s.depth, s.depth_rate, compliance
    n = len(depth)
    none, known, step = np.zeros(n), np.empty(n), np.empty(n)
    sign = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    deep = max(float(np.abs(depth).max(initial=0.0)), 1e-9)
    # of the deepest, and of the fastest: far above rounding, far below what bends a law
    h, v = 1e-7 * deep * sign, 1e-7 * max(float(np.abs(rate).max(initial=0.0)), 1e-9) * sign
    touched = depth > 0.0

    def pressed(x: Array, speed: Array) -> Array:
        s.depth, s.depth_rate = x, speed
        press(s)
        return s.normal

    near = s.agreed
    begin = near or Agreement(none, none, none, np.full(n, 0.1))
    force, slope, loss, share = begin.force, begin.slope, begin.loss, begin.share
    trust, before = np.ones(n), none
    beyond, pace = None, 1.0
    first, last, stale, age, aged, grew = 0.0, np.inf, near is None, 0, AGED, 0
    for count in range(MOST_STEPS):
        x, speed = depth - c * force, rate - c * _rate(force, s.dt)
        here = pressed(x, speed)
        recall = Recall.joined(n, [own() for own in s.recalls])
        memory = recall.keep, recall.before, recall.now, recall.reach, recall.size
        kinks = np.column_stack([x > 0.0, recall.reach > 0.0])  # at the surface, and where a depth becomes the deepest
        if stale or (pace > SLOW and (beyond is None or (kinks != beyond).any())):
            beyond = kinks
            remembered(h, none, s.dt, *memory, known)
            slope = np.maximum((pressed(x + h, speed) - here - known) / h, -SNAP / c)
            remembered(none, v, s.dt, *memory, known)
            loss = np.maximum((pressed(x, speed + v) - here - known) / v, 0.0)
            age, aged = 0, 2 * aged
        forwards(force - here, s.dt, c, slope, loss, *memory, step)
        # the material is not left by a step that overshoots; where steps want to leave it again and again, the arm follows
        most = np.where(touched, (depth - np.maximum(share * x, LEAST * deep)) / c, np.inf)
        trial = np.minimum(force - step, most)
        share = np.where(trial < most, 0.1, share**2)
        change = trial - force
        if count > PATIENT and pace > 0.5:
            torn = (change * before < 0.0) & (np.abs(change) > TORN * np.abs(before))
            trust = np.where(torn, 0.5 * trust, trust)
            force, before = force + trust * change, change
            change = change[trust > LOST]
        else:
            force, before = trial, change
        change = np.abs(change)
        moved, moves = float(change.max(initial=0.0)), float(change.sum())
        grew = grew + 1 if moved > last else 0
        first = first or moves
        pace = min(1.0, moved / last) if last < np.inf else 1.0  # what is left is this share of the step, if it goes on like that
        beside = near is not None and pace * moves <= NEARBY * first
        if beside or grew == GROWING or pace * moved <= SETTLED * float(np.abs(force).max(initial=0.0)):
            break
        age += 1
        stale, last = pace > SLOW and age >= aged, moved
    pressed(depth - c * force, rate - c * _rate(force, s.dt))
    s.normal = force
    s.agreed = Agreement(force, slope, loss, share)


def _rate(force: Array, dt: Array) -> Array:
    """Change since the sample before, over time; 0 where there is none."""
    change = np.diff(force, prepend=force[:1])
    return np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)
