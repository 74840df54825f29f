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
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from kinid.contact import contact_series
from kinid.effects import Layout, SensorMotion, Signals
from kinid.effects.mains_hum import MainsHum
from kinid.experiment import from_wrench
from kinid.log import Log
from kinid.model import Model
from kinid.rig import WRENCH, Rig
from kinid.robot import Robot

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


@pytest.mark.parametrize("order", [("tool-mass", "tool-com", "tool-inertia"), ("tool-com", "tool-inertia", "tool-mass")])
def test_tool_effects_make_one_rigid_body_of_another(
    order: tuple[str, ...], shaken: tuple[Log, tuple[Array, ...]], weighed: Callable[..., Array]
) -> None:
    """From the rig's tool to another one of other mass, centre and inertia: exact, in any order (Pinocchio's RNEA)."""
    log, motion = shaken
    stated = Rig.parse({**ROBOT, "tool": TOOL})
    more = {"mass": 0.23, "com": [0.004, 0.03, -0.02], "inertia": [5e-4, -2e-4, 3e-4, 5e-5, 1e-4, -1e-4]}
    true = Rig.parse({**ROBOT, "tool": {
        "mass": TOOL["mass"] + more["mass"], "com": np.add(TOOL["com"], more["com"]).tolist(),
        "inertia": np.add(TOOL["inertia"], more["inertia"]).tolist()}})  # fmt: skip
    values = {"tool-mass.mass": more["mass"]}
    values |= {f"tool-com.com[{axis}]": d for axis, d in zip("xyz", more["com"])}
    entries = ("xx", "yy", "zz", "xy", "xz", "yz")
    values |= {f"tool-inertia.inertia[{entry}]": d for entry, d in zip(entries, more["inertia"])}
    experiment = from_wrench(log, stated)
    predicted = Model(*order).predict(experiment.signals, values)
    np.testing.assert_allclose(predicted.T, weighed(true, Robot.load(true), *motion), atol=1e-10)  # rounding of RNEA


def test_without_a_tool_in_the_rig_the_mass_hangs_on_the_sensors_origin(
    shaken: tuple[Log, tuple[Array, ...]], weighed: Callable[..., Array]
) -> None:
    log, motion = shaken
    experiment = from_wrench(log, Rig.parse(ROBOT))
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
    return Robot(robot.name, model, robot.joint_names, robot.sensor_frame, robot.tip_frame, robot.gravity, robot.compliance)


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
    values = {f"tip-offset.offset[{axis}]": v for axis, v in zip("xyz", d)}
    expected = model.predict(there.signals, {})
    np.testing.assert_allclose((model + "tip-offset").predict(here.signals, values), expected, atol=1e-9)


def test_structural_compliance_is_a_spring_in_series() -> None:
    """With the measured force, Hooke's law and an arm of compliance C are a spring k/(1 + C k)."""
    t = np.linspace(0.0, 3.0, 1500)
    depth = 4e-3 * np.sin(4.0 * t)
    k, c = 8000.0, 6e-5
    measured = np.zeros((3, len(t)))
    measured[0] = np.maximum(depth, 0.0) * k / (1.0 + c * k)
    s = signals(t, depth, measured=measured)
    predicted = Model("hooke", "structural-compliance").predict(s, {"hooke.stiffness": k,
                                                                    "structural-compliance.compliance": c})  # fmt: skip
    np.testing.assert_allclose(predicted, measured, atol=1e-12)


def test_structural_compliance_slows_the_depth_too() -> None:
    """Spring and damper behind a compliant arm: N = k (δ − C N) + b (δ̇ − C Ṅ), integrated by SciPy."""
    k, b, c = 3000.0, 60.0, 8e-5
    t = np.linspace(0.0, 4.0, 4001)

    def depth(at: Any) -> Any:
        return 6e-3 + 2e-3 * np.sin(6.0 * at)

    def rate(at: Any) -> Any:
        return 12e-3 * np.cos(6.0 * at)

    solved = solve_ivp(lambda at, n: (k * depth(at) + b * rate(at) - (1 + k * c) * n) / (b * c), (0, 4), [15.0], t_eval=t,
                       rtol=1e-10, atol=1e-12, method="Radau")  # fmt: skip
    measured = np.zeros((3, len(t)))
    measured[0] = solved.y[0]
    s = signals(t, depth(t), rate(t), measured=measured)
    values = {"hooke.stiffness": k, "viscous-damping.damping": b, "structural-compliance.compliance": c}
    predicted = Model("hooke", "viscous-damping", "structural-compliance").predict(s, values)
    inner = slice(200, -200)
    # the rate of the force is a derivative at 25 Hz of a motion of 1 Hz: 1e-5 of C·Ṅ·b = 0.4 N
    np.testing.assert_allclose(predicted[0, inner], measured[0, inner], atol=1e-4)
    stiff = Model("hooke", "viscous-damping").predict(s, {key: values[key] for key in list(values)[:2]})
    assert np.abs(stiff[0, inner] - measured[0, inner]).max() > 1.0


@pytest.mark.parametrize(("law", "n"), [("hertz", 1.5), ("hooke", 1.0)])
def test_structural_compliance_of_a_motion_that_is_only_planned(law: str, n: float) -> None:
    t = np.linspace(0.0, 1.0, 50)
    depth = np.linspace(-1e-3, 8e-3, 50)
    k, c = (6e4, 2e-4) if law == "hertz" else (9000.0, 2e-4)
    predicted = Model(law, "structural-compliance").predict(
        signals(t, depth), {f"{law}.stiffness": k, "structural-compliance.compliance": c})  # fmt: skip
    for got, d in zip(predicted[0], depth):
        expected = brentq(lambda f, d=d: f - k * max(d - c * f, 0.0) ** n, 0.0, d / c, xtol=1e-14) if d > 0 else 0.0
        assert got == pytest.approx(expected, rel=1e-9)


def test_structural_compliance_takes_the_force_out_of_a_wrench() -> None:
    """Turned into the contact frame, less the tool's load."""
    rng, n = np.random.default_rng(0), 60
    turn = Rotation.random(n, random_state=1).as_matrix()
    contact, load = rng.normal(size=(3, n)), rng.normal(size=(6, n))
    wrench = load + np.concatenate([np.einsum("nji,jn->in", turn, contact), rng.normal(size=(3, n))])
    none = np.zeros((3, n))
    s = signals(np.arange(n) * 1e-3, np.ones(n), np.zeros(n), "wrench", measured=wrench,
                sensor=SensorMotion(turn, np.zeros(3), none, none, none, load, 0.5, np.zeros(3))).fresh()  # fmt: skip
    Model("hooke", "structural-compliance").effects[1].geometry(s, np.array([2e-3]))
    np.testing.assert_allclose(s.depth, 1.0 - 2e-3 * contact[2], atol=1e-12)


def test_what_follows_from_the_log_alone_is_kept_as_long_as_the_log() -> None:
    from kinid.effects._derived import _made

    t = np.linspace(0.0, 1.0, 300)
    before = len(_made)
    s = signals(t, 1e-3 * np.sin(9 * t), measured=np.ones((3, 300)))
    model = Model("hooke", "structural-compliance")
    first = model.predict(s, {"structural-compliance.compliance": 1e-5})
    assert len(_made) == before + 2  # force and its rate
    np.testing.assert_array_equal(model.predict(s, {"structural-compliance.compliance": 1e-5}), first)
    assert len(_made) == before + 2
    del s
    assert len(_made) == before


# ---- sensor ---------------------------------------------------------------------------------------------------------


def test_misalignment_reads_in_turned_axes(examples_of: Callable[[str], Any]) -> None:
    found = examples_of("sensor-misalignment")
    clean = Model("hooke").predict(found.signals, {})
    phi = np.array([0.3, -0.5, 0.2])
    values = {f"sensor-misalignment.rotation[{axis}]": v for axis, v in zip("xyz", phi)}
    read = Model("hooke", "sensor-misalignment").predict(found.signals, values)
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


def test_crosstalk_is_a_matrix_without_its_diagonal(examples_of: Callable[[str], Any]) -> None:
    found = examples_of("sensor-crosstalk")
    model = Model("hooke", "coulomb-friction")
    matrix = np.eye(6)
    for name, value in found.values.items():
        row, column = name.split("[")[1].rstrip("]").split(",")
        matrix[WRENCH.index(row), WRENCH.index(column)] = value
    assert (matrix != 0).sum() == 36
    read = (model + "sensor-crosstalk").predict(found.signals, found.values)
    np.testing.assert_allclose(read, matrix @ model.predict(found.signals, {}), atol=1e-12)


def test_crosstalk_of_three_forces_and_of_one() -> None:
    model = Model("hooke", "sensor-crosstalk")
    assert len(model.parameters(Layout(TESTER, "contact"))) == 1 + 6
    assert len(model.parameters(Layout(TESTER[:1], "contact"))) == 1
    units = {p.unit for p in model.parameters(Layout(WRENCH, "wrench")).values()}
    assert units == {"N/m", "1", "m", "1/m"}


def test_gain_scales_weight_and_contact_alike(examples_of: Callable[[str], Any]) -> None:
    s = examples_of("sensor-gain").signals
    clean = Model("hooke").predict(s, {})
    np.testing.assert_allclose(Model("hooke", "sensor-gain").predict(s, {"sensor-gain.gain": -0.2}), 0.8 * clean, rtol=1e-14)


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

    read = Model("hooke", "sensor-lag").predict(poked(t, force), {"hooke.stiffness": 1.0, "sensor-lag.time-constant": tau})
    solved = solve_ivp(lambda at, y: (np.interp(at, t, force(t)) - y) / tau, (t[0], t[-1]), [force(t[0])], t_eval=t,
                       rtol=1e-9, atol=1e-11, max_step=5e-4)  # fmt: skip
    np.testing.assert_allclose(read[0], solved.y[0], rtol=0, atol=1e-6)  # of the integrator, at the corners of the input


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
    """Where a reading's time passes a sample, the slope over the delay is the same on both sides; a straight line breaks."""
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


def test_saturation_clips_each_channel_at_its_limit(examples_of: Callable[[str], Any]) -> None:
    found = examples_of("saturation")
    clean = Model("hooke").predict(found.signals, {})
    read = Model("hooke", "saturation").predict(found.signals, found.values)
    for row, limit, channel in zip(read, found.values.values(), clean):
        assert np.abs(row).max() == limit
        inside = np.abs(channel) < limit
        assert 0 < inside.sum() < len(inside)
        np.testing.assert_array_equal(row[inside], channel[inside])


def test_quantization_reads_whole_steps(examples_of: Callable[[str], Any]) -> None:
    found = examples_of("quantization")
    values = {**found.values, "quantization.step[fx]": 0.0}
    clean = Model("hooke").predict(found.signals, {})
    read = Model("hooke", "quantization").predict(found.signals, values)
    np.testing.assert_array_equal(read[0], clean[0])
    for row, channel, step in zip(read[1:], clean[1:], list(values.values())[1:]):
        np.testing.assert_allclose(row / step, np.round(row / step), atol=1e-9)
        assert np.abs(row - channel).max() <= 0.5 * step * (1 + 1e-9)


def test_hum_is_a_line_at_its_frequency() -> None:
    t = np.arange(5000) * 1e-3
    s = signals(t, np.full(5000, -1.0))
    hum = MainsHum(frequency=60.0, harmonics=(1, 3))
    values = {"mains-hum.sine[normal_force,1]": 0.3, "mains-hum.cosine[normal_force,1]": 0.4,
              "mains-hum.cosine[tangential_force1,3]": 0.2}  # fmt: skip
    read = Model("hooke", hum).predict(s, values)
    amplitude = 2.0 * np.abs(np.fft.rfft(read, axis=1)) / 5000
    frequency = np.fft.rfftfreq(5000, 1e-3)
    expected = np.zeros_like(amplitude)
    expected[0, frequency == 60.0], expected[1, frequency == 180.0] = 0.5, 0.2
    np.testing.assert_allclose(amplitude, expected, atol=1e-12)


# ---- examples --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def examples_of() -> Callable[[str], Any]:
    """The catalogue's examples by name."""
    import importlib.util
    import sys
    from pathlib import Path

    spec = importlib.util.spec_from_file_location("_sensor_examples", Path(__file__).with_name("_examples_sensor.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return lambda name: module.EXAMPLES[name]


