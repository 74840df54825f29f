"""A log that is as it should be: what tests of doubts change."""

from __future__ import annotations

import numpy as np
import pytest
from scripted import scripted_poke

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Rig, Robot]:
    """A poke whose free motion turns the wrist by half a radian about two axes, as a log of several poses does."""
    path = scripted_poke(seed=5).write(tmp_path_factory.mktemp("doubts"))
    rig = Rig.load(path.parent / "rig.toml")
    robot = Robot.load(rig)
    log = read(path, rig, robot=robot)
    assert log.q is not None
    assert log.wrench is not None
    turns = np.repeat(log.q[:1], 2000, axis=0)
    t = np.arange(2000) * log.period
    q = turns.copy()
    q[:, 5] += 0.5 * np.sin(2 * np.pi * t / 2.0) ** 3
    q[:, 4] += 0.5 * np.sin(2 * np.pi * t / 4.0) ** 3
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    assert rig.tool is not None
    assert robot.sensor_frame is not None
    load = tool_load(rig.tool, robot.kinematics(robot.sensor_frame, q, dq, ddq), robot.gravity)
    bias = np.median(log.wrench[:200], axis=0) - load[0]
    noise = np.random.default_rng(0).normal(scale=0.015, size=load.shape) * [1, 1, 2, 0.03, 0.04, 0.02]
    return (
        Log(
            t=np.concatenate([t, log.t - log.t[0] + t[-1] + log.period]),
            q=np.concatenate([q, log.q]),
            wrench=np.concatenate([load + bias + noise, log.wrench]),
        ),
        rig,
        robot,
    )
