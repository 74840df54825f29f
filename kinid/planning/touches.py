"""What is done to a surface: pokes, slides along polylines, and campaigns of them over a grid or a polygon.

Places are along both tangents of the rig's plane from its point [m]; on a mesh they are points in the base frame, which
are brought to the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.inputs import raised, size_limit
from kinid.planning.signals import Multisine, Sampled
from kinid.writers import Json

Array = NDArray[np.float64]
Place = tuple[float, ...]

#: more touches than this are more than one plan
MOST = 20_000
#: places closer than this are one [m]
CLOSEST = 1e-5
#: deeper than this [m] no tool of an arm reaches: somebody means millimetres
DEEPEST = 0.3
#: a tool that leans more than this touches with its side [rad]
STEEPEST = 1.0


@final
@dataclass(frozen=True, eq=False)
class Poke:
    """Approach to the signal's base depth, hold [s], the signal, retract; the tool tilted about both tangents [rad]."""

    place: Place = (0.0, 0.0)
    signal: Multisine | Sampled = Multisine(0.003, ((0.0015, 0.9), (0.0005, 5.0)))
    hold: float = 1.0
    tilt: tuple[float, float] = (0.0, 0.0)

    name = "poke"

    def __post_init__(self) -> None:
        _check_place(self.place)
        _check_hold(self.hold)
        if not self.signal.base > 0:
            raise InputError(
                f"a poke about a depth of {1e3 * self.signal.base:.4g} mm, in the air",
                "a depth in the material, above 0 m",
                "press deeper: depths count from the surface into the material",
            )
        if len(self.tilt) != 2 or not np.isfinite(self.tilt).all() or np.linalg.norm(self.tilt) > STEEPEST:
            raise InputError(
                f"a tilt of {self.tilt} rad",
                f"angles about both tangents, {STEEPEST:g} rad at most together",
                "let the tool lean less",
            )

    @property
    def corners(self) -> tuple[Place, ...]:
        """The one place that it touches."""
        return (self.place,)

    @property
    def depth(self) -> float:
        """Where its motion begins [m]."""
        return self.signal.base

    def to_dict(self) -> Json:
        """For provenance."""
        return {
            "kind": self.name,
            "place": list(self.place),
            "signal": self.signal.to_dict(),
            "hold": self.hold,
            "tilt": list(self.tilt),
        }


@final
@dataclass(frozen=True, eq=False)
class Slide:
    """Approach to a depth [m] at the first corner, hold [s], along the polyline at a speed [m/s], perhaps back;
    retract.
    """

    corners: tuple[Place, ...]
    depth: float = 2.5e-3
    speed: float = 3e-3
    hold: float = 1.0
    back: bool = True

    name = "slide"

    def __post_init__(self) -> None:
        if len(self.corners) < 2:
            raise InputError(f"a slide through {len(self.corners)} corner", "two or more", "add one")
        for place in self.corners:
            _check_place(place)
        for a, b in zip(self.corners[:-1], self.corners[1:]):
            if len(a) != len(b) or np.linalg.norm(np.subtract(b, a)) < 1e-6:
                raise InputError(f"a slide from {a} to {b}", "corners that are apart", "leave one out")
        _check_hold(self.hold)
        for what, value in (("speed", self.speed), ("depth", self.depth)):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"a {what} of a slide of {value}", "a positive number", "correct it")

    def to_dict(self) -> Json:
        """For provenance."""
        return {
            "kind": self.name,
            "corners": [list(c) for c in self.corners],
            "depth": self.depth,
            "speed": self.speed,
            "hold": self.hold,
            "back": self.back,
        }


Touch = Poke | Slide


def four_paths(length: float = 0.02, centre: Place = (0.0, 0.0), **options: Any) -> tuple[Slide, ...]:
    """Slides through a place along both tangents and both diagonals, there and back; options as of `Slide`."""
    half = 0.5 * length
    return tuple(
        Slide((tuple(np.subtract(centre, half * d)), tuple(np.add(centre, half * d))), **options)
        for d in (np.array([np.cos(a), np.sin(a)]) for a in np.deg2rad([0.0, 90.0, 45.0, 135.0]))
    )


def grid(rows: int, columns: int, spacing: float, centre: Place = (0.0, 0.0)) -> list[Place]:
    """Places of a grid about a centre, along both tangents [m]."""
    if not (rows > 0 and columns > 0 and np.isfinite(spacing) and spacing >= CLOSEST):
        found = f"a grid of {rows} × {columns} places {spacing} m apart"
        raise InputError(found, f"one place at least, a spacing of {CLOSEST:g} m or more", "correct it")
    if rows * columns > size_limit(MOST):
        raise InputError(
            f"a grid of {rows} × {columns} places {spacing} m apart",
            f"{size_limit(MOST):.6g} places at most",
            f"plan fewer, {raised(rows * columns, MOST)}",
        )
    x = centre[0] + (np.arange(rows) - (rows - 1) / 2) * spacing
    y = centre[1] + (np.arange(columns) - (columns - 1) / 2) * spacing
    return [(float(a), float(b)) for a in x for b in y]


def within(polygon: Sequence[Place], spacing: float) -> list[Place]:
    """Places of a square grid that lie in a polygon (n, 2), or on its rim; it may be concave."""
    corners = np.asarray(polygon, dtype=float)
    if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise InputError(
            f"a polygon of {len(polygon)} corners", "three or more places along both tangents", "add corners"
        )
    _check_polygon(corners)
    if not (np.isfinite(spacing) and spacing > 0):
        raise InputError(f"a spacing of {spacing} m", "a positive length", "correct it")
    low, high = corners.min(axis=0), corners.max(axis=0)
    counts = np.floor((high - low) / spacing + 1e-9) + 1
    if (count := float(counts.prod())) > (most := size_limit(MOST)):
        asked, mend = (
            f"a polygon with {count:.3g} places {spacing:g} m apart",
            f"space them wider, {raised(count, MOST)}",
        )
        raise InputError(asked, f"at most {most:.6g}", mend)
    # centred in the polygon's box, so that it doesn't matter where the box begins
    axes = [0.5 * (low[k] + high[k]) + (np.arange(counts[k]) - (counts[k] - 1) / 2) * spacing for k in (0, 1)]
    x, y = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    inside = np.zeros(len(x), dtype=np.bool_)
    on_rim = np.zeros(len(x), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = ax + (y - ay) * (bx - ax) / (by - ay)
        inside ^= ((ay > y) != (by > y)) & (x < crossing)  # even-odd rule
        along = np.clip(
            ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / max((bx - ax) ** 2 + (by - ay) ** 2, 1e-30), 0.0, 1.0
        )
        on_rim |= np.hypot(ax + along * (bx - ax) - x, ay + along * (by - ay) - y) < 1e-9
    found = inside | on_rim
    if not found.any():
        raise InputError(
            f"a polygon that holds no place of a grid {spacing:g} m apart", "one place at least", "space them closer"
        )
    return [(float(a), float(b)) for a, b in zip(x[found], y[found])]


def shortest_tour(places: Sequence[Place]) -> list[int]:
    """An order of places with little travel, from the first place back to it: nearest neighbours, then 2-opt (Croes
    1958).
    """
    points = np.asarray(places, dtype=float)
    n = len(points)
    if n < 4:
        return list(range(n))
    distance = np.linalg.norm(points[:, None] - points[None], axis=2) if n <= 3000 else None

    def gap(a: int | NDArray[np.int64], b: int | NDArray[np.int64]) -> Array:
        return np.asarray(distance[a, b] if distance is not None else np.linalg.norm(points[a] - points[b], axis=-1))

    left = np.ones(n, dtype=np.bool_)
    left[0] = False
    order = [0]
    while len(order) < n:
        rest = np.flatnonzero(left)
        nearest = int(rest[np.argmin(np.round(gap(np.full(len(rest), order[-1]), rest), 12))])
        order.append(nearest)
        left[nearest] = False
    tour = np.array(order)
    for _ in range(60):
        improved = False
        for i in range(n - 1):
            a, b = tour[i], tour[i + 1]
            ends, after = tour[i + 2 :], np.append(tour[i + 3 :], tour[0])[: max(0, n - i - 2)]
            if not len(ends):
                continue
            gain = gap(a, b) + gap(ends, after) - gap(np.full(len(ends), a), ends) - gap(np.full(len(ends), b), after)
            k = int(np.argmax(gain))
            if gain[k] > 1e-12:
                tour[i + 1 : i + 3 + k] = tour[i + 1 : i + 3 + k][::-1]
                improved = True
        if not improved:
            break
    return [int(i) for i in tour]


def tour_length(places: Sequence[Place], order: Sequence[int]) -> float:
    """Travel of a tour and back to its beginning [m]."""
    points = np.asarray(places, dtype=float)[list(order)]
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())


def _check_polygon(corners: Array) -> None:
    """Refuse corners (n, 2) on one line, and edges that cross: each has both ends of the other on different sides."""
    extent = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if extent[1] <= 1e-9 * extent[0]:
        raise InputError("a polygon whose corners lie on one line", "corners around an area", "move one")
    edges = np.roll(corners, -1, axis=0) - corners
    x, y = (corners[None, :, k] - corners[:, None, k] for k in (0, 1))
    side = edges[:, None, 0] * y - edges[:, None, 1] * x  # of corner j, seen along edge i
    apart = side * np.roll(side, -1, axis=1) < 0
    crossing = np.argwhere(apart & apart.T)
    if len(crossing):
        i, j = crossing[0]
        raise InputError(
            f"a polygon whose edges {i + 1} and {j + 1} cross",
            "edges that meet at corners alone",
            "name the corners in the order in which they lie around it",
        )


def _check_place(place: Place) -> None:
    if len(place) not in (2, 3) or not np.isfinite(place).all():
        raise InputError(
            f"a place {place}",
            "two numbers along the tangents, or a point of a mesh in the base frame [m]",
            "correct it",
        )


def _check_hold(hold: float) -> None:
    if not (np.isfinite(hold) and hold >= 0):
        raise InputError(f"a hold of {hold} s", "0 or more", "correct it")
