"""`kinid lab`, as typed."""

from __future__ import annotations

import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import kinid
from kinid.cli.lab import lab
from kinid.errors import InputError
from kinid.lab import teleoperation_study
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane


@pytest.fixture(scope="module")
def app() -> typer.Typer:
    app = typer.Typer()
    app.command()(lab)
    return app


def test_hidden_effect_is_told_to_the_truth_alone(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["poke", "--hide", "relaxation", "--seed", "7", "-o", str(tmp_path / "x")])
    assert result.exit_code == 0, result.output
    assert {p.name for p in (tmp_path / "x").iterdir()} == {"log.parquet", "log.mcap", "streams", "rig.toml", "truth"}
    truth = json.loads((tmp_path / "x" / "truth" / "log.json").read_text())
    assert truth["hidden"]["effect"] == "relaxation"
    assert 0.1 < truth["hidden"]["parameters"]["ratio"] < 0.6
    assert "relaxation" not in result.output
    for path in ("rig.toml", "log.parquet", "log.mcap"):
        assert b"relaxation" not in (tmp_path / "x" / path).read_bytes()


def test_campaign_goes_on(app: typer.Typer, tmp_path: Path) -> None:
    words = ["mould", "--campaign", "1x2", "-o", str(tmp_path / "c")]
    assert "2 pokes made" in CliRunner().invoke(app, words).output
    assert (tmp_path / "c" / "overview.html").is_file()
    (tmp_path / "c" / "poke_0001.parquet").unlink()
    assert "1 pokes made (1 were there already)" in CliRunner().invoke(app, words).output
    other = CliRunner().invoke(app, [*words[:-1], str(tmp_path / "c"), "--normal", "0.1,0,1"])
    assert "another campaign" in str(other.exception)


def test_streams_of_a_campaign_and_an_effect_in_a_part_of_the_surface(app: typer.Typer, tmp_path: Path) -> None:
    words = ["mould", "--campaign", "1x1", "--hide", "relaxation", "--where", "0,-0.05,0.05,0", "--mcap"]
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "c")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "c" / "poke_0000.mcap").is_file()
    facts = json.loads((tmp_path / "c" / "truth" / "poke_0000.json").read_text())["hidden"]
    assert facts["where"] == [[0.0, -0.05], [0.05, 0.0]]


@pytest.fixture
def one_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small study of all schemes."""
    monkeypatch.setattr(teleoperation_study, "DELAYS", (0.05,))
    monkeypatch.setattr(teleoperation_study, "STIFFNESSES", (732.0,))


@pytest.mark.usefixtures("one_delay")
def test_teleoperation(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["teleoperation", "--material", "sponge", "-o", str(tmp_path / "t")])
    assert result.exit_code == 0, result.output
    assert "transparency error" in result.output
    assert {p.name for p in (tmp_path / "t").iterdir()} == {"teleoperation.html", "teleoperation.json"}


@pytest.mark.usefixtures("one_delay")
def test_teleoperation_reflects_a_map_that_was_measured(app: typer.Typer, tmp_path: Path) -> None:
    lies = Plane(np.array([0.55, 0.0, 0.1]), np.eye(3))
    places = [lies.point + [x, y, 0.0] for x in (0.01, 0.02, 0.03) for y in (0.01, 0.02, 0.03)]
    kinds = (Property("stiffness", "N/m"), Property("damping", "N·s/m"))
    probes = tuple(Probe(place, np.array([900.0, 12.0]), np.diag([4.0, 0.01])) for place in places)
    PropertyMap(lies, kinds, probes).write(tmp_path / "map.parquet")
    words = ["teleoperation", "--material", "mould", "--map", str(tmp_path / "map.parquet")]
    result = CliRunner().invoke(app, [*words, "--at", "0.02,0.02", "-o", str(tmp_path / "t")])
    assert result.exit_code == 0, result.output
    facts = json.loads((tmp_path / "t" / "teleoperation.json").read_text())
    assert facts["map"] == {"stiffness": pytest.approx(900.0, rel=0.01), "damping": pytest.approx(12.0, rel=0.01)}
    assert facts["place"] == [0.02, 0.02]
    away = CliRunner().invoke(app, [*words, "--at", "-0.04,-0.04", "-o", str(tmp_path / "u")])
    assert "doesn't know" in str(away.exception)


def test_published_true_and_estimated_side_by_side(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["study", "--seed", "2", "-o", str(tmp_path / "s")])
    assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / "s" / "study.json").read_text())
    assert len(rows) == 9
    within = {"stiffness": 0.03, "damping": 0.10, "friction": 0.05}
    for row in rows:
        assert row["published"] == row["true"]
        assert row["estimated"] == pytest.approx(row["true"], rel=within[row["parameter"]])
        assert row["low"] < row["estimated"] < row["high"]
        assert f"{row['estimated']:.4g}" in result.output


def test_borders_along_four_slides(app: typer.Typer, tmp_path: Path) -> None:
    out = tmp_path / "s"
    result = CliRunner().invoke(app, ["slides", "--seed", "2", "-o", str(out)])
    assert result.exit_code == 0, result.output
    rows = json.loads((out / "slides.json").read_text())
    assert "12 of 12 crossings found, none where no border is" in result.output
    assert {row["slide"] for row in rows} == {1, 2, 3, 4}
    assert all(abs(row["error"]) < 0.5e-3 for row in rows)  # what is asked of borders
    assert all(abs(row["error"]) < 4.0 * row["sd"] for row in rows)
    # where silicones were poured beside each other is known in closed form, too: x = 1.5 mm sin(90 y / m)
    assert rows[0]["true"] == pytest.approx(1.5e-3 * np.sin(90.0 * -0.022), abs=5e-5)
    assert "Slide 4" in (out / "slides.html").read_text()
    rig, log = out / "rig.toml", out / "slide_2.parquet"
    assert kinid.contact_series(kinid.read(log, kinid.Rig.load(rig)), kinid.Rig.load(rig)).depth.max() > 2e-3


FIRST = ["poke", "--seed", "3"]


def test_what_was_not_reached_is_said(app: typer.Typer, tmp_path: Path) -> None:
    """Soft gains that get through; a motion in the air; and an effect of the material that it can't show."""
    soft = CliRunner().invoke(app, [*FIRST, "--stiffness", "450", "-o", str(tmp_path / "soft")])
    assert soft.exit_code == 0, soft.output
    assert "no contact in hold: asked for 3.0 mm below the surface" in soft.output
    stiff = CliRunner().invoke(app, [*FIRST, "-o", str(tmp_path / "stiff")])
    assert "no contact" not in stiff.output
    for hide, words in (("relaxation", True), ("tool-mass", False)):
        wave = CliRunner().invoke(app, ["wave", "--hide", hide, "-o", str(tmp_path / hide)])
        assert "nothing was touched" in wave.output
        assert ("this log can't tell it" in wave.output.replace("\n", " ")) == words


@pytest.mark.parametrize(
    "stops",
    [
        ("write_rig", "write_log"),  # the first and the last
        pytest.param(("write_rig", "write_streams", "write_mcap", "write_log"), marks=pytest.mark.slow),
    ],
)
def test_an_experiment_that_was_killed_is_made_again(app: typer.Typer, tmp_path: Path, stops: tuple[str, ...]) -> None:
    """Killed at any step of writing, the folder isn't blocked, and ends with the bytes of a run that wasn't."""
    assert CliRunner().invoke(app, [*FIRST, "-o", str(tmp_path / "whole")]).exit_code == 0
    whole = {p.relative_to(tmp_path / "whole"): p.read_bytes() for p in (tmp_path / "whole").rglob("*") if p.is_file()}
    for i, stop in enumerate(stops):
        out = tmp_path / str(i)
        code = (
            f"import os, sys; import kinid.lab.writing; kinid.lab.writing.{stop} = lambda *a, **k: os._exit(9); "
            f"sys.argv = ['kinid', 'lab', 'poke', '--seed', '3', '-o', {str(out)!r}]; from kinid.cli import main; "
            f"main()"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode == 9
        assert (out / "truth" / "log.begun").is_file()
        if i == 1:  # somebody else's file in it: nothing is taken away
            (out / "notes.txt").write_text("mine")
            assert "rig.toml" in str(CliRunner().invoke(app, [*FIRST, "-o", str(out)]).exception)
            (out / "notes.txt").unlink()
        again = CliRunner().invoke(app, [*FIRST, "-o", str(out)])
        assert again.exit_code == 0, (again.output, again.exception)
        assert {p.relative_to(out): p.read_bytes() for p in out.rglob("*") if p.is_file()} == whole


@pytest.mark.parametrize("stop", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["full", "stopped"])
def test_an_experiment_that_fails_leaves_nothing(
    stop: BaseException, app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither its rig and truth nor the mark that it had begun; what else is in the folder stays."""

    def stops(*_: object) -> None:
        raise stop

    monkeypatch.setattr("kinid.lab.writing.write_log", stops)
    (tmp_path / "mine").mkdir()
    for out in (tmp_path / "new" / "x", tmp_path / "mine"):
        assert CliRunner().invoke(app, [*FIRST, "-o", str(out)]).exit_code != 0
    assert [path.name for path in tmp_path.rglob("*")] == ["mine"]


@pytest.mark.parametrize(
    ("step", "whole"), [("kinid.lab.campaign.write_experiment", 1), ("kinid.lab.campaign_page.Overview.add", 2)]
)
def test_a_campaign_that_is_interrupted_says_how_it_goes_on(
    step: str, whole: int, app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As its second poke is made, or is looked at, when it is whole already."""
    made, do = [], pkgutil.resolve_name(step)

    def stops(*args: Any, **named: Any) -> None:
        if made:
            raise KeyboardInterrupt
        made.append(do(*args, **named))

    monkeypatch.setattr(step, stops)
    words = ["mould", "--campaign", "1x3", "-o", str(tmp_path / "c")]
    stopped = CliRunner().invoke(app, words)
    assert stopped.exit_code == 130
    assert f"{whole} of 3 pokes are whole" in stopped.output
    monkeypatch.undo()
    assert f"{3 - whole} pokes made ({whole} were there already)" in CliRunner().invoke(app, words).output


def test_the_overview_of_a_campaign_is_the_same_each_time(app: typer.Typer, tmp_path: Path) -> None:
    pages = []
    for name in ("a", "b"):
        assert CliRunner().invoke(app, ["mould", "--campaign", "1x1", "-o", str(tmp_path / name)]).exit_code == 0
        pages.append((tmp_path / name / "overview.html").read_bytes())
    assert pages[0] == pages[1]


def test_a_folder_holds_one_experiment(app: typer.Typer, tmp_path: Path) -> None:
    """A second one would stand beside the first one's rig and truth: refused, and nothing touched."""
    out = tmp_path / "x"
    assert CliRunner().invoke(app, [*FIRST, "-o", str(out)]).exit_code == 0
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    for words in (FIRST, ["wave"], ["mould", "--campaign", "1x1"], ["teleoperation"]):
        again = CliRunner().invoke(app, [*words, "-o", str(out)])
        assert isinstance(again.exception, InputError)
        assert "rig.toml, log.parquet" in str(again.exception)
        assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rig.toml").write_text("# mine\n")
    assert "rig.toml" in str(CliRunner().invoke(app, [*FIRST, "-o", str(tmp_path / "mine")]).exception)
    assert (tmp_path / "mine" / "rig.toml").read_text() == "# mine\n"


def test_an_experiment_doesn_t_enter_a_campaign(app: typer.Typer, tmp_path: Path) -> None:
    assert CliRunner().invoke(app, ["mould", "--campaign", "1x1", "-o", str(tmp_path)]).exit_code == 0
    assert "campaign.json" in str(CliRunner().invoke(app, [*FIRST, "-o", str(tmp_path)]).exception)


def test_slide_makes_a_campaign_of_slides(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["slide", "--campaign", "1x1", "-o", str(tmp_path / "s")])
    assert "1 slides made" in result.output
    assert [path.name for path in (tmp_path / "s").glob("*.parquet")] == ["slide_0000.parquet"]


def test_torque_limits_reach_the_drives(app: typer.Typer, tmp_path: Path) -> None:
    """A limit below what holds the arm is refused; one above leaves the log as it was."""
    logs = []
    for name, words in (
        ("a", []),
        ("b", ["--torque-limit", "150"]),
        ("c", ["--torque-limit", "176,176,100,100,100,38,38"]),
    ):
        assert CliRunner().invoke(app, [*FIRST, *words, "-o", str(tmp_path / name)]).exit_code == 0
        logs.append((tmp_path / name / "log.parquet").read_bytes())
    assert logs[0] == logs[1] == logs[2]


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["pok"], "experiment 'pok'"),
        (["poke", "--material", "wood"], "material 'wood'"),
        (["poke", "--hide", "magic"], "effect 'magic'"),
        (["poke", "--point", "1.6,0,0.1"], "reach"),
        (["poke", "--point=-0.55,0,0.1"], "behind the robot"),
        (["poke", "--normal", "0,0,-1"], "turned away"),
        (["poke", "--normal", "0,0,0"], "direction"),
        (["poke", "--point", "1,2"], "--point"),
        (["poke", "--stiffness", "1e6"], "unstable"),
        (["poke", "--seed", "-1"], "--seed"),
        (["poke", "--campaign", "ten"], "--campaign"),
        (["poke", "--campaign", "0x3"], "campaign"),
        (["poke", "--stiffness", "6000"], "5200"),
        (["poke", "--stiffness", "nan"], "positive"),
        (["poke", "--point", "0.1,0,0.1"], "limits"),
        (["band", "--material", "dragon-skin-30"], "sensor's range"),
        (["mould", "--campaign", "3x3", "--spacing", "0.1"], "beside the mould"),
        (["mould", "--campaign", "2x2", "--point=-0.5,0,0.1"], "behind the robot"),
        (["poke", "--campaign", "30x30", "--spacing", "0.03"], "limits"),
        (["poke", "--spacing", "0.1"], "--spacing"),
        (["poke", "--where", "0,0,1,1"], "--where"),
        (["poke", "--hide", "relaxation", "--where", "0,0,1"], "4 numbers"),
        (["poke", "--hide", "sensor-bias", "--where", "0,0,1,1"], "part of the surface"),
        (["teleoperation", "--material", "wood"], "material 'wood'"),
        (["teleoperation", "--hide", "relaxation"], "teleoperation with --hide"),
        (["pok"], "teleoperation"),
        (["teleoperation", "--torque-limit", "9"], "teleoperation with --torque-limit"),
        ([], "neither an experiment nor --trajectory"),
        (["poke", "--trajectory", "plan.parquet"], "'poke' and --trajectory"),
        (["--trajectory", "absent.parquet"], "no file absent.parquet"),
        (["--trajectory", "absent.parquet", "--campaign", "2x2"], "--campaign with --trajectory"),
        (["poke", "--rig", "rig.toml"], "--rig without --trajectory"),
        (["wave", "--campaign", "2x2"], "--campaign with wave"),
        (["poke", "--hide", "relaxation", "--where", "0.07,0,0.08,0.01"], "off the ecoflex-50"),
        (["mould", "--hide", "relaxation", "--where", "0.05,0,0.06,0.01"], "off the mould"),
        (["poke", "--hide", "relaxation", "--where", "0.02,0.02,0.03,0.03"], "isn't touched"),
        (["poke", "--hide", "relaxation", "--where", "0.02,0,0.01,0.01"], "two corners"),
        (["mould", "--campaign", "2x2", "--hide", "relaxation", "--where", "0.02,0.02,0.03,0.03"], "isn't touched"),
        (["poke", "--stiffness", "100"], "friction holds the tip"),
        (["band", "--stiffness", "90"], "lie above it in the air"),
        (["study", "--material", "sponge"], "study with --material"),
        (["poke", "--map", "map.parquet"], "--map without teleoperation or control"),
        (["control", "--material", "sponge"], "control with --material"),
        (["control", "--map", "absent.parquet"], "no readable map"),
        (["control", "--at", "0,0"], "--at without teleoperation"),
        (["poke", "--at", "0,0"], "--at without teleoperation"),
        (["teleoperation", "--at", "here"], "2 numbers"),
        (["teleoperation", "--material", "mould", "--at", "0.2,0"], "beside the mould"),
        (["teleoperation", "--map", "absent.parquet"], "no readable map"),
        (["poke", "--torque-limit", "20"], "limit 20 N·m"),
        (["poke", "--torque-limit", "20,30"], "--torque-limit 20,30"),
        (["poke", "--torque-limit", "-5"], "torque limits -5"),
        (["poke", "--torque-limit", "much"], "--torque-limit much"),
    ],
)
def test_bad_input_is_said_and_nothing_written(app: typer.Typer, tmp_path: Path, words: list[str], found: str) -> None:
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert found in str(result.exception)
    assert not (tmp_path / "out").exists()
