"""A trajectory as set-points of a controller: at its period, as joints or as poses of the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.planning.trajectory import Trajectory
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SetPoints:
    """One a control period.

    Attributes:
        t: [s], (n,). phase: (n,). q, dq: joints, (n, N). positions: of the tip, base frame [m], (n, 3).
        rotations: (n, 3, 3).
    """

    t: Array
    phase: NDArray[np.str_]
    q: Array
    dq: Array
    positions: Array
    rotations: Array


def set_points(motion: Trajectory, robot: Robot, period: float = 1e-3, stiffness: float | None = None) -> SetPoints:
    """What a controller follows to carry a trajectory out.

    Args:
        motion: of the robot's joints. robot: with a tip frame. period: of the controller [s].
        stiffness: of a Cartesian impedance [N/m]: set-points go ahead by the expected force over it, so that the tip
            goes where the plan says in spite of the material.

    Raises:
        InputError: another robot's joints, a period that is no time, or a stiffness without expected forces.
    """
    if motion.joint_names != robot.joint_names or robot.tip_frame is None:
        raise InputError(
            f"a trajectory of {', '.join(motion.joint_names)}",
            f"the joints of {robot.name}, with a tip frame",
            "name the rig that it was planned for",
        )
    if not (np.isfinite(period) and period > 0):
        raise InputError(f"a period of {period} s", "a positive time", "correct it")
    t: Array = np.arange(int(np.floor(motion.duration / period + 1e-9)) + 1, dtype=np.float64) * period
    row = np.clip(np.searchsorted(motion.t - motion.t[0], t + 1e-9 * period, side="right") - 1, 0, len(motion) - 2)
    q, dq = between(motion, row, t - (motion.t[row] - motion.t[0]))
    pose = robot.kinematics(robot.tip_frame, q, dq)
    positions = pose.position
    if stiffness is not None:
        if motion.force is None or not np.isfinite(motion.force).all():
            raise InputError(
                "a plan without expected forces", "the force at every sample", "plan with --model, or leave it out"
            )
        force = np.stack([np.interp(t, motion.t - motion.t[0], motion.force[:, k]) for k in range(3)], axis=1)
        positions = positions - force / stiffness
    return SetPoints(t, motion.phase[row], q, dq, positions, pose.rotation)


def between(motion: Trajectory, row: NDArray[np.int64], since: Array) -> tuple[Array, Array]:
    """Joints and velocities at times [s] since the samples of rows, by the polynomial of fifth degree that joins
    neighbours.
    """
    h = (motion.t[row + 1] - motion.t[row])[:, None]
    u = since[:, None] / h
    a, b = row, row + 1
    q0, v0, a0 = motion.q[a], h * motion.dq[a], h**2 * motion.ddq[a]
    q1, v1, a1 = motion.q[b], h * motion.dq[b], h**2 * motion.ddq[b]
    # what is left of the second sample when the first one's parabola has been taken away
    d, e, f = q1 - q0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3, c4, c5 = 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f
    q = q0 + u * (v0 + u * (0.5 * a0 + u * (c3 + u * (c4 + u * c5))))
    dq = (v0 + u * (a0 + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))) / h
    return q, dq
