"""Compiled code that is kept on disk until any source that went into it changes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from numba.core.dispatcher import Dispatcher

from kinid.kernels.kernel import kernel


def cached(*called: ModuleType) -> Callable[[Callable[..., object]], Dispatcher]:
    """Compile and cache a function that calls compiled functions of other modules.

    Numba looks at the file of the function alone; it would go on with what it once inlined from elsewhere. So the cache
    is named after all sources.

    Args:
        called: modules whose compiled functions or constants the function uses.
    """
    sources = stamp(*called)

    def compile_(function: Callable[..., object]) -> Dispatcher:
        function.__qualname__ += f"_{sources}"
        compiled: Dispatcher = kernel(function)
        return compiled

    return compile_


def stamp(*modules: ModuleType) -> str:
    """Hash of the modules' sources."""
    digest = hashlib.sha256()
    for module in modules:
        if module.__file__ is None:
            raise ValueError(f"{module.__name__} has no source")
        digest.update(Path(module.__file__).read_bytes())
    return digest.hexdigest()[:12]
