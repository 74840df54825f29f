"""`kinid fit` and `compare` of many logs: what they print, write and refuse."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign.testers import several

from kinid.campaign import Campaign
from kinid.cli import main
from kinid.errors import InputError


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr("sys.argv", ["kinid", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, log in zip("abc", several(3)):
        pq.write_table(pa.table({"t": log.t, **log.contact}), tmp_path / f"{name}.parquet")
    return tmp_path


def test_a_folder_is_fitted(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    facts, page = folder / "out" / "fit.json", folder / "out" / "fit.html"
    facts.parent.mkdir()
    model = "kelvin-voigt,surface-offset,sensor-bias"
    assert run(monkeypatch, "fit", folder, "--model", model, "--json", facts, "--plot", page) == 0
    said = capsys.readouterr().out
    assert "kelvin-voigt.stiffness" in said
    assert "on logs held out" in said
    found = json.loads(facts.read_text())
    assert found["logs"] == ["a.parquet", "b.parquet", "c.parquet"]
    assert list(found["parameters"]) == ["kelvin-voigt.stiffness", "kelvin-voigt.damping"]
    text = page.read_text()
    assert all(name in text for name in found["logs"])
    assert "http://" not in text.split("plotly.js", maxsplit=1)[0]


def test_logs_that_cannot_be_used_are_counted_and_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = pq.read_table(folder / "c.parquet")
    pq.write_table(whole.drop_columns(["normal_force"]), folder / "deaf.parquet")
    (folder / "notes.csv").write_text("who,when\nme,today\n")
    assert run(monkeypatch, "fit", folder, "--model", "kelvin-voigt,surface-offset,sensor-bias") == 0
    said = capsys.readouterr().out
    assert "; 2 of 5 logs put aside\n" in said
    for name, why in (("deaf.parquet", "no normal force"), ("notes.csv", "no time")):
        assert f"doubt: {name} is put aside: found {why}" in said


def test_a_rejected_fit_of_many_logs_names_the_command_that_says_more(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "fit", folder, "--model", "hooke,sensor-bias", "--workers", 1) == 0
    said = capsys.readouterr().out
    (line,) = [line for line in said.splitlines() if line.startswith("next: ")]
    words = shlex.split(line)[1:]
    assert words == ["kinid", "diagnose", str(folder), "--model", "hooke,sensor-bias", "--workers", "1"]
    assert "alone: the fit of this log by itself" in said


def test_models_are_compared(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    logs = [folder / f"{name}.parquet" for name in "abc"]
    words = ["--model", "hooke", "--model", "kelvin-voigt", "--json", folder / "c.json", "--plot", folder / "c.html"]
    assert run(monkeypatch, "compare", *logs, *words) == 0
    said = capsys.readouterr().out
    assert "differences are means over logs held out" in said
    assert "kelvin-voigt wins" in said
    found = json.loads((folder / "c.json").read_text())
    assert found["reference"] == "kelvin-voigt"
    assert found["models"][1]["held_out_by_log"] > found["models"][0]["held_out_by_log"]
    assert "by log" in (folder / "c.html").read_text()


def test_one_log_that_is_left_has_no_error_of_logs_held_out(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pq.read_table(folder / "b.parquet")
    turned = pa.array(-abs(table["depth"].to_numpy()) - 1e-3)
    table = table.set_column(table.column_names.index("depth"), "depth", turned)
    pq.write_table(table, folder / "b.parquet")
    for command in ("fit", "compare"):
        words = (command, folder / "a.parquet", folder / "b.parquet", "--model", "kelvin-voigt")
        assert run(monkeypatch, *words) == 0
        said = capsys.readouterr().out
        assert "b.parquet is put aside: found a depth that is never positive" in said
        assert "nan" not in said


def test_a_campaign_is_diagnosed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model = "kelvin-voigt,surface-offset,sensor-bias"
    words = ["--max-effects", 0, "--json", folder / "d.json", "--report", folder / "d.html"]
    assert run(monkeypatch, "diagnose", folder, "--model", model, *words) == 0
    assert "adequate" in capsys.readouterr().out
    found = json.loads((folder / "d.json").read_text())
    assert (found["verdict"], found["added"], found["odd"]) == ("adequate", [], [])
    assert "Effects by log" in (folder / "d.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fit", "none", "a.parquet"], "no log at none"),
        (["fit", "a.parquet", "b.parquet", "-o", "t.csv"], "many logs"),
        (["fit", "empty"], "no logs in empty"),
        (["diagnose", "a.parquet", "b.parquet", "--add", "relaxation"], "for many logs"),
    ],
)
def test_what_is_wrong_is_one_line(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.chdir(folder)
    assert run(monkeypatch, *words, "--model", "hooke") == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("command", ["fit", "compare", "diagnose"])
@pytest.mark.parametrize("how", ["named", "copied", "linked"])
def test_a_log_that_is_there_twice_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str, how: str
) -> None:
    first, again = folder / "a.parquet", folder / "again.parquet"
    if how == "copied":
        again.write_bytes(first.read_bytes())
    elif how == "linked":
        again.symlink_to(first)
    else:
        again = first
    models = ["--model", "hooke"] + (["--model", "kelvin-voigt"] if command == "compare" else [])
    assert run(monkeypatch, command, first, again, *models) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "twice" in said
    assert "each log once" in said


def test_one_log_given_twice_in_python_is_refused() -> None:
    first, second = several(2)
    Campaign([first, second])
    with pytest.raises(InputError, match="numbers 1 and 3"):
        Campaign([first, second, first.replace(phase=None)])
