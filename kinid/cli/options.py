"""Options that several commands have, and texts of options as numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from kinid.cli import complete
from kinid.errors import InputError


def ending_in(*endings: str) -> Callable[[Path | None], Path | None]:
    """Takes the name of an output only where it says what will be in it."""

    def check(path: Path | None) -> Path | None:
        if path is not None and path.suffix.lower() not in endings and path != Path("-") and not path.is_dir():
            raise InputError(f"output '{path.name}'", f"a name ending in {' or '.join(endings)}", "rename it")
        return path

    return check


#: of an output that a browser opens
PAGE = ending_in(".html", ".htm")
LogFile = Annotated[
    Path, typer.Argument(help="The log: Parquet, CSV, NPZ, MAT, ROS 1/2 bag or MCAP.", show_default=False)
]
_LOGS = typer.Argument(
    metavar="LOG…",
    help="The log: Parquet, CSV, NPZ, MAT, ROS 1/2 bag or MCAP; or many, a folder of them, or a campaign.toml.",
    show_default=False,
)
LogFiles = Annotated[list[Path], _LOGS]
LogFilesOrNone = Annotated[list[Path] | None, _LOGS]
RigFile = Annotated[Path | None, typer.Option(help="What was measured with what; default: rig.toml beside the log.")]
ModelText = Annotated[
    str,
    typer.Option(help="Effects of the model, separated by commas.", show_default=False, autocompletion=complete.model),
]
#: of commands that take many logs of one rig, and fit a model to each touch
FirstRigFile = Annotated[
    Path | None, typer.Option(help="What was measured with what; default: rig.toml beside the first log.")
]
TouchModel = Annotated[str, typer.Option(help="Effects that are fitted to each touch.", autocompletion=complete.model)]
PlotFile = Annotated[Path | None, typer.Option(help="Plot to write: one offline HTML file.", callback=PAGE)]


def names(text: str) -> list[str]:
    """Names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def numbers(
    text: str,
    option: str,
    expected: str = "numbers separated by commas",
    *,
    counts: tuple[int, ...] = (),
    below: float | None = None,
) -> tuple[float, ...]:
    """Numbers separated by commas.

    Args:
        text: as typed. option, expected: for the message. counts: how many there may be; any, where it is empty.
        below: what their sizes have to stay below.

    Raises:
        InputError: something else.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    refused = below is not None and not all(abs(value) < below for value in values)
    if not values or (counts and len(values) not in counts) or refused:
        raise InputError(f"{option} {text}", expected, "correct it")
    return values


def grid(text: str, option: str) -> tuple[int, int]:
    """Rows and columns, as 10x10.

    Raises:
        InputError: something else.
    """
    parts = [part.strip() for part in text.lower().replace("×", "x").split("x")]
    if len(parts) != 2 or not all(part.isdecimal() and len(part) < 10 and int(part) > 0 for part in parts):
        raise InputError(f"{option} {text}", "rows x columns, as 10x10", "correct it")
    return int(parts[0]), int(parts[1])


def check_method(method: str) -> None:
    """Refuse a way to interpolate between probes that there isn't.

    Raises:
        InputError: which there are.
    """
    from kinid.mapping.interpolation import METHODS

    if method not in METHODS:
        raise InputError(f"--method {method}", f"one of {', '.join(METHODS)}", "choose one of them")
