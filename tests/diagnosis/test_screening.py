"""One look at the catalogue: what an effect promises is its own merit, and no more than what is left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import kinid
from kinid import effects
from kinid.diagnosis.screening import screen, screen_catalogue
from kinid.diagnosis.selection import screen_and_refit
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.identification.covariance import covariance_of
from kinid.identification.estimation import estimate
from kinid.identification.solver import search
from kinid.identification.state import State
from kinid.modeling.readings import all_channels

if TYPE_CHECKING:
    from conftest import Tester

MODEL = kinid.Model("kelvin-voigt")


@pytest.fixture(scope="module")
def fitted(tester: Tester) -> State:
    """A spring that relaxes, as a spring and a dashpot."""
    return estimate(MODEL, all_channels(tester.log(tester.relaxing()), kinid.Rig(), MODEL))


def _off(state: State, share: float) -> State:
    """The same model where a search might have ended: a share of its standard errors away."""
    off = share * np.sqrt(np.diag(covariance_of(state).matrix))
    return search(state.problem, MODEL, state.values + off, state.error, shift=state.shift, max_steps=0)


def test_what_the_model_does_itself_is_no_effects_merit(fitted: State) -> None:
    """A gain of the one sensor is the stiffness: it promises nothing, wherever a search ended; others promise no more
    there.
    """
    state = _off(fitted, 2.0)
    assert state.cost > fitted.cost + 1.0
    for name in ("sensor-gain", "relaxation", "stiffening-layer"):
        here, there = (
            points[0].predicted_gain if (points := screen(s, effects.get(name))) else 0.0 for s in (fitted, state)
        )
        # to first order all that is left to gain is the model's own; what isn't, is curved: of second order
        assert abs(there - here) < 0.1 * (state.cost - fitted.cost) + 0.05 * abs(here)


@pytest.mark.parametrize("share", [0.0, 1.0, 5.0])
def test_no_effect_explains_more_than_what_is_left(fitted: State, share: float) -> None:
    state = _off(fitted, share)
    gains = {name: points[0].predicted_gain for name, points in screen_catalogue(state).items()}
    assert len(gains) > 10
    assert max(gains.values()) <= state.cost
    assert "relaxation" in sorted(gains, key=lambda name: -gains[name])[:3]


def test_what_promises_far_less_than_the_best_is_passed_over(fitted: State) -> None:
    settings = DiagnosisSettings()
    found = screen_and_refit(fitted, settings)
    assert found.refits[0].effect.id == "relaxation"
    promised = {name: points[0].predicted_gain for name, points in found.points.items()}
    best = max(promised.values())
    assert 1 <= len(found.refits) <= settings.refits
    assert all(promised[t.effect.id] > settings.promising_share * best for t in found.refits)


def test_a_refit_ends_no_higher_than_the_model_without_the_effect(fitted: State) -> None:
    """What calibration has found already is not lost by adding an effect."""
    for refit in screen_and_refit(fitted, DiagnosisSettings()).refits:
        assert refit.state.cost <= fitted.cost * (1.0 + 1e-6), refit.effect.id


def test_what_no_law_has_leaves_little_work(tester: Tester, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring that yields behind a play, and pulls: the catalogue's loops and bonds mop it up, each a little
    better.
    """
    play, yielding = 0.0, []
    for depth in np.maximum(tester.depth, 0.0):
        play = min(max(play, depth - 4e-4), depth + 4e-4) if depth > 0.0 else 0.0
        yielding.append(play)
    force = 900.0 * np.array(yielding) * (1.0 + 0.4 * np.sin(2e3 * tester.depth)) + 9.0 * tester.rate * (
        tester.depth > 0
    )
    asked: list[int] = []
    course = kinid.Model.course
    monkeypatch.setattr(kinid.Model, "course", lambda *a, **k: (asked.append(1), course(*a, **k))[1])
    found = kinid.diagnose(tester.log(force), kinid.Rig(), model=MODEL)
    print(f"{found.verdict} {found.added}: {len(asked)} predictions")
    assert found.verdict == "unexplained"
    assert len(asked) < 30_000
