"""The second world against closed forms, conservation of energy, and MuJoCo where it computes for itself."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hidden.cases import KINDS, WORLDS, case, cases
from hidden.world import arm
from hidden.world.arm import Body, dynamics, forward, inverse, scene
from hidden.world.drives import JOINTS, SCALE, SPEEDS, Drives, excite, torques
from hidden.world.material import DEEPEST, Matter, elastic_table, press
from hidden.world.path import FINE, Script
from hidden.world.protocol import Protocol
from hidden.world.rubbing import Rub, brush, rub
from hidden.world.sensing import Chain, colour, read
from hidden.world.wrist import TIP, swing_of

Array = NDArray[np.float64]

HOME = np.deg2rad([20.0, 35.0, -10.0, -85.0, 15.0, 60.0, 30.0])
TOOL = Body(0.31, (4e-3, -6e-3, 0.05), (3e-4, 2.5e-4, 1e-4, 2e-5, -1e-5, 3e-5))


def poke(*depths: float, seconds: float = 0.5, stay: float = 0.0) -> tuple[Array, Array]:
    """Time and depth of pokes to these depths, each from outside and back."""
    script = Script(("z",), np.random.default_rng(0), z=-1e-3)
    for depth in depths:
        script.move("poke", seconds, z=depth)
        script.rest("hold", max(stay, 1e-3))
        script.move("poke", seconds, z=-1e-3)
    path = script.path()
    return path.t, path.x[:, 0]


def pressed(m: Matter, t: Array, depth: Array) -> Array:
    """Normal force at one place."""
    here = np.zeros_like(t)
    return press(m, t, depth, here, here)[0]


# ---------------------------------------------------------------------------------------------------------------- arm


def test_kinematics_are_those_of_mujoco() -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (20, 7))
    pose = forward(q)
    model = scene(())
    data = mujoco.MjData(model)
    jacobian = np.empty((6, 7))
    for i in range(len(q)):
        data.qpos[:] = q[i]
        mujoco.mj_forward(model, data)
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], model.body("tool_tip").id)
        np.testing.assert_allclose(pose.position[i], data.body("tool_tip").xpos, atol=1e-12)
        np.testing.assert_allclose(pose.rotation[i].ravel(), data.body("tool_tip").xmat, atol=1e-12)
        np.testing.assert_allclose(pose.jacobian[i], jacobian, atol=1e-12)


def test_inverse_kinematics_reach_what_is_asked_for() -> None:
    rng = np.random.default_rng(2)
    wanted = forward(HOME + rng.uniform(-0.15, 0.15, (50, 7)))
    found = forward(inverse(HOME, wanted.position, wanted.rotation))
    np.testing.assert_allclose(found.position, wanted.position, atol=1e-9)
    np.testing.assert_allclose(found.rotation, wanted.rotation, atol=1e-9)
    with pytest.raises(ValueError, match="out of reach"):
        inverse(HOME, wanted.position + [3.0, 0, 0], wanted.rotation)


def test_a_resting_tool_reads_its_weight() -> None:
    q, still = HOME[None], np.zeros((1, 7))
    wrench, _ = dynamics((TOOL,), q, still, still)
    weight = TOOL.mass * forward(q).rotation[0].T @ [0, 0, -arm.GRAVITY]
    np.testing.assert_allclose(wrench[0], np.concatenate([weight, np.cross(TOOL.com, weight)]), atol=1e-9)


def test_a_force_at_the_tip_reaches_sensor_and_joints() -> None:
    """What the worlds add to the tool's load in closed form is what MuJoCo makes of a force on the tool."""
    rng = np.random.default_rng(3)
    q, dq, ddq = HOME + rng.uniform(-0.3, 0.3, (10, 7)), rng.uniform(-1, 1, (10, 7)), rng.uniform(-5, 5, (10, 7))
    push = rng.uniform(-10, 10, (10, 3))
    free, torque = dynamics((TOOL,), q, dq, ddq)
    wrench, pushed = dynamics((TOOL,), q, dq, ddq, push=push)
    pose = forward(q)
    force = np.einsum("nji,nj->ni", pose.rotation, push)
    np.testing.assert_allclose(wrench - free, np.concatenate([force, np.cross(TIP, force)], axis=1), atol=1e-9)
    np.testing.assert_allclose(torque - pushed, np.einsum("nij,ni->nj", pose.jacobian[:, :3], push), atol=1e-9)


def test_a_swing_follows_its_path() -> None:
    swing = swing_of(np.random.default_rng(4), Protocol(turning=True, tilts=True))
    asked = swing.path.x[swing.path.logged, :3]
    # joints run on a spline through poses every 10 ms: fast pokes are rounded a little, and logged as they are
    np.testing.assert_allclose(swing.tip()[swing.path.logged], asked, atol=2e-5)
    speed = np.abs(swing.joints(swing.t, 1)).max(axis=0)
    assert (speed < SPEEDS).all(), f"joints at {speed.round(2)} rad/s"
    unit = swing.rotation @ swing.rotation.transpose(0, 2, 1)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-12)
    contact = np.random.default_rng(5).uniform(-1, 1, (len(swing.t), 3))
    force = np.einsum("nji,nj->ni", swing.rotation, contact @ swing.axes)
    np.testing.assert_allclose(
        swing.into_sensor(contact, TIP), np.concatenate([force, np.cross(TIP, force)], axis=1), atol=1e-6
    )


# ----------------------------------------------------------------------------------------------------------- material


@pytest.mark.parametrize(("profile", "exponent"), [(np.inf, 1.0), (1.0, 2.0), (2.0, 1.5), (4.0, 1.25)])
def test_punches_have_the_exponents_of_contact_mechanics(profile: float, exponent: float) -> None:
    """Flat punch 1, cone 2, round 1.5 (Hertz, Sneddon); by springs side by side."""
    force = elastic_table(Matter(stiffness=700.0, profile=profile))
    depth = np.linspace(0, DEEPEST, len(force))
    assert np.interp(1e-3, depth, force) == pytest.approx(0.7, rel=1e-6)
    slope = np.diff(np.log(force[50::50])) / np.diff(np.log(depth[50::50]))
    np.testing.assert_allclose(slope, exponent, atol=3e-4)  # some hundred springs carry at the least depth


def test_a_second_spring_acts_behind_its_gap() -> None:
    force = elastic_table(Matter(stiffness=800.0, second=400.0, gap=3e-3))
    depth = np.linspace(0, DEEPEST, len(force))
    np.testing.assert_allclose(force, 800 * depth + 400 * np.maximum(depth - 3e-3, 0), atol=0.008)
    # an uneven gap of 3e-3 ± 7.5e-5 m rounds the bend by a quarter of 400 N/m times that


DISSIPATIVE = {
    "dashpot": Matter(dashpot=6.0),
    "loss": Matter(profile=2.0, loss=2.0),
    "relaxation": Matter(arms=((0.3, 0.4), (0.2, 0.05))),
    "loop": Matter(loop=0.2, loop_length=5e-4),
    "fibres": Matter(fibres=0.4, fibre_stretch=1e-3),
    "glue": Matter(glue=0.5, glue_length=5e-4),
    "series": Matter(profile=2.0, loss=1.0, series=5e-5),
}


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_material_takes_energy_and_never_pulls(name: str) -> None:
    t, depth = poke(3e-3, 3e-3, 4e-3, seconds=0.3)
    m = DISSIPATIVE[name]
    force = pressed(m, t, depth)
    work = np.trapezoid(force, depth)
    assert work > 1e-4  # [J] of some 5e-3 that are stored
    assert force.min() >= (-m.glue - 1e-12)
    assert (force[depth < -1.5 * m.glue_length] == 0).all()
    # what there is beyond the spring changes the force by as much as it should matter
    assert np.abs(force - pressed(Matter(profile=m.profile), t, depth)).max() > 0.02


def test_a_spring_gives_back_what_it_took() -> None:
    t, depth = poke(3e-3, 2e-3)
    force = pressed(Matter(stiffness=900.0), t, depth)
    np.testing.assert_allclose(force, 900 * np.maximum(depth, 0), atol=1e-9)
    assert abs(np.trapezoid(force, depth)) < 1e-12


def test_relaxation_decays_with_its_time_constant() -> None:
    t, depth = poke(3e-3, seconds=0.02, stay=3.0)
    force = pressed(Matter(stiffness=1000.0, arms=((0.4, 0.5),)), t, depth)
    held = (t > 0.05) & (t < 3.0)
    excess = force[held] - 3.0 * 0.6
    rate = np.polyfit(t[held], np.log(excess), 1)[0]
    assert rate == pytest.approx(-2.0, rel=2e-3)
    assert force.max() == pytest.approx(3.0, rel=0.03)  # it hardly flowed in 10 ms


def test_the_plate_stays_behind_a_tool_that_leaves_fast() -> None:
    t, depth = poke(3e-3, seconds=0.05, stay=2.0)
    force = pressed(Matter(arms=((0.5, 0.5),)), t, depth)
    leaving = (t > 2.05) & (depth > 0)
    lost = depth[leaving][force[leaving] == 0]
    # it has settled by half of the 3 mm, and the tool leaves it there
    assert lost.max() == pytest.approx(1.45e-3, abs=0.1e-3)


def test_fibres_break_on_the_first_loading_only() -> None:
    t, depth = poke(2e-3, 2e-3, 4e-3)
    m = Matter(stiffness=1000.0, fibres=0.4, fibre_stretch=1e-3)
    force = pressed(m, t, depth)
    deepest = np.maximum.accumulate(np.maximum(depth, 0))
    # strengths that are spread exponentially have this limit; two dozen of them come within 3 % of the force
    limit = 1000 * np.maximum(depth, 0) * (0.6 + 0.4 * np.exp(-(deepest - np.maximum(depth, 0)) / 1e-3))
    np.testing.assert_allclose(force, limit, atol=0.03 * limit.max())
    first, second = force[t < 0.5].max(), force[(t > 1.0) & (t < 1.5)]
    assert second.max() == pytest.approx(first, rel=1e-3)
    assert np.trapezoid(force[(t > 1.001) & (t < 2.0)], depth[(t > 1.001) & (t < 2.0)]) == pytest.approx(0, abs=2e-6)


def test_threads_pull_with_all_their_strength_and_tear() -> None:
    t, depth = poke(3e-3, seconds=1.0)
    m = Matter(stiffness=500.0, glue=0.4, glue_length=4e-4)
    pull = pressed(m, t, depth) - pressed(replace(m, glue=0.0), t, depth)
    assert pull.min() == pytest.approx(-0.4, rel=0.02)
    assert (pull[t < 1.0] > -1e-9).all()  # nothing on the way in
    outside = (t > 1.0) & (depth < 0)
    assert pull[outside].min() < -0.25
    assert (np.diff(pull[outside]) > -1e-3).all()  # they tear one after the other


def test_a_spring_in_series_shares_the_depth() -> None:
    t, depth = poke(3e-3)
    force = pressed(Matter(stiffness=2000.0, series=1e-4), t, depth)
    np.testing.assert_allclose(force, 2000 / 1.2 * np.maximum(depth, 0), atol=1e-6)
    # with a dashpot the spring in series stores what the dashpot holds, and both together stay passive
    damped = pressed(Matter(stiffness=2000.0, dashpot=10.0, series=1e-4), t, depth)
    assert np.trapezoid(damped, depth) > 0
    assert np.abs(damped - force).max() < 10 * np.abs(np.gradient(depth, t)).max() * 1.1


def test_a_bundle_of_sliders_turns_over_its_length() -> None:
    t, depth = poke(4e-3, seconds=2.0)
    length = 5e-4
    base = 1000 * np.maximum(depth, 0)
    turn = (pressed(Matter(loop=0.1, loop_length=length), t, depth) - base) / np.maximum(base, 1e-9) / 0.1
    back = (t > 2.0) & (depth > 0.5e-3)
    away = depth.max() - depth[back]
    np.testing.assert_allclose(turn[back], 2 * np.exp(-away / length) - 1, atol=0.08)  # sixteen sliders for a curve


# ----------------------------------------------------------------------------------------------------------- friction


def strokes(length: float = 5e-3, speed: float = 1e-2) -> tuple[Array, Array]:
    """Slip along both tangents (2, n), there and back, and across."""
    script = Script(("x", "y"), np.random.default_rng(0))
    for x, y in ((length, 0.0), (0.0, 0.0), (0.0, length), (length, length)):
        script.cruise("slide", speed, x=x, y=y)
    path = script.path()
    return path.x.T, path.rate.T


def test_friction_takes_energy_and_reaches_its_coefficient() -> None:
    slip, rate = strokes()
    normal = np.full(slip.shape[1], 3.0)
    force = rub(Rub(mu=0.4, uneven=0.4, turn=3e-4), normal, slip, rate, normal > 0)
    assert np.linalg.norm(force, axis=0).max() == pytest.approx(1.2, rel=1e-3)
    taken = -(force * rate).sum() / FINE
    assert taken == pytest.approx(1.2 * 0.02, rel=0.08)  # the bristles turn thrice, and give way meanwhile


def test_bristles_turn_over_their_length() -> None:
    slip, _ = strokes()
    held = brush(Rub(turn=2e-4), slip, np.ones(slip.shape[1], dtype=bool))[0]
    back = int(slip[0].argmax())
    away = slip[0][back] - slip[0][back : back + 3000]
    np.testing.assert_allclose(held[back : back + 3000], 2 * np.exp(-away / 2e-4) - 1, atol=0.05)


@pytest.mark.parametrize(("spread", "exponent"), [(0.0, 2 / 3), (1.0, 0.8), (8.0, 1 - 0.5 / 9.5)])
def test_asperities_have_the_area_of_archard(spread: float, exponent: float) -> None:
    """A ∝ N^((1 + q)/(1.5 + q)) with heights that grow as the power q of the depth."""
    load = np.geomspace(0.1, 8.0, 4000)
    slip = np.stack([np.linspace(0, 0.02, 4000), np.zeros(4000)])
    force = rub(Rub(mu=0.3, area="asperities", area_spread=spread), load, slip, np.full((2, 4000), 0.1), load > 0)
    power = np.polyfit(np.log(load[500:]), np.log(-force[0][500:]), 1)[0]
    assert power == pytest.approx(exponent, abs=0.01)


def test_grooves_hold_across_more_than_along() -> None:
    slip, rate = strokes()
    normal = np.full(slip.shape[1], 2.0)
    force = np.abs(rub(Rub(mu=0.3, flank=0.4), normal, slip, rate, normal > 0))
    assert force[1].max() > 1.1 * force[0].max()
    assert force[0].max() + force[1].max() == pytest.approx(2 * 0.6, rel=1e-2)


# ------------------------------------------------------------------------------------------------------------ sensors


def test_a_late_stream_is_late() -> None:
    t = np.arange(20000) / FINE
    load = np.sin(2 * np.pi * 3.0 * t)[:, None]
    at = t[1000:-1000:10]
    out = read(Chain(late=7.3e-3), load, at, np.zeros(1), np.random.default_rng(0), triples=())
    np.testing.assert_allclose(out[:, 0], np.sin(2 * np.pi * 3.0 * (at - 7.3e-3)), atol=1e-8)


def test_poles_delay_slow_signals_by_their_sum() -> None:
    t = np.arange(20000) / FINE
    load = np.stack([np.full_like(t, 2.0), np.sin(2 * np.pi * 1.0 * t)], axis=1)
    at = t[5000:-100:10]
    out = read(Chain(poles=(6e-3, 2e-3)), load, at, np.zeros(2), np.random.default_rng(0), triples=())
    np.testing.assert_allclose(out[:, 0], 2.0, atol=1e-9)
    np.testing.assert_allclose(out[:, 1], np.sin(2 * np.pi * (at - 8e-3)), atol=3e-3)


def test_a_turned_sensor_keeps_lengths_and_a_converter_clips_and_steps() -> None:
    rng = np.random.default_rng(6)
    load = np.repeat(rng.uniform(-5, 5, (1, 6)), 2000, axis=0)
    at = np.arange(100, 1900, 10) / FINE
    turned = read(Chain(turned=np.array([0.1, -0.2, 0.05])), load, at, np.zeros(6), rng, triples=(0, 3))
    for i in (0, 3):
        assert np.linalg.norm(turned[0, i : i + 3]) == pytest.approx(np.linalg.norm(load[0, i : i + 3]), rel=1e-12)
    assert np.abs(turned[0] - load[0]).max() > 0.1
    out = read(Chain(limit=np.full(6, 2.0), step=np.full(6, 0.25)), load, at, np.full(6, 0.1), rng)
    assert np.abs(out).max() <= 2.0
    np.testing.assert_allclose(out / 0.25, np.round(out / 0.25), atol=1e-9)


def test_noise_is_as_large_as_stated_and_hardly_coloured() -> None:
    noise = colour(np.random.default_rng(7), 200_000, np.array([0.015]))[:, 0]
    assert noise.std() == pytest.approx(0.015, rel=0.02)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.04, abs=0.01)


# ------------------------------------------------------------------------------------------------------------- drives


def test_motions_have_their_own_derivatives_and_keep_speed_limits() -> None:
    motion = excite(np.random.default_rng(8), 20.0, fast=True)
    q, dq, ddq = motion(motion.t)
    np.testing.assert_allclose(np.gradient(q, motion.t, axis=0)[5:-5], dq[5:-5], atol=2e-3)
    np.testing.assert_allclose(np.gradient(dq, motion.t, axis=0)[5:-5], ddq[5:-5], atol=0.1)
    assert (np.abs(dq).max(axis=0) < SPEEDS).all()
    np.testing.assert_allclose(dq[[0, -1]], 0.0, atol=1e-9)


def test_joints_add_up() -> None:
    motion = excite(np.random.default_rng(9), 12.0, fast=True)
    dq, ddq = motion.logged[1:]
    rigid = torques(Drives(), motion)
    np.testing.assert_allclose(rigid, dynamics((), *motion.logged)[1], atol=5e-3)  # of 20 N·m, at a quarter of the rate
    np.testing.assert_allclose(torques(Drives(motors=0.3 * SCALE), motion) - rigid, 0.3 * SCALE * ddq, atol=2e-3)
    np.testing.assert_allclose(torques(Drives(viscous=2.0 * SCALE), motion) - rigid, 2.0 * SCALE * dq, atol=1e-9)
    dry = torques(Drives(dry=SCALE), motion) - rigid
    fast = np.abs(dq) > 0.05 * SPEEDS
    np.testing.assert_allclose((dry / SCALE)[fast], np.sign(dq)[fast], atol=0.05)
    assert (dry * dq).sum() > 0
    # a gear that gives way: to first order the torque that turns the link later, by τ̈/K for each unit of inertia
    soft = torques(Drives(softness=np.full(JOINTS, 1e-6)), motion) - rigid
    softer = torques(Drives(softness=np.full(JOINTS, 2e-6)), motion) - rigid
    np.testing.assert_allclose(softer, 2 * soft, atol=0.02 * np.abs(softer).max())
    assert np.abs(soft).max() > 1e-3


# -------------------------------------------------------------------------------------------------------------- cases


@pytest.mark.parametrize(
    ("kind", "world"),
    [
        # each kind in one world, and in all of them where it is asked for
        pytest.param(kind, world, marks=() if (i - j) % len(WORLDS) == 0 else pytest.mark.slow)
        for i, kind in enumerate(KINDS)
        for j, world in enumerate(WORLDS)
    ],
)
def test_cases_are_the_same_each_time(kind: str, world: str) -> None:
    first, again = case(kind, 1, 5, world), case(kind, 1, 5, world)
    for name in ("t", "q", "tau", "wrench"):
        one, two = getattr(first.log, name), getattr(again.log, name)
        assert (one is None) == (two is None)
        if one is not None:
            np.testing.assert_array_equal(one, two)
    for name, values in first.log.contact.items():
        np.testing.assert_array_equal(values, again.log.contact[name])
    assert (first.name, first.note, first.truth, first.model) == (again.name, again.note, again.truth, again.model)
    assert first.log.valid.all()
    counts = {"single": 1, "pair": 2, "none": 0, "outside": 0}
    if kind in counts:
        assert len(first.truth) == counts[kind]
        assert first.true_model == (*first.model, *first.true_model[len(first.model) :])
        assert set(first.true_model) == set(first.model) | first.truth
    else:
        assert first.truth


def test_cases_come_from_all_worlds_in_turn() -> None:
    found = list(cases("none", 3, 2))
    assert [c.name.split("/")[1] for c in found] == list(WORLDS)
    other = case("none", 0, 3, "wrench")
    assert found[1].seed != other.seed
    assert not np.array_equal(found[1].log.q[:1000], other.log.q[:1000])
    with pytest.raises(ValueError, match="kinds are single"):
        next(cases("double", 1, 0))


def test_the_world_knows_nothing_of_the_catalogue() -> None:
    """Of kinid, cases and all that they import use the format of logs and rigs, and the arm's URDF; nothing that
    predicts.
    """
    here = Path(__file__).parent
    used, seen, left = set(), set(), ["hidden.cases", "hidden.measured"]
    while left:
        module = left.pop()
        if module in seen:
            continue
        seen.add(module)
        file = here.parent / Path(*module.split("."))
        tree = ast.parse(
            (file / "__init__.py" if file.is_dir() else file.with_suffix(".py")).read_text(encoding="utf-8")
        )
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = (
                    [f"{node.module}.{alias.name}" for alias in node.names]
                    if node.module == "hidden"
                    else [node.module]
                )
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "kinid":
                names = [f"kinid.{node.attr}"]
            else:
                continue
            left += [name for name in names if name.startswith("hidden.")]
            used |= {name for name in names if name.split(".")[0] == "kinid"}
    assert {"hidden.world.material", "hidden.world.drives", "hidden.world.wrist", "hidden.limited"} <= seen
    assert used <= {"kinid", "kinid.urdf", "kinid.Log", "kinid.Rig"}
