"""What electronics do over time, against scipy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from kinid.kernels.acquisition import delay, lag, slopes


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.05, 0.05), st.integers(3, 40))
def test_a_delay_is_a_cubic_hermite_spline(seed: int, late: float, many: int) -> None:
    """On uneven times, two channels, in two runs: slopes are those of the parabola through three neighbours; ends are
    held.
    """
    rng = np.random.default_rng(seed)
    dt = rng.uniform(1e-3, 6e-3, 2 * many)
    t = np.cumsum(dt)
    dt[[0, many]] = 0.0
    x = rng.standard_normal((2, 2 * many))
    out = np.empty_like(x)
    delay(x, t, dt, late, out)
    for run in (slice(0, many), slice(many, 2 * many)):
        spline = CubicHermiteSpline(t[run], x[:, run], np.gradient(x[:, run], t[run], axis=1), axis=1)
        wanted = spline(np.clip(t[run] - late, t[run][0], t[run][-1]))
        # slopes of up to 4e3 over steps of 1e-3: rounding of some 1e-14 of the values
        np.testing.assert_allclose(out[:, run], wanted, rtol=0, atol=1e-10)


@pytest.mark.parametrize("late", [-1e-3, 0.0, 1e-3])
def test_a_sample_alone_stays_where_it_is(late: float) -> None:
    x = np.array([[1.0, 2.0, 3.0]])
    out = np.empty_like(x)
    delay(x, np.array([0.0, 1.0, 2.0]), np.zeros(3), late, out)
    np.testing.assert_array_equal(out, x)


@pytest.mark.parametrize("tau", [2e-4, 4e-3, 0.3])
@pytest.mark.parametrize("even", [False, True])
def test_a_lag_solves_its_equation(tau: float, even: bool) -> None:
    """τ ẏ = x − y, by a solver that knows no steps of time; in two runs, each in balance first."""
    rng, many = np.random.default_rng(5), 12
    dt = np.full(2 * many, 4e-3) if even else rng.uniform(1e-3, 6e-3, 2 * many)
    t = np.cumsum(dt)
    dt[[0, many]] = 0.0
    x = rng.standard_normal((2, 2 * many))
    out = np.empty_like(x)
    lag(x, dt, tau, out)
    for run in (slice(0, many), slice(many, 2 * many)):
        spline = CubicHermiteSpline(t[run], x[:, run], np.gradient(x[:, run], t[run], axis=1), axis=1)
        solved = solve_ivp(
            lambda at, y, spline=spline: (spline(at) - y) / tau,
            (t[run][0], t[run][-1]),
            x[:, run.start],
            "LSODA",
            t[run],
            rtol=1e-11,
            atol=1e-12,
            max_step=1e-4,
        )
        np.testing.assert_allclose(out[:, run], solved.y, rtol=0, atol=1e-8)  # the solver's own error


@pytest.mark.parametrize("tau", [1e-9, 1e-4, 0.0999, 0.1001, 10.0, 1e6])
def test_a_lag_of_any_length_leaves_what_stands_and_ramps_are_late(tau: float) -> None:
    """A constant stays; a ramp is late by τ once it has settled; also where the series takes over from the
    recurrence.
    """
    n = 400
    dt = np.full(n, 0.01)
    dt[0] = 0.0
    x = np.stack([np.full(n, 3.0), np.cumsum(dt)])
    out = np.empty_like(x)
    lag(x, dt, tau, out)
    np.testing.assert_allclose(out[0], 3.0, rtol=1e-12)
    np.testing.assert_allclose(out[1], x[1] - tau * -np.expm1(-x[1] / tau), rtol=0, atol=1e-11)


def test_no_lag_is_none() -> None:
    x = np.random.default_rng(1).standard_normal((2, 9))
    out = np.empty_like(x)
    lag(x, np.full(9, 0.01), 0.0, out)
    np.testing.assert_array_equal(out, x)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 20))
def test_slopes_do_not_cross_gaps(seed: int, many: int) -> None:
    """Of straight lines that leap between two runs the slope is the line's, but where memory begins anew."""
    dt = np.random.default_rng(seed).uniform(1e-3, 6e-3, 2 * many)
    dt[[0, many]] = 0.0
    t = np.cumsum(dt)
    x = np.stack([3.0 * t, -2.0 * t]) + np.where(np.arange(2 * many) < many, 0.0, 7.0)
    out = np.empty_like(x)
    slopes(x, dt, 0.1, out)
    np.testing.assert_allclose(out, np.where(dt > 0, [[0.3], [-0.2]], 0.0), rtol=0, atol=1e-11)
