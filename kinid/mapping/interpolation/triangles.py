"""Piecewise linear over triangles whose edges run along borders: what a few pokes beside a border say about all of it.

Delaunay's triangles know places only. Here edges are flipped while that lowers the total variation of the surface, so
that they come to lie along a border and not across it (data-dependent triangulation: Dyn, Levin & Rippa, IMA J. Numer.
Anal. 10, 1990). Between its corners a place is like each of them with its barycentric coordinate as the probability:
that is the mean of a border that may be anywhere between, and the spread of that mixture is the uncertainty stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.mapping.interpolation import RIM, Guess, Interpolator, PlaneSites, Prior, expected, on_plane
from kinid.mapping.interpolation.local_bias import spread_over, unexplained
from kinid.mapping.interpolation.segments import scaled

Array = NDArray[np.float64]
Index = NDArray[np.int64]
#: coordinates and height
Point = tuple[float, float, float]

#: a flip lowers the variation by this share at least; an edge is looked at so many times at most
LOWER, SWEEPS = 1e-6, 20
#: a step this large may hide in a triangle whose corners are alike (of logarithms, else of the values' spread)
BASE = 0.03


@final
@dataclass(frozen=True, eq=False)
class Triangles(Interpolator):
    """Over n probes; logarithms of the values are interpolated where all are surely positive.

    Attributes:
        sample_sites: places. values: (n,). noise: standard deviation of each (n,). prior: what was expected before.
        lasting: the part of each probe's error that no further probe averages away, (n,).
    """

    sample_sites: PlaneSites
    values: Array
    noise: Array
    prior: Prior | None = None
    lasting: Array | None = None

    @cached_property
    def logarithmic(self) -> bool:
        """Whether logarithms are interpolated."""
        return bool(np.all(self.values > 3.0 * self.noise) and np.all(self.values > 0.0))

    @cached_property
    def heights(self) -> tuple[Array, Array]:
        """What is interpolated, values on their scale, and its standard deviation, (n,) both."""
        return scaled(self.values, self.noise)

    @cached_property
    def surprise(self) -> float:
        """How far the probes lie from what the prior expects, over its standard deviation; 1 at least."""
        if self.prior is None:
            return 1.0
        mean, sd = expected(self.prior, self.sample_sites.places, self.logarithmic)
        away = ((self.heights[0] - mean) / sd)[np.isfinite(mean)]
        return max(1.0, float(np.sqrt(np.mean(away**2)))) if len(away) else 1.0

    def between(self, q: Array) -> tuple[Array, Array]:
        """Mean and variance on the scale that is interpolated, at places (m, 2), known or not, (m,) both.

        The prior and the triangles are two witnesses, weighed by their variances: where probes around agree they
        decide, where a border runs between them the prior does. One that the probes contradict counts for less.
        """
        places, height, noise = self.framed
        number, share = locate(places, self.corners, q)
        h, s = height[number], noise[number]
        mean = np.sum(share * h, axis=1)
        variance = np.sum(share * (h - mean[:, None]) ** 2 + (share * s) ** 2, axis=1)
        variance += (
            1.5 * self._base**2 * (1.0 - np.sum(share**2, axis=1))
        )  # nothing at a corner, base² in a triangle's middle
        if self.prior is None:
            return mean, variance
        before, sd = expected(self.prior, q, self.logarithmic)
        finite = np.isfinite(before)
        weight = np.where(
            finite, variance / (variance + (self.surprise * np.where(finite, sd, 1.0)) ** 2 + 1e-300), 0.0
        )
        return np.where(finite, mean + weight * (np.where(finite, before, 0.0) - mean), mean), (1.0 - weight) * variance

    def halfway(self, steps: Array, q: Array) -> Array:
        """Standard deviation half-way between two places whose heights differ by steps (m,) if nothing else is near,
        (m,).
        """
        variance = 0.25 * steps.ravel() ** 2 + self._base**2
        if self.prior is None:
            return np.asarray(np.sqrt(variance))
        sd = self.surprise * expected(self.prior, q, self.logarithmic)[1]
        return np.asarray(1.0 / np.sqrt(1.0 / variance + 1.0 / np.where(np.isfinite(sd), sd, np.inf) ** 2))

    @property
    def _base(self) -> float:
        return BASE * (1.0 if self.logarithmic else float(np.std(self.values)))

    @cached_property
    def framed(self) -> tuple[Array, Array, Array]:
        """Places, heights and their noise with a frame's four corners around, which stand as the nearest probe does."""
        from scipy.spatial import cKDTree

        places, (height, noise) = self.sample_sites.places, self.heights
        edge = RIM * self.sample_sites.spacing
        (a, b), (c, d) = places.min(axis=0) - edge, places.max(axis=0) + edge
        frame = np.array([[a, b], [a, d], [c, b], [c, d]])
        near = cKDTree(places).query(frame)[1]
        return np.vstack([places, frame]), np.append(height, height[near]), np.append(noise, noise[near])

    @cached_property
    def corners(self) -> Index:
        """Of the triangles over `framed` places, counterclockwise, (k, 3)."""
        return triangulate(*self.framed[:2])

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """Linear in its triangle, on the scale that is interpolated."""
        q = on_plane(queries)
        mean, variance = self.between(q)
        if self.logarithmic:
            mean = np.exp(mean)
            variance = mean**2 * variance
        known = self.sample_sites.known(q)
        deviation = np.full(len(q), np.nan)
        if sd:
            places, spacing = self.sample_sites.places, self.sample_sites.spacing
            deviation = np.maximum(np.sqrt(variance), spread_over(places, self._unlike, q, spacing, self.values))
            if self.lasting is not None:
                deviation = np.hypot(deviation, spread_over(places, self.lasting, q))
        return Guess(np.where(known, mean, np.nan), np.where(known, deviation, np.nan), known)

    @cached_property
    def _unlike(self) -> Array:
        """What each probe's neighbours don't say of it, (n,); a prior does where there is one."""
        if self.prior is not None:
            return np.zeros(len(self.values))
        return unexplained(self.left_out, self.noise)

    @property
    def left_out(self) -> Array:
        """Value less what its neighbours in the triangulation say of its place without it, (n,)."""
        places, height, _ = self.framed
        out = np.full(len(self.values), np.nan)
        around: list[set[int]] = [set() for _ in range(len(places))]
        for corner in self.corners.tolist():
            for i in corner:
                around[i].update(corner)
        for i, ring in enumerate(around[: len(out)]):
            # the frame's corners know what the probe says
            others = np.array(sorted(j for j in ring if j != i and j < len(out)), dtype=np.int64)
            if len(others) == 0:
                continue
            number, share = locate(places[others], triangulate(places[others], height[others]), places[i : i + 1])
            guess = float(share[0] @ height[others][number[0]])
            out[i] = self.values[i] - (np.exp(guess) if self.logarithmic else guess)
        return out


def triangulate(places: Array, heights: Array) -> Index:
    """Triangles over places (n, 2) whose edges are flipped until the variation of heights (n,) falls no further, (k,
    3).
    """
    from scipy.spatial import Delaunay, QhullError

    if len(places) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    try:
        corners: Index = np.asarray(Delaunay(places).simplices, dtype=np.int64)
    except QhullError:  # in one line
        return np.zeros((0, 3), dtype=np.int64)
    a, b, c = (places[corners[:, k]] for k in range(3))
    turned = _cross(b - a, c - a) < 0
    corners[turned] = corners[turned][:, [0, 2, 1]]
    scale = float(np.ptp(places, axis=0).max()) or 1.0
    _flip(corners, (places - places.mean(axis=0)) / scale, heights)
    return corners


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _flip(corners: Index, places: Array, heights: Array) -> None:
    """Flip edges in place (Lawson's swaps, with the variation of both triangles as their cost)."""
    points = [(float(x), float(y), float(h)) for (x, y), h in zip(places, heights)]
    triangles: list[list[int]] = corners.tolist()
    beside: dict[tuple[int, int], list[int]] = {}
    for k, t in enumerate(triangles):
        for i in range(3):
            beside.setdefault(_edge(t[i], t[i - 1]), []).append(k)
    queue = [edge for edge, both in beside.items() if len(both) == 2]
    left = SWEEPS * len(queue)
    while queue and left > 0:
        left -= 1
        edge = queue.pop()
        k, m = beside.get(edge, [0])[:2] if len(beside.get(edge, [])) == 2 else (-1, -1)
        if k < 0:
            continue
        a, b = edge
        c = next(i for i in triangles[k] if i not in edge)
        d = next(i for i in triangles[m] if i not in edge)
        old = _variation(points[a], points[b], points[c])[0] + _variation(points[a], points[b], points[d])[0]
        (first, side1), (second, side2) = (_variation(points[c], points[d], points[i]) for i in (a, b))
        # both triangles of a convex quadrangle lie on either side of the new edge
        if side1 * side2 >= 0 or min(abs(side1), abs(side2)) < 1e-9 or first + second >= old * (1 - LOWER) - 1e-15:
            continue
        triangles[k] = [c, d, a] if side1 > 0 else [d, c, a]
        triangles[m] = [c, d, b] if side2 > 0 else [d, c, b]
        del beside[edge]
        beside[_edge(c, d)] = [k, m]
        for i, j, before, now in ((a, d, m, k), (b, c, k, m)):
            pair = beside[_edge(i, j)]
            pair[pair.index(before)] = now
        queue += [e for e in (_edge(a, c), _edge(a, d), _edge(b, c), _edge(b, d)) if len(beside[e]) == 2]
    corners[:] = triangles


def _edge(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i < j else (j, i)


def _variation(p: Point, q: Point, r: Point) -> tuple[float, float]:
    """Slope times area of a triangle, and twice its area, positive where it turns counterclockwise."""
    x1, y1, h1 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    x2, y2, h2 = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    gx, gy = h1 * y2 - h2 * y1, h2 * x1 - h1 * x2
    return float(0.5 * (gx * gx + gy * gy) ** 0.5), x1 * y2 - x2 * y1


def locate(places: Array, corners: Index, q: Array) -> tuple[Index, Array]:
    """The three probes around each query and its barycentric coordinates, (m, 3) both; outside, the nearest one with
    1.
    """
    from scipy.spatial import cKDTree

    number = np.repeat(cKDTree(places).query(q)[1][:, None], 3, axis=1).astype(np.int64)
    share = np.tile([1.0, 0.0, 0.0], (len(q), 1))
    if not len(corners):
        return number, share
    tree, triangle = cKDTree(q), places[corners]
    centre = triangle.mean(axis=1)
    reach = np.linalg.norm(triangle - centre[:, None], axis=2).max(axis=1)
    for corner, (a, b, c), inside in zip(corners, triangle, tree.query_ball_point(centre, reach * (1 + 1e-9))):
        area = _cross(b - a, c - a)
        if not inside or area <= 0:
            continue
        p = q[inside]
        beta, gamma = _cross(p - a, c - a) / area, _cross(b - a, p - a) / area
        hit = (beta >= -1e-9) & (gamma >= -1e-9) & (beta + gamma <= 1 + 1e-9)
        rows = np.asarray(inside)[hit]
        number[rows] = corner
        share[rows] = np.clip(np.column_stack([1 - beta - gamma, beta, gamma])[hit], 0.0, 1.0)
    return number, share
