"""What is worked out of each log by itself: a table, and with it what stands in the JSON of a single log."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kinid.batch.logs import Item
from kinid.batch.pooled import OWN, packed
from kinid.batch.store import Store
from kinid.contact.analysis import analyse
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.identification.fit import fit_model
from kinid.identification.fitted import FittedParameter
from kinid.identification.pooling.pool import Alone
from kinid.memory import give_back
from kinid.modeling.model import Model
from kinid.writers import Column, Json, json_text


class Made(NamedTuple):
    """Columns of a table, one or more rows; facts that go along with it; and of a fit, where it ended, as bytes that a
    pooled fit begins from.
    """

    columns: dict[str, Column]
    facts: Json
    end: bytes = b""


@dataclass(frozen=True)
class Job:
    """What is done with each log.

    Attributes:
        kind: one of `KINDS`. model: names of its effects, where one is fitted. max_effects: of a diagnosis.
    """

    kind: str
    model: tuple[str, ...] = ()
    max_effects: int = 8

    def to_dict(self) -> Json:
        """For JSON."""
        return {"kind": self.kind, "model": list(self.model), "max_effects": self.max_effects}


class Done(NamedTuple):
    """What a worker tells of a log: the size of its table [bytes], and what speaks against it."""

    size: int
    doubts: tuple[str, ...]


def work(job: Job, store: Store, item: Item) -> Done:
    """Read a log, work out its table, and put that into the store: all that a worker does.

    Raises:
        InputError: a log that can't be read, or can't carry the model.
    """
    try:
        made = KINDS[job.kind](job, *item(), item)
        if made.end:
            store.write(item.part(OWN, "npz"), made.end)
        return _put(job, store, item, made)
    finally:
        give_back()  # or a worker grows from log to log


def take_in(jobs: Sequence[Job], store: Store, item: Item) -> None:
    """The same of several jobs; the log is read once.

    Raises:
        InputError: as of `work`.
    """
    log, rig = item()
    for job in jobs:
        _put(job, store, item, KINDS[job.kind](job, log, rig, item))
    give_back()


def _put(job: Job, store: Store, item: Item, made: Made) -> Done:
    data = parquet(made.columns, made.facts)
    store.write(item.part(job.kind), data)
    return Done(len(data), tuple(made.facts["doubts"]))


def parquet(columns: dict[str, Column], facts: Json) -> bytes:
    """A table as a Parquet file; the facts are JSON under the key `kinid` of its schema's metadata."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    table = pa.table({name: pa.array(np.asarray(values)) for name, values in columns.items()})
    text = json_text(facts)
    out = io.BytesIO()
    names = [name for name, values in columns.items() if np.asarray(values).dtype.kind in "US"]
    pq.write_table(table.replace_schema_metadata({"kinid": text}), out, use_dictionary=names, write_statistics=False)
    return out.getvalue()


def unparquet(data: bytes) -> tuple[Any, Json]:
    """The table and the facts of such a file.

    Raises:
        InputError: it is none.
    """
    import pyarrow as pa
    from pyarrow import parquet as pq

    try:
        table = pq.ParquetFile(io.BytesIO(data)).read(use_threads=False)
        return table, json.loads(table.schema.metadata[b"kinid"])
    except (pa.ArrowInvalid, OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"a file that kinid has not written ({str(error)[:80]})", "its own Parquet", "choose another -o"
        ) from None


def _contact(job: Job, log: Log, rig: Rig, item: Item) -> Made:
    result = analyse(log, rig)
    facts: Json = {"name": item.name, "provenance": result.provenance.to_dict()}
    return Made(dict(result.columns()), facts | {"doubts": list(result.provenance.warnings)})


def _fit(job: Job, log: Log, rig: Rig, item: Item) -> Made:
    fit = fit_model(Model(*job.model), log, rig)
    facts = fit.to_dict()
    columns: Json = {"log": item.name, **item.columns}
    columns |= _numbers(fit.parameters) | _flat("error", facts["error"])
    columns |= {"excess": fit.left.excess, "warnings": "\n".join(fit.warnings)}
    facts = {"name": item.name, "fit": facts, "doubts": list(fit.warnings)}
    return Made(_row(columns), facts, packed(Alone.of(fit.state)))


def _diagnose(job: Job, log: Log, rig: Rig, item: Item) -> Made:
    from kinid.diagnosis import diagnose

    found = diagnose(log, rig, model=Model(*job.model), max_effects=job.max_effects)
    facts = found.to_dict()
    columns: Json = {"log": item.name, **item.columns, "verdict": str(found.verdict), "added": ",".join(found.added)}
    columns |= _flat("error", facts["error"]) | _numbers(found.fit.parameters)
    return Made(_row(columns), {"name": item.name, "diagnosis": facts, "doubts": list(found.fit.warnings)})


def _numbers(parameters: Mapping[str, FittedParameter]) -> Json:
    """Each estimate and its interval, in columns of their own."""
    out: Json = {}
    for name, p in parameters.items():
        out |= {name: p.value, f"{name}.low": p.low, f"{name}.high": p.high}
    return out


def _flat(name: str, facts: Json) -> Json:
    return {f"{name}.{key}": np.nan if value is None else value for key, value in facts.items()}


def _row(values: dict[str, Any]) -> dict[str, Column]:
    return {name: np.array([value]) for name, value in values.items()}


KINDS: dict[str, Callable[[Job, Log, Rig, Item], Made]] = {"contact": _contact, "fit": _fit, "diagnose": _diagnose}
