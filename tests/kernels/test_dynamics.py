"""The compiled dynamics against Pinocchio, which shares only the numbers of the model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from kinid.data.rig import Rig, ToolSpec
from kinid.kernels import dynamics as kernel
from kinid.lab.arm import Arm
from kinid.robotics.robot import Robot

TOOL = ToolSpec(mass=0.7, com=(0.01, -0.02, 0.06), inertia=(2e-3, 1.5e-3, 1e-3, 1e-4, -2e-4, 3e-4))
# rounding only: torques reach 1e2, and Pinocchio works in other axes
EXACT = 1e-10


def _case(name: str) -> tuple[Robot, Arm, Any]:
    frames = {
        "lwr4plus": 'model = "lwr4plus"',
        "tilted": 'model = "lwr4plus"\ngravity = [3.0, -2.0, -8.0]',
        "panda": 'model = "panda"\ntip_frame = "panda_hand"\nsensor_frame = "panda_hand"',
        "ur5": 'model = "ur5"\ntip_frame = "tool0"\nsensor_frame = "tool0"',
    }
    robot = Robot.load(Rig.parse_text(f"[robot]\n{frames[name]}\n"))
    return robot, Arm.pack(robot, TOOL), robot.with_tool(TOOL).model


@pytest.mark.parametrize("name", ["lwr4plus", "tilted", "panda", "ur5"])
def test_agrees_with_pinocchio_at_random_states(name: str) -> None:
    robot, arm, model = _case(name)
    data, frame = model.createData(), model.getFrameId(robot.tip_frame, robot.frame(robot.tip_frame or "").type)
    rng, order = np.random.default_rng(3), np.argsort(arm.columns)
    for _ in range(40):
        q, dq = rng.uniform(-3, 3, arm.joints), rng.normal(scale=3.0, size=arm.joints)
        state = arm.state(q, dq)
        configuration = robot.configuration(q[order][None])[0]
        speed = robot.tangent(dq[order][None])[0]
        back = np.array([robot.joint_names.index(model.names[j]) for j in range(1, model.njoints)])
        to_chain = np.argsort(back)[arm.columns]
        mass = np.triu(pin.crba(model, data, configuration))
        mass = mass + np.triu(mass, 1).T
        np.testing.assert_allclose(state.mass, mass[np.ix_(to_chain, to_chain)], atol=EXACT)
        np.testing.assert_allclose(state.bias, pin.nle(model, data, configuration, speed)[to_chain], atol=EXACT)
        gravity = pin.computeGeneralizedGravity(model, data, configuration)[to_chain]
        np.testing.assert_allclose(state.gravity, gravity, atol=EXACT)
        jacobian = pin.computeFrameJacobian(model, data, configuration, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(state.jacobian, jacobian[:, to_chain], atol=EXACT)
        place = pin.updateFramePlacement(model, data, frame)
        np.testing.assert_allclose(state.position, place.translation, atol=EXACT)
        np.testing.assert_allclose(state.rotation, place.rotation, atol=EXACT)
        energy = pin.computeKineticEnergy(model, data, configuration, speed)
        energy += pin.computePotentialEnergy(model, data, configuration)
        assert arm.energy(q, dq) == pytest.approx(energy, abs=EXACT * 10)


def test_prismatic_joints_too(tmp_path: Any) -> None:
    links = "".join(
        f'<link name="l{i}"><inertial><origin xyz="0.0{i + 1} 0.02 -0.03"/><mass value="{i + 1}"/>'
        f'<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="-0.003"/></inertial></link>'
        for i in range(4)
    )
    kinds = (("prismatic", "0 1 0"), ("revolute", "1 0 0"), ("prismatic", "0.6 0 0.8"))
    joints = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 0.1"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="9" effort="99"/></joint>'
        for i, (kind, axis) in enumerate(kinds)
    )
    path = tmp_path / "slider.urdf"
    path.write_text(f'<robot name="slider">{links}{joints}</robot>')
    robot = Robot.from_urdf(path, tip_frame="l3")
    arm, model = Arm.pack(robot), robot.model
    data, rng = model.createData(), np.random.default_rng(0)
    for _ in range(20):
        q, dq = rng.uniform(-1, 1, 3), rng.normal(size=3)
        state = arm.state(q, dq)
        mass = np.triu(pin.crba(model, data, q))
        np.testing.assert_allclose(state.mass, mass + np.triu(mass, 1).T, atol=EXACT)
        np.testing.assert_allclose(state.bias, pin.nle(model, data, q, dq), atol=EXACT)


def test_factor_solves() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(7, 7))
    matrix, b = a @ a.T + np.eye(7), rng.normal(size=7)
    factor, x = matrix.copy(), b.copy()
    kernel.factorise(factor, 7)
    kernel.substitute(factor, x, 7)
    np.testing.assert_allclose(matrix @ x, b, atol=1e-12)
