"""A job done for many logs: what is there already is left alone, what can't be done is put aside and named."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

import kinid
from kinid.batch.jobs import Job, parquet, work
from kinid.batch.logs import Item
from kinid.batch.pooled import OWN
from kinid.batch.runners import Lost, Runner
from kinid.batch.store import Store
from kinid.errors import InputError
from kinid.writers import Json, json_text

#: called with how many logs are done or put aside, of how many, and the last one's name
Progress = Callable[[int, int, str], None]
#: what a store says of itself
MANIFEST, TABLE = "manifest.json", "manifest.parquet"


@dataclass(frozen=True)
class Outcome:
    """What became of the logs.

    Attributes:
        done: size of each log's table in the store [bytes]. before: how many of them were there before. aside: name →
            why. doubts: name → what speaks against a log that was worked at now.
    """

    done: dict[str, int]
    before: int
    aside: dict[str, str]
    doubts: dict[str, tuple[str, ...]] = field(default_factory=dict)


def run(job: Job, items: Sequence[Item], store: Store, runner: Runner, progress: Progress = lambda *_: None) -> Outcome:
    """Do a job for every log that the store doesn't hold it of yet.

    Args:
        job, items: what, of which logs. store: where results go. runner: who does it. progress: called at each log.

    Raises:
        InputError: a store of another job, or one that workers in other processes can't see.
    """
    claim(job.to_dict(), store, runner)
    files = store.files(job.kind)
    parts = {item.name: item.part(job.kind).removeprefix(f"{job.kind}/") for item in items}
    sweep(job.kind, items, store, files)
    if job.kind == "fit":
        sweep(OWN, items, store, store.files(OWN), "npz")
    todo = [item for item in items if parts[item.name] not in files]
    done, aside, doubts = {}, dict[str, str](), dict[str, tuple[str, ...]]()
    for count, (place, result) in enumerate(
        runner.run(partial(work, job, store), todo), start=len(items) - len(todo) + 1
    ):
        name = todo[place].name
        if isinstance(result, Lost):
            aside[name] = result.why
        else:
            done[name] = result.size
            if result.doubts:
                doubts[name] = result.doubts
        progress(count, len(items), name)
    for item in items:
        if parts[item.name] in files:
            done[item.name] = int(files[parts[item.name]]["size"])
    sizes = {item.name: done[item.name] for item in items if item.name in done}
    whole = Outcome(sizes, len(items) - len(todo), aside, doubts)
    _write_manifest(job, items, store, whole)
    return whole


def claim(job: Json, store: Store, runner: Runner, also: Sequence[Json] = ()) -> None:
    """Make a store that of a job, or see that it is, or that of another one whose results serve it, too.

    Raises:
        InputError: it is another's, or lies in this process' memory where others work.
    """
    if runner.apart and store.address.startswith("memory://"):
        raise InputError(
            f"{store.address} for workers in other processes", "a folder that they see", "use --on serial, or a folder"
        )
    data = store.found(MANIFEST)
    if data is None:
        if store.files():
            raise InputError(
                f"files in {store.address}, and no {MANIFEST}",
                "an empty folder, or one to go on with",
                "name another -o",
            )
        store.write(MANIFEST, _text({"job": job, "kinid": kinid.__version__}))
        return
    try:
        before = json.loads(data)["job"]
    except (ValueError, KeyError, TypeError, RecursionError):
        before = f"no {MANIFEST} of kinid"
    if before != job and before not in also:
        raise InputError(
            f"{store.address}, which holds {before}", f"an empty folder, or one of {job}", "name another -o"
        )


def sweep(kind: str, items: Sequence[Item], store: Store, files: Iterable[str], suffix: str = "parquet") -> None:
    """Take away tables of logs that have changed since: a log's own name ends its key."""
    there: dict[str, list[str]] = {}
    for name in files:
        there.setdefault(name.rpartition(".")[0].rpartition("-")[2], []).append(f"{kind}/{name}")
    for item in items:
        for name in there.get(item.key.rpartition("-")[2], []):
            if name != item.part(kind, suffix):
                store.remove(name)


def _write_manifest(job: Job, items: Sequence[Item], store: Store, outcome: Outcome) -> None:
    """What the store holds, as a table with a row a log, and in short."""
    columns = {
        "log": np.array([item.name for item in items]),
        "address": np.array([item.address for item in items]),
        "part": np.array([item.part(job.kind) if item.name in outcome.done else "" for item in items]),
        "bytes": np.array([outcome.done.get(item.name, 0) for item in items]),
        "put_aside": np.array([outcome.aside.get(item.name, "") for item in items]),
    }
    store.write(TABLE, parquet(columns, {"job": job.to_dict()}))
    facts = {
        "job": job.to_dict(),
        "kinid": kinid.__version__,
        "logs": len(items),
        "done": len(outcome.done),
        "put_aside": outcome.aside,
    }
    store.write(MANIFEST, _text(facts))


def _text(facts: Json) -> bytes:
    return (json_text(facts, indent=2) + "\n").encode()
