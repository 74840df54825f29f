"""Work on all cores: in order, without threads of threads, errors included."""

from __future__ import annotations

import threading

import pytest

from kinid.parallel import THREADED_SAMPLES as LONG
from kinid.parallel import parallel_map


def test_results_come_in_the_order_of_the_items() -> None:
    first = threading.Event()

    def last_first(i: int) -> int:
        if i == 0:
            assert first.wait(10.0)
        first.set()
        return i * i

    assert parallel_map(last_first, [2], LONG) == [4]
    first.clear()
    assert parallel_map(lambda i: i * i, range(20), LONG) == [i * i for i in range(20)]


def test_work_inside_of_work_stays_in_its_thread() -> None:
    def inner(_: int) -> int:
        return threading.get_ident()

    def outer(_: int) -> bool:
        return set(parallel_map(inner, range(3), LONG)) == {threading.get_ident()}

    assert all(parallel_map(outer, range(4), LONG))


def test_short_work_stays_in_its_thread() -> None:
    assert set(parallel_map(lambda _: threading.get_ident(), range(3), LONG - 1)) == {threading.get_ident()}


def test_an_error_comes_through() -> None:
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda i: 1 // i, [2, 1, 0], LONG)
