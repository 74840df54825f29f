"""`kinid changes` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinid.lab.experiments import prepare
from kinid.lab.materials import ECOFLEX, SPONGE, Patch
from kinid.lab.protocol import Slide, five_phases
from kinid.lab.writing import write_experiment

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def crossed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a slide over a border at 2.25 mm."""
    folder = tmp_path_factory.mktemp("slide")
    material = ECOFLEX.replace(patches=(Patch((2.25e-3, -0.1), (0.1, 0.1), SPONGE),))
    script = five_phases(Slide(speed=5e-3, length=8e-3, directions=(0.0,)))
    return write_experiment(folder, prepare("slide", seed=3).replace(material=material, script=script).run(), {})


def test_borders_are_printed_and_written(run: Run, crossed: Path, tmp_path: Path) -> None:
    out = tmp_path / "borders.json"
    code, said, _ = run("changes", crossed, "--json", out)
    assert code == 0
    found = json.loads(out.read_text())
    assert len(found) == 2
    for border in found:
        assert {"t", "slip1", "slip2", "sd", "before", "after"} <= set(border)
        assert abs(border["slip1"] - 2.25e-3) < 0.5e-3
        assert 0 < border["sd"] < 0.5e-3
    assert np.sign(np.cos(found[0]["direction"])) == 1.0
    assert found[0]["before"]["stiffness"] > found[0]["after"]["stiffness"]
    assert "2.2" in said or "2.3" in said
    assert "doubt" not in said


def test_a_border_that_may_be_none_is_doubted(run: Run, tmp_path: Path) -> None:
    material = ECOFLEX.replace(relaxation=((0.5, 1.0),))
    script = five_phases(Slide(speed=5e-3, length=8e-3, directions=(0.0,)))
    log = write_experiment(tmp_path, prepare("slide", seed=3).replace(material=material, script=script).run(), {})
    code, said, _ = run("changes", log, "--json", tmp_path / "borders.json")
    assert code == 0
    assert "may be none: the way back across it shows none" in said
    assert all(border["doubt"] for border in json.loads((tmp_path / "borders.json").read_text()))


def test_wrong_questions_are_refused(run: Run, refused: Callable[..., None], crossed: Path) -> None:
    refused(run("changes", crossed, "--false-alarms", "2"), "false-alarm")
    refused(run("changes", crossed.parent / "none.parquet", "--rig", crossed.parent / "rig.toml"), "none.parquet")


def with_rig(log: Path, line: str, other: str) -> Path:
    """A rig beside the log's with another line."""
    text = (log.parent / "rig.toml").read_text(encoding="utf-8")
    assert line in text
    path = log.parent / "other.toml"
    path.write_text(text.replace(line, other), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("line", "other", "words"),
    [
        ("[robot]", "[columns]\nwrench = { scale = 1000.0 }\n\n[robot]", "the wrench is in another unit"),
        ("mass = 0.24", "mass = 0.9", "correct [tool] mass"),
    ],
)
def test_what_hides_a_slide_is_said(
    run: Run, refused: Callable[..., None], crossed: Path, line: str, other: str, words: str
) -> None:
    rig = with_rig(crossed, line, other)
    refused(run("changes", crossed, "--rig", rig), "no slide of 4 mm", "first see to what is to be doubted", words)


def test_what_contact_doubts_is_doubted_here_too(run: Run, crossed: Path) -> None:
    code, said, err = run(
        "changes", crossed, "--rig", with_rig(crossed, "com = [0.0, 0.0, 0.049]", "com = [0.049, 0.0, 0.0]")
    )
    assert code == 0, err
    assert "correct [tool] com" in said
