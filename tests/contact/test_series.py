"""Contact-frame quantities against planted truth, physics and symmetry; what is said of samples that can't be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinid.contact import series as contact
from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import CONTACT, Rig, ToolSpec
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

POSE = (0.2, 0.5, -0.1, -1.2, 0.3, 0.9, 0.0)
TOOL = {"mass": 0.3, "com": [0.004, -0.006, 0.049], "inertia": [4e-4, 5e-4, 1e-4, 1e-5, -2e-5, 3e-5]}
#: kinematics and statics are asked for of the motion as it was logged; what the smoother makes of it has tests of its
#: own
AS_LOGGED = Differentiator()
contact_series = partial(contact.contact_series, differentiator=AS_LOGGED)
tip_motion = partial(contact.tip_motion, differentiator=AS_LOGGED)
#: rounding of sums of forces up to some 100 N (m · a with ten times gravity) and of lengths near 1 m
EXACT = 1e-10


def make_rig(folder: Path | None = None, **changes: Any) -> Rig:
    """A skewed plane some 3 cm below the tip's home, a tilted base, a tool with an inertia; or with changes."""
    tables: dict[str, Any] = {
        "robot": {"model": "lwr4plus", "gravity": [1.0, -2.0, -9.4]},
        "tool": TOOL,
        "surface": {"point": [0.6, 0.1, 0.4], "normal": [0.2, -0.1, 1.0], "tangent": [1.0, 0.3, 0.0]},
    }
    for table, values in changes.items():
        tables[table] = {**tables.get(table, {}), **values} if isinstance(values, dict) else values
    return Rig.parse({k: v for k, v in tables.items() if v is not None}, folder=folder or Path())


def sensor_reads(rig: Rig, robot: Robot, load: Array, q: Array, force: Array, moment: Array) -> Array:
    """What a sensor says under the tool's load and a contact force and moment at the tip, base axes, (n, 6)."""
    out = load.copy()
    for i, place in enumerate(places(robot, robot.sensor_frame or "", q)):
        arm = places(robot, robot.tip_frame or "", q[i : i + 1])[0].translation - place.translation
        out[i, :3] += place.rotation.T @ force[i]
        out[i, 3:] += place.rotation.T @ (np.cross(arm, force[i]) + moment[i])
    crosstalk = np.eye(6) if rig.sensor.crosstalk is None else np.array(rig.sensor.crosstalk)
    bias = np.zeros(6) if rig.sensor.bias is None else np.array(rig.sensor.bias)
    return out @ crosstalk.T + bias


def places(robot: Robot, frame: str, q: Array) -> list[Any]:
    data, out = robot.model.createData(), []
    for row in robot.configuration(q):
        pin.framesForwardKinematics(robot.model, data, row)
        out.append(data.oMf[robot.model.getFrameId(frame)].copy())
    return out


def twists(robot: Robot, frame: str, q: Array, dq: Array) -> Array:
    """Velocity and angular velocity of a frame in base axes, (n, 6)."""
    data, out = robot.model.createData(), []
    for row, rate in zip(robot.configuration(q), robot.tangent(dq)):
        pin.forwardKinematics(robot.model, data, row, rate)
        frame_id = robot.model.getFrameId(frame)
        out.append(pin.getFrameVelocity(robot.model, data, frame_id, pin.LOCAL_WORLD_ALIGNED).vector.copy())
    return np.array(out)


def table(touch: ContactSeries) -> Array:
    """All quantities, (9, n)."""
    return np.array([getattr(touch, name) for name in CONTACT])


@pytest.fixture(scope="module")
def poke(swing: Callable[..., Any], weighed: Callable[..., Any]) -> Any:
    """A rig, its robot, a log with exact derivatives, and the contact force and moment that were planted."""
    rig = make_rig()
    robot = Robot.load(rig)
    moves = swing(POSE, seed=3, size=0.25, speed=5.0)
    t = np.arange(600) / 200
    q, dq, ddq = moves(t)
    force = np.column_stack([2 * np.sin(3 * t), np.cos(2 * t), 10 + 5 * np.sin(t)])
    moment = 0.1 * np.column_stack([np.cos(t), np.sin(2 * t), np.sin(3 * t)])
    wrench = sensor_reads(rig, robot, weighed(rig, robot, q, dq, ddq), q, force, moment)
    return rig, robot, Log(t, q=q, dq=dq, ddq=ddq, wrench=wrench), force, moment, moves


@pytest.mark.parametrize("seed", range(6))
def test_what_was_planted_comes_back(seed: int, swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    """Random tools, planes, gravity, bias, cross-talk, joint orders: depth, slip, their rates, forces and moments."""
    rng = np.random.default_rng(seed)
    order = [f"joint_{j + 1}" for j in (rng.permutation(7) if seed else range(7))]
    normal, tangent = rng.normal(size=(2, 3))
    half = rng.normal(size=(3, 3)) * 0.02
    inertia = np.trace(half @ half.T) * np.eye(3) - half @ half.T
    rig = make_rig(
        robot={"gravity": rng.normal(size=3) * 8, "joints": order},
        tool={
            "mass": rng.uniform(0.1, 2),
            "com": rng.normal(size=3) * 0.05,
            "inertia": [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]],
        },
        surface={"point": rng.normal(size=3), "normal": normal * 3, "tangent": tangent},
        sensor={"bias": rng.normal(size=6) * 4, "crosstalk": (np.eye(6) + 0.05 * rng.normal(size=(6, 6))).tolist()},
    )
    robot = Robot.load(rig)
    t = np.arange(150) / 100
    q, dq, ddq = swing(POSE, seed=seed, size=1.0, speed=6.0)(t)
    force, moment = rng.normal(size=(len(t), 3)) * 20, rng.normal(size=(len(t), 3))
    wrench = sensor_reads(rig, robot, weighed(rig, robot, q, dq, ddq), q, force, moment)
    touch = contact_series(Log(t, q=q, dq=dq, ddq=ddq, wrench=wrench), rig, moments=True, trust_wrench=True)

    n = normal / np.linalg.norm(normal)
    t1 = tangent - (tangent @ n) * n
    t1 /= np.linalg.norm(t1)
    t2 = np.cross(n, t1)
    tip = np.array([place.translation for place in places(robot, "tool_tip", q)]) - np.array(rig.surface.point)
    rate = twists(robot, "tool_tip", q, dq)[:, :3]
    expected = {
        "depth": -tip @ n,
        "slip1": tip @ t1,
        "slip2": tip @ t2,
        "depth_rate": -rate @ n,
        "slip_rate1": rate @ t1,
        "slip_rate2": rate @ t2,
        "normal_force": force @ n,
        "tangential_force1": force @ t1,
        "tangential_force2": force @ t2,
    }
    for name in CONTACT:
        np.testing.assert_allclose(getattr(touch, name), expected[name], rtol=0, atol=EXACT, err_msg=name)
    np.testing.assert_allclose(touch.moment, np.array([t1, t2, n]) @ moment.T, rtol=0, atol=EXACT)
    assert touch.valid.all()


def test_rates_are_the_differences_of_depth_and_slip(poke: Any) -> None:
    rig, robot, log, *_, moves = poke
    h = 1e-5

    def at(t: Array) -> ContactSeries:
        q, dq, ddq = moves(t)
        return contact_series(Log(t, q=q, dq=dq, ddq=ddq), rig, robot=robot)

    now, before, after = at(log.t), at(log.t - h), at(log.t + h)
    for name in ("depth", "slip"):
        for axis in ("",) if name == "depth" else ("1", "2"):
            change = (getattr(after, name + axis) - getattr(before, name + axis)) / (2 * h)
            # h² times a third derivative near 30 m/s³, and 1e-16 / h
            np.testing.assert_allclose(getattr(now, f"{name}_rate{axis}"), change, atol=2e-9)


def test_power_at_the_contact_is_power_at_the_joints(poke: Any) -> None:
    """f · v at the tip, τ · q̇ through the Jacobian, and from contact quantities alone."""
    rig, robot, log, force, moment, _ = poke
    touch = contact_series(log, rig, moments=True, trust_wrench=True)
    turning = np.array(rig.axes) @ twists(robot, "tool_tip", log.q, log.dq)[:, 3:].T
    contact = (
        -touch.normal_force * touch.depth_rate
        + touch.tangential_force1 * touch.slip_rate1
        + touch.tangential_force2 * touch.slip_rate2
        + np.sum(touch.moment * turning, axis=0)
    )
    data, joints = robot.model.createData(), np.empty(len(log))
    for i, row in enumerate(robot.configuration(log.q)):
        jacobian = pin.computeFrameJacobian(
            robot.model, data, row, robot.model.getFrameId("tool_tip"), pin.LOCAL_WORLD_ALIGNED
        )
        joints[i] = np.concatenate([force[i], moment[i]]) @ jacobian @ log.dq[i]
    assert np.abs(joints).max() > 1
    np.testing.assert_allclose(contact, joints, atol=EXACT)


def test_power_through_the_sensor_moves_the_tool_and_works_at_the_contact(poke: Any) -> None:
    """For any wrench: load · twist of the sensor + d/dt (kinetic + potential energy of the tool) = contact power."""
    rig, robot, log, *_, moves = poke
    wrench = np.random.default_rng(4).normal(size=(len(log), 6)) * [5, 5, 5, 0.3, 0.3, 0.3]
    touch = contact_series(log.replace(wrench=wrench), rig, moments=True, trust_wrench=True, bias="none")

    def energy(t: Array) -> Array:
        q, dq, _ = moves(t)
        tool, out = rig.tool, np.empty(len(t))
        for i, (place, twist) in enumerate(zip(places(robot, "ft_sensor", q), twists(robot, "ft_sensor", q, dq))):
            arm = place.rotation @ tool.com
            v, w = twist[:3] + np.cross(twist[3:], arm), place.rotation.T @ twist[3:]
            kinetic = 0.5 * tool.mass * v @ v + 0.5 * w @ tool.inertia_matrix @ w
            out[i] = kinetic - tool.mass * robot.gravity @ (place.translation + arm)
        return out

    h = 1e-5
    gain = (energy(log.t + h) - energy(log.t - h)) / (2 * h)
    given_ = np.empty(len(log))
    sensor = twists(robot, "ft_sensor", log.q, log.dq)
    for i, place in enumerate(places(robot, "ft_sensor", log.q)):
        given_[i] = (place.rotation @ wrench[i, :3]) @ sensor[i, :3] + (place.rotation @ wrench[i, 3:]) @ sensor[i, 3:]
    turning = np.array(rig.axes) @ twists(robot, "tool_tip", log.q, log.dq)[:, 3:].T
    contact = (
        -touch.normal_force * touch.depth_rate
        + touch.tangential_force1 * touch.slip_rate1
        + touch.tangential_force2 * touch.slip_rate2
        + np.sum(touch.moment * turning, axis=0)
    )
    assert np.abs(gain).max() > 1
    # central differences: h² · 1e3 W/s² and 1e-15 J / h
    np.testing.assert_allclose(contact, given_ + gain, atol=2e-7)


# Symmetry


def rotations() -> st.SearchStrategy[Array]:
    numbers = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)
    return numbers.map(lambda q: Rotation.from_quat(q).as_matrix())


@settings(max_examples=30, deadline=None)
@given(turn=rotations(), shift=st.tuples(*[st.floats(-3, 3)] * 3))
def test_turning_base_gravity_and_surface_together_changes_nothing(
    poke: Any, turn: Array, shift: tuple[float, float, float]
) -> None:
    rig, _, log, *_ = poke
    rig = make_rig(robot={"compliance": [[2e-4, 1e-5, 0], [1e-5, 1e-4, 0], [0, 0, 3e-4]]})
    robot = Robot.load(rig)
    model = robot.model.copy()
    model.jointPlacements[1] = pin.SE3(turn, np.array(shift)) * model.jointPlacements[1]
    moved = replace(robot, model=model, gravity=turn @ robot.gravity, compliance=turn @ robot.compliance @ turn.T)
    there = rig.surface
    moved_rig = make_rig(
        surface={
            "point": turn @ there.point + shift,
            "normal": turn @ there.normal,
            "tangent": turn @ there.tangent,
        }
    )
    here = contact_series(log, rig, robot=robot, bias="none", trust_wrench=True, moments=True)
    elsewhere = contact_series(log, moved_rig, robot=moved, bias="none", trust_wrench=True, moments=True)
    np.testing.assert_allclose(table(elsewhere), table(here), rtol=0, atol=EXACT)
    np.testing.assert_allclose(elsewhere.moment, here.moment, rtol=0, atol=EXACT)


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(-7, 7), length=st.floats(0.01, 100), slant=st.floats(-2, 2))
def test_turning_the_tangent_turns_what_is_tangential(poke: Any, angle: float, length: float, slant: float) -> None:
    """Lengths of normal and tangent, and a tangent's part along the normal, say nothing."""
    rig, robot, log, *_ = poke
    t1, t2, n = np.array(rig.axes)
    tangent = length * (np.cos(angle) * t1 + np.sin(angle) * t2 + slant * n)
    turned = make_rig(surface={"normal": n * length, "tangent": tangent})
    here = contact_series(log, rig, robot=robot, trust_wrench=True)
    there = contact_series(log, turned, robot=robot, trust_wrench=True)
    for one, two in (
        ("slip1", "slip2"),
        ("slip_rate1", "slip_rate2"),
        ("tangential_force1", "tangential_force2"),
    ):
        a, b = getattr(here, one), getattr(here, two)
        np.testing.assert_allclose(getattr(there, one), np.cos(angle) * a + np.sin(angle) * b, atol=EXACT)
        np.testing.assert_allclose(getattr(there, two), np.cos(angle) * b - np.sin(angle) * a, atol=EXACT)
    for name in ("depth", "depth_rate", "normal_force"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), atol=EXACT)


@settings(max_examples=20, deadline=None)
@given(along=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)))
def test_moving_the_surface_point_moves_slip_and_depth_alone(poke: Any, along: tuple[float, float, float]) -> None:
    rig, robot, log, *_ = poke
    point = np.array(rig.surface.point) + np.array(along) @ rig.axes
    here = contact_series(log, rig, robot=robot, trust_wrench=True, bias="none")
    there = contact_series(log, make_rig(surface={"point": point}), robot=robot, trust_wrench=True, bias="none")
    move = np.zeros((9, 1))
    for name, by in zip(("slip1", "slip2", "depth"), (-along[0], -along[1], along[2])):
        move[CONTACT.index(name)] = by
    np.testing.assert_allclose(table(there) - table(here), np.tile(move, len(log)), atol=EXACT)


def test_joint_order_of_the_log_does_not_matter(poke: Any) -> None:
    rig, robot, log, *_ = poke
    order = [5, 0, 3, 6, 1, 2, 4]
    mixed = make_rig(robot={"joints": [robot.joint_names[j] for j in order]})
    shuffled = log.replace(q=log.q[:, order], dq=log.dq[:, order], ddq=log.ddq[:, order])
    here, there = (contact_series(x, r, trust_wrench=True) for x, r in ((log, rig), (shuffled, mixed)))
    np.testing.assert_allclose(table(there), table(here), atol=EXACT)


# The sensor


def free_then_pressed(
    swing: Callable[..., Any], weighed: Callable[..., Any], rig: Rig, phase: bool
) -> tuple[Log, Array, Rig]:
    """A log whose second half is lower and has a contact force, that force (n, 3), and the rig with a surface
    between.
    """
    robot = Robot.load(rig)
    t = np.arange(800) / 400
    up = swing(np.add(POSE, [0, -0.5, 0, 0, 0, 0, 0]), size=0.3)(t[:400])
    down = swing(POSE, size=0.3)(t[400:])
    q, dq, ddq = (np.concatenate(pair) for pair in zip(up, down))
    force = np.column_stack([np.sin(9 * t), 2 * np.cos(7 * t), 8 + np.sin(5 * t)])
    force[:400] = 0.0
    wrench = sensor_reads(rig, robot, weighed(rig, robot, q, dq, ddq), q, force, np.zeros_like(force))
    names = np.where(t < 1.0, "free", "poke") if phase else None
    tip = np.array([place.translation for place in places(robot, "tool_tip", q)])
    height = tip @ np.array(rig.axes)[2]
    # through the highest point of the pressed half: only in the first half is the tip ever clear of it
    top = tip[400 + int(np.argmax(height[400:]))]
    tables = rig.model_dump(exclude_none=True)
    tables["surface"]["point"] = top
    return Log(t, q=q, dq=dq, ddq=ddq, wrench=wrench, phase=names), force, Rig.parse(tables)


@pytest.mark.parametrize("phase", [True, False])
def test_bias_learned_from_free_motion(phase: bool, swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    """Free by label, or because the tip is clear of the surface."""
    bias = [3.0, -2.0, 5.0, 0.1, -0.2, 0.05]
    truth = make_rig(sensor={"bias": bias, "crosstalk": (np.eye(6) + 0.02 * np.ones((6, 6))).tolist()})
    stated = make_rig(sensor={"crosstalk": truth.sensor.crosstalk})
    log, force, truth = free_then_pressed(swing, weighed, truth, phase)
    stated = make_rig(sensor={"crosstalk": truth.sensor.crosstalk}, surface={"point": truth.surface.point})
    touch = contact_series(log, stated)
    facts = next(step.facts for step in touch.provenance.steps if step.name == "wrench")
    assert facts["bias_from"] == "median of free motion"
    np.testing.assert_allclose(facts["bias"], bias, atol=1e-10)
    np.testing.assert_allclose(touch.normal_force, force @ np.array(truth.axes)[2], atol=1e-9)
    raw = contact_series(log, stated, bias="none")
    assert np.abs(raw.normal_force - touch.normal_force).max() > 1


def test_a_com_that_nobody_stated_is_said(poke: Any) -> None:
    rig, _, log, *_ = poke
    said = [
        next(
            step.facts["tool"]
            for step in contact_series(log, one, trust_wrench=True).provenance.steps
            if step.name == "wrench"
        )
        for one in (rig, rig.model_copy(update={"tool": ToolSpec(mass=0.3)}))
    ]
    assert said == ["removed", "removed, its com taken for the sensor's origin ([tool] states none)"]


def test_a_wrench_in_base_axes(poke: Any) -> None:
    rig, robot, log, *_ = poke
    turn = np.array([place.rotation for place in places(robot, "ft_sensor", log.q)])
    base = np.einsum("nij,nkj->nki", turn, log.wrench.reshape(-1, 2, 3)).reshape(-1, 6)
    here = contact_series(log, rig, trust_wrench=True, bias="none")
    there = contact_series(
        log.replace(wrench=base), make_rig(sensor={"wrench_frame": "base"}), trust_wrench=True, bias="none"
    )
    np.testing.assert_allclose(table(there), table(here), atol=EXACT)


def test_a_wrong_sign_is_refused_in_a_whole_log(swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    log, _, rig = free_then_pressed(swing, weighed, make_rig(), phase=True)
    contact_series(log, rig)
    with pytest.raises(InputError, match="with the opposite sign"):
        contact_series(log.replace(wrench=-log.wrench), rig)
    flipped = contact_series(log.replace(wrench=-log.wrench), rig, trust_wrench=True)
    assert len(flipped) == len(log)


def test_a_log_without_a_wrench_has_motion_and_no_forces(poke: Any) -> None:
    rig, _, log, *_ = poke
    with_, without = (
        contact_series(log, rig, trust_wrench=True),
        contact_series(log.replace(wrench=None), rig),
    )
    assert np.isnan(table(without)[[CONTACT.index(c) for c in CONTACT if "force" in c]]).all()
    for name in ("depth", "depth_rate", "slip1", "slip_rate2"):
        np.testing.assert_allclose(getattr(without, name), getattr(with_, name), atol=EXACT)
    assert without.valid.all()
    np.testing.assert_array_equal(without.in_contact, without.depth > 0)


# Compliance


def bending(poke: Any, weighed: Callable[..., Any], rig: Rig) -> tuple[Log, Array, Array]:
    """A log of an arm that bends by C f: joints as measured before the bending, tip and its velocity behind it."""
    _, robot, _, _, _, moves = poke
    t = np.arange(1500) / 1000
    q, dq, ddq = moves(t)
    force = np.column_stack([2 * np.sin(3 * t), np.cos(2 * t), 10 + 5 * np.sin(t)])
    change = np.column_stack([6 * np.cos(3 * t), -2 * np.sin(2 * t), 5 * np.cos(t)])
    bends = np.array(rig.robot.compliance)
    tip = np.array([place.translation for place in places(robot, "tool_tip", q)]) + force @ bends.T
    rate = twists(robot, "tool_tip", q, dq)[:, :3] + change @ bends.T
    wrench = sensor_reads(rig, robot, weighed(rig, robot, q, dq, ddq), q, force, np.zeros_like(force))
    return Log(t, q=q, dq=dq, ddq=ddq, wrench=wrench), tip, rate


@pytest.mark.parametrize("kind", ["plane", "mesh"])
def test_an_arm_that_bends(kind: str, poke: Any, weighed: Callable[..., Any], tmp_path: Path) -> None:
    """A full compliance matrix [m/N]: depth and slip to rounding, their rates as well as the force's rate is known."""
    compliance = {"compliance": [[4e-4, 1e-4, -5e-5], [1e-4, 3e-4, 2e-5], [-5e-5, 2e-5, 2e-4]]}
    rig = make_rig(robot=compliance)
    log, tip, rate = bending(poke, weighed, rig)
    t1, t2, n = np.array(rig.axes)
    used = rig
    if kind == "mesh":
        used = quad(rig, tmp_path, robot=compliance)
    touch = contact_series(log, used, trust_wrench=True, bias="none")
    from_point = tip - np.array(rig.surface.point)
    # the quad's STL holds single precision numbers near 5 m
    rough = EXACT if kind == "plane" else 1e-6
    np.testing.assert_allclose(touch.depth, -from_point @ n, atol=rough)
    slip = touch.slip1 - touch.slip1[0] + (from_point @ t1)[0]
    np.testing.assert_allclose(slip, from_point @ t1, atol=rough)
    # forces of at most 3 rad/s through 25 Hz of bandwidth: 5e-5 of 6 N/s · 4e-4 m/N, ten times that at the ends
    np.testing.assert_allclose(touch.depth_rate, -rate @ n, atol=max(rough, 2e-6))
    np.testing.assert_allclose(touch.slip_rate1, rate @ t1, atol=max(rough, 2e-6))
    np.testing.assert_allclose(touch.slip_rate2, rate @ t2, atol=max(rough, 2e-6))
    rigid = contact_series(log, make_rig(), trust_wrench=True, bias="none")
    assert np.abs(rigid.depth + from_point @ n).max() > 1e-3
    assert np.abs(rigid.depth_rate + rate @ n).max() > 5e-4


# A mesh


def quad(rig: Rig, folder: Path, **changes: Any) -> Rig:
    """The same plane as a square of two triangles, 10 m wide, in an STL file."""
    import trimesh

    t1, t2, n = np.array(rig.axes)
    corners = np.array(rig.surface.point) + 5 * np.array([-t1 - t2, t1 - t2, t1 + t2, -t1 + t2])
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).export(folder / "quad.stl")
    changes["surface"] = None
    made = make_rig(folder, **changes).model_dump(exclude_none=True)
    return Rig.parse({**made, "surface": {"mesh": "quad.stl", "tangent": list(t1)}}, folder=folder)


def test_a_flat_mesh_is_a_plane(poke: Any, tmp_path: Path) -> None:
    """With slip from the first sample of the log."""
    rig, _, log, *_ = poke
    plane = contact_series(log, rig, trust_wrench=True, bias="none", moments=True)
    mesh = contact_series(log, quad(rig, tmp_path), trust_wrench=True, bias="none", moments=True)
    # single precision of the STL file: 5 m · 6e-8 in position, 6e-8 in direction of forces near 20 N
    for name in CONTACT:
        start = plane.slip1[0] if name == "slip1" else plane.slip2[0] if name == "slip2" else 0.0
        np.testing.assert_allclose(getattr(mesh, name), getattr(plane, name) - start, atol=3e-6, err_msg=name)
    np.testing.assert_allclose(mesh.moment, plane.moment, atol=1e-6)
    np.testing.assert_array_equal(mesh.in_contact, plane.in_contact)


def test_slip_on_a_mesh_survives_an_invalid_sample_and_a_gap(poke: Any, tmp_path: Path) -> None:
    rig, _, log, *_ = poke
    dq = log.dq.copy()
    dq[100, 2] = np.nan
    t = log.t + np.where(np.arange(len(log)) >= 300, 2.0, 0.0)
    spoilt = Log(t, q=log.q, dq=dq, ddq=log.ddq, wrench=log.wrench)
    plane = contact_series(log, rig, trust_wrench=True, bias="none")
    mesh = contact_series(spoilt, quad(rig, tmp_path), trust_wrench=True, bias="none")
    assert not mesh.valid[100]
    assert mesh.valid.sum() == len(log) - 1
    np.testing.assert_allclose(mesh.slip1[mesh.valid], (plane.slip1 - plane.slip1[0])[mesh.valid], atol=3e-6)


# Samples that can't be used


@settings(max_examples=60, deadline=None)
@given(
    rows=st.sets(st.integers(0, 599), min_size=1, max_size=5),
    channel=st.sampled_from(["q", "dq", "ddq", "wrench"]),
    column=st.integers(0, 5),
    bad=st.sampled_from([np.nan, np.inf, -np.inf]),
)
def test_invalid_samples_are_marked_counted_and_kept_apart(
    poke: Any, rows: set[int], channel: str, column: int, bad: float
) -> None:
    rig, robot, log, *_ = poke
    values = getattr(log, channel).copy()
    values[list(rows), column] = bad
    clean = contact_series(log, rig, robot=robot, trust_wrench=True, bias="none")
    touch = contact_series(log.replace(**{channel: values}), rig, robot=robot, trust_wrench=True, bias="none")
    hit = np.isin(np.arange(600), list(rows))
    np.testing.assert_array_equal(touch.valid, ~hit)
    assert np.isnan(table(touch)[:, hit]).all()
    np.testing.assert_array_equal(table(touch)[:, ~hit], table(clean)[:, ~hit])
    assert not touch.in_contact[hit].any()
    facts = next(step.facts for step in touch.provenance.steps if step.name == "contact frame")
    assert facts["invalid_samples"] == len(rows)


def test_opposite_infinities_in_one_sample(poke: Any) -> None:
    rig, _, log, *_ = poke
    q = log.q.copy()
    q[7, 1], q[7, 2] = np.inf, -np.inf
    touch = contact_series(log.replace(q=q), rig, trust_wrench=True, bias="none")
    assert not touch.valid[7]
    assert touch.valid.sum() == 599


@pytest.mark.parametrize("missing", ["velocities", "accelerations", "compliance"])
def test_invalid_samples_do_not_spread_through_the_differentiator(poke: Any, missing: str) -> None:
    """Neighbours are fitted without the sample: next to what they are with it."""
    rig, _, log, *_ = poke
    log = Log(log.t, q=log.q, dq=log.dq, ddq=log.ddq, wrench=log.wrench)
    spoilt, row = "q", 250
    if missing == "velocities":
        log = log.replace(dq=None, ddq=None)
    elif missing == "accelerations":
        log, spoilt = log.replace(ddq=None), "dq"
    else:
        rig, spoilt = make_rig(robot={"compliance": (2e-4 * np.eye(3)).tolist()}), "wrench"
    values = getattr(log, spoilt).copy()
    values[row, 3] = np.nan
    clean = contact_series(log, rig, trust_wrench=True, bias="none")
    touch = contact_series(log.replace(**{spoilt: values}), rig, trust_wrench=True, bias="none")
    assert list(np.flatnonzero(~touch.valid)) == [row]
    others = touch.valid
    # a fit over the other samples of its window differs by what the bandwidth cuts off anyway: 1e-3 of 10 m/s²
    np.testing.assert_allclose(table(touch)[:, others], table(clean)[:, others], atol=0.01)


def test_a_log_of_invalid_samples_alone_is_refused(poke: Any) -> None:
    rig, _, log, *_ = poke
    with pytest.raises(InputError, match="not one sample"):
        contact_series(log.replace(wrench=np.full_like(log.wrench, np.nan)), rig)


def test_a_gap_is_not_bridged(swing: Callable[..., Any]) -> None:
    """Positions alone, with two seconds missing: velocities on both sides are their own."""
    rig, moves = make_rig(), swing(POSE, size=0.25)
    t = np.concatenate([np.arange(400), 2400 + np.arange(400)]) / 1000
    q, dq, ddq = moves(t)
    truth = contact_series(Log(t, q=q, dq=dq, ddq=ddq), rig)
    touch = contact_series(Log(t, q=q), rig)
    facts = next(step.facts for step in touch.provenance.steps if step.name == "contact frame")
    assert facts["gaps"] == 1
    assert touch.valid.all()
    # speeds up to 1 m/s, accelerations some 3 m/s²; a slope across the gap would be off by 0.1 m/s and more
    np.testing.assert_allclose(touch.depth_rate, truth.depth_rate, atol=1e-4)


def test_positions_alone_give_rates_and_forces(poke: Any) -> None:
    rig, _, log, force, *_ = poke
    touch = contact_series(log.replace(dq=None, ddq=None), rig, trust_wrench=True, bias="none")
    truth = contact_series(log, rig, trust_wrench=True, bias="none")
    steps = [step for step in touch.provenance.steps if step.name == "differentiate"]
    assert steps
    assert steps[0].facts["bandwidth_hz"] > 25
    inner = slice(20, -20)
    # 5 rad/s at 0.25 rad: the velocity is good to 1e-4, the acceleration to 1e-2 m/s², times 0.3 kg
    np.testing.assert_allclose(touch.depth_rate[inner], truth.depth_rate[inner], atol=1e-4)
    np.testing.assert_allclose(touch.normal_force[inner], force[inner] @ np.array(rig.axes)[2], atol=0.01)


def test_poses_at_rest(poke: Any, weighed: Callable[..., Any]) -> None:
    """A row every few seconds, without velocities: the arm stood still."""
    rig, robot, log, force, moment, _ = poke
    t = 5.0 * np.arange(60)
    q, still = log.q[::10], np.zeros((60, 7))
    wrench = sensor_reads(rig, robot, weighed(rig, robot, q, still, still), q, force[::10], moment[::10])
    touch = contact_series(Log(t, q=q, wrench=wrench), rig, trust_wrench=True, bias="none")
    np.testing.assert_allclose(touch.normal_force, force[::10] @ np.array(rig.axes)[2], atol=EXACT)
    assert not touch.depth_rate.any()


def test_the_flag_of_poses_at_rest_looks_at_each_alone(poke: Any) -> None:
    """Poses one after the other have nothing in common: pressed, air, pressed, air."""
    _, robot, log, *_ = poke
    q = np.tile(np.array([POSE, np.add(POSE, [0, -0.5, 0, 0, 0, 0, 0])]), (30, 1))
    tip = places(robot, "tool_tip", q[:1])[0].translation
    rig = make_rig(surface={"point": tip + [0, 0, 1e-3], "normal": [0, 0, 1]}, tool={"mass": 0.0})
    wrench = np.random.default_rng(9).normal(size=(60, 6)) * 0.02
    turn = places(robot, "ft_sensor", q[:1])[0].rotation
    wrench[::2, :3] += turn.T @ [0, 0, 5.0]
    touch = contact_series(Log(np.arange(60.0), q=q, wrench=wrench), rig)
    np.testing.assert_array_equal(touch.in_contact, np.arange(60) % 2 == 0)


def test_one_sample_alone(poke: Any) -> None:
    rig, _, log, *_ = poke
    one = Log(log.t[:1], q=log.q[:1], wrench=log.wrench[:1])
    touch = contact_series(one, rig, bias="none")
    assert len(touch) == 1
    assert touch.valid.all()


# Without a surface, and what is missing


def test_tip_motion_without_a_surface(poke: Any) -> None:
    rig, robot, log, force, *_ = poke
    bare = make_rig(surface=None)
    found = tip_motion(log, bare, trust_wrench=True, bias="none")
    tip = np.array([place.translation for place in places(robot, "tool_tip", log.q)])
    np.testing.assert_allclose(found.position, tip, atol=EXACT)
    np.testing.assert_allclose(found.velocity, twists(robot, "tool_tip", log.q, log.dq)[:, :3], atol=EXACT)
    np.testing.assert_allclose(found.force, force, atol=EXACT)
    columns = found.columns()
    assert list(columns) == [
        "t",
        "tip_x",
        "tip_y",
        "tip_z",
        "tip_vx",
        "tip_vy",
        "tip_vz",
        "force_x",
        "force_y",
        "force_z",
    ]
    assert tip_motion(log.replace(wrench=None), bare).force is None
    with pytest.raises(InputError, match=r"a rig without \[surface\]"):
        contact_series(log, bare)


def test_what_is_missing_is_said(poke: Any) -> None:
    _, _, log, *_ = poke
    six = log.replace(q=log.q[:, :6], dq=None, ddq=None, wrench=None)
    no_tip = Rig.parse({"robot": {"model": "ur5"}, "surface": {"point": [0, 0, 0], "normal": [0, 0, 1]}})
    with pytest.raises(InputError, match="without a tip frame") as caught:
        contact_series(six, no_tip)
    assert "tip_frame" in str(caught.value)
    with pytest.raises(InputError, match=r"without \[robot\]"):
        contact_series(log, Rig.parse({"surface": {"point": [0, 0, 0], "normal": [0, 0, 1]}}))
    with pytest.raises(InputError, match="6 joints"):
        contact_series(six, make_rig())


def test_a_series_is_read_only_and_writes_its_columns(poke: Any) -> None:
    rig, _, log, *_ = poke
    phase = np.where(log.t < 1, "free", "poke")
    touch = contact_series(log.replace(phase=phase), rig, trust_wrench=True)
    for name in ("t", *CONTACT, "in_contact", "valid"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(touch, name)[0] = 0
    assert list(touch.columns()) == ["t", *CONTACT, "in_contact", "phase"]
    assert len(touch) == 600
    with pytest.raises(InputError, match="depth of shape"):
        replace(touch, depth=touch.depth[:5])
