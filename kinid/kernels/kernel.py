"""How functions are compiled: NumPy's rules for division, cached on disk, without Python's global lock."""

from __future__ import annotations

from collections.abc import Callable

from numba import njit
from numba.core.dispatcher import Dispatcher


def kernel(function: Callable[..., object] | None = None, **options: object) -> Dispatcher:
    """A compiled function, called from Python or from other kernels; with `options` of numba's alone, what makes one.

    Division by zero gives inf or NaN, as in NumPy: Python's way costs a branch and an exception at every division, and
    twice the time to compile.
    """
    compiled: Dispatcher = njit(cache=True, nogil=True, error_model="numpy", **options)
    return compiled if function is None else compiled(function)
