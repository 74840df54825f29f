"""How kernels are compiled: NumPy's rules for division, cached on disk, no allocation, without Python's global lock."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

#: the cache of compiled code is named after this: on its own it would miss a change in what a kernel inlines
_NAMES = (
    "_jit",
    "_store",
    "_factored_kernels",
    "_excitation_kernels",
    "_kernels",
    "_contact_kernels",
    "_kalman_kernels",
    "_friction_kernels",
)
_SOURCES = hashlib.sha256(b"".join(Path(__file__).with_name(f"{name}.py").read_bytes() for name in _NAMES)).hexdigest()[
    :12
]


def jit(function: F) -> F:
    """A kernel that Python calls."""
    function.__qualname__ += f"_{_SOURCES}"
    # _nrt=False: the compiler refuses code that allocates, and spends no time on counting references
    return njit(error_model="numpy", cache=True, nogil=True, _nrt=False)(function)  # type: ignore[no-any-return]


def inlined(function: F) -> F:
    """A part of kernels: inlined by LLVM, so that loops over a constant number of parameters unroll."""
    return njit(error_model="numpy", forceinline=True, _nrt=False)(function)  # type: ignore[no-any-return]
