"""A contact law behind an arm that gives way: the force at which law and arm agree, sample by sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinid.effects._signals import Agreement, Array, Recall, Signals
from kinid.kernels.recall import forwards, remembered

#: steps after which a search that goes on is left as it is; a power law takes five, laws with a long memory some
#: twenty, and beside an agreement that is known three do
MOST_STEPS, MOST_BESIDE = 30, 10
#: … and after so many that each were greater than the one before: damping that gives energy has no such force
GROWING = 4
#: a bond that tears lets go of the arm where it gives way faster than the arm follows: to this share of that, slopes
#: are believed
SNAP = 0.5
#: slopes are worked out anew where a step is more than this share of the one before
SLOW = 0.05
#: … not within so many steps, at first, and twice as many each time: where memory makes steps slow, new slopes are the
#: old ones
AGED = 1
#: after so many steps, a sample that goes back by this share of the step before is torn between two places, as where a
#: bond lets go at once: it is taken half as far each time, to the place between them, and left there with this share of
#: its steps
PATIENT, TORN, LOST = 5, 0.7, 0.02
#: a tool that the arm holds back from the material is this share of the greatest depth inside: a law that jumps acts
#: there
LEAST = 1e-12
#: what is less than this share of the greatest force is no step any more; beside an agreement that is known, what is
#: less than this share of the first step, all samples together: of the difference between the two
SETTLED, NEARBY = 1e-10, 3e-5


def solve_series_compliance(s: Signals, compliance: float, press: Callable[[Signals], None]) -> None:
    """Replace depth, rate and normal force by those behind a compliance C: N = L(x, ẋ), x = δ − C N, ẋ = δ̇ − C Ṅ.

    A Newton search for all samples at once. A law's slope over depth and rate at one sample, its memory of the others
    as it is, comes from a probe that alternates in sign from sample to sample: what a law says that it remembers of it
    is taken off, and other memory averages it out. Ṅ is the difference to the sample before, and is solved for forwards
    in time, so that a dashpot behind a soft arm settles as it does in nature. Where a law jumps at touch (a dashpot),
    the arm follows: N = δ/C, until the law's force is reached.

    Args:
        s: with `depth` and `depth_rate` as the arm has them; `agreed` to begin with, which becomes what was agreed on.
        compliance: C [m/N], > 0.
        press: sets `elastic` and `normal` of signals from their depth and its rate.
    """
    depth, search = s.depth, _Newton(s, compliance, press)
    before, pace = np.zeros(len(s)), 1.0
    first, last, stale, age, aged, grew = 0.0, np.inf, s.agreed is None, 0, AGED, 0
    for count in range(MOST_BESIDE if search.beside else MOST_STEPS):
        if search.look(stale, pace > SLOW and (not search.beside or count > 1)):
            age, aged = 0, 2 * aged
        change = search.step()
        if count > PATIENT and pace > 0.5:
            change, before = search.torn(change, before), change
        else:
            search.force, before = search.force + change, change
        change = np.abs(change)
        moved, moves = float(change.max(initial=0.0)), float(change.sum())
        grew = grew + 1 if moved > last else 0
        first = first or moves
        pace = (
            min(1.0, moved / last) if last < np.inf else 1.0
        )  # what is left is this share of the step, if it goes on like that
        near = search.beside and pace * moves <= NEARBY * first
        if near or grew == GROWING or pace * moved <= SETTLED * float(np.abs(search.force).max(initial=0.0)):
            break
        age += 1
        stale, last = last < np.inf and pace > SLOW and age >= aged, moved
    s.agreed = search.agree()
    # what friction needs of depth is where it begins: most searches agree on that, and the arm's own is the same for
    # all
    if not s.rest.kept:
        s.touch = depth if np.array_equal(s.depth > 0.0, depth > 0.0) else s.depth


class _Newton:
    """A search for the force N (n,) on which a law and an arm agree: present force, and the law's slopes there."""

    def __init__(self, s: Signals, compliance: float, press: Callable[[Signals], None]) -> None:
        self._s, self._c, self._press = s, compliance, press
        self._depth, self._rate, n = s.depth, s.depth_rate, len(s)
        self._none = np.zeros(n)
        self.beside = (
            s.agreed is not None and s.beside
        )  # only what changes from an agreement that is known is looked for
        begin = s.agreed or Agreement.none(n)
        self.force, self._slope, self._loss, self._share, self._kinks, self._memory = (
            begin.force,
            begin.slope,
            begin.loss,
            begin.share,
            begin.kinks,
            begin.memory,
        )
        self._trust = np.ones(n)
        self._touched = s.depth > 0.0
        self._deep = max(float(np.abs(s.depth).max(initial=0.0)), 1e-9)
        # of the deepest, and of the fastest: far above rounding, far below what bends a law
        sign = 1e-7 * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
        self._h, self._v = self._deep * sign, max(float(np.abs(s.depth_rate).max(initial=0.0)), 1e-9) * sign

    def look(self, stale: bool, moving: bool) -> bool:
        """The law at the present force; slopes anew where they are stale, or samples crossed the surface while all
        still moves.

        What a law remembers, too; where all is to be found, not only what changes, that is anew each time.
        """
        s, c = self._s, self._c
        self._x, speed = self._behind()
        self._here = self._pressed(self._x, speed)
        anew = stale or (moving and not np.array_equal(self._x > 0.0, self._kinks))
        if anew or not self.beside:
            self._memory = Recall.joined(len(s), [own() for own in s.recalls])
        if not anew:
            return False
        self._kinks, known = self._x > 0.0, np.empty(len(s))
        remembered(self._h, self._none, s.dt, *self._memory.parts, known)
        self._slope = np.maximum((self._pressed(self._x + self._h, speed) - self._here - known) / self._h, -SNAP / c)
        remembered(self._none, self._v, s.dt, *self._memory.parts, known)
        self._loss = np.maximum((self._pressed(self._x, speed + self._v) - self._here - known) / self._v, 0.0)
        return True

    def step(self) -> Array:
        """Change of the force towards what law and arm agree on, (n,)."""
        step = np.empty(len(self.force))
        forwards(self.force - self._here, self._s.dt, self._c, self._slope, self._loss, *self._memory.parts, step)
        # the material is not left by a step that overshoots; where steps want to leave it again and again, the arm
        # follows
        held = (self._depth - np.maximum(self._share * self._x, LEAST * self._deep)) / self._c
        most = np.where(self._touched, held, np.inf)
        trial = np.minimum(self.force - step, most)
        self._share = np.where(trial < most, 0.1, self._share**2)
        return trial - self.force

    def torn(self, change: Array, before: Array) -> Array:
        """Take a step, half as far where samples go to and fro; the change of those that aren't left (·,)."""
        torn = (change * before < 0.0) & (np.abs(change) > TORN * np.abs(before))
        self._trust = np.where(torn, 0.5 * self._trust, self._trust)
        self.force = self.force + self._trust * change
        return change[self._trust > LOST]

    def agree(self) -> Agreement:
        """Leave the signals with the present force, and at the depth behind it."""
        self._pressed(*self._behind())
        self._s.normal = self.force
        return Agreement(self.force, self._slope, self._loss, self._share, self._kinks, self._memory)

    def _behind(self) -> tuple[Array, Array]:
        """Depth and its rate behind the arm, each (n,)."""
        force, dt = self.force, self._s.dt
        change = np.diff(force, prepend=force[:1])
        rate = np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)
        return self._depth - self._c * force, self._rate - self._c * rate

    def _pressed(self, depth: Array, rate: Array) -> Array:
        """The law's force there, (n,)."""
        self._s.depth, self._s.depth_rate = depth, rate
        self._press(self._s)
        return self._s.normal
