"""The arm of a rig: which joints and frames it has, what carries what, and what is said when a name is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import kinid.urdf
from kinid.data.log import Log
from kinid.data.rig import Rig, RobotSpec, ToolSpec
from kinid.errors import InputError
from kinid.robotics.motion import joint_motion
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator


def robot(model: str = "lwr4plus", **spec: Any) -> Robot:
    return Robot.from_spec(RobotSpec(model=model, **spec))


def arm(*links: str, mount: str = "") -> str:
    """A URDF with hinges about z between links in a row, 0.3 m apart."""
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="{a}"/><child link="{b}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i, (a, b) in enumerate(zip(links[:-1], links[1:]))
    )
    return f'<robot name="r">{"".join(f"<link name={chr(34)}{x}{chr(34)}/>" for x in links)}{joints}{mount}</robot>'


def test_the_shipped_arm_has_the_names_that_are_promised() -> None:
    lwr = robot()
    names = [frame.name for frame in lwr.model.frames]
    for frame in ("base_link", *(f"link_{j}" for j in range(1, 8)), "flange", "ft_sensor", "tool_tip"):
        assert frame in names
    assert lwr.joint_names == tuple(f"joint_{j}" for j in range(1, 8))
    assert (lwr.sensor_frame, lwr.tip_frame) == ("ft_sensor", "tool_tip")
    assert lwr.joint_count == 7
    assert (lwr.lower < lwr.upper).all()


def test_whoever_changes_a_robot_changes_no_other() -> None:
    mine, before = robot(), robot().chain("tool_tip").shifts
    mine.model.inertias[3].mass = 100.0
    mine.gravity[2] = 0.0
    mine.model.jointPlacements[2].translation = np.array([0.0, 0.0, 9.0])
    other = robot()
    assert other.model.inertias[3].mass != 100.0
    assert other.gravity[2] == -9.81
    np.testing.assert_array_equal(other.chain("tool_tip").shifts, before)


def test_a_urdf_that_was_changed_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(arm("a", "b", "c"))
    first = Robot.from_urdf(path)
    path.write_text(arm("a", "b", "c", "d"))
    assert Robot.from_urdf(path).joint_count == first.joint_count + 1
    path.write_text("no URDF")
    with pytest.raises(InputError):
        Robot.from_urdf(path)


def test_tip_in_sensor_is_where_the_tip_is() -> None:
    lwr = robot()
    q = np.array([[0.3, -0.7, 0.4, 1.1, -0.2, 0.9, 0.1]])
    sensor, tip = lwr.kinematics("ft_sensor", q), lwr.kinematics("tool_tip", q)
    offset = sensor.rotation[0].T @ (tip.position[0] - sensor.position[0])
    np.testing.assert_allclose(lwr.tip_in_sensor(), offset, atol=1e-15)


@pytest.mark.parametrize(
    ("model", "tip", "joints"),
    [
        ("panda", "panda_hand_tcp", 7),
        ("ur5", "tool0", 6),
        ("kinova", "j2s6s200_end_effector", 6),
        ("xarm7", "link7", 7),
    ],
)
def test_joints_are_those_between_base_and_tip(model: str, tip: str, joints: int) -> None:
    assert robot(model, tip_frame=tip).joint_count == joints


def test_without_a_tip_every_moving_joint_counts() -> None:
    assert robot("panda").joint_count == 9  # with both fingers


def test_limits_of_a_joint_without_limits_are_infinite() -> None:
    kinova = robot("kinova")
    continuous = [kinova.model.joints[kinova.model.getJointId(name)].nq == 2 for name in kinova.joint_names]
    assert any(continuous)
    np.testing.assert_array_equal(np.isinf(kinova.upper), continuous)
    np.testing.assert_array_equal(np.isinf(kinova.lower), continuous)


def test_a_urdf_beside_the_rig(tmp_path: Path) -> None:
    (tmp_path / "mine.urdf").write_text(arm("base", "one", "two"))
    rig = Rig.parse({"robot": {"model": "mine.urdf", "tip_frame": "two"}}, folder=tmp_path)
    mine = Robot.load(rig)
    assert mine.joint_names == ("j0", "j1")
    assert mine.sensor_frame is None
    np.testing.assert_allclose(mine.kinematics("two", [[0.0, 0.0]]).position, [[0.6, 0.0, 0.0]], atol=1e-15)


def test_a_link_and_a_joint_of_one_name(tmp_path: Path) -> None:
    """Common in the wild: then the link is meant."""
    (tmp_path / "twins.urdf").write_text(arm("base", "j1", "end"))
    twins = Robot.from_urdf(tmp_path / "twins.urdf", tip_frame="j1")
    assert twins.joint_names == ("j0",)
    # the link j1 sits at its parent joint j0, the joint j1 0.3 m further
    np.testing.assert_allclose(twins.kinematics("j1", [[0.0]]).position, [[0.3, 0.0, 0.0]], atol=1e-15)
    kept = Robot.from_urdf(tmp_path / "twins.urdf", joints=["j1"])
    assert list(kept.model.names)[1:] == ["j1"]
    np.testing.assert_allclose(kept.kinematics("end", [[0.0]]).position, [[0.6, 0.0, 0.0]], atol=1e-15)


def test_configuration_and_tangent_follow_the_names() -> None:
    """Pinocchio's own order and the cosine and sine of joints without limits, against its forward kinematics."""
    straight = robot("kinova", tip_frame="j2s6s200_end_effector")
    mixed = robot("kinova", tip_frame="j2s6s200_end_effector", joints=straight.joint_names[::-1])
    rng = np.random.default_rng(0)
    q, dq = rng.uniform(-3, 3, (5, 6)), rng.normal(size=(5, 6))
    np.testing.assert_allclose(mixed.configuration(q[:, ::-1]), straight.configuration(q), atol=0)
    np.testing.assert_allclose(mixed.tangent(dq[:, ::-1]), straight.tangent(dq), atol=0)
    np.testing.assert_allclose(mixed.from_tangent(mixed.tangent(dq)), dq, atol=0)
    data = straight.model.createData()
    for i, configuration in enumerate(straight.configuration(q)):
        pin.framesForwardKinematics(straight.model, data, configuration)
        place = data.oMf[straight.model.getFrameId("j2s6s200_end_effector")]
        found = straight.kinematics("j2s6s200_end_effector", q[i : i + 1])
        np.testing.assert_allclose(found.position[0], place.translation, atol=1e-14)  # rounding of some 0.1 m


@pytest.mark.parametrize("tilt", [(0.0, 0.0, -9.81), (9.81, 0.0, 0.0), (0.0, 0.0, 9.81), (3.0, -4.0, 8.0)])
def test_a_tilted_or_hung_base(tilt: tuple[float, float, float]) -> None:
    """Gravity torque is the potential energy's gradient, with gravity as the rig gives it."""
    hung = robot(gravity=tilt)
    np.testing.assert_array_equal(hung.model.gravity.linear, tilt)
    np.testing.assert_array_equal(hung.gravity, tilt)
    q = np.array([0.3, -0.7, 0.4, 1.1, -0.2, 0.9, 0.1])
    data = hung.model.createData()
    torque = pin.computeGeneralizedGravity(hung.model, data, q)
    h = 1e-6
    for j in range(7):
        step = h * np.eye(7)[j]
        rise = pin.computePotentialEnergy(hung.model, data, q + step) - pin.computePotentialEnergy(
            hung.model, data, q - step
        )
        assert abs(rise / (2 * h) - torque[j]) < 1e-7  # h² · 100 N·m and rounding of 100 J by 1e-16 / h: 1e-8


def test_the_tool_hangs_on_the_sensor() -> None:
    tool = ToolSpec(mass=0.7, com=(0.01, -0.02, 0.05), inertia=(2e-3, 3e-3, 1e-3, 1e-4, -2e-4, 3e-4))
    bare = robot()
    loaded = bare.with_tool(tool)
    assert pin.computeTotalMass(loaded.model) == pytest.approx(pin.computeTotalMass(bare.model) + 0.7, abs=1e-12)
    q, dq = np.array([0.3, -0.7, 0.4, 1.1, -0.2, 0.9, 0.1]), np.array([0.5, -0.3, 0.2, 0.7, -0.9, 1.1, 0.4])
    gain = pin.computeKineticEnergy(loaded.model, loaded.model.createData(), q, dq)
    gain -= pin.computeKineticEnergy(bare.model, bare.model.createData(), q, dq)
    sensor = bare.kinematics("ft_sensor", q, dq)
    omega = sensor.rotation[0].T @ sensor.angular_velocity[0]
    v = sensor.rotation[0].T @ sensor.velocity[0] + np.cross(omega, tool.com)
    # rounding of an energy near 1 J
    assert gain == pytest.approx(0.5 * 0.7 * v @ v + 0.5 * omega @ tool.inertia_matrix @ omega, abs=1e-12)


def test_a_joint_between_sensor_and_tip_is_refused() -> None:
    with pytest.raises(InputError, match="a joint between 'panda_link4' and 'panda_hand_tcp'"):
        robot("panda", sensor_frame="panda_link4", tip_frame="panda_hand_tcp")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"tip_frame": "tool_tipp"}, r"found \[robot\] tip_frame = 'tool_tipp'.*did you mean 'tool_tip'"),
        ({"sensor_frame": "ft_senser"}, r"found \[robot\] sensor_frame = 'ft_senser'.*'ft_sensor'"),
        ({"joints": ("joint_1", "joint_8")}, r"found joint 'joint_8'.*did you mean 'joint_"),
        ({"joints": ("joint_1", "joint_1")}, r"each joint once"),
        ({"joints": ("flange_joint",)}, r"a one-axis joint"),
    ],
)
def test_unknown_names_are_refused_with_near_ones(spec: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        robot(**spec)
    assert "\n" not in str(caught.value)


def test_unknown_models_and_frames() -> None:
    with pytest.raises(InputError, match=r"unknown robot, 'lwr4pluss'.*did you mean 'lwr4plus'"):
        robot("lwr4pluss")
    with pytest.raises(InputError, match="no robot at"):
        robot("not/there.urdf")
    with pytest.raises(InputError, match=r"frame 'linc_3'.*'link_3'"):
        robot().kinematics("linc_3", np.zeros((1, 7)))
    with pytest.raises(InputError, match=r"without \[robot\]"):
        Robot.load(Rig())
    with pytest.raises(InputError, match="without a sensor frame"):
        robot("ur5").with_tool(ToolSpec(mass=1.0))


def test_a_urdf_that_pinocchio_refuses(tmp_path: Path) -> None:
    path = tmp_path / "loop.urdf"
    path.write_text(arm("base", "one").replace('<child link="one"/>', '<child link="nowhere"/>'))
    with pytest.raises(InputError, match="Pinocchio can't read") as caught:
        Robot.from_urdf(path)
    assert "\n" not in str(caught.value)


def test_wrong_joint_count_is_refused() -> None:
    log = Log(np.arange(3.0), q=np.zeros((3, 6)))
    with pytest.raises(InputError, match=r"found 6 joints.*expected 7 for lwr4plus \(joint_1, ") as caught:
        joint_motion(log, robot())
    assert "[robot] joints" in str(caught.value)


def test_a_log_without_positions_is_refused() -> None:
    with pytest.raises(InputError, match=r"no joint positions.*q1…qN \[rad\]"):
        joint_motion(Log(np.arange(3.0), tau=np.zeros((3, 7))), robot())


@pytest.mark.parametrize("model", ["lwr4plus", "ur5", "kinova", "panda"])
def test_degrees_are_refused(model: str, swing: Callable[..., Any]) -> None:
    """And radians of the same motion are not."""
    arm_ = robot(model)
    middle = np.clip(0.5, arm_.lower, arm_.upper)
    t = np.arange(200) / 100.0
    q = swing(middle, size=0.6)(t)[0]
    joint_motion(Log(t, q=q), arm_)
    with pytest.raises(InputError, match=r"plausible in degrees.*unit = \"deg\""):
        joint_motion(Log(t, q=np.rad2deg(q)), arm_)


def test_many_turns_of_a_joint_without_limits_are_not_degrees() -> None:
    kinova = robot("kinova")
    q = np.zeros((100, 6))
    q[:, 0] = np.linspace(0, 40 * np.pi, 100)
    joint_motion(Log(np.arange(100.0) / 100, q=q), kinova)


def test_a_sliding_joint_in_metres_is_never_degrees(tmp_path: Path) -> None:
    path = tmp_path / "gantry.urdf"
    path.write_text(arm("base", "one", "tip").replace('"revolute"', '"prismatic"', 1))
    gantry = Robot.from_urdf(path, tip_frame="tip")
    q = np.column_stack([np.linspace(0, 30, 50), np.zeros(50)])
    joint_motion(Log(np.arange(50) / 100, q=q), gantry)


def test_invalid_positions_do_not_hide_degrees_nor_feign_them() -> None:
    q = np.full((50, 7), 0.5)
    q[3], q[4, 2], q[5, 2] = np.nan, np.inf, -np.inf
    joint_motion(Log(np.arange(50) / 100, q=q), robot())
    with pytest.raises(InputError, match="degrees"):
        joint_motion(Log(np.arange(50) / 100, q=100 * q), robot())


def test_poses_at_rest_and_derivatives_that_a_log_lacks(swing: Callable[..., Any]) -> None:
    lwr, moves = robot(), swing(np.full(7, 0.2), size=0.2, speed=3.0)
    slow = np.arange(20.0)
    rest = joint_motion(Log(slow, q=moves(slow)[0]), lwr)
    assert not rest.dq.any()
    assert "at rest" in rest.facts["velocities"]
    t = np.arange(2000) / 1000
    q, dq, ddq = moves(t)
    # of noise-free positions the smoother gives derivatives that are off by next to nothing, most at the ends
    for log in (Log(t, q=q), Log(t, q=q, dq=dq), Log(t, q=q, dq=dq, ddq=ddq), Log(t, q=q, ddq=ddq)):
        made = joint_motion(log, lwr)
        np.testing.assert_allclose(made.q, q, atol=1e-8)
        np.testing.assert_allclose(made.dq, dq, atol=1e-5)
        np.testing.assert_allclose(made.ddq, ddq, atol=2e-3)
        assert made.facts["motion"].startswith("smoothed from positions")
    # a differentiator that is asked for leaves what was logged as it is
    given = joint_motion(Log(t, q=q, dq=dq, ddq=ddq), lwr, Differentiator())
    np.testing.assert_array_equal(given.ddq, ddq)
    assert given.facts == {}
    half = joint_motion(Log(t, q=q, dq=dq), lwr, Differentiator())
    np.testing.assert_allclose(half.ddq, ddq, atol=1e-4)
    assert half.facts["bandwidth_hz"] == pytest.approx(25, rel=0.05)


def test_all_shipped_names_load() -> None:
    for name in kinid.urdf.shipped():
        assert robot(name).joint_count > 0


def test_a_urdf_in_millimetres_is_refused(tmp_path: Path) -> None:
    text = (Path(kinid.urdf.__file__).parent / "lwr4plus.urdf").read_text()
    scaled = re.sub(
        r'(<origin xyz=")([^"]*)', lambda m: m[1] + " ".join(f"{1e3 * float(x):g}" for x in m[2].split()), text
    )
    (tmp_path / "arm.urdf").write_text(scaled)
    with pytest.raises(InputError, match="links in metres") as refused:
        Robot.load(tmp_path / "arm.urdf")
    assert "by 1000" in refused.value.mend


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('q = { unit = "m" }', "q in m in .columns., where all joints turn; expected a unit as rad"),
        ('q3 = { unit = "mm" }', "q3 in mm in .columns., where joint_3 turns"),
        ('dq = { unit = "mm/s" }', "expected a unit as rad/s"),
        ('tau = { unit = "N" }', "expected a unit as Nm"),
    ],
)
def test_a_unit_of_a_joint_of_another_kind_is_refused(line: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Robot.load(Rig.parse_text(f'[robot]\nmodel = "lwr4plus"\n[columns]\n{line}'))


def test_units_that_a_robots_joints_have_are_taken() -> None:
    units = 'q = { unit = "deg" }\ntau = { unit = "A", scale = 30 }\ntau2 = { unit = "mN·m" }'
    Robot.load(Rig.parse_text(f'[robot]\nmodel = "lwr4plus"\n[columns]\n{units}'))
