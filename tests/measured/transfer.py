"""Whether what is named on one log holds on another one of the same machine: parameters of the one predict the
other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinid
from kinid import effects
from measured.logs import SOURCES, halves
from measured.scene import experiment_of
from measured.scoring import Answer
from measured.solver import Fitting

Array = NDArray[np.float64]

#: of each log its own: refitted where the parameters of another log are tried
NUISANCES = ("joint-torque-offset", "sensor-bias", "sensor-drift", "surface-offset")
#: logs of two recordings, and those that are cut in the middle
TWO = (
    ("lwr4plus-motion-1", "lwr4plus-motion-2"),
    ("ur10e-motion-14", "ur10e-motion-15"),
    ("leg-jump", "leg-push_pull"),
)
HALVED = ("panda-motion", "drive-friction", "silicone-two-cycles", "phantom-probes", "phantom-slide")


@dataclass(frozen=True, eq=False)
class Way:
    """From the log that is learnt from to the one that is predicted."""

    name: str
    model: tuple[str, ...]
    learnt: tuple[kinid.Log, kinid.Rig]
    tried: tuple[kinid.Log, kinid.Rig]


def ways(real: Path, only: str = "") -> list[Way]:
    """Every pair, there and back."""
    by = {source.name: source for source in SOURCES}
    pairs = [(f"{a} to {b}", by[a].model, by[a].read(real), by[b].read(real)) for a, b in TWO if only in a or only in b]
    for name in HALVED:
        if only in name:
            log, rig = by[name].read(real)
            first, second = halves(log)
            pairs.append((f"{name} halves", by[name].model, (first, rig), (second, rig)))
    return [
        way
        for name, model, a, b in pairs
        for way in (Way(f"{name}, there", model, a, b), Way(f"{name}, back", model, b, a))
    ]


def moved(way: Way, added: tuple[str, ...]) -> tuple[float, float]:
    """Error on the other log of the model, and of the model with what was named, both with the parameters of the first.

    Root mean square over channels, each in units of what the model leaves in it on the first log, held out. Marks of
    converters (a lattice, a flat top, the mains) are of one recording; they take no part.
    """
    known = [name for name in added if name in effects.catalogue() and not effects.get(name).detector]
    model, better = kinid.Model(*way.model), kinid.Model(*way.model, *known)
    seen, new = (experiment_of(model, *log) for log in (way.learnt, way.tried))
    first = Fitting(model, seen)
    left = np.sqrt(np.nanmean(first.held_out(first.solve(first.start({}), first.valid)) ** 2, axis=1))
    weight = 1.0 / np.maximum(left, 1e-3 * left.max())
    before = _error(model, seen, new, weight)
    return before, _error(better, seen, new, weight) if known else before


def _error(model: kinid.Model, seen: Any, new: Any, weight: Array) -> float:
    learnt = Fitting(model, seen, weight)
    values = learnt.solve(learnt.start({}), learnt.valid)
    tried = Fitting(model, new, weight)
    own = np.array([name.split(".", 1)[0] in NUISANCES for name in tried.named])
    tried.free = np.array([i for i in tried.free if own[i]], dtype=np.int64)
    there = tried.solve(values, tried.valid)
    left = ((tried.measured - tried.predict(there)) * tried.weight[:, None])[:, tried.valid]
    return float(np.sqrt(np.mean(left**2)))


def line(way: Way, said: Answer, before: float, after: float) -> str:
    """For a table."""
    mark = "–" if not said.added else "holds" if after < before else "FAILS"
    return f"{way.name:<50} {before:.4f} → {after:.4f}  {mark:<6} {', '.join(said.added) or 'nothing named'}"
