"""Readings of a coarse converter: what they leave open, the noise before it, and effects that hide behind its steps."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import kinid
from kinid.diagnosis import rounding
from kinid.diagnosis.descent import _Descent, fit
from kinid.diagnosis.detectors import detect
from kinid.diagnosis.inquiry import experiment_of
from kinid.diagnosis.problem import Problem

if TYPE_CHECKING:
    from conftest import Tester

Array = NDArray[np.float64]

RATE = 500.0
STEP = 0.25
RIG = kinid.Rig()
sizes = st.floats(-50.0, 50.0)


def moving_force(seed: int = 0, seconds: float = 40.0) -> Array:
    """A force that passes steps at many speeds."""
    t = np.arange(round(seconds * RATE)) / RATE
    a, b, c, d = np.random.default_rng(seed).uniform(0.7, 1.5, 4)
    out: Array = 2.0 * a + 2.0 * b * np.sin(c * t) + 0.5 * d * np.sin(5.0 * c * d * t)
    return out


# ------------------------------------------------------------------------------------------------------------- functions


@given(arrays(float, (2, 7), elements=sizes), arrays(float, (2, 7), elements=sizes), st.floats(1e-3, 5.0))
def test_a_reading_is_contradicted_by_what_lies_beyond_half_a_step(read: Array, predicted: Array, step: float) -> None:
    steps = np.array([step, 0.0])
    left = read - rounding.nearest(read, predicted, steps)
    beyond = np.maximum(np.abs(read - predicted) - 0.5 * steps[:, None], 0.0)
    # floats of up to 50: rounding of 1e-14 each
    assert np.abs(np.abs(left) - beyond).max() < 1e-12
    told = rounding.contradicted(read, predicted, steps)
    assert ((beyond > 1e-12) <= told).all()
    assert (np.abs(left)[~told] < 1e-12).all()


@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2, 0.4, 0.8])
def test_the_noise_before_a_converter_is_seen_though_readings_hardly_show_it(ratio: float) -> None:
    noise, found = ratio * STEP, []
    for seed in range(5):
        force = moving_force(seed)
        raw = STEP * np.round((force + noise * np.random.default_rng(seed).standard_normal(len(force))) / STEP)
        # what a model expects is off by 2 % and a sixth of a step
        found.append(rounding.blur(raw, STEP, 1.02 * force + 0.04, 1 / RATE))
    # a log passes some 200 steps: each is known to 10 %, and the median of five to 5 %
    assert np.median(found) == pytest.approx(noise, rel=0.15)
    assert max(found) < 1.4 * noise
    assert min(found) > 0.7 * noise


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.3])
def test_what_neighbours_share_of_a_rounding_error(ratio: float) -> None:
    """Against a converter: the mean of its error over noise, at many places within a step."""
    rng = np.random.default_rng(0)
    places = np.linspace(0.0, 1.0, 200, endpoint=False)
    noise = ratio * rng.standard_normal((40_000, 1))
    mean = np.mean(np.round(places + noise) - places - noise, axis=0)
    # 40 000 draws leave a mean to 0.0015 of a step, beside errors of 0.036 to 0.28
    assert rounding.shared(np.array([1.0]), np.array([ratio]))[0] == pytest.approx(float(np.mean(mean**2)), rel=0.08)


@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2])
def test_what_noise_leaves_of_a_right_model(ratio: float) -> None:
    force, rng = moving_force(), np.random.default_rng(1)
    raw = STEP * np.round((force + ratio * STEP * rng.standard_normal(len(force))) / STEP)
    steps = np.array([STEP])
    left = (raw - rounding.nearest(raw[None], force[None], steps)[0]).reshape(-1, 4).mean(axis=1)
    usual = rounding.usual(np.array([ratio]), np.array([4.0]))[0]
    # while a force passes a step within four samples, neighbours share less than where it rests: up to a third
    assert float(np.mean(left**2)) / ((ratio * STEP) ** 2 / 4) == pytest.approx(usual, rel=0.35)


# ----------------------------------------------------------------------------------------------------------------- search


def rounded(tester: Tester, force: Array, step: float = STEP) -> kinid.Log:
    """The log of a force whose converter has this step."""
    log = tester.log(force)
    read = step * np.round(log.contact["normal_force"] / step)
    return kinid.Log(t=log.t, contact={**log.contact, "normal_force": read}, phase=log.phase)


def problem_of(log: kinid.Log, model: kinid.Model, values: Array) -> Problem:
    experiment = experiment_of(log, RIG, model)
    cleaned = detect(experiment, model.names, model.predict(experiment.signals, values)).experiment
    assert cleaned.steps is not None
    return Problem.build(cleaned, model, values)


def test_sensitivities_are_those_of_what_is_compared(tester: Tester) -> None:
    """Against differences of a step so small that hardly a reading begins to be contradicted."""
    model, values = kinid.Model("kelvin-voigt"), np.array([900.0, 4.0])
    problem = problem_of(rounded(tester, tester.kelvin_voigt()), model, values)
    at = _Descent(problem, model, values, np.zeros(len(problem.calibration)))
    jacobian = at.sensitivity()
    for j, scale in enumerate(at.scale):
        ahead = values.copy()
        ahead[j] += 1e-6 * scale
        moved, _, _ = at.compared(at.predict(ahead, at.shift), at.shift)
        difference = (moved - at.stacked) / 1e-6
        assert np.linalg.norm(difference - jacobian[:, j]) < 0.02 * np.linalg.norm(jacobian[:, j])


def test_calibration_acts_as_far_as_it_goes(tester: Tester) -> None:
    """What is compared at a shift is the law with its surface, clock and bias moved by that."""
    model, values = kinid.Model("kelvin-voigt"), np.array([800.0, 6.0])
    problem = problem_of(rounded(tester, tester.kelvin_voigt()), model, values)
    shift = np.array([1.5, 0.0, -2.0])
    at = _Descent(problem, model, values, shift)
    s = problem.experiment.signals
    moved = model.predict(dataclasses.replace(s, depth=s.depth + 1.5 * 1.5e-5), values) - 2.0 * 0.01
    assert np.abs(at.stacked - problem.expected(moved)).max() < 1e-9


@settings(max_examples=8, deadline=None)
@given(st.floats(0.15, 0.6))
def test_stiffness_and_damping_come_back_through_a_converter(tester: Tester, step: float) -> None:
    model = kinid.Model("kelvin-voigt")
    log = rounded(tester, tester.kelvin_voigt(), step)
    problem = problem_of(log, model, np.array([800.0, 6.0]))
    found = fit(problem, model, np.array([500.0, 2.0])).values
    # steps of seven to thirty times the noise: a hundred transitions, each to a few times the noise of 0.02 N
    assert found[0] == pytest.approx(800.0, rel=0.02)
    assert found[1] == pytest.approx(6.0, rel=0.15)


def test_a_dashpot_hides_behind_steps_of_twelve_times_the_noise(tester: Tester) -> None:
    found = kinid.diagnose(rounded(tester, tester.kelvin_voigt()), RIG, model=kinid.Model("hooke"))
    assert found.verdict == "missing"
    assert set(found.added) & {"viscous-damping", "time-offset"}
    assert "quantization" in found.added


@pytest.mark.parametrize("step", [0.1, 0.25, 0.5, 1.0])
def test_nothing_is_found_in_the_steps_themselves(tester: Tester, step: float) -> None:
    found = kinid.diagnose(rounded(tester, tester.kelvin_voigt(), step), RIG, model=kinid.Model("kelvin-voigt"))
    assert found.added == ("quantization",)
    assert found.verdict == "missing"


@pytest.mark.parametrize("step", [0.0, STEP])
def test_a_channel_that_never_changes_hides_no_friction(tester: Tester, step: float) -> None:
    """Nothing slides along the second tangent: its sensor reads nought throughout, and is no proof against friction."""
    force = tester.kelvin_voigt()
    log = tester.log(force, tester.rubbing(force))
    names = ("normal_force", "tangential_force1")
    read = {name: step * np.round(log.contact[name] / step) if step else log.contact[name] for name in names}
    read["tangential_force2"] = np.zeros(len(log.t))
    log = kinid.Log(t=log.t, contact={**log.contact, **read}, phase=log.phase)
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"))
    assert found.added[0] == "coulomb-friction"
    friction = found["coulomb-friction"].parameters["coefficient"]
    assert friction.value == pytest.approx(0.4, rel=0.05)
