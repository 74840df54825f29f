"""What a map, a picture or pooled logs let expect of a place that isn't touched yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.contact.early_stop import MOST_NOISE
from kinid.errors import InputError
from kinid.estimators.estimate import NORMAL_95
from kinid.estimators.warm_start import Candidate, Learnt, WarmStart
from kinid.identification.fitted import FittedModel
from kinid.mapping.property_map import Probe, PropertyMap
from kinid.robotics.surface import Plane

Array = NDArray[np.float64]

#: word for a start from the map's own probes alone
NEIGHBOURS = "neighbours"
#: so many of the nearest probes each say what may lie at a place
NEAREST = 4
#: shares of a value by which it may differ from place to place in one material (standard deviation)
SPREADS = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
#: a spread stands as long as the touches' evidence (a logarithm) isn't by so much better under another one
CONTRADICTED = 2.0
#: the same share from specimen to specimen, of an earlier map or a pooled material
ELSEWHERE = 0.1
#: share of places where another material lies than any that is expected
ANOTHER = 0.2


@dataclass(frozen=True, eq=False)
class Expectation:
    """What is expected beside the map's own probes: of an earlier map, or of a pooled material.

    Attributes:
        earlier: of another specimen, or predicted from a picture; on a plane. pooled: value and standard deviation of
            each property of one material, by the names of maps. source: what it was read from, in words.
    """

    earlier: PropertyMap | None = None
    pooled: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    source: str = NEIGHBOURS

    @classmethod
    def read(cls, text: str) -> Expectation:
        """From "neighbours", which is nothing beside them, or from a file: a map, or a fit of one or many logs.

        Raises:
            InputError: a file that isn't there, or neither a map on a plane nor a fit.
        """
        path = Path(text)
        if text == NEIGHBOURS:
            return cls()
        if path.suffix.lower() == ".json":
            return cls(pooled=pooled(FittedModel.load(path)), source=text)
        if path.suffix.lower() != ".parquet":
            raise InputError(
                f"a prior '{text}'",
                f"{NEIGHBOURS}, a map (.parquet) or a fit (.json)",
                "name the file of a map, of what a picture predicts, or of a fit",
            )
        earlier = PropertyMap.read(path)
        if not isinstance(earlier.surface, Plane):
            raise InputError(f"a map on a mesh at {path}", "one on a plane", f"take {NEIGHBOURS}")
        return cls(earlier, source=text)

    def candidates(self, place: Array, names: Sequence[str]) -> list[Candidate]:
        """Materials that may lie at a place, base frame [m], (3,); of each as much as all neighbours together weigh."""
        found = [] if self.earlier is None else [_there(self.earlier, place, names)]
        values, sd = np.array([self.pooled.get(name, (np.nan, np.inf)) for name in names]).T
        found.append((values, sd))
        return [
            _candidate(values, np.diag(sd**2), ELSEWHERE, float(NEAREST))
            for values, sd in found
            if np.isfinite(sd).any()
        ]


class Neighbourhood:
    """Starts from the probes near by, and by how much those of one material differ.

    That is learnt as the map grows: it is the widest of `SPREADS` that the touches don't contradict, so that the first
    ones start nearly from nothing. It is one share for all properties.

    Args:
        expectation: what else is expected.
    """

    def __init__(self, expectation: Expectation) -> None:
        self._expectation = expectation
        self._evidence = np.zeros(len(SPREADS))

    @property
    def source(self) -> str:
        """What else is expected, in words."""
        return self._expectation.source

    @property
    def spread(self) -> float:
        """Share of a value by which it differs from place to place in one material."""
        return SPREADS[int(np.flatnonzero(self._evidence >= self._evidence.max() - CONTRADICTED)[-1])]

    def at(self, grown: PropertyMap | None, place: Array, names: Sequence[str]) -> WarmStart:
        """What may lie at a place.

        Args:
            grown: the map so far. place: base frame [m], (3,). names: of the properties that a touch tells.
        """
        return self._start(grown, place, names, self.spread)

    def learn(self, grown: PropertyMap | None, place: Array, names: Sequence[str], alone: Learnt) -> None:
        """How well each spread expected what a touch alone says; arguments as of `at`, with the map before it."""
        starts = (self._start(grown, place, names, spread) for spread in SPREADS)
        self._evidence += [start.after(alone.values, alone.covariance).evidence for start in starts]

    def applied(self, grown: PropertyMap | None, names: Sequence[str], probe: Probe) -> Probe:
        """A probe with what was expected of its place.

        What its own touch leaves open stays open; and where the law fails it stays as it is: its parameters aren't
        those of a material near by.

        Args:
            grown: the map so far. names: of the probe's properties.
        """
        known = np.isfinite(np.diag(probe.covariance)) & (np.diag(probe.covariance) > 0.0)
        if not known.any() or _fails(probe):
            return probe
        rows = np.ix_(known, known)
        start = self.at(grown, probe.place, [name for name, is_known in zip(names, known) if is_known])
        learnt = start.after(probe.values[known], probe.covariance[rows])
        if known.all():
            self.learn(grown, probe.place, names, WarmStart().after(probe.values, probe.covariance))
        values, covariance = probe.values.copy(), probe.covariance.copy()
        values[known], covariance[rows] = learnt.values, learnt.covariance
        return replace(probe, values=values, covariance=covariance)

    def _start(self, grown: PropertyMap | None, place: Array, names: Sequence[str], spread: float) -> WarmStart:
        expected = [] if grown is None else _near(grown, place, names, spread)
        expected += self._expectation.candidates(place, names)
        return WarmStart(expected, ANOTHER) if expected else WarmStart()


def pooled(fit: FittedModel) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter that a fit tells, by the names of maps."""
    out = {}
    for name, p in fit.parameters.items():
        effect, own = name.split(".", 1)
        sd = (p.high - p.low) / (2.0 * NORMAL_95)
        if np.isfinite(sd):
            out[fit.model[effect].map_names.get(own, own)] = (p.value, sd)
    return out


def _near(grown: PropertyMap, place: Array, names: Sequence[str], spread: float) -> list[Candidate]:
    """Each of the nearest probes that tell something, as a candidate of its own: their errors aren't independent."""
    if not set(names) <= {p.name for p in grown.properties}:
        return []
    rows, out = [grown.index(name) for name in names], list[Candidate]()
    for k in np.argsort(((grown.places - place) ** 2).sum(axis=1), kind="stable").tolist():
        probe = grown.probes[k]
        covariance = probe.covariance[np.ix_(rows, rows)]
        if np.isfinite(np.diag(covariance)).any() and not _fails(probe):
            out.append(_candidate(probe.values[rows], covariance, spread, 1.0))
        if len(out) == NEAREST:
            break
    return out


def _fails(probe: Probe) -> bool:
    """Whether the law leaves more than noise of a probe's touch."""
    return probe.residual > MOST_NOISE * probe.noise


def _there(earlier: PropertyMap, place: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """What an earlier map says of a place: values and standard deviations, infinite where it is unknown."""
    values, sd = np.full(len(names), np.nan), np.full(len(names), np.inf)
    for i, name in enumerate(names):
        if name not in {p.name for p in earlier.properties} or not np.isfinite(earlier.deviations(name)).any():
            continue
        guess = earlier.interpolator(name).at(earlier.flat(place[None]))
        if guess.known[0] and np.isfinite(guess.sd[0]):
            values[i], sd[i] = guess.mean[0], guess.sd[0]
    return values, sd


def _candidate(values: Array, covariance: Array, spread: float, share: float) -> Candidate:
    """A material as it may be at another place."""
    known = np.isfinite(np.diag(covariance))
    more = np.where(known, spread**2 * (np.where(known, values, 0.0) ** 2 + np.diag(covariance)), 0.0)
    return Candidate(np.where(known, values, 0.0), covariance + np.diag(more), share)
