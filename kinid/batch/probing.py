"""Probes for a map, of many logs at a time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path

from kinid.batch.logs import addresses
from kinid.batch.runners import Lost, Runner
from kinid.batch.store import fetched, is_remote
from kinid.data.rig import Rig
from kinid.mapping.probes import Found, Prober, logs_in


def found_in(paths: Sequence[str]) -> list[str]:
    """Addresses of the logs that files, folders and addresses name, in order."""
    out: list[str] = []
    for path in paths:
        out += addresses(path) if is_remote(path) else [str(log) for log in logs_in([Path(path)])]
    return list(dict.fromkeys(out))


def probed(runner: Runner, prober: Prober, sources: Sequence[str]) -> Iterator[tuple[str, Found | str]]:
    """Each log's properties and probes, or why it has none, in the order of the logs.

    Args:
        runner: who does it. prober: fits them. sources: paths or addresses.
    """
    do: Callable[[str], Found] = partial(_probe, prober.rig, prober.model.names, prober.along)
    waiting: dict[int, Found | Lost] = {}
    after = 0
    for place, result in runner.run(do, sources):
        waiting[place] = result
        while after in waiting:
            one = waiting.pop(after)
            yield sources[after], one.why if isinstance(one, Lost) else one
            after += 1


def _probe(rig: Rig, model: tuple[str, ...], along: float, source: str) -> Found:
    prober = _prober(rig.model_dump_json(), str(rig.folder), model, along)
    with fetched(source) as path:
        return prober.probes(path, source)


@cache
def _prober(rig: str, folder: str, model: tuple[str, ...], along: float) -> Prober:
    """Made once in each worker."""
    return Prober.of(Rig.parse(json.loads(rig), folder=folder), model, along)
