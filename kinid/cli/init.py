"""`kinid init`: a log's columns to a commented rig.toml that runs."""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from kinid.data.guess import Guess
    from kinid.robotics.robot import Robot

EXAMPLES = """Examples:

kinid init poke.csv --robot ur5

kinid init poke.csv --robot my_arm.urdf -o poke-rig.toml
"""
#: robots by their number of joints, offered where none is named
USUAL = {7: "lwr4plus", 6: "ur5"}
#: where a line stands that a log can't be read without
COLUMNS = "[columns] "


def init(
    log: Annotated[Path, typer.Argument(help="A table with named columns: CSV, Parquet or NPZ.", show_default=False)],
    robot: Annotated[
        str | None, typer.Option(help="A robot's name, or the path of its URDF; asked for on a terminal.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The rig to write; default: rig.toml beside the log.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="What columns were taken for, as JSON.")] = None,
) -> None:
    """Read a log's columns, guess names and units, ask what is missing, and write a rig.toml to go on with; what
    stays open stands in it as lines to fill in.
    """
    from kinid.data.guess import columns_of, guesses
    from kinid.data.rig import CONTACT, Rig
    from kinid.robotics.reading import read
    from kinid.writers import check_outputs, write_json, write_text

    target = out or log.parent / "rig.toml"
    go_on = shlex.join(["kinid", "contact", str(log), "--rig", str(target)])
    if target.exists():
        raise InputError(
            f"a rig at {target} already",
            "a name that is free: what was written into that one would be lost",
            f"go on with it: {go_on}; or name another with -o, or remove it",
        )
    check_outputs((target, json_file), (log,))
    columns = columns_of(log)
    asks = sys.stdin.isatty() and sys.stdout.isatty()
    if robot is None and asks:
        usual = USUAL.get(sum(guess.quantity[0] == "q" for guess in guesses(columns)), "")
        robot = typer.prompt("robot, or the path of its URDF; empty if there is none", default=usual) or None
    robot, arm = _robot(robot, target.parent)
    found = guesses(columns, () if arm is None else arm.joint_names)
    wrench = any(guess.quantity == "fx" for guess in found)
    tool = _asked_tool() if asks and wrench else None
    frames = {} if arm is None else _frames(arm, wrench=wrench)
    stated = _asked_frames(frames) if asks else {}
    used = {guess.column for guess in found}
    left = [name for name in columns if name not in used | {*CONTACT, "phase"}]
    to_fill = _open(found, columns, arm, {name: there for name, there in frames.items() if name not in stated})
    text = rig_text(found, robot, tool, log.name, left, frames, stated, to_fill)
    rig = Rig.parse_text(text, folder=target.parent, where=str(target))
    # with a time and a quantity a log can be read, and what is the matter with it is said before anything is written
    made = None if any(line.startswith(COLUMNS) for line in to_fill) else read(log, rig)
    write_text(target, text)
    for guess in found:
        if guess.unit or guess.column != guess.quantity:
            typer.echo(f"{guess.quantity}: column '{guess.column}'" + (f" in {guess.unit}" if guess.unit else ""))
    if made is not None:
        typer.echo(f"{len(made)} samples over {made.t[-1] - made.t[0]:.4g} s read with it")
    if json_file is not None:
        facts = [dataclasses.asdict(guess) for guess in found]
        samples = None if made is None else len(made)
        write_json(json_file, {"rig": str(target), "samples": samples, "columns": facts, "to_fill_in": to_fill})
    for line in to_fill:
        typer.echo(f"to fill in: {line}")
    typer.echo(f"wrote {target}; {'fill those in' if to_fill else 'look at it'}, then: {go_on}")


def _robot(robot: str | None, folder: Path) -> tuple[str | None, Robot | None]:
    """The robot's name, or its URDF's path as the rig in this folder names it, and the robot."""
    from kinid.data.rig import RobotSpec
    from kinid.robotics.robot import Robot

    if robot is None:
        return None, None
    if Path(robot).is_file() and not (folder / robot).is_file():  # typed where one stands, which is elsewhere
        robot = os.path.relpath(robot, folder)
    return robot, Robot.from_spec(RobotSpec(model=robot), folder)


def _asked_frames(frames: Mapping[str, str]) -> dict[str, str]:
    """Those fields of [robot] that a user knows, of these with what there is."""
    named = {
        name: typer.prompt(f"[robot] {name}, of {there}; empty if unknown", default="")
        for name, there in frames.items()
    }
    return {name: frame for name, frame in named.items() if frame}


def _open(
    found: Sequence[Guess], columns: Mapping[str, object], arm: Robot | None, frames: Mapping[str, str]
) -> list[str]:
    """Lines of the rig that nobody but the user can fill in, with what there is to choose from."""
    from kinid.data.rig import CONTACT, WRENCH

    known = {guess.quantity for guess in found}
    left = [repr(name) for name in columns if name not in {guess.column for guess in found}]
    free = f"; there are {', '.join(left)}" if left else ""
    lines = []
    if "t" not in known:
        lines.append(f'{COLUMNS}t = {{ column = "…", unit = "s" }}, or t = {{ rate = 500 }} [Hz]{free}')
    if not known - {"t"} and not {*CONTACT} & columns.keys():
        lines.append(f"{COLUMNS}q = {{ columns = […] }}, wrench = {{ columns = […] }} or depth{free}")
    elif known & {*WRENCH} and not {*WRENCH} <= known:
        lacking = " ".join(name for name in WRENCH if name not in known)
        lines.append(f"{COLUMNS}{lacking}, which a wrench has, too{free}")
    elif arm is not None and {name for name in known if re.fullmatch(r"q\d+", name)} != {
        f"q{j + 1}" for j in range(arm.joint_count)
    }:
        joints = ", ".join(arm.joint_names)
        lines.append(f"q = {{ columns = […] }} in [columns], one for each of {joints}{free}")
    if arm is None and not {*CONTACT} & columns.keys():
        lines.append('[robot] model = "…", a name as lwr4plus or ur5, or the path of a URDF; or name it with --robot')
    lines += [f"[robot] {name}: one of {there}" for name, there in frames.items()]
    return lines


def _asked_tool() -> str | None:
    """The tool, as a user knows it."""
    mass = typer.prompt("mass of the tool beyond the sensor [kg], empty if unknown", default="", show_default=False)
    if not str(mass).strip():
        return None
    com = typer.prompt("its centre of mass in the sensor frame, x,y,z [m]", default="0,0,0.05")
    try:
        numbers = [float(part) for part in str(com).split(",")]
        return f"mass = {float(mass)}\ncom = {numbers}"
    except ValueError:
        raise InputError(
            f"a tool of '{mass}' kg at '{com}'", "numbers, as 0.24 and 0,0,0.049", "run it again"
        ) from None


def _frames(arm: Robot, *, wrench: bool) -> dict[str, str]:
    """Fields of [robot] that the rig has to state since the robot has no frame of the usual name: what there is."""
    lacks = {"sensor_frame": wrench and arm.sensor_frame is None, "tip_frame": arm.tip_frame is None}
    return {name: ", ".join(arm.end_frames) for name, lacking in lacks.items() if lacking}


def rig_text(
    found: Sequence[Guess],
    robot: str | None,
    tool: str | None,
    name: str,
    left: Sequence[str],
    frames: Mapping[str, str],
    stated: Mapping[str, str],
    to_fill: Sequence[str],
) -> str:
    """A rig.toml with comments.

    Args:
        found: the columns. robot: name or path. tool: lines of [tool]. name: of the log. left: columns of no use.
        frames: of those that the rig has to state, what there is. stated: those that the user named.
        to_fill: lines that are left to the user.
    """
    from kinid.data.guess import columns_table, quoted

    parts = [f"# what {name} was measured with; SI units, vectors in the frame named. Written by kinid init"]
    parts += ["\n".join(f"# to fill in: {line}" for line in to_fill)] if to_fill else []
    if robot is not None:
        said = {
            "sensor_frame": "the frame whose axes the wrench has, where the URDF names it otherwise",
            "tip_frame": "the contact point",
        }
        said |= {field: f"{said[field]}; at the end of the arm are {there}" for field, there in frames.items()}
        lines = [
            (f"{field} = {quoted(stated[field])}" if field in stated else f'# {field} = "…"').ljust(30) + f"# {words}"
            for field, words in said.items()
        ]
        parts.append("\n".join([f"[robot]\nmodel = {quoted(robot)}", *lines]))
    if tool is not None:
        parts.append(f"[tool]                        # everything beyond the sensor's measuring plane\n{tool}")
    elif any(guess.quantity == "fx" for guess in found):
        parts.append(
            "# [tool]                      # everything beyond the sensor's measuring plane: weigh it\n"
            "# mass = 0.24                 # kg\n# com = [0.0, 0.0, 0.049]     # m, in the sensor frame"
        )
    parts.append(
        "# [surface]                   # for depth and slip; kinid contact LOG --find-surface finds it from touches\n"
        "# point = [0.55, 0.0, 0.10]   # m, in the base frame\n# normal = [0, 0, 1]          # out of the material"
    )
    table = columns_table(found)
    if table:
        parts.append(f"[columns]\n{table}")
    if left:
        parts.append("# not read: " + ", ".join(repr(column) for column in left[:20]))
    return "\n\n".join(parts) + "\n"
