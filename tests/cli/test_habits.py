"""What holds for every command: help with examples, completion, a summary for scripts, plain text where it is piped."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import kinid
from kinid.cli import app, complete
from kinid.effects import catalogue
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane

Run = Callable[..., tuple[int, str, str]]


def walk(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command that does something, with the words that call it."""
    children = getattr(command, "commands", None)
    if not children:
        yield path, command
    for name, child in (children or {}).items():
        yield from walk(child, (*path, name))


COMMANDS = dict(walk(typer.main.get_command(app)))
each = pytest.mark.parametrize("path", COMMANDS, ids=" ".join)


@each
def test_help_has_examples_that_can_be_copied(path: tuple[str, ...], run: Run) -> None:
    code, said, _ = run(*path, "--help")
    assert code == 0
    assert said.startswith(f"Usage: kinid {' '.join(path)}")
    examples = re.findall(r"^ +((?:\w+=\S+ )?kinid .+)$", said.split("Examples:", 1)[1], re.MULTILINE)
    assert examples
    known = {option for parameter in COMMANDS[path].params for option in (*parameter.opts, *parameter.secondary_opts)}
    for example in examples:
        words = shlex.split(re.sub(r"\s\s+\(.*\)$", "", example))
        words = words[words.index("kinid") + 1 :]
        assert tuple(words[: len(path)]) == path, example
        assert {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)} <= known | {"--help"}, example


@each
def test_an_option_of_one_value_is_not_given_two(path: tuple[str, ...], run: Run) -> None:
    """The last one would win without a word; options that are lists take several."""
    options = [p for p in COMMANDS[path].params if p.param_type_name == "option" and not p.is_flag and p.nargs == 1]
    assert options or path == ("doctor",)
    for option in options:
        name = max(option.opts, key=len)
        code, _, said = run(*path, name, "1", name, "2")
        assert code == 2
        assert (f"{name} given 2 times" in said) is not option.multiple
        assert "Traceback" not in said


@each
def test_the_list_of_commands_names_it_in_one_line(path: tuple[str, ...], run: Run) -> None:
    said = run(*path[:-1], "--help")[1]
    (line,) = re.findall(rf"^  {path[-1]} +(\S.*)$", said, re.MULTILINE)
    if len(path) == 1:
        assert not line.endswith("..."), "cut short"


@each
def test_a_summary_for_scripts(path: tuple[str, ...]) -> None:
    options = {option for parameter in COMMANDS[path].params for option in parameter.opts}
    assert "--json" in options


COMPLETED = [
    ("kinid di", "diagnose"),
    ("kinid plan ex", "excite"),
    ("kinid fit --mo", "--model"),
    ("kinid fit log.csv --model kel", "kelvin-voigt"),
    ("kinid compare log.csv --model hooke,stri", "hooke,stribeck-friction"),
    ("kinid diagnose log.csv --add relax", "relaxation"),
    ("kinid diagnose --explain stribeck", "stribeck-friction"),
    ("kinid plan discriminate --effects relaxation,stiffness-d", "relaxation,stiffness-drift"),
    ("kinid lab poke --hide relax", "relaxation"),
    ("kinid map logs --model kelvin-voigt,coul", "kelvin-voigt,coulomb-friction"),
    ("kinid view log.csv --model hertz,relax", "hertz,relaxation"),
    ("kinid map logs --method tri", "triangles"),
]


def test_a_model_goes_on_with_what_it_lacks() -> None:
    """One law of contact, nothing twice, all else of the catalogue; each begins with what was typed."""
    bases = {name for name, known in catalogue().items() if known.base}
    offered = [name for name, _ in complete.model("kelvin-voigt,relaxation,")]
    assert offered == [f"kelvin-voigt,relaxation,{name}" for name in sorted(set(catalogue()) - bases - {"relaxation"})]
    assert {name for name, _ in complete.model("")[: len(bases)]} == bases
    assert complete.effect("nonsense") == []


def completions(typed: str) -> list[str]:
    """What a shell offers for the last word."""
    asked = {"_KINID_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", "from kinid.cli import main; main()"],
        env=os.environ | asked,
        check=True,
        capture_output=True,
        text=True,
    )
    return [line for line in done.stdout.splitlines() if line]


@pytest.mark.parametrize(("typed", "offered"), COMPLETED)
def test_the_shell_completes(typed: str, offered: str) -> None:
    assert completions(typed) == [offered]


@pytest.mark.parametrize("command", ["view", "picture"])
def test_the_shell_completes_properties_of_the_map_that_was_typed(command: str, tmp_path: Path) -> None:
    """Such as some probe tells; without a map there are none to offer."""
    properties = (Property("stiffness", "N/m"), Property("friction", "1"), Property("damping", "N·s/m"))
    probe = Probe(np.zeros(3), np.array([500.0, 0.5, 0.0]), np.diag([1.0, 0.01, np.inf]))
    PropertyMap(Plane(np.zeros(3), np.eye(3)), properties, (probe,)).write(tmp_path / "map.parquet")
    assert completions(f"kinid {command} {tmp_path / 'map.parquet'} --property fr") == ["friction"]
    assert completions(f"kinid {command} {tmp_path / 'map.parquet'} --property dam") == []
    assert completions(f"kinid {command} {tmp_path / 'absent.parquet'} --property fr") == []


def test_the_laboratory_sums_up_for_scripts(run: Run, tmp_path: Path) -> None:
    """Files that are there, and how the motion was followed, as `kinid lab` prints it."""
    code, said, err = run("lab", "poke", "--no-mcap", "-o", tmp_path / "one", "--json", tmp_path / "one.json")
    assert code == 0, err
    facts = json.loads((tmp_path / "one.json").read_text())
    assert all(Path(facts[name]).exists() for name in ("log", "rig", "truth"))
    (poke,) = [phase for phase in facts["phases"] if phase["phase"] == "poke"]
    assert f"{1e3 * poke['depth_reached']:.2f}" in said
    assert 0.5 * poke["depth_asked"] < poke["depth_reached"] <= poke["depth_asked"] + 1e-3
    assert "hidden" not in json.dumps(facts)
    code, _, err = run("lab", "mould", "--campaign", "2x1", "-o", tmp_path / "two", "--json", tmp_path / "two.json")
    assert code == 0, err
    facts = json.loads((tmp_path / "two.json").read_text())
    assert facts["count"] == facts["made"] == len(facts["logs"]) == 2
    assert all(Path(log).is_file() for log in facts["logs"])


def test_words_in_brackets_are_printed_wherever_they_stand(capsys: pytest.CaptureFixture[str]) -> None:
    """No message, heading or cell is markup: "[sensor]" is a table of the rig, "[mm]" a unit, "log[1]" a file."""
    from rich.table import Table

    from kinid.cli.show import console, right, say

    table = Table("place [mm]", *right("[N]"), title="log[red].csv")
    table.add_row("[bold]", "[/]")
    out = console()
    out.print(table)
    out.print("add [sensor] bias")
    say(out, "or [tool]")
    said = capsys.readouterr().out
    assert all(word in said for word in ("place [mm]", "[N]", "log[red].csv", "[bold]", "[/]", "[sensor]", "[tool]"))


def test_what_is_shown_comes_from_that_console() -> None:
    """Another one would read brackets as markup; those for progress stand on the error stream, and escape."""
    own = {path.name for path in Path(kinid.__file__).parent.rglob("*.py") if " Console(" in path.read_text("utf-8")}
    assert own == {"show.py", "batch.py", "campaign.py"}


def test_a_message_repeats_no_name_beyond_measure(run, log):
    for model in ("a" * 5000, ",".join(["kelvin-voigt"] * 501)):
        code, _, err = run("fit", log, "--model", model)
        assert code == 2
        assert err.count("\n") == 1
        assert len(err) < 3000
