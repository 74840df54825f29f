"""`kinid init`: a log's columns to a commented rig.toml that runs."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from kinid.data.guess import Guess

EXAMPLES = """Examples:

kinid init poke.csv --robot ur5

kinid init poke.csv --robot my_arm.urdf -o poke-rig.toml
"""
#: robots by their number of joints, offered where none is named
USUAL = {7: "lwr4plus", 6: "ur5"}


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
    """Read a log's columns, guess names and units, ask what is missing, and write a rig.toml to go on with."""
    from kinid.data.guess import columns_of, guesses
    from kinid.data.rig import Rig
    from kinid.robotics.reading import read
    from kinid.writers import check_outputs, write_json, write_text

    target = out or log.parent / "rig.toml"
    if target.exists():
        go_on = shlex.join(["kinid", "contact", str(log), "--rig", str(target)])
        raise InputError(
            f"a rig at {target} already",
            "a name that is free: what was written into that one would be lost",
            f"go on with it: {go_on}; or name another with -o, or remove it",
        )
    check_outputs((target, json_file), (log,))
    columns = columns_of(log)
    found = guesses(columns)
    if not any(guess.quantity == "t" for guess in found):
        raise InputError(
            f"no column of {log} that is its time ({', '.join(list(columns)[:12])})",
            "one named as t or time",
            'write a rig.toml with [columns] t = { column = "…" }, or t = { rate = 500 }',
        )
    asks = sys.stdin.isatty() and sys.stdout.isatty()
    joints = sum(guess.quantity[0] == "q" for guess in found)
    if joints and robot is None:
        if not asks:
            raise InputError(f"{joints} joints in {log}, and no robot", "whose they are", "name it with --robot")
        robot = typer.prompt("robot, or the path of its URDF", default=USUAL.get(joints))
    tool = _asked_tool() if asks and any(guess.quantity == "fx" for guess in found) else None
    frames = _frames(robot, target.parent, wrench=any(guess.quantity == "fx" for guess in found))
    left = [name for name in columns if name not in {guess.column for guess in found}]
    text = rig_text(found, robot, tool, log.name, left, frames)
    rig = Rig.parse_text(text, folder=target.parent, where=str(target))
    made = read(log, rig)
    write_text(target, text)
    for guess in found:
        if guess.unit or guess.column != guess.quantity:
            typer.echo(f"{guess.quantity}: column '{guess.column}'" + (f" in {guess.unit}" if guess.unit else ""))
    typer.echo(f"{len(made)} samples over {made.t[-1] - made.t[0]:.4g} s read with it")
    if json_file is not None:
        facts = [dataclasses.asdict(guess) for guess in found]
        write_json(json_file, {"rig": str(target), "samples": len(made), "columns": facts})
    for name in frames:
        typer.echo(f"{robot} has no frame of the usual name: say in {target} which is its [robot] {name}")
    typer.echo(f"wrote {target}; look at it, then: {shlex.join(['kinid', 'contact', str(log), '--rig', str(target)])}")


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


def _frames(robot: str | None, folder: Path, *, wrench: bool) -> dict[str, str]:
    """Fields of [robot] that the rig has to state since the robot has no frame of the usual name: what there is."""
    from kinid.data.rig import RobotSpec
    from kinid.robotics.robot import Robot

    if robot is None:
        return {}
    made = Robot.from_spec(RobotSpec(model=robot), folder)
    lacks = {"sensor_frame": wrench and made.sensor_frame is None, "tip_frame": made.tip_frame is None}
    return {name: ", ".join(made.end_frames) for name, lacking in lacks.items() if lacking}


def rig_text(
    found: Sequence[Guess],
    robot: str | None,
    tool: str | None,
    name: str,
    left: Sequence[str],
    frames: Mapping[str, str],
) -> str:
    """A rig.toml with comments.

    Args:
        found: the columns. robot: name or path. tool: lines of [tool]. name: of the log. left: columns of no use.
        frames: of those that the rig has to state, what there is.
    """
    from kinid.data.guess import columns_table, quoted

    parts = [f"# what {name} was measured with; SI units, vectors in the frame named. Written by kinid init"]
    if robot is not None:
        said = {
            "sensor_frame": "the frame whose axes the wrench has, where the URDF names it otherwise",
            "tip_frame": "the contact point",
        }
        said |= {field: f"{said[field]}; at the end of the arm are {there}" for field, there in frames.items()}
        lines = [f'# {field} = "…"'.ljust(30) + f"# {words}" for field, words in said.items()]
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
