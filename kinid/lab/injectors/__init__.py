"""What the laboratory can hide: for each effect an injector, which puts it into a set-up with a plausible size.

Each module of this folder whose name has no leading underscore holds `INJECTORS`, by the effects' names. An effect may
bring its own, too: a function `inject(setup, rng)` in its file, which gives the set-up with the effect in it and the
parameters that it has there.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys

from kinid.effects import catalogue
from kinid.errors import InputError
from kinid.lab.injectors._common import Injected, Injector, Truth

__all__ = ["Injected", "Injector", "Truth", "injectors"]


def injectors() -> dict[str, Injector]:
    """All injectors, by the names of their effects.

    Raises:
        InputError: an effect with two of them.
    """
    found: dict[str, Injector] = {}
    for module in pkgutil.iter_modules(__path__):
        if not module.name.startswith("_"):
            found |= importlib.import_module(f"{__name__}.{module.name}").INJECTORS
    for name, kind in catalogue().items():
        home = sys.modules[kind.__module__]
        own = getattr(home, "inject", None)
        if own is not None and name in found:
            raise InputError(f"a second injector of '{name}' in {home.__file__}", "one", "take one of them away")
        if own is not None:
            found[name] = own
    return found
