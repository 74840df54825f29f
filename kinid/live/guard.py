"""A guard for controllers: one question a cycle, answered in microseconds, that never waits for anything.

    guard = Guard(force=20.0, depth=8e-3, dead_man=0.02)
    fresh = session.samples > seen  # the array is overwritten in place: old numbers in it are no new sample
    if (reason := guard.check(pipeline.quantities if fresh else None)) != guard.OK:
        ...  # what to do is the controller's: nothing here commands a robot

It latches: once it has said a reason it says it again until `reset`, so that no single cycle can miss it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinid.data.rig import CONTACT
from kinid.errors import InputError

Array = NDArray[np.float64]

_DEPTH, _RATE, _NORMAL, _TANGENT1, _TANGENT2 = (
    CONTACT.index(name) for name in ("depth", "depth_rate", "normal_force", "tangential_force1", "tangential_force2")
)


class Guard:
    """Limits that a touch mustn't leave, and the time within which a sample has to come.

    Args:
        force: largest normal force [N]; tangential: largest tangential force [N]; depth: largest [m]; speed: of the
            depth [m/s]. None for no limit.
        dead_man: time without a new sample after which the answer is no [s].
        clock: seconds that only grow; for tests.

    Raises:
        InputError: a limit or a time that is not positive.
    """

    OK = "ok"

    def __init__(
        self,
        *,
        force: float | None = None,
        tangential: float | None = None,
        depth: float | None = None,
        speed: float | None = None,
        dead_man: float = 0.02,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        limits = {"force": force, "tangential": tangential, "depth": depth, "speed": speed, "dead_man": dead_man}
        for name, value in limits.items():
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise InputError(f"{name} = {value} of a guard", "a positive number", "leave it out for no limit")
        self._force, self._tangential, self._depth, self._speed = (
            math.inf if value is None else float(value) for value in (force, tangential, depth, speed)
        )
        self._dead_man, self._clock = dead_man, clock
        self._last = clock()
        self._reason = self.OK
        self._reasons = {
            name: f"{name.replace('_', ' ')} beyond {value} {unit}"
            for (name, value), unit in zip(limits.items(), ("N", "N", "m", "m/s", "s"))
        }

    def check(self, sample: Array | None) -> str:
        """Whether the touch may go on: "ok", or why not.

        Args:
            sample: contact quantities in the order of `CONTACT`, as `Pipeline.quantities`; None where no new one came,
                or the dead man's time never ends.
        """
        if self._reason is not self.OK:
            return self._reason
        now = self._clock()
        if now - self._last > self._dead_man:
            self._reason = f"no sample for more than {self._dead_man} s"
            return self._reason
        if sample is None:
            return self.OK
        self._last = now
        try:
            x: list[float] = sample.tolist()  # of Python numbers, which are compared ten times faster
            math.hypot(x[_TANGENT1], x[_TANGENT2])
        except (AttributeError, IndexError, TypeError):
            self._reason = f"no contact quantities: {str(sample)[:60]}"
            return self._reason
        normal, depth, rate = x[_NORMAL], x[_DEPTH], x[_RATE]
        if (
            abs(normal) <= self._force
            and depth <= self._depth
            and abs(rate) <= self._speed
            and math.hypot(x[_TANGENT1], x[_TANGENT2]) <= self._tangential
            and math.isfinite(normal + depth + rate)
        ):
            return self.OK
        self._reason = self._why(x)
        return self._reason

    def trip(self, reason: str) -> None:
        """Say no from now on, for a reason of somebody else's: an event, another program."""
        if self._reason is self.OK:
            self._reason = reason

    def reset(self) -> None:
        """Start anew; the dead man's time begins now."""
        self._reason, self._last = self.OK, self._clock()

    def _why(self, x: list[float]) -> str:
        """The limit that a sample is beyond."""
        if not all(math.isfinite(x[i]) for i in (_NORMAL, _DEPTH, _RATE, _TANGENT1, _TANGENT2)):
            return "a sample that is no finite number"
        if abs(x[_NORMAL]) > self._force:
            return self._reasons["force"]
        if x[_DEPTH] > self._depth:
            return self._reasons["depth"]
        if abs(x[_RATE]) > self._speed:
            return self._reasons["speed"]
        return self._reasons["tangential"]
