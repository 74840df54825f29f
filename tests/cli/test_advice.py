"""Advice runs: what a diagnosis, a doubt or a refusal tells to do next is a command that works as it is printed."""

from __future__ import annotations

import ast
import dataclasses
import json
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from scripted import Scripted

import kinid
from kinid import effects
from kinid.cli import app
from kinid.cli.show_diagnosis import show_diagnosis
from kinid.diagnosis import Diagnosis, EffectStatus, EffectVerdict
from kinid.planning.advice import Advisor
from kinid.planning.trajectory import read_trajectory

Run = Callable[..., tuple[int, str, str]]
HOUSE = Path(kinid.__file__).parent
GROUP = typer.main.get_command(app)
NAMES = "|".join(GROUP.commands)
#: a command ends where a sentence goes on
ADVISED = re.compile(rf"kinid (?:--effects \S+ )?(?:{NAMES})\b.*?(?=[;:)]|, |$)", re.MULTILINE)
#: what makes refusals, and which of its arguments is the remedy
REMEDY = {"InputError": 2, "read_json": 3, "read_text": 3}
#: effects that are taken for each other: some that a robot tells apart, some that none does
PAIRS = (
    ("tool-mass", "sensor-gain"),
    ("relaxation", "stiffness-drift"),
)


def commands(text: str) -> list[str]:
    """Those that a text advises."""
    return [found.rstrip(" .") for found in ADVISED.findall(text)]


def words_of(node: ast.expr) -> str:
    """A text of the source, "x" for each value in it; "" where it is none."""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "x" for part in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def remedies() -> Iterator[Any]:
    """Commands in the remedies of all refusals, with where they stand."""
    for path in sorted(HOUSE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            last = REMEDY.get(getattr(getattr(node, "func", None), "id", ""))
            if isinstance(node, ast.Call) and last is not None:
                for text in map(words_of, node.args[last:]):
                    for command in commands(text):
                        yield pytest.param(command, id=f"{path.stem}:{node.lineno}")


@pytest.mark.parametrize("command", list(remedies()))
def test_remedies_name_commands_that_can_be_typed(command: str) -> None:
    """With options that there are, and all arguments that are needed."""
    words = shlex.split(command)[1:]
    group: Any = GROUP
    while hasattr(group, "commands") and words[0] in group.commands:
        group, words = group.commands[words[0]], words[1:]
    assert not hasattr(group, "commands"), f"{command}: which of {', '.join(group.commands)}?"
    if words != ["--help"]:
        group.make_context("kinid", words)


def pressed(folder: Path, seconds: int) -> Path:
    """A material tester's pokes of a spring that stiffens."""
    t = np.arange(250 * seconds) / 250
    depth = 4e-3 * np.sin(2 * np.pi * t)
    noise = np.random.default_rng(0).normal(0, 0.01, len(t))
    force = np.where(depth > 0, 700 * depth + 1e5 * depth**2, 0) + noise
    table = np.column_stack([t, depth, force])
    np.savetxt(folder / "a.csv", table, delimiter=",", header="t,depth,normal_force", comments="")
    (folder / "rig.toml").write_text("[sensor]\nnoise = [0.01, 0.01, 0.01, 0.001, 0.001, 0.001]\n", encoding="utf-8")
    return folder / "a.csv"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, scripted: Scripted) -> tuple[Diagnosis, kinid.Rig]:
    """A diagnosis of a short log, and the rig of a robot to plan with: what is asked of it doesn't hang on what it
    says.
    """
    folder = tmp_path_factory.mktemp("found")
    log = kinid.read(pressed(folder, 5), kinid.Rig())
    rig = kinid.Rig.load(scripted.write(folder).parent / "rig.toml")
    return kinid.diagnose(log, kinid.Rig(), model=kinid.Model("hooke"), max_effects=0), rig


def with_rivals(found: Diagnosis, *pairs: tuple[str, str]) -> Diagnosis:
    """The diagnosis, as if the log couldn't tell these apart, and didn't show another."""
    alike = [EffectVerdict(a, EffectStatus.INDISTINGUISHABLE, 5.0, "", (b,), separate_by="words") for a, b in pairs]
    hidden = EffectVerdict("coupled-stiffness", EffectStatus.NOT_EXCITED, 0.0, "", separate_by="words")
    return dataclasses.replace(found, effects=(*alike, hidden))


@pytest.fixture(scope="module")
def advised(found: tuple[Diagnosis, kinid.Rig]) -> Diagnosis:
    return Advisor(with_rivals(found[0], *PAIRS), found[1], Path("rig.toml")).advised()


def test_what_a_diagnosis_tells_to_measure_next_can_be_planned(
    advised: Diagnosis, run: Run, log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(log.parent)
    show_diagnosis(advised)
    lines = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("    kinid ")]
    assert len(lines) == 2  # of one pair, and of what the log doesn't show; the other pair is beyond any robot
    for line in lines:
        code, _, err = run(*shlex.split(line)[1:])
        assert code == 0, f"{line}: {err}"
        plan = read_trajectory(Path(shlex.split(line)[-1]))
        # the words are of the experiment that the command plans
        said = next(effect.separate_by for effect in advised.effects if line in effect.separate_by)
        assert said.startswith(f"record {plan.provenance['discrimination']['title']}, to tell ")
    for effect in advised.effects:
        assert effect.separate_by.startswith("words") is ("kinid plan" not in effect.separate_by)


def test_a_diagnosis_that_is_written_is_what_to_plan_for(
    found: tuple[Diagnosis, kinid.Rig], run: Run, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    written = Path("found facts.json")  # a name that a shell needs quoted
    rivals = with_rivals(found[0], ("relaxation", "stiffness-drift"))
    result = Advisor(rivals, found[1], Path("rig.toml"), written).advised()
    written.write_text(json.dumps(result.to_dict()), encoding="utf-8")
    (line,) = commands(result["relaxation"].separate_by)
    assert "--value" not in line
    code, _, err = run(*shlex.split(line)[1:])
    assert code == 0, f"{line}: {err}"


def test_what_no_experiment_tells_apart_gets_the_reason(advised: Diagnosis) -> None:
    """It was advised to plan that, and refused."""
    said = advised["tool-mass"].separate_by
    assert "kinid plan" not in said
    assert "no experiment" in said
    assert "calibration" in said


def test_a_log_without_a_robot_gets_no_trajectory(found: tuple[Diagnosis, kinid.Rig]) -> None:
    rivals = with_rivals(found[0], *PAIRS)
    assert Advisor(rivals, kinid.Rig(), Path("rig.toml")).advised() is rivals


@pytest.mark.slow
@pytest.mark.parametrize("name", effects.catalogue())
def test_advice_for_all_confusions_can_be_planned(
    name: str, found: tuple[Diagnosis, kinid.Rig], run: Run, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    known = [other for other in effects.get(name).confusions if other in effects.catalogue()]
    alike = tuple(EffectVerdict(name, EffectStatus.INDISTINGUISHABLE, 5.0, "", (other,)) for other in known)
    for verdict in Advisor(dataclasses.replace(found[0], effects=alike), found[1], Path("rig.toml")).advised().effects:
        for line in re.findall(r"kinid plan.*", verdict.separate_by):
            code, _, err = run(*shlex.split(line)[1:])
            assert code == 0, f"{line}: {err}"


def test_a_rejected_fit_names_the_command_that_says_more(run: Run, tmp_path: Path) -> None:
    log, rig = pressed(tmp_path, 5), tmp_path / "rig.toml"
    code, said, err = run("fit", log, "--rig", rig, "--model", "hooke")
    assert code == 0, err
    (line,) = [line for line in said.splitlines() if line.startswith("next: ")]
    assert shlex.split(line)[1:] == ["kinid", "diagnose", str(log), "--rig", str(rig), "--model", "hooke"]
    code, _, err = run(*shlex.split(line)[2:])
    assert code == 0, err


def test_a_fit_that_no_diagnosis_can_take_says_so(run: Run, tmp_path: Path) -> None:
    """Two seconds can be fitted, and are too few to hold half of them out."""
    log = pressed(tmp_path, 2)
    code, said, err = run("fit", log, "--model", "hooke")
    assert code == 0, err
    (line,) = [line for line in said.splitlines() if line.startswith("next: ")]
    assert "can't be diagnosed" in line
    assert run("diagnose", log, "--model", "hooke")[0] == 2


def test_remedies_hold_the_log_and_the_rig_of_the_command_line(run: Run, tmp_path: Path) -> None:
    log, rig = pressed(tmp_path, 5), tmp_path / "rig.toml"
    code, _, err = run("diagnose", log, "--rig", rig)
    assert code == 2
    (line,) = commands(err)
    assert shlex.split(line)[2:5] == [str(log), "--rig", str(rig)]


def test_touches_are_not_asked_for_a_surface_that_they_do_not_give(run: Run, log: Path) -> None:
    """One touch leaves the plane open, and the advice says so instead of being refused."""
    rig = log.parent / "rig.toml"
    rig.write_text(rig.read_text(encoding="utf-8").replace("0.10]", "-0.20]"), encoding="utf-8")
    code, _, err = run("fit", log, "--model", "hooke")
    assert code == 2
    assert "--find-surface (once the log has more of them; now it is refused: touch" in err


def test_advised_commands_read_the_effects_of_the_command_line(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a fit, and what a refusal tells to do next, knows the reader's own effects as the command before did."""
    log, own = pressed(tmp_path, 5), tmp_path / "my effects"
    own.mkdir()
    monkeypatch.setenv("KINID_EFFECTS", "")
    code, said, err = run("fit", log, "--model", "hooke", "--effects", own)
    assert code == 0, err
    (line,) = [line for line in said.splitlines() if line.startswith("next: ")]
    assert shlex.split(line)[1:5] == ["kinid", "--effects", str(own), "diagnose"]
    code, _, err = run("diagnose", log, "--effects", own)
    assert code == 2
    (line,) = re.findall(r"kinid .* --model \S+", err)
    assert shlex.split(line)[:4] == ["kinid", "--effects", str(own), "diagnose"]
