"""Less touching: where the next poke tells most, by what the map doesn't know yet.

A poke is worth the doubt that it takes away around it: the map's variance, which is large far from probes, and at borders,
where a guess is a mixture of two materials (`kinid.interpolation_gp`), averaged over the neighbourhood that a probe speaks
for (Cohn, Neural Networks 9, 1996, with the neighbourhood in place of the whole map). Where the properties are positive the
doubt is relative, so that a soft material counts as much as a hard one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.exploration_slide import Border, SlidePath
from kinid.interpolation import PlaneGround
from kinid.interpolation_gp import GaussianProcess
from kinid.interpolation_zones import belonging

Array = NDArray[np.float64]

#: a second poke nearer than this share of the smallest distance worth telling apart is refused
CLOSE = 0.7
#: a poke is made where one material is this probable
SIDED = 0.8


@dataclass(frozen=True, eq=False)
class Choice:
    """The next place to poke: along both tangents [m], (2,); its gain, the doubt that is left on average, and all gains."""

    place: Array
    gain: float
    doubt: float
    gains: Array


def next_poke(
    process: GaussianProcess, candidates: Array, *, apart: float, prior: Callable[[Array], Array] | None = None
) -> Choice:
    """Where to poke next.

    Args:
        process: the map so far. candidates: places that can be poked, (m, 2) [m]. apart: the smallest detail that matters [m].
        prior: how sure a place is of its material already, 0…1 (a picture's say); a sure place is worth less.

    Raises:
        InputError: every candidate has been poked.
    """
    candidates = np.asarray(candidates, dtype=float)
    mean, variance = process._of_zone(candidates, None, True) if process.across >= 1.0 else process._mixture(candidates, True)
    doubt = np.sqrt(variance)
    if np.all(process.values > 0):
        doubt = doubt / np.maximum(np.abs(mean), 0.1 * float(np.median(process.values)))
    if prior is not None:
        doubt = doubt * (1.0 - 0.9 * np.clip(prior(candidates), 0.0, 1.0))
    from scipy.spatial import cKDTree

    tree = cKDTree(candidates)
    # a probe speaks for its surroundings as far as half-way to the next one, and at least for the smallest detail
    distance = cKDTree(process.ground.places).query(candidates)[0]
    gains = np.array([float(np.mean(doubt[tree.query_ball_point(c, max(apart, 0.5 * d))] ** 2)) * max(d, apart) ** 2
                      for c, d in zip(candidates, distance)])  # fmt: skip
    free = distance > CLOSE * apart
    if not free.any():
        raise InputError(
            "every place poked already", "candidates that are apart from the probes", "the map is done, or give more candidates"
        )
    # right on a border a poke feels both materials at once, and tells of neither: better to close in from its sides
    sided = np.ones(len(candidates), np.bool_)
    if process.across < 1.0:
        sided = belonging(candidates, process.ground.places, process.zones, process.ground.spacing)[1].max(axis=1) >= SIDED
    gains = np.where(free & sided if (free & sided).any() else free, gains, -np.inf)
    k = int(gains.argmax())
    return Choice(candidates[k], float(gains[k]), float(np.mean(doubt)), gains)


def explore(
    poke: Callable[[Array], tuple[float, float]], candidates: Array, start: Array, *, apart: float, most: int,
    prior: Callable[[Array], Array] | None = None,
) -> Iterator[GaussianProcess]:  # fmt: skip
    """Poke the starting places, then wherever it is worth most, until `most` pokes; the map after each of the latter.

    Args:
        poke: value and its standard error at a place. candidates, apart, prior: as for `next_poke`. start: (k, 2) [m].
    """
    places = np.asarray(start, dtype=float)
    told = np.array([poke(place) for place in places])
    while True:
        process = GaussianProcess.fit(PlaneGround(places), told[:, 0], told[:, 1])
        yield process
        if len(places) >= most:
            return
        place = next_poke(process, candidates, apart=apart, prior=prior).place
        places = np.vstack([places, place])
        told = np.vstack([told, poke(place)])


def pokes_after_slides(slides: Sequence[tuple[SlidePath, Sequence[Border]]], *, beside: float, apart: float) -> Array:
    """Where to poke after sliding: beside each border that was felt, and once in each stretch without one, (k, 2) [m].

    Args:
        slides: ways with the borders found on them. beside: distance of a poke from a border [m]. apart: two pokes nearer
            than this are one [m].
    """
    wanted: list[Array] = []
    for path, borders in slides:
        edges = [float(path.x[0]), *(b.place for b in borders), float(path.x[-1])]
        for i, (a, b) in enumerate(zip(edges[:-1], edges[1:])):
            low = a + (min(beside, 0.5 * (b - a)) if i > 0 else 0.0)
            high = b - (min(beside, 0.5 * (b - a)) if i < len(edges) - 2 else 0.0)
            wanted += [path.at(low), path.at(high)] if high - low > apart else [path.at(0.5 * (low + high))]
    kept: list[Array] = []
    for place in wanted:
        if all(np.linalg.norm(place - other) >= apart for other in kept):
            kept.append(place)
    return np.array(kept).reshape(-1, 2)
