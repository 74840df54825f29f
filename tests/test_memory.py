"""Freed memory goes back where the C library can do it, and nothing happens where it can't."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import numpy as np
import pytest

from kinid import memory


def resident() -> int:
    """Memory of this process that is in use [bytes]."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096


@pytest.mark.skipif(
    memory._trim() is None or not sys.platform.startswith("linux"), reason="the C library has no malloc_trim"
)
def test_what_many_small_arrays_left_goes_back() -> None:
    kept = [np.ones(12_000) for _ in range(2000)]  # below the size that is mapped on its own: 190 MB in all
    held = kept[::20]
    before = resident()
    del kept
    memory.give_back()
    assert resident() < before - 100e6
    assert len(held) == 100


def test_nothing_happens_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(name: object) -> object:
        raise OSError("no such library")

    monkeypatch.setattr(ctypes, "CDLL", none)
    memory._trim.cache_clear()
    memory.give_back()
    assert memory._trim() is None
    memory._trim.cache_clear()
