"""The offline fit: recovery, bounds, directions that nothing tells, and intervals that cover what they claim to."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.signal import lfilter

from kinid.effects import Layout, Signals
from kinid.errors import InputError
from kinid.estimators.batch import autoregression, solve
from kinid.modeling.model import Model
from kinid.parameter import Parameter

Array = NDArray[np.float64]


def poke(n: int = 2000, rate: float = 500.0) -> Signals:
    """A poke of two sines about 4 mm, with separations."""
    t = np.arange(n) / rate
    two_pi = 2 * np.pi
    depth = 2.5e-3 + 3e-3 * np.sin(two_pi * 0.9 * t) + 1.5e-3 * np.sin(two_pi * 4 * t)
    rate_of = 3e-3 * two_pi * 0.9 * np.cos(two_pi * 0.9 * t) + 1.5e-3 * two_pi * 4 * np.cos(two_pi * 4 * t)
    nothing = np.zeros((2, n))
    return Signals(Layout(("normal_force",), "contact"), t, np.diff(t, prepend=t[0]), depth, rate_of, nothing, nothing)


SIGNALS, MODEL, TRUTH = poke(), Model("hunt-crossley"), np.array([2000.0, 300.0, 1.3])
PARAMETERS = tuple(MODEL.parameters(SIGNALS.layout).values())


def predict(values: Array) -> Array:
    return MODEL.predict(SIGNALS, values)


def coloured(rng: np.random.Generator, n: int, colour: float, sigma: float) -> Array:
    return lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.normal(scale=sigma, size=n + 200))[200:]


def test_exact_data_give_exact_parameters() -> None:
    found = solve(predict, predict(TRUTH), PARAMETERS)
    np.testing.assert_allclose(found.values, TRUTH, rtol=1e-8)  # the search ends at 1e-9 of a scale
    assert found.converged
    assert not found.at_bound.any()


def test_variable_projection_finds_what_a_full_search_finds() -> None:
    """The independent reference is scipy's curve_fit over all three parameters at once."""
    rng = np.random.default_rng(1)
    measured = predict(TRUTH) + rng.normal(scale=0.05, size=(1, len(SIGNALS)))
    found = solve(predict, measured, PARAMETERS)
    reference, covariance = curve_fit(
        lambda _, *p: predict(np.array(p)).ravel(),
        SIGNALS.t,
        measured.ravel(),
        p0=(1500, 100, 1.2),
        method="trf",
        x_scale=(100, 100, 0.1),
    )
    np.testing.assert_allclose(found.values, reference, rtol=1e-5)  # curve_fit stops at 1e-8 of the cost
    np.testing.assert_allclose(found.standard_errors, np.sqrt(np.diag(covariance)), rtol=0.05)


@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize(("logs", "off"), [(120, 6), pytest.param(500, 2, marks=pytest.mark.slow)])
def test_intervals_cover_the_truth_in_many_logs(colour: float, logs: int, off: float) -> None:
    """Within three standard errors of a share of 95 % of the few, and two of the many [%]."""
    rng = np.random.default_rng(20)
    hits = np.zeros(3)
    for _ in range(logs):
        measured = predict(TRUTH) + coloured(rng, len(SIGNALS), colour, 0.05)
        found = solve(predict, measured, PARAMETERS)
        hits += np.abs(found.values - TRUTH) < 1.959963984540054 * found.standard_errors
    share = 100 * hits / logs
    print(f"noise AR(1) {colour}: 95 % intervals of K, B, n cover the truth in {share} % of {logs} logs")
    assert (np.abs(share - 95) <= off).all()


def test_white_noise_intervals_would_be_wrong_for_coloured_noise() -> None:
    """What the autoregression is for: without it the intervals of a slow parameter are several times too narrow."""
    rng = np.random.default_rng(3)
    measured = predict(TRUTH) + coloured(rng, len(SIGNALS), 0.9, 0.05)
    found = solve(predict, measured, PARAMETERS)
    white = solve(predict, predict(found.values) + rng.normal(scale=0.05, size=(1, len(SIGNALS))), PARAMETERS)
    assert (found.standard_errors[[0, 2]] > 2 * white.standard_errors[[0, 2]]).all()


def test_a_direction_that_nothing_tells_is_named_and_the_rest_is_kept() -> None:
    x = np.linspace(0, 1, 200)
    parameters = [
        Parameter("a", "a", "1", 1.0, linear=True),
        Parameter("b", "b", "1", 1.0, linear=True),
        Parameter("c", "c", "1", 0.5, linear=True),
    ]
    found = solve(lambda p: ((p[0] + p[1]) * x + p[2])[None], (3 * x + 1)[None], parameters)
    assert list(found.unidentified) == [True, True, False]
    assert np.isinf(found.standard_errors[:2]).all()
    assert found.values[2] == pytest.approx(1.0)
    assert found.values[0] + found.values[1] == pytest.approx(3.0)


def test_a_parameter_without_any_influence_is_open() -> None:
    x = np.linspace(0, 1, 50)
    parameters = [Parameter("a", "a", "1", 1.0, linear=True), Parameter("n", "n", "1", 1.0, 0.0, 5.0)]
    found = solve(lambda p: (p[0] * x)[None], (2 * x)[None] + 1e-3 * np.sin(40 * x), parameters)
    assert list(found.unidentified) == [False, True]


def test_bounds_hold_for_linear_and_nonlinear_parameters() -> None:
    x = np.linspace(0, 1, 100)
    parameters = [Parameter("a", "a", "1", 1.0, 0.0, 10.0, linear=True), Parameter("n", "n", "1", 1.5, 1.0, 2.0)]
    found = solve(lambda p: (p[0] * x ** p[1])[None], (-2 * x**3)[None], parameters)
    assert found.values[0] == 0.0
    assert found.at_bound[0]
    found = solve(lambda p: (p[0] * x ** p[1])[None], (2 * x**3)[None], parameters)
    assert found.values[1] == pytest.approx(2.0, abs=1e-5)
    assert found.at_bound[1]


def test_masked_and_missing_readings_do_not_count() -> None:
    rng = np.random.default_rng(4)
    measured = predict(TRUTH) + 1e-6 * rng.normal(size=(1, len(SIGNALS)))
    mask = SIGNALS.t > 1.0
    measured[:, ~mask] += 100.0
    measured[0, -50:] = np.nan
    np.testing.assert_allclose(solve(predict, measured, PARAMETERS, mask=mask).values, TRUTH, rtol=1e-4)


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(InputError, match="more readings than parameters"):
        solve(predict, predict(TRUTH), PARAMETERS, mask=np.arange(len(SIGNALS)) < 3)


@pytest.mark.parametrize("coefficients", [(), (0.8,), (1.2, -0.5)])
def test_autoregression_is_recovered(coefficients: tuple[float, ...]) -> None:
    rng = np.random.default_rng(5)
    noise = lfilter([1.0], [1.0, *(-np.array(coefficients))], rng.normal(scale=0.3, size=20_000))
    found, variance = autoregression(noise)
    assert len(found) >= len(coefficients)
    # the standard error of a coefficient is about 1/√n = 0.007; five of them
    np.testing.assert_allclose(found[: len(coefficients)], coefficients, atol=0.035)
    assert np.sqrt(variance) == pytest.approx(0.3, rel=0.02)
