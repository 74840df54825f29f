"""The differentiator: exact on polynomials, without delay, with the bandwidth it states, and never across a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]


def whole(t: Array) -> list[slice]:
    return [slice(0, len(t))]


def sine(frequency: float, rate: float, periods: int = 40, phase: float = 0.4) -> tuple[Array, Array, Array, Array]:
    """Times, values, and both derivatives divided by ω and −ω²."""
    t = np.arange(int(periods * rate / frequency)) / rate
    angle = 2 * np.pi * frequency * t + phase
    return t, np.sin(angle)[:, None], np.cos(angle), np.sin(angle)


def amplitude(signal: Array, reference: Array, quadrature: Array) -> complex:
    """In-phase and quadrature part of a signal, by least squares."""
    basis = np.column_stack([reference, quadrature])
    real, imaginary = np.linalg.lstsq(basis, signal, rcond=None)[0]
    return complex(real, imaginary)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 300),
    degree=st.integers(0, 4),
    jitter=st.sampled_from([0.0, 0.01, 0.3, 0.9]),
    bandwidth=st.floats(5, 200),
)
def test_exact_on_polynomials_everywhere(seed: int, n: int, degree: int, jitter: float, bandwidth: float) -> None:
    """Up to its degree, at even and uneven times, at the ends and in short pieces too."""
    rng = np.random.default_rng(seed)
    steps = 1e-3 * (1 + jitter * rng.uniform(-1, 1, n))
    t = np.cumsum(steps)
    curve = Polynomial(rng.normal(size=min(degree, n - 1) + 1), domain=[t[0], t[-1]])
    made = Differentiator(bandwidth)(t, curve(t)[:, None], whole(t))
    span = t[-1] - t[0]
    # taps of nearly even steps are those of even steps: each derivative is then off by the jitter
    slack = 0.05 if jitter == 0.01 else 0.0
    # rounding of values near 1, times the noise gain of the shortest window at its ends: some 100 / window
    near = 5 * 1e-3
    for order, found in ((1, made.first), (2, made.second)):
        true = curve.deriv(order)(t)
        size = np.abs(true).max()
        np.testing.assert_allclose(
            found[:, 0], true, rtol=0, atol=slack * size + 1e-12 * size + 1e-11 / min(near, span) ** order
        )


@pytest.mark.parametrize("bandwidth", [2.0, 10.0, 25.0, 80.0])
@pytest.mark.parametrize("rate", [500.0, 1000.0, 1237.0])
def test_three_decibels_at_the_stated_bandwidth(bandwidth: float, rate: float) -> None:
    """Of what is asked for, as closely as whole samples allow; exactly of what is stated."""
    probe = Differentiator(bandwidth)(*sine(bandwidth, rate)[:2], whole(sine(bandwidth, rate)[0]))
    steps = probe.window // 2
    assert bandwidth <= probe.bandwidth <= bandwidth * (1 + 1.1 / steps)  # one sample fewer a side would pass more
    t, x, cosine, _ = sine(probe.bandwidth, rate)
    made = Differentiator(bandwidth)(t, x, whole(t))
    inner = slice(probe.window, -probe.window)
    gain = amplitude(made.first[inner, 0] / (2 * np.pi * probe.bandwidth), cosine[inner], x[inner, 0])
    # the window is symmetric in time: no quadrature part but rounding; the amplitude is bisected to 1e-12
    assert abs(gain.imag) < 1e-9
    assert gain.real == pytest.approx(np.sqrt(0.5), abs=1e-6)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 20.0, 60.0])
def test_no_delay_at_any_frequency(frequency: float) -> None:
    t, x, cosine, sine_ = sine(frequency, 1000.0)
    made = Differentiator(25.0)(t, x, whole(t))
    inner = slice(made.window, -made.window)
    omega = 2 * np.pi * frequency
    assert abs(amplitude(made.first[inner, 0] / omega, cosine[inner], sine_[inner]).imag) < 1e-9
    assert abs(amplitude(-made.second[inner, 0] / omega**2, sine_[inner], cosine[inner]).imag) < 1e-9


def test_slow_motion_passes_whole() -> None:
    """Far below its bandwidth the loss goes with the fourth power of the frequency."""
    loss = []
    for frequency in (2.5, 5.0):
        t, x, cosine, sine_ = sine(frequency, 1000.0)
        made = Differentiator(25.0)(t, x, whole(t))
        inner = slice(made.window, -made.window)
        gain = amplitude(made.first[inner, 0] / (2 * np.pi * frequency), cosine[inner], sine_[inner])
        loss.append(1 - gain.real)
    assert 0 < loss[0] < 1e-4
    assert loss[1] / loss[0] == pytest.approx(16, rel=0.05)


def test_noise_gain_is_what_the_taps_say() -> None:
    """White noise comes out with the root of the sum of squared taps, and a tenth of the bandwidth brings far less."""
    rng = np.random.default_rng(0)
    t, noise = np.arange(200_000) * 1e-3, rng.normal(size=(200_000, 1))
    spread = {}
    for bandwidth in (2.5, 25.0):
        maker = Differentiator(bandwidth)
        made = maker(t, noise, whole(t))
        half = made.window // 2
        k = np.arange(-half, half + 1)
        fit = np.linalg.pinv(np.vander(k * 1e-3, 5, increasing=True))
        inner = slice(made.window, -made.window)
        for row, found, scale in ((fit[1], made.first, 1), (2 * fit[2], made.second, 1)):
            # a standard deviation from 2e5 samples, of which some 1e3 windows are independent: 3 %, asked for 5 %
            assert found[inner].std() == pytest.approx(scale * np.sqrt((row**2).sum()), rel=0.05)
        spread[bandwidth] = made.first[inner].std()
    # gain of a window of n samples goes with n^-1.5
    assert spread[2.5] / spread[25.0] == pytest.approx(0.1**1.5, rel=0.1)


def test_a_gap_is_never_crossed() -> None:
    """Two lines with a jump between them: beside the gap the slope of each side, exactly."""
    t = np.concatenate([np.arange(100), 150 + np.arange(100)]) * 1e-3
    x = np.concatenate([3 * t[:100], 7 * t[100:] - 5])[:, None]
    made = Differentiator(25.0)(t, x, [slice(0, 100), slice(100, 200)])
    # rounding of values near 1 over a window of some 50 ms: 1e-13, at the ends 100 times more
    np.testing.assert_allclose(made.first[:, 0], np.repeat([3.0, 7.0], 100), atol=1e-11)
    np.testing.assert_allclose(made.second[:, 0], 0.0, atol=1e-8)


def test_values_that_are_missing_for_long_are_a_gap() -> None:
    """A sensor that drops out while the log goes on: lines on both sides, with a jump between them."""
    t = np.arange(300) * 1e-3
    x = np.where(t < 0.15, 3 * t, 7 * t - 5)[:, None]
    x[100:200] = np.nan
    made = Differentiator(25.0)(t, x, whole(t))
    known = np.isfinite(x[:, 0])
    np.testing.assert_array_equal(np.isfinite(made.first[:, 0]), known)
    np.testing.assert_allclose(made.first[known, 0], np.repeat([3.0, 7.0], 100), atol=1e-11)


def test_outside_of_the_pieces_and_for_a_lone_sample_nothing_is_known() -> None:
    t = np.arange(30) * 1e-3
    made = Differentiator(25.0)(t, t[:, None] ** 2, [slice(2, 12), slice(14, 15), slice(20, 22)])
    known = np.isfinite(made.first[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(known), [*range(2, 12), 20, 21])
    np.testing.assert_array_equal(np.isfinite(made.second[:, 0]), known)
    # two samples make a line, and no curve
    assert made.first[20, 0] == pytest.approx(0.041, abs=1e-9)
    assert made.second[20, 0] == pytest.approx(0.0, abs=1e-6)
    alone = Differentiator()(np.zeros(1), np.ones((1, 3)), [slice(0, 1)])
    assert np.isnan(alone.first).all()


@settings(max_examples=40, deadline=None)
@given(
    rows=st.sets(st.integers(0, 299), min_size=1, max_size=60),
    column=st.integers(0, 1),
    bad=st.sampled_from([np.nan, np.inf, -np.inf]),
)
def test_values_that_are_no_numbers_spoil_only_themselves(rows: set[int], column: int, bad: float) -> None:
    t = np.arange(300) * 1e-3
    x = np.column_stack([np.sin(9 * t), np.cos(7 * t)])
    true = np.column_stack([9 * np.cos(9 * t), -7 * np.sin(7 * t)])
    spoilt = np.isin(np.arange(300), list(rows))
    x[spoilt, column] = bad
    made = Differentiator(25.0)(t, x, whole(t))
    assert np.isnan(made.first[spoilt]).all()
    # a sample all alone between two gaps of 5 ms has no velocity; with 60 of 300 missing that does not happen here
    known = np.isfinite(made.first).all(axis=1)
    assert (known | spoilt).sum() >= 298
    # a sine of 1.5 Hz; where a gap leaves a few samples the degree is low and the slope is one over some ms: 5 %
    np.testing.assert_allclose(made.first[known], true[known], atol=0.5)
    # the window may hold fewer samples, but it is centred and 49 ms long wherever no gap is near
    calm = known & (np.convolve(spoilt, np.ones(60), "same") < 3)
    calm[:60], calm[-60:] = False, False
    np.testing.assert_allclose(made.first[calm], true[calm], atol=1e-3)


@pytest.mark.parametrize("rates", [(1.0, 1.015), (1.0, 0.985)])
def test_a_clock_that_drifts_within_what_counts_as_even(rates: tuple[float, float]) -> None:
    """Steps 1.5 % longer in the second half are even steps, but the velocity there is that of the actual times."""
    steps = np.repeat(np.array(rates) * 1e-3, 2000)[:-1]
    t = np.cumsum(steps)
    made = Differentiator(25.0)(t, (3 * t + 20 * t**2)[:, None], whole(t))
    away = np.abs(np.arange(len(t)) - 2000) > made.window
    # away from the seam steps are even: what is left is rounding
    np.testing.assert_allclose(made.first[away, 0], 3 + 40 * t[away], rtol=1e-6)
    np.testing.assert_allclose(made.second[away, 0], 40.0, rtol=1e-4)


def test_uneven_times_are_the_actual_ones() -> None:
    """Missed samples and jitter far beyond what counts as even don't disturb a sine."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.choice(np.arange(4000), 3000, replace=False)) * 1e-3 + rng.uniform(-2e-4, 2e-4, 3000)
    made = Differentiator(25.0)(t, np.sin(12 * t)[:, None], whole(t))
    inner = slice(60, -60)
    # 2 Hz of 25 Hz; the window holds a fixed number of samples, so it is longer where samples are missed
    np.testing.assert_allclose(made.first[inner, 0], 12 * np.cos(12 * t[inner]), atol=2e-3)


def test_stamps_since_1970() -> None:
    """Their rounding is 2.4e-7 s: jitter like any other, and nothing is lost beyond it."""
    t = 1.7e9 + np.arange(2000) * 1e-3
    made = Differentiator(25.0)(t, np.sin(5 * (t - 1.7e9))[:, None], whole(t))
    inner = slice(100, -100)
    angle = 5 * (t[inner] - 1.7e9)
    np.testing.assert_allclose(made.first[inner, 0], 5 * np.cos(angle), atol=1e-4)
    # what the jitter of the times does to a second derivative falls out to first order; without that 0.05 stay
    np.testing.assert_allclose(made.second[inner, 0], -25 * np.sin(angle), atol=5e-3)


def test_columns_do_not_mix() -> None:
    rng = np.random.default_rng(2)
    t, x = np.arange(500) * 1e-3, rng.normal(size=(500, 7))
    together = Differentiator(25.0)(t, x, whole(t))
    for j in range(7):
        alone = Differentiator(25.0)(t, x[:, j : j + 1], whole(t))
        # the same sums in another order
        np.testing.assert_allclose(together.first[:, j], alone.first[:, 0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(together.second[:, j], alone.second[:, 0], rtol=1e-9, atol=1e-6)


def test_a_bandwidth_beyond_the_samples_takes_the_shortest_window() -> None:
    maker = Differentiator(1e6)
    assert maker.half_window(1e-3) == 3
    t = np.arange(50) * 1e-3
    made = maker(t, np.sin(20 * t)[:, None], whole(t))
    assert made.window == 7
    assert made.bandwidth < 500


@pytest.mark.parametrize("bandwidth", [0.0, -3.0, np.nan, np.inf])
def test_a_bandwidth_that_is_none_is_refused(bandwidth: float) -> None:
    with pytest.raises(InputError, match="a positive frequency in Hz"):
        Differentiator(bandwidth)


@pytest.mark.parametrize("order", [-1, 0, 1])
def test_a_degree_without_a_second_derivative_is_refused(order: int) -> None:
    with pytest.raises(InputError, match="2 or more"):
        Differentiator(25.0, order)


def test_columns_that_do_not_lie_row_by_row_make_no_difference() -> None:
    t = np.arange(300) * 1e-3
    x = np.stack([np.sin(7 * t), np.cos(3 * t), t**2], axis=1)
    plain = Differentiator(25.0)(t, x, whole(t))
    fortran = Differentiator(25.0)(t, np.asfortranarray(x), whole(t))
    np.testing.assert_array_equal(plain.first, fortran.first)
    np.testing.assert_array_equal(plain.second, fortran.second)
