"""Two streams with rates and clocks of their own onto the wrench's clock, sample by sample, as logs are read.

A wrench waits until joints come that are newer, and gets positions from the line between its neighbours. What can't be
used is left out and told; nothing here raises on what a sender sent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.data.readers._joints import arrange
from kinid.errors import InputError
from kinid.live import _clock_kernels as kernels
from kinid.live.messages import Joints, Wrench

Array = NDArray[np.float64]
Report = Callable[[str, str], None]

JOINTS, WRENCH = "joints", "wrench"
#: streams whose stamps lie further apart than this, measured against their reception, have different epochs [ns]
EPOCH_NS = 1_000_000_000
#: clocks that begin at zero, or below, are told from there [ns]: what isn't positive says what became of a sample
EARLIEST_NS = 1_000_000_000
#: orders of joints that are remembered
MOST_ORDERS = 64


class Clock:
    """One stream's clock: which samples are taken, and how their stamps go on.

    Args:
        name: of the stream. report: is told what is wrong with a sample. slots: samples that are kept, of so many
            numbers each. slot: of the stream in the pairing's counts.
    """

    def __init__(self, name: str, report: Report, slots: int, width: int, slot: int) -> None:
        self.name, self._report, self.slot = name, report, slot
        self.state = np.zeros(kernels.PLACES, np.int64)
        self.state[kernels.COUNT] = -1
        self.stamps = np.zeros(slots, np.int64)
        self.rows = np.full((slots, width), np.nan)
        self.row = np.full(width, np.nan)

    def put(self, counts: NDArray[np.int64], stamp: int | None, received: int, needed: int) -> int | None:
        """Keep the sample that lies in `row`: its stamp on the continuous clock [ns]; None where it is left out.

        Args:
            counts: state of the pairing. stamp, received: [ns]. needed: how many numbers of the row have to be finite.
        """
        if stamp is None:
            stamp = received
        code = kernels.put(self.state, counts, self.slot, self.stamps, self.rows, stamp, received, self.row, needed)
        return code if code > 0 else self._reported(-code, stamp)

    @property
    def started(self) -> bool:
        """Whether a sample was accepted."""
        return self.state.item(kernels.COUNT) >= 0

    @property
    def received(self) -> int:
        """When the last sample that was accepted came [ns]."""
        return int(self.state[kernels.RECEIVED])

    @property
    def period(self) -> int:
        """Usual step of time [ns]; 0 before the first."""
        return int(self.state[kernels.PERIOD])

    @property
    def lag(self) -> int:
        """Time from the last stamp, as it goes on here, to its reception [ns]."""
        return self.state.item(kernels.RECEIVED) - self.state.item(kernels.LAST)

    def shift(self, by: int) -> None:
        """Add something to all stamps that come [ns]."""
        self.state[kernels.SHIFT] += by

    def _reported(self, code: int, stamp: int) -> int | None:
        """Tell what became of a sample that isn't as it should be; its stamp where it is kept."""
        step = 1e-6 * float(self.state[kernels.STEP])
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
            behind = 1e-6 * float(self.state[kernels.LAST] - stamp - self.state[kernels.SHIFT])
            self._report("late", f"{self.name}, {behind:.1f} ms behind the newest")
        return int(self.state[kernels.LAST]) if code < kernels.LATE else None


class Aligner:
    """Joints and wrench in, pairs out.

    Args:
        names: of the robot's joints, in the order of q1…qN.
        report: is told what is wrong: the kind of event, and a sentence.
        wrench_offset: added to the wrench's stamps [s]. max_gap: longest pause between joint samples that is bridged
            [s]; None: 3.5 median steps.

    Attributes:
        t: time of the last pair since the first sample [s]. q, dq, tau, wrench: of the last pair; overwritten by the
            next. dq and tau are NaN where the joints come without.
    """

    def __init__(
        self, names: Sequence[str], report: Report, *, wrench_offset: float = 0.0, max_gap: float | None = None
    ) -> None:
        n = len(names)
        self._names, self._report = tuple(names), report
        self._offset = round(1e9 * wrench_offset)
        self._longest = 0 if max_gap is None else round(1e9 * max_gap)
        self._joints = Clock(JOINTS, report, kernels.JOINT_SLOTS, 3 * n, kernels.JOINTS)
        self._wrench = Clock(WRENCH, report, kernels.WRENCH_SLOTS, 6, kernels.WRITTEN)
        self.clocks = {JOINTS: self._joints, WRENCH: self._wrench}
        self._orders: dict[tuple[str, ...], list[int] | None] = {}
        self._counts = np.zeros(3, np.int64)
        self._out = np.full(3 * n + 6, np.nan)
        self.q, self.dq, self.tau, self.wrench = np.split(self._out, [n, 2 * n, 3 * n])
        self.t, self.stamp, self._rates = 0.0, 0, False
        self._origin = 0
        self._rings = (
            self._joints.state,
            self._counts,
            self._joints.stamps,
            self._joints.rows,
            self._wrench.stamps,
            self._wrench.rows,
            self._longest,
            self._offset,
            self._out,
        )

    def put(self, message: Joints | Wrench) -> int | None:
        """Take one sample in: its stamp on the continuous clock [ns], None where it was left out, which was told."""
        try:
            return self._put_joints(message) if isinstance(message, Joints) else self._put_wrench(message)
        except (TypeError, ValueError, OverflowError):
            self._report("malformed", f"{type(message).__name__.lower()} that aren't numbers: {str(message)[:80]}")
            return None

    def pair(self) -> bool:
        """Bring one wrench together with its joints; False where none is ready."""
        while True:
            code = kernels.take_pair(*self._rings)
            if code > 0:
                self.stamp = code
                self.t = 1e-9 * (code - self._origin)
                return True
            if code == -kernels.WAITING:
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
        if len(q) != n or len(dq) not in (0, n) or len(tau) not in (0, n):
            self._report("joint-names", f"{len(q)} positions, {len(dq)} velocities, {len(tau)} torques of {n} joints")
            return None
        row, needed = self._joints.row, n
        row[:n] = q
        if self._rates or len(dq) or len(tau):
            self._rates = True
            row[n : 2 * n] = dq if len(dq) else math.nan
            row[2 * n :] = tau if len(tau) else math.nan
            needed = 3 * n if len(dq) and len(tau) else 2 * n if len(dq) else n
        if self._joints.started and self._origin:
            return self._joints.put(self._counts, message.stamp, message.received, needed)
        return self._first(self._joints, self._wrench, message, needed)

    def _put_wrench(self, message: Wrench) -> int | None:
        if len(message.wrench) != 6:
            self._report("malformed", f"a wrench of {len(message.wrench)} numbers")
            return None
        clock = self._wrench
        clock.row[:] = message.wrench
        if clock.started and self._origin:
            return clock.put(self._counts, message.stamp, message.received, 6)
        return self._first(clock, self._joints, message, 6)

    def _first(self, clock: Clock, other: Clock, message: Joints | Wrench, needed: int) -> int | None:
        """The first sample of a stream: it is put onto the other stream's epoch, where they have two."""
        sent = message.received if message.stamp is None else message.stamp
        if not self._origin and not other.started and not clock.started and sent < EARLIEST_NS:
            for each in (clock, other):
                each.shift(EARLIEST_NS - sent)
        if not clock.started and other.started:
            apart = message.received - sent - clock.state.item(kernels.SHIFT) - other.lag
            if abs(apart) > EPOCH_NS:
                clock.shift(apart)
                self._report("clock-offset", f"{1e-9 * apart:+.3f} s added to the stamps of the {clock.name}")
        stamp = clock.put(self._counts, message.stamp, message.received, needed)
        if stamp is not None and not self._origin:
            self._origin = stamp
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
