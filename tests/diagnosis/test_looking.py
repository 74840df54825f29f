"""How the catalogue is looked at: on several cores, from a fit that ended a little beside its lowest place, in long logs."""

from __future__ import annotations

import dataclasses
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

import kinid
from kinid import effects
from kinid.diagnosis.candidates import able, screen
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.descent import State, _between, _Descent, cost_of, fit, settled
from kinid.diagnosis.effort import Effort
from kinid.diagnosis.inquiry import experiment_of
from kinid.diagnosis.look import FAR_BEHIND, _nearest, attempt, look, worth_searching
from kinid.diagnosis.problem import FINE, MOST_SAMPLES, PLENTY, RATE, Problem, thin
from kinid.experiment import Experiment

if TYPE_CHECKING:
    from conftest import Tester

Array = NDArray[np.float64]

MODEL = kinid.Model("kelvin-voigt")


@pytest.fixture(scope="module")
def problem(tester: Tester) -> Problem:
    """A spring that relaxes, as a spring and a dashpot."""
    experiment = experiment_of(tester.log(tester.relaxing()), kinid.Rig(), MODEL)
    return Problem.build(experiment, MODEL, np.array([700.0, 5.0]))


@pytest.fixture(scope="module")
def fitted(problem: Problem) -> State:
    """The model at its best."""
    return fit(problem, MODEL, np.array([700.0, 5.0]))


# ----------------------------------------------------------------------------------------------------------------- cores


def test_results_come_in_the_order_of_the_items() -> None:
    first = threading.Event()

    def last_first(i: int) -> int:
        if i == 0:
            assert first.wait(10.0)
        first.set()
        return i * i

    assert side_by_side(last_first, [2]) == [4]
    first.clear()
    assert side_by_side(lambda i: i * i, range(20)) == [i * i for i in range(20)]


def test_work_inside_of_work_stays_in_its_thread() -> None:
    def inner(_: int) -> int:
        return threading.get_ident()

    def outer(_: int) -> bool:
        return set(side_by_side(inner, range(3))) == {threading.get_ident()}

    assert all(side_by_side(outer, range(4)))


def test_an_error_comes_through() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda i: 1 // i, [2, 1, 0])


# -------------------------------------------------------------------------------------------------------------- screening


def _off(problem: Problem, fitted: State, share: float) -> State:
    """The same model where a search might have ended: a share of its standard errors away."""
    off = share * np.sqrt(np.diag(fitted.inverse))[: len(fitted.values)] * fitted.scale
    return fit(problem, MODEL, fitted.values + off, steps=0)


def test_what_the_model_does_itself_is_no_effects_merit(problem: Problem, fitted: State) -> None:
    """Without slip, a stiffness that depends on the place is the stiffness: it explains nothing, wherever a search ended."""
    state = _off(problem, fitted, 2.0)
    assert state.cost > fitted.cost + 1.0
    place = screen(state, effects.get("stiffness-inhomogeneity"))
    # to first order all that is left to gain is the model's own; what isn't, is curved: of second order
    assert all(point.gain < 1.0 for point in place)
    assert place[0].gain < screen(state, effects.get("relaxation"))[0].gain / 100


@pytest.mark.parametrize("share", [0.0, 1.0, 5.0])
def test_no_effect_explains_more_than_what_is_left(problem: Problem, fitted: State, share: float) -> None:
    state = _off(problem, fitted, share)
    points = [screen(state, effect) for effect, why in able(MODEL, problem.experiment.layout) if not why]
    gains = {found[0].effect.id: found[0].gain for found in points if found}
    assert len(gains) > 10
    assert max(gains.values()) <= state.cost
    assert "relaxation" in sorted(gains, key=lambda name: -gains[name])[:3]


def test_a_place_beside_another_is_not_searched_again(fitted: State) -> None:
    points = screen(fitted, effects.get("relaxation"))
    best = points[0]
    step = np.zeros_like(best.start)
    step[best.place] = best.effect.parameters(fitted.problem.experiment.layout)[0].scale
    beside, away = (dataclasses.replace(best, start=best.start + k * step) for k in (0.1, 1.0))
    assert worth_searching(fitted, [best, beside]) == [best]
    assert worth_searching(fitted, [best, away]) == [best, away]
    assert worth_searching(fitted, [best, dataclasses.replace(away, gain=0.1 * best.gain)]) == [best]
    # and rightly so: both end at the same place, to a tenth of what a further parameter costs
    costs = [attempt(fitted, best.effect, point).state.cost for point in (best, beside)]
    assert costs[0] == pytest.approx(costs[1], abs=0.4)


def test_what_promises_far_less_than_another_brought_is_passed_over(fitted: State) -> None:
    found = look(fitted, Effort())
    brought = {t.effect.id: fitted.cost - t.state.cost for t in found.tried}
    assert max(brought, key=lambda name: brought[name]) == "relaxation"
    gains = {c.effect.id: c.gain for c in found.screened}
    assert all(gains[name] >= FAR_BEHIND * brought["relaxation"] for name in list(brought)[2:])
    # beside a model that is there already, which brought ten times what any effect promises, none is worth a search
    assert not look(fitted, Effort(), goal=fitted.cost - 10.0 * max(gains.values())).tried


def test_a_refit_begins_where_calibration_stands(fitted: State) -> None:
    """So that it begins no higher than the model without the effect, which has found its surface already."""
    assert np.abs(fitted.shift).max() > 0.1
    for points in (screen(fitted, effects.get(name)) for name in ("relaxation", "hysteresis", "stiffening-layer")):
        values, shift = _nearest(fitted, MODEL + points[0].effect, points[0])
        assert cost_of(fitted.problem, MODEL + points[0].effect, values, shift) <= fitted.cost * (1.0 + 1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(1, 8))
def test_a_step_between_ends_makes_the_best_of_what_is_free(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((size, size))
    h, g = root @ root.T + 0.1 * np.eye(size), rng.standard_normal(size)
    low, high = -rng.exponential(size=size), rng.exponential(size=size)
    x = _between(h, g, low, high)
    assert ((x >= low) & (x <= high)).all()
    free = (x > low) & (x < high)
    np.testing.assert_allclose((h @ x)[free], g[free], atol=1e-8)
    wide = np.full(size, np.inf)
    np.testing.assert_allclose(h @ _between(h, g, -wide, wide), g, atol=1e-8)


# -------------------------------------------------------------------------------------------------------------- long logs


def _long(seconds: float, rate: float, channels: int = 1) -> Experiment:
    t = np.arange(round(seconds * rate)) / rate
    depth = 4e-3 * np.sin(1.3 * t)
    noise = 0.02 * np.random.default_rng(3).standard_normal((3, len(t)))
    contact = {"depth": depth, "normal_force": np.where(depth > 0, 900.0 * depth, 0.0) + noise[0]}
    for i in range(1, channels):
        contact |= {f"slip{i}": 1e-3 * np.sin(t), f"tangential_force{i}": noise[i]}
    return experiment_of(kinid.Log(t=t, contact=contact), kinid.Rig(), MODEL)


@pytest.mark.parametrize(("seconds", "rate", "channels", "many"), [
    (20.0, 500.0, 3, 1), (80.0, 200.0, 3, 1), (60.0, 500.0, 1, 1), (60.0, 500.0, 3, 2), (60.0, 1000.0, 3, 3),
    (120.0, 500.0, 3, 3), (200.0, 250.0, 1, 2), (300.0, 1000.0, 1, 8),
])  # fmt: skip
def test_long_logs_are_followed_in_means(seconds: float, rate: float, channels: int, many: int) -> None:
    whole = _long(seconds, rate, channels)
    assert len(whole.measured) == channels
    short = thin(whole)
    assert len(short.signals) == -(-len(whole.signals) // many)
    # no faster than asked for, and no slower unless the log is very long
    assert many == 1 or rate / many >= FINE - 1e-9 or len(short.signals) > MOST_SAMPLES // 2
    kept = len(whole.signals) // many * many
    mean = whole.measured[0, :kept].reshape(-1, many).mean(axis=1)
    np.testing.assert_allclose(short.measured[0, : len(mean)], mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(short.noise, whole.noise / np.sqrt(many))


@pytest.mark.parametrize(("seconds", "channels"), [(20.0, 3), (60.0, 1), (70.0, 3), (100.0, 3)])
def test_of_many_readings_fewer_means_are_compared(seconds: float, channels: int) -> None:
    """Means are the faster the fewer there are, and none is lost: each sample is in one of them."""
    problem = Problem.build(thin(_long(seconds, 500.0, channels)), MODEL, np.array([900.0, 0.0]))
    rate = len(problem.edge) / seconds
    if channels * seconds * RATE < PLENTY:
        assert RATE <= rate < 1.5 * RATE
    else:
        assert 0.5 * RATE <= rate < RATE
    assert problem.count.sum() == len(problem.experiment.signals)


def test_readings_below_a_frequency() -> None:
    """The band against scipy's own filter, and a channel that holds nothing stays so."""
    experiment = dataclasses.replace(_long(20.0, 500.0), band=25.0)
    readings = np.random.default_rng(1).standard_normal((3, len(experiment.signals)))
    readings[1] = 0.0
    found = experiment.in_band(readings)
    wanted = sosfiltfilt(butter(4, 25.0, output="sos", fs=500.0), readings, axis=1)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
    assert not found[1].any()


# --------------------------------------------------------------------------------------------------------------- beginning


@pytest.mark.parametrize("stiffness", [1.0, 1e3, 1e6])
def test_what_enters_linearly_begins_at_its_best(problem: Problem, fitted: State, stiffness: float) -> None:
    """From anywhere: without calibration's tolerances, where a search would end."""
    found = settled(problem, MODEL, np.array([stiffness, -3.0]))
    plain = fit(problem, MODEL, np.array([700.0, 5.0]), calibrate=False)
    np.testing.assert_allclose(found, plain.values, rtol=1e-5)
    assert fitted.cost <= plain.cost + 1e-6


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


def test_a_bias_pulls_at_no_material(problem: Problem) -> None:
    """A sensor that reads −2 N in the air: what of a reading is open is what it is without the bias."""
    layout = problem.experiment.layout
    biased = MODEL + effects.get("sensor-bias")
    values = np.array([700.0, 5.0])
    with_bias = np.r_[values, -2.0] if list(biased.parameters(layout))[-1].startswith("sensor-bias") else np.r_[-2.0, values]
    open_ = [Problem.build(problem.experiment, *fitted).sigma for fitted in ((MODEL, values), (biased, with_bias))]
    # the share of a reading that no law gets right is of the biased one: 0.2 % of 2 N
    np.testing.assert_allclose(open_[1], open_[0], rtol=0, atol=0.004)


def test_what_a_step_taught_is_in_both_views(problem: Problem, fitted: State) -> None:
    """Broyden's update meets what the step did, and JᵀJ stays that of J."""
    descent = _Descent(problem, MODEL, fitted.values, fitted.shift)
    jacobian, squares = descent.view()
    rng = np.random.default_rng(4)
    moved = np.zeros(jacobian.shape[1])
    moved[: descent.curved] = rng.standard_normal(descent.curved)
    actual = rng.standard_normal(len(jacobian))
    descent.learn(jacobian, squares, moved, actual)
    np.testing.assert_allclose(jacobian @ moved, actual, rtol=0, atol=1e-9 * np.abs(jacobian).max())
    np.testing.assert_allclose(squares, jacobian.T @ jacobian, rtol=1e-9, atol=1e-9 * np.abs(squares).max())
