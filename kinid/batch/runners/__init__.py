"""Where work is done: every file of this folder whose name has no leading underscore holds one `Runner`."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Sequence
from importlib import import_module

from kinid.batch.runners._runner import In, Lost, Out, Runner
from kinid.errors import InputError, near

__all__ = ["Lost", "Runner", "in_order", "named", "runner"]


def named() -> list[str]:
    """Names of all runners."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_"))


def runner(on: str = "serial", workers: int | None = None) -> Runner:
    """A runner, to be closed (or used as a context) in the end.

    Args:
        on: its name; or the address of a scheduler of dask, as tcp://10.0.0.1:8786. workers: how many processes;
            default: as many as there are cores.

    Raises:
        InputError: no such runner, no worker, or libraries that aren't installed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers", "one at least", "correct --workers")
    name, address = ("dask", on) if "://" in on else (on, "")
    if name not in named():
        found = f"one of {', '.join(named())}, or a scheduler's address as tcp://10.0.0.1:8786"
        raise InputError(f"--on {on}", found, near(on, named()))
    made: Runner = import_module(f"{__name__}.{name}").begin(address, workers)
    return made


def in_order(runner: Runner, do: Callable[[In], Out], items: Sequence[In]) -> list[Out | Lost]:
    """Results for all items, in their order."""
    found = dict(runner.run(do, items))
    return [found[i] for i in range(len(items))]
