"""Whether a stream's wrench in free motion is what gravity puts on the rig's tool, asked as of a log."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from kinid.contact.tool_doubts import FEWEST, tool_doubts
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]
Row = tuple[float, Array, Array]

#: samples of free motion that are kept of a session's beginning, and as many of its end: 40 s each
KEPT = 2000


class Readings:
    """Takes samples of free motion now and then; what it keeps doesn't grow.

    Args:
        rig: what is measured with what. robot: of the rig.
    """

    def __init__(self, rig: Rig, robot: Robot) -> None:
        self._rig, self._robot = rig, robot
        self._first, self._last = list[Row](), deque[Row](maxlen=KEPT)

    def take(self, t: float, q: Array, wrench: Array) -> None:
        """One sample, clear of what is touched.

        Args:
            t: time [s]. q: positions (N,). wrench: as it came, (6,).
        """
        kept = self._first if len(self._first) < KEPT else self._last
        kept.append((t, q.copy(), wrench.copy()))

    def doubts(self) -> list[str]:
        """What speaks against the readings, a line each."""
        rows = {row[0]: row for row in (*self._first, *self._last)}  # a source that begins anew has times twice
        if len(rows) < FEWEST:
            return []
        t, q, wrench = (np.array(column) for column in zip(*(rows[at] for at in sorted(rows)), strict=True))
        log = Log(t, q=q, wrench=wrench, phase=np.full(len(t), "free"))
        return tool_doubts(log, self._rig, self._robot, None)
