"""Tool, sensor and acquisition effects against Pinocchio, SciPy and closed forms that share no code with them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import kinid
from kinid import Model
from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.data.rig import WRENCH, Rig
from kinid.effects import Layout, Motion, Signals
from kinid.effects.mains_hum import MainsHum
from kinid.effects.quantization import Quantization
from kinid.effects.saturation import Saturation
from kinid.effects.sensor_crosstalk import SensorCrosstalk
from kinid.modeling.contract import Case
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_wrench
from kinid.modeling.reference_motions import reference_motion
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]
POSE = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])
TOOL = {"mass": 0.6, "com": [0.01, -0.02, 0.05], "inertia": [2e-3, 1.5e-3, 1e-3, 1e-4, -2e-4, 3e-4]}
ROBOT = {"robot": {"model": "lwr4plus"}}
TESTER = ("normal_force", "tangential_force1", "tangential_force2")


def signals(t: Array, depth: Array, rate: Array | None = None, kind: str = "contact", **more: Any) -> Signals:
    """Signals with this depth, and no slip unless it is given."""
    pair = np.zeros((2, len(t)))
    layout = Layout(TESTER if kind == "contact" else WRENCH, kind)
    rate = np.gradient(depth, t) if rate is None else rate
    slips = more.pop("slip", pair), more.pop("slip_rate", pair)
    return Signals(layout, t, np.diff(t, prepend=t[0]), depth, rate, *slips, **more)


# ---- tool -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shaken(swing: Callable[..., Any]) -> tuple[Log, tuple[Array, Array, Array]]:
    """An arm in the air, with exact derivatives; the wrench is for the tests to fill in."""
    t = np.linspace(0.0, 2.0, 300)
    motion = swing(POSE, seed=3, size=0.5, speed=9.0)(t)
    return Log(t, q=motion[0], dq=motion[1], ddq=motion[2], wrench=np.zeros((300, 6))), motion


def test_no_tool_turns_more_easily_than_nothing(shaken: tuple[Log, tuple[Array, ...]]) -> None:
    """The smallest moment may come out a little negative; one that is larger than all others can't."""
    seen = from_wrench(shaken[0], Rig.parse({**ROBOT, "tool": TOOL}), differentiator=Differentiator()).signals
    inertia = kinid.effects.get("tool-inertia")

    def why(*moments: float) -> str:
        return inertia.implausible({f"inertia[{a}{a}]": value for a, value in zip("xyz", moments)}, {}, seen)

    assert why(-1e-3, 1e-3, 0.0) == ""
    assert why(-2.2e-3, 1e-3, 0.0) == ""
    assert "moments" in why(-9e-3, -4e-3, 0.0)


@pytest.mark.parametrize(
    "order", [("tool-mass", "tool-com", "tool-inertia"), ("tool-com", "tool-inertia", "tool-mass")]
)
def test_tool_effects_make_one_rigid_body_of_another(
    order: tuple[str, ...], shaken: tuple[Log, tuple[Array, ...]], weighed: Callable[..., Array]
) -> None:
    """From the rig's tool to another one of other mass, centre and inertia: exact, in any order (Pinocchio's RNEA)."""
    log, motion = shaken
    stated = Rig.parse({**ROBOT, "tool": TOOL})
    more = {"mass": 0.23, "com": [0.004, 0.03, -0.02], "inertia": [5e-4, -2e-4, 3e-4, 5e-5, 1e-4, -1e-4]}
    true = Rig.parse(
        {
            **ROBOT,
            "tool": {
                "mass": TOOL["mass"] + more["mass"],
                "com": np.add(TOOL["com"], more["com"]).tolist(),
                "inertia": np.add(TOOL["inertia"], more["inertia"]).tolist(),
            },
        }
    )
    values = {"tool-mass.mass": more["mass"]}
    values |= {f"tool-com.com[{axis}]": d for axis, d in zip("xyz", more["com"])}
    entries = ("xx", "yy", "zz", "xy", "xz", "yz")
    values |= {f"tool-inertia.inertia[{entry}]": d for entry, d in zip(entries, more["inertia"])}
    experiment = from_wrench(log, stated, differentiator=Differentiator())  # the chain behind logged motion
    predicted = Model(*order).predict(experiment.signals, values)
    np.testing.assert_allclose(predicted.T, weighed(true, Robot.load(true), *motion), atol=1e-10)  # rounding of RNEA


def test_without_a_tool_in_the_rig_the_mass_hangs_on_the_sensors_origin(
    shaken: tuple[Log, tuple[Array, ...]], weighed: Callable[..., Array]
) -> None:
    log, motion = shaken
    experiment = from_wrench(log, Rig.parse(ROBOT), differentiator=Differentiator())
    true = Rig.parse({**ROBOT, "tool": {"mass": 0.8, "com": [0.0, 0.01, 0.06]}})
    values = {"tool-mass.mass": 0.8, "tool-com.com[y]": 0.01, "tool-com.com[z]": 0.06}
    predicted = Model("tool-mass", "tool-com").predict(experiment.signals, values)
    np.testing.assert_allclose(predicted.T, weighed(true, Robot.load(true), *motion), atol=1e-10)


# ---- tip and structure ----------------------------------------------------------------------------------------------


def moved_tip(robot: Robot, d: Array) -> Robot:
    """The same arm with the tip displaced in sensor axes."""
    model = robot.model.copy()
    frame = model.getFrameId(robot.tip_frame)
    into = robot.frame(robot.sensor_frame or "").placement.rotation
    placement = model.frames[frame].placement
    model.frames[frame].placement = pin.SE3(placement.rotation, placement.translation + into @ d)
    return Robot(
        robot.name, model, robot.joint_names, robot.sensor_frame, robot.tip_frame, robot.gravity, robot.compliance
    )


def test_tip_offset_is_an_arm_with_another_tip(swing: Callable[..., Any], weighed: Callable[..., Array]) -> None:
    t, d = np.linspace(0.0, 2.0, 200), np.array([3e-3, -2e-3, 4e-3])
    q, dq, ddq = swing(POSE, seed=5, size=0.3, speed=6.0)(t)
    surface = {"point": [0.6, 0.0, 0.25], "normal": [0.2, -0.1, 1.0], "tangent": [1, 0.3, 0]}
    rig = Rig.parse({**ROBOT, "tool": TOOL, "surface": surface})
    robot = Robot.load(rig)
    log = Log(t, q=q, dq=dq, ddq=ddq, wrench=weighed(rig, robot, q, dq, ddq))
    here, there = from_wrench(log, rig, robot=robot), from_wrench(log, rig, robot=moved_tip(robot, d))
    assert (there.signals.depth > 0).any()
    touch = contact_series(log, rig, robot=moved_tip(robot, d))
    s = here.signals.fresh()
    Model("tip-offset").effects[0].geometry(s, d)
    np.testing.assert_allclose(s.depth, touch.depth, atol=1e-12)
    np.testing.assert_allclose(s.depth_rate, touch.depth_rate, atol=1e-11)
    np.testing.assert_allclose(s.slip, [touch.slip1, touch.slip2], atol=1e-12)
    np.testing.assert_allclose(s.slip_rate, [touch.slip_rate1, touch.slip_rate2], atol=1e-11)
    model = Model("hooke", "coulomb-friction")
    here.signals.dither = there.signals.dither = 0.0  # of two tips' slips noise is seen differently
    values = {f"tip-offset.offset[{axis}]": v for axis, v in zip("xyz", d)}
    expected = model.predict(there.signals, {})
    np.testing.assert_allclose((model + "tip-offset").predict(here.signals, values), expected, atol=1e-9)


COMPLIANCE = "structural-compliance.compliance"


def test_structural_compliance_is_a_spring_in_series() -> None:
    """Hooke's law behind an arm of compliance C is a spring k/(1 + C k)."""
    t = np.linspace(0.0, 3.0, 1500)
    depth = 4e-3 * np.sin(4.0 * t)
    k, c = 8000.0, 6e-5
    predicted = Model("hooke", "structural-compliance").predict(
        signals(t, depth), {"hooke.stiffness": k, COMPLIANCE: c}
    )
    np.testing.assert_allclose(predicted[0], np.maximum(depth, 0.0) * k / (1.0 + c * k), atol=1e-12)


def test_structural_compliance_slows_the_depth_too() -> None:
    """Spring and damper behind a compliant arm: N = k (δ − C N) + b (δ̇ − C Ṅ), integrated by SciPy."""
    k, b, c = 3000.0, 60.0, 8e-5
    t = np.linspace(0.0, 4.0, 4001)

    def depth(at: Any) -> Any:
        return 6e-3 + 2e-3 * np.sin(6.0 * at)

    def rate(at: Any) -> Any:
        return 12e-3 * np.cos(6.0 * at)

    solved = solve_ivp(
        lambda at, n: (k * depth(at) + b * rate(at) - (1 + k * c) * n) / (b * c),
        (0, 4),
        [15.0],
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
        method="Radau",
    )
    s = signals(t, depth(t), rate(t))
    values = {"hooke.stiffness": k, "viscous-damping.damping": b, COMPLIANCE: c}
    predicted = Model("hooke", "viscous-damping", "structural-compliance").predict(s, values)
    inner = slice(200, None)  # both have forgotten where they began
    # Ṅ is half a sample old: b C N̈ h/2 with N̈ of 36 · 5 N/s² is 4e-4 N
    np.testing.assert_allclose(predicted[0, inner], solved.y[0, inner], atol=5e-4)
    stiff = Model("hooke", "viscous-damping").predict(s, {key: values[key] for key in list(values)[:2]})
    assert np.abs(stiff[0, inner] - solved.y[0, inner]).max() > 1.0


@pytest.mark.parametrize(
    ("law", "n", "k"), [("hertz", 1.5, 6e4), ("hooke", 1.0, 9000.0), ("hunt-crossley", 0.7, 500.0)]
)
def test_structural_compliance_of_laws_without_memory(law: str, n: float, k: float) -> None:
    """Sample by sample the root of N = k (δ − C N)ⁿ, by Brent's method."""
    t = np.linspace(0.0, 1.0, 50)
    depth, c = np.linspace(-1e-3, 8e-3, 50), 2e-4
    values = {f"{law}.stiffness": k, COMPLIANCE: c} | ({"hunt-crossley.exponent": n} if law == "hunt-crossley" else {})
    predicted = Model(law, "structural-compliance").predict(signals(t, depth), values)
    for got, d in zip(predicted[0], depth):
        expected = brentq(lambda f, d=d: f - k * max(d - c * f, 0.0) ** n, 0.0, d / c, xtol=1e-14) if d > 0 else 0.0
        assert got == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("compliance", [1e-6, 1e-4, 1e-3])
def test_behind_an_arm_a_material_with_memory_still_obeys_its_own_law(compliance: float) -> None:
    """The law without the arm, fed with the depth that the predicted force leaves, gives that force again."""
    t = np.linspace(0.0, 4.0, 4001)
    depth, along = 2e-3 * np.sin(6.0 * t), 12e-3 * np.cos(6.0 * t)
    model = Model("hertz", "relaxation", "hysteresis", "hunt-crossley-damping")
    values = {
        "hertz.stiffness": 1.2e5,
        "relaxation.ratio": 0.5,
        "relaxation.time-constant": 0.2,
        "hunt-crossley-damping.damping": 1.5,
    }
    force = (model + "structural-compliance").predict(signals(t, depth, along), {**values, COMPLIANCE: compliance})[0]
    rate = along - compliance * np.diff(force, prepend=force[0]) / 1e-3
    again = model.predict(signals(t, depth - compliance * force, rate), values)[0]
    print(
        f"compliance {compliance:g} m/N: {force.max():.3g} N, law and arm disagree by "
        f"{np.abs(again - force).max():.2g} N"
    )
    np.testing.assert_allclose(again, force, atol=1e-9 * force.max())


def test_a_dashpot_does_not_jump_at_touch_behind_an_arm_that_gives_way() -> None:
    """Both springs are undeflected at touch: the force begins at zero, and grows within C c as the dashpot takes
    over.
    """
    t = np.linspace(0.0, 0.3, 3001)
    depth = 20e-3 * (t - 0.05)
    values = {"kelvin-voigt.stiffness": 1000.0, "kelvin-voigt.damping": 50.0}
    stiff = Model("kelvin-voigt").predict(signals(t, depth, np.full_like(t, 20e-3)), values)[0]
    soft = Model("kelvin-voigt", "structural-compliance").predict(
        signals(t, depth, np.full_like(t, 20e-3)), {**values, COMPLIANCE: 3e-4}
    )[0]
    assert np.diff(stiff).max() > 0.9
    # N/C = δ at first: a tenth of a millisecond at 20 mm/s over 3e-4 m/N
    assert np.diff(soft).max() < 1.05 * 20e-3 * 1e-4 / 3e-4


@pytest.mark.parametrize(
    ("amplitude", "length", "compliance"),
    [(0.1, 1e-5, 2e-5), (0.5, 1e-4, 2e-5), (0.1, 1e-4, 1e-4), (0.5, 1e-3, 1e-4), (1.0, 1e-3, 1e-4)],
)
def test_behind_an_arm_a_loop_still_obeys_its_own_law(amplitude: float, length: float, compliance: float) -> None:
    """Loops are stiff at their ends, a F_e/ℓ beside the material's own stiffness: of some 4 N, 2e4 N/m beside 800."""
    t = np.arange(0, 8, 2e-3)
    depth = 4e-3 * np.sin(0.8 * t) + 1e-3 * np.sin(3.1 * t)
    along = 3.2e-3 * np.cos(0.8 * t) + 3.1e-3 * np.cos(3.1 * t)
    model = Model("hooke", "hysteresis")
    values = {"hooke.stiffness": 800.0, "hysteresis.ratio": amplitude, "hysteresis.length": length}
    force = (model + "structural-compliance").predict(signals(t, depth, along), {**values, COMPLIANCE: compliance})[0]
    rate = along - compliance * np.diff(force, prepend=force[0]) / 2e-3
    again = model.predict(signals(t, depth - compliance * force, rate), values)[0]
    assert force.max() > 2.0
    assert np.abs(again - force).max() < 1e-6 * force.max()


@pytest.mark.parametrize(
    ("extra", "values"),
    [
        (("adhesion",), {"adhesion.force": 0.38, "adhesion.length": 1.1e-3}),
        (("adhesion", "hysteresis"), {"adhesion.force": 0.31, "hysteresis.ratio": 0.3, "hysteresis.length": 2e-4}),
        (
            ("stress-softening", "hysteresis"),
            {
                "stress-softening.ratio": 0.3,
                "stress-softening.length": 1e-4,
                "hysteresis.ratio": 0.1,
                "hysteresis.length": 2e-3,
            },
        ),
    ],
)
def test_behind_a_soft_arm_bonds_softening_and_loops_under_noise_obey_their_laws(
    extra: tuple[str, ...], values: dict[str, float]
) -> None:
    """Noise of the depth turns every loop around at every sample while depth is held, and moves what was the
    deepest.
    """
    t = np.arange(0, 10, 2e-3)
    rng = np.random.default_rng(11)
    depth = 1.5e-3 * np.sin(0.8 * t) ** 3 + 0.4e-3 + 3e-6 * rng.standard_normal(len(t))
    along = np.gradient(depth, t)
    model, c = Model("hooke", *extra), 4e-4
    values = {"hooke.stiffness": 1300.0, **values}
    moving = signals(t, depth, along)
    force = (model + "structural-compliance").predict(moving, {**values, COMPLIANCE: c})[0]
    rate = along - c * np.diff(force, prepend=force[0]) / 2e-3
    again = model.predict(signals(t, depth - c * force, rate), values)[0]
    off = float(np.abs(again - force).max()) / force.max()
    print(f"{' + '.join(extra)}: law and arm disagree by {off:.2g} of the greatest force")
    assert force.max() > 1.0
    assert off < 1e-8


def test_where_a_bond_lets_go_of_a_soft_arm_at_once_no_more_than_that_moment_is_open() -> None:
    """F_a/ℓ five times 1/C: while the bond tears law and arm balance at several forces; all other samples agree."""
    t = np.arange(0, 10, 2e-3)
    depth = 1.5e-3 * np.sin(0.8 * t) ** 3 + 0.2e-3
    along = np.gradient(depth, t)
    model, c = Model("hooke", "adhesion"), 1e-3
    values = {"hooke.stiffness": 1300.0, "adhesion.force": 0.5, "adhesion.length": 1e-4}
    force = (model + "structural-compliance").predict(signals(t, depth, along), {**values, COMPLIANCE: c})[0]
    rate = along - c * np.diff(force, prepend=force[0]) / 2e-3
    again = model.predict(signals(t, depth - c * force, rate), values)[0]
    off = np.abs(again - force) / force.max()
    print(f"{(off > 1e-6).sum()} of {len(t)} samples are open")
    assert (off > 1e-6).sum() <= 10


def test_compliance_is_found_without_bias_from_a_noisy_force() -> None:
    """Driven by a measured force with 0.1 N of noise the estimate would be 2.1e-4 for 3e-4 m/N."""
    truth, found = 3e-4, []
    t = np.arange(3000) * 2e-3
    depth = 3e-3 + 3.5e-3 * np.sin(2.1 * t) + 1e-3 * np.sin(11.0 * t)
    model = Model("hertz", "structural-compliance")
    s = signals(t, depth)
    clean = model.predict(s, {"hertz.stiffness": 2e4, COMPLIANCE: truth})
    for seed in range(6):
        noisy = clean + np.random.default_rng(seed).normal(scale=0.1, size=clean.shape)
        every = np.ones(len(t), np.bool_)
        fit = model.fit(
            Experiment(s, noisy, every, np.full(3, 0.1), None, depth > 0, np.arange(len(t))), held_out=False
        )
        found.append((fit["compliance"].value, fit.solution.standard_errors[1]))
    values, errors = np.array(found).T
    print("compliance: " + ", ".join(f"{v:.4g} ± {e:.2g}" for v, e in found) + f" m/N; truth {truth:g}")
    # the mean of six has a standard error of one over their root
    assert abs(values.mean() - truth) < 3.0 * errors.mean() / np.sqrt(6)
    # calibration is open inside its tolerance (surface, bias, clock); 0.03 without that
    assert errors.mean() < 0.05 * truth


def test_behind_a_linear_spring_compliance_and_stiffness_are_one_and_it_is_said() -> None:
    t = np.arange(3000) * 2e-3
    depth = 3e-3 + 3.5e-3 * np.sin(2.1 * t)
    s = signals(t, depth)
    noisy = Model("hooke").predict(s, {"hooke.stiffness": 700.0}) + np.random.default_rng(0).normal(
        scale=0.05, size=(3, 3000)
    )
    every = np.ones(len(t), np.bool_)
    fit = Model("hooke", "structural-compliance").fit(
        Experiment(s, noisy, every, np.full(3, 0.05), None, depth > 0, np.arange(len(t)))
    )
    print(fit.warnings)
    for name in ("stiffness", "compliance"):
        assert np.isinf(fit[name].high)
        assert any(f"{fit[name].name}" in warning and "not identified" in warning for warning in fit.warnings)
    k, c = fit["stiffness"].value, fit["compliance"].value
    assert k / (1 + c * k) == pytest.approx(700.0, rel=2e-3)  # 0.05 N of 4.5, over 3000 samples


def test_what_follows_from_the_log_alone_is_kept_as_long_as_the_log() -> None:
    from kinid.effects import JointMotion
    from kinid.effects._derived import _made

    t = np.linspace(0.0, 1.0, 300)
    before = len(_made)
    none, pair = np.zeros(300), np.zeros((2, 300))
    q = np.sin(9.0 * t)[None]
    s = Signals(
        Layout(("tau1",), "joints"),
        t,
        np.diff(t, prepend=0.0),
        none,
        none,
        pair,
        pair,
        joints=JointMotion(q, 9 * np.cos(9.0 * t)[None], -81 * q, np.zeros((1, 300)), known=False),
    )
    model = Model("rigid-body", "joint-elasticity")
    first = model.predict(s, {"joint-elasticity.elasticity": 1e-5})
    assert len(_made) == before + 1  # the second derivative of the torque
    np.testing.assert_array_equal(model.predict(s, {"joint-elasticity.elasticity": 1e-5}), first)
    assert len(_made) == before + 1
    del s, q
    assert len(_made) == before


# ---- sensor ---------------------------------------------------------------------------------------------------------


def test_misalignment_reads_in_turned_axes() -> None:
    s = reference_motion(Motion.WRENCH)
    clean = Model("hooke").predict(s, {})
    phi = np.array([0.3, -0.5, 0.2])
    values = {f"sensor-misalignment.rotation[{axis}]": v for axis, v in zip("xyz", phi)}
    read = Model("hooke", "sensor-misalignment").predict(s, values)
    into = Rotation.from_rotvec(phi).inv()
    expected = np.concatenate([into.apply(clean[:3].T).T, into.apply(clean[3:].T).T])
    np.testing.assert_allclose(read, expected, atol=1e-12)


def test_misalignment_in_the_contact_frame_whatever_the_order_of_its_channels() -> None:
    t = np.linspace(0.0, 1.0, 40)
    slip = np.stack([np.sin(9 * t), np.cos(7 * t)]) * 0.01
    s = signals(t, 2e-3 + 1e-3 * np.sin(5 * t), slip=slip, slip_rate=np.gradient(slip, t, axis=1))
    model = Model("hooke", "coulomb-friction")
    phi = np.array([0.02, -0.04, 0.3])
    names = [f"sensor-misalignment.rotation[{axis}]" for axis in ("tangent1", "tangent2", "normal")]
    for channels in (TESTER, TESTER[::-1]):
        one = dataclasses.replace(s, layout=Layout(channels, "contact"))
        rows = [channels.index(name) for name in ("tangential_force1", "tangential_force2", "normal_force")]
        clean = model.predict(one, {})[rows]
        read = (model + "sensor-misalignment").predict(one, dict(zip(names, phi)))[rows]
        np.testing.assert_allclose(read, Rotation.from_rotvec(-phi).apply(clean.T).T, atol=1e-12)
    alone = Layout(("normal_force",), "contact")
    assert (model + "sensor-misalignment").parameters(alone).keys() == model.parameters(alone).keys()


def test_crosstalk_is_a_matrix_without_its_diagonal() -> None:
    case = Case.of(SensorCrosstalk)
    found = dict(zip((f"sensor-crosstalk.{name}" for name in case.own), case.values[case.places]))
    model = Model("hooke", "coulomb-friction")
    matrix = np.eye(6)
    for name, value in found.items():
        row, column = name.split("[")[1].rstrip("]").split(",")
        matrix[WRENCH.index(row), WRENCH.index(column)] = value
    assert (matrix != 0).sum() == 36
    read = (model + "sensor-crosstalk").predict(case.signals, found)
    np.testing.assert_allclose(read, matrix @ model.predict(case.signals, {}), atol=1e-12)


def test_crosstalk_of_three_forces_and_of_one() -> None:
    model = Model("hooke", "sensor-crosstalk")
    assert len(model.parameters(Layout(TESTER, "contact"))) == 1 + 6
    assert len(model.parameters(Layout(TESTER[:1], "contact"))) == 1
    units = {p.unit for p in model.parameters(Layout(WRENCH, "wrench")).values()}
    assert units == {"N/m", "1", "m", "1/m"}


def test_gain_scales_weight_and_contact_alike() -> None:
    s = reference_motion(Motion.WRENCH)
    clean = Model("hooke").predict(s, {})
    np.testing.assert_allclose(
        Model("hooke", "sensor-gain").predict(s, {"sensor-gain.gain": -0.2}), 0.8 * clean, rtol=1e-14
    )


def test_drift_is_per_minute() -> None:
    t = np.linspace(0.0, 120.0, 30)
    s = signals(t, np.full(30, -1.0))
    read = Model("hooke", "sensor-drift").predict(s, {"sensor-drift.drift[normal_force]": 0.7})
    np.testing.assert_allclose(read, [0.7 * t / 60.0, 0 * t, 0 * t], atol=1e-15)


# ---- acquisition ----------------------------------------------------------------------------------------------------


def poked(t: Array, f: Callable[[Any], Any]) -> Signals:
    """Signals for which `hooke` of 1 N/m reads f(t) ≥ 0."""
    return signals(t, f(t))


def uneven(n: int = 900, seed: int = 0) -> Array:
    return np.cumsum(np.random.default_rng(seed).uniform(0.5e-3, 2e-3, n))


def test_lag_is_a_first_order_filter_that_begins_in_balance() -> None:
    t, tau = uneven(), 0.02

    def force(at: Any) -> Any:
        return 2.0 + np.sin(30.0 * at) * np.cos(7.0 * at)

    read = Model("hooke", "sensor-lag").predict(
        poked(t, force), {"hooke.stiffness": 1.0, "sensor-lag.time-constant": tau}
    )
    course = CubicHermiteSpline(t, force(t), np.gradient(force(t), t))
    solved = solve_ivp(
        lambda at, y: (course(at) - y) / tau,
        (t[0], t[-1]),
        [force(t[0])],
        t_eval=t,
        rtol=1e-9,
        atol=1e-11,
        max_step=5e-4,
    )
    np.testing.assert_allclose(
        read[0], solved.y[0], rtol=0, atol=1e-6
    )  # of the integrator, at the corners of the slopes


def test_lag_begins_anew_after_a_gap() -> None:
    t = uneven()
    s = poked(t, lambda at: 1.0 + (at > t[400]))
    dt = s.dt.copy()
    dt[401] = 0.0
    values = {"hooke.stiffness": 1.0, "sensor-lag.time-constant": 0.5}
    read = Model("hooke", "sensor-lag").predict(dataclasses.replace(s, dt=dt), values)
    np.testing.assert_array_equal(read[0], s.depth)  # the step falls into the gap, and both sides are in balance


@pytest.mark.parametrize("late", [0.0137, -0.0093, 0.25])
def test_time_offset_reads_what_was(late: float) -> None:
    t = uneven()

    def force(at: Any) -> Any:
        return 2.0 + np.sin(15.0 * at)

    read = Model("hooke", "time-offset").predict(poked(t, force), {"hooke.stiffness": 1.0, "time-offset.delay": late})
    there = (t - late > t[2]) & (t - late < t[-3])
    assert there.sum() > 600
    # cubic Hermite with slopes of second order: h³ f''' / 24 with steps of up to 2 ms is 1.5e-6
    np.testing.assert_allclose(read[0, there], force(t - late)[there], atol=3e-6)
    held = t - late < t[0] if late > 0 else t - late > t[-1]
    assert held.any()
    np.testing.assert_array_equal(read[0, held], force(t[0] if late > 0 else t[-1]))


def test_time_offset_has_a_continuous_derivative() -> None:
    """Where a reading's time passes a sample, the slope over the delay is the same on both sides; a straight line
    breaks.
    """
    t = np.arange(400) * 1e-3
    s = poked(t, lambda at: 2.0 + np.sin(40.0 * at))
    model = Model("hooke", "time-offset")

    def read(late: float) -> Array:
        return model.predict(s, {"hooke.stiffness": 1.0, "time-offset.delay": late})[0, 20:-20]

    at, h = 5e-3, 1e-7
    before, after = (read(at) - read(at - h)) / h, (read(at + h) - read(at)) / h
    # curvature makes them differ by 1600·h = 2e-4; straight lines would by 1600·1e-3 = 1.6
    np.testing.assert_allclose(before, after, atol=1e-3)


def test_time_offset_stays_within_its_piece() -> None:
    t = np.concatenate([np.arange(300), np.arange(400, 700)]) * 1e-3
    s = poked(t, lambda at: 1.0 + 5.0 * (at > 0.35))
    dt = s.dt.copy()
    dt[300] = 0.0
    for late in (0.02, -0.02):
        values = {"hooke.stiffness": 1.0, "time-offset.delay": late}
        read = Model("hooke", "time-offset").predict(dataclasses.replace(s, dt=dt), values)
        np.testing.assert_array_equal(read[0], s.depth)


def test_saturation_clips_each_channel_at_its_limit() -> None:
    case = Case.of(Saturation)
    clean = Model("hooke").predict(case.signals, {})
    for row, limit, channel in zip(case.reading, case.values[case.places], clean):
        assert np.abs(row).max() == limit
        inside = np.abs(channel) < limit
        assert 0 < inside.sum() < len(inside)
        np.testing.assert_array_equal(row[inside], channel[inside])


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_readings_pile_up_where_noise_comes_behind_the_end_of_the_range(noise: float) -> None:
    """… and not where a load comes to rest by itself. An exact top is read off; a pile is where the search begins."""
    t, rng, effect = np.arange(10_000) * 2e-3, np.random.default_rng(1), Saturation()
    landing = np.clip(t % 4, 0, 1) - np.clip(t % 4 - 2.5, 0, 1)
    loads = np.stack(
        [20 * np.sin(2 * t), 20 * landing**3 * (10 - 15 * landing + 6 * landing**2), -12 - 8 * np.sin(2 * t)]
    )
    white = noise * rng.standard_normal(loads.shape)
    cut = np.clip(loads, -18.0, 18.0) + white
    np.testing.assert_allclose(effect.piles(cut), 18.0, atol=0.2 * noise)
    assert np.isnan(effect.piles(loads + white)[[0, 2]]).all()
    shown, search = effect.detected(cut)
    assert (shown == 1e12).all()
    assert np.isnan(search).all()
    exact = np.clip(loads + white, -18.0, 18.0)
    np.testing.assert_array_equal(effect.detected(exact), np.full((2, 3), 18.0))
    s = dataclasses.replace(signals(t, landing), measured=cut)
    (start,) = effect.initial_guesses(s)
    np.testing.assert_allclose(start, 18.0, atol=0.2 * noise)


def test_quantization_reads_whole_steps() -> None:
    case = Case.of(Quantization)
    steps = dict(zip(case.own, case.values[case.places])) | {"step[fx]": 0.0}
    clean = Model("hooke").predict(case.signals, {})
    read = Model("hooke", "quantization").predict(
        case.signals, {f"quantization.{name}": value for name, value in steps.items()}
    )
    np.testing.assert_array_equal(read[0], clean[0])
    for row, channel, step in zip(read[1:], clean[1:], list(steps.values())[1:]):
        np.testing.assert_allclose(row / step, np.round(row / step), atol=1e-9)
        assert np.abs(row - channel).max() <= 0.5 * step * (1 + 1e-9)


def test_hum_is_a_line_at_its_frequency() -> None:
    t = np.arange(5000) * 1e-3
    s = signals(t, np.full(5000, -1.0))
    hum = MainsHum(frequency=60.0, harmonics=(1, 3))
    values = {
        "mains-hum.sine[normal_force,1]": 0.3,
        "mains-hum.cosine[normal_force,1]": 0.4,
        "mains-hum.cosine[tangential_force1,3]": 0.2,
    }
    read = Model("hooke", hum).predict(s, values)
    amplitude = 2.0 * np.abs(np.fft.rfft(read, axis=1)) / 5000
    frequency = np.fft.rfftfreq(5000, 1e-3)
    expected = np.zeros_like(amplitude)
    expected[0, frequency == 60.0], expected[1, frequency == 180.0] = 0.5, 0.2
    np.testing.assert_allclose(amplitude, expected, atol=1e-12)


@pytest.mark.parametrize("line", [49.93, 60.04])
def test_hum_finds_its_own_frequency(line: float) -> None:
    """A model with the effect by its name follows the grid that the log was recorded on."""
    t = np.arange(20_000) * 1e-3
    depth = 1e-3 + 1e-3 * np.sin(2 * np.pi * 1.3 * t)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    force = 800.0 * np.maximum(depth, 0.0) + 0.1 * np.sin(2 * np.pi * line * t + 1.0) + noise
    touch = kinid.contact_series(kinid.Log(t=t, contact={"depth": depth, "normal_force": force}), kinid.Rig())
    fit = Model("hooke", "mains-hum").fit(touch)
    size = np.hypot(fit["sine[normal_force,1]"].value, fit["cosine[normal_force,1]"].value)
    assert size == pytest.approx(0.1, rel=0.03)  # its noise is 0.2 %; the search's last step blurs it by less
    assert fit.error.held_out < 1.05 * 0.02
