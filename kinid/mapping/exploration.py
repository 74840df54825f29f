"""Less touching: where the next poke tells most, by what the map doesn't know yet.

Three probes around a place say what it may be like: if they differ, a border runs between them. What a triangle leaves
open is its area times the standard deviation half-way along its edges (relative where values are positive, so that a
soft material counts as much as a hard one), and the next poke halves the edge that leaves most open: borders are closed
in by bisection, the widest open ones first. What is expected in advance, as from a picture, makes the map surer, and
pokes go elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.mapping.boundaries import Border, SlidePath
from kinid.mapping.interpolation import REACH, Interpolator, PlaneSites, Prior
from kinid.mapping.interpolation.triangles import Triangles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Region:
    """A rectangle that can be poked, along both tangents [m]: its lower and its upper corner."""

    low: tuple[float, float]
    high: tuple[float, float]

    def __post_init__(self) -> None:
        if not (
            np.isfinite([*self.low, *self.high]).all() and self.high[0] > self.low[0] and self.high[1] > self.low[1]
        ):
            raise InputError(
                f"a region from {self.low} to {self.high} m", "two corners, the lower one first", "correct it"
            )

    @property
    def corners(self) -> Array:
        """All four, (4, 2)."""
        (a, b), (c, d) = self.low, self.high
        return np.array([[a, b], [a, d], [c, b], [c, d]])

    def grid(self, rows: int, columns: int | None = None) -> Array:
        """Middles of equal cells, (rows · columns, 2): what spreads probes evenly."""
        ticks = [
            low + (high - low) * (np.arange(n) + 0.5) / n
            for low, high, n in zip(self.low, self.high, (rows, columns or rows))
        ]
        return np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Choice:
    """The next place to poke: along both tangents [m], (2,), and its gain: area [m²] times what is left open there."""

    place: Array
    gain: float


def next_poke(grown: Interpolator, region: Region, *, apart: float) -> Choice:
    """Where to poke next.

    Args:
        grown: the map so far, on a plane; of another method than "triangles" its probes are taken, and triangles laid
            over them.
        region: what can be poked. apart: the smallest detail that matters [m]; no two pokes are nearer.

    Raises:
        InputError: everything has been poked as closely as that; a map on a mesh; no distance apart.
    """
    from scipy.spatial import Delaunay, cKDTree

    if not (np.isfinite(apart) and apart > 0):
        raise InputError(f"pokes {apart} m apart", "a positive distance [m]", "say the smallest detail that matters")
    grown = _over_probes(grown)
    tree = cKDTree(grown.sample_sites.places)
    # the region's corners stand as the nearest probe does
    far = np.array([corner for corner in region.corners if tree.query(corner)[0] > apart]).reshape(-1, 2)
    places = np.vstack([grown.sample_sites.places, far])
    height = np.append(grown.heights[0], grown.heights[0][tree.query(far)[1]] if len(far) else [])
    corners = Delaunay(places).simplices
    a, b, c = (places[corners[:, k]] for k in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    ends = np.stack([corners, np.roll(corners, -1, axis=1)])  # (2, k, 3)
    middles = 0.5 * places[ends].sum(axis=0)
    length = np.linalg.norm(places[ends[0]] - places[ends[1]], axis=2)
    open_ = grown.halfway(height[ends[0]] - height[ends[1]], middles.reshape(-1, 2)).reshape(-1, 3)
    gains = area * open_.max(axis=1)
    widest = np.argmax(length * open_, axis=1)
    for k in np.argsort(-gains).tolist():
        middle = middles[k, widest[k]]
        if tree.query(middle)[0] >= apart:
            return Choice(middle, float(gains[k]))
    raise InputError(
        f"every place poked within {1e3 * apart:g} mm",
        "a region that is not known yet",
        "the map is done, or allow pokes closer together",
    )


def _over_probes(grown: Interpolator) -> Triangles:
    """Triangles over the probes of any interpolator on a plane."""
    if isinstance(grown, Triangles):
        return grown
    sample_sites, values = getattr(grown, "sample_sites", None), getattr(grown, "values", None)
    if not isinstance(sample_sites, PlaneSites) or values is None:
        raise InputError(
            f"{type(grown).__name__}, which is no map on a plane",
            "one on a plane",
            "ask for PropertyMap.interpolator(…, 'triangles') of a map on a plane",
        )
    noise = getattr(grown, "noise", None)
    return Triangles(sample_sites, values, np.zeros(len(values)) if noise is None else np.asarray(noise, dtype=float))


def explore(
    poke: Callable[[Array], tuple[float, float]],
    region: Region,
    start: Array,
    *,
    apart: float,
    most: int,
    prior: Prior | None = None,
) -> Iterator[Triangles]:
    """Poke the starting places, then wherever most is left open, until `most` pokes; the map after each of the latter.

    Args:
        poke: value and its standard error at a place. region, apart: as for `next_poke`. start: (k, 2) [m].
        prior: what is expected, as `kinid.mapping.picture_map.Sighted.prior` says it.

    Raises:
        InputError: fewer than 3 starting places, or nothing left to poke before `most`.
    """
    places = np.asarray(start, dtype=float).reshape(-1, 2)
    if len(places) < 3:
        raise InputError(f"{len(places)} starting places", "3 at least", "start with more")
    measured = np.array([poke(place) for place in places])
    # the start is spread over the region: what it reaches is known from then on
    reach = max(
        PlaneSites(places).reach, REACH * float(np.sqrt(np.prod(np.subtract(region.high, region.low)) / len(places)))
    )
    while True:
        grown = Triangles(PlaneSites(places, reach), measured[:, 0], measured[:, 1], prior)
        yield grown
        if len(places) >= most:
            return
        place = next_poke(grown, region, apart=apart).place
        places = np.vstack([places, place])
        measured = np.vstack([measured, poke(place)])


def pokes_after_slides(slides: Sequence[tuple[SlidePath, Sequence[Border]]], *, beside: float, apart: float) -> Array:
    """Where to poke after sliding: beside each border that was felt, and once in each stretch without one, (k, 2) [m].

    Args:
        slides: ways with the borders found on them. beside: distance of a poke from a border [m]. apart: two pokes
            nearer than this are one [m].
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
