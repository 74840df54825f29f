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


FIRST = ["poke", "--seed", "3"]


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
    for name, words in (("a", []), ("b", ["--torque-limit", "150"]), ("c", ["--torque-limit", "176,176,100,100,100,38,38"])):
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
        (["teleoperation", "--material", "mould"], "material 'mould'"),
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
