"""The batch kernels against Pinocchio, and against what must hold of any kinematics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinid.urdf
from kinid.kernels import chain as kernel
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

STATES = 10_000
#: both sides round a sum of some hundred products of numbers near 1: 1e-14; 1e-12 leaves room for long chains
AGREE = 1e-12

#: joints that slide (pr2, tiago), without limits (kinova, pr2), a tree (pr2, tiago), 1 to 8 joints in a row
BORROWED = (
    "panda",
    "ur3",
    "ur5",
    "ur10",
    "ur5_gripper",
    "kinova",
    "z1",
    "xarm7",
    "talos_arm",
    "so100",
    "bravo7_no_ee",
    "double_pendulum_continuous",
    "pr2",
    "tiago",
)

SKEWED = """<robot name="skewed">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="0.36 0.48 -0.8"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
    <origin xyz="0.2 0.1 0" rpy="-1 0.3 0.2"/><axis xyz="1 -2 2"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="spin" type="continuous"><parent link="b"/><child link="c"/>
    <origin xyz="0 0.3 0.1" rpy="0 1.2 -0.7"/><axis xyz="-3 1 0.5"/></joint>
  <joint name="lift" type="prismatic"><parent link="c"/><child link="d"/>
    <origin xyz="0.05 0 0.2"/><axis xyz="0 0 -1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="d"/><child link="tip"/>
    <origin xyz="0.03 -0.04 0.12" rpy="0.1 0.2 -2.9"/></joint>
</robot>"""


def states(robot: Robot, seed: int, count: int = STATES) -> tuple[Array, Array, Array]:
    """Random positions over several turns (a joint that slides: ±1 m), velocities, accelerations."""
    rng = np.random.default_rng(seed)
    reach = np.array([1.0 if robot.is_prismatic(name) else 7.0 for name in robot.joint_names])
    q = rng.uniform(-reach, reach, (count, robot.joint_count))
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


def by_pinocchio(model: Any, names: tuple[str, ...], frame: str, q: Array, dq: Array, ddq: Array) -> dict[str, Array]:
    """Motion of a link in base axes, sample by sample; joints that are not named stand still at neutral."""
    data, frame_id = model.createData(), model.getFrameId(frame, pin.FrameType.BODY)
    joints = [(model.joints[model.getJointId(name)], column) for column, name in enumerate(names)]
    c, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    out: dict[str, Array] = {"rotation": np.empty((len(q), 3, 3))}
    for kind in ("velocity", "acceleration"):
        out[kind], out[f"angular_{kind}"] = np.empty((len(q), 3)), np.empty((len(q), 3))
    out["position"], out["spatial"] = np.empty((len(q), 3)), np.empty((len(q), 3))
    for i in range(len(q)):
        for joint, column in joints:
            value = q[i, column]
            at = slice(joint.idx_q, joint.idx_q + joint.nq)
            c[at] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
            v[joint.idx_v], a[joint.idx_v] = dq[i, column], ddq[i, column]
        pin.forwardKinematics(model, data, c, v, a)
        place = pin.updateFramePlacement(model, data, frame_id)
        twist = pin.getFrameVelocity(model, data, frame_id, axes)
        change = pin.getFrameClassicalAcceleration(model, data, frame_id, axes)
        out["rotation"][i], out["position"][i] = place.rotation, place.translation
        out["velocity"][i], out["angular_velocity"][i] = twist.linear, twist.angular
        out["acceleration"][i], out["angular_acceleration"][i] = change.linear, change.angular
        out["spatial"][i] = pin.getFrameAcceleration(model, data, frame_id, axes).linear
    return out


def check(robot: Robot, model: Any, frame: str, seed: int, count: int = STATES) -> None:
    """Every quantity of a frame to `AGREE`, relative to the value where that exceeds 1."""
    q, dq, ddq = states(robot, seed, count)
    expected = by_pinocchio(model, robot.joint_names, frame, q, dq, ddq)
    found = robot.kinematics(frame, q, dq, ddq)
    for name, values in expected.items():
        if name == "spatial":  # Featherstone's: without the turning of the velocity
            have = found.acceleration - np.cross(found.angular_velocity, found.velocity)
        else:
            have = getattr(found, name)
        error = np.abs(have - values) / np.maximum(1.0, np.abs(values))
        assert error.max() <= AGREE, f"{robot.name} {frame} {name}: {error.max():.2e}"


def deepest(model: Any) -> str:
    """The link behind the most joints, and furthest from the last of them."""
    links = [f for f in model.frames if f.type == pin.FrameType.BODY]
    reach = [(len(model.supports[f.parentJoint]), np.linalg.norm(f.placement.translation)) for f in links]
    return str(links[reach.index(max(reach))].name)


@pytest.mark.parametrize("name", kinid.urdf.shipped())
def test_shipped_robots_agree_with_pinocchio_at_sensor_and_tip(name: str) -> None:
    path = kinid.urdf.path(name, Path())
    robot, model = Robot.from_urdf(path), pin.buildModelFromUrdf(str(path))
    assert robot.sensor_frame == "ft_sensor"
    assert robot.tip_frame == "tool_tip"
    check(robot, model, "ft_sensor", seed=1)
    check(robot, model, "tool_tip", seed=2)


@pytest.mark.parametrize("name", BORROWED)
def test_other_robots_agree_with_pinocchio(name: str) -> None:
    path = kinid.urdf.path(name, Path())
    model = pin.buildModelFromUrdf(str(path))
    tip = deepest(model)
    robot = Robot.from_urdf(path, tip_frame=tip)
    check(robot, model, tip, seed=3)
    # a link half way up the chain depends on the first joints alone
    half_way = model.getJointId(robot.joint_names[robot.joint_count // 2])
    middle = next(f.name for f in model.frames if f.parentJoint == half_way and f.type == pin.FrameType.BODY)
    check(robot, model, middle, seed=4, count=1000)


def test_sliding_joints_and_skewed_axes(tmp_path: Path) -> None:
    path = tmp_path / "skewed.urdf"
    path.write_text(SKEWED)
    robot = Robot.from_urdf(path, tip_frame="tip")
    assert [robot.is_prismatic(name) for name in robot.joint_names] == [False, True, False, True]
    check(robot, pin.buildModelFromUrdf(str(path)), "tip", seed=5)


def test_joints_in_the_order_of_the_log() -> None:
    path = kinid.urdf.path("lwr4plus", Path())
    straight = Robot.from_urdf(path)
    order = [3, 0, 6, 2, 5, 1, 4]
    mixed = Robot.from_urdf(path, joints=[straight.joint_names[j] for j in order])
    assert mixed.joint_names == tuple(f"joint_{j + 1}" for j in order)
    check(mixed, pin.buildModelFromUrdf(str(path)), "tool_tip", seed=6, count=1000)
    np.testing.assert_array_equal(mixed.upper, straight.upper[order])


def test_joints_that_the_log_lacks_are_locked() -> None:
    path = kinid.urdf.path("panda", Path())
    model = pin.buildModelFromUrdf(str(path))
    names = tuple(f"panda_joint{j}" for j in (2, 4, 6, 7))
    robot = Robot.from_urdf(path, joints=names, tip_frame="panda_hand_tcp")
    assert robot.model.nv == 4
    check(robot, model, "panda_hand_tcp", seed=7, count=1000)


def test_rates_are_the_differences_of_poses() -> None:
    robot = Robot.from_urdf(kinid.urdf.path("lwr4plus", Path()))
    rng = np.random.default_rng(8)
    size, speed, phase = rng.uniform(0.2, 0.6, 7), rng.uniform(1.0, 3.0, 7), rng.uniform(0, 6, 7)
    t = np.linspace(0.0, 2.0, 200)[:, None]
    h = 1e-5

    def at(time: Array) -> Any:
        angle = speed * time + phase
        return robot.kinematics(
            "tool_tip", size * np.sin(angle), size * speed * np.cos(angle), -size * speed**2 * np.sin(angle)
        )

    before, now, after = at(t - h), at(t), at(t + h)
    # central differences: h² times a third derivative near 100 m/s³ is 1e-8, rounding 1e-16/h is 1e-11
    np.testing.assert_allclose((after.position - before.position) / (2 * h), now.velocity, atol=2e-8)
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * h), now.acceleration, atol=2e-7)
    np.testing.assert_allclose(
        (after.angular_velocity - before.angular_velocity) / (2 * h), now.angular_acceleration, atol=2e-7
    )
    # Ṙ Rᵀ = [ω]×
    turning = np.einsum("nij,nkj->nik", (after.rotation - before.rotation) / (2 * h), now.rotation)
    np.testing.assert_allclose(turning[:, [2, 0, 1], [1, 2, 0]], now.angular_velocity, atol=2e-8)


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e5, 1e5))
def test_sine_and_cosine_far_beyond_one_turn(angle: float) -> None:
    sine, cosine = kernel._sincos(angle)
    # one rounding of the polynomial and one of the reduced argument: 2 ulp of 1
    assert abs(sine - np.sin(angle)) <= 4.5e-16
    assert abs(cosine - np.cos(angle)) <= 4.5e-16


@pytest.mark.parametrize("multiple", range(-9, 10))
def test_sine_and_cosine_at_the_seams_of_the_quadrants(multiple: int) -> None:
    for nudge in (-1e-9, 0.0, 1e-9):
        angle = multiple * np.pi / 4 + nudge
        sine, cosine = kernel._sincos(angle)
        assert abs(sine - np.sin(angle)) <= 4.5e-16
        assert abs(cosine - np.cos(angle)) <= 4.5e-16


@pytest.mark.parametrize("count", [1, 2, 63, 64, 65, 127, 128, 200])
def test_results_do_not_depend_on_the_blocks(count: int) -> None:
    robot = Robot.from_urdf(kinid.urdf.path("lwr4plus", Path()))
    motion = states(robot, 9, 200)
    whole = robot.kinematics("tool_tip", *motion)
    part = robot.kinematics("tool_tip", *(values[:count] for values in motion))
    np.testing.assert_array_equal(part.position, whole.position[:count])
    np.testing.assert_array_equal(part.acceleration, whole.acceleration[:count])


@settings(max_examples=50, deadline=None)
@given(
    row=st.integers(0, 129),
    column=st.integers(0, 6),
    bad=st.sampled_from([np.nan, np.inf, -np.inf]),
    which=st.integers(0, 2),
)
def test_a_bad_sample_leaves_its_neighbours_alone(row: int, column: int, bad: float, which: int) -> None:
    robot = Robot.from_urdf(kinid.urdf.path("lwr4plus", Path()))
    motion = [values.copy() for values in states(robot, 10, 130)]
    clean = robot.kinematics("tool_tip", *motion)
    motion[which][row, column] = bad
    spoilt = robot.kinematics("tool_tip", *motion)
    others = np.arange(130) != row
    np.testing.assert_array_equal(spoilt.position[others], clean.position[others])
    np.testing.assert_array_equal(spoilt.acceleration[others], clean.acceleration[others])
    # whatever the kernel was given, it may not turn it into a number
    if column < 6:  # the last joint's axis goes through the tip: its turning moves no point of the axis
        assert not np.isfinite(spoilt.acceleration[row]).all()


def test_absent_derivatives_are_zero() -> None:
    robot = Robot.from_urdf(kinid.urdf.path("ur5", Path()), tip_frame="tool0")
    q, dq, _ = states(robot, 11, 50)
    assert np.count_nonzero(robot.kinematics("tool0", q).velocity) == 0
    still, none = robot.kinematics("tool0", q, dq, np.zeros_like(q)), robot.kinematics("tool0", q, dq)
    np.testing.assert_array_equal(still.acceleration, none.acceleration)
    assert robot.kinematics("tool0", q[0]).position.shape == (1, 3)
