"""Predicted joint torques against Pinocchio's other algorithms, energy, and a measured arm."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.robotics import inverse_dynamics as module
from kinid.robotics.inverse_dynamics import inverse_dynamics
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

POSE = (0.2, 0.5, -0.1, -1.2, 0.3, 0.9, 0.0)
TOOL = {"mass": 0.8, "com": [0.004, -0.006, 0.06], "inertia": [4e-4, 5e-4, 1e-4, 1e-5, -2e-5, 3e-5]}
#: rigid bodies are asked about the motion as it was logged; what the smoother makes of it has tests of its own
joint_torques = partial(module.joint_torques, differentiator=Differentiator())
#: rounding of torques up to some 100 N·m
EXACT = 1e-11


def make_rig(**tables: Any) -> Rig:
    robot = {"model": "lwr4plus", "gravity": [1.0, -2.0, -9.4]} | tables.pop("robot", {})
    return Rig.parse({"robot": robot, **tables})


def assembled(model: Any, q: Array, dq: Array, ddq: Array) -> Array:
    """M q̈ + C q̇ + g from composite bodies, Coriolis matrix and gravity: not by recursive Newton-Euler."""
    data, out = model.createData(), []
    for a, b, c in zip(q, dq, ddq):
        mass = pin.crba(model, data, a)
        mass = np.triu(mass) + np.triu(mass, 1).T
        coriolis = pin.computeCoriolisMatrix(model, data, a, b)
        out.append(mass @ c + coriolis @ b + pin.computeGeneralizedGravity(model, data, a))
    return np.array(out)


def test_prediction_is_mass_matrix_coriolis_and_gravity(swing: Callable[..., Any]) -> None:
    rig = make_rig()
    robot = Robot.load(rig)
    t = np.arange(200) / 100
    q, dq, ddq = swing(POSE, size=0.8, speed=6.0)(t)
    expected = assembled(robot.model, q, dq, ddq)
    noise = np.random.default_rng(0).normal(size=q.shape)
    found = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=expected + noise), rig)
    np.testing.assert_allclose(found.predicted, expected, atol=EXACT)
    np.testing.assert_allclose(found.residual, noise, atol=EXACT)
    np.testing.assert_allclose(found.rms, np.sqrt((noise**2).mean(axis=0)), atol=EXACT)
    np.testing.assert_allclose(found.measured_rms, np.sqrt(((expected + noise) ** 2).mean(axis=0)), atol=EXACT)
    assert found.joint_names == robot.joint_names
    assert found.valid.all()


def test_power_of_the_torques_is_the_rate_of_the_energy(swing: Callable[..., Any]) -> None:
    rig = make_rig(tool=TOOL)
    robot = Robot.load(rig).with_tool(rig.tool)
    moves = swing(POSE, seed=1, size=0.6)
    t = np.arange(100) / 50

    def energy(at: Array) -> Array:
        data, (q, dq, _) = robot.model.createData(), moves(at)
        return np.array(
            [
                pin.computeKineticEnergy(robot.model, data, a, b) + pin.computePotentialEnergy(robot.model, data, a)
                for a, b in zip(q, dq)
            ]
        )

    q, dq, ddq = moves(t)
    found = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=np.zeros_like(q)), rig)
    power = np.sum(found.predicted * dq, axis=1)
    h = 1e-5
    assert np.abs(power).max() > 10
    # central differences: h² · 1e4 W/s², and 1e-14 J / h
    np.testing.assert_allclose(power, (energy(t + h) - energy(t - h)) / (2 * h), atol=1e-6)


def test_contact_wrench_through_the_jacobian(swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    """Measured: the arm with its tool, less Jᵀ f. Predicted: the bare arm, less what the sensor carries."""
    rng = np.random.default_rng(2)
    bias = [1.0, -2.0, 3.0, 0.1, 0.2, -0.3]
    rig = make_rig(tool=TOOL, sensor={"bias": bias})
    robot = Robot.load(rig)
    t = np.arange(150) / 100
    q, dq, ddq = swing(POSE, size=0.6)(t)
    force, moment = rng.normal(size=(150, 3)) * 20, rng.normal(size=(150, 3))
    whole = robot.with_tool(rig.tool)
    tau, wrench = assembled(whole.model, q, dq, ddq), weighed(rig, robot, q, dq, ddq) + bias
    data, tip = robot.model.createData(), robot.model.getFrameId("tool_tip")
    for i in range(150):
        jacobian = pin.computeFrameJacobian(robot.model, data, q[i], tip, pin.LOCAL_WORLD_ALIGNED)
        tau[i] -= jacobian.T @ np.concatenate([force[i], moment[i]])
        pin.framesForwardKinematics(robot.model, data, q[i])
        sensor = data.oMf[robot.model.getFrameId("ft_sensor")]
        arm = data.oMf[tip].translation - sensor.translation
        wrench[i, :3] += sensor.rotation.T @ force[i]
        wrench[i, 3:] += sensor.rotation.T @ (np.cross(arm, force[i]) + moment[i])
    found = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=tau, wrench=wrench), rig)
    np.testing.assert_allclose(found.predicted, tau, atol=EXACT)
    # free motion without a wrench: the rig's tool hangs on the arm
    free = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=tau), rig)
    np.testing.assert_allclose(free.predicted, assembled(whole.model, q, dq, ddq), atol=EXACT)


def test_joint_order_and_joints_without_limits(swing: Callable[..., Any]) -> None:
    """Pinocchio orders joints itself and writes continuous ones as cosine and sine."""
    names = Robot.load(Rig.parse({"robot": {"model": "kinova"}})).joint_names
    order = [4, 2, 0, 5, 1, 3]
    t = np.arange(50) / 50
    q, dq, ddq = swing(np.full(6, 0.5), size=2.0)(t)
    straight, mixed = (
        Rig.parse({"robot": {"model": "kinova", "joints": list(joints)}})
        for joints in (names, [names[j] for j in order])
    )
    zero = np.zeros_like(q)
    one = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=zero), straight)
    other = joint_torques(Log(t, q=q[:, order], dq=dq[:, order], ddq=ddq[:, order], tau=zero), mixed)
    np.testing.assert_allclose(other.predicted, one.predicted[:, order], atol=EXACT)
    model = Robot.load(straight).model
    configuration = Robot.load(straight).configuration(q)
    expected = assembled(model, configuration, dq, ddq)  # its tangent order is that of the names
    np.testing.assert_allclose(one.predicted, expected, atol=EXACT)


def test_a_drive_of_one_axis(tmp_path: Path) -> None:
    """A sliding mass: force is m (q̈ − g along the axis)."""
    (tmp_path / "drive.urdf").write_text(
        '<robot name="drive"><link name="base"/><link name="car"><inertial><mass value="5"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="0 0 1"/>'
        '<limit lower="-9" upper="9" velocity="9" effort="9"/></joint></robot>'
    )
    rig = Rig.parse({"robot": {"model": "drive.urdf"}}, folder=tmp_path)
    t = np.arange(100) / 100
    log = Log(t, q=np.sin(t)[:, None], dq=np.cos(t)[:, None], ddq=-np.sin(t)[:, None], tau=np.zeros((100, 1)))
    found = joint_torques(log, rig)
    np.testing.assert_allclose(found.predicted[:, 0], 5 * (9.81 - np.sin(t)), atol=1e-13)


def test_invalid_samples_are_left_out(swing: Callable[..., Any]) -> None:
    rig = make_rig()
    t = np.arange(200) / 100
    q, dq, ddq = swing(POSE)(t)
    tau = inverse_dynamics(Robot.load(rig), q, dq, ddq)
    tau[50] += 1e6
    spoilt = tau.copy()
    spoilt[50, 3], dq[70, 2], ddq[80, 1] = np.nan, np.inf, np.nan
    found = joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=spoilt), rig)
    assert list(np.flatnonzero(~found.valid)) == [50, 70, 80]
    assert np.isnan(found.predicted[[50, 70, 80]]).all()
    np.testing.assert_allclose(found.rms, 0.0, atol=EXACT)
    with pytest.raises(InputError, match="no valid sample"):
        joint_torques(Log(t, q=q, dq=dq, ddq=ddq, tau=np.full_like(tau, np.nan)), rig)


def test_a_log_without_torques_is_refused() -> None:
    with pytest.raises(InputError, match="no joint torques"):
        joint_torques(Log(np.arange(3.0), q=np.zeros((3, 7))), make_rig())


def test_results_are_read_only() -> None:
    found = joint_torques(Log(np.arange(30.0), q=np.zeros((30, 7)), tau=np.zeros((30, 7))), make_rig())
    for values in (found.measured, found.predicted):
        with pytest.raises(ValueError, match="read-only"):
            values[0, 0] = 1.0
    assert "inverse dynamics" in [step.name for step in found.provenance.steps]


@pytest.mark.real
@pytest.mark.parametrize("number", [1, 2])
def test_a_measured_arm(real_data: Path, number: int) -> None:
    """A KUKA LWR4+ in free motion: what rigid bodies leave unexplained is friction and the like, and known in size."""
    with np.load(real_data / "lwr4plus-motion" / f"measurements_{number}.npz", allow_pickle=False) as data:
        t, q, dq, ddq, tau = (data[k] for k in ("times", "positions", "velocities", "accelerations", "torques"))
    keep = np.concatenate([[True], np.diff(t) > 0])
    log = Log(t[keep], q=q[keep], dq=dq[keep], ddq=ddq[keep], tau=tau[keep])
    found = module.joint_torques(log, Rig.parse({"robot": {"model": "lwr4plus"}}))  # smoothed
    # what another implementation leaves on the first file: 1.32 0.79 0.53 0.85 1.29 0.67 0.27 N·m
    assert (found.rms <= [1.4, 0.85, 0.65, 0.95, 1.4, 0.75, 0.35]).all(), found.rms
    assert found.measured_rms[1] > 15  # of a signal that large
