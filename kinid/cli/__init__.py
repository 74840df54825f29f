"""The command line: thin over the library. One module a command; each loads its libraries when it runs."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

import kinid
from kinid.cli import compare, contact, demo, diagnose, fit, lab, plan, view
from kinid.cli import map as map_command
from kinid.errors import KinidError

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
) -> None:
    pass


app.command("contact", epilog=contact.EXAMPLES)(contact.contact)
app.command("fit", epilog=fit.EXAMPLES)(fit.fit)
app.command("compare", epilog=compare.EXAMPLES)(compare.compare)
app.command("diagnose", epilog=diagnose.EXAMPLES)(diagnose.diagnose)
app.add_typer(plan.app, name="plan")
app.command("lab", epilog=lab.EXAMPLES)(lab.lab)
app.command("map", epilog=map_command.EXAMPLES)(map_command.map_)
app.command("view", epilog=view.EXAMPLES)(view.view)
app.command("demo", epilog=demo.EXAMPLES)(demo.demo)


def main() -> None:
    """Run the command line; bad input ends in one line on stderr and exit code 2."""
    try:
        code = app(standalone_mode=False)
    except KinidError as error:
        _say(str(error))
        code = 2
    except (KeyboardInterrupt, typer.Abort):
        _say("stopped; nothing was left half-written")
        code = 130
    except BrokenPipeError:  # the reader of a pipe has gone: nobody is left to tell
        sys.stderr.close()
        code = 0
    except Exception as error:
        # wrong use of options, whichever command-line library typer carries: it knows its message and its exit code
        if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
            raise
        context = getattr(error, "ctx", None)
        where = f"{context.command_path} --help" if context is not None else "kinid --help"
        _say(f"{error.format_message()} See '{where}'.")
        code = 2
    sys.exit(code)


def _say(message: str) -> None:
    print(f"kinid: {' '.join(message.split())}", file=sys.stderr)
