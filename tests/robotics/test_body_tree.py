"""Compiled torques of many states against Pinocchio's, which shares only the numbers of the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from kinid.data.rig import Rig, ToolSpec
from kinid.modeling.tool_load import gravity_torques, payload_torques
from kinid.robotics.body_tree import BodyTree
from kinid.robotics.robot import Robot

TOOL = ToolSpec(mass=0.7, com=(0.01, -0.02, 0.06), inertia=(2e-3, 1.5e-3, 1e-3, 1e-4, -2e-4, 3e-4))
#: rounding of torques up to some 100 N·m
EXACT = 1e-11

LINK = (
    '<link name="l{0}"><inertial><origin xyz="0.0{0} 0.02 -0.03" rpy="0.2 0.1 0.4"/><mass value="{0}"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="-0.003"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="l{parent}"/><child link="l{child}"/>'
    '<origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.1"/><axis xyz="{axis}"/>'
    '<limit lower="-3" upper="3" velocity="9" effort="99"/></joint>'
)
#: a trunk with two branches, one of which slides; names that don't sort as they stand
JOINTS = (
    ("b", "revolute", 1, 2, "0 1 0"),
    ("d", "prismatic", 2, 3, "0.6 0 0.8"),
    ("a", "continuous", 3, 4, "1 0 0"),
    ("c", "revolute", 2, 5, "0 0 -1"),
)


def branched(folder: Path) -> Robot:
    keys = ("name", "kind", "parent", "child", "axis")
    joints = "".join(JOINT.format(**dict(zip(keys, joint))) for joint in JOINTS)
    path = folder / "branched.urdf"
    path.write_text(f'<robot name="branched">{"".join(LINK.format(i) for i in range(1, 6))}{joints}</robot>')
    text = '[robot]\nmodel = "branched.urdf"\nsensor_frame = "l4"\n'
    text += 'joints = ["a", "b", "c", "d"]\ngravity = [1.0, -2.0, -9.0]'
    return Robot.load(Rig.parse_text(text, folder))


@pytest.mark.parametrize("name", ["lwr4plus", "panda", "ur5", "branched"])
def test_torques_of_motion_load_and_gravity(name: str, tmp_path: Path) -> None:
    if name == "branched":
        robot = branched(tmp_path)
    else:
        sensor = {"lwr4plus": "lwr_arm_7_link", "panda": "panda_link8", "ur5": "tool0"}[name]
        known = Robot.load(Rig.parse_text(f'[robot]\nmodel = "{name}"\n'))
        sensor = known.sensor_frame or sensor
        robot = Robot.load(
            Rig.parse_text(f'[robot]\nmodel = "{name}"\nsensor_frame = "{sensor}"\ngravity = [1, 2, -9]')
        )
    robot = robot.with_tool(TOOL)
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(5)
    n, joints = 30, robot.joint_count
    q, dq, ddq = rng.uniform(-1, 1, (n, joints)), rng.normal(size=(n, joints)), rng.normal(size=(n, joints))
    load = rng.normal(size=(n, 6))
    at, v, a = robot.configuration(q), robot.tangent(dq), robot.tangent(ddq)
    sensor = robot.sensor_frame or ""
    frame = robot.frame(sensor)
    number = model.getFrameId(sensor, frame.type)
    alone, carrying, held = (np.empty((n, model.nv)) for _ in range(3))
    for i in range(n):
        alone[i] = pin.rnea(model, data, at[i], v[i], a[i])
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        forces[frame.parentJoint] = frame.placement.act(pin.Force(load[i]))
        carrying[i] = pin.rnea(model, data, at[i], v[i], a[i], forces)
        held[i] = -load[i] @ pin.computeFrameJacobian(model, data, at[i], number, pin.LOCAL)
    tree = BodyTree.of(robot)
    np.testing.assert_allclose(tree.torques(q, dq, ddq), robot.from_tangent(alone), atol=EXACT)
    np.testing.assert_allclose(tree.torques(q, dq, ddq, load, sensor), robot.from_tangent(carrying), atol=EXACT)
    np.testing.assert_allclose(tree.torques_of_load(q, load, sensor), robot.from_tangent(held), atol=EXACT)
    bent = pin.Model(model)
    for axis, found in enumerate(gravity_torques(robot, q)):
        bent.gravity = pin.Motion(np.eye(3)[axis], np.zeros(3))
        expected = np.array([pin.computeGeneralizedGravity(bent, data, row) for row in at])
        np.testing.assert_allclose(found.T, robot.from_tangent(expected), atol=EXACT)


@pytest.mark.parametrize("name", ["lwr4plus", "branched"])
def test_torques_are_linear_in_a_payload(name: str, tmp_path: Path) -> None:
    """What a payload of mass and first moment adds to an arm's torques, by a body of that mass instead."""
    robot = (
        branched(tmp_path)
        if name == "branched"
        else Robot.load(Rig.parse_text('[robot]\nmodel = "lwr4plus"\ngravity = [1, 2, -9]'))
    )
    rng = np.random.default_rng(6)
    q, dq, ddq = (rng.uniform(-1, 1, (20, robot.joint_count)) for _ in range(3))
    mass, com, inertia = 0.9, np.array([0.02, -0.05, 0.08]), np.diag([3e-3, 4e-3, 5e-3])
    # two bodies of one inertia about the frame's origin differ by a mass and a first moment alone
    about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    where = robot.frame(robot.sensor_frame or "")
    torques = []
    for body in (pin.Inertia(mass, com, inertia), pin.Inertia(0.4, np.zeros(3), about)):
        model = robot.model.copy()
        model.appendBodyToJoint(where.parentJoint, body, where.placement)
        arm = Robot(
            robot.name, model, robot.joint_names, robot.sensor_frame, robot.tip_frame, robot.gravity, robot.compliance
        )
        torques.append(BodyTree.of(arm).torques(q, dq, ddq))
    units = payload_torques(robot, q, dq, ddq)
    np.testing.assert_allclose(
        np.einsum("k,kjn->nj", [mass - 0.4, *(mass * com)], units), torques[0] - torques[1], atol=EXACT
    )


def test_what_the_base_carries_loads_no_joint() -> None:
    robot = Robot.load(Rig.parse_text('[robot]\nmodel = "ur5"\nsensor_frame = "tool0"'))
    still = np.zeros((3, 6))
    tree = BodyTree.of(robot)
    assert (tree.torques_of_load(still, np.ones((3, 6)), "base_link") == 0.0).all()
