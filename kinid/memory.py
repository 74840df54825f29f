"""Memory that is free again, handed back to the system."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache


@cache
def _trim() -> Callable[[int], int] | None:
    """The C library's own way to do it, where it has one."""
    try:
        found: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    return found


def give_back() -> None:
    """Hand freed memory back: glibc keeps what many large arrays left behind, half as much again on long logs.

    Does nothing where the C library has no `malloc_trim`.
    """
    trim = _trim()
    if trim is not None:
        trim(0)
