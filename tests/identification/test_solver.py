"""Searches: steps between bounds, and where they begin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scripted import RIG, scripted_poke

import kinid
from kinid.identification.initial_guesses import project_linear
from kinid.identification.problem import Problem
from kinid.identification.solver import first_error_model, search
from kinid.identification.state import solve_box_constrained
from kinid.modeling.from_logs import from_contact
from kinid.modeling.readings import experiment_for

Array = NDArray[np.float64]

MODEL = kinid.Model("kelvin-voigt")


def pressed() -> kinid.Log:
    """A spring of 800 N/m with a dashpot of 6 N·s/m, pressed at several speeds."""
    t = np.arange(5000) / 250.0
    depth = 3e-3 * np.sin(1.3 * t) * np.linspace(0.3, 1.0, len(t)) + 1e-3 * np.sin(7.0 * t)
    rate = np.gradient(depth, t)
    force = np.where(depth > 0, 800.0 * depth + 6.0 * rate, 0.0) + 0.02 * np.random.default_rng(5).standard_normal(
        len(t)
    )
    return kinid.Log(t=t, contact={"depth": depth, "normal_force": force})


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem.build(from_contact(kinid.contact_series(pressed(), kinid.Rig()), ("normal_force",)))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(1, 8))
def test_a_step_between_ends_makes_the_best_of_what_is_free(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((size, size))
    h, g = root @ root.T + 0.1 * np.eye(size), rng.standard_normal(size)
    low, high = -rng.exponential(size=size), rng.exponential(size=size)
    x = solve_box_constrained(h, g, low, high)
    assert ((x >= low) & (x <= high)).all()
    free = (x > low) & (x < high)
    np.testing.assert_allclose((h @ x)[free], g[free], atol=1e-8)
    wide = np.full(size, np.inf)
    np.testing.assert_allclose(h @ solve_box_constrained(h, g, -wide, wide), g, atol=1e-8)


@pytest.mark.parametrize("stiffness", [1.0, 1e3, 1e6])
def test_what_enters_linearly_begins_at_its_best(problem: Problem, stiffness: float) -> None:
    """From anywhere: where a search would end, but for what calibration leaves open."""
    error = first_error_model(problem)
    begun, least = project_linear(problem, MODEL, np.array([stiffness, -3.0]), error)
    found = search(problem, MODEL, np.array([700.0, 5.0]), error)
    np.testing.assert_allclose(begun, found.values, rtol=0.02)
    assert found.cost <= least
    again, same = project_linear(problem, MODEL, begun, error)
    np.testing.assert_allclose(again, begun, rtol=1e-6)
    assert same == pytest.approx(least)


def test_a_stiff_thing_is_found_from_the_usual_start() -> None:
    """Ninety times the nominal stiffness under a power law: thirty steps from the nominal one did not get there."""
    t = np.arange(10_000) / 250.0
    depth = 3e-3 * np.sin(1.3 * t) * np.linspace(0.3, 1.0, len(t))
    force = 9e4 * np.maximum(depth, 0.0) ** 1.79 + 0.01 * np.random.default_rng(5).standard_normal(len(t))
    log = kinid.Log(t=t, contact={"depth": depth, "normal_force": force})
    found = kinid.diagnose(log, kinid.Rig(), model=kinid.Model("hunt-crossley"))
    assert found.verdict == "adequate"
    exponent = found.fit.parameters["hunt-crossley.exponent"]
    assert exponent.low < 1.79 < exponent.high


def test_a_small_moment_begins_as_loose_as_the_force_at_its_lever() -> None:
    """A tip that turns by a hair makes millinewtonmetres of which a contact law knows nothing: before anything is known
    of what is left, they must not bend what explains twenty newtons."""
    log, rig = scripted_poke(seed=2).log, kinid.Rig.parse_text(RIG)
    problem = Problem.build(experiment_for(MODEL, log, rig))
    signals = problem.experiment.signals
    assert signals.sensor is not None
    force, moment = problem.channel_rms[:3].max(), problem.channel_rms[3:].max()
    lever = float(np.linalg.norm(signals.sensor.tip))
    error = first_error_model(problem)
    np.testing.assert_allclose(error.discrepancy[:3], 0.02 * force)
    np.testing.assert_allclose(error.discrepancy[3:], 0.02 * max(moment, lever * force))
    assert lever * force > 0.2 * moment
