"""Payload from wrenches: recovery, honest intervals, what can't be told, and 24 measured poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from kinid.errors import InputError
from kinid.estimators.payload import NAMES, fit_payload

Array = NDArray[np.float64]
G = 9.81
AXES = {"+x": 0, "+y": 1, "+z": 2, "-x": 3, "-y": 4, "-z": 5}
SIX = G * np.vstack([np.eye(3), -np.eye(3)])  # gravity along each axis of the sensor, both ways

MASS, COM = 0.73, np.array([0.012, -0.007, 0.061])
BIAS = np.array([3.0, -1.5, 7.0, 0.2, -0.4, 0.1])
INERTIA = np.array([[2.1e-3, 1e-4, -2e-4], [1e-4, 1.8e-3, 3e-4], [-2e-4, 3e-4, 9e-4]])  # about the com


def reading(
    gravity: Array,
    a: Array | None = None,
    w: Array | None = None,
    alpha: Array | None = None,
    mass: float = MASS,
    com: Array = COM,
    bias: Array = BIAS,
) -> Array:
    """Newton-Euler about the com: not the linear form about the sensor's origin that the estimator solves."""
    zero = np.zeros_like(gravity)
    a, w, alpha = (zero if v is None else v for v in (a, w, alpha))
    force = mass * (gravity - a - np.cross(alpha, com) - np.cross(w, np.cross(w, com)))
    about_com = -(alpha @ INERTIA + np.cross(w, w @ INERTIA))
    return np.concatenate([force, np.cross(com, force) + about_com], axis=1) + bias


def truth(turning: bool = False) -> Array:
    inertia = INERTIA[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] if turning else np.empty(0)
    return np.concatenate([[MASS], COM, BIAS, inertia])


def directions(n: int, rng: np.random.Generator) -> Array:
    v = rng.normal(size=(n, 3))
    return G * v / np.linalg.norm(v, axis=1, keepdims=True)


def test_exact_poses_give_the_payload_back() -> None:
    fit = fit_payload(reading(SIX), SIX)
    assert fit.status == "ok"
    assert fit.unidentified == ()
    # six poses, rounding only
    np.testing.assert_allclose([fit[name].value for name in NAMES[:10]], truth(), rtol=0, atol=1e-12)
    assert fit.tool().mass == pytest.approx(MASS)
    assert fit.rms_force < 1e-12


def test_motion_gives_the_inertia_about_the_com_too() -> None:
    rng = np.random.default_rng(3)
    g, a, w, alpha = directions(60, rng), *(s * rng.normal(size=(60, 3)) for s in (4.0, 3.0, 20.0))
    wrench = reading(g, a, w, alpha)
    fit = fit_payload(wrench, g, acceleration=a, angular_velocity=w, angular_acceleration=alpha)
    assert fit.status == "ok"
    np.testing.assert_allclose([fit[name].value for name in NAMES], truth(turning=True), rtol=0, atol=1e-11)
    np.testing.assert_allclose(fit.tool().inertia, truth(turning=True)[10:], atol=1e-11)


def test_taking_motion_for_rest_is_seen_in_the_residual() -> None:
    rng = np.random.default_rng(4)
    g, a = directions(60, rng), rng.normal(size=(60, 3))
    assert fit_payload(reading(g, a), g).rms_force > 0.5 * MASS


@settings(max_examples=60, deadline=None)
@given(
    mass=st.floats(0.05, 10.0),
    com=st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    bias=st.tuples(*[st.floats(-50.0, 50.0)] * 6),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_payload_is_recovered_from_random_poses(
    mass: float, com: tuple[float, ...], bias: tuple[float, ...], seed: int
) -> None:
    g = directions(12, np.random.default_rng(seed))
    fit = fit_payload(reading(g, mass=mass, com=np.array(com), bias=np.array(bias)), g)
    assert fit.status == "ok"
    # random poses are excited to some percent at worst, which magnifies rounding (1e-14 N) by as much squared
    assert fit.mass == pytest.approx(mass, abs=1e-8)
    np.testing.assert_allclose(fit.com, com, atol=1e-7)
    np.testing.assert_allclose(fit.bias, bias, atol=1e-7)


def covered(noise: Array, rows: int, trials: int, correlated: float = 0.0) -> tuple[Array, Array]:
    """Share of 95 % intervals that hold the truth, and their mean width over the estimates' true spread."""
    rng = np.random.default_rng(11)
    inside, width, values = np.zeros(10), np.zeros(10), []
    for _ in range(trials):
        g = directions(rows, rng)
        if correlated:  # a slow motion, and an error that is as slow
            g = np.sin(np.cumsum(rng.normal(scale=0.05, size=(rows, 3)), axis=0) + rng.uniform(0, 6, 3))
            g *= G / np.linalg.norm(g, axis=1, keepdims=True)
        error = rng.normal(size=(rows, 6))
        if correlated:
            start = correlated / np.sqrt(1 - correlated**2) * rng.normal(size=(1, 6))
            error = lfilter([1], [1, -correlated], error, axis=0, zi=start)[0] * np.sqrt(1 - correlated**2)
        fit = fit_payload(reading(g) + noise * error, g)
        inside += (fit.low <= truth()) & (truth() <= fit.high)
        width += fit.high - fit.low
        values.append([fit[name].value for name in NAMES[:10]])
    return inside / trials, width / trials / (2 * 1.96 * np.std(values, axis=0))


@pytest.mark.parametrize("noise", [[0.1, 0.1, 0.1, 5e-3, 5e-3, 5e-3], [0.5, 0.05, 0.05, 2e-3, 2e-3, 2e-2]])
def test_intervals_cover_the_truth_as_often_as_they_say(noise: list[float]) -> None:
    share, width = covered(np.array(noise), rows=24, trials=300)
    print(f"\ncoverage of 95 % intervals {share.round(3)}, width / spread {width.round(2)}")
    # 300 trials: the standard error of a share of 0.95 is 0.013; three of them below, and not absurdly wide
    assert share.min() >= 0.91
    assert width.max() < 1.5


def test_correlated_errors_widen_the_intervals() -> None:
    share, _ = covered(np.array([0.1] * 3 + [5e-3] * 3), rows=3000, trials=100, correlated=0.95)
    print(f"\ncoverage with errors correlated over 39 samples {share.round(3)}")
    # intervals that take the rows for independent are six times narrower and cover a quarter
    assert share.mean() >= 0.92


def test_four_poses_are_less_sure_than_forty() -> None:
    rng = np.random.default_rng(5)
    few, many = SIX[:4], directions(40, rng)
    noise = np.array([0.1] * 3 + [5e-3] * 3)
    fits = [fit_payload(reading(g) + noise * rng.normal(size=(len(g), 6)), g) for g in (few, many)]
    assert np.ptp(fits[0]["mass"][1:3]) > 3 * np.ptp(fits[1]["mass"][1:3]) > 0


def test_poses_all_alike_are_not_excited_and_the_remedy_works() -> None:
    g = np.repeat(SIX[[AXES["-z"]]], 8, axis=0)
    fit = fit_payload(reading(g), g)
    assert fit.status == "not-excited"
    assert {"mass", "com_x", "com_y", "com_z", "bias_fz"} <= set(fit.unidentified)
    # along x and y gravity does not pull: the force bias there is known
    assert not {"bias_fx", "bias_fy", "bias_tz"} & set(fit.unidentified)
    assert fit["bias_fx"].value == pytest.approx(BIAS[0])
    assert np.isnan(fit.mass)
    assert fit["mass"][1:3] == (-np.inf, np.inf)
    assert np.isinf(fit.condition)
    with pytest.raises(InputError, match=r"mass, com_x.*gravity points along"):
        fit.tool()
    follow(g, fit.remedy)


def test_gravity_along_one_line_hides_the_com_along_it() -> None:
    g = np.repeat(SIX[[AXES["+z"], AXES["-z"]]], 3, axis=0)
    fit = fit_payload(reading(g), g)
    assert fit.unidentified == ("com_z",)
    assert fit.mass == pytest.approx(MASS)
    np.testing.assert_allclose(fit.com[:2], COM[:2], atol=1e-12)
    assert fit["com_z"][1:3] == (-np.inf, np.inf)
    follow(g, fit.remedy)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 2))
def test_the_remedy_for_few_poses_works(seed: int, count: int) -> None:
    g = np.repeat(directions(count, np.random.default_rng(seed)), 3, axis=0)
    fit = fit_payload(reading(g), g)
    assert fit.status == "not-excited"
    follow(g, fit.remedy)


def follow(g: Array, remedy: str) -> None:
    """Add the poses that a remedy names: then everything is identified."""
    named = [word for word in remedy.replace(",", " ").split() if word in AXES]
    assert named, remedy
    more = np.concatenate([g, SIX[[AXES[name] for name in named]]])
    again = fit_payload(reading(more), more)
    assert again.unidentified == (), remedy
    np.testing.assert_allclose(again.com, COM, atol=1e-8)


def test_inertia_of_a_tool_that_hardly_turned_is_infinite_not_invented() -> None:
    rng = np.random.default_rng(6)
    g, w, alpha = directions(50, rng), 1e-3 * rng.normal(size=(50, 3)), 1e-2 * rng.normal(size=(50, 3))
    fit = fit_payload(reading(g, None, w, alpha), g, angular_velocity=w, angular_acceleration=alpha)
    assert fit.status == "not-excited"
    assert set(fit.unidentified) == set(NAMES[10:])
    assert "turn the tool faster" in fit.remedy
    assert "gravity" not in fit.remedy
    assert fit.mass == pytest.approx(MASS)
    # the inertia that can't be seen has leaked into the com, and the interval knows
    assert 0 < abs(fit.com[2] - COM[2]) < 1e-4
    assert fit["com_z"].low < COM[2] < fit["com_z"].high
    assert fit.tool().inertia == (0, 0, 0, 0, 0, 0)


def test_as_many_readings_as_unknowns_leave_no_interval_without_a_noise() -> None:
    g = directions(2, np.random.default_rng(7))
    g = np.concatenate([g, np.full((1, 3), np.nan)])  # a broken row is not used
    values = reading(g)
    fit = fit_payload(values[:1], g[:1])
    assert fit.status == "not-excited"
    assert fit_payload(values, g).used == 2
    assert np.isnan(fit_payload(values, g).residual[2]).all()
    known = fit_payload(values[:2], g[:2], noise=[0.1] * 3 + [5e-3] * 3)
    assert np.isfinite(known["mass"][1:3]).all()


def test_a_light_tool_in_much_noise_has_no_bounded_com() -> None:
    rng = np.random.default_rng(8)
    g = directions(10, rng)
    fit = fit_payload(reading(g, mass=0.001) + rng.normal(size=(10, 6)) * ([0.5] * 3 + [0.05] * 3), g)
    assert fit["mass"].low < 0.0 < fit["mass"].high
    assert fit["com_z"][1:3] == (-np.inf, np.inf)


def test_the_opposite_sign_makes_the_mass_negative_and_says_so() -> None:
    fit = fit_payload(-reading(SIX), SIX)
    assert fit.mass == pytest.approx(-MASS)
    assert fit.status == "negative-mass"
    assert "scale = -1" in fit.remedy
    with pytest.raises(InputError, match=r"-0\.73 kg"):
        fit.tool()


@pytest.mark.parametrize(
    ("wrench", "gravity", "more", "says"),
    [
        (np.zeros((3, 5)), SIX[:3], {}, r"wrench of shape \(3, 5\)"),
        (np.zeros((3, 6)), SIX[:4], {}, r"gravity of shape \(4, 3\)"),
        (np.zeros((0, 6)), SIX[:0], {}, r"wrench of shape \(0, 6\)"),
        (np.full((3, 6), np.nan), SIX[:3], {}, "no usable row"),
        (np.zeros((3, 6)), SIX[:3] / G, {}, "gravity of 1 "),
        (np.zeros((3, 6)), SIX[:3], {"noise": [1, 2, 3]}, "a noise of"),
    ],
)
def test_bad_input_is_one_line(wrench: Array, gravity: Array, more: dict[str, list[int]], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        fit_payload(wrench, gravity, **more)
    assert "\n" not in str(caught.value)


@pytest.mark.real
def test_measured_poses_of_an_ati_gamma(real_data: Path) -> None:
    """24 poses of a tool on a KUKA Med 14, whose reading at rest has the sign of m·Rᵀ·g."""
    path = real_data / "med14-ft-imu" / "0-calibration_fts-accel.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    wrench = np.stack([table[c] for c in ("fx", "fy", "fz", "tx", "ty", "tz")], axis=1)
    gravity = np.stack([table[c] for c in ("gx", "gy", "gz")], axis=1)
    rotation = np.stack([table[f"r{i}{j}"] for i in "123" for j in "123"], axis=1).reshape(-1, 3, 3)
    # the file's gravity is Rᵀ g of a sensor-to-base rotation and of gravity that points down
    np.testing.assert_allclose(np.einsum("nji,j->ni", rotation, [0, 0, -9.82085]), gravity, atol=1e-6)
    fit = fit_payload(wrench, gravity)
    mass, com = fit["mass"], fit["com_z"]
    print(
        f"\nmass {mass.value:.4f} kg [{mass.low:.4f}, {mass.high:.4f}], com z {1e3 * com.value:.2f} mm "
        f"[{1e3 * com.low:.2f}, {1e3 * com.high:.2f}], residual {fit.rms_force:.4f} N, "
        f"{1e3 * fit.rms_torque:.2f} mN·m, condition {fit.condition:.3f}"
    )
    assert fit.status == "ok"
    assert mass.value == pytest.approx(0.932, rel=5e-3)
    assert mass.low < 0.932 < mass.high
    assert com.value == pytest.approx(0.0439, abs=2e-4)
    assert fit.rms_force <= 0.09
    assert fit.rms_torque <= 3.1e-3
    assert fit_payload(-wrench, gravity).status == "negative-mass"


@pytest.mark.parametrize("walk", [0.0, 1e-3], ids=["still", "wanders"])
def test_intervals_know_of_a_zero_that_wanders(walk: float) -> None:
    """Twenty seconds of turning in the air: with intervals that know of white noise alone 6 to 40 biases would hold."""
    n, period = 2000, 0.01
    t = period * np.arange(n)
    tilt, turn = 0.6 * np.sin(2 * np.pi * 0.37 * t), 0.6 * np.sin(2 * np.pi * 0.29 * t + 1.0)
    gravity = G * np.stack([np.sin(tilt), np.cos(tilt) * np.sin(turn), np.cos(tilt) * np.cos(turn)], axis=1)
    noise = np.array([0.015, 0.015, 0.029, 5e-4, 6e-4, 3e-4])
    steps = walk * np.sqrt(period) * np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    held = np.zeros(10)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        wandering = np.cumsum(rng.normal(size=(n, 6)) * steps, axis=0)
        fit = fit_payload(reading(gravity) + wandering + noise * rng.normal(size=(n, 6)), gravity)
        held += (fit.low <= truth()) & (truth() <= fit.high)  # the zero as it was at the start
    print(f"95 % intervals of {', '.join(NAMES[:10])} hold in {held.astype(int).tolist()} of 100 logs")
    # 95 % of a hundred, less three standard errors
    assert held[:4].min() >= 88
    # the walk of a channel that is as noisy as the normal force's is often called smaller than it is
    assert held.min() >= (70 if walk else 88)
