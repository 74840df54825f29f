"""What may be left, what is called left, and what follows from it: verdicts, stand-ins, absences, noise that is too
small.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

import kinid
from kinid.diagnosis import Diagnosis
from kinid.errors import InputError
from kinid.identification.lack_of_fit import TOLERANCE
from kinid.modeling.applicability import candidate_effects

if TYPE_CHECKING:
    from conftest import Tester

Array = NDArray[np.float64]

RIG = kinid.Rig()


def strange(tester: Tester, size: float, force: Array | None = None) -> Array:
    """A spring and a dashpot, and a force over depth that no law has: three swings on the way down, of so many
    newtons.
    """
    swings = np.sin(2.0 * np.pi * tester.depth / 1.1e-3)
    return np.where(tester.depth > 0, (tester.kelvin_voigt() if force is None else force) + size * swings, 0.0)


@pytest.fixture(scope="module")
def unexplained(tester: Tester) -> Diagnosis:
    return kinid.diagnose(tester.log(strange(tester, 0.3)), RIG, model=kinid.Model("kelvin-voigt"))


# --------------------------------------------------------------------------------------------------------------
# tolerance


def test_a_tolerance_larger_than_what_is_left_turns_unexplained_into_adequate(
    tester: Tester, unexplained: Diagnosis
) -> None:
    """The same numbers, and another verdict: the tolerance decides what matters, not what is found."""
    assert unexplained.verdict == "unexplained"
    assert unexplained.left.excess > unexplained.left.tolerance
    log, model = tester.log(strange(tester, 0.3)), kinid.Model("kelvin-voigt")
    wide = kinid.diagnose(log, RIG, model=model, tolerance=1.1 * unexplained.left.excess)
    assert wide.verdict == ("missing" if unexplained.added else "adequate")
    assert wide.added == unexplained.added
    assert [step.held_out for step in wide.steps] == [step.held_out for step in unexplained.steps]
    assert wide.left.excess == unexplained.left.excess
    plain = kinid.diagnose(log, RIG, model=model, max_effects=0)
    assert plain.verdict == "unexplained"
    assert kinid.diagnose(log, RIG, model=model, max_effects=0, tolerance=1.1 * plain.left.excess).verdict == "adequate"
    assert (
        kinid.diagnose(log, RIG, model=model, max_effects=0, tolerance=0.9 * plain.left.excess).verdict == "unexplained"
    )


def test_what_is_not_stated_is_two_percent_of_the_readings_or_the_noise(tester: Tester, unexplained: Diagnosis) -> None:
    log = tester.log(strange(tester, 0.3))
    reading = np.sqrt(np.mean(log.contact["normal_force"][tester.depth > 0] ** 2))
    assert unexplained.left.reading == pytest.approx(reading, rel=0.02)
    assert unexplained.left.tolerance == pytest.approx(
        max(TOLERANCE * unexplained.left.reading, unexplained.left.noise)
    )


@pytest.mark.parametrize("tolerance", [-0.1, float("nan"), float("inf")])
def test_a_tolerance_that_is_none_is_refused(tester: Tester, tolerance: float) -> None:
    with pytest.raises(InputError, match="0 or more"):
        kinid.diagnose(tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"), tolerance=tolerance)


def test_a_tolerance_beyond_all_readings_is_doubted(tester: Tester) -> None:
    log = tester.log(strange(tester, 0.3))
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"), max_effects=0, tolerance=1000.0)
    assert any("more than the readings' own root mean square" in doubt for doubt in found.warnings)


def test_none_at_all_may_be_left_of_noise(tester: Tester) -> None:
    """A tolerance of nought is one: of a right model nothing is left beside noise that chance would not make."""
    found = kinid.diagnose(tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"), tolerance=0.0)
    assert found.left.tolerance == 0.0
    assert found.added == ()
    assert found.verdict == "adequate" or found.left.excess < 0.5 * found.left.noise


def test_the_numbers_stand_in_the_json(tester: Tester, unexplained: Diagnosis) -> None:
    """Of what the contract lists, beside the error; shares grow from step to step where errors fall."""
    for found in (unexplained, kinid.diagnose(tester.log(tester.relaxing()), RIG, model=kinid.Model("hooke"))):
        facts = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        noise, errors = found.left.noise, [step["error"]["held_out"] for step in facts["steps"]]
        assert facts["tolerance"] == found.left.tolerance
        assert facts["left"] == {
            "rms": pytest.approx(errors[-1]),
            "share_of_reading": pytest.approx(found.left.share_of_reading),
            "memory_s": found.left.memory,
        }
        beyond = max(errors[0] ** 2 - noise**2, 1e-300)
        for step, error in zip(facts["steps"], errors):
            assert step["explained"] == pytest.approx(np.clip((errors[0] ** 2 - error**2) / beyond, 0.0, 1.0), abs=1e-9)
        assert facts["explained"] == facts["steps"][-1]["explained"]


def test_what_is_left_remembers_itself_and_noise_does_not(tester: Tester, unexplained: Diagnosis) -> None:
    right = kinid.diagnose(tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"))
    assert right.left.memory < 0.02  # white at 250 Hz
    assert unexplained.left.memory > 0.05  # swings as a tool is pressed in, in a quarter of a second


# --------------------------------------------------------------------------------------------------------------
# stand-ins


def test_what_takes_off_less_than_is_left_is_a_stand_in(tester: Tester) -> None:
    """Beside what no law has, additions follow it here and there: none of them is called present."""
    for size in (0.2, 0.3, 0.6):
        found = kinid.diagnose(tester.log(strange(tester, size)), RIG, model=kinid.Model("kelvin-voigt"))
        print(size, found.verdict, [(e.id, e.verdict, e.says[:30]) for e in found.effects if e.id in found.added])
        assert found.verdict == "unexplained"
        assert not [e.id for e in found.effects if e.verdict == "present"]
        for name in found.added:
            assert found[name].verdict == "indistinguishable"
            assert found[name].says.startswith("a stand-in")


def test_what_takes_off_most_stays_present_beside_what_is_left(tester: Tester) -> None:
    """A force that relaxes, beside a third of it that no law has: found, though the diagnosis ends unexplained."""
    found = kinid.diagnose(tester.log(strange(tester, 0.06, tester.relaxing())), RIG, model=kinid.Model("kelvin-voigt"))
    print(found, [step.held_out for step in found.steps])
    assert found.verdict == "unexplained"
    assert "relaxation" in found.added
    assert found["relaxation"].verdict == "present"
    # 0.3 of the force at once
    assert found["relaxation"].parameters["ratio"].value == pytest.approx(0.3 / 0.7, rel=0.1)
    assert found.explained > 0.7


# ---------------------------------------------------------------------------------------------------- absent, not
# excited


@pytest.mark.parametrize(("name", "model"), [("relaxation", "kelvin-voigt"), ("damping", "hooke")])
def test_what_a_look_at_the_residual_shows_is_never_not_excited(tester: Tester, name: str, model: str) -> None:
    """An effect of many times what is left is there or was left out, however many were asked for: this log can tell."""
    force = tester.relaxing() if name == "relaxation" else tester.kelvin_voigt()
    log, effect = tester.log(force), {"relaxation": "relaxation", "damping": "viscous-damping"}[name]
    full = kinid.diagnose(log, RIG, model=kinid.Model(model))
    size = full.steps[0].held_out ** 2 - full.steps[-1].held_out ** 2
    assert np.sqrt(size) > 0.9 * full.left.rms  # it is there to be seen
    for most in (0, 1, 8):
        found = kinid.diagnose(log, RIG, model=kinid.Model(model), max_effects=most)
        asked = found[effect]
        assert asked.verdict in ("present", "indistinguishable") or asked.left_out, (most, asked.verdict, asked.says)


@pytest.mark.parametrize(
    "effect", ["relaxation", "hysteresis", "stress-softening", "adhesion", "time-offset", "surface-offset"]
)
@pytest.mark.parametrize("share", [5.0, 10.0])
def test_an_effect_of_five_times_what_is_left_shows(tester: Tester, effect: str, share: float) -> None:
    """Each planted by the catalogue's own law: what a refitted model cannot take up of it is `share` times the
    noise.
    """
    size = {
        "relaxation": {"ratio": 0.3, "time-constant": 0.4},
        "hysteresis": {"ratio": 0.3, "length": 1e-3},
        "stress-softening": {"ratio": 0.3, "length": 1e-3},
        "adhesion": {"force": 0.6, "length": 4e-4},
        "time-offset": {"delay": 0.02},
        "surface-offset": {"offset": 5e-4},
    }[effect]
    model, larger = kinid.Model("kelvin-voigt"), kinid.Model("kelvin-voigt", effect)
    values = {"kelvin-voigt.stiffness": 800.0, "kelvin-voigt.damping": 6.0} | {
        f"{effect}.{k}": v for k, v in size.items()
    }
    signals = model.fit(kinid.contact_series(tester.log(tester.kelvin_voigt()), RIG), held_out=False).experiment.signals
    clean = larger.predict(signals, values)[0]
    quiet = kinid.Log(t=tester.t, contact={"depth": tester.depth, "normal_force": clean}, phase=tester.phase)
    worth = model.fit(kinid.contact_series(quiet, RIG), held_out=False).error.train  # what the model can't take up
    noise = worth / share * np.random.default_rng(7).standard_normal(len(clean))
    log = kinid.Log(t=tester.t, contact={"depth": tester.depth, "normal_force": clean + noise}, phase=tester.phase)
    found = kinid.diagnose(log, RIG, model=model)
    asked = found[effect]
    print(effect, share, found.verdict, found.added, asked.verdict)
    assert asked.verdict != "not-excited", asked.says
    assert found.verdict != "adequate"


def test_what_cannot_act_is_told_from_what_is_not_excited(unexplained: Diagnosis) -> None:
    able = {effect.id for effect, why in candidate_effects(unexplained.best, unexplained.experiment.layout) if not why}
    for effect in unexplained.effects:
        assert effect.acts == (effect.id in able or effect.id in unexplained.added), effect.id


# ------------------------------------------------------------------------------------------------- noise that is too
# small


@pytest.mark.parametrize("cutoff", [20.0, pytest.param(60.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("model", ["kelvin-voigt", "hooke"])
def test_readings_low_passed_before_logging_are_diagnosed_alike(tester: Tester, cutoff: float, model: str) -> None:
    """A sensor's filter takes most of the white noise and leaves what moves: noise too small to be believed decides
    nothing.
    """
    log = tester.log(tester.relaxing())
    sos = butter(2, cutoff, fs=250.0, output="sos")
    force = sosfiltfilt(sos, log.contact["normal_force"])
    filtered = kinid.Log(t=log.t, contact={**log.contact, "normal_force": force}, phase=log.phase)
    raw, smooth = (kinid.diagnose(one, RIG, model=kinid.Model(model)) for one in (log, filtered))
    print(cutoff, raw.added, smooth.added, f"noise {raw.noise_floor:.3g} → {smooth.noise_floor:.3g}", smooth.says)
    assert set(smooth.added) == set(raw.added)
    assert smooth.verdict == raw.verdict == "missing"


def test_a_right_model_of_low_passed_readings_is_adequate(tester: Tester) -> None:
    """What the filter rounds off at each touch is many times the white noise that it leaves, and inside the
    tolerance.
    """
    log = tester.log(tester.kelvin_voigt())
    force = sosfiltfilt(butter(4, 15.0, fs=250.0, output="sos"), log.contact["normal_force"])
    found = kinid.diagnose(
        kinid.Log(t=log.t, contact={**log.contact, "normal_force": force}, phase=log.phase),
        RIG,
        model=kinid.Model("kelvin-voigt"),
    )
    print(found.added, found.says)
    assert found.verdict != "unexplained"
    assert found.left.excess < found.left.tolerance
    assert set(found.added) <= {"sensor-lag", "time-offset"}


def test_the_form_of_friction_at_rest_is_no_finding_inside_the_tolerance(tester: Tester) -> None:
    """Bristles of 0.02 to 0.2 mm are no other friction than the usual 0.1 mm; those of 0.5 mm give before they slip."""
    model, force = kinid.Model("kelvin-voigt", "coulomb-friction"), tester.kelvin_voigt()
    for length, added, verdict in ((2e-5, (), "adequate"), (2e-4, (), "adequate"), (5e-4, ("presliding",), "missing")):
        found = kinid.diagnose(tester.log(force, tester.rubbing(force, length)), RIG, model=model)
        print(length, found, found["presliding"].says)
        assert (found.added, found.verdict) == (added, verdict)


def test_a_clock_as_many_a_rig_has_is_no_finding_inside_the_tolerance(tester: Tester) -> None:
    """Forces of a ball 3 ms late: no dashpot does the same; it is said with its evidence, and not added."""
    log = tester.log(tester.kelvin_voigt())
    force = 9e3 * np.maximum(log.contact["depth"], 0.0) ** 1.5
    late = np.interp(log.t - 3e-3, log.t, force) + 0.002 * np.random.default_rng(3).standard_normal(len(force))
    ball = kinid.Log(t=log.t, contact={**log.contact, "normal_force": late}, phase=log.phase)
    found = kinid.diagnose(ball, RIG, model=kinid.Model("hertz"))
    print(found, found["time-offset"].says)
    assert (found.added, found.verdict) == ((), "adequate")
    assert "inside the tolerance" in found["time-offset"].says
