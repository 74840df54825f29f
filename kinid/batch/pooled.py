"""Visits of a pooled model's logs by a runner; each log's own fit, which takes the most time, is kept in a store."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from kinid.batch.logs import Item
from kinid.batch.runners import Lost, Runner, in_order
from kinid.batch.runners._runner import In, Out
from kinid.batch.store import Store, is_remote
from kinid.effects._signals import RestForm
from kinid.errors import InputError, KinidError
from kinid.identification.error_model import ErrorModel, reading_variance
from kinid.identification.pooling.logs import PooledLog
from kinid.identification.pooling.pool import Alone, Visit
from kinid.identification.pooling.search import Begun, Progress, begin_one
from kinid.identification.pooling.shelf import Shelf, shelf_in
from kinid.identification.problem import Problem
from kinid.modeling.model import Model

#: where fits are kept
OWN = "own"
#: folder of a shelf, hidden from those who look for tables
SHELF = ".shelf"


@dataclasses.dataclass(frozen=True)
class ByRunner:
    """Where a pooled model's logs are worked at (`pooling.logs.Elsewhere`): by a runner.

    Attributes:
        runner: who does it. store: where each log's own fit is kept, so that it isn't made twice; None for nowhere.
        parts: name of each log → of its file there. shelf: where logs are kept as they were made ready, so that visits
            don't make them again; None for nowhere.
    """

    runner: Runner
    store: Store | None = None
    parts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    shelf: Shelf | None = None

    @classmethod
    def of(cls, runner: Runner, store: Store | None, items: Sequence[Item], shelf: Shelf | None = None) -> ByRunner:
        """For these logs; a store serves one model, and so does a shelf."""
        return cls(runner, store, {item.name: item.part(OWN, "npz") for item in items}, shelf)

    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> list[Out]:
        """Results for all items, in their order.

        Raises:
            KinidError: a log that was fitted, and can't be visited any more.
        """
        found = in_order(self.runner, do, items)
        lost = next((one for one in found if isinstance(one, Lost)), None)
        if lost is not None:
            raise InputError(f"a log that was lost on the way ({lost.why})", "logs that stay", "start again")
        return [one for one in found if not isinstance(one, Lost)]

    def begun(self, model: Model, logs: Sequence[PooledLog], progress: Progress) -> list[Begun | str]:
        """Each log fitted by itself, or why it can't be."""
        out: list[Begun | str] = [""] * len(logs)
        do = partial(_begun, model, self.store)
        if self.shelf is not None:
            name = hashlib.sha256(repr(model).encode()).hexdigest()[:12]  # models differ in what they take of a log
            logs = [self.shelf.of(log, f"{name}-{number}") for number, log in enumerate(logs)]
        tasks = [(log, self.parts.get(log.name, "")) for log in logs]
        for count, (place, one) in enumerate(self.runner.run(do, tasks), start=1):
            out[place] = one.why if isinstance(one, Lost) else dataclasses.replace(one, log=logs[place])
            progress(f"fitting each log by itself, {count} of {len(logs)} done")
        return out


@contextmanager
def shelf_for(runner: Runner, store: Store | None) -> Iterator[Shelf | None]:
    """A shelf for as long as a pooled model takes, which all workers see: in the store where that is a folder of this
    machine, else where it keeps what is temporary; None where workers are on other machines.
    """
    if not runner.here:
        yield None
    elif store is not None and not is_remote(store.address):
        with shelf_in(Path(store.address) / SHELF) as shelf:
            yield shelf
    else:
        with tempfile.TemporaryDirectory(prefix="kinid-") as folder, shelf_in(Path(folder) / SHELF) as shelf:
            yield shelf


def _begun(model: Model, store: Store | None, task: tuple[PooledLog, str]) -> Begun:
    """One log's own fit, out of the store where it is there."""
    log, part = task
    problem = Problem.build(log.load())
    if store is None:
        return begin_one(model, log, problem)
    data = store.found(part)
    if data is not None:
        rest, visit, errors, held_out = _unpacked(data, model, problem)
        one = Begun.of(log, visit.state(problem.with_rest(rest)))
        return dataclasses.replace(one, alone=dataclasses.replace(one.alone, errors=errors, held_out=held_out))
    one = begin_one(model, log, problem)
    store.write(part, packed(one.alone))
    return one


def packed(alone: Alone) -> bytes:
    """Where a log's own fit ended, as NPZ; what follows from the log itself isn't in it."""
    error, out = alone.error, io.BytesIO()
    unusual = np.broadcast_to(error.unusual, error.motion.shape)
    begin = np.flatnonzero(np.r_[True, (np.diff(unusual, axis=1) != 0.0).any(axis=0)])  # the same all over a block
    np.savez(
        out,
        values=alone.values,
        errors=alone.errors,
        shift=alone.shift,
        held_out=alone.held_out,
        motion=error.motion,
        discrepancy=error.discrepancy,
        memory=error.memory,
        unusual=unusual[:, begin],
        lasting=np.diff(np.r_[begin, unusual.shape[1]]),
        rest=np.array(json.dumps(dataclasses.asdict(alone.rest))),
    )
    return out.getvalue()


def _unpacked(data: bytes, model: Model, problem: Problem) -> tuple[RestForm, Visit, NDArray[np.float64], float]:
    """What such a file says.

    Raises:
        KinidError: it is none.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            rest = RestForm(**json.loads(str(kept["rest"])))
            sizes = reading_variance(problem), kept["motion"], kept["discrepancy"]
            unusual = np.repeat(kept["unusual"], kept["lasting"], axis=1)
            error = ErrorModel(*sizes, float(kept["memory"]), unusual)
            visit = Visit(model.for_log(problem.experiment.signals), kept["values"], kept["shift"], error)
            return rest, visit, kept["errors"], float(kept["held_out"])
    except (ValueError, KeyError, TypeError, OSError, BadZipFile) as error:
        raise KinidError(f"found a fit in the store that isn't whole ({error}); expected its own; remove it") from None
