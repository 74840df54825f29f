"""`kinid lab`, as typed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from kinid.cli.lab import lab
from kinid.errors import InputError


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
    told = json.loads((tmp_path / "c" / "truth" / "poke_0000.json").read_text())["hidden"]
    assert told["where"] == [[0.0, -0.05], [0.05, 0.0]]


def test_teleoperation(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["teleoperation", "--material", "sponge", "-o", str(tmp_path / "t")])
    assert result.exit_code == 0, result.output
    assert "transparency error" in result.output
    assert {p.name for p in (tmp_path / "t").iterdir()} == {"teleoperation.html", "teleoperation.json"}


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
        (["teleoperation", "--material", "mould"], "material 'mould'"),
        (["teleoperation", "--hide", "relaxation"], "teleoperation with --hide"),
    ],
)
def test_bad_input_is_said_and_nothing_written(app: typer.Typer, tmp_path: Path, words: list[str], found: str) -> None:
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert found in str(result.exception)
    assert not (tmp_path / "out").exists()
