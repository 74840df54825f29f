"""Logs of a pooled fit as they were made ready for it, on disk: a visit reads one in a hundredth of the time that it
takes to make it from the log.

A file is NPY twice: JSON that says what stands where, then the bytes of all arrays. Nothing is pickled. What is no
array and no plain value (motions to be drawn, torques to be worked out) is made from the log again where it is wanted.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout, Signals
from kinid.effects._signals import AsRead, JointMotion, RestForm, SensorMotion
from kinid.identification.pooling.logs import PooledLog
from kinid.modeling.experiment import Experiment
from kinid.writers import Json

#: what may stand in a file, by name
KINDS: dict[str, Any] = {
    kind.__name__: kind for kind in (Experiment, Signals, Layout, RestForm, SensorMotion, JointMotion, AsRead)
}
#: each array begins at a multiple of so many bytes
ALIGNED = 64
#: share of a disk that is left free
LEFT_FREE = 0.1
#: of files that aren't whole yet
PART = ".part"


@dataclass(frozen=True)
class Shelf:
    """A folder that all who visit the logs see."""

    folder: Path

    def of(self, log: PooledLog, name: str) -> PooledLog:
        """The same log, kept here in a file of this name once it was loaded."""
        return dataclasses.replace(log, load=Shelved(log.load, self.folder / f"{name}.npy"))


@contextmanager
def shelf_in(folder: Path) -> Iterator[Shelf]:
    """A shelf in a folder of its own, which is gone in the end; what an earlier one left there goes first."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield Shelf(folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True)
class Shelved:
    """How a log is loaded: from its file where that is there, else as `load` does, and then it is."""

    load: Callable[[], Experiment]
    file: Path

    def __call__(self) -> Experiment:
        """The log.

        Raises:
            InputError: as of `load`.
        """
        with contextlib.suppress(OSError, ValueError, EOFError):  # no file, or one that somebody cut
            return unpacked(self.file, self.load)
        made = self.load()
        with contextlib.suppress(OSError):  # a full disk: it is made again next time
            _write(self.file, made)
        return made


@dataclass(frozen=True)
class Anew:
    """In place of what no file holds: made from the log again when it is called."""

    load: Callable[[], Experiment]
    path: tuple[str, ...]

    def __call__(self, *args: Any) -> Any:
        """What it does."""
        return self._made(*args)

    @cached_property
    def _made(self) -> Callable[..., Any]:
        made: Any = self.load()
        for name in self.path:
            made = getattr(made, name)
        return made  # type: ignore[no-any-return]


class _Arrays:
    """Arrays one after the other, each once."""

    def __init__(self) -> None:
        self.all: list[NDArray[Any]] = []
        self.end, self._at = 0, dict[int, int]()
        self.facts: list[Json] = []

    def add(self, array: NDArray[Any]) -> int:
        if id(array) not in self._at:
            # in the order of its memory: sums over axes depend on that in their last digits
            turn = np.argsort([-abs(step) for step in array.strides], kind="stable").tolist()
            self.all.append(np.ascontiguousarray(array.transpose(turn)))
            self.facts.append({"type": array.dtype.str, "shape": self.all[-1].shape, "turn": turn, "at": self.end})
            self.end += -(-array.nbytes // ALIGNED) * ALIGNED
            self._at[id(array)] = len(self.facts) - 1
        return self._at[id(array)]


def _write(file: Path, experiment: Experiment) -> None:
    """Whole, or not at all; not on a disk that is nearly full."""
    arrays = _Arrays()
    what = _taken_apart(dataclasses.replace(experiment, touch=None), arrays, ())
    total, _, free = shutil.disk_usage(file.parent)
    if free - arrays.end < LEFT_FREE * total:
        return
    head = np.frombuffer(json.dumps({"arrays": arrays.facts, "what": what}).encode(), np.uint8)
    body = np.zeros(arrays.end, np.uint8)
    for array, facts in zip(arrays.all, arrays.facts):
        body[facts["at"] : facts["at"] + array.nbytes] = array.reshape(-1).view(np.uint8)
    part = file.with_name(f"{file.name}.{secrets.token_hex(4)}{PART}")
    try:
        with part.open("wb") as out:
            np.save(out, head, allow_pickle=False)
            np.save(out, body, allow_pickle=False)
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def _taken_apart(thing: Any, arrays: _Arrays, path: tuple[str, ...]) -> Any:
    """As JSON, arrays by their numbers."""
    if isinstance(thing, np.ndarray):
        return {"array": arrays.add(thing)}
    if dataclasses.is_dataclass(thing) and type(thing).__name__ in KINDS:
        names = [field.name for field in dataclasses.fields(thing)]
        fields = {name: _taken_apart(getattr(thing, name), arrays, (*path, name)) for name in names}
        return {"kind": type(thing).__name__, "fields": fields}
    if isinstance(thing, tuple):
        return {"tuple": [_taken_apart(one, arrays, (*path, str(i))) for i, one in enumerate(thing)]}
    if callable(thing):
        return {"anew": path}
    return thing.item() if isinstance(thing, np.generic) else thing


def unpacked(file: Path, load: Callable[[], Experiment]) -> Experiment:
    """What a file holds.

    Args:
        file: that `Shelved` has written. load: makes the log anew, for what the file doesn't hold.

    Raises:
        OSError, ValueError, EOFError: there is none, or it isn't whole.
    """
    with file.open("rb") as opened:
        head: Json = json.loads(np.load(opened, allow_pickle=False).tobytes())
        body: NDArray[np.uint8] = np.load(opened, allow_pickle=False)
    arrays = []
    for facts in head["arrays"]:
        kind, shape = np.dtype(facts["type"]), facts["shape"]
        size = kind.itemsize * int(np.prod(shape))
        array = body[facts["at"] : facts["at"] + size].view(kind).reshape(shape)
        arrays.append(array.transpose(np.argsort(facts["turn"])) if len(shape) > 1 else array)
    out: Experiment = _put_together(head["what"], arrays, load)
    return out


def _put_together(what: Any, arrays: list[NDArray[Any]], load: Callable[[], Experiment]) -> Any:
    if not isinstance(what, dict):
        return what
    if "array" in what:
        return arrays[what["array"]]
    if "tuple" in what:
        return tuple(_put_together(one, arrays, load) for one in what["tuple"])
    if "anew" in what:
        return Anew(load, tuple(what["anew"]))
    return KINDS[what["kind"]](**{k: _put_together(v, arrays, load) for k, v in what["fields"].items()})
