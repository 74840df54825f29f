"""A saved trajectory whose joints, rates and tip contradict each other, or the robot."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scripted import RIG

from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.planning.saved_doubts import is_trajectory, saved_doubts
from kinid.planning.trajectory import Trajectory
from kinid.robotics.robot import Robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(Rig.parse_text(RIG))


@pytest.fixture(scope="module")
def motion(robot: Robot) -> Trajectory:
    """Joint 2 swings once, slowly."""
    t = np.linspace(0.0, 4.0, 801)
    q = np.tile(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), (len(t), 1))
    q[:, 1] += 0.1 * np.sin(np.pi * t / 2.0) ** 2
    dq = np.gradient(q, t, axis=0)
    tip = robot.kinematics("tool_tip", q).position
    return Trajectory(t, np.full(len(t), "free"), q, dq, np.gradient(dq, t, axis=0), tip, robot.joint_names)


CHANGES = {
    "as it was": (lambda m: m, ""),
    "another tip": (lambda m: dataclasses.replace(m, tip=m.tip + (0.05, 0.0, 0.0)), "50 mm beside"),
    "joints exchanged": (lambda m: dataclasses.replace(m, q=m.q[:, [1, 0, 2, 3, 4, 5, 6]]), "beside where its joints"),
    "degrees": (lambda m: dataclasses.replace(m, q=np.rad2deg(m.q)), "beyond its limits"),
    "rates turned": (lambda m: dataclasses.replace(m, dq=-m.dq), "the velocities are"),
    "a hundred times as fast": (lambda m: dataclasses.replace(m, t=m.t / 100.0, dq=100.0 * m.dq), "as fast as it can"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_contradicts_itself_is_said(change: str, motion: Trajectory, robot: Robot, tmp_path: Path) -> None:
    make, says = CHANGES[change]
    path = tmp_path / "plan.parquet"
    make(motion).write(path)
    assert is_trajectory(path)
    said = " | ".join(saved_doubts(path, robot))
    assert says in said
    assert bool(says) == bool(said)


def test_another_robots_is_refused(motion: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "plan.csv"
    motion.write(path)
    with pytest.raises(InputError, match="7 joints"):
        saved_doubts(
            path,
            Robot.load(Rig.parse_text(RIG.replace("lwr4plus", "ur5").replace("[tool]", 'tip_frame = "tool0"\n[tool]'))),
        )


def test_a_log_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q1,tip_x,fx\n0,0,0,0\n1,0,0,0\n")
    assert not is_trajectory(path)
    assert not is_trajectory(tmp_path / "out.mcap")
