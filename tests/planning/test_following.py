"""Plans as set-points, and carried out by the virtual arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kinid
from kinid.errors import InputError
from kinid.lab.arm import Arm, Gains, lwr4plus_joints
from kinid.lab.loop_experiment import Loop
from kinid.lab.materials import Material
from kinid.planning import Law, Multisine, Planner, Poke, Protocol
from kinid.planning.following import set_points


def test_a_finer_clock_meets_the_finer_plan(rig: Any) -> None:
    touch = Poke(signal=Multisine(0.003, ((0.001, 1.3),), 1.5), hold=0.2)
    coarse, fine = (Planner(rig, Protocol(rate=rate)).plan([touch]) for rate in (250.0, 1000.0))
    points = set_points(coarse, kinid.Robot.load(rig), 1e-3)
    n = min(len(points.t), len(fine))
    # where the jerk jumps between two samples 4 ms apart: 40 rad/s³ · (4 ms)³ / 100
    np.testing.assert_allclose(points.q[:n], fine.q[:n], atol=3e-8)
    np.testing.assert_allclose(points.dq[:n], fine.dq[:n], atol=3e-5)
    np.testing.assert_allclose(points.positions[:n], fine.tip[:n], atol=1e-7)
    same = set_points(fine, kinid.Robot.load(rig), 1e-3)
    np.testing.assert_allclose(same.q, fine.q, atol=1e-12)


def test_the_virtual_arm_goes_where_the_plan_says(rig: Any) -> None:
    """An impedance of 5200 N/m, set-points ahead of it by the expected force: depth within the arm's dynamic error."""
    law = Law(kinid.Model("hunt-crossley"), {"stiffness": 1200.0, "damping": 1500.0, "exponent": 1.2})
    motion = Planner(rig, Protocol(rate=250.0), law).plan([Poke(signal=Multisine(0.008, ((0.003, 0.7),), 3.0))])
    robot, gains = kinid.Robot.load(rig), Gains()
    arm = Arm.pack(robot, rig.tool)
    material = Material(stiffness=1200.0, loss=1500.0 / 1200.0, exponent=1.2)
    loop = Loop(arm, lwr4plus_joints(friction=False), gains, np.asarray(rig.axes), np.asarray(rig.surface.point))
    errors = []
    for stiffness in (None, gains.translation):
        points = set_points(motion, robot, gains.period, stiffness)
        done = loop.run(points.q[0, arm.columns], points.positions, points.rotations, material)
        wanted = np.interp(done.t, motion.t, motion.place[:, 2])  # type: ignore[index]
        rows = points.phase == "poke"
        errors.append(float(np.sqrt(np.mean((done.place[rows, 2] - wanted[rows]) ** 2))))
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 3e-4


def test_what_cannot_be_followed(rig: Any) -> None:
    motion = Planner(rig, Protocol(rate=100.0)).plan([Poke(signal=Multisine(0.003, (), 1.0))])
    robot = kinid.Robot.load(rig)
    with pytest.raises(InputError, match="expected forces"):
        set_points(motion, robot, stiffness=5000.0)
    with pytest.raises(InputError, match="period"):
        set_points(motion, robot, 0.0)
