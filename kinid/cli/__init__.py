"""The command line: thin over the library. One module a command; each loads its libraries when it runs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

import kinid
from kinid.cli import changes, compare, contact, demo, diagnose, doctor, fit, lab, picture, plan, view
from kinid.cli import map as map_command
from kinid.cli.once import Once
from kinid.errors import KinidError

#: names folders of effects, as kinid.effects reads it
VARIABLE = "KINID_EFFECTS"
#: exit code of a command that the user stopped
STOPPED = 130

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
        os.environ[VARIABLE] = os.pathsep.join([str(folder.absolute()) for folder in effects])


#: each command with the line that the list of commands shows of it
for name, function, examples, short in (
    ("demo", demo.demo, demo.EXAMPLES, "See it all: a virtual arm finds out what its model lacks."),
    ("doctor", doctor.doctor, doctor.EXAMPLES, "Is everything here that kinid needs?"),
    ("contact", contact.contact, contact.EXAMPLES, "Raw log to contact-frame quantities."),
    ("fit", fit.fit, fit.EXAMPLES, "Parameters of a model, with intervals."),
    ("compare", compare.compare, compare.EXAMPLES, "Models side by side on samples held out."),
    ("diagnose", diagnose.diagnose, diagnose.EXAMPLES, "Where a model fails, and what it lacks."),
    ("lab", lab.lab, lab.EXAMPLES, "Virtual experiments whose truth is known."),
    ("changes", changes.changes, changes.EXAMPLES, "Borders and jumps along slides."),
    ("map", map_command.map_, map_command.EXAMPLES, "Touches to a map of properties."),
    ("picture", picture.picture, picture.EXAMPLES, "What a picture says of a mapped property."),
    ("view", view.view, view.EXAMPLES, "A log or a map in three dimensions."),
):
    app.command(name, epilog=examples, short_help=short)(function)
app.add_typer(plan.app, name="plan", short_help="Trajectories the robot can run.")
for command in (*app.registered_commands, *plan.app.registered_commands):
    command.cls = Once
    lines = [line.strip() for line in (command.epilog or "").splitlines() if line.strip()]
    # "\b": each example stays on its line, to be copied
    command.epilog = "\b\n" + "\n".join([*lines[:1], *(f"  {line}" for line in lines[1:])])


def _folders_first(words: list[str]) -> list[str]:
    """Command-line words, folders of effects before the command: `plan discriminate` has names of effects under that
    option.
    """
    first: list[str] = []
    rest: list[str] = []
    i = 0
    while i < len(words):
        option, equals, value = words[i].partition("=")
        value = value if equals else "".join(words[i + 1 : i + 2])
        if option == "--effects" and (os.sep in value or Path(value).is_dir()):
            first += [option, value]
            i += 1 if equals else 2
        else:
            rest.append(words[i])
            i += 1
    return first + rest


def main() -> None:
    """Run the command line; bad input ends in one line on stderr and exit code 2."""
    try:
        code = app(_folders_first(sys.argv[1:]), prog_name="kinid", standalone_mode=False)
    except KinidError as error:
        _say(str(error))
        code = 2
    except (KeyboardInterrupt, typer.Abort):
        code = STOPPED
    except BrokenPipeError:  # the reader of a pipe has gone: nobody is left to tell
        sys.stderr.close()
        code = 0
    except Exception as error:
        # wrong use of options, whichever command-line library typer carries: it knows its message and its exit code
        if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
            raise
        context = getattr(error, "ctx", None)
        if type(error).__name__ == "NoArgsIsHelpError" and context is not None:
            print(context.get_help(), file=sys.stderr)
            sys.exit(2)
        where = f"{context.command_path} --help" if context is not None else "kinid --help"
        _say(f"{error.format_message()} See '{where}'.")
        code = 2
    if code == STOPPED:
        _say("stopped; nothing was left half-written")
    sys.exit(code)


def _say(message: str) -> None:
    print(f"kinid: {' '.join(message.split())}", file=sys.stderr)
