"""Whether a saved trajectory is one motion of one robot: its joints, rates and tip are three ways to say the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kinid.data.guess import columns_of
from kinid.errors import InputError
from kinid.planning.trajectory import Trajectory, read_trajectory
from kinid.robotics.robot import Robot
from kinid.writers import TABLE_SUFFIXES

#: a tip may be so far from where its joints put it [m], rates off by this share of their size, and speeds beyond limits
#: by this one
SAME_TIP, SAME_RATES, ROUNDED = 1e-3, 0.2, 1.05


def is_trajectory(path: Path) -> bool:
    """Whether a table is a trajectory: it says where the tip has to be, and holds no reading."""
    if path.suffix.lower() not in TABLE_SUFFIXES:
        return False
    columns = columns_of(path)
    return "tip_x" in columns and "q1" in columns and "fx" not in columns


def saved_doubts(path: Path, robot: Robot) -> list[str]:
    """What speaks against a saved trajectory, a sentence each.

    Args:
        path: of a table with a tip, as `Trajectory.write` makes it. robot: that it is shown on.

    Raises:
        InputError: no trajectory, or one of another robot.
    """
    motion = read_trajectory(path, robot.joint_names)
    if motion.q.shape[1] != robot.joint_count:
        raise InputError(
            f"{motion.q.shape[1]} joints in {path}",
            f"{robot.joint_count} for {robot.name}",
            "name the rig that it was planned for with --rig",
        )
    return [*_tip(motion, robot), *_limits(motion, robot), *_rates(motion)]


def _tip(motion: Trajectory, robot: Robot) -> list[str]:
    if robot.tip_frame is None or not np.isfinite(motion.tip).any():
        return []
    away = np.linalg.norm(robot.kinematics(robot.tip_frame, motion.q).position - motion.tip, axis=1)
    i = int(np.nanargmax(away))
    if away[i] <= SAME_TIP:
        return []
    return [
        f"the tip is {1e3 * away[i]:.3g} mm beside where its joints put it, {motion.t[i]:.4g} s in: tip or joints were "
        "changed, or it was planned for another tool"
    ]


def _limits(motion: Trajectory, robot: Robot) -> list[str]:
    over = np.maximum(motion.q - robot.upper, robot.lower - motion.q)
    if over.max() > 0.0:
        i, j = np.unravel_index(int(over.argmax()), over.shape)
        return [
            f"{robot.joint_names[j]} is {over[i, j]:.3g} rad beyond its limits, {motion.t[i]:.4g} s in: angles in "
            "degrees, or of another robot"
        ]
    most = robot.velocity_limit
    share = np.abs(np.diff(motion.q, axis=0) / np.diff(motion.t)[:, None]) / np.where(most > 0.0, most, np.inf)
    if share.max() <= ROUNDED:
        return []
    i, j = np.unravel_index(int(share.argmax()), share.shape)
    return [
        f"{robot.joint_names[j]} moves {share[i, j]:.3g} times as fast as it can, {motion.t[i]:.4g} s in: a jump, or "
        "times in another unit"
    ]


def _rates(motion: Trajectory) -> list[str]:
    own = np.gradient(motion.q, motion.t, axis=0)
    size = float(np.sqrt(np.mean(own**2)))
    off = float(np.sqrt(np.mean((motion.dq - own) ** 2)))
    if off <= SAME_RATES * size + 1e-6:
        return []
    return [
        f"the velocities are {100.0 * off / max(size, 1e-9):.3g} % beside what the positions do: sign, order or unit"
    ]
