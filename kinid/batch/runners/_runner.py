"""What all runners have in common: how an item is tried, and what is said of one that can't be worked out."""

from __future__ import annotations

import os
import pickle
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, TypeVar

from kinid.errors import KinidError
from kinid.parallel import in_turn, one_blas_thread

In = TypeVar("In")
Out = TypeVar("Out")

#: how often an item is tried: where its error isn't about its data, and where its worker died of it
TRIES = 3
#: pause before another try, which grows with each [s]: a server that is busy is so for a while
PAUSE = 0.2
#: names folders of effects, as kinid.effects reads it
VARIABLE = "KINID_EFFECTS"


@dataclass(frozen=True)
class Lost:
    """An item that couldn't be worked out, and why, in words."""

    why: str


class Runner(ABC):
    """Works out a function of many items; whoever does it, and however often a worker dies, results are the same.

    Attributes:
        workers: how many items are worked out at a time. dashboard: address of a page that shows it, "" for none.
        apart: whether that happens in other processes, which see nothing of this one's memory. here: whether all of
            them are on this machine.
    """

    workers: int = 1
    dashboard: str = ""
    apart: bool = True
    here: bool = True

    @abstractmethod
    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> Iterator[tuple[int, Out | Lost]]:
        """Place of each item, and its result, as they come.

        Args:
            do: a function of a module; it may be called more than once for an item. items: any number, of which few
                are on their way at a time.
        """

    def close(self) -> None:
        """Let go of the workers."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()


def attempt(do: Callable[[In], Out], item: In) -> Out | Lost:
    """The result for an item, or why there is none: what is wrong with its data is said at once, all else is tried
    again.
    """
    for last in range(TRIES):
        try:
            with one_blas_thread():  # the same sums in the same order, wherever it is done
                return do(item)
        except KinidError as error:
            return Lost(str(error))
        except Exception as error:
            why = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
        time.sleep(PAUSE * last)
    return Lost(f"{why} ({TRIES} tries)")


def packed(do: Callable[[In], Out], item: In) -> bytes:
    """A task as a worker takes it."""
    return pickle.dumps((do, item), protocol=pickle.HIGHEST_PROTOCOL)


def unpacked(task: bytes) -> Any:
    """What `attempt` says of a task that this program has packed; effects of a user's own are known to it before."""
    if os.environ.get(VARIABLE):
        from kinid.effects import catalogue

        catalogue()
    do, item = pickle.loads(task)  # from this program's own pipe or scheduler, never from a file
    with in_turn():
        return attempt(do, item)


def cores() -> int:
    """Usable cores of this machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def died(how: str) -> Lost:
    """Of an item whose workers die."""
    return Lost(f"its worker died of it {TRIES} times ({how})")
