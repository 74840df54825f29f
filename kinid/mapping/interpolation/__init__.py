"""From estimates at places to guesses anywhere: nearest, biharmonic, triangles, Gaussian process; each says how well it
does.

All of them stand on `sample_sites`, which know how places lie to each other: Euclidean on a plane (`PlaneSites`), along
the surface on a mesh (`kinid.mapping.interpolation.mesh.MeshSites`). Where there is nothing near, a guess is unknown,
not invented.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError
from kinid.mapping.interpolation.uniform import Uniform

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

METHODS = ("gp", "triangles", "biharmonic", "nearest")
#: on a mesh
MESH_METHODS = ("gp", "biharmonic", "nearest")
#: the same in words
METHOD_WORDS = {
    "gp": "Gaussian process",
    "triangles": "flat triangles",
    "biharmonic": "biharmonic spline",
    "nearest": "nearest probe",
}
#: what is expected of places (m, 2) before they are touched: mean (NaN where nothing is) and standard deviation, (m,)
#: both
Prior = Callable[[Array], tuple[Array, Array]]
#: a guess is known within so many spacings of a probe; where probes lie in a grid every cell's middle is within 0.71
REACH = 1.25
#: beyond the hull of the probes a guess is known within this share of a spacing only
RIM = 0.5
#: a probe within this share of a spacing of the hull is an outermost one
AT_HULL = 0.25
#: nearer to a probe without a layer than this share of a spacing, the layer's border may run
WITHOUT = 0.95


@dataclass(frozen=True, eq=False)
class Guess:
    """What is expected at m places: mean and standard deviation (NaN where the method states none), and where it is
    known.
    """

    mean: Array
    sd: Array
    known: Mask


class Interpolator(ABC):
    """One property over a surface.

    Attributes:
        uniform: the one value of a property that is the same everywhere; None where it varies, or the method can't
            tell.
    """

    uniform: Uniform | None = None

    @abstractmethod
    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """What is expected at places: (m, 2) on a plane [m], vertex numbers (m,) on a mesh.

        Raises:
            InputError: something else than that.
        """

    @property
    @abstractmethod
    def left_out(self) -> Array:
        """Value less what the other probes say of its place, (n,)."""

    @property
    def left_out_error(self) -> float:
        """Root mean square of `left_out`."""
        residual = self.left_out[np.isfinite(self.left_out)]
        return float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan")


@dataclass(frozen=True, eq=False)
class PlaneSites:
    """Places of n probes on a plane [m], (n, 2), and how far their word carries [m]; default from their spacing.

    Those `without` what is mapped, as a layer that other probes show, say where it isn't known, (m, 2).
    """

    places: Array
    reach: float = float("nan")
    without: Array | None = None

    def __post_init__(self) -> None:
        places = np.ascontiguousarray(self.places, dtype=float)
        if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all() or not len(places):
            raise InputError(
                f"places of shape {places.shape} that are perhaps no numbers",
                "one place at least, (n, 2) [m]",
                "leave out what has no place",
            )
        object.__setattr__(self, "places", places)
        if not np.isfinite(self.reach):
            object.__setattr__(self, "reach", REACH * self.spacing)

    @property
    def spacing(self) -> float:
        """Typical distance between neighbours [m]."""
        n = len(self.places)
        if n == 1:
            return 0.01
        from scipy.spatial import cKDTree

        nearest = cKDTree(self.places).query(self.places, k=2)[0][:, 1]
        if n < 4 or self._hull is None:
            return float(np.max(nearest)) or 0.01
        # nearest neighbours alone are too close where probes lie at random; a share of the area alone is where they lie
        # in lines
        return float(max(np.quantile(nearest, 0.5), np.sqrt(self._hull.volume / n)))

    @cached_property
    def _hull(self) -> ConvexHull | None:
        """Convex hull of the places; None where they lie in one line."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            return ConvexHull(self.places) if len(self.places) > 3 else None
        except QhullError:
            return None

    def known(self, queries: Array) -> Mask:
        """Whether probes are near enough to a place to say something, (m,)."""
        from scipy.spatial import cKDTree

        distance = cKDTree(self.places).query(queries)[0]
        if self.without is not None and len(self.without):
            lacking = cKDTree(self.without).query(queries)[0] < WITHOUT * self.spacing
            distance = np.where(lacking, np.inf, distance)
        if self._hull is None:
            return np.asarray(distance <= RIM / REACH * self.reach)
        return np.asarray((distance <= self.reach) & (self.beyond(queries) <= RIM / REACH * self.reach))

    @property
    def bordering(self) -> Mask:
        """Which probes have a neighbour `without` what is mapped, (n,)."""
        from scipy.spatial import cKDTree

        if self.without is None or not len(self.without):
            return np.zeros(len(self.places), np.bool_)
        return np.asarray(cKDTree(self.without).query(self.places)[0] <= REACH * self.spacing)

    @property
    def outermost(self) -> Mask:
        """Which probes lie at their hull, (n,): all where they lie in one line."""
        if self._hull is None:
            return np.ones(len(self.places), np.bool_)
        return np.asarray(self.beyond(self.places) > -AT_HULL * self.spacing)

    def beyond(self, queries: Array) -> Array:
        """How far places lie outside the hull [m], (m,); negative within it, 0 where probes span none."""
        if self._hull is None:
            return np.zeros(len(queries))
        faces = self._hull.equations
        return np.asarray((queries @ faces[:, :2].T + faces[:, 2]).max(axis=1))


@final
@dataclass(frozen=True, eq=False)
class Nearest(Interpolator):
    """The value of the nearest probe; no uncertainty is stated."""

    sample_sites: PlaneSites
    values: Array

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """As the nearest probe."""
        from scipy.spatial import cKDTree

        q = on_plane(queries)
        at = cKDTree(self.sample_sites.places).query(q)[1]
        return _guess(self.values[at], np.full(len(q), np.nan), self.sample_sites.known(q))

    @property
    def left_out(self) -> Array:
        """Value less that of the nearest other probe, (n,)."""
        return less_the_nearest(self.sample_sites.places, self.values)


def less_the_nearest(places: Array, values: Array) -> Array:
    """Each value less that of the nearest other place by straight distance, (n,); NaN where there is no other."""
    from scipy.spatial import cKDTree

    if len(values) < 2:
        return np.full(len(values), np.nan)
    at = cKDTree(places).query(places, k=2)[1]
    other = np.where(at[:, 0] == np.arange(len(values)), at[:, 1], at[:, 0])
    return np.asarray(values - values[other])


#: shares of the largest Green's value that are tried as smoothing; the first is none: the values are met exactly
SMOOTHING = (0.0, 1e-4, 1e-3, 1e-2, 1e-1)


@final
@dataclass(frozen=True, eq=False)
class Biharmonic(Interpolator):
    """Green's function of the biharmonic operator, r² (ln r − 1), and a plane (Sandwell, Geophys. Res. Lett. 14, 1987).

    The weights have no constant and no linear part, so that neither the unit of length nor the origin matters: without
    that condition (as in MATLAB's "v4") both do. With noise stated, the smoothing of the probes in proportion to their
    variances is the one that leaving out each in turn likes best; without noise, values are met exactly.
    """

    sample_sites: PlaneSites
    values: Array
    noise: Array | None = None

    def __post_init__(self) -> None:
        places = self.sample_sites.places
        scale = float(np.ptp(places, axis=0).max()) or 1.0
        centre = places.mean(axis=0)
        unit = (places - centre) / scale
        n = len(unit)
        rank = np.linalg.matrix_rank(np.column_stack([np.ones(n), unit]), tol=1e-6) if n > 1 else 1
        trend = np.column_stack([np.ones(n), unit])[:, : 3 if rank == 3 else 1]
        k = trend.shape[1]
        best: tuple[float, Array, Array] | None = None
        weights = np.ones(n) if self.noise is None else (self.noise / np.sqrt(np.mean(self.noise**2))) ** 2
        for share in SMOOTHING if self.noise is not None and n > 4 else SMOOTHING[:1]:
            system = np.zeros((n + k, n + k))
            system[:n, :n] = _green(unit, unit)
            system[np.arange(n), np.arange(n)] += share * weights + 1e-12
            system[:n, n:], system[n:, :n] = trend, trend.T
            inverse = np.linalg.inv(system)
            solution = inverse[:, :n] @ self.values
            with np.errstate(divide="ignore", invalid="ignore"):
                left_out = solution[:n] / np.diag(inverse)[:n]
            press = float(np.mean(left_out**2)) if np.isfinite(left_out).all() else np.inf
            if best is None or press < best[0]:
                best = (press, solution, left_out)
        assert best is not None
        object.__setattr__(self, "_frame", (centre, scale))
        object.__setattr__(self, "_solution", best[1])
        object.__setattr__(self, "_left_out", best[2] if n > k + 1 else np.full(n, np.nan))

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """The spline; no uncertainty is stated."""
        q = on_plane(queries)
        centre, scale = self._frame  # type: ignore[attr-defined]
        unit, own = (q - centre) / scale, (self.sample_sites.places - centre) / scale
        solution: Array = self._solution  # type: ignore[attr-defined]
        n = len(own)
        mean = np.empty(len(q))
        for a in range(0, len(q), 4096):
            rows = slice(a, a + 4096)
            trend = np.column_stack([np.ones(len(unit[rows])), unit[rows]])[:, : len(solution) - n]
            mean[rows] = _green(unit[rows], own) @ solution[:n] + trend @ solution[n:]
        return _guess(mean, np.full(len(q), np.nan), self.sample_sites.known(q))

    @property
    def left_out(self) -> Array:
        """In closed form: a weight over its diagonal of the inverse (Wahba 1990, § 4.2), (n,)."""
        out: Array = self._left_out  # type: ignore[attr-defined]
        return out


def on_plane(queries: ArrayLike) -> Array:
    """Places that a map on a plane can be asked about, (m, 2) [m]; one place alone may be (2,).

    Raises:
        InputError: another shape, or what is no finite number.
    """
    try:
        q = np.asarray(queries, dtype=float)
    except (TypeError, ValueError):
        raise InputError(
            "places that are no numbers", "(m, 2) along the plane's tangents [m]", "correct them"
        ) from None
    if q.size and (q.ndim > 2 or q.shape[-1] != 2):
        raise InputError(
            f"places of shape {q.shape}",
            "(m, 2) along the plane's tangents [m]",
            "turn points in the base frame into them with PropertyMap.flat",
        )
    q = q.reshape(-1, 2)
    bad = ~np.isfinite(q).all(axis=1)
    if bad.any():
        raise InputError(
            f"{bad.sum()} of {len(q)} places that are not finite, the first in row {int(bad.argmax())}",
            "finite coordinates along the plane's tangents [m]",
            "leave them out",
        )
    return q


def _green(a: Array, b: Array) -> Array:
    """r² (ln r − 1) between places, (m, n)."""
    square = (a[:, 0, None] - b[:, 0]) ** 2
    square += (a[:, 1, None] - b[:, 1]) ** 2
    out: Array = square * (0.5 * np.log(square + 1e-300) - 1.0)
    return out


def _guess(mean: Array, sd: Array, known: Mask) -> Guess:
    return Guess(np.where(known, mean, np.nan), np.where(known, sd, np.nan), known)


def expected(prior: Prior, q: Array, logarithmic: bool) -> tuple[Array, Array]:
    """What a prior says of places (m, 2), as logarithms if asked, mean and standard deviation (m,); NaN where it says
    nothing.
    """
    mean, sd = prior(q)
    finite = np.isfinite(mean) & (sd > 0) & (mean > 0 if logarithmic else True)
    if logarithmic:
        mean, sd = np.log(np.where(finite, mean, 1.0)), sd / np.where(finite, mean, 1.0)
    return np.where(finite, mean, np.nan), np.where(finite, sd, np.nan)
