"""kinid in Python: short lines, tables and figures of results, fits on disk, and one clear line for a wrong type."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinid

PEAK = 4e-3


@pytest.fixture(scope="module")
def touch() -> kinid.ContactSeries:
    """A material tester's pokes: a spring and a dashpot."""
    t = np.arange(1500) / 250
    turn = 2 * np.pi * (0.4 * t + 0.05 * t**2)
    depth, rate = PEAK * np.sin(turn), PEAK * np.cos(turn) * 2 * np.pi * (0.4 + 0.1 * t)
    force = np.where(depth > 0, 700 * depth + 8 * rate, 0) + np.random.default_rng(0).normal(0, 0.02, len(t))
    log = kinid.Log(t, contact={"depth": depth, "normal_force": force})
    return kinid.contact_series(log, kinid.Rig())


@pytest.fixture(scope="module")
def fit(touch: kinid.ContactSeries) -> kinid.Fit:
    return kinid.Model("kelvin-voigt").fit(touch)


@pytest.fixture(scope="module")
def results(touch: kinid.ContactSeries, fit: kinid.Fit) -> dict[str, Any]:
    assert touch.source is not None
    return {
        "log": touch.source[0],
        "touch": touch,
        "fit": fit,
        "comparison": kinid.compare(["hooke", ["kelvin-voigt"]], touch),
        "diagnosis": kinid.diagnose(kinid.Model("hooke").fit(touch), max_effects=1),
    }


@pytest.mark.parametrize("name", ["log", "touch", "fit", "comparison", "diagnosis"])
def test_a_result_shows_itself(results: dict[str, Any], name: str) -> None:
    result = results[name]
    line = repr(result)
    assert line.startswith(f"<{type(result).__name__} ")
    assert len(line) < 200
    assert "\n" not in line
    page = result._repr_html_()
    assert "<table>" in page
    assert len(page) < 20_000
    assert len(result.plot().data) >= 1
    columns = result.columns()
    assert len({len(values) for values in columns.values()}) == 1


@pytest.mark.parametrize("made", [kinid.Model("hooke"), kinid.Rig(), kinid.Robot.load("lwr4plus")], ids=str)
def test_what_has_no_table_is_short(made: object) -> None:
    assert len(repr(made)) < 120


def test_a_model_repeats_itself() -> None:
    model = kinid.Model(["kelvin-voigt", "coulomb-friction"])
    assert eval(repr(model), {"Model": kinid.Model}) == model == kinid.Model("kelvin-voigt", "coulomb-friction")


def test_a_data_frame_is_made_where_pandas_is(
    fit: kinid.Fit, touch: kinid.ContactSeries, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", types.SimpleNamespace(DataFrame=lambda columns: columns))
    assert list(fit.to_dataframe()) == ["parameter", "value", "low", "high", "unit"]
    assert len(touch.to_dataframe()["depth"]) == len(touch)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(kinid.InputError, match="pip install pandas"):
        fit.to_dataframe()


def test_a_fit_goes_to_disk_and_back(fit: kinid.Fit, touch: kinid.ContactSeries, tmp_path: Path) -> None:
    fit.save(tmp_path / "fit.json")
    again = kinid.Fit.load(tmp_path / "fit.json")
    assert again.model == fit.model
    assert again.to_save() == fit.to_save()
    assert again.equation() == fit.equation()
    assert str(again) == str(fit)
    np.testing.assert_array_equal(again.values, fit.values)
    np.testing.assert_allclose(again.predict(touch), fit.predict(touch, calibrated=False), atol=1e-12)
    with pytest.raises(kinid.InputError, match="diagnose again"):
        again.plot()


def test_a_fit_that_the_command_line_wrote_can_be_loaded(
    fit: kinid.Fit, touch: kinid.ContactSeries, results: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "d.json").write_text(json.dumps(results["diagnosis"].to_dict()), encoding="utf-8")
    best = kinid.Fit.load(tmp_path / "d.json")
    assert best.model == results["diagnosis"].best
    # the damper that the spring lacked is found, and what is left is the noise of 0.02 N
    assert np.sqrt(np.nanmean((best.predict(touch)[0] - touch.normal_force) ** 2)) < 0.03


def test_a_diagnosis_goes_to_disk_and_back(results: dict[str, Any], tmp_path: Path) -> None:
    found: kinid.Diagnosis = results["diagnosis"]
    found.save(tmp_path / "found.json")
    again = kinid.Diagnosis.load(tmp_path / "found.json")
    for name in ("model", "best", "verdict", "says", "added", "steps", "noise_floor", "unit", "warnings", "explained"):
        assert getattr(again, name) == getattr(found, name), name
    assert [(e.id, e.group, e.label, e.parameters) for e in again.effects] == [
        (e.id, e.group, e.label, e.parameters) for e in found.effects
    ]
    assert again[found.added[0]].evidence == pytest.approx(found[found.added[0]].evidence)
    assert again.fit.to_save() == found.fit.to_save()
    assert repr(again).replace("Saved", "", 1) == repr(found)
    assert again.columns()["says"].tolist() == found.columns()["says"].tolist()
    again.save(tmp_path / "twice.json")
    assert (tmp_path / "twice.json").read_bytes() == (tmp_path / "found.json").read_bytes()


@pytest.mark.parametrize("field", ["steps", "effects", "says", "error", "verdict", "fit", "model"])
@pytest.mark.parametrize("value", [None, 5, "x", [], [5], {}])
def test_a_file_that_is_no_diagnosis_is_refused_in_one_line(
    field: str, value: object, results: dict[str, Any], tmp_path: Path
) -> None:
    if (field, value) in (("effects", []), ("model", []), ("says", "x")):
        return  # such a diagnosis there can be
    facts = {**json.loads(json.dumps(results["diagnosis"].to_dict())), field: value}
    (tmp_path / "found.json").write_text(json.dumps(facts), encoding="utf-8")
    with pytest.raises(kinid.InputError) as refused:
        kinid.Diagnosis.load(tmp_path / "found.json")
    assert "expected" in str(refused.value)


def test_a_prediction_lies_beside_the_samples_that_it_is_of(fit: kinid.Fit, touch: kinid.ContactSeries) -> None:
    """Of another touch, too: twice as slow the dashpot gives half as much."""
    assert touch.source is not None
    log = touch.source[0]
    slow = kinid.contact_series(kinid.Log(2 * log.t, contact={"depth": log.contact["depth"]}), kinid.Rig())
    said = fit.predict(slow, calibrated=False)[0]
    assert said.shape == slow.t.shape
    inside = slow.depth > 1e-4
    expected = fit["stiffness"].value * slow.depth + fit["damping"].value * slow.depth_rate
    np.testing.assert_allclose(said[inside], expected[inside], atol=0.02)  # of the rate where a touch begins


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"model": ' + 60 * "[" + 60 * "]" + "}", "levels deep"),
        ('{"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": 1e999}}}', "beyond 1e+100"),
        ('{"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": NaN}}}', "NaN is no number"),
        ('{"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": "700"}}}', "expected a number"),
        ('{"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": true}}}', "expected a number"),
        (f'{{"model": ["hooke"], "parameters": {{"hooke.stiffness": {{"value": 1{400 * "0"}}}}}}}', "401 digits"),
        ('{"model": ["hooke"], "parameters": {"hooke.stiffness": {}}}', "without a value"),
        ('{"model": ["hooke"], "parameters": {"hertz.stiffness": {"value": 1}}}', "beside the model"),
        ('{"model": "hooke", "parameters": {}}', "a list of names"),
        ('{"model": ["hoke"], "parameters": {}}', "did you mean 'hooke'"),
        ('{"model": ["hooke"], "parameters": {}}', "no layout"),
        ("[1]", "no fit"),
        ("not json", "no JSON"),
        ('"' + 3_000_000 * "x" + '"', "2 MB at most"),
    ],
    ids=lambda value: value[:24] if isinstance(value, str) else None,
)
def test_a_file_that_is_no_fit_is_refused_in_one_line(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "fit.json").write_text(text, encoding="utf-8")
    with pytest.raises(kinid.InputError) as refused:
        kinid.Fit.load(tmp_path / "fit.json")
    assert says in str(refused.value)
    assert len(str(refused.value)) < 400


def changed(facts: Any, *path: Any) -> Any:
    """The facts with another value at the end of a path of keys; without it where the value is `...`."""
    *keys, last, value = path
    out = json.loads(json.dumps(facts))
    inner = out
    for key in keys:
        inner = inner[key]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return out


@pytest.mark.parametrize(
    "path",
    [
        ("error", ...),
        ("error", "held_out", -1.0),
        ("error", "held_out", True),
        ("error", "unit", "kg"),
        ("warnings", {}),
        ("rest", [1]),
        ("layout", "channels", ["a"]),
        ("parameters", "kelvin-voigt.stiffness", ...),
        ("parameters", "kelvin-voigt.stiffness", {"value": -1.0, "low": -2.0, "high": 0.0, "unit": "N/m"}),
        ("parameters", "kelvin-voigt.stiffness", {"value": 1e9, "low": 0.0, "high": 2e9, "unit": "N/m"}),
    ],
    ids=str,
)
def test_a_fit_with_a_field_that_cant_be_is_refused(fit: kinid.Fit, path: Any, tmp_path: Path) -> None:
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(changed(fit.to_save(), *path)), encoding="utf-8")
    with pytest.raises(kinid.InputError) as refused:
        kinid.Fit.load(file)
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize(
    "path",
    [
        ("verdict", "missing?"),
        ("says", ...),
        ("steps", []),
        ("steps", 0, "model", ["hertz"]),
        ("steps", 0, "explained", 3.0),
        ("error", "after", -1.0),
        ("error", "before", 7.5),
        ("error", "unit", "kg"),
        ("added", ["no-such-effect"]),
        ("effects", []),
        ("effects", 0, "id", "no-such-effect"),
        ("effects", 0, "evidence", "much"),
        ("where", 0, "share", 3.0),
        ("left", {}),
        ("tolerance", -1.0),
        ("explained", 7.0),
    ],
    ids=str,
)
def test_a_diagnosis_with_a_field_that_cant_be_is_refused(results: dict[str, Any], path: Any, tmp_path: Path) -> None:
    file = tmp_path / "found.json"
    file.write_text(json.dumps(changed(results["diagnosis"].to_dict(), *path)), encoding="utf-8")
    with pytest.raises(kinid.InputError) as refused:
        kinid.Diagnosis.load(file)
    assert len(str(refused.value)) < 400


def test_none_is_no_contact_law() -> None:
    assert kinid.Model("none", "tool-mass").names == ("tool-mass",)
    with pytest.raises(kinid.InputError, match="'none' beside hooke"):
        kinid.Model("none", "hooke")


WRONG: dict[str, Callable[[Any], object]] = {
    "read": lambda _: kinid.read(5),  # type: ignore[arg-type]
    "read, rig": lambda _: kinid.read("log.csv", "rig.toml"),  # type: ignore[arg-type]
    "rig": lambda _: kinid.Rig.load(None),  # type: ignore[arg-type]
    "robot": lambda _: kinid.Robot.load(5),  # type: ignore[arg-type]
    "contact_series": lambda _: kinid.contact_series("log.csv", kinid.Rig()),  # type: ignore[arg-type]
    "tip_motion": lambda _: kinid.tip_motion(1, 2),  # type: ignore[arg-type]
    "joint_torques": lambda touch: kinid.joint_torques(touch.source[0], "rig.toml"),  # type: ignore[arg-type]
    "find_surface": lambda _: kinid.find_surface("log.csv", kinid.Rig()),
    "model": lambda _: kinid.Model(5),  # type: ignore[arg-type]
    "model, list": lambda _: kinid.Model(["hooke", None]),  # type: ignore[list-item]
    "model +": lambda _: kinid.Model("hooke") + 5,  # type: ignore[operator]
    "fit": lambda _: kinid.Model("hooke").fit("log.csv"),  # type: ignore[arg-type]
    "fit, rig": lambda touch: kinid.Model("hooke").fit(touch.source[0], "rig.toml"),
    "fit, start": lambda touch: kinid.Model("hooke").fit(touch, start=5),
    "fit[…]": lambda touch: kinid.Model("hooke").fit(touch, held_out=False)[5],
    "predict": lambda touch: kinid.Model("hooke").fit(touch, held_out=False).predict("log.csv"),
    "compare": lambda touch: kinid.compare(kinid.Model("hooke"), touch),  # type: ignore[arg-type]
    "diagnose": lambda touch: kinid.diagnose(touch, model="hooke"),  # type: ignore[arg-type]
    "diagnose, tolerance": lambda touch: kinid.diagnose(touch, model=kinid.Model("hooke"), tolerance="5"),  # type: ignore[arg-type]
    "diagnose, add": lambda touch: kinid.diagnose(touch, model=kinid.Model("hooke"), add="relaxation"),
    "campaign": lambda _: kinid.Campaign(5),  # type: ignore[arg-type]
    "campaign, list": lambda _: kinid.Campaign([5]),  # type: ignore[list-item]
    "differentiator": lambda _: kinid.Differentiator("25"),  # type: ignore[arg-type]
    "load": lambda _: kinid.Fit.load(5),  # type: ignore[arg-type]
    "load, diagnosis": lambda _: kinid.Diagnosis.load(5),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_type_is_one_clear_line(name: str, touch: kinid.ContactSeries) -> None:
    with pytest.raises(kinid.InputError, match=r"^found .*; expected .*; to mend it, "):
        WRONG[name](touch)


def test_dir_holds_what_is_public() -> None:
    shown = [name for name in dir(kinid) if not name.startswith("__")]
    assert shown == sorted(kinid.__all__)
    for name in shown:
        assert getattr(kinid, name) is not None


@pytest.mark.parametrize("name", [name for name in kinid.__all__ if name != "KinidError"])
def test_help_finds_something(name: str) -> None:
    """The thing itself, and each public method of its own."""
    thing = getattr(kinid, name)
    assert thing.__doc__
    for own, value in vars(thing).items() if inspect.isclass(thing) else ():
        plain = getattr(value, "__func__", getattr(value, "fget", value))
        if not own.startswith("_") and inspect.isfunction(plain):
            assert plain.__doc__, f"{name}.{own}"


def test_importing_kinid_loads_nothing_heavy() -> None:
    """Figures and fits load where they are used."""
    check = "import sys, kinid; print([m for m in ('numba', 'plotly', 'pinocchio', 'pyarrow') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True).stdout == "[]\n"
