"""Joint effects against Pinocchio, an elastic joint integrated apart, and real drives and arms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.signal import decimate

import kinid
from kinid import Model
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import JointMotion, Layout, Signals, get
from kinid.effects._axes import BRISTLE
from kinid.effects.joint_torque_ripple import JointTorqueRipple
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_joint_torques
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]
LWR = Rig.parse({"robot": {"model": "lwr4plus"}})
POSE = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])


def one_axis(t: Array, q: Array, dq: Array, ddq: Array, channel: str = "tau1") -> Signals:
    none, pair = np.zeros(len(t)), np.zeros((2, len(t)))
    joints = JointMotion(q[None], dq[None], ddq[None], np.zeros((1, len(t))), known=False)
    return Signals(Layout((channel,), "joints"), t, np.diff(t, prepend=t[0]), none, none, pair, pair, joints=joints)


# ---- laws -----------------------------------------------------------------------------------------------------------


def test_dry_friction_is_a_sign_that_turns_within_its_bristles_and_stays_at_rest() -> None:
    t = np.linspace(0.0, 6.0, 6001)
    dq = np.where(t < 2.0, np.sin(np.pi * t), np.where(t < 4.0, 0.0, -0.5 * np.sin(0.5 * np.pi * (t - 4.0))))
    q = np.concatenate([[0.0], np.cumsum(0.5e-3 * (dq[1:] + dq[:-1]))])
    s = one_axis(t, q, dq, np.gradient(dq, t))
    torque = Model("rigid-body", "joint-coulomb-friction").predict(
        s, {"rigid-body.inertia": 0.0, "joint-coulomb-friction.coulomb": 3.0}
    )[0]
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    since = travelled - np.interp(np.where(t < 1, 0.0, np.where(t < 4, 1.0, 4.0)), t, travelled)
    moving = since > 20 * BRISTLE["rad"]  # e⁻²⁰ of the bristles is left to turn
    np.testing.assert_allclose(torque[moving & (t < 2)], 3.0 * np.sign(dq)[moving & (t < 2)], atol=1e-6)
    np.testing.assert_allclose(torque[(t > 2.001) & (t < 4)], -3.0, atol=1e-6)
    assert moving.mean() > 0.9


def test_a_reversal_follows_dahls_law() -> None:
    """du/dx = 1 − u sign(dx): from −1, u = 1 − 2 exp(−x/ℓ) over the travel x since the reversal."""
    t = np.linspace(0.0, 2.0, 20001)
    dq = -4e-3 * np.cos(np.pi * t / 2)  # 2.5 mrad one way, as much back
    s = one_axis(t, np.zeros_like(t), dq, np.zeros_like(t))
    u = Model("rigid-body", "joint-coulomb-friction").predict(s, {"joint-coulomb-friction.coulomb": 1.0})[0]
    back = t > 1.0
    x = 4e-3 * 2 / np.pi * (1 - np.sin(np.pi * t / 2))
    np.testing.assert_allclose(
        u[back], (1 - 2 * np.exp(-x / BRISTLE["rad"]))[back], atol=1e-4
    )  # steps of the quadrature


def test_asymmetric_viscosity_is_one_viscosity_each_way() -> None:
    t = np.linspace(0.0, 5.0, 500)
    s = one_axis(t, np.sin(t), np.cos(t), -np.sin(t))
    model = Model("rigid-body", "joint-viscous-friction", "joint-friction-asymmetry")
    torque = model.predict(
        s, {"rigid-body.inertia": 0.0, "joint-viscous-friction.viscous": 2.0, "joint-friction-asymmetry.asymmetry": 0.5}
    )[0]
    np.testing.assert_allclose(torque, np.where(np.cos(t) > 0, 2.5, 1.5) * np.cos(t), atol=1e-14)


def test_friction_fades_with_speed_and_grows_with_the_torque() -> None:
    t = np.linspace(0.0, 5.0, 500)
    none, pair = np.zeros(len(t)), np.zeros((2, len(t)))
    q, dq = np.stack([np.sin(t), 0.1 * np.sin(t)]), np.stack([np.cos(t), 0.1 * np.cos(t)])
    joints = JointMotion(q, dq, -q, np.stack([2 * np.cos(q[0]), -30 * q[1]]), known=True)
    layout = Layout(("tau1", "force2"), "joints", ("turns", "slides"))
    s = Signals(layout, t, np.diff(t, prepend=0.0), none, none, pair, pair, joints=joints)
    u = (
        Model("rigid-body", "joint-coulomb-friction").predict(
            s, {"joint-coulomb-friction.coulomb[turns]": 1.0, "joint-coulomb-friction.coulomb[slides]": 1.0}
        )
        - joints.rigid
    )
    model = Model("rigid-body", "joint-coulomb-friction", "joint-stribeck-friction", "joint-load-friction")
    found = model.predict(
        s,
        {
            "joint-coulomb-friction.coulomb[turns]": 0.0,
            "joint-coulomb-friction.coulomb[slides]": 0.0,
            "joint-stribeck-friction.excess[turns]": 0.7,
            "joint-stribeck-friction.excess[slides]": 5.0,
            "joint-stribeck-friction.speed[turns]": 0.3,
            "joint-stribeck-friction.speed[slides]": 0.03,
            "joint-load-friction.load[turns]": 0.1,
            "joint-load-friction.load[slides]": 0.2,
        },
    )
    fading = np.exp(-((dq / np.array([[0.3], [0.03]])) ** 2))
    size = np.array([[0.7], [5.0]]) * fading + np.array([[0.1], [0.2]]) * np.abs(joints.rigid)
    np.testing.assert_allclose(found, joints.rigid + size * u, atol=1e-12)
    assert "at rest" in get("joint-stribeck-friction").implausible(
        {"excess[turns]": -0.5}, {"joint-coulomb-friction.coulomb[turns]": 0.3}
    )


@pytest.mark.parametrize("order", [7.0, 100.0])
def test_a_ripple_is_found_by_its_line_over_the_angle(order: float) -> None:
    """Beside friction and what is smooth; of the joints that have none no parameter is left."""
    t = np.arange(0.0, 30.0, 2e-3)
    rng, none, pair = np.random.default_rng(1), np.zeros(len(t)), np.zeros((2, len(t)))
    q = np.stack([1.2 * np.sin(0.5 * t) + 0.3 * np.sin(1.7 * t), 0.8 * np.sin(0.9 * t + 1.0), 0.3 * np.cos(1.1 * t)])
    dq, ddq = np.gradient(q, t, axis=1), np.gradient(np.gradient(q, t, axis=1), t, axis=1)
    joints = JointMotion(q, dq, ddq, np.stack([3 * np.sin(q[0]), 2 * np.cos(q[1]), ddq[2]]), known=True)
    torque = joints.rigid + 0.5 * np.tanh(dq / 0.01) + 0.3 * q + 0.05 * rng.standard_normal(q.shape)
    torque[1] += 0.15 * np.sin(order * q[1] + 1.0) + 0.05 * np.cos(2 * order * q[1])
    layout = Layout(("tau1", "tau2", "tau3"), "joints", ("a", "b", "c"))
    s = Signals(layout, t, np.diff(t, prepend=0.0), none, none, pair, pair, measured=torque, joints=joints)
    found = JointTorqueRipple().for_log(s)
    assert found.orders is not None
    assert [joint for joint, _ in found.orders] == ["[b]"]
    assert found.orders[0][1] == pytest.approx(order, rel=0.05)
    assert len(found.parameters(layout)) == 5
    assert found.for_log(s) is found
    free = JointTorqueRipple()
    assert any(abs(start[5] - order) < 0.05 * order for start in free.initial_guesses(s))
    assert "never exceeds" in found.implausible({"sine[b,1]": 50.0}, {}, s)


def test_a_spring_is_about_the_encoders_zero() -> None:
    t = np.linspace(0.0, 5.0, 500)
    s = one_axis(t, np.sin(t), np.cos(t), -np.sin(t))
    model = Model("rigid-body", "joint-spring", "joint-torque-offset")
    torque = model.predict(
        s, {"rigid-body.inertia": 0.0, "joint-spring.rate": 4.0, "joint-torque-offset.offset": -2.0}
    )[0]
    np.testing.assert_allclose(torque, 4.0 * (np.sin(t) - 0.5), atol=1e-14)  # a spring that rests at 0.5 rad


def test_units_follow_the_axis() -> None:
    model = Model("rigid-body", "joint-viscous-friction", "joint-coulomb-friction", "joint-elasticity")
    turns, slides = (model.parameters(Layout((name,), "joints")).values() for name in ("tau1", "force1"))
    assert [p.unit for p in turns] == ["N·m·s²/rad", "N·m·s/rad", "N·m", "N·m·s⁴/rad"]
    assert [p.unit for p in slides] == ["N·s²/m", "N·s/m", "N", "N·s⁴/m"]


def test_names_of_the_parameters_end_in_the_joint() -> None:
    robot = Layout(("tau1", "tau2"), "joints", ("shoulder", "elbow"))
    assert list(Model("rigid-body", "rotor-inertia").parameters(robot)) == [
        "rotor-inertia.inertia[shoulder]",
        "rotor-inertia.inertia[elbow]",
    ]
    assert list(Model("rigid-body").parameters(Layout(("tau1", "tau2"), "joints"))) == [
        "rigid-body.inertia[tau1]",
        "rigid-body.inertia[tau2]",
    ]
    assert list(Model("rigid-body").parameters(Layout(("tau1",), "joints"))) == ["rigid-body.inertia"]


@pytest.mark.parametrize("encoder", ["motor", "link"])
def test_elasticity_of_a_joint_that_is_simulated_apart(encoder: str) -> None:
    """A motor J and a link M with a spring K between them, the link's motion given: θ = q + M q̈/K, τ_m = M q̈ + J
    θ̈.
    """
    link, rotor, stiffness = 0.8, 0.5, 3000.0
    t = np.arange(0.0, 8.0, 1e-3)
    sines = [(0.4, 3.0), (0.05, 7.0), (0.02, 11.0)]

    def derivative(order: int) -> Array:
        return sum(a * w**order * np.sin(w * t + order * np.pi / 2) for a, w in sines)  # type: ignore[return-value]

    wound = [derivative(k) + link / stiffness * derivative(k + 2) for k in range(3)]  # θ and its derivatives
    if encoder == "motor":
        motion, torque, model = wound, link * derivative(2), Model("rigid-body", "joint-elasticity")
        expected = link**2 / stiffness
    else:
        motion, torque = [derivative(k) for k in range(3)], link * derivative(2) + rotor * wound[2]
        model, expected = Model("rigid-body", "joint-elasticity"), -rotor * link / stiffness
    every, none = np.ones(len(t), np.bool_), np.zeros(len(t), np.bool_)
    e = Experiment(one_axis(t, *motion), torque[None], every, np.ones(1), None, none, np.arange(len(t)))
    rigid, _ = least_squares(Model("rigid-body"), e)
    elastic, values = least_squares(model, e)
    assert elastic < 0.05 * rigid
    # the effect is of first order in 1/K; at 11 rad/s the second is w² M/K = 3 % of it
    assert values["joint-elasticity.elasticity"] == pytest.approx(expected, rel=0.05)


# ---- robot ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def moving(swing: Callable[..., Any]) -> Log:
    """A log of an arm's own torques, with exact derivatives."""
    t = np.linspace(0.0, 4.0, 400)
    q, dq, ddq = swing(POSE, seed=1, size=0.6, speed=5.0)(t)
    robot = Robot.load(LWR)
    data = robot.model.createData()
    tau = np.array([pin.rnea(robot.model, data, *row) for row in zip(q, dq, ddq)])
    return Log(t, q=q, dq=dq, ddq=ddq, tau=tau)


def test_a_rigid_arm_leaves_nothing(moving: Log) -> None:
    e = from_joint_torques(moving, LWR, differentiator=Differentiator())
    assert e.layout == Layout(tuple(f"tau{j}" for j in range(1, 8)), "joints", tuple(f"joint_{j}" for j in range(1, 8)))
    assert not Model("rigid-body").parameters(e.layout)
    np.testing.assert_allclose(Model("rigid-body").predict(e.signals, {}), e.measured, atol=1e-10)


def test_payload_is_the_regressor_of_a_body_on_the_sensor(moving: Log) -> None:
    """Jᵀ times Pinocchio's body regressor, its first four columns (m, m·com)."""
    e = from_joint_torques(moving, LWR, differentiator=Differentiator())
    robot = Robot.load(LWR)
    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId("ft_sensor")
    assert e.signals.joints is not None
    assert e.signals.joints.payload is not None
    assert moving.q is not None
    assert moving.dq is not None
    assert moving.ddq is not None
    for i in range(0, len(moving), 37):
        row = moving.q[i], moving.dq[i], moving.ddq[i]
        pin.rnea(model, data, *row)
        regressor = pin.frameBodyRegressor(model, data, frame)[:, :4]
        jacobian = pin.computeFrameJacobian(model, data, moving.q[i], frame, pin.LOCAL)
        np.testing.assert_allclose(e.signals.joints.payload[:, :, i], (jacobian.T @ regressor).T, atol=1e-10)


def test_payload_is_found_in_an_arm_that_carries_one(moving: Log) -> None:
    """A ball of 1.3 kg: what it weighs shows in all joints; its own inertia, 3 g·m², is all that is left over."""
    com = np.array([0.02, -0.03, 0.08])
    rig = Rig.parse({"robot": {"model": "lwr4plus"}, "tool": {"mass": 1.3, "com": com.tolist()}})
    loaded = moving.replace(tau=from_joint_torques(moving, rig, differentiator=Differentiator()).signals.joints.rigid.T)  # type: ignore[union-attr]
    left, values = least_squares(
        Model("rigid-body", "payload"), from_joint_torques(loaded, LWR, differentiator=Differentiator())
    )
    assert values["payload.mass"] == pytest.approx(1.3, rel=0.01)
    moments = [values[f"payload.moment[{axis}]"] for axis in "xyz"]
    np.testing.assert_allclose(moments, 1.3 * com, atol=0.01)
    assert left < 0.05  # of 14 N·m


def test_gravity_error_is_what_another_gravity_adds(moving: Log) -> None:
    """An arm on a base that leans by 8° and 5°, and the rig says it stands upright; with a tool, gravity pulls at it
    too.
    """
    leaning = np.array([-0.85, 1.35, -9.68])
    tool = {"tool": {"mass": 1.3, "com": [0.02, -0.03, 0.08]}}
    for more in ({}, tool):
        robot = {"robot": {"model": "lwr4plus", "gravity": leaning.tolist()}}
        truth = from_joint_torques(moving, Rig.parse({**robot, **more}), differentiator=Differentiator()).signals.joints
        rig = Rig.parse({"robot": {"model": "lwr4plus"}, **more})
        assert truth is not None
        e = from_joint_torques(moving.replace(tau=truth.rigid.T), rig, differentiator=Differentiator())
        model = Model("rigid-body", "gravity-error")
        difference = leaning - np.array([0.0, 0.0, -9.81])
        named = {f"gravity-error.error[{axis}]": v for axis, v in zip("xyz", difference)}
        np.testing.assert_allclose(model.predict(e.signals, named), e.measured, atol=1e-10)
        fit = model.fit(e)
        # along gravity, first moments of all links in proportion are as good
        np.testing.assert_allclose([fit[f"error[{axis}]"].value for axis in "xy"], difference[:2], atol=1e-3)
        values = {f"gravity-error.{name}": fit[name].value for name in map(_own, model.parameters(e.signals.layout))}
        np.testing.assert_allclose(model.predict(e.signals, values), e.measured, atol=1e-3)


def _own(name: str) -> str:
    return name.split(".", 1)[1]


def test_a_link_with_another_centre_of_mass_is_a_gravity_error(moving: Log) -> None:
    """Inverse dynamics at rest is linear in first moments: a lever that is stated wrong by Δc adds m Δc."""
    e = from_joint_torques(moving, LWR, differentiator=Differentiator())
    robot, still = Robot.load(LWR), np.zeros(7)
    wrong = Robot.load(LWR)
    change = np.array([0.01, -0.02, 0.03])
    wrong.model.inertias[3].lever = wrong.model.inertias[3].lever + change
    mass, third = wrong.model.inertias[3].mass, robot.joint_names[2]
    named = {f"gravity-error.moment[{third}.{axis}]": mass * d for axis, d in zip("xyz", change)}
    added = Model("rigid-body", "gravity-error").predict(e.signals, named) - e.signals.joints.rigid  # type: ignore[union-attr]
    for i in range(0, len(e.signals), 400):
        q = e.signals.joints.q[:, i]  # type: ignore[union-attr]
        torque = [pin.rnea(r.model, r.model.createData(), r.configuration(q)[0], still, still) for r in (wrong, robot)]
        np.testing.assert_allclose(added[:, i], torque[0] - torque[1], atol=1e-9)


def test_joints_that_sag_turn_what_lies_beyond(moving: Log) -> None:
    """To first order, torques with all links turned back by what their springs give under a slow motion's load."""
    slow = moving.replace(t=20.0 * moving.t)
    e = from_joint_torques(slow, LWR, differentiator=Differentiator())
    robot, compliance, still = Robot.load(LWR), 1e-6, np.zeros(7)
    names = {f"joint-elasticity.sag[{name}.all]": compliance for name in robot.joint_names}
    added = Model("rigid-body", "joint-elasticity").predict(e.signals, names) - e.signals.joints.rigid  # type: ignore[union-attr]
    for i in range(0, len(e.signals), 400):
        q, load = e.signals.joints.q[:, i], e.signals.joints.rigid[:, i]  # type: ignore[union-attr]
        at = [
            pin.rnea(robot.model, robot.model.createData(), robot.configuration(x)[0], still, still)
            for x in (q - compliance * load, q)
        ]
        np.testing.assert_allclose(added[:, i], at[0] - at[1], atol=0.05 * np.abs(added).max())


def test_dry_friction_of_each_direction() -> None:
    """Where a joint rests, an offset stays and friction doesn't: only there are they two."""
    t = np.linspace(0.0, 20.0, 8000)
    speed = np.where(np.sin(0.5 * t) > 0, np.sin(2.0 * t), 0.0)
    s = one_axis(t, np.cumsum(speed) * (t[1] - t[0]), speed, np.gradient(speed, t))
    model = Model("rigid-body", "joint-coulomb-friction", "joint-friction-asymmetry")
    values = {"rigid-body.inertia": 0.5, "joint-coulomb-friction.coulomb": 2.0, "joint-friction-asymmetry.dry": 0.4}
    torque = model.predict(s, values)[0]
    fast = np.abs(speed) > 0.5
    base = model.predict(s, values | {"joint-friction-asymmetry.dry": 0.0})[0]
    np.testing.assert_allclose((torque - base)[fast], 0.4, atol=1e-6)
    assert get("joint-friction-asymmetry").implausible({"dry": 3.0}, values)


def test_gravity_error_and_payload_are_told_apart(moving: Log) -> None:
    rig = Rig.parse(
        {"robot": {"model": "lwr4plus", "gravity": [0.4, 0.0, -9.8]}, "tool": {"mass": 0.8, "com": [0, 0, 0.06]}}
    )
    tau = from_joint_torques(moving, rig, differentiator=Differentiator()).signals.joints.rigid.T  # type: ignore[union-attr]
    noisy = moving.replace(tau=tau + np.random.default_rng(0).normal(scale=0.02, size=tau.shape))
    fit = Model("rigid-body", "gravity-error", "payload").fit(noisy, LWR)
    # the product of both errors is left out of the model: 0.8 kg at the arm's end act like some 2 kg in its middle of
    # 15 kg
    assert fit["error[x]"].value == pytest.approx(0.4, abs=0.07)
    assert fit["mass"].value == pytest.approx(0.8, abs=0.05)


def test_gravity_error_needs_a_robot() -> None:
    assert Model("rigid-body", "gravity-error").parameters(Layout(("tau1",), "joints")).keys() == {"rigid-body.inertia"}
    t = np.arange(400) / 100
    with pytest.raises(kinid.InputError, match="gravity-error"):
        Model("rigid-body", "gravity-error").fit(Log(t, q=np.sin(t)[:, None], tau=-np.sin(t)[:, None]), Rig())


def test_the_rigs_tool_is_carried_and_a_wrench_replaces_it(moving: Log, weighed: Callable[..., Array]) -> None:
    rig = Rig.parse({"robot": {"model": "lwr4plus"}, "tool": {"mass": 1.3, "com": [0.02, -0.03, 0.08]}})
    with_tool = from_joint_torques(moving, rig, differentiator=Differentiator())
    wrench = weighed(rig, Robot.load(rig), moving.q, moving.dq, moving.ddq)
    felt = from_joint_torques(moving.replace(wrench=wrench), rig, bias="none", differentiator=Differentiator())
    bare = from_joint_torques(moving, LWR, differentiator=Differentiator())
    assert with_tool.signals.joints is not None
    assert felt.signals.joints is not None
    assert bare.signals.joints is not None
    np.testing.assert_allclose(felt.signals.joints.rigid, with_tool.signals.joints.rigid, atol=1e-9)
    assert np.abs(with_tool.signals.joints.rigid - bare.signals.joints.rigid).max() > 5.0


def test_samples_that_are_missing(moving: Log) -> None:
    """A reading that is missing doesn't count, a position that is missing leaves the sample out, a gap ends memory."""
    assert moving.q is not None
    assert moving.tau is not None
    t, q, tau = moving.t.copy(), moving.q.copy(), moving.tau.copy()
    t[200:] += 1.0
    q[50, 3] = np.nan
    tau[70, 0] = np.nan
    e = from_joint_torques(Log(t, q=q, dq=moving.dq, ddq=moving.ddq, tau=tau), LWR)
    assert len(e.signals) == 399
    np.testing.assert_array_equal(np.flatnonzero(~e.valid), [69])
    np.testing.assert_array_equal(np.flatnonzero(e.signals.dt == 0.0), [0, 199])


def test_an_axis_without_a_robot_is_named_by_its_units() -> None:
    t = np.linspace(0.0, 2.0, 300)
    log = Log(t, q=np.sin(t)[:, None], tau=np.cos(t)[:, None])
    rigs = [Rig.parse({"columns": {"q1": {"column": "q", "unit": unit}}}) for unit in ("deg", "mm")]
    turns, slides = (from_joint_torques(log, rig) for rig in rigs)
    assert turns.layout == Layout(("tau1",), "joints")
    assert slides.layout == Layout(("force1",), "joints")
    assert slides.layout.units == ("N",)


def test_without_torques_or_positions() -> None:
    t = np.linspace(0.0, 1.0, 100)
    with pytest.raises(kinid.InputError, match=r"tau1…tauN"):
        from_joint_torques(Log(t, q=np.zeros((100, 1))), Rig.parse({}))
    with pytest.raises(kinid.InputError, match=r"q1…qN"):
        from_joint_torques(Log(t, tau=np.zeros((100, 1))), Rig.parse({}))


# ---- measured -------------------------------------------------------------------------------------------------------


def least_squares(
    model: Model, e: Experiment, held_out: Experiment | None = None, band: Callable[[Array], Array] = lambda x: x
) -> tuple[float, dict[str, float]]:
    """Plain linear least squares on predicted columns: rms of what is left over all channels, and the values."""
    left, values = by_channel(model, e, held_out, band)
    return float(np.sqrt(np.mean(left**2))), values


def by_channel(
    model: Model, e: Experiment, held_out: Experiment | None = None, band: Callable[[Array], Array] = lambda x: x
) -> tuple[Array, dict[str, float]]:
    """The same, rms of each channel; `band` passes readings and columns alike."""
    named = model.parameters(e.layout)

    def problem(e: Experiment) -> tuple[Array, Array]:
        zero = model.predict(e.signals, np.zeros(len(named)))
        columns = [band(model.predict(e.signals, unit) - zero) for unit in np.eye(len(named))]
        return np.stack(columns, axis=-1) if columns else np.zeros((*zero.shape, 0)), band(e.measured - zero)

    columns, y = problem(e)
    values = np.linalg.lstsq(columns.reshape(y.size, len(named)), y.ravel(), rcond=None)[0]
    columns, y = problem(held_out or e)
    return np.sqrt(np.mean((y - columns @ values) ** 2, axis=1)), dict(zip(named, values.tolist()))


def shown(name: str, figures: Sequence[Any]) -> None:
    print(f"\n{name}: " + " → ".join(str(np.round(figure, 2)) for figure in figures))


FRICTION = ("joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset")


@pytest.mark.real
def test_a_linear_drive(real_data: Path) -> None:
    """EMPS (Janot, Gautier, Brunot 2019), readings and columns compared at 100 Hz: above 50 Hz acts the controller
    alone.
    """
    force = {"column": "vir", "unit": "N", "scale": 35.15065}
    rig = Rig.parse({"columns": {"q1": {"column": "qm", "unit": "m"}, "tau1": force}})
    log = kinid.read(real_data / "drive-friction" / "DATA_EMPS.mat", rig)
    # the encoder's noise of 17 nm lets the drive's motion be seen to 50 Hz
    e = from_joint_torques(log, rig, differentiator=Differentiator(50.0))

    def band(x: Array) -> Array:
        return decimate(x, 10, ftype="fir", zero_phase=True)

    rigid = Model("rigid-body")
    ladder = [rigid, Model("rigid-body", *FRICTION), Model("rigid-body", *FRICTION, "joint-friction-asymmetry")]
    fits = [least_squares(model, e, band=band) for model in ladder]
    shown("drive, N: inertia → + dry, viscous, offset → + direction", [fit[0] for fit in fits])
    shown("  the same at 1 kHz", [least_squares(model, e)[0] for model in ladder])
    assert fits[0][0] == pytest.approx(37.5, abs=0.1)
    assert fits[1][0] <= 2.2
    assert fits[2][0] <= 1.7
    values = fits[2][1]
    # the benchmark's reference: M 95.1 kg, F_v 203.5 N·s/m, F_c 20.4 N, offset −3.2 N (without direction)
    assert values["rigid-body.inertia"] == pytest.approx(95.1, rel=0.01)
    assert values["joint-viscous-friction.viscous"] == pytest.approx(203.5, rel=0.01)
    assert values["joint-coulomb-friction.coulomb"] == pytest.approx(20.4, rel=0.02)
    assert fits[1][1]["joint-torque-offset.offset"] == pytest.approx(-3.2, abs=0.1)


@pytest.mark.real
def test_an_arm_with_torque_sensors(real_data: Path) -> None:
    """A KUKA LWR4+ in the air, fitted on one log and tested on the other; mean of both ways [N·m], joint by joint."""
    logs = []
    for name in ("measurements_1.npz", "measurements_2.npz"):
        with np.load(real_data / "lwr4plus-motion" / name, allow_pickle=False) as file:
            t, q, dq, ddq, tau = (file[key] for key in ("times", "positions", "velocities", "accelerations", "torques"))
        logs.append(
            from_joint_torques(Log(t - t[0], q=q, dq=dq, ddq=ddq, tau=tau), LWR, differentiator=Differentiator())
        )

    def both_ways(*effects: str) -> Array:
        model = Model("rigid-body", *effects)
        return np.mean([by_channel(model, a, b)[0] for a, b in (logs, logs[::-1])], axis=0)

    rigid, friction = both_ways(), both_ways("joint-torque-offset", "joint-coulomb-friction")
    more = both_ways("joint-torque-offset", "joint-coulomb-friction", "joint-viscous-friction")
    rotor = both_ways("joint-torque-offset", "joint-coulomb-friction", "rotor-inertia")
    shown("arm, N·m: rigid body → + offset, dry friction → + viscous | + rotor inertia", [rigid, friction, more, rotor])
    np.testing.assert_allclose(rigid, [1.28, 0.75, 0.56, 0.77, 1.28, 0.67, 0.28], atol=0.006)
    assert (friction <= [0.37, 0.43, 0.26, 0.36, 0.28, 0.21, 0.25]).all()


@pytest.mark.real
def test_a_motor_current(real_data: Path) -> None:
    """The first joint of an upright UR10e, which nothing pulls on: its current [A] by an unknown inertia and
    friction.
    """
    rig = Rig.parse(
        {
            "columns": {
                "t": {"column": 0},
                "q1": {"column": 1},
                "dq1": {"column": 7},
                "tau1": {"column": 13, "unit": "A"},
            }
        }
    )
    e = from_joint_torques(
        kinid.read(real_data / "ur10e-motion" / "joint_1.csv", rig), rig, differentiator=Differentiator()
    )
    fits = [least_squares(Model("rigid-body", *FRICTION[:k]), e)[0] for k in range(3)]
    shown("current, A: reading → inertia → + dry → + viscous", [np.sqrt(np.mean(e.measured**2)), *fits])
    assert fits[0] > 2.5
    assert fits[1] <= 0.8
    assert fits[2] <= 0.3
