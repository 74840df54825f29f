"""`kinid watch`: logs taken in as they appear in a folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from kinid.cli.batch import On, Workers
from kinid.cli.options import ModelText, RigFile
from kinid.errors import InputError

EXAMPLES = """Examples:

kinid watch recordings --model kelvin-voigt,coulomb-friction

kinid watch s3://lab/today --model hunt-crossley -o today --on processes --workers 2

kinid watch recordings --model kelvin-voigt --idle 10
"""


def watch(
    folder: Annotated[Path, typer.Argument(help="Where logs appear: a folder, or an address as s3://lab/today.")],
    model: ModelText,
    rig: RigFile = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="Folder of tables and of the page; default: .kinid in the folder.", show_default=False
        ),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Fits of all logs, odd ones and why, written anew as logs come.")
    ] = None,
    every: Annotated[float, typer.Option(help="Look for new logs so often [s].")] = 2.0,
    idle: Annotated[
        float | None, typer.Option(help="End when none has come for so long [s]; default: never.", show_default=False)
    ] = None,
    on: On = None,
    workers: Workers = None,
) -> None:
    """Each new log's contact frame and fit, whether it is odd among its fellows, and a page of all; until Ctrl-C.

    Started again it goes on, also where it was killed.
    """
    if not 0.05 <= every <= 1e5 or (idle is not None and not 0 <= idle <= 1e9):
        raise InputError(f"--every {every}, --idle {idle}", "seconds, 0.05 or more", "correct it")
    from kinid.batch.store import Store, address_of, is_remote
    from kinid.batch.watch import PAGE, SETTLED, Watch
    from kinid.cli.batch import refuse_inside, running
    from kinid.cli.fit import parse_model
    from kinid.writers import check_outputs, write_json

    check_outputs((json_file,), ())
    chosen = parse_model(model)
    if not is_remote(folder) and not folder.is_dir():
        raise InputError(f"no folder {folder}", "a folder in which logs appear", "make it first, or correct the name")
    if out is None and is_remote(folder):
        raise InputError(f"{folder} without -o", "a folder for tables and page", "name one with -o")
    out = out or folder / ".kinid"
    refuse_inside(out, [folder])
    where = None if rig is None else address_of(rig)
    with running(on, workers) as runner:
        store = Store(address_of(out))
        made = Watch(address_of(folder), where, chosen.names, store, runner, _say)
        before = made.begin()
        typer.echo(f"watching {address_of(folder)}, {before} logs known; page {store.address}/{PAGE}")
        last, fresh = time.monotonic(), True
        while True:
            if made.look() or fresh:
                last, fresh = time.monotonic(), False
                if json_file is not None:
                    write_json(json_file, made.to_dict())
            if idle is not None and time.monotonic() - last >= max(idle, SETTLED + every):
                return
            time.sleep(every)


def _say(name: str, says: str) -> None:
    import sys

    typer.echo(f"{name}: {says}")
    sys.stdout.flush()
