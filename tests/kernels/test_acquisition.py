"""What electronics do over time, against scipy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from kinid.kernels.acquisition import delay


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.05, 0.05), st.integers(3, 40))
def test_a_delay_is_a_cubic_hermite_spline(seed: int, late: float, many: int) -> None:
    """On uneven times, two channels, in two runs: slopes are those of the parabola through three neighbours; ends are held."""
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
