"""Two streams with rates and clocks of their own onto the wrench's clock, sample by sample, as logs are read.

A wrench waits until joints come that are newer, and gets positions from the line between its neighbours. What can't be
used is left out and told; nothing here raises on what a sender sent.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinid.data.readers._joints import arrange
from kinid.errors import InputError
from kinid.live import _clock_kernels as kernels
from kinid.live.messages import Joints, Wrench

if TYPE_CHECKING:
    from kinid.live.messages import Numbers

Array = NDArray[np.float64]
Report = Callable[[str, str], None]

JOINTS, WRENCH = "joints", "wrench"
#: streams whose stamps lie further apart than this, measured against their reception, have different epochs [ns]
EPOCH_NS = 1_000_000_000
#: clocks that begin at zero, or below, are told from there [ns]: what isn't positive says what became of a sample
EARLIEST_NS = 1_000_000_000
#: velocities that stay 0 are reported once a position is so far from where it began [rad or m]; samples between looks
MOVED, LOOK = 0.01, 64
#: samples that may be missing in a row; more are a sender's mistake in counting
MOST_MISSING = 1_000_000
#: orders of joints that are remembered
MOST_ORDERS = 64


class Clock:
    """One stream's clock: which samples are taken, and how their stamps go on.

    Args:
        name: of the stream. state: of its clock. report: is told what is wrong with a sample. put: the compiled call
            that keeps a sample: of stamp, reception and how many numbers have to be finite.

    Attributes:
        started: whether a sample was accepted.
    """

    def __init__(self, name: str, state: memoryview, report: Report, put: Callable[[int, int, int], int]) -> None:
        self.name, self._state, self._report, self._put = name, state, report, put
        self.started = False
        state[kernels.COUNT] = -1

    def put(self, stamp: int | None, received: int, needed: int) -> int | None:
        """Keep the sample that lies ready: its stamp on the continuous clock [ns]; None where it is left out.

        Args:
            stamp, received: [ns]. needed: how many numbers of the row have to be finite.
        """
        if stamp is None:
            stamp = received
        code = self._put(stamp, received, needed)
        return code if code > 0 else self._reported(-code, stamp)

    @property
    def received(self) -> int:
        """When the last sample that was accepted came [ns]."""
        return int(self._state[kernels.RECEIVED])

    @property
    def period(self) -> int:
        """Usual step of time [ns]; 0 before the first."""
        return int(self._state[kernels.PERIOD])

    @property
    def lag(self) -> int:
        """Time from the last stamp, as it goes on here, to its reception [ns]."""
        return self.received - self._state[kernels.LAST]

    @property
    def shift(self) -> int:
        """What is added to all stamps that come [ns]."""
        return int(self._state[kernels.SHIFT])

    @shift.setter
    def shift(self, by: int) -> None:
        self._state[kernels.SHIFT] = by

    @property
    def missing(self) -> int:
        """How many samples before the next one never came, at most."""
        return int(self._state[kernels.MISSING])

    @missing.setter
    def missing(self, count: int) -> None:
        self._state[kernels.MISSING] = min(count, MOST_MISSING)

    def _reported(self, code: int, stamp: int) -> int | None:
        """Tell what became of a sample that isn't as it should be; its stamp where it is kept."""
        step = 1e-6 * float(self._state[kernels.STEP])
        if code == kernels.GAP:
            self._report("gap", f"{step:.1f} ms between two samples of the {self.name}")
        elif code == kernels.JUMP:
            self._report("clock-jump", f"by {1e-3 * step:+.3f} s, of the {self.name}")
        elif code == kernels.DELAY:
            self._report("delayed", f"{self.name} come {step:.0f} ms later than the quickest")
        elif code == kernels.REPEATED:
            self._report("repeated", f"{self.name}, stamp {1e-9 * stamp:.6f} s")
        elif code == kernels.NOT_FINITE:
            self._report("not-finite", self.name)
        elif code == kernels.LATE:
            behind = 1e-6 * float(self._state[kernels.LAST] - stamp - self._state[kernels.SHIFT])
            self._report("late", f"{self.name}, {behind:.1f} ms behind the newest")
        return int(self._state[kernels.LAST]) if code < kernels.LATE else None


class Aligner:
    """Joints and wrench in, pairs out.

    Args:
        names: of the robot's joints, in the order of q1…qN.
        report: is told what is wrong: the kind of event, and a sentence.
        wrench_offset: added to the wrench's stamps [s]. max_gap: longest pause between joint samples that is bridged
            [s]; None: 3.5 median steps.

    Attributes:
        t: time of the last pair since the first sample [s]. q, dq, tau, wrench: of the last pair; overwritten by the
            next sample. dq and tau are NaN where the joints come without; dq also
            until one velocity has been another number than 0: many drivers send zeros for what they don't know.
    """

    def __init__(
        self, names: Sequence[str], report: Report, *, wrench_offset: float = 0.0, max_gap: float | None = None
    ) -> None:
        n = len(names)
        self._names, self._report = tuple(names), report
        whole = np.zeros(kernels.WHOLE, np.int64)
        real = np.full(kernels.JOINT_SLOTS * 3 * n + kernels.WRENCH_SLOTS * 6 + 2 * (3 * n + 6), np.nan)
        longest = 0 if max_gap is None else round(1e9 * max_gap)
        self._rings = (whole, real, 3 * n, longest, round(1e9 * wrench_offset))
        self._counts = whole.data
        self.clocks = {
            name: Clock(
                name,
                self._counts[i * kernels.PLACES : (i + 1) * kernels.PLACES],
                report,
                partial(kernels.put, *self._rings, i),
            )
            for i, name in enumerate((JOINTS, WRENCH))
        }
        self._joints, self._wrench = self.clocks[JOINTS], self.clocks[WRENCH]
        *parts, self._joint_row, self._wrench_row = np.split(real[-2 * (3 * n + 6) :], np.cumsum([n, n, n, 6, 3 * n]))
        self.q, self.dq, self.tau, self.wrench = parts
        # a sample mostly is a list, and packing it takes a third of the time of numpy's assignment
        self._pack_joints = partial(struct.Struct(f"{n}d").pack_into, self._joint_row.data)
        self._pack_wrench = partial(struct.Struct("6d").pack_into, self._wrench_row.data)
        self._orders: dict[tuple[str, ...], list[int] | None] = {}
        self.t, self.stamp, self._rates = 0.0, 0, False
        self._origin = 0
        self._has_rates, self._zeros, self._began = False, 0, np.empty(0)

    def put(self, message: Joints | Wrench) -> int | None:
        """Take one sample in: its stamp on the continuous clock [ns], None where it was left out, which was told."""
        try:
            return self._put_joints(message) if isinstance(message, Joints) else self._put_wrench(message)
        except (TypeError, ValueError, OverflowError, struct.error):
            self._report("malformed", f"{type(message).__name__.lower()} that aren't numbers: {str(message)[:80]}")
            return None

    def lost(self, missing: int) -> None:
        """So many messages never came, by their running numbers: stamps that go on behind them are no clock's jump."""
        for clock in self.clocks.values():
            clock.missing = missing

    def pair(self) -> bool:
        """Bring one wrench together with its joints; False where none is ready."""
        counts = self._counts
        while True:
            code = counts[kernels.READY]
            if code == 0 and counts[kernels.WRITTEN] > counts[kernels.READ]:
                code = kernels.take_pair(*self._rings)
            counts[kernels.READY] = 0
            if code > 0:
                self.stamp = code
                self.t = 1e-9 * (code - self._origin)
                return True
            if code == 0:
                return False
            self._report("unpaired", "a wrench without joints on both sides of it in time")

    def _put_joints(self, message: Joints) -> int | None:
        n, q, dq, tau = len(self._names), message.q, message.dq, message.tau
        order = None
        if message.names is not None and message.names != self._names:
            order = self._order(message.names)
            if order is None:
                return None
            q, dq, tau = ([part[i] for i in order] if len(part) > 0 else part for part in (q, dq, tau))
        rates, torques = len(dq), len(tau)
        if len(q) != n or (rates and rates != n) or (torques and torques != n):
            self._report("joint-names", f"{len(q)} positions, {rates} velocities, {torques} torques of {n} joints")
            return None
        row, needed = self._joint_row, n
        if isinstance(q, np.ndarray):
            row[:n] = q
        else:
            self._pack_joints(0, *q)
        if rates and not self._has_rates:
            rates = self._first_rates(dq, row[:n])
        if self._rates or rates or torques:
            self._rates = True
            row[n : 2 * n] = dq if rates else math.nan
            row[2 * n :] = tau if torques else math.nan
            needed = 3 * n if rates and torques else 2 * n if rates else n
        if self._joints.started and self._origin:
            return self._joints.put(message.stamp, message.received, needed)
        return self._first(self._joints, self._wrench, message, needed)

    def _first_rates(self, dq: Numbers, q: Array) -> int:
        """How many velocities count while none has been another number than 0; where positions change, a notice."""
        if np.count_nonzero(dq) if isinstance(dq, np.ndarray) else any(dq):
            self._has_rates = bool(np.isfinite(np.asarray(dq, float)).all())
            return len(dq)
        if self._zeros == 0:
            self._began = q.copy()
        self._zeros += 1
        if self._zeros % LOOK == 0 and (np.abs(q - self._began) > MOVED).any():
            self._report(
                "dead-velocities", "velocities stay 0 while positions change: they are left out, as if none came"
            )
            self._began = np.full_like(q, np.nan)
        return 0

    def _put_wrench(self, message: Wrench) -> int | None:
        if len(message.wrench) != 6:
            self._report("malformed", f"a wrench of {len(message.wrench)} numbers")
            return None
        clock = self._wrench
        self._pack_wrench(0, *message.wrench)
        if clock.started and self._origin:
            return clock.put(message.stamp, message.received, 6)
        return self._first(clock, self._joints, message, 6)

    def _first(self, clock: Clock, other: Clock, message: Joints | Wrench, needed: int) -> int | None:
        """The first sample of a stream: it is put onto the other stream's epoch, where they have two."""
        sent = message.received if message.stamp is None else message.stamp
        if not self._origin and not other.started and not clock.started and sent < EARLIEST_NS:
            for each in (clock, other):
                each.shift += EARLIEST_NS - sent
        if not clock.started and other.started:
            apart = message.received - sent - clock.shift - other.lag
            if abs(apart) > EPOCH_NS:
                clock.shift += apart
                self._report("clock-offset", f"{1e-9 * apart:+.3f} s added to the stamps of the {clock.name}")
        stamp = clock.put(message.stamp, message.received, needed)
        if stamp is not None:
            clock.started = True
            self._origin = self._origin or stamp
        return stamp

    def _order(self, names: tuple[str, ...]) -> list[int] | None:
        """Where each of the robot's joints stands in a message; None where one is missing, which is told."""
        if names not in self._orders:
            if len(self._orders) >= MOST_ORDERS:  # whatever a sender sends, memory stays as it is
                self._orders.clear()
            self._orders[names] = self._found(names)
        order = self._orders[names]
        if order is None:
            self._report("joint-names", f"{', '.join(names[:8])} instead of {', '.join(self._names)}")
        return order

    def _found(self, names: tuple[str, ...]) -> list[int] | None:
        try:
            places: Any = arrange({names: 1}, self._names, "the stream").sources[names]
        except (InputError, KeyError, TypeError, AttributeError):
            return None
        order = {joint: place for place, joint in places.items()}
        return [order[i] for i in range(len(self._names))] if len(order) == len(self._names) else None
