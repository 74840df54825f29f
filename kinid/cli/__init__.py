"""The command line: thin over the library. One module a command; each loads its libraries when it runs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

import kinid
from kinid.cli import (
    changes,
    compare,
    contact,
    demo,
    diagnose,
    doctor,
    effect,
    fit,
    init,
    lab,
    live,
    picture,
    plan,
    shape,
    view,
    watch,
)
from kinid.cli import map as map_command
from kinid.cli.advice import EFFECTS
from kinid.cli.ending import ended
from kinid.cli.once import Once
from kinid.errors import InputError

app = typer.Typer(
    name="kinid",
    help="From raw robot logs to contact-frame quantities, and to the physical effect that a model lacks.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"kinid {kinid.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
    effects: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER", help="Effects of your own, one a file; may stand behind the command, and more than once."
        ),
    ] = None,
) -> None:
    if effects:  # processes that are begun inherit it
        os.environ[EFFECTS] = os.pathsep.join([str(folder.absolute()) for folder in effects])
        if "kinid.effects" in sys.modules:  # a program that calls this one may have read the catalogue before
            sys.modules["kinid.effects"].catalogue.cache_clear()


#: each command with the line that the list of commands shows of it
for name, function, examples, short in (
    ("demo", demo.demo, demo.EXAMPLES, "See it all: a virtual arm finds out what its model lacks."),
    ("doctor", doctor.doctor, doctor.EXAMPLES, "Is everything here that kinid needs?"),
    ("init", init.init, init.EXAMPLES, "A log's columns to a rig.toml."),
    ("contact", contact.contact, contact.EXAMPLES, "Raw log to contact-frame quantities."),
    ("fit", fit.fit, fit.EXAMPLES, "Parameters of a model, with intervals."),
    ("compare", compare.compare, compare.EXAMPLES, "Models side by side on samples held out."),
    ("diagnose", diagnose.diagnose, diagnose.EXAMPLES, "Where a model fails, and what it lacks."),
    ("lab", lab.lab, lab.EXAMPLES, "Virtual experiments whose truth is known."),
    ("watch", watch.watch, watch.EXAMPLES, "Logs taken in as they appear in a folder."),
    ("live", live.live, live.EXAMPLES, "A robot's stream as it comes: contact frame, estimates, events."),
    ("changes", changes.changes, changes.EXAMPLES, "Borders and jumps along slides."),
    ("map", map_command.map_, map_command.EXAMPLES, "Touches to a map of properties."),
    ("shape", shape.shape, shape.EXAMPLES, "Touches of an unknown surface to its mesh."),
    ("picture", picture.picture, picture.EXAMPLES, "What a picture says of a mapped property."),
    ("view", view.view, view.EXAMPLES, "A log or a map in three dimensions."),
):
    app.command(name, epilog=examples, short_help=short)(function)
app.add_typer(plan.app, name="plan", short_help="Trajectories the robot can run.")
app.add_typer(effect.app, name="effect", short_help="An effect of your own, in one file.")
for command in (*app.registered_commands, *plan.app.registered_commands, *effect.app.registered_commands):
    command.cls = Once
    lines = [line.strip() for line in (command.epilog or "").splitlines() if line.strip()]
    # "\b": each example stays on its line, to be copied
    command.epilog = "\b\n" + "\n".join([*lines[:1], *(f"  {line}" for line in lines[1:])])


def _folders_first(words: list[str]) -> list[str]:
    """Command-line words, folders of effects before the command: `plan discriminate` has names of effects under that
    option.

    Raises:
        InputError: the option without a folder.
    """
    first: list[str] = []
    rest: list[str] = []
    i = 0
    while i < len(words) and words[i] != "--":
        option, equals, value = words[i].partition("=")
        value = value if equals else "".join(words[i + 1 : i + 2])
        names = "discriminate" in rest and not (os.sep in value or os.path.isdir(value))
        if option == "--effects" and not names:
            if not value or (value.startswith("-") and not equals):
                raise InputError("--effects without a folder", "a folder of effects, one a file", "name it behind it")
            first += [option, value]
            i += 1 if equals else 2
        else:
            rest.append(words[i])
            i += 1
    return first + rest + words[i:]


def _check_threads() -> None:
    """Refuse a number of threads that the compiler of the kernels would stumble over when it is loaded.

    Raises:
        InputError: no whole number of 1 or more.
    """
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not (threads.isascii() and threads.isdecimal() and int(threads) > 0):
        raise InputError(f"NUMBA_NUM_THREADS={threads[:40]} in the environment", "a number, 1 or more", "take it out")


def main() -> None:
    """Run the command line; whatever goes wrong ends in one line on stderr and an exit code that says which way."""
    words = sys.argv[1:]

    def command() -> int | None:
        _check_threads()
        code: int | None = app(_folders_first(words), prog_name="kinid", standalone_mode=False)
        return code

    sys.exit(ended(command, words, kinid.__version__))
