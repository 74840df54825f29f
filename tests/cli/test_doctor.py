"""`kinid doctor`: says what is here, and fails where something needed is missing."""

from __future__ import annotations

import importlib.metadata
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from kinid.cli import doctor

Run = Callable[..., tuple[int, str, str]]


def findings(path: Path) -> dict[str, dict[str, str]]:
    return {f["name"]: f for f in json.loads(path.read_text())["findings"]}


def test_all_is_here(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "real" / "some-logs").mkdir(parents=True)
    monkeypatch.setenv("KINID_REAL_DATA", str(tmp_path / "real"))
    code, said, err = run("doctor", "--json", tmp_path / "doctor.json")
    assert code == 0, err
    found = findings(tmp_path / "doctor.json")
    assert json.loads((tmp_path / "doctor.json").read_text())["healthy"] is True
    assert f"pin {importlib.metadata.version('pin')}" in found["libraries"]["says"]
    assert "7 joints" in found["robot"]["says"]
    assert "some-logs" in found["measured data"]["says"]
    assert all(name in said for name in found)
    assert "\x1b[" not in said


def test_the_lists_are_those_of_the_package() -> None:
    """What a plain installation brings is what the doctor looks for; extras are those that can be installed."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    plain = {re.split(r"[<>=\[ ;]", line)[0] for line in project["dependencies"]}
    assert plain - {"example-robot-data-loaders"} == set(doctor.NEEDED)
    assert set(doctor.EXTRAS) <= set(project["optional-dependencies"])


def test_what_is_missing_is_named(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "NEEDED", (*doctor.NEEDED, "a-library-that-nobody-wrote"))
    code, said, _ = run("doctor", "--json", tmp_path / "doctor.json")
    assert code == 1
    assert "something that is needed is missing" in said
    assert findings(tmp_path / "doctor.json")["libraries"] == {
        "name": "libraries",
        "state": "bad",
        "says": "a-library-that-nobody-wrote not installed",
        "mend": "pip install a-library-that-nobody-wrote",
    }


def test_what_is_optional_may_be_absent(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KINID_REAL_DATA", str(tmp_path / "none"))
    monkeypatch.setattr(doctor, "EXTRAS", {"bags": ("no_such_module",)})
    code, said, err = run("doctor", "--json", tmp_path / "doctor.json")
    assert code == 0, err
    found = findings(tmp_path / "doctor.json")
    assert found["extra: bags"]["mend"] == "pip install 'kinid[bags]'"
    assert found["measured data"]["state"] == found["extra: bags"]["state"] == "note"
    assert "set KINID_REAL_DATA" in said


def test_one_broken_part_hides_no_other(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> doctor.Finding:
        raise ImportError("libpinocchio.so: cannot open shared object file")

    monkeypatch.setattr(doctor, "_robot", broken)
    code, _, err = run("doctor", "--json", tmp_path / "doctor.json")
    assert code == 1, err
    found = findings(tmp_path / "doctor.json")
    assert "libpinocchio.so" in found["robot"]["says"]
    assert found["cores"]["state"] == "good"
