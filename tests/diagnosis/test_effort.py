"""How much work a search does: bounded, counted, the same on every machine, and told where it wasn't enough."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest

import kinid
from kinid import effects
from kinid.diagnosis.candidates import screen
from kinid.diagnosis.descent import cost_of, fit
from kinid.diagnosis.effort import AGAIN, PREDICTIONS, RIVALS, Effort, weight_of
from kinid.diagnosis.inquiry import experiment_of
from kinid.diagnosis.look import attempt, look, pursue
from kinid.diagnosis.problem import Problem
from kinid.errors import InputError

if TYPE_CHECKING:
    from conftest import Tester

RIG = kinid.Rig()
MODEL = kinid.Model("kelvin-voigt")


@pytest.fixture(scope="module")
def relaxing(tester: Tester) -> kinid.Log:
    """A spring that relaxes."""
    return tester.log(tester.relaxing())


@pytest.fixture(scope="module")
def problem(relaxing: kinid.Log) -> Problem:
    """The same, as a spring and a dashpot."""
    return Problem.build(experiment_of(relaxing, RIG, MODEL), MODEL, np.array([700.0, 5.0]))


def test_where_the_work_is_enough_more_changes_nothing(relaxing: kinid.Log) -> None:
    usual, more = (kinid.diagnose(relaxing, RIG, model=MODEL, effort=effort) for effort in (1.0, 50.0))
    assert usual.added == ("relaxation",)
    assert usual.to_dict() == more.to_dict()


def test_a_search_without_work_says_what_it_did_not_try(relaxing: kinid.Log) -> None:
    found = kinid.diagnose(relaxing, RIG, model=MODEL, effort=1e-3)
    assert (found.verdict, found.added) == ("unexplained", ())
    assert "had done all the work" in found.says
    assert "--effort" in found.says
    assert found["relaxation"].verdict == "not-excited"
    assert "left out" in found["relaxation"].says
    assert "--add relaxation" in found["relaxation"].separate_by
    assert any("relaxation" in told and "--add" in told for told in found.warnings)


def test_what_is_asked_for_is_added_without_any_work(relaxing: kinid.Log) -> None:
    found = kinid.diagnose(relaxing, RIG, model=MODEL, add=["relaxation"], effort=1e-3)
    usual = kinid.diagnose(relaxing, RIG, model=MODEL)
    assert found.steps == usual.steps


@pytest.mark.parametrize("effort", [0.0, -1.0, float("nan"), float("inf")])
def test_an_effort_that_is_no_share_is_refused(relaxing: kinid.Log, effort: float) -> None:
    with pytest.raises(InputError, match="a number above 0"):
        kinid.diagnose(relaxing, RIG, model=MODEL, effort=effort)


def test_a_look_spends_what_its_refits_took_and_refits_nothing_when_it_is_spent(problem: Problem) -> None:
    state = fit(problem, MODEL, np.array([700.0, 5.0]))
    effort = Effort(10_000.0)
    found = look(state, effort)
    points = weight_of(MODEL, problem) * sum(map(len, found.points.values()))
    # at least what is known of it: places that were looked at, and searches that were kept
    assert 10_000.0 - effort.left >= points + sum(t.work for t in found.tried) > points
    assert not effort.short
    none = Effort(1.0)
    assert not look(state, none).tried
    assert none.short


def test_a_search_that_is_taken_up_stops_with_the_work(problem: Problem) -> None:
    state = fit(problem, MODEL, np.array([700.0, 5.0]))
    hysteresis = effects.get("hysteresis")
    tried = attempt(state, hysteresis, screen(state, hysteresis)[0])
    # as if it had still gone down
    tried = dataclasses.replace(tried, state=dataclasses.replace(tried.state, converged=False))
    assert pursue(state, tried, most=-1.0).work == tried.work
    assert pursue(state, tried).work > tried.work


def test_predictions_behind_an_arm_that_gives_way_count_for_more(problem: Problem) -> None:
    soft = kinid.Model("kelvin-voigt", "hysteresis", "structural-compliance")
    rigid, bent = (weight_of(model, problem) for model in (MODEL, soft))
    assert bent > 2.0 * rigid
    few = Problem.build(problem.experiment.thinned(4), MODEL, np.array([700.0, 5.0]))
    assert weight_of(MODEL, few) <= rigid <= 1.0


def test_what_a_search_carries_along_behind_a_soft_arm_is_what_a_fresh_prediction_gives(tester: Tester) -> None:
    """Each step begins beside the agreement of arm and law of the last one; their misses don't add up."""
    model = kinid.Model("kelvin-voigt", "hysteresis", "structural-compliance")
    problem = Problem.build(experiment_of(tester.log(tester.relaxing()), RIG, MODEL), MODEL, np.array([700.0, 5.0]))
    start = model.nominal(problem.experiment.layout)
    start[:2], start[-1] = (700.0, 5.0), 1e-4
    found = fit(problem, model, start)
    assert found.work > 50.0
    assert cost_of(problem, model, found.values, found.shift) == pytest.approx(found.cost, rel=1e-5)


def test_the_work_is_bounded_where_no_law_has_the_right_form(tester: Tester, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring that yields behind a play, and pulls: the catalogue's loops and bonds mop it up, each a little better."""
    play, yielding = 0.0, []
    for depth in np.maximum(tester.depth, 0.0):
        play = min(max(play, depth - 4e-4), depth + 4e-4) if depth > 0.0 else 0.0
        yielding.append(play)
    force = 900.0 * np.array(yielding) * (1.0 + 0.4 * np.sin(2e3 * tester.depth)) + 9.0 * tester.rate * (tester.depth > 0)
    asked = 0
    lock = threading.Lock()
    for name in ("predict", "course"):
        do = getattr(kinid.Model, name)

        def counted(*args: object, do: Callable[..., object] = do) -> object:
            nonlocal asked
            with lock:
                asked += 1
            return do(*args)

        monkeypatch.setattr(kinid.Model, name, counted)
    log = tester.log(force)
    found = kinid.diagnose(log, RIG, model=MODEL, effort=0.05)
    little, asked = asked, 0
    kinid.diagnose(log, RIG, model=MODEL)
    print(f"{found.verdict} {found.added}: predictions {little}, with the usual effort {asked}")
    # a log this short may have five times as many as one of a minute; noise, intervals and errors take some besides
    assert little < 0.05 * 5 * (PREDICTIONS + AGAIN + RIVALS) + 300
    assert asked > 3 * little
    assert found.verdict == "unexplained"
