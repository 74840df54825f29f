"""The fast Hunt-Crossley fit against the truth and against the general one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinid.effects import Layout, Signals
from kinid.errors import InputError
from kinid.estimators.batch import solve
from kinid.estimators.power_law import fit_power_law
from kinid.modeling.model import Model

T = np.arange(4000) * 1e-3
DEPTH = 2.5e-3 + 3e-3 * np.sin(2 * np.pi * 0.9 * T) + 1.5e-3 * np.sin(2 * np.pi * 4 * T)
RATE = np.gradient(DEPTH, T)


def law(stiffness: float, damping: float, exponent: float) -> np.ndarray:
    return np.maximum(DEPTH, 0.0) ** exponent * (stiffness + damping * RATE)


@given(st.floats(10, 1e5), st.floats(-0.5, 0.5), st.floats(0.7, 2.5))
@settings(max_examples=40, deadline=None)
def test_exact_forces_give_exact_parameters(stiffness: float, loss: float, exponent: float) -> None:
    found = fit_power_law(DEPTH, RATE, law(stiffness, loss * stiffness, exponent))
    assert found.converged
    # the force of a step in n of 1e-9 is beyond double precision's sums
    assert found.exponent == pytest.approx(exponent, abs=1e-7)
    assert found.stiffness == pytest.approx(stiffness, rel=1e-6)
    assert found.damping == pytest.approx(loss * stiffness, rel=1e-5, abs=1e-6 * stiffness)


def test_it_agrees_with_the_general_fit_and_its_covariance() -> None:
    rng = np.random.default_rng(0)
    force = law(2000.0, 300.0, 1.3) + rng.normal(scale=0.05, size=len(T))
    model, n = Model("hunt-crossley"), len(T)
    inside = DEPTH > 0
    none = np.zeros((2, n))
    signals = Signals(Layout(("normal_force",), "contact"), T, np.diff(T, prepend=0), DEPTH, RATE, none, none)
    general = solve(
        lambda v: model.predict(signals, v), force[None], tuple(model.parameters(signals.layout).values()), mask=inside
    )
    found = fit_power_law(DEPTH, RATE, force)
    np.testing.assert_allclose([found.stiffness, found.damping, found.exponent], general.values, rtol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), general.standard_errors, rtol=0.02)


def test_noise_of_a_real_sensor_leaves_one_percent() -> None:
    """0.05 N and 2 µm, the figures of a Mini40 on an LWR4+; ten seconds of the source study's motion, up to 30 N."""
    t = np.arange(10_000) * 1e-3
    two_pi = 2 * np.pi
    depth = 0.012 * np.sin(two_pi * 2 * t) + 0.003 * np.sin(two_pi * 5 * t) + 0.021
    rate = two_pi * (0.024 * np.cos(two_pi * 2 * t) + 0.015 * np.cos(two_pi * 5 * t))
    errors = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        force = depth**1.3 * (2500 + 400 * rate) + rng.normal(scale=0.05, size=len(t))
        found = fit_power_law(depth + rng.normal(scale=2e-6, size=len(t)), rate, force)
        errors.append(100 * np.array([found.stiffness / 2500 - 1, found.damping / 400 - 1, found.exponent / 1.3 - 1]))
    worst = np.abs(errors).max(axis=0)
    shown = ", ".join(f"{name} {value:.2f} %" for name, value in zip("KBn", worst))
    print(f"Hunt-Crossley with 0.05 N and 2 µm of noise: worst of 5 logs {shown}")
    assert (worst < 1).all()


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="one length"):
        fit_power_law([1, 2], [1], [1, 2])
    with pytest.raises(InputError, match="inside the material"):
        fit_power_law(-DEPTH - 1, RATE, RATE)


def test_samples_that_are_not_numbers_and_air_are_passed_over() -> None:
    force = law(2000.0, 300.0, 1.3)
    spoilt, rate = force.copy(), RATE.copy()
    spoilt[::50], rate[7::50] = np.nan, np.inf
    spoilt[DEPTH < 0] = 5.0
    assert fit_power_law(DEPTH, rate, spoilt).stiffness == pytest.approx(2000, rel=1e-6)
