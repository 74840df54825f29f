"""The smoothed motion: exact where it can be, the same in other units and backwards, near the truth, and as sure as it
says.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from kinid.signal import Smoothed, contradictions, smooth_motion

Array = NDArray[np.float64]

PERIOD = 2.4  # of a poke [s]


def poke(t: Array) -> tuple[Array, Array, Array]:
    """Minimum-jerk ways in and out of 20 mm, 0.4 s each, with holds of 0.8 s; position, velocity, acceleration,
    (n,).
    """
    out = np.zeros((3, len(t)))
    for start, way in ((0.8, 0.02), (2.0, -0.02)):
        u = np.clip((t % PERIOD - start) / 0.4, 0.0, 1.0)
        out[0] += way * u**3 * (10 - 15 * u + 6 * u**2)
        out[1] += way / 0.4 * 30 * u**2 * (1 - u) ** 2
        out[2] += way / 0.16 * 60 * u * (1 - u) * (1 - 2 * u)
    return out[0], out[1], out[2]


def smoothed(t: Array, x: Array, first: Array | None = None) -> Smoothed:
    return smooth_motion(t, x[:, None], [slice(0, len(t))], None if first is None else first[:, None])


def errors(made: Smoothed, truth: tuple[Array, Array, Array]) -> Array:
    """(3, n)."""
    return np.stack([made.value[:, 0] - truth[0], made.first[:, 0] - truth[1], made.second[:, 0] - truth[2]])


def rms(x: Array) -> Array:
    out: Array = np.sqrt(np.mean(x**2, axis=-1))
    return out


@pytest.fixture(scope="module")
def measured() -> tuple[Array, tuple[Array, Array, Array], Array]:
    """Times, truth and positions with 3 µm of noise."""
    t = np.arange(0, 4 * PERIOD, 0.002)
    truth = poke(t)
    return t, truth, truth[0] + 3e-6 * np.random.default_rng(0).standard_normal(len(t))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_polynomials_come_back(degree: int) -> None:
    t = np.sort(np.random.default_rng(degree).uniform(0, 2, 400)) + np.arange(400) * 0.01
    u = (t - 3.0) / 3.0
    truth = (u**degree, degree * u ** max(degree - 1, 0) / 3, degree * (degree - 1) * u ** max(degree - 2, 0) / 9)
    away = np.abs(errors(smoothed(t, truth[0]), truth)).max(axis=1)
    assert (away < [1e-7, 1e-5, 1e-3]).all(), away


def test_units_and_direction_of_time_don_t_matter(measured: tuple[Array, tuple[Array, Array, Array], Array]) -> None:
    t, _, x = measured
    plain = smoothed(t, x)
    milli = smoothed(t, 1e3 * x)
    np.testing.assert_allclose(milli.second, 1e3 * plain.second, rtol=1e-5, atol=1e-5 * np.abs(milli.second).max())
    slow = smoothed(10 * t, x)
    np.testing.assert_allclose(100 * slow.second, plain.second, rtol=1e-5, atol=1e-5 * np.abs(plain.second).max())
    back = smoothed(t[-1] - t[::-1], x[::-1])
    scale = rms(plain.first[:, 0])
    assert rms(back.first[::-1, 0] + plain.first[:, 0]) < 2e-2 * scale


def test_it_is_near_the_truth_and_as_sure_as_it_says(measured: tuple[Array, tuple[Array, Array, Array], Array]) -> None:
    t, truth, x = measured
    made = smoothed(t, x)
    off = errors(made, truth)
    assert (rms(off) < [1e-6, 6e-5, 1.2e-2]).all(), rms(off)  # 25 Hz differentiator: 3e-6, 1.2e-4, 4e-2
    for row, sd in zip(off, made.sd):
        inside = np.abs(row)[:, None] < np.outer(sd[:, 0], [1.0, 2.0])
        assert 0.5 < inside[:, 0].mean() <= 1.0
        assert inside[:, 1].mean() > 0.85


@pytest.mark.parametrize(("noise", "bias", "delay"), [(1e-5, 0, 0), (2e-4, 0, 0), (2e-4, 2e-4, 0), (2e-4, 0, 0.004)])
def test_velocities_never_make_it_worse(
    noise: float, bias: float, delay: float, measured: tuple[Array, tuple[Array, Array, Array], Array]
) -> None:
    t, truth, x = measured
    logged = poke(np.maximum(t - delay, 0))[1] + bias + noise * np.random.default_rng(1).standard_normal(len(t))
    alone, both = smoothed(t, x), smoothed(t, x, logged)
    assert (rms(errors(both, truth)) < 1.05 * rms(errors(alone, truth))).all()
    found = both.facts["velocities"]
    assert found["bias"][0] == pytest.approx(bias, abs=3e-5)
    assert found["delay"][0] == pytest.approx(delay, abs=3e-4)


def test_velocities_made_of_the_positions_tell_nothing(
    measured: tuple[Array, tuple[Array, Array, Array], Array],
) -> None:
    t, _, x = measured
    alone, both = smoothed(t, x), smoothed(t, x, np.gradient(x, t))
    assert both.facts["velocities"]["noise"] == [np.inf]
    np.testing.assert_array_equal(both.first, alone.first)


def test_draws_scatter_as_the_standard_deviations_say(
    measured: tuple[Array, tuple[Array, Array, Array], Array],
) -> None:
    t, _, x = measured
    made = smoothed(t, x)
    drawn = np.stack(made.errors(40), axis=1)[..., 0].astype(np.float64)
    ratio = drawn.std(axis=0).mean(axis=1) / np.stack(made.sd)[:, :, 0].mean(axis=1)
    np.testing.assert_allclose(ratio, 1.0, atol=0.1)
    np.testing.assert_array_equal(*([one.first for one in made.draws(2)] for _ in range(2)))
    # a drawn velocity is the derivative of the drawn position
    assert rms(np.gradient(drawn[0, 0], t) - drawn[0, 1]) < 0.03 * rms(drawn[0, 1])


def test_gaps_and_what_is_missing(measured: tuple[Array, tuple[Array, Array, Array], Array]) -> None:
    t, truth, x = measured
    x = x.copy()
    x[100] = np.nan
    made = smooth_motion(t, x[:, None], [slice(0, 2000), slice(2000, 2001), slice(2001, len(t))])
    assert np.isnan(made.value[100])
    assert np.isnan(made.first[2000])
    assert np.isfinite(made.value[2000])
    good = np.isfinite(made.first[:, 0])
    assert rms(made.first[good, 0] - truth[1][good]) < 1e-4


def test_without_a_position_there_is_nothing_and_with_one_a_place() -> None:
    t = 0.01 * np.arange(500.0)
    none = smoothed(t, np.full(500, np.nan))
    assert np.isnan(none.first).all()
    assert none.errors(2)[0].shape == (2, 500, 1)
    alone = np.full(500, np.nan)
    alone[7] = 0.25
    assert smoothed(t, alone).value[7, 0] == pytest.approx(0.25)


@pytest.mark.parametrize("logged", ["filtered differences", "huge", "none", "a constant", "a millionth of a millionth"])
def test_no_rate_takes_the_positions_away(logged: str) -> None:
    """On a lattice most differences are 0, which looks like a rate without noise."""
    t = np.arange(0, 4 * PERIOD, 0.001)
    truth = poke(t)
    x = 1e-4 * np.round(truth[0] / 1e-4)
    difference = np.diff(x, prepend=x[0]) / 0.001
    rate = {
        "filtered differences": lfilter([0.2], [1, -0.8], difference),
        "huge": 1e12 * truth[1],
        "none": np.full(len(t), np.nan),
        "a constant": np.full(len(t), 5.0),
        "a millionth of a millionth": 1e-12 * truth[1],
    }[logged]
    made = smoothed(t, x, rate)
    for row in (made.value, made.first, made.second, *made.sd):
        assert np.isfinite(row).all()
    assert (rms(errors(made, truth)) < 1.03 * rms(errors(smoothed(t, x), truth))).all()


@pytest.mark.parametrize("lag", [0.002, 0.005])
def test_rates_that_lag_as_a_filter_does_no_harm(
    lag: float, measured: tuple[Array, tuple[Array, Array, Array], Array]
) -> None:
    t, truth, x = measured
    a = np.exp(-0.002 / lag)
    rate = lfilter([1 - a], [1, -a], truth[1]) + 2e-4 * np.random.default_rng(2).standard_normal(len(t))
    assert (rms(errors(smoothed(t, x, rate), truth)) < 1.03 * rms(errors(smoothed(t, x), truth))).all()


@pytest.mark.parametrize(
    ("rate", "said"),
    [
        (lambda t: poke(t)[1], ()),
        (lambda t: poke(t)[1] + 2e-3, ("offset", "+0.002")),
        (lambda t: poke(np.maximum(t - 0.005, 0))[1], ("ms after", "moved back")),
        (lambda t: 57.3 * poke(t)[1], ("57.3", "unit")),
    ],
)
def test_what_contradicts_the_positions_is_said_with_figures(
    rate: Callable[[Array], Array], said: tuple[str, ...], measured: tuple[Array, tuple[Array, Array, Array], Array]
) -> None:
    t, truth, x = measured
    made = smoothed(t, x, rate(t) + 2e-4 * np.random.default_rng(1).standard_normal(len(t)))
    lines = contradictions(made, ["q1"], 0.002)
    assert len(lines) == bool(said)
    assert all(word in lines[0] for word in said)


@pytest.mark.parametrize("stuck", [0.0, 0.1])
def test_rates_that_never_change_are_left_out_and_said(
    stuck: float, measured: tuple[Array, tuple[Array, Array, Array], Array]
) -> None:
    t, _, x = measured
    both = np.stack([x, np.full_like(x, 0.4)], axis=1)  # one that stands still has a rate of nothing
    made = smooth_motion(t, both, [slice(0, len(t))], np.stack([np.full_like(t, stuck), np.zeros_like(t)], axis=1))
    (line,) = contradictions(made, ["q1", "q2"], 0.002)
    assert "velocities of q1 never change" in line
    np.testing.assert_array_equal(made.first[:, 0], smooth_motion(t, both, [slice(0, len(t))]).first[:, 0])


def test_a_long_piece_is_smoothed_as_a_short_one_is() -> None:
    """Covariances are kept for some samples at a time; nothing tells where."""
    t = np.arange(0, 5 * PERIOD, 0.002)
    x = poke(t)[0] + 3e-6 * np.random.default_rng(3).standard_normal(len(t))
    made = smoothed(t, x)
    middle = made._tracks[0].pieces[0][1]
    state, sd, _ = middle.smoothed()
    predicted, own = (
        state[:-1] @ np.triu([[1, 1, 1 / 2, 1 / 6], [0, 1, 1, 1 / 2], [0, 0, 1, 1], [0, 0, 0, 1]]).T,
        sd[1:],
    )
    assert (np.abs(np.diff(sd[:, 0])) < 0.5 * own[:, 0]).all()
    assert (np.abs(state[1:, 0] - predicted[:, 0]) < 3.0 * own[:, 0] + 1e-6).all()


def test_stamps_that_are_off_are_errors_of_time(swing: Callable[..., Any]) -> None:
    """A message that comes late, and one that brings what the one before it brought, move all axes along their
    motion.
    """
    rng = np.random.default_rng(5)
    truth = np.arange(4000) / 250.0
    made = swing(np.zeros(5), seed=2, size=0.6, speed=3.0)
    held = np.where(rng.uniform(size=len(truth)) < 0.1, np.r_[truth[:1], truth[:-1]], truth)
    stamps = np.maximum.accumulate(truth + 4e-4 * rng.standard_normal(len(truth)) * (truth > 0)) + 1e-9 * np.arange(
        len(truth)
    )
    q = made(held)[0] + 1e-6 * rng.standard_normal((len(truth), 5))
    smoothed = smooth_motion(stamps, q, [slice(0, len(q))])
    error = (smoothed.second - made(held)[2])[100:-100]
    scale = np.sqrt(np.mean(made(truth)[2] ** 2))
    assert (
        np.sqrt(np.mean(error**2)) < 0.3 * scale
    )  # 3 mrad of false steps, twice differentiated at 250 Hz, are 200 rad/s²


@pytest.mark.parametrize("lattice", [0.0, 1e-4])
def test_a_position_that_stands_alone_is_passed_over(lattice: float) -> None:
    """Repeated or off, of one axis whose stamps are right; not where the axis itself turns at once."""
    rng = np.random.default_rng(6)
    t = np.arange(5000) / 500.0
    truth = 0.4 * np.sin(2.0 * t) + 0.1 * np.sin(7.0 * t)
    x = truth + (2e-6 if not lattice else 2e-5) * rng.standard_normal(len(t))
    x = np.round(x / lattice) * lattice if lattice else x
    bad = 50 + np.flatnonzero(rng.uniform(size=len(t) - 100) < 0.01)
    off = x.copy()
    off[bad] = np.where(rng.uniform(size=len(bad)) < 0.5, off[bad - 1], off[bad] + 0.02)
    right, found = (smooth_motion(t, y[:, None], [slice(0, len(t))]).second[100:-100, 0] for y in (x, off))
    assert np.std(found - right) < 0.2 * np.std(right)
    kink = 0.7310537 * np.abs(t - 5.0003) + 0.1 * np.sin(t)
    turned = smooth_motion(t, kink[:, None], [slice(0, len(t))])
    np.testing.assert_allclose(turned.value[:, 0], kink, atol=2e-5)


def test_positions_written_with_few_digits_lie_on_a_lattice_still() -> None:
    """Steps of 5.1444 µrad in hundredths of a µrad: each gap is off by a little, and long ones by more."""
    rng = np.random.default_rng(9)
    t = np.cumsum(1e-3 + 1e-4 * rng.standard_normal(20_000))
    truth = 0.1 * np.sin(1.3 * t) * (np.sin(0.2 * t) > 0.0)  # at rest for half of the time
    q = np.round(np.round((truth[:, None] + [0.0, 1.8]) / 5.1444e-6) * 5.1444e-6, 8)
    smoothed = smooth_motion(t, q, [slice(0, len(t))])
    np.testing.assert_allclose(smoothed.facts["step"], 5.1444e-6, rtol=1e-4)


def test_an_axis_at_rest_on_two_values_stays_there() -> None:
    """An encoder of an axis at rest shows the value beside its own now and then; the other axes go on moving."""
    t = np.arange(4000) * 0.004
    rest = np.zeros(len(t))
    for begin, end in ((2003, 2010), (2237, 2244), (3325, 3329)):
        rest[begin:end] = -1e-5
    moving = np.round(poke(t)[0] / 1e-5) * 1e-5
    made = smooth_motion(t, np.column_stack([moving, rest, np.zeros(len(t))]), [slice(0, len(t))])
    assert np.abs(made.value[:, 1]).max() < 2e-5
    assert np.abs(made.first[:, 1]).max() < 1e-3  # a step of 1e-5 in a sample would be 2.5e-3
    assert np.abs(made.value[:, 0] - poke(t)[0]).max() < 1e-5
    assert (made.value[:, 2] == 0.0).all()


@pytest.mark.parametrize("share", [0.014, 0.1, 0.35])
def test_positions_between_those_of_an_encoder_are_followed(share: float) -> None:
    """A stream of joints put onto the clock of a wrench: most differences are slivers of a step, or nothing."""
    t = np.arange(8000) * 2e-3
    true = 0.2 * np.clip(np.sin(1.3 * t), 0.0, None) ** 3
    read = np.round(true / 2e-6) * 2e-6
    between, exact = (x[:-1] + share * np.diff(x) for x in (read, true))
    made = smooth_motion(t[:-1], between[:, None], [slice(0, len(between))])
    assert np.abs(made.value[:, 0] - exact).max() < 4e-6  # two steps
    speed = np.gradient(exact, t[:-1])
    assert np.std(made.first[50:-50, 0] - speed[50:-50]) < 5e-4
