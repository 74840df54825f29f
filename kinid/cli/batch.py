"""`--on`: many logs, one after the other, in processes, or on a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.batch.jobs import Job
    from kinid.batch.run import Outcome, Progress
    from kinid.batch.runners import Runner
    from kinid.campaign import Campaign
    from kinid.modeling.model import Model

On = Annotated[
    str | None,
    typer.Option(
        "--on",
        help="Who works at many logs: serial, processes, dask (a cluster on this machine), or the address of a "
        "scheduler of dask, as tcp://10.0.0.1:8786.",
        show_default=False,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        help="So many workers, processes unless --on says otherwise; default: as many as there are cores.",
        show_default=False,
    ),
]
Each = Annotated[
    bool, typer.Option("--each", help="Each log by itself, a row of a table each, into the folder -o; not one model.")
]
#: logs put aside that are named on the screen; all of them stand in the manifest
MOST_NAMED = 20


@contextmanager
def running(on: str | None, workers: int | None) -> Iterator[Runner]:
    """A runner, its dashboard's address told."""
    from kinid.batch.runners import runner

    default = "serial" if workers is None else "processes"
    with runner(default if on is None else on, workers) as made:
        if made.dashboard:
            typer.echo(f"{made.workers} workers; dashboard at {made.dashboard}", err=True)
        yield made


@contextmanager
def counted(words: str) -> Iterator[Progress]:
    """How many logs are done, on the terminal's error stream."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    out = Console(stderr=True)
    if not out.is_terminal:
        yield lambda *_: None
        return
    columns = (
        TextColumn(words, markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[log]}", markup=False),
    )
    with Progress(*columns, console=out) as bar:
        task = bar.add_task(words, total=None, log="")
        yield lambda done, total, name: bar.update(task, completed=done, total=total, log=name)


def each_log(
    job: Job,
    logs: Sequence[Path],
    rig: Path | None,
    out: Path | None,
    on: str | None,
    workers: int | None,
    json_file: Path | None = None,
) -> None:
    """A job done for each log, into a folder; what was done is told."""
    from kinid.batch.logs import items_of
    from kinid.batch.run import run
    from kinid.batch.store import Store, address_of
    from kinid.cli.show import written
    from kinid.writers import check_outputs, write_json

    if out is None:
        found = "many logs without -o" if on is None and workers is None else "--on or --workers without -o"
        raise InputError(found, "a folder for the tables of many logs", "name one with -o")
    check_outputs((json_file,), ())
    if out.is_file():
        raise InputError(f"a file at {out}", "a folder for the tables of many logs", "name another -o")
    refuse_inside(out, logs)
    items, _ = items_of(logs, rig)
    with running(on, workers) as runner, counted(job.kind) as progress:
        outcome = run(job, items, Store(address_of(out)), runner, progress)
    if json_file is not None:
        facts = {"done": outcome.done, "before": outcome.before, "put_aside": outcome.aside, "doubts": outcome.doubts}
        write_json(json_file, facts)
    show_outcome(outcome)
    if outcome.aside and not outcome.done:
        raise InputError(
            f"{len(outcome.aside)} logs, none of which could be used ({next(iter(outcome.aside.values()))})",
            "one at least",
            "mend what is said of each, and start it again",
        )
    written([path for path in (json_file, out) if path is not None])


def refuse_inside(out: Path, logs: Sequence[Path]) -> None:
    """Refuse a folder of results where logs are looked for: its tables would be taken for logs."""
    from kinid.batch.store import is_remote

    for log in logs:
        if not is_remote(log) and not is_remote(out) and log.is_dir() and out.resolve().is_relative_to(log.resolve()):
            if any(part.startswith(".") for part in out.resolve().relative_to(log.resolve()).parts):
                continue  # hidden ones aren't looked into
            raise InputError(f"-o {out} inside of {log}", "a folder beside the logs", "name another -o")


def show_outcome(outcome: Outcome) -> None:
    """How many logs are done, and which were put aside."""
    before = f", {outcome.before} of them before" if outcome.before else ""
    typer.echo(f"{len(outcome.done)} logs done{before}; {len(outcome.aside)} put aside")
    for name, why in list(outcome.aside.items())[:MOST_NAMED]:
        typer.echo(f"put aside: {name}: {why}")
    if len(outcome.aside) > MOST_NAMED:
        typer.echo(f"and {len(outcome.aside) - MOST_NAMED} more, in the manifest")
    for name, says in list(outcome.doubts.items())[:MOST_NAMED]:
        more = f" (and {len(says) - 1} more)" if len(says) > 1 else ""
        typer.echo(f"doubt: {name}: {says[0]}{more}")
    if len(outcome.doubts) > MOST_NAMED:
        typer.echo(f"and {len(outcome.doubts) - MOST_NAMED} more logs with doubts, in their tables")


@contextmanager
def campaign_on(
    logs: Sequence[Path], rig: Path | None, out: Path | None, on: str | None, workers: int | None, model: Model
) -> Iterator[Campaign]:
    """A campaign whose logs a runner works at; in the folder `out` each log's own fit is kept, to go on with."""
    from kinid.batch.jobs import Job
    from kinid.batch.logs import campaign_of, items_of
    from kinid.batch.pooled import ByRunner, shelf_for
    from kinid.batch.run import claim
    from kinid.batch.store import Store, address_of

    if out is not None:
        refuse_inside(out, logs)
    items, sharing = items_of(logs, rig)
    with running(on, workers) as runner:
        store = None
        if out is not None:
            store = Store(address_of(out))
            each = Job("fit", model.names).to_dict()
            claim({"kind": "pooled", "model": list(model.names)}, store, runner, also=(each,))
        with shelf_for(runner, store) as shelf:
            yield campaign_of(items, sharing, ByRunner.of(runner, store, items, shelf))
