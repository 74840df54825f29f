"""The notebooks run from the first cell to the last, and show what they say they show."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
Names = dict[str, Any]


def contact_frame(names: Names, said: str) -> None:
    assert np.nanstd(names["force_error"]) < 2 * names["rig"].sensor.noise[2]
    assert np.nanmax(np.abs(names["depth_error"])) < 1e-5
    assert "residual rms" in said


def excitation(names: Names, said: str) -> None:
    assert all(names["found"].intervals[name].half < 0.8 * each.half for name, each in names["before"].items())
    assert names["motion"].normal_force.max() <= names["force"]
    assert "refused: found" in said


def comparison(names: Names, said: str) -> None:
    assert [str(row.fit.model) for row in names["table"].rows] == ["hunt-crossley", "kelvin-voigt", "hooke"]
    for material, truth in names["truth"].items():
        for value, name in zip(truth, ("stiffness", "damping", "coefficient")):
            assert names["fits"][material][name].value == pytest.approx(value, rel=0.1)


def hidden_effect(names: Names, said: str) -> None:
    assert names["found"].added[0] == "relaxation"
    assert "missing ('relaxation'," in said
    assert names["found"].steps[-1].held_out < 0.5 * names["found"].steps[0].held_out


def mould(names: Names, said: str) -> None:
    assert len(names["grown"]) == 36
    misfit, film = names["grown"].misfit, names["film"]
    assert film.any()
    assert np.median(misfit[film]) > 5 > 1.5 > np.median(misfit[~film])


def picture(names: Names, said: str) -> None:
    figures = names["figures"]
    assert figures.random_folds > 0.8
    assert 0.5 < figures.spatial_blocks <= figures.random_folds + 0.02
    assert np.mean(names["strangers"] == "unknown") > 0.95


def another_robot(names: Names, said: str) -> None:
    assert names["fit"]["stiffness"].value == pytest.approx(900.0, rel=0.01)
    assert "did you mean 'tool_tip'" in said


def teleoperation(names: Names, said: str) -> None:
    stable = {(row.delay, row.method): row.stable for row in names["found"].rows}
    assert all(stable[delay, "impedance"] for delay in (0.05, 0.2))
    assert not any(stable[delay, "direct"] for delay in (0.05, 0.2))


SHOWN: dict[str, Callable[[Names, str], None]] = {
    "01-raw-logs-to-contact-frame": contact_frame, "02-plan-an-excitation": excitation, "03-fit-and-compare": comparison,
    "04-find-the-hidden-effect": hidden_effect, "05-explore-a-mould": mould, "06-picture-to-properties": picture,
    "07-another-robot": another_robot, "08-teleoperation": teleoperation,
}  # fmt: skip


def test_each_notebook_has_its_number_and_its_check() -> None:
    assert [path.stem for path in NOTEBOOKS] == sorted(SHOWN)
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{i + 1:02d}" for i in range(len(NOTEBOOKS))]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    if "picture" in path.stem:
        pytest.importorskip("sklearn")
    monkeypatch.chdir(tmp_path)
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    names: Names = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "notebooks are kept without their outputs"
            exec(compile("".join(cell["source"]), str(path), "exec"), names)
    SHOWN[path.stem](names, capsys.readouterr().out)
