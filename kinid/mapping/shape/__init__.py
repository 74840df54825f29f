"""The shape of a surface that nobody knows, and what it is made of, both from the touches and slides of one tool.

The surface is the zero set of a Gaussian process over space (`kinid.mapping.shape.implicit`). It is read out over the
plane that fits the touches best, seen along whose normal it must not overhang; there properties are interpolated, too.
Lengths in m, base frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.rig import surface_axes
from kinid.errors import InputError
from kinid.mapping.interpolation import RIM, Interpolator, PlaneSites, on_plane
from kinid.mapping.interpolation.gaussian_process import interpolator
from kinid.mapping.property_map import Probe, PropertyMap
from kinid.mapping.shape.implicit import Hyperparameters, ImplicitSurface, Observations
from kinid.mapping.shape.touches import Touch, Touches
from kinid.robotics.surface import Plane

Array = NDArray[np.float64]

#: fewer touches say nothing of a shape
FEWEST = 4
#: so many places and components of normals make one surface at most
MOST_SEEN = 4000
#: cosine of the angle between a normal and the plane's: less, and the surface would overhang
OVERHANG = 0.2
#: cells of a sheet along its longer side
CELLS = 80
#: Newton's steps to the surface, from a touch's tangent plane; the last is no longer than this [m]
STEPS, CLOSE = 25, 1e-6


class Located(NamedTuple):
    """The surface over m places of the plane: points (m, 3), outward unit normals (m, 3), standard deviation along them
    (m,) [m], in which is what all touches may be off together; NaN where it has no point.
    """

    points: Array
    normals: Array
    sd: Array


class Sheet(NamedTuple):
    """The surface as triangles: its places along the plane's tangents (m, 2) [m], numbers of the corners of each
    triangle, counter-clockwise seen from outside, (k, 3), and where the places are.
    """

    flat: Array
    faces: NDArray[np.int64]
    located: Located


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface and its properties; make it with `fit`.

    Attributes:
        touches: what it was learnt from. implicit: the surface as a zero set.
    """

    touches: Touches
    implicit: ImplicitSurface
    _fitted: dict[str, Interpolator] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def fit(cls, touches: Touches, near: Hyperparameters | None = None) -> Shape:
        """Learn the surface.

        Args:
            touches: of all logs. near: what a shape of nearly the same touches learnt, which saves time.

        Raises:
            InputError: fewer than `FEWEST` touches or too many, touches in one line, or normals to several sides.
        """
        plane = _plane(touches)
        every = touches.touches
        if (rows := sum(1 + 3 * len(touch.along) for touch in every)) > MOST_SEEN:
            raise InputError(
                f"{len(every)} touches with {rows} numbers of places and normals",
                f"{MOST_SEEN} at most, as the time of a surface grows with their cube",
                "make surfaces of parts",
            )
        seen = Observations(
            touches.places,
            np.zeros(len(every)),
            np.array([touch.place_sd for touch in every]),
            np.concatenate([touch.along for touch in every]),
            np.concatenate([touch.normals for touch in every]),
        )
        return cls(touches, ImplicitSurface.fit(plane, seen, near).outside(touches.air, touches.tip_radius))

    @property
    def plane(self) -> Plane:
        """Through the middle of the touches; its normal is the mean of theirs."""
        return self.implicit.plane

    @cached_property
    def sites(self) -> Array:
        """Where the touches are along both tangents of the plane [m], (n, 2)."""
        return np.asarray((self.touches.places - self.plane.point) @ self.plane.axes[:2].T)

    @property
    def common(self) -> float:
        """What all touches may be early or late together, because the material's law shifts every onset alike [m]."""
        return float(np.mean([touch.place_sd for touch in self.touches.touches]))

    @property
    def place_error(self) -> float:
        """What a touch leaves open of its own place along the normal, standard deviation [m]."""
        own = float(np.median([touch.place_sd for touch in self.touches.touches]))
        return float(np.hypot(own, self.implicit.learnt.roughness))

    @cached_property
    def grown(self) -> PropertyMap:
        """The touches as probes of a map on the plane."""
        probes = tuple(touch.probe for touch in self.touches.touches)
        return PropertyMap(self.plane, self.touches.properties, probes, self.touches.model)

    @cached_property
    def left_out(self) -> Array:
        """How far along its normal each touch lies from the surface that the others give [m], (n,)."""
        ends = np.cumsum([0, *(len(touch.along) for touch in self.touches.touches)])
        return self.implicit.left_out([np.arange(a, b) for a, b in zip(ends[:-1], ends[1:])])

    def at(self, queries: ArrayLike) -> Located:
        """The surface over places (m, 2) along the plane's tangents [m]: Newton's method along the plane's normal."""
        from scipy.spatial import cKDTree

        q = on_plane(queries)
        normals = self.touches.normals @ self.plane.axes.T
        near = cKDTree(self.sites).query(q)[1]
        height = -self.plane.locate(self.touches.places).depth[near]
        height -= np.einsum("mi,mi->m", normals[near, :2], q - self.sites[near]) / normals[near, 2]
        longest = 0.1 * float(np.linalg.norm(np.ptp(self.sites, axis=0)))
        below = self.plane.point + q @ self.plane.axes[:2]
        for _ in range(STEPS):
            points = below + height[:, None] * self.plane.normal
            value, slope = self.implicit.distance(points)
            rise = slope @ self.plane.normal
            step = np.clip(value / np.maximum(rise, OVERHANG), -longest, longest)
            if not (np.abs(step) > CLOSE).any():
                break
            height -= step
        size = np.linalg.norm(slope, axis=1)
        hole = np.where((np.abs(step) <= CLOSE) & (rise > 0.0), 0.0, np.nan)
        sd = np.hypot(self.implicit.sd(points) / size, self.common)
        return Located(points + hole[:, None], slope / size[:, None] + hole[:, None], sd + hole)

    def interpolator(self, name: str) -> Interpolator:
        """A property over places (m, 2) along the plane's tangents.

        Raises:
            InputError: no such property, or no touch that tells it.
        """
        if name not in self._fitted:
            values, noise = self.grown.values(name), self.grown.deviations(name)
            tells = np.isfinite(values)
            if not tells.any():
                raise InputError(f"no touch that tells {name}", "one at least", "press deeper, or fit another model")
            sites = PlaneSites(self.sites[tells], reach=float(np.linalg.norm(np.ptp(self.sites, axis=0))))
            self._fitted[name] = interpolator("triangles", sites, values[tells], noise[tells])
        return self._fitted[name]

    def over_grid(self, cells: int = CELLS, edge: float = 0.0) -> tuple[Array, NDArray[np.int64]]:
        """Places of a grid between the touches and within `edge` [m] around them, (m, 2), and corners of its triangles,
        (k, 3).
        """
        from scipy.spatial import ConvexHull

        low, high = self.sites.min(axis=0) - edge, self.sites.max(axis=0) + edge
        counts = np.maximum(2, np.round((high - low) / (high - low).max() * cells).astype(int) + 1)
        x, y = np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, counts)), indexing="ij")
        q = np.column_stack([x.ravel(), y.ravel()])
        number = np.arange(len(q)).reshape(x.shape)
        a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
        faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        sides = ConvexHull(self.sites).equations
        known = (q @ sides[:, :2].T + sides[:, 2]).max(axis=1) <= edge + 1e-9
        return _used(q, faces[known[faces].all(axis=1)])

    def sheet(self, cells: int = CELLS) -> Sheet:
        """The surface between the touches, and around them as far as a map's guess is known beyond its probes.

        Raises:
            InputError: touches between which no surface is found.
        """
        q, faces = self.over_grid(cells, RIM * PlaneSites(self.sites).spacing)
        located = self.at(q)
        faces = faces[np.isfinite(located.sd)[faces].all(axis=1)]
        if not len(faces):
            raise InputError(
                "touches between which no surface is found", "touches of one surface", "touch closer together"
            )
        used, number = np.unique(faces, return_inverse=True)
        return Sheet(q[used], number.reshape(-1, 3), Located(*(part[used] for part in located)))

    def supposed(self, place: Array, values: Array) -> Shape:
        """As if one more touch, where the surface is expected (3,), had found `values` (p,); nothing is learnt anew."""
        slope = self.implicit.distance(place[None])[1][0]
        normal = slope / np.linalg.norm(slope)
        variances = np.median([np.diag(touch.probe.covariance) for touch in self.touches.touches], axis=0)
        sd = float(np.median([touch.place_sd for touch in self.touches.touches]))
        touch = Touch(Probe(place, values, np.diag(variances)), normal, sd, place[None], normal[None])
        touches = replace(self.touches, touches=(*self.touches.touches, touch))
        return Shape(touches, self.implicit.added(place, normal, sd))


def _plane(touches: Touches) -> Plane:
    """That the surface is read out over."""
    places, normals = touches.places, touches.normals
    if len(places) < FEWEST:
        raise InputError(f"{len(places)} touches", f"{FEWEST} at least, not in one line", "touch at more places")
    mean = normals.mean(axis=0)
    steepest = float((normals @ mean).min() / max(float(np.linalg.norm(mean)), 1e-9))
    if steepest < OVERHANG:
        turned, most = np.rad2deg(np.arccos(np.clip([steepest, OVERHANG], -1.0, 1.0)))
        raise InputError(
            f"touches whose normals turn up to {turned:.0f}° from their mean",
            f"touches from one side, {most:.0f}° at most",
            "make a surface of each side",
        )
    plane = Plane(places.mean(axis=0), surface_axes(mean))
    flat = (places - plane.point) @ plane.axes[:2].T
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-2 * spread[0]:
        raise InputError("touches in one line", "touches beside it, too", "touch at more places")
    return plane


def _used(q: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Those of the places (m, 2) that triangles have for corners, and the triangles by their numbers."""
    used, number = np.unique(faces, return_inverse=True)
    return q[used], number.reshape(-1, 3)
