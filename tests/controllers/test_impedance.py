"""The geometric impedance: gradient, frames, passivity, null space, saturation."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinid.controllers import (
    ArmState,
    DecoupledImpedance,
    Gains,
    Impedance,
    JacobianTranspose,
    Target,
    design_damping,
    impedance_torque,
    potential,
    sampled_radius,
)
from kinid.controllers.cartesian import NULL_TIME
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]
seeds = st.integers(0, 10_000)
#: the first example compiles, and a busy machine is late: how long one takes says nothing here
UNHURRIED = settings(deadline=None)
NO_LIMIT = np.full(7, np.inf)


def pose(rng: Any) -> tuple[Array, Array]:
    return Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(), rng.normal(size=3)


def spring(rng: Any) -> Array:
    a = rng.normal(size=(6, 6))
    return a @ a.T


def wrench(
    at: tuple[Array, Array],
    target: tuple[Array, Array],
    stiffness: Array,
    twist: Array | None = None,
    damping: Array | None = None,
) -> Array:
    """The kernel's wrench: an arm whose joints are the tip's own six motions."""
    out, zero = np.empty(6), np.zeros(6)
    impedance_torque(
        *at,
        np.eye(6),
        zero if twist is None else twist,
        zero,
        *target,
        zero,
        stiffness,
        np.zeros((6, 6)) if damping is None else damping,
        0.0,
        np.full(6, np.inf),
        out,
    )
    return out


def moved(at: tuple[Array, Array], step: Array) -> tuple[Array, Array]:
    return Rotation.from_rotvec(step[3:]).as_matrix() @ at[0], at[1] + step[:3]


@UNHURRIED
@given(seeds)
def test_wrench_is_the_gradient_of_the_potential(seed: int) -> None:
    """Any pose and target, also near half a turn, and any symmetric stiffness with coupling."""
    rng = np.random.default_rng(seed)
    at, target, k, h = pose(rng), pose(rng), spring(rng), 1e-5
    slope = [
        (potential(*moved(at, h * e), *target, k) - potential(*moved(at, -h * e), *target, k)) / (2 * h)
        for e in np.eye(6)
    ]
    # central differences: h² times third derivatives, and 1e-15 V / h
    np.testing.assert_allclose(wrench(at, target, k), -np.array(slope), atol=1e-6)


@UNHURRIED
@given(seeds)
def test_moment_is_that_of_the_quaternion_form(seed: int) -> None:
    """2 (η − ε×) K_r ε (F. Caccavale et al., IEEE Trans. Robotics and Automation 15, 1999), by scipy's quaternion."""
    rng = np.random.default_rng(seed)
    (r, p), (d, _), k = pose(rng), pose(rng), spring(rng)
    k[:3, 3:] = k[3:, :3] = 0
    *vector, scalar = Rotation.from_matrix(d @ r.T).as_quat()
    push = k[3:, 3:] @ vector
    np.testing.assert_allclose(wrench((r, p), (d, p), k)[3:], 2 * (scalar * push - np.cross(vector, push)), atol=1e-11)


@UNHURRIED
@given(seeds)
def test_near_the_target_it_is_the_given_stiffness(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at, k, step = pose(rng), spring(rng), 1e-5 * rng.normal(size=6)
    # second order in the step
    np.testing.assert_allclose(wrench(moved(at, -step), at, k), k @ step, atol=1e-7)


@UNHURRIED
@given(seeds)
def test_a_turned_and_shifted_base_leaves_the_behaviour(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at, target, k, d, twist = pose(rng), pose(rng), spring(rng), spring(rng), rng.normal(size=6)
    q, shift = pose(rng)
    turn = np.kron(np.eye(2), q)

    def other(of: tuple[Array, Array]) -> tuple[Array, Array]:
        return q @ of[0], q @ of[1] + shift

    found = wrench(other(at), other(target), turn @ k @ turn.T, turn @ twist, turn @ d @ turn.T)
    np.testing.assert_allclose(found, turn @ wrench(at, target, k, twist, d), atol=1e-10)


@UNHURRIED
@given(seeds)
def test_null_damping_leaves_the_task_alone_and_takes_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at, jacobian, dq, out, zero = pose(rng), rng.normal(size=(6, 7)), rng.normal(size=7), np.empty(7), np.zeros((6, 6))
    impedance_torque(*at, jacobian, dq, np.zeros(7), *at, np.zeros(6), zero, zero, 3.0, NO_LIMIT, out)
    projector = np.eye(7) - np.linalg.pinv(jacobian) @ jacobian
    # λ is 1e-10 of the trace: what is left of the task part is that over the smallest eigenvalue of J Jᵀ
    smallest = np.linalg.eigvalsh(jacobian @ jacobian.T)[0]
    slack = 3 * np.linalg.norm(dq) * 1e-9 * np.trace(jacobian @ jacobian.T) / smallest + 1e-9
    np.testing.assert_allclose(out, -3.0 * projector @ dq, atol=slack)
    assert out @ dq <= 1e-12
    # a Jacobian without rank: still no energy
    jacobian[3] = jacobian[2]
    impedance_torque(*at, jacobian, dq, np.zeros(7), *at, np.zeros(6), zero, zero, 3.0, NO_LIMIT, out)
    assert np.isfinite(out).all()
    assert out @ dq <= 1e-9


def test_state_agrees_with_pinocchio_in_any_joint_order(bench: Any) -> None:
    order = [3, 0, 6, 1, 5, 2, 4]
    names = [f"joint_{i + 1}" for i in order]
    mixed = Robot.load(Rig.parse({"robot": {"model": "lwr4plus", "joints": names}}))
    mixed.model.armature = bench.robot.model.armature
    rng = np.random.default_rng(1)
    q, dq, h = bench.pose, rng.normal(size=7), 1e-6
    a, b = bench.state(q, dq), ArmState.of(mixed, q[order], dq[order])
    np.testing.assert_allclose(b.jacobian, a.jacobian[:, order], atol=1e-12)
    np.testing.assert_allclose(b.mass, a.mass[np.ix_(order, order)], atol=1e-12)
    np.testing.assert_allclose(b.bias, a.bias[order], atol=1e-11)
    np.testing.assert_allclose(b.gravity, a.gravity[order], atol=1e-11)
    np.testing.assert_allclose(b.drift, a.drift, atol=1e-11)
    ahead, behind = bench.state(q + h * dq, dq), bench.state(q - h * dq, dq)
    np.testing.assert_allclose(a.twist[:3], (ahead.position - behind.position) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(a.drift, (ahead.twist - behind.twist) / (2 * h), atol=1e-7)
    data = bench.robot.model.createData()
    np.testing.assert_allclose(a.bias, pin.rnea(bench.robot.model, data, q, dq, np.zeros(7)), atol=1e-11)


@UNHURRIED
@given(st.floats(0.1, 1.5), seeds)
def test_designed_damping_gives_every_mode_its_ratio(ratio: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    k, inertia = spring(rng) + np.eye(6), spring(rng) + np.eye(6)
    d = design_damping(k, inertia, ratio)
    first = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(inertia, k), -np.linalg.solve(inertia, d)]])
    poles = np.linalg.eigvals(first)
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(inertia, k)).real)
    expected = np.concatenate([omega * (-ratio + s * np.sqrt(ratio**2 - 1 + 0j)) for s in (1, -1)])
    for pole in expected:
        # a double pole at ratio 1 moves by the root of the rounding
        assert np.abs(poles - pole).min() < 1e-5 * omega.max()


def controller(bench: Any, offset: Any = (0, 0, 0), kind: type[Impedance] = Impedance, **gains: Any) -> Impedance:
    state = bench.state()
    return kind(Gains(**gains), Target(state.rotation, state.position + np.asarray(offset, dtype=float)), bench.limit)


def test_closed_loop_only_loses_energy(bench: Any) -> None:
    """Kinetic energy and the spring's V, gravity held: the storage function never grows, and the tip arrives."""
    control = controller(bench, (0.02, -0.03, 0.02), translation=1500.0, rotation=80.0)
    target, k = control.target, control.gains.stiffness()
    energy = []

    def command(_: int, state: ArmState) -> Array:
        energy.append(
            0.5 * state.dq @ state.mass @ state.dq
            + potential(state.rotation, state.position, target.rotation, target.position, k)
        )
        return control.command(state)

    run = bench.run(command, 1200)
    e = np.array(energy)
    # a torque held through 1 ms may lift it by K (v T)²/2 a step
    assert np.diff(e).max() < 1e-3 * e[0]
    assert e[-1] < 1e-4 * e[0]
    np.testing.assert_allclose(run["tip"][-1], target.position, atol=2e-4)


@pytest.mark.parametrize("kind", [Impedance, DecoupledImpedance])
def test_torques_respect_their_limits(bench: Any, kind: type[Impedance]) -> None:
    control = controller(bench, (0.5, 0.5, -0.5), kind, translation=5200.0)
    found = control.command(bench.state(dq=np.full(7, 2.0)))
    assert (np.abs(found) <= bench.limit).all()
    assert (np.abs(found) == bench.limit).any()


def test_torque_limits_are_one_for_all_or_one_a_joint(bench: Any) -> None:
    state = bench.state()
    target = Target(state.rotation, state.position + np.array([0.0, 0.0, 0.05]))
    one = Impedance(Gains(), target, np.array([3.0])).command(state)
    assert np.array_equal(one, Impedance(Gains(), target, np.full(7, 3.0)).command(state))
    assert np.abs(one).max() == 3.0
    for limits in (np.array([3.0, 3.0]), np.full(8, 3.0)):
        with pytest.raises(InputError, match="torque limits for 7 joints"):
            Impedance(Gains(), target, limits).command(state)
        with pytest.raises(InputError, match="torque limits for 7 joints"):
            JacobianTranspose(np.zeros(6), limits).command(state)


def lateral(bench: Any, kind: type[Impedance]) -> tuple[float, float]:
    """Largest lateral displacement and normal stroke [m] of a purely normal sine into a Kelvin-Voigt material."""
    control = controller(bench, kind=kind, translation=5200.0, rotation=300.0)
    start, omega = control.target, 2 * np.pi * 4.0

    def contact(state: ArmState) -> Array:
        depth, rate = start.position[2] - state.position[2], -state.twist[2]
        return np.array([0, 0, max(0.0, 732 * depth + 9.9 * rate) if depth > 0 else 0.0, 0, 0, 0])

    def command(i: int, state: ArmState) -> Array:
        t = i * 1e-3
        z, v, a = 0.01 * np.array([np.cos(omega * t) - 1, -omega * np.sin(omega * t), -(omega**2) * np.cos(omega * t)])
        up = np.eye(6)[2]
        return control.toward(Target(start.rotation, start.position + z * up[:3], v * up, a * up)).command(state)

    tip = bench.run(command, 500, contact)["tip"] - start.position
    return float(np.abs(tip[:, :2]).max()), float(np.ptp(tip[:, 2]))


def test_a_normal_command_moves_sideways_unless_the_inertia_is_decoupled(bench: Any) -> None:
    plain, stroke = lateral(bench, Impedance)
    decoupled, other = lateral(bench, DecoupledImpedance)
    print(
        f"lateral displacement of a 20 mm, 4 Hz normal command: plain {1e3 * plain:.3f} mm, decoupled "
        f"{1e3 * decoupled:.4f} mm"
    )
    assert plain > 5e-4
    assert decoupled < 0.05 * plain
    assert min(stroke, other) > 0.015


def test_decoupled_tip_has_the_shaped_inertia(bench: Any) -> None:
    """At rest off the target: Λ_d ẍ = w + f, by Pinocchio's forward dynamics."""
    shaped = np.diag([3.0, 4.0, 5.0, 0.1, 0.2, 0.3])
    base = controller(bench, (0.003, -0.002, 0.001), translation=800.0, rotation=50.0)
    control = DecoupledImpedance(base.gains, base.target, np.full(7, 1e9), shaped)
    rng = np.random.default_rng(3)
    force, dq = rng.normal(size=6), 0.3 * rng.normal(size=7)
    state = bench.state(dq=dq, wrench=force)
    model = bench.robot.model
    ddq = pin.aba(model, model.createData(), bench.pose, dq, control.command(state) + state.jacobian.T @ force)
    error = np.concatenate([control.target.position - state.position, np.zeros(3)])
    push = control.gains.stiffness() @ error - control.damping(state) @ state.twist + force
    np.testing.assert_allclose(state.jacobian @ ddq + state.drift, np.linalg.solve(shaped, push), atol=1e-7)


def test_a_rendered_wrench_holds_its_opposite(bench: Any) -> None:
    """Statics by virtual work, Jacobian by Pinocchio: the arm with Jᵀ w stays at rest against −w."""
    w = np.array([5.0, -3.0, 12.0, 0.4, -0.2, 0.3])
    state = bench.state(wrench=-w)
    tau = JacobianTranspose(w, bench.limit).command(state)
    model = bench.robot.model
    data = model.createData()
    jacobian = pin.computeFrameJacobian(model, data, bench.pose, model.getFrameId("tool_tip"), pin.LOCAL_WORLD_ALIGNED)
    ddq = pin.aba(model, data, bench.pose, np.zeros(7), tau - jacobian.T @ w)
    np.testing.assert_allclose(ddq, 0, atol=1e-9)
    strong = JacobianTranspose(100 * w, bench.limit)
    assert strong.saturates(state)
    assert (np.abs(strong.command(state)) <= bench.limit).all()


def test_sampled_radius_against_a_simulation() -> None:
    """One mass: the critical damping of a sampled damper is 2 m / T, and a sampled spring alone is unstable."""
    one = np.eye(1)
    assert sampled_radius(0 * one, 1.99e3 * one, one, 1e-3) <= 1 + 1e-12
    assert sampled_radius(0 * one, 2.01e3 * one, one, 1e-3) > 1 + 1e-6
    radius = sampled_radius(1e4 * one, 0 * one, one, 1e-3)
    x, v, sizes = 1.0, 0.0, []
    for _ in range(4000):
        a = -1e4 * x
        x, v = x + v * 1e-3 + 0.5e-6 * a, v + 1e-3 * a
        sizes.append(np.hypot(100 * x, v))
    growth = (max(sizes[3000:]) / max(sizes[:1000])) ** (1 / 3000)
    assert radius > 1
    assert growth == pytest.approx(radius, abs=1e-4)  # the maxima are taken over a period of 63 samples


def test_unstable_gains_are_refused_before_they_run(bench: Any) -> None:
    state = bench.state()
    controller(bench, translation=5200.0, rotation=300.0).check(state, 1e-3)
    with pytest.raises(InputError, match="sampled loop grows"):
        controller(bench, translation=5200.0, rotation=300.0).check(state, 0.05)
    with pytest.raises(InputError, match="sampled loop grows"):
        controller(bench, translation=5200.0, ratio=0.0).check(state, 1e-3)
    for kind in (Impedance, DecoupledImpedance):
        controller(bench, kind=kind).check(state, 1e-3)
        with pytest.raises(InputError, match="sampled loop grows"):
            controller(bench, kind=kind, null_damping=2000.0).check(state, 1e-3)
    # without rotors a null-space damping that suits them is too much for the wrist
    robot = Robot.load(Rig.parse({"robot": {"model": "lwr4plus"}}))
    light = ArmState.of(robot, bench.pose)
    with pytest.raises(InputError, match="null-space damping of 5 .* too strong"):
        controller(bench, null_damping=5.0).check(light, 1e-3)
    loaded = ArmState.of(robot, bench.pose, rotor=np.full(7, 0.4))
    np.testing.assert_allclose(loaded.mass, state.mass, atol=1e-12)
    controller(bench, null_damping=5.0).check(loaded, 1e-3)
    for ratio, words in (
        (0.05, "damping ratio of 0.05 .* too low.*raise it"),
        (2.0, "ratio of 2 .* too high.*lower it"),
    ):
        with pytest.raises(InputError, match=words):
            controller(bench, ratio=ratio).check(light, 1e-3)
    with pytest.raises(InputError, match="period"):
        controller(bench).check(light, 0.0)


@pytest.mark.parametrize("kind", [Impedance, DecoupledImpedance])
@pytest.mark.parametrize("rotor", [0.0, 0.05, 0.4])
def test_null_damping_suits_the_arm_where_it_isn_t_given(bench: Any, kind: type[Impedance], rotor: float) -> None:
    """Stable with and without rotors, and null motions die out within their time constant, by forward dynamics."""
    robot = Robot.load(Rig.parse({"robot": {"model": "lwr4plus"}}))
    state = ArmState.of(robot, bench.pose, rotor=np.full(7, rotor))
    control = controller(bench, kind=kind)
    control.check(state, 1e-3)
    idle = np.linalg.svd(state.jacobian)[2][-1]
    still = ArmState.of(robot, bench.pose, 0.1 * idle, rotor=np.full(7, rotor))
    slowing = np.linalg.solve(state.mass, control.command(still) - still.bias)
    rate = -float(idle @ slowing) / 0.1
    assert 0.0 < rate < 1.5 / NULL_TIME
    if kind is Impedance:
        # the other directions of M⁻¹ P move the tip, which the spring holds
        assert rate == pytest.approx(1.0 / NULL_TIME, rel=0.02)


def test_an_arm_without_null_space_needs_no_null_damping() -> None:
    robot = Robot.load(Rig.parse({"robot": {"model": "ur5", "tip_frame": "tool0"}}))
    state = ArmState.of(robot, np.array([0.0, -1.0, 1.2, -0.5, 0.7, 0.2]))
    control = Impedance(Gains(), Target(state.rotation, state.position), np.full(6, 100.0))
    assert control.null_damping(state) == 0.0
    control.check(state, 1e-3)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"translation": -1.0}, "negative"),
        ({"translation": 5300.0}, "at most 5200"),
        ({"rotation": np.nan}, "rotation"),
        ({"translation": (1.0, -2.0, 3.0)}, "negative"),
        ({"ratio": -0.1}, "ratio"),
        ({"ratio": 3.0}, "ratio"),
        ({"null_damping": -1.0}, "null_damping"),
        ({"axes": np.ones((3, 3))}, "orthonormal"),
        ({"damping": -np.eye(6)}, "can give energy"),
        ({"damping": np.triu(np.ones((6, 6)))}, "can give energy"),
        ({"damping": np.eye(3)}, "shape"),
        ({"translation": "a"}, "translation stiffness 'a'"),
        ({"rotation": None}, "rotation stiffness"),
        ({"translation": (1.0, 2.0)}, "translation stiffness"),
        ({"axes": np.diag([1.0, 1.0, -1.0])}, "right-handed"),
        ({"axes": "xyz"}, "axes of the stiffness 'xyz'"),
        ({"ratio": "0.7"}, "ratio"),
        ({"null_damping": "5"}, "null_damping"),
        ({"damping": "much"}, "damping 'much'"),
    ],
)
def test_gains_that_make_no_sense_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Gains(**bad)


def test_other_bad_input_is_refused(bench: Any) -> None:
    at = bench.state()
    for target in ((2 * np.eye(3), np.zeros(3)), (np.eye(3), np.zeros(2)), (np.eye(3), np.full(3, np.nan))):
        with pytest.raises(InputError, match="target"):
            Target(*target)
    for limit in (np.array([1.0, 0.0]), np.array([-1.0]), np.array([np.nan])):
        with pytest.raises(InputError, match="torque limits"):
            Impedance(Gains(), Target(at.rotation, at.position), limit)
    with pytest.raises(InputError, match="wrench"):
        JacobianTranspose(np.zeros(3), bench.limit)
    with pytest.raises(InputError, match="inertia"):
        DecoupledImpedance(Gains(), Target(at.rotation, at.position), bench.limit, np.zeros((6, 6)))
    with pytest.raises(InputError, match="one state at a time"):
        ArmState.of(bench.robot, np.zeros((2, 7)))
    with pytest.raises(InputError, match="joint velocities of lwr4plus with 7 values that aren't finite"):
        ArmState.of(bench.robot, bench.pose, np.full(7, np.nan))
    with pytest.raises(InputError, match="rotor inertias"):
        ArmState.of(bench.robot, bench.pose, rotor=np.full(6, 0.4))
    with pytest.raises(InputError, match="a state's wrench of shape"):
        ArmState.of(bench.robot, bench.pose, wrench=np.zeros(3))
    for name, value in (
        ("dq", np.full(7, np.nan)),
        ("mass", np.eye(6)),
        ("jacobian", "J"),
        ("position", np.full(3, np.inf)),
    ):
        with pytest.raises(InputError, match=f"a state's {name}"):
            dataclasses.replace(at, **{name: value})
    with pytest.raises(InputError, match="torque limits"):
        Impedance(Gains(), Target(at.rotation, at.position), "strong")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="gains '2000'"):
        Impedance("2000", Target(at.rotation, at.position), bench.limit)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="target"):
        Impedance(Gains(), at.position, bench.limit)
    for kind in (Impedance, DecoupledImpedance):
        short = kind(Gains(), Target(at.rotation, at.position), np.full(6, 100.0))
        for ask in (short.command, short.saturates):
            with pytest.raises(InputError, match="6 torque limits for 7 joints"):
                ask(at)
    lifted = JacobianTranspose(np.zeros(6), np.full(6, 100.0))
    for ask in (lifted.command, lifted.saturates):
        with pytest.raises(InputError, match="6 torque limits for 7 joints"):
            ask(at)


@pytest.mark.parametrize("kind", [Impedance, DecoupledImpedance])
def test_an_arm_goes_through_a_singular_pose(bench: Any, kind: type[Impedance]) -> None:
    """Stretched out and near it: torques stay those of the spring, and far from it the inertia is exact."""
    assert not bench.state().singular
    mobility = bench.state().jacobian @ np.linalg.solve(bench.state().mass, bench.state().jacobian.T)
    np.testing.assert_allclose(bench.state().task_inertia() @ mobility, np.eye(6), atol=1e-8)
    for bend in (0.0, 1e-6, 1e-4, 1e-3, 1e-2):
        state = ArmState.of(bench.robot, np.array([0.0, 0.5, 0.0, bend, 0.0, 0.3, 0.0]))
        assert state.singular or bend > 1e-3
        target = Target(state.rotation, state.position + [0.01, 0.0, -0.01])
        torque = kind(Gains(2000.0), target, NO_LIMIT).command(state) - state.gravity
        # 28 N on an arm of a metre or so; a decoupled one bends the wrench into axes of its own
        assert np.isfinite(torque).all()
        assert np.abs(torque).max() < 60.0


@pytest.mark.parametrize("kind", [Impedance, DecoupledImpedance])
def test_a_target_turned_over_is_turned_back_to(bench: Any, kind: type[Impedance]) -> None:
    """Exactly half a turn away every way round is as short: one is chosen; the arm doesn't stay turned over."""
    state = bench.state()
    for axis in np.vstack([np.eye(3), [0.6, 0.8, 0.0], [-0.6, 0.48, 0.64]]):
        over = Rotation.from_rotvec(np.pi * axis).as_matrix() @ state.rotation
        torque = kind(Gains(2000.0, 100.0), Target(over, state.position), NO_LIMIT).command(state) - state.bias
        assert np.abs(torque).max() > 0.1
        # it is the moment about the axis, which the arm turns by
        turned = state.jacobian[3:] @ np.linalg.solve(state.mass, torque)
        assert abs(turned @ axis) > 0.5 * np.linalg.norm(turned) or kind is Impedance


def test_a_far_target_saturates_and_says_so(bench: Any) -> None:
    state = bench.state()
    for far, saturates in ((0.001, False), (0.5, True)):
        control = Impedance(Gains(5000.0), Target(state.rotation, state.position + [0, 0, far]), bench.limit)
        assert control.saturates(state) == saturates
        assert (np.abs(control.command(state)) >= bench.limit - 1e-9).any() == saturates
