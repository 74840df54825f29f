"""The same three ways of guessing along a curved surface: distances and smoothness are those of the surface, not of
space.

Gaussian process: the stochastic equation (κ² − Δ) u = white noise, whose solutions have Matérn's covariance with ν = 1,
put on linear finite elements (Lindgren, Rue & Lindström, J. R. Stat. Soc. B 73, 2011). Biharmonic: the same with κ → 0,
whose energy is ∫ (Δu)². Nearest: along the edges (Dijkstra 1959), which are a few per cent longer than the shortest
way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError, near
from kinid.mapping.interpolation import MESH_METHODS, REACH, Guess, Interpolator, Mask, less_the_nearest
from kinid.mapping.interpolation.local_bias import local_bias, spread_over, unexplained
from kinid.mapping.interpolation.uniform import Uniform, uniform_value
from kinid.robotics.surface import Mesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import SuperLU

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: on meshes with more vertices the covariance of every vertex with itself is taken as that of a boundless plane
MOST_EXACT = 3000
#: a vertex is known while the process knows this share of its prior at least
IGNORANCE = 0.9


@dataclass(frozen=True, eq=False)
class MeshSites:
    """A mesh, and n probes on it, each a mixture of the three corners of its face.

    Attributes:
        mesh: the surface. places: on it, base frame [m], (n, 3). reach: how far a probe's word carries along the
            surface [m].
    """

    mesh: Mesh
    places: Array
    reach: float = float("nan")

    def __post_init__(self) -> None:
        if not np.isfinite(self.reach):
            object.__setattr__(self, "reach", REACH * self.spacing)

    def vertices(self, queries: ArrayLike) -> Index:
        """Vertex numbers that a map on this mesh can be asked about, (m,).

        Raises:
            InputError: places instead of numbers, or numbers that no vertex has.
        """
        q, n = np.asarray(queries), len(self.mesh.vertices)
        if q.size == 0:
            return np.zeros(0, dtype=np.int64)
        if q.dtype.kind not in "iu" or q.ndim > 1 or q.min() < 0 or q.max() >= n:
            what = f"numbers from {q.min()} to {q.max()}" if q.dtype.kind in "iu" else f"{q.dtype} of shape {q.shape}"
            raise InputError(
                f"{what} asked of a map on a mesh",
                f"vertex numbers, whole, 0 to {n - 1}, of shape (m,)",
                "name the vertices nearest to the places",
            )
        return np.atleast_1d(q).astype(np.int64)

    @cached_property
    def shares(self) -> csr_array:
        """How each place is made of vertices: sparse, (n, vertices)."""
        return shares(self.mesh, self.places)

    @cached_property
    def elements(self) -> tuple[csr_array, Array]:
        """Stiffness matrix of the Laplacian (cotangents) and lumped masses [m²], per vertex."""
        from scipy.sparse import coo_array

        v, f = self.mesh.vertices, self.mesh.faces
        n = len(v)
        sides = [v[f[:, (i + 2) % 3]] - v[f[:, (i + 1) % 3]] for i in range(3)]
        area = 0.5 * np.linalg.norm(np.cross(sides[0], sides[1]), axis=1)
        rows, columns, entries = [], [], []
        for i in range(3):
            for j in range(3):
                rows.append(f[:, i])
                columns.append(f[:, j])
                entries.append(np.einsum("ij,ij->i", sides[i], sides[j]) / (4.0 * area))
        stiffness = coo_array(
            (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)
        ).tocsc()
        mass = np.bincount(f.ravel(), np.repeat(area / 3.0, 3), minlength=n)
        return stiffness, np.maximum(mass, 1e-12 * area.mean())

    @cached_property
    def area(self) -> float:
        """Of the surface [m²]."""
        return float(self.elements[1].sum())

    @property
    def spacing(self) -> float:
        """Typical distance between neighbours [m]."""
        if len(self.places) < 3:
            return 0.01
        from scipy.spatial import cKDTree

        # of probes at random the nearest are too close to tell the holes; the far ones among them are not
        return float(np.quantile(cKDTree(self.places).query(self.places, k=2)[0][:, 1], 0.9))

    @cached_property
    def nearest(self) -> tuple[Index, Array]:
        """For every vertex: number of the nearest probe along the surface, and how far it is [m]."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import dijkstra

        v, f, n = self.mesh.vertices, self.mesh.faces, len(self.mesh.vertices)
        start, end = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]).T
        low, high = np.minimum(start, end), np.maximum(start, end)
        pairs = np.unique(np.column_stack([low, high]), axis=0)
        length = np.linalg.norm(v[pairs[:, 0]] - v[pairs[:, 1]], axis=1)
        # each probe is a vertex of its own, joined to the corners of its face
        parts = self.shares.tocoo()
        probe, corner = parts.coords
        spoke = np.maximum(np.linalg.norm(self.places[probe] - v[corner], axis=1), 1e-12)
        size = n + len(self.places)
        graph = coo_array(
            (
                np.concatenate([length, spoke]),
                (np.concatenate([pairs[:, 0], n + probe]), np.concatenate([pairs[:, 1], corner])),
            ),
            shape=(size, size),
        ).tocsr()
        distance, _, source = dijkstra(
            graph, directed=False, indices=np.arange(n, size), min_only=True, return_predecessors=True
        )
        return np.where(source[:n] >= n, source[:n] - n, 0).astype(np.int64), distance[:n]


def shares(mesh: Mesh, places: Array) -> csr_array:
    """How places on a mesh, (m, 3), are made of its vertices: barycentric coordinates, sparse (m, vertices)."""
    from scipy.sparse import coo_array

    from kinid.kernels.mesh import closest

    places = np.asarray(places, dtype=float).reshape(-1, 3)
    found = closest(places, mesh.tree)
    corners = mesh.faces[found.face]
    a, b, c = np.moveaxis(mesh.vertices[corners], 1, 0)
    normal = np.cross(b - a, c - a)
    square = np.einsum("ij,ij->i", normal, normal)
    v = np.einsum("ij,ij->i", np.cross(found.point - a, c - a), normal) / square
    w = np.einsum("ij,ij->i", np.cross(b - a, found.point - a), normal) / square
    parts = np.clip(np.column_stack([1 - v - w, v, w]), 0.0, 1.0)
    parts /= parts.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(places)), 3)
    return coo_array((parts.ravel(), (rows, corners.ravel())), shape=(len(places), len(mesh.vertices))).tocsr()


@final
@dataclass(frozen=True, eq=False)
class MeshNearest(Interpolator):
    """The value of the probe that is nearest along the surface."""

    sample_sites: MeshSites
    values: Array

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """At vertices, by their numbers (m,)."""
        probe, distance = self.sample_sites.nearest
        q = self.sample_sites.vertices(queries)
        known: Mask = np.asarray(distance[q] <= self.sample_sites.reach)
        return Guess(np.where(known, self.values[probe[q]], np.nan), np.full(len(q), np.nan), known)

    @property
    def left_out(self) -> Array:
        """Value less that of the nearest other probe: by straight distance, which close neighbours share, (n,)."""
        return less_the_nearest(self.sample_sites.places, self.values)


@final
@dataclass(frozen=True, eq=False)
class MeshProcess(Interpolator):
    """Gaussian process on the vertices of a mesh; `biharmonic` is its limit without a length and without uncertainty.

    Attributes:
        sample_sites, values, noise: of the probes. length: range √(8 ν)/κ [m], where the correlation has fallen to
            0.14. size: standard deviation of the property. states: whether it states its uncertainty. lasting: as of a
            `GaussianProcess`.
    """

    sample_sites: MeshSites
    values: Array
    noise: Array
    length: float
    size: float
    mean: float
    states: bool = True
    uniform: Uniform | None = None
    lasting: Array | None = None

    @classmethod
    def fit(cls, sample_sites: MeshSites, values: Array, noise: Array | None = None) -> MeshProcess:
        """Length and size by the marginal likelihood on a grid of lengths; the size in closed form but for the
        noise.
        """
        values = np.asarray(values, dtype=float)
        spread = float(np.std(values)) or max(abs(float(values[0])), 1.0)
        noise = np.full(len(values), 1e-3 * spread) if noise is None else np.asarray(noise, dtype=float)
        noise = np.clip(np.where(np.isfinite(noise), noise, 1e3 * spread), 1e-4 * spread, 1e3 * spread)
        mean = float(np.average(values, weights=1 / (noise**2 + spread**2)))
        best: tuple[float, float, float] | None = None
        widest = np.sqrt(sample_sites.area)
        for length in np.geomspace(max(1.5 * sample_sites.spacing, 0.02 * widest), 3 * widest, 7):
            unit = cls(sample_sites, values, noise, float(length), 1.0, mean)._between
            for size in spread * np.array([0.5, 1.0, 2.0, 4.0]):
                system = size**2 * unit + np.diag(noise**2)
                sign, logarithm = np.linalg.slogdet(system)
                y = values - mean
                value = 0.5 * float(y @ np.linalg.solve(system, y)) + 0.5 * logarithm
                if sign > 0 and (best is None or value < best[0]):
                    best = (value, float(length), float(size))
        assert best is not None
        uniform = uniform_value(values, noise, -best[0])
        if uniform is not None:
            flat = cls.biharmonic(sample_sites, values, np.hypot(noise, uniform.scatter))
            return replace(flat, mean=uniform.value, states=True, uniform=uniform)
        return cls(sample_sites, values, noise, best[1], best[2], mean)

    @classmethod
    def biharmonic(cls, sample_sites: MeshSites, values: Array, noise: Array | None = None) -> MeshProcess:
        """The surface of least ∫ (Δu)² through the values, softened where their noise asks for it."""
        values = np.asarray(values, dtype=float)
        spread = float(np.std(values)) or 1.0
        held = (
            np.full(len(values), 1e-4 * spread)
            if noise is None
            else np.maximum(np.nan_to_num(noise, posinf=1e3 * spread), 1e-4 * spread)
        )
        far = 30.0 * float(np.sqrt(sample_sites.area))
        return cls(sample_sites, values, held, far, 30.0 * spread, float(values.mean()), states=False)

    @cached_property
    def _solver(self) -> SuperLU:
        """Solves (κ² M + L) x = b."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        stiffness, mass = self.sample_sites.elements
        return splu((self._kappa2 * diags_array(mass) + stiffness).tocsc())

    @property
    def _kappa2(self) -> float:
        return 8.0 / self.length**2

    @cached_property
    def _columns(self) -> Array:
        """Covariance of every vertex with every probe for size 1, (vertices, n)."""
        _, mass = self.sample_sites.elements
        half = self._solver.solve(self.sample_sites.shares.toarray().T)
        # the covariance is τ⁻² (κ² M + L)⁻¹ M (κ² M + L)⁻¹, and that of a point with itself 1/(4 π κ² τ²) on a wide
        # plane
        return np.asarray(4 * np.pi * self._kappa2 * self._solver.solve(mass[:, None] * half))

    @cached_property
    def _between(self) -> Array:
        """Covariance of the probes with each other for size 1, (n, n)."""
        return np.asarray(self.sample_sites.shares @ self._columns)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.size**2 * self._between + np.diag(self.noise**2)))

    @cached_property
    def _vertices(self) -> tuple[Array, Array, Array]:
        """Mean, standard deviation and prior's standard deviation at every vertex."""
        if self.uniform is not None:
            every = np.ones(len(self.sample_sites.mesh.vertices))
            return self.uniform.value * every, self.uniform.standard_error * every, np.inf * every
        columns = self.size**2 * self._columns
        mean = self.mean + columns @ (self._inverse @ (self.values - self.mean))
        n = len(columns)
        prior = np.full(n, self.size**2)
        if n <= MOST_EXACT:
            _, mass = self.sample_sites.elements
            half = self._solver.solve(np.eye(n))
            prior = self.size**2 * 4 * np.pi * self._kappa2 * np.einsum("ij,i,ij->j", half, mass, half)
        explained = np.einsum("ij,jk,ik->i", columns, self._inverse, columns, optimize=True)
        return mean, np.sqrt(np.maximum(prior - explained, 0.0)), np.sqrt(prior)

    @cached_property
    def local_bias(self) -> Array:
        """What the mean may be off by at each probe, as the residuals around it say, (n,)."""
        residual, uniform = self.values - self.mean, self.uniform is not None
        if not uniform:
            residual = self.noise**2 * (self._inverse @ residual)
        return local_bias(self.sample_sites.places, residual, self.noise, self.sample_sites.spacing, uniform)

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """At vertices, by their numbers (m,)."""
        q = self.sample_sites.vertices(queries)
        known: Mask = np.asarray(self.sample_sites.nearest[1][q] <= self.sample_sites.reach)
        if not self.states:
            mean = self.mean + self.size**2 * self._columns[q] @ (self._inverse @ (self.values - self.mean))
            return Guess(np.where(known, mean, np.nan), np.full(len(q), np.nan), known)
        mean, deviation, prior = (part[q] for part in self._vertices)
        known &= deviation <= IGNORANCE * prior
        places, at = self.sample_sites.places, self.sample_sites.mesh.vertices[q]
        if self.uniform is None:
            off = unexplained(self.left_out, self.noise)
            deviation = np.maximum(deviation, spread_over(places, off, at, self.sample_sites.spacing, self.values))
        lasting = 0.0 if self.lasting is None else self.lasting
        deviation = np.hypot(deviation, spread_over(places, np.maximum(self.local_bias, lasting), at))
        return Guess(np.where(known, mean, np.nan), np.where(known, deviation, np.nan), known)

    @property
    def left_out(self) -> Array:
        """Weight over the diagonal of the inverse, (n,)."""
        return np.asarray((self._inverse @ (self.values - self.mean)) / np.diag(self._inverse))


def on_mesh(
    method: str, sample_sites: MeshSites, values: Array, noise: Array | None = None, lasting: Array | None = None
) -> Interpolator:
    """One of `kinid.mapping.interpolation.MESH_METHODS` along a mesh; arguments as of `interpolator`.

    Raises:
        InputError: no such method.
    """
    if method == "nearest":
        return MeshNearest(sample_sites, np.asarray(values, dtype=float))
    if method == "biharmonic":
        return MeshProcess.biharmonic(sample_sites, values, noise)
    if method == "gp":
        return replace(MeshProcess.fit(sample_sites, values, noise), lasting=lasting)
    raise InputError(f"method '{method}'", f"one of {', '.join(MESH_METHODS)}", near(method, MESH_METHODS))
