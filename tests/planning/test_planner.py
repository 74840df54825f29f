"""Plans against what they promise: limits, continuity, an upright tool, no collision; and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import kinid
from kinid import urdf
from kinid.errors import InputError
from kinid.planning import (
    Guard,
    Law,
    Limits,
    Multisine,
    Pace,
    Planner,
    Poke,
    Protocol,
    Slide,
    Trajectory,
    four_paths,
    grid,
)
from kinid.planning.check import breaks, check
from kinid.planning.collision import representatives

Draw = Callable[[int], tuple[Planner, list[Any]]]

#: what a refusal names
NAMED = ("binding limit is the", "position limits", "can't reach", "comes within")
STUDY = Multisine(0.012, ((0.003, 0.9), (0.001, 5.0)))


def within_limits(planner: Planner, motion: Trajectory) -> None:
    """Every sample, by figures taken from the URDF and Pinocchio here, not from the planner."""
    model = pin.buildModelFromUrdf(str(urdf.path("lwr4plus", Path())))
    margin = np.radians(1.0)
    assert (motion.q >= model.lowerPositionLimit + margin).all()
    assert (motion.q <= model.upperPositionLimit - margin).all()
    assert (np.abs(motion.dq) <= model.velocityLimit).all()
    assert np.abs(motion.ddq).max() <= 4.0
    dt = np.diff(motion.t)[:, None]
    assert (np.abs(np.diff(motion.ddq, axis=0)) <= 1000.0 * dt).all()
    # torque with the contact force, every so manieth sample: Pinocchio is slow here
    sensor = model.frames[model.getFrameId("ft_sensor")]
    tool = planner.rig.tool
    assert tool is not None
    model.appendBodyToJoint(
        sensor.parentJoint, pin.Inertia(tool.mass, np.array(tool.com), np.zeros((3, 3))), sensor.placement
    )
    data, tip = model.createData(), model.getFrameId("tool_tip")
    for i in range(0, len(motion), 1 + len(motion) // 50):
        torque = pin.rnea(model, data, motion.q[i], motion.dq[i], motion.ddq[i])
        if motion.force is not None and np.isfinite(motion.force[i]).all():
            jacobian = pin.computeFrameJacobian(model, data, motion.q[i], tip, pin.LOCAL_WORLD_ALIGNED)
            torque -= jacobian[:3].T @ motion.force[i]
        assert (np.abs(torque) <= model.effortLimit).all()


def upright(planner: Planner, motion: Trajectory) -> None:
    rotation = planner.robot.kinematics("tool_tip", motion.q).rotation
    along = rotation[:, :, 2] @ -np.asarray(planner.rig.axes)[2]
    np.testing.assert_allclose(along, 1.0, atol=1e-12)  # of a cosine: 1.4e-6 rad


def test_a_poke_in_five_phases(rig: Any, law: Law) -> None:
    planner = Planner(rig, Protocol(), law)
    motion = planner.plan([Poke(signal=STUDY)])
    assert list(dict.fromkeys(motion.phase.tolist())) == ["free", "approach", "hold", "poke", "retract", "rest"]
    assert motion.place is not None
    assert motion.normal_force is not None
    within_limits(planner, motion)
    upright(planner, motion)
    np.testing.assert_allclose(motion.place[:, :2], 0.0, atol=1e-9)
    rows = motion.phase == "poke"
    start = motion.t[rows][0]
    # the phase begins between two samples; the depth is then what the signal says at the time since
    t0 = np.searchsorted(motion.t, start) / 500.0
    shifts = np.linspace(0, 0.002, 201)
    best = min(np.abs(motion.place[rows, 2] - STUDY(motion.t[rows] - t0 + shift)[0]).max() for shift in shifts)
    assert best < 2e-6
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-9)
    np.testing.assert_allclose(motion.dq[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.normal_force[motion.place[:, 2] < 0], 0.0)
    # the model itself, at the deepest sample
    i = int(np.argmax(motion.place[:, 2]))
    assert motion.normal_force[i] == pytest.approx(1200 * motion.place[i, 2] ** 1.2, rel=0.02)


def test_derivatives_are_those_of_the_joints(rig: Any) -> None:
    motion = Planner(rig, Protocol(rate=2000.0)).plan([Poke(), Slide(((0.0, 0.0), (0.01, 0.01)), speed=0.01)])
    h = 1 / 2000.0
    inner = slice(1, -1)
    jerk = np.abs(np.diff(motion.ddq, axis=0)).max() / h
    dq, ddq = (motion.q[2:] - motion.q[:-2]) / (2 * h), (motion.dq[2:] - motion.dq[:-2]) / (2 * h)
    # central differences are off by at most h²/6 of the next but one derivative, h/2 of a jump in the jerk
    np.testing.assert_allclose(dq, motion.dq[inner], atol=jerk * h**2)
    np.testing.assert_allclose(ddq, motion.ddq[inner], atol=jerk * h)


@pytest.mark.parametrize("seed", range(12))
def test_random_plans_keep_all_limits(seed: int, drawn: Draw) -> None:
    planner, touches = drawn(seed)
    try:
        motion = planner.plan(touches)
    except InputError as error:
        assert any(word in error.found for word in NAMED), error
        return
    _promises(planner, motion)


@pytest.mark.slow
def test_a_thousand_random_plans(drawn: Draw, capsys: pytest.CaptureFixture[str]) -> None:
    refused: dict[str, int] = {}
    done, seed = 0, 0
    while done < 1000:
        planner, touches = drawn(seed)
        seed += 1
        try:
            motion = planner.plan(touches)
        except InputError as error:
            assert any(word in error.found for word in NAMED), error
            refused[error.expected] = refused.get(error.expected, 0) + 1
            assert seed < 1200, refused
            continue
        done += 1
        _promises(planner, motion)
    with capsys.disabled():
        print(f"\n1000 random plans inside all limits; {seed - 1000} other requests refused: {refused}")


def _promises(planner: Planner, motion: Trajectory) -> None:
    within_limits(planner, motion)
    upright(planner, motion)
    assert breaks(motion, planner.limits) <= 1e-9
    assert motion.provenance["joins"] <= 1e-9


def test_most_random_plans_are_feasible(drawn: Draw) -> None:
    done = 0
    for seed in range(12):
        planner, touches = drawn(seed)
        try:
            planner.plan(touches)
            done += 1
        except InputError:
            continue
    assert done >= 8  # else the test above checks nothing


def test_slides_keep_depth_speed_and_path(rig: Any) -> None:
    planner = Planner(rig, Protocol())
    corners = ((0.0, 0.0), (0.02, 0.0), (0.02, 0.015))
    motion = planner.plan([Slide(corners, depth=0.0025, speed=0.005)])
    assert motion.place is not None
    rows = motion.phase == "slide"
    np.testing.assert_allclose(motion.place[rows, 2], 0.0025, atol=1e-8)
    speed = np.linalg.norm(np.diff(motion.place[rows, :2], axis=0), axis=1) * 500.0
    assert speed.max() <= 0.005 * (1 + 1e-6)
    assert np.median(speed) == pytest.approx(0.005, rel=1e-6)
    # on the polyline: along one leg or the other
    x, y = motion.place[rows, 0], motion.place[rows, 1]
    assert np.minimum(np.abs(y), np.abs(x - 0.02)).max() < 1e-8
    one_way = planner.plan([Slide(corners, depth=0.0025, speed=0.005, back=False)])
    assert one_way.place is not None
    assert (one_way.phase == "slide").sum() == pytest.approx(rows.sum() / 2, abs=2)


def test_a_campaign_goes_everywhere_and_comes_back(rig: Any) -> None:
    planner = Planner(rig, Protocol(rate=200.0))
    places = grid(2, 3, 0.02)
    motion = planner.plan([Poke(p, Multisine(0.003, ((0.001, 1.0),), 1.0), 0.1) for p in places])
    assert motion.place is not None
    assert motion.touch is not None
    _promises(planner, motion)
    for k, place in enumerate(places):
        rows = (motion.phase == "poke") & (motion.touch == k)
        np.testing.assert_allclose(motion.place[rows, :2], np.tile(place, (rows.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-8)
    four = planner.plan(four_paths(0.02, speed=0.01))
    assert set(four.touch.tolist()) == {0, 1, 2, 3} if four.touch is not None else False


def test_the_same_request_gives_the_same_plan(rig: Any) -> None:
    one, two = (Planner(rig).plan([Poke((0.01, 0.02))]) for _ in range(2))
    np.testing.assert_array_equal(one.q, two.q)


def test_joints_depend_on_the_pose_alone(rig: Any) -> None:
    """Redundancy resolved by where a cost is least: another way to the same place brings the same joints."""
    planner = Planner(rig, Protocol(rate=200.0))
    short = Multisine(0.003, (), 0.7)
    there = planner.plan([Poke((0.0, 0.0), short), Poke((0.05, 0.05), short)])
    around = planner.plan([Poke((0.0, 0.0), short), Poke((0.05, -0.05), short), Poke((0.05, 0.05), short)])
    assert there.touch is not None
    assert around.touch is not None
    a = there.q[(there.touch == 1) & (there.phase == "hold")][0]
    b = around.q[(around.touch == 2) & (around.phase == "hold")][0]
    np.testing.assert_allclose(a, b, atol=1e-9)


def test_redundancy_is_resolved_where_the_cost_is_least(rig: Any) -> None:
    """Along the self-motion, limits and singularities together grow to both sides of the plan's posture."""
    planner = Planner(rig)
    q = planner.plan([Poke((0.02, 0.1))]).q[0]
    model = planner.robot.model
    data, frame = model.createData(), model.getFrameId("tool_tip")
    middle, half = (
        0.5 * (planner.limits.lower + planner.limits.upper),
        0.5 * (planner.limits.upper - planner.limits.lower),
    )

    def cost(x: Any) -> float:
        jacobian = pin.computeFrameJacobian(model, data, x, frame, pin.LOCAL_WORLD_ALIGNED)
        return float(
            -0.5 * np.log(1 - ((x - middle) / half) ** 2).sum() - 0.25 * np.linalg.slogdet(jacobian @ jacobian.T)[1]
        )

    def along(size: float) -> Any:
        """Follow the null space for so many radians."""
        x, direction = q.copy(), None
        for _ in range(20):
            null = np.linalg.svd(pin.computeFrameJacobian(model, data, x, frame, pin.LOCAL_WORLD_ALIGNED))[2][-1]
            direction = null if direction is None or null @ direction > 0 else -null
            x = x + direction * size / 20
        return x

    here = cost(q)
    assert cost(along(0.1)) > here
    assert cost(along(-0.1)) > here


def test_a_mesh_is_met_along_its_normal(tmp_path: Path) -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.3)
    ball.apply_translation([0.55, 0.0, -0.2])
    ball.export(tmp_path / "ball.stl")
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}, "surface": {"mesh": "ball.stl"}}, folder=tmp_path)
    planner = Planner(rig, Protocol(rate=200.0, height=0.02))
    centre = np.array([0.55, 0.0, -0.2])
    aim = np.array([0.1, 0.15, 0.0]) + [0.0, 0.0, np.sqrt(0.3**2 - 0.1**2 - 0.15**2)]
    motion = planner.plan([Poke(tuple(centre + aim), Multisine(0.003, ((0.001, 1.0),), 1.0), 0.1)])
    pose = planner.robot.kinematics("tool_tip", motion.q)
    out = aim / np.linalg.norm(aim)
    # facets of the ball turn by 3°
    assert (pose.rotation[:, :, 2] @ -out).min() > np.cos(np.radians(3.0))
    rows = motion.phase == "hold"
    depth = 0.3 - np.linalg.norm(motion.tip[rows] - centre, axis=1)
    np.testing.assert_allclose(depth, 0.003, atol=3e-4)  # facets lie below the ball by up to 0.15 mm
    corners = tuple(
        tuple(centre + 0.3 * np.array([x, 0.1, 1.0]) / np.linalg.norm([x, 0.1, 1.0])) for x in (-0.1, 0.0, 0.1)
    )
    slide = planner.plan([Slide(corners, depth=0.002, speed=0.01)])
    rows = slide.phase == "slide"
    depth = 0.3 - np.linalg.norm(slide.tip[rows] - centre, axis=1)
    np.testing.assert_allclose(depth, 0.002, atol=5e-4)
    assert breaks(slide, planner.limits) <= 1e-9


def test_forces_name_the_limit(rig: Any, law: Law) -> None:
    with pytest.raises(InputError, match="binding limit is the force"):
        Planner(rig, Protocol(guard=Guard(1.0)), law).plan([Poke(signal=STUDY)])
    gentle = Planner(rig, Protocol(guard=Guard(12.0)), law).plan([Poke(signal=STUDY)])
    assert gentle.force_limit is not None
    assert (gentle.force_limit[gentle.phase == "poke"] == 12.0).all()


def test_a_guarded_approach_stops_in_time(rig: Any) -> None:
    """From the force limit on, reaction and braking go on for less than a tenth of the limit."""
    stiff = Law(kinid.Model("hooke"), {"stiffness": 20_000.0})
    planner = Planner(rig, Protocol(guard=Guard(20.0, reaction=0.02)), stiff)
    motion = planner.plan([Poke(signal=Multisine(0.0005))])
    assert motion.place is not None
    near = (motion.phase == "approach") & (motion.place[:, 2] > -0.002)
    speed = np.abs(np.diff(motion.place[:, 2])[near[1:]]).max() * 500.0
    overshoot = speed * 0.02 + speed**2 / (2 * Protocol().contact.acceleration)
    assert 20_000.0 * overshoot <= 2.0 * (1 + 1e-6)
    assert speed < 0.5 * Protocol().contact.speed  # the guard did slow it


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"velocity": 0.02}, "velocity"),
        ({"acceleration": 0.05}, "acceleration"),
        ({"jerk": 1.0}, "jerk"),
        ({"torque": 5.0}, "torque"),
    ],
)
def test_infeasible_requests_name_the_binding_limit(change: dict[str, float], word: str, rig: Any, law: Law) -> None:
    limits = Limits.of(kinid.Robot.load(rig))
    limits = limits.replace(**{name: np.full(7, value) for name, value in change.items()})
    with pytest.raises(InputError, match=f"binding limit is the {word} of joint_"):
        Planner(rig, Protocol(), law, limits).plan([Poke(signal=STUDY)])


def test_tilted_pokes(rig: Any) -> None:
    """The tool leans about its tip by what was asked for, turns in the air alone, and the tip goes where it went
    upright.
    """
    planner = Planner(
        rig, Protocol(rate=200.0, collisions=False)
    )  # the sensor's primitive shape would be near the surface
    still = Multisine(0.003, (), 0.6)
    leans = ((0.0, 0.0), (0.2, 0.0), (-0.1, 0.15))
    motion = planner.plan([Poke((0.0, 0.0), still, 0.3, lean) for lean in leans])
    pose = planner.robot.kinematics(planner.robot.tip_frame or "", motion.q)
    assert motion.place is not None
    assert motion.touch is not None
    down, inside = -pose.rotation[:, :, 2], motion.place[:, 2] > 0
    for k, (about_x, about_y) in enumerate(leans):
        rows = inside & (motion.touch == k)
        lean = np.cross(np.array([0.0, 0.0, 1.0]), down[rows])
        angle = np.hypot(about_x, about_y)
        np.testing.assert_allclose(
            lean[:, :2], np.sinc(angle / np.pi) * np.array([[about_x, about_y]] * len(lean)), atol=1e-6
        )
    assert np.abs(motion.place[inside, :2]).max() < 1e-6
    assert motion.place[:, 2].max() == pytest.approx(0.003, abs=1e-6)


def test_set_points_slow_down_where_joints_are_slow(rig: Any) -> None:
    limits = Limits.of(kinid.Robot.load(rig))
    limits = limits.replace(velocity=np.full(7, 0.03), acceleration=np.full(7, 0.2), jerk=np.full(7, 5.0))
    calm = Poke(signal=Multisine(0.003, ((0.0002, 0.5),), 2.0))
    planner = Planner(rig, Protocol(travel=Pace(1.0, 10.0, 100.0)), None, limits)
    motion = planner.plan([calm])
    assert np.abs(motion.dq).max() <= 0.03
    assert np.abs(motion.dq).max() >= 0.025  # and no slower than needed
    assert max(use["share"] for use in motion.provenance["used"] if use["quantity"] != "position") > 0.9


def test_places_out_of_reach_are_refused(rig: Any) -> None:
    with pytest.raises(InputError, match=r"can't reach|position limits"):
        Planner(rig).plan([Poke((0.9, 0.0))])
    with pytest.raises(InputError, match="two numbers"):
        Planner(rig).plan([Poke((0.5, 0.0, 0.1))])
    with pytest.raises(InputError, match="no touch"):
        Planner(rig).plan([])
    free = kinid.Rig.parse({"robot": {"model": "lwr4plus"}})
    with pytest.raises(InputError, match="surface"):
        Planner(free).plan([Poke()])


def test_collisions_are_found() -> None:
    near = kinid.Rig.parse(
        {"robot": {"model": "lwr4plus"}, "surface": {"point": (0.13, 0.0, 0.06), "normal": (0, 0, 1)}}
    )
    with pytest.raises(InputError) as found:
        Planner(near).plan([Poke()])
    assert "within 6 mm" in str(found.value) or "position limits" in str(found.value) or "reach" in str(found.value)
    deep = kinid.Rig.parse(
        {"robot": {"model": "lwr4plus"}, "surface": {"point": (0.55, 0.0, 0.10), "normal": (0, 0, 1)}}
    )
    with pytest.raises(InputError, match=r"comes within 6 mm of surface"):
        # a depth of 13 cm, more than the tool is long
        Planner(deep, Protocol()).plan([Poke(signal=Multisine(0.13, (), 1.0)), Slide(((0.1, 0.0), (0.12, 0.0)))])


def test_representatives_stand_for_all() -> None:
    t = np.linspace(0, 20, 5000)
    q = np.stack([np.sin(t + k) for k in range(7)], axis=1)
    rows = representatives(q, 0.05)
    assert len(rows) < 1500
    distance = np.abs(q[:, None, :] - q[None, rows, :]).sum(axis=2).min(axis=1)
    assert distance.max() <= 0.05


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_other_robots(name: str) -> None:
    """An arm with seven other joints, and one without redundancy."""
    tip = {"panda": "panda_link8", "ur5": "tool0"}[name]
    rig = kinid.Rig.parse(
        {
            "robot": {"model": name, "tip_frame": tip, "sensor_frame": tip},
            "surface": {"point": (0.45, 0.15, 0.1), "normal": (0, 0, 1)},
        }
    )
    planner = Planner(rig, Protocol(rate=200.0, collisions=name == "ur5"))
    motion = planner.plan([Poke(signal=Multisine(0.003, ((0.001, 1.0),), 1.0))])
    assert motion.place is not None
    assert motion.place[:, 2].max() == pytest.approx(0.004, abs=2e-4)
    check(motion, planner.limits)


def test_urdf_accelerations_are_used(tmp_path: Path) -> None:
    text = urdf.path("lwr4plus", Path()).read_text(encoding="utf-8")
    stated = text.replace('effort="176"/>', 'effort="176" acceleration="2.5" jerk="300"/>')
    (tmp_path / "arm.urdf").write_text(stated, encoding="utf-8")
    rig = kinid.Rig.parse({"robot": {"model": "arm.urdf"}}, folder=tmp_path)
    limits = Limits.of(kinid.Robot.load(rig), tmp_path / "arm.urdf")
    np.testing.assert_array_equal(limits.acceleration, [2.5, 2.5, 4, 4, 4, 4, 4])
    np.testing.assert_array_equal(limits.jerk, [300, 300, 1000, 1000, 1000, 1000, 1000])
    assert limits.stated == ("acceleration", "jerk")
