"""The same work for many items on all cores: kernels and linear algebra let go of the interpreter's lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

In = TypeVar("In")
Out = TypeVar("Out")

#: threads at most: what stays under the lock leaves more of them nothing to do
MAX_THREADS = 4
#: samples from which threads pay: with two, a diagnosis of 30,000 takes a quarter more, one of 600,000 a quarter less
THREADED_SAMPLES = 100_000

_here = threading.local()


def parallel_map(do: Callable[[In], Out], items: Sequence[In], samples: int) -> list[Out]:
    """Results for all items, in their order; computed one after the other inside of work that is parallel already, and
    where arrays are so short that threads wait for each other.

    Args:
        do: what is computed for an item, with floating-point warnings off. items: any number. samples: length of the
            arrays that an item's work goes through.
    """

    def quietly(item: In) -> Out:
        with np.errstate(all="ignore"):  # a shape that doesn't suit the log may overflow: it is passed over
            return do(item)

    cores = min(os.cpu_count() or 1, MAX_THREADS)
    if samples < THREADED_SAMPLES or cores < 2 or len(items) < 2 or getattr(_here, "busy", False):
        return [quietly(item) for item in items]
    with ThreadPoolExecutor(min(cores, len(items)), initializer=lambda: setattr(_here, "busy", True)) as pool:
        return list(pool.map(quietly, items))


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Inside of it linear algebra has one thread: many small products, where more only wait for each other.

    They wait busily. Where another process has a core, a map of 49 probes takes 60 s instead of 0.3.
    """
    with threadpool_limits(1, user_api="blas"):
        yield


@contextmanager
def in_turn() -> Iterator[None]:
    """Work inside of it is one of many things that go on at once: it makes no threads of its own."""
    before = getattr(_here, "busy", False)
    _here.busy = True
    try:
        yield
    finally:
        _here.busy = before
