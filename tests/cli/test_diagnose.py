"""`kinid diagnose` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import kinid

Run = Callable[..., tuple[int, str, str]]
Refused = Callable[..., None]

DAMPING = 12.0


@pytest.fixture
def tester(tmp_path: Path) -> Path:
    """Eight pokes of a material tester at speeds that grow: a spring of 700 N/m and a dashpot; no rig beside it."""
    t = np.arange(4000) / 250
    turn = 2 * np.pi * (0.3 * t + 0.02 * t**2)
    depth, rate = 4e-3 * np.sin(turn), 4e-3 * np.cos(turn) * 2 * np.pi * (0.3 + 0.04 * t)
    force = np.where(depth > 0, 700 * depth + DAMPING * rate, 0) + np.random.default_rng(0).normal(
        scale=0.03, size=len(t)
    )
    folder = tmp_path / "tester"
    folder.mkdir()
    np.savetxt(
        folder / "log.csv",
        np.column_stack([t, depth, force]),
        delimiter=",",
        header="t,depth,normal_force",
        comments="",
    )
    return folder / "log.csv"


def test_the_whole_way(run: Run, tester: Path) -> None:
    folder = tester.parent
    code, said, err = run(
        "diagnose",
        tester,
        "--model",
        "hooke",
        "--json",
        folder / "d.json",
        "--report",
        folder / "d.html",
        "-o",
        folder / "d.parquet",
    )
    assert code == 0, err
    assert "Traceback" not in err
    facts = json.loads((folder / "d.json").read_text(), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert facts["model"] == ["hooke"]
    assert facts["verdict"] == "missing"
    assert facts["added"] == ["viscous-damping"]
    error = facts["error"]
    assert error["after"] == pytest.approx(0.03, rel=0.1)
    assert error["noise_floor"] == pytest.approx(0.03, rel=0.1)
    assert error["before"] > 1.5 * error["after"]
    damping = next(e for e in facts["effects"] if e["id"] == "viscous-damping")["parameters"]["damping"]
    assert damping["low"] < DAMPING < damping["high"]
    # the terminal says the same
    figures = (f"{error['before']:.3g}", f"{error['after']:.3g}")
    for words in ("missing", "viscous-damping", *figures, "noise alone", "where the model fails"):
        assert words in said, words
    html = (folder / "d.html").read_text()
    assert "viscous-damping" in html
    assert 'src="http' not in html  # it opens without a network
    table = pq.read_table(folder / "d.parquet")
    residual = table["normal_force"].to_numpy() - table["normal_force_model"].to_numpy()
    assert np.sqrt(np.nanmean(residual**2)) < 1.1 * 0.03
    for name in ("d.json", "d.html", "d.parquet"):
        assert name in said


def test_an_adequate_model_is_left_alone(run: Run, tester: Path) -> None:
    code, said, err = run("diagnose", tester, "--model", "kelvin-voigt")
    assert code == 0, err
    assert "adequate" in said
    assert "this log cannot tell" in said  # friction, robot and tool


def test_add_and_stop(run: Run, tester: Path) -> None:
    target = tester.parent / "d.json"
    code, _, err = run(
        "diagnose", tester, "--model", "kelvin-voigt", "--add", "relaxation", "--max-effects", 1, "--json", target
    )
    assert code == 0, err
    assert json.loads(target.read_text())["added"] == ["relaxation"]
    code, _, err = run("diagnose", tester, "--model", "hooke", "--max-effects", 0, "--json", target)
    assert code == 0, err
    facts = json.loads(target.read_text())
    assert facts["added"] == []
    assert facts["verdict"] != "adequate"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("relaxation", ("hysteresis", "ratio", "hold")),
        ("time-offset", ("sensor-lag", "delay")),
        ("joint-coulomb-friction", ("coulomb", "N·m")),
        ("saturation", ("limit",)),
        ("hooke", ("base law", "stiffness")),
    ],
)
def test_effects_are_explained(run: Run, name: str, words: tuple[str, ...]) -> None:
    code, said, err = run("diagnose", "--explain", name)
    assert code == 0, err
    for word in (name, "looks like", "source", *words):
        assert word in said, word


def test_the_catalogue_is_listed_and_names_for_several_are_told_apart(run: Run) -> None:
    code, said, err = run("diagnose", "--explain", "all")
    assert code == 0, err
    assert all(name in said for name in kinid.effects.catalogue())
    code, said, err = run("diagnose", "--explain", "dahl-friction")
    assert code == 0, err
    assert "coulomb-friction and presliding" in said


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--model", "hook"], "hooke"),
        (["--model", "hooke", "--add", "relaxaton"], "relaxation"),
        (["--model", "hooke", "--add", "sensor-crosstalk"], "channels"),
        (["--model", "kelvin-voigt,relaxation", "--add", "relaxation"], "which has it"),
        (["--model", "hooke", "--max-effects", "-1"], "0 or more"),
        (["--model", "hooke", "--tolerance", "nan"], "0 or more"),
        (["--model", "hooke", "--tolerance", "-0.1"], "0 or more"),
        (["--model", "rigid-body"], "torque"),
        (["--model", "hooke", "--rig", "none.toml"], "none.toml"),
        (["--model", "hooke", "--json", "nowhere/d.json"], "nowhere"),
        (["--model", "hooke", "-o", "d.txt"], "d.txt"),
        ([], "model"),
    ],
)
def test_bad_use_is_refused_in_one_line(run: Run, refused: Refused, tester: Path, args: list[str], words: str) -> None:
    refused(run("diagnose", tester, *args), words)


def test_bad_logs_are_refused_in_one_line(run: Run, refused: Refused, tester: Path, tmp_path: Path) -> None:
    refused(run("diagnose", tester.parent / "none.csv", "--model", "hooke"), "none.csv")
    rows = tester.read_text().splitlines()
    brief = tmp_path / "brief.csv"
    brief.write_text("\n".join(rows[:500]) + "\n")
    refused(run("diagnose", brief, "--model", "hooke"), "of log", "record")
    lacks = tmp_path / "lacks.csv"
    lacks.write_text("\n".join(",".join(row.split(",")[:2]) for row in rows) + "\n")
    refused(run("diagnose", lacks, "--model", "hooke"), "normal force")
    hollow = tmp_path / "hollow.csv"
    hollow.write_text("\n".join([rows[0] + ",slip1", *(row + ",nan" for row in rows[1:])]) + "\n")
    refused(run("diagnose", hollow, "--model", "hooke"), "no number in slip1")
    refused(run("diagnose", "--explain", "relaxaton"), "relaxation")
    refused(run("diagnose"), "no log")


def test_nothing_half_written_is_left(run: Run, tester: Path) -> None:
    """What can't be written is said before the work, and what can isn't either."""
    code, _, _ = run(
        "diagnose", tester, "--model", "hooke", "--json", tester.parent / "d.json", "--report", "nowhere/d.html"
    )
    assert code == 2
    assert sorted(path.name for path in tester.parent.iterdir()) == ["log.csv"]


def test_what_was_left_out_stands_apart_from_what_the_log_cannot_tell(run: Run, tester: Path) -> None:
    code, said, err = run("diagnose", tester, "--model", "hooke", "--max-effects", 0)
    assert code == 0, err
    apart = next(line for line in said.splitlines() if line.startswith("left out"))
    assert "viscous-damping" in apart
    assert all("viscous-damping" not in line for line in said.splitlines() if line.startswith("this log cannot tell"))


def test_a_tolerance_is_asked_for(run: Run, tester: Path) -> None:
    """What a spring leaves of a dashpot is 0.1 N: more than 2 % of the readings, and inside of 0.2 N."""
    target = tester.parent / "d.json"
    for tolerance, verdict in ((), "unexplained"), (("--tolerance", 0.2), "adequate"):
        code, said, err = run("diagnose", tester, "--model", "hooke", "--max-effects", 0, *tolerance, "--json", target)
        assert code == 0, err
        facts = json.loads(target.read_text())
        assert facts["verdict"] == verdict
        assert f"The tolerance is {facts['tolerance']:.3g} N." in said
    assert facts["tolerance"] == 0.2


def test_effort_is_no_option_any_more(run: Run, tester: Path) -> None:
    code, _, err = run("diagnose", tester, "--model", "hooke", "--effort", 2)
    assert code == 2
    assert "No such option: --effort" in err
