"""What a diagnosis promises, on short logs whose equations stand in `conftest.py`."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import kinid
from kinid import effects
from kinid.diagnosis import Diagnosis
from kinid.errors import InputError
from kinid.identification.fit import Fit

if TYPE_CHECKING:
    from conftest import Tester

RIG = kinid.Rig()
#: as in `conftest.py`
SHARE, DECAY, NOISE = 0.3, 0.45, 0.02
VERDICTS = {"present", "absent", "not-excited", "indistinguishable"}


@pytest.fixture(scope="module")
def fit(relaxing_log: kinid.Log) -> Fit:
    """What a user starts from: the log's model without the relaxation."""
    return kinid.Model("kelvin-voigt", "coulomb-friction").fit(kinid.contact_series(relaxing_log, RIG))


@pytest.fixture(scope="module")
def found(fit: Fit) -> Diagnosis:
    return kinid.diagnose(fit)


@pytest.fixture(scope="module")
def nothing(tester: Tester) -> Diagnosis:
    """Of a log that the model describes fully."""
    return kinid.diagnose(tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"))


def short(tester: Tester, rows: slice = slice(None), **columns: Any) -> kinid.Log:
    """Part of a log of depth and force, with columns replaced; None takes one away."""
    log = tester.log(tester.kelvin_voigt())
    contact = {name: values for name, values in {**log.contact, **columns}.items() if values is not None}
    return kinid.Log(
        t=log.t[rows], contact={name: values[rows] for name, values in contact.items()}, phase=log.phase[rows]
    )


# ------------------------------------------------------------------------------------------------ what a user does with
# it


def test_the_effect_is_found_added_and_the_error_falls_to_the_noise(
    fit: Fit, found: Diagnosis, relaxing_log: kinid.Log
) -> None:
    assert found.verdict == "missing"
    assert found.added == ("relaxation",)
    touch = kinid.contact_series(relaxing_log, RIG)
    better = (fit.model + found.added[0]).fit(touch)
    assert better.error.held_out < 0.4 * fit.error.held_out
    # the planted figures; their intervals are of 95 %, so that three half widths hold all but 4 of 1e9
    for name, truth in (("ratio", SHARE / (1.0 - SHARE)), ("time-constant", DECAY)):
        for p in (better[f"relaxation.{name}"], found["relaxation"].parameters[f"{name}"]):
            assert abs(p.value - truth) < 3 * (p.high - p.low) / 2
            assert p.high - p.low < 0.1 * truth
    # noise of 0.02 N, and of 4 000 samples of three channels nothing but that: 10 % is for the corners of a rubbing
    # tool
    assert found.steps[-1].held_out == pytest.approx(NOISE, rel=0.1)
    assert found.noise_floor == pytest.approx(NOISE, rel=0.1)


def test_where_the_error_sits_is_said(found: Diagnosis) -> None:
    worst = found.where[0]
    assert worst.channel == "normal_force"
    assert 0 < worst.share <= 1
    assert "%" in worst.says
    phases = {cell.phase for cell in found.where}
    assert phases & {"hold", "slide"}
    assert found.where[0].rms > 1.5 * max(cell.rms for cell in found.left_where)


def test_nothing_is_missing_where_nothing_is(nothing: Diagnosis) -> None:
    assert nothing.verdict == "adequate"
    assert nothing.added == ()
    assert len(nothing.steps) == 1
    assert nothing.steps[0].held_out == pytest.approx(NOISE, rel=0.1)
    assert not {e.verdict for e in nothing.effects} & {"present", "indistinguishable"}
    assert str(nothing.best) == str(nothing.model)


def test_what_no_slip_can_show_is_not_called_absent(nothing: Diagnosis) -> None:
    """No slip, no tangential force, no robot."""
    for name in (
        "coulomb-friction",
        "viscous-friction",
        "presliding",
        "friction-anisotropy",
        "stiffness-inhomogeneity",
        "tool-mass",
        "sensor-crosstalk",
        "joint-coulomb-friction",
        "payload",
    ):
        assert nothing[name].verdict == "not-excited", name


# -------------------------------------------------------------------------------------------------------------- facts


def test_every_effect_that_the_model_lacks_has_one_verdict(found: Diagnosis, nothing: Diagnosis) -> None:
    for result in (found, nothing):
        lacking = {name for name, effect in effects.catalogue().items() if not effect.base} - set(result.model.names)
        names = [effect.id for effect in result.effects]
        assert sorted(names) == sorted(lacking)
        assert {effect.verdict for effect in result.effects} <= VERDICTS
        present = {e.id for e in result.effects if e.verdict in ("present", "indistinguishable")}
        assert set(result.added) <= present
    with pytest.raises(InputError, match="did you mean 'relaxation'"):
        found["relaxaton"]


def _only_json(value: Any) -> None:
    """Nothing but what JSON knows, and only numbers that are finite."""
    if isinstance(value, dict):
        assert all(type(key) is str for key in value)
        for item in value.values():
            _only_json(item)
    elif isinstance(value, list):
        for item in value:
            _only_json(item)
    else:
        assert value is None or isinstance(value, str | float | int), type(value)
        assert not isinstance(value, float) or math.isfinite(value)


def test_facts_as_json(found: Diagnosis, nothing: Diagnosis) -> None:
    for result in (found, nothing):
        facts = json.loads(json.dumps(result.to_dict(), allow_nan=False))
        _only_json(result.to_dict())
        assert facts["model"] == list(result.model.names)
        assert facts["verdict"] in ("adequate", "missing", "unexplained")
        assert facts["added"] == list(result.added)
        assert facts["error"]["unit"] == "N"
        assert facts["error"]["before"] == facts["steps"][0]["error"]["held_out"]
        assert facts["error"]["after"] == facts["steps"][-1]["error"]["held_out"]
        assert 0 < facts["error"]["noise_floor"] < 1.2 * facts["error"]["after"]
        assert facts["steps"][0]["added"] is None
        assert [step["added"] for step in facts["steps"][1:]] == facts["added"]
        for before, after in zip(facts["steps"], facts["steps"][1:]):
            assert set(after["model"]) == {*before["model"], after["added"]}
        for step in facts["steps"]:
            assert 0 < step["error"]["train"] <= 1.01 * step["error"]["held_out"]  # fitted there; 1 % is chance
        assert facts["tolerance"] > 0
        assert facts["explained"] == facts["steps"][-1]["explained"]
        assert facts["steps"][0]["explained"] == 0.0
        assert all(0 <= step["explained"] <= 1 for step in facts["steps"])
        assert set(facts["left"]) == {"rms", "share_of_reading", "memory_s"}
        assert facts["left"]["rms"] == pytest.approx(facts["error"]["after"])
        assert 0 <= facts["left"]["share_of_reading"] < 1
        assert facts["left"]["memory_s"] > 0
        for cell in (*facts["where"], *facts["left_where"]):
            assert {"channel", "phase", "share", "says"} <= set(cell)
            assert 0 <= cell["share"] <= 1
        for effect in facts["effects"]:
            assert {"id", "verdict", "evidence", "equivalent_to", "held_out_gain", "parameters", "separate_by"} <= set(
                effect
            )
            assert effect["evidence"] is None or isinstance(
                effect["evidence"], float | int
            )  # None for marks in the samples
            assert isinstance(effect["separate_by"], str)
            for p in effect["parameters"].values():
                assert set(p) == {"value", "low", "high", "unit"}
                assert p["low"] is None or p["low"] <= p["value"]
                assert p["high"] is None or p["value"] <= p["high"]
    here = next(effect for effect in found.to_dict()["effects"] if effect["id"] == "relaxation")
    assert here["held_out_gain"] == pytest.approx(found.steps[0].held_out - found.steps[1].held_out)
    assert here["parameters"]["ratio"]["unit"] == "1"
    assert here["parameters"]["time-constant"]["unit"] == "s"


def test_the_ladder_only_falls(relaxing_log: kinid.Log) -> None:
    """Two effects are missing: each rung lowers the held-out error, and the last one is at the noise."""
    result = kinid.diagnose(relaxing_log, RIG, model=kinid.Model("hooke", "coulomb-friction"))
    assert set(result.added) == {"relaxation", "viscous-damping"}
    errors = [step.held_out for step in result.steps]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == pytest.approx(NOISE, rel=0.1)
    assert result.added[0] == "relaxation"  # which takes off more, and so stands first


def test_an_effect_may_need_another_that_was_found(tester: Tester) -> None:
    """Friction whose direction turns over 1 mm is two effects, and the second can't stand without the first."""
    force = tester.kelvin_voigt()
    result = kinid.diagnose(tester.log(force, tester.rubbing(force, 1e-3)), RIG, model=kinid.Model("kelvin-voigt"))
    assert result.added == ("coulomb-friction", "presliding")
    assert result["presliding"].parameters["length"].value == pytest.approx(1e-3, rel=0.05)
    assert result.steps[-1].held_out == pytest.approx(NOISE, rel=0.1)


def test_three_seconds_are_enough_where_all_is_in_them(relaxing_log: kinid.Log) -> None:
    """Blocks of a short log are shorter: one touch names its effect; less than 2.5 s is refused with what to record."""

    def first(seconds: float) -> kinid.Log:
        rows = slice(int(seconds / relaxing_log.period))
        contact = {name: values[rows] for name, values in relaxing_log.contact.items()}
        return kinid.Log(t=relaxing_log.t[rows], contact=contact)

    model = kinid.Model("kelvin-voigt", "coulomb-friction")
    assert kinid.diagnose(first(3.4), RIG, model=model).added == ("relaxation",)
    with pytest.raises(InputError, match="2.5 s at least"):
        kinid.diagnose(first(2.0), RIG, model=model)


def test_noise_of_the_slip_shakes_no_surface(tester: Tester) -> None:
    """3 µm on each slip: presliding is found, and no anisotropy, which slides along one axis can't show.

    Noise that moves bristles turns friction across the slides into noise, which anisotropy would seem to take away.
    """
    force = tester.kelvin_voigt()
    quiet, rng = tester.log(force, tester.rubbing(force, 4e-4)), np.random.default_rng(3)
    slips = {name: quiet.contact[name] + 3e-6 * rng.standard_normal(len(force)) for name in ("slip1", "slip2")}
    log = kinid.Log(t=quiet.t, contact={**quiet.contact, **slips}, phase=quiet.phase)
    result = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"))
    assert result.added == ("coulomb-friction", "presliding")
    assert result.verdict == "missing"
    assert result["friction-anisotropy"].verdict == "not-excited"
    assert result["coulomb-friction"].parameters["coefficient"].value == pytest.approx(0.4, rel=0.01)
    assert result["presliding"].parameters["length"].value == pytest.approx(4e-4, rel=0.1)
    assert result.steps[-1].held_out < 1.1 * NOISE
    whole = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt", "coulomb-friction", "presliding"))
    assert whole.verdict == "adequate"


def test_errors_are_of_the_same_samples_held_out(found: Diagnosis) -> None:
    """Both residuals cover the same samples, those that were valid, and their size is the error on the ladder."""
    assert found.residual.shape == found.residual_after.shape == found.experiment.measured.shape
    valid = found.experiment.valid
    for residual, step in ((found.residual, found.steps[0]), (found.residual_after, found.steps[-1])):
        assert np.isfinite(residual[:, valid]).all()
        assert np.isnan(residual[:, ~valid]).all()
        assert np.sqrt(np.mean(residual[:, valid] ** 2)) == pytest.approx(step.held_out, rel=1e-9)
    # held out: a model of all samples is nearer to them
    fitted = found.experiment.measured - found.fit.predict()
    assert np.sqrt(np.mean(fitted[:, valid] ** 2)) < found.steps[-1].held_out


def test_the_same_question_has_the_same_answer(fit: Fit, found: Diagnosis) -> None:
    assert json.dumps(kinid.diagnose(fit).to_dict()) == json.dumps(found.to_dict())


def test_what_was_given_stays_as_it_was(relaxing_log: kinid.Log) -> None:
    before = {name: values.copy() for name, values in relaxing_log.contact.items()}
    model = kinid.Model("kelvin-voigt", "coulomb-friction")
    kinid.diagnose(relaxing_log, RIG, model=model, max_effects=0)
    for name, values in before.items():
        np.testing.assert_array_equal(relaxing_log.contact[name], values)
    assert model.names == ("kelvin-voigt", "coulomb-friction")


# ------------------------------------------------------------------------------------------------------- what is asked
# for


def test_a_name_for_several_effects_can_be_forced(tester: Tester) -> None:
    """What the model has of them is no twin."""
    force = tester.kelvin_voigt()
    model = kinid.Model("kelvin-voigt", "coulomb-friction")
    found = kinid.diagnose(
        tester.log(force, tester.rubbing(force)), RIG, model=model, add=["dahl-friction"], max_effects=1
    )
    assert found.added == ("presliding",)


def test_how_far_an_absence_reaches_is_said(nothing: Diagnosis, tester: Tester) -> None:
    layer = nothing["stiffening-layer"]
    assert layer.verdict == "absent"
    assert layer.label == f"stiffening-layer (down to {1e3 * tester.depth.max():.2g} mm)"
    assert layer.says.endswith(layer.within)
    assert nothing["relaxation"].label == "relaxation (for time constants from 0.02 to 30 s)"
    assert nothing["hysteresis"].label == "hysteresis"


def test_what_is_printed_is_what_a_reader_wants(found: Diagnosis) -> None:
    lines = str(found).splitlines()
    assert lines[0].startswith("missing: relaxation; held-out error ")
    assert any(line.startswith("relaxation.ratio = 0.") for line in lines)
    assert len(lines) < 20


def test_an_effect_can_be_forced(tester: Tester) -> None:
    """Nothing asks for it: it joins, and the held-out error doesn't fall."""
    result = kinid.diagnose(
        tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"), add=["relaxation"]
    )
    assert result.added == ("relaxation",)
    assert "relaxation" in result.best
    assert result.steps[1].held_out == pytest.approx(result.steps[0].held_out, rel=0.01)
    ratio = result["relaxation"].parameters["ratio"]
    assert abs(ratio.value) < 0.02  # of the elastic force; nothing relaxes


def test_forced_effects_may_need_one_another(tester: Tester) -> None:
    force = tester.kelvin_voigt()
    log = tester.log(force, tester.rubbing(force))
    result = kinid.diagnose(
        log, RIG, model=kinid.Model("kelvin-voigt"), add=["coulomb-friction", "presliding"], max_effects=2
    )
    assert result.added == ("coulomb-friction", "presliding")
    assert result["coulomb-friction"].parameters["coefficient"].value == pytest.approx(0.4, rel=0.02)


def test_no_more_is_added_than_asked_for(fit: Fit) -> None:
    none = kinid.diagnose(fit, max_effects=0)
    assert none.added == ()
    assert len(none.steps) == 1
    assert none.verdict != "adequate"  # 3.7 times the noise
    one = kinid.diagnose(kinid.Model("hooke", "coulomb-friction").fit(fit.experiment.touch), max_effects=1)
    assert len(one.added) == 1
    with pytest.raises(InputError, match="max_effects of -1"):
        kinid.diagnose(fit, max_effects=-1)


def test_progress_is_told(tester: Tester) -> None:
    said: list[str] = []
    kinid.diagnose(tester.log(tester.kelvin_voigt()), RIG, model=kinid.Model("kelvin-voigt"), progress=said.append)
    assert len(said) >= 4
    assert any("screening" in words for words in said)


# ----------------------------------------------------------------------------------------------------------- bad input


def refused(*words: str, **given: Any) -> None:
    """One clear line: what was found, what was expected, how to mend it."""
    data = given.pop("data")
    with pytest.raises(InputError) as stop:
        kinid.diagnose(data, RIG if isinstance(data, kinid.Log) else None, **given)
    text = str(stop.value)
    assert "\n" not in text
    for word in ("found", "expected", "to mend it", *words):
        assert word in text, text


def test_a_log_too_short_to_hold_out_is_refused(tester: Tester) -> None:
    refused("of log", "2.5 s", "record", data=short(tester, slice(0, 600)), model=kinid.Model("hooke"))


def test_a_log_of_gaps_is_refused(tester: Tester) -> None:
    """Long enough, and hardly a reading in it."""
    force = np.full(len(tester.t), np.nan)
    force[::800] = 1.0
    refused("found", data=short(tester, normal_force=force), model=kinid.Model("hooke"))


def test_names_are_checked(fit: Fit, tester: Tester) -> None:
    refused("relaxaton", "did you mean 'relaxation'", data=fit, add=["relaxaton"])
    refused("coulomb-friction", "each effect once", data=fit, add=["coulomb-friction"])
    refused("bases", data=fit, add=["hertz"])
    refused("joint torques", "leave it out", data=fit, add=["joint-coulomb-friction"])
    refused(
        "lacks the channels", "leave it out", data=short(tester), model=kinid.Model("hooke"), add=["sensor-crosstalk"]
    )


def test_an_effect_that_needs_another_is_refused(tester: Tester) -> None:
    refused("presliding", "coulomb-friction", data=short(tester), model=kinid.Model("hooke"), add=["presliding"])


def test_a_model_is_needed_and_a_rig_with_the_log_of_a_robot(tester: Tester) -> None:
    refused("model", data=short(tester))
    refused("a model that is a str", data=short(tester), model="hooke")
    refused("ndarray to diagnose", data=np.zeros(5), model=kinid.Model("hooke"))
    joints = kinid.Log(t=np.arange(3000) * 2e-3, q=np.zeros((3000, 7)), wrench=np.zeros((3000, 6)))
    with pytest.raises(InputError, match="rig"):
        kinid.diagnose(joints, model=kinid.Model("hooke"))


def test_a_testers_log_needs_no_rig(tester: Tester) -> None:
    alone = kinid.diagnose(short(tester), model=kinid.Model("hooke"), max_effects=0)
    assert alone.steps == kinid.diagnose(short(tester), kinid.Rig(), model=kinid.Model("hooke"), max_effects=0).steps


@pytest.mark.parametrize("column", ["depth", "normal_force"])
def test_a_missing_channel_is_named(tester: Tester, column: str) -> None:
    refused(column.replace("_", " ").split()[-1], data=short(tester, **{column: None}), model=kinid.Model("hooke"))


def test_a_depth_that_is_never_positive_is_said(tester: Tester) -> None:
    refused("never positive", "surface", data=short(tester, depth=tester.depth - 0.01), model=kinid.Model("hooke"))


def test_joints_are_asked_for_where_the_model_is_of_joints(tester: Tester) -> None:
    refused("torque", data=short(tester), model=kinid.Model("rigid-body"))


def test_one_phase_is_doubted(tester: Tester) -> None:
    log = dataclasses.replace(short(tester), phase=np.full(len(tester.t), "poke"))
    result = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"), max_effects=0)
    assert any("one phase" in words and "record" in words for words in result.warnings)
    whole = kinid.diagnose(short(tester), RIG, model=kinid.Model("kelvin-voigt"), max_effects=0)
    assert not any("one phase" in words for words in whole.warnings)


def test_a_log_without_free_motion_is_doubted(tester: Tester) -> None:
    """Bias and contact can't be told apart there."""
    inside = np.flatnonzero(tester.depth > 2e-4)
    log = short(tester)
    contact = {name: values[inside] for name, values in log.contact.items()}
    cut = kinid.Log(t=np.arange(len(inside)) / 250.0, contact=contact, phase=log.phase[inside])
    result = kinid.diagnose(cut, RIG, model=kinid.Model("kelvin-voigt"), max_effects=0)
    assert any("free motion" in words for words in result.warnings)


def test_readings_that_are_no_numbers_are_left_out_and_said(tester: Tester) -> None:
    force = tester.log(tester.kelvin_voigt()).contact["normal_force"].copy()
    force[1000:1400] = np.nan
    result = kinid.diagnose(short(tester, normal_force=force), RIG, model=kinid.Model("kelvin-voigt"))
    assert result.verdict == "adequate"
    assert any("10 % of the samples" in words for words in result.warnings)
    json.dumps(result.to_dict(), allow_nan=False)


def test_an_unlabelled_log_is_a_log(tester: Tester, relaxing_log: kinid.Log) -> None:
    log = dataclasses.replace(relaxing_log, phase=None)
    result = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt", "coulomb-friction"))
    assert result.added == ("relaxation",)


def test_a_log_file_is_diagnosed_the_same(tester: Tester, tmp_path: Path) -> None:
    """Through a file, in other units."""
    log = tester.log(tester.kelvin_voigt())
    table = np.column_stack([log.t, 1e3 * log.contact["depth"], log.contact["normal_force"]])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,d,f", comments="", fmt="%.12g")
    rig = kinid.Rig.parse({"columns": {"depth": {"column": "d", "unit": "mm"}, "normal_force": {"column": "f"}}})
    result = kinid.diagnose(kinid.read(tmp_path / "log.csv", rig), rig, model=kinid.Model("hooke"))
    assert result.added == ("viscous-damping",)
    assert result["viscous-damping"].parameters["damping"].value == pytest.approx(6.0, rel=0.1)
