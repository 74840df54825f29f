"""A session says when its values aren't to be believed, and stays silent when they are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scripted import Scripted

from kinid.estimators.estimate import Estimate, Status
from kinid.live.trust import Trust

Run = Callable[..., tuple[int, str, str]]
LAW = ("stiffness", "damping")


def estimate(
    values: tuple[float, ...], std: tuple[float, ...], status: Status = Status.VALID, names: tuple[str, ...] = LAW
) -> Estimate:
    deviations = np.array(std)
    whole = np.diag(deviations**2)
    return Estimate(names, np.array(values), deviations**2, 0.0, 0.02, 1.0, status, 100, 0, lambda: whole)


def after(*taken: Estimate, model: tuple[str, ...] = ("kelvin-voigt",)) -> list[str]:
    trust = Trust(model)
    for each in taken:
        trust.take({"part": each})
    return trust.doubts({"part": taken[-1]})


GONE = estimate((730.0, 9.0), (2.0, 0.3), Status.NO_CONTACT)


def steady(level: float) -> list[Estimate]:
    noise = np.random.default_rng(0).normal(scale=(2.0, 0.3), size=(50, 2))
    return [estimate((level + k, 9.0 + c), (2.0, 0.3)) for k, c in noise]


def test_values_that_stay_within_their_errors_are_believed() -> None:
    assert after(*steady(730.0), GONE) == []
    assert after(*steady(730.0), GONE, *steady(500.0), GONE) == []  # another touch may be of another material


def test_a_value_that_wanders_within_one_touch_is_doubted() -> None:
    (doubt,) = after(*(estimate((k, 9.0), (2.0, 0.3)) for k in np.linspace(720.0, 480.0, 50)), GONE)
    assert "stiffness went from 480 to 720 N/m" in doubt
    assert "damping" not in doubt
    # by less than matters, however small its errors are
    assert after(*(estimate((k, 9.0), (0.1, 0.3)) for k in np.linspace(720.0, 700.0, 50)), GONE) == []


def test_a_model_that_never_stood_says_why() -> None:
    doubts = after(*[estimate((3e3, 7.0), (9e2, 3.0), Status.NOT_EXCITED)] * 40, GONE)
    assert doubts == [
        f"stiffness, damping: no estimate stood while the tool touched, mostly: {Status.NOT_EXCITED.remedy}"
    ]


@pytest.mark.parametrize(("viscous", "said"), [(-3.91, True), (-0.1, False), (2.0, False)])
def test_a_friction_that_gives_energy_is_doubted_where_that_is_sure(viscous: float, said: bool) -> None:
    found = estimate((0.6, viscous), (0.01, 0.11), names=("friction", "viscous"))
    assert ("viscous -3.91 N·s/m is of no material" in " ".join(after(found, model=("coulomb-friction",)))) is said


def test_a_good_session_is_silent_and_its_table_has_units(run: Run, scripted: Scripted, tmp_path: Path) -> None:
    log, facts = scripted.write(tmp_path), tmp_path / "live.json"
    args = ("live", log, "--model", "kelvin-voigt", "--speed", 0, "--quiet")
    code, out, err = run(*args, "--tare", 2, "--json", facts)
    assert code == 0, err
    assert "N·s/m" in out
    assert "doubt" not in out
    summary = json.loads(facts.read_text())
    assert summary["estimates"]["normal"]["units"] == {"stiffness": "N/m", "damping": "N·s/m"}
    assert summary["doubts"] == []
    # a word in brackets is printed as it is
    assert "add [sensor] bias" in run(*args, "--duration", 1)[1]


def test_a_law_that_lacks_relaxation_is_doubted_and_told_once_a_touch(run: Run, tmp_path: Path) -> None:
    hidden = ("lab", "ecoflex-50", "--hide", "relaxation", "--seed", 5, "--no-mcap", "-o", tmp_path / "run")
    assert run(*hidden)[0] == 0
    code, out, err = run("live", tmp_path / "run/log.parquet", "--model", "kelvin-voigt", "--speed", 0)
    assert code == 0, err
    assert "doubt: within one touch stiffness went from" in out
    # a poke's turning points are no loss: what is lost for a second is, once
    assert 1 <= out.count("excitation-lost at") <= out.count("touch at")


def doubts_of(run: Run, log: Path, *options: object) -> str:
    """What a session that replays a log doubts."""
    facts = log.parent / "live.json"
    code, _, err = run("live", log, "--model", "kelvin-voigt", "--speed", 0, *options, "--quiet", "--json", facts)
    assert code == 0, err
    return " ".join(json.loads(facts.read_text())["doubts"])


@pytest.mark.parametrize(("factor", "doubted"), [(1.0, False), (1000.0, True)])
def test_forces_in_another_unit_are_beyond_the_sensors_range(
    run: Run, scripted: Scripted, tmp_path: Path, factor: float, doubted: bool
) -> None:
    log = scripted.write(tmp_path)
    rig = log.parent / "rig.toml"
    text = rig.read_text(encoding="utf-8")
    assert "range = [40" in text
    rig.write_text(f"{text}\n[columns]\nwrench = {{ scale = {factor} }}\n", encoding="utf-8")
    said = doubts_of(run, log)
    assert ("beyond [sensor] range" in said) == doubted


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("", ""),
        ("mass = 0.5", "correct [tool] mass"),
        ("[columns]\nwrench = { scale = 8 }", "correct [tool] mass"),
    ],
)
def test_a_tools_weight_that_free_motion_contradicts_is_doubted(
    run: Run, scripted: Scripted, tmp_path: Path, line: str, words: str
) -> None:
    log = scripted.write(tmp_path)
    rig = log.parent / "rig.toml"
    text = rig.read_text(encoding="utf-8")
    rig.write_text(
        text.replace("mass = 0.24", line) if line.startswith("mass") else f"{text}\n{line}\n", encoding="utf-8"
    )
    said = doubts_of(run, log, "--tare", 2)
    assert words in said if words else said == ""
