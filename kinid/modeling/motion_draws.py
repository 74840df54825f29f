"""Samples of a motion's own error, carried into everything that a law is driven by.

The same law, predicted with each of them, shows what the noise of the motion leaves in a residual: a bristle turns it
into a force that lasts, a dashpot into one that doesn't.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.surface_frame import contact_motion
from kinid.data.log import Log
from kinid.data.rig import CONTACT, Rig
from kinid.effects import Signals
from kinid.modeling.tool_load import joint_signals, sensor_motion
from kinid.robotics.motion import axes_motion, joint_motion, own_motion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load as load_surface
from kinid.signal import Smoothed

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: samples of the error
DRAWS = 4
DEPTH, DEPTH_RATE = CONTACT.index("depth"), CONTACT.index("depth_rate")
SLIP = [CONTACT.index("slip1"), CONTACT.index("slip2")]
SLIP_RATE = [CONTACT.index("slip_rate1"), CONTACT.index("slip_rate2")]


@dataclass(frozen=True, eq=False)
class SeriesDraws:
    """Signals of a contact series, or of a force/torque sensor, driven by samples of the motion.

    Called with the signals of these rows of the log.
    """

    log: Log
    rig: Rig

    def __call__(self, signals: Signals, rows: Rows) -> Iterator[Signals]:
        """The signals with each of the motions in turn."""
        if self.log.q is None:
            yield from self._of_own_quantities(signals, rows)
            return
        robot, surface = Robot.load(self.rig), load_surface(self.rig)
        motion = joint_motion(self.log, robot)
        if motion.smoothed is None:
            return
        mean = (
            np.zeros((0, 0)) if surface is None else contact_motion(self.log, self.rig, robot, surface, motion)[:, rows]
        )
        for moved in motion.draws(DRAWS):
            out = signals
            if surface is not None:
                out = _moved(out, contact_motion(self.log, self.rig, robot, surface, moved)[:, rows] - mean)
            if out.sensor is not None:
                out = dataclasses.replace(out, sensor=sensor_motion(robot, self.rig, moved, rows, surface))
            yield out

    def _of_own_quantities(self, signals: Signals, rows: Rows) -> Iterator[Signals]:
        smoothed = {name: made for name, _, made in own_motion(self.log, None) if isinstance(made, Smoothed)}
        errors = {name: made.errors(DRAWS) for name, made in smoothed.items()}
        for number in range(DRAWS):
            away = np.zeros((len(CONTACT), len(rows)))
            for name, rate in (("depth", DEPTH_RATE), ("slip1", SLIP_RATE[0]), ("slip2", SLIP_RATE[1])):
                if name in errors:
                    value, first, _ = errors[name]
                    away[CONTACT.index(name)], away[rate] = value[number, rows, 0], first[number, rows, 0]
            yield _moved(signals, away)


@dataclass(frozen=True, eq=False)
class JointDraws:
    """The same for joint torques.

    Attributes:
        robot: the arm that carries everything whose torques are predicted, None for axes alone; bare: without the tool.
        carried: load on what lies beyond the sensor frame at all rows of the log [N, N·m], (n, 6), or None.
    """

    log: Log
    robot: Robot | None
    bare: Robot | None
    carried: Array | None

    def __call__(self, signals: Signals, rows: Rows) -> Iterator[Signals]:
        """The signals with each of the motions in turn."""
        motion = axes_motion(self.log)
        if signals.joints is None:
            return
        for drawn in motion.draws(DRAWS):
            moved = joint_signals(drawn, rows, self.robot, self.bare, self.carried)
            yield dataclasses.replace(signals, joints=dataclasses.replace(moved, tool=signals.joints.tool))


def _moved(signals: Signals, away: Array) -> Signals:
    """Signals whose motion is off by rows of a contact table."""
    away = np.nan_to_num(away)
    return dataclasses.replace(
        signals,
        depth=signals.depth + away[DEPTH],
        depth_rate=signals.depth_rate + away[DEPTH_RATE],
        slip=signals.slip + away[SLIP],
        slip_rate=signals.slip_rate + away[SLIP_RATE],
    )
