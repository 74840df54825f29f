"""A surface as the zero set of a Gaussian process over space, learnt from points on it and normals there.

f(x) is the signed distance as far as the data say: 0 on the surface, > 0 in the air, with the outward unit normal as
its gradient. Prior: the distance to a plane and a stationary covariance σ² φ(s) beside it, s = |x − x'|²/ℓ². With the
derivatives of φ, and d = (x − x')/ℓ,

    cov(f, f') = σ² φ,   cov(f, ∂ⱼf') = −2 σ² φ' dⱼ / ℓ,   cov(∂ᵢf, ∂ⱼf') = −σ² (4 φ'' dᵢ dⱼ + 2 φ' δᵢⱼ) / ℓ²

Implicit surfaces by Gaussian processes: O. Williams, A. Fitzgibbon, Gaussian Processes in Practice, 2007; with touches
and
normals: S. Dragiev, M. Toussaint, M. Gienger, ICRA 2011. Derivatives as observations: Rasmussen & Williams, Gaussian
Processes for Machine Learning, 2006, §9.4. Lengths in m, base frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.mapping.interpolation.covariance import IMPOSSIBLE, inverted
from kinid.mapping.interpolation.uniform import sample_of
from kinid.parallel import one_blas_thread
from kinid.robotics.surface import Plane

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Matérn's smoothness that data choose from; the last is the limit, the squared exponential
SMOOTHNESS = (2.5, 3.5, float("inf"))
#: what the likelihood may choose: length over the extent of the points; size and roughness over their spread about the
#: plane; error of a normal [rad]
LENGTHS, SIZES, ROUGHNESS, TILTS = (0.05, 5.0), (1e-2, 1e2), (1e-4, 0.5), (1e-3, 0.5)
#: queries are answered in blocks of so many, which bounds the memory
BLOCK = 1024
#: points in the air count where the surface contradicts them by so many of its standard deviations
CONTRADICTS = 2.0
#: of those, one at a time is added, so many at most
MOST_ADDED = 40


class Hyperparameters(NamedTuple):
    """What likelihood has chosen: ν, length ℓ [m], size σ of f [m], roughness [m] and tilt [rad], the standard
    deviations of what a point's place and a normal have beyond the stated.
    """

    smoothness: float
    length: float
    size: float
    roughness: float
    tilt: float


@dataclass(frozen=True, eq=False)
class Observations:
    """Of f at `places` (a, 3): `values` (a,) [m] with standard deviations `sd` (a,); of its gradient at `turned` (b,
    3): unit `normals` (b, 3).
    """

    places: Array
    values: Array
    sd: Array
    turned: Array
    normals: Array

    def some(self, values: Index, gradients: Index) -> Observations:
        """Those of some numbers."""
        return Observations(
            self.places[values], self.values[values], self.sd[values], self.turned[gradients], self.normals[gradients]
        )

    def with_value(self, place: Array, value: float, sd: float) -> Observations:
        """One more value."""
        return replace(
            self,
            places=np.vstack([self.places, place]),
            values=np.append(self.values, value),
            sd=np.append(self.sd, sd),
        )


@dataclass(frozen=True, eq=False)
class ImplicitSurface:
    """The process with all it has seen; make it with `fit`.

    Attributes:
        plane: prior's mean is the distance to it. seen: observations. learnt: hyperparameters.
    """

    plane: Plane
    seen: Observations
    learnt: Hyperparameters

    @classmethod
    @one_blas_thread()
    def fit(cls, plane: Plane, seen: Observations, near: Hyperparameters | None = None) -> ImplicitSurface:
        """The hyperparameters of largest marginal likelihood on the observations of `sample_of`.

        They are searched for from `near` on, which also fixes ν.
        """
        from scipy.optimize import minimize

        few = seen.some(sample_of(len(seen.places)), sample_of(len(seen.turned)))
        away, turned = _beside_plane(plane, few)
        extent = float(np.linalg.norm(np.ptp(seen.places, axis=0)))
        spread = float(np.sqrt(np.mean(away**2))) + 1e-3 * extent
        bounds = np.log(
            [
                [extent * share for share in LENGTHS],
                [spread * share for share in SIZES],
                [spread * share for share in ROUGHNESS],
                TILTS,
            ]
        )
        start = np.log([0.5 * extent, 2.0 * spread, 0.01 * spread, 0.02]) if near is None else np.log(near[1:])
        best: tuple[float, Hyperparameters] | None = None
        for kind in SMOOTHNESS if near is None else (near.smoothness,):
            found = minimize(
                _evidence,
                np.clip(start, *bounds.T),
                args=(kind, few, away, turned),
                jac=True,
                bounds=bounds,
                method="L-BFGS-B",
                options={"maxiter": 40, "ftol": 1e-7},
            )
            if best is None or found.fun < best[0]:
                best = (float(found.fun), Hyperparameters(kind, *(float(v) for v in np.exp(found.x))))
        assert best is not None
        return cls(plane, seen, best[1])

    @cached_property
    def _factor(self) -> Array:
        from scipy.linalg import cholesky

        system = _covariance(self.learnt, self.seen, self.seen)
        system[np.diag_indices_from(system)] += _noise(self.learnt, self.seen)
        return np.asarray(cholesky(system, lower=True, check_finite=False))

    @cached_property
    def _weights(self) -> Array:
        from scipy.linalg import cho_solve

        away, turned = _beside_plane(self.plane, self.seen)
        return np.asarray(cho_solve((self._factor, True), np.concatenate([away, turned.ravel()]), check_finite=False))

    def distance(self, queries: Array) -> tuple[Array, Array]:
        """Mean of f [m], (m,), and its gradient, (m, 3), at places (m, 3)."""
        parts = [self._distance(queries[rows]) for rows in _blocks(len(queries))]
        return np.concatenate([f for f, _ in parts]), np.concatenate([g for _, g in parts])

    def _distance(self, x: Array) -> tuple[Array, Array]:
        a = len(self.seen.places)
        ell, size = self.learnt.length, self.learnt.size
        own, along = self._weights[:a], self._weights[a:].reshape(-1, 3)
        value, slope = -self.plane.locate(x).depth, np.tile(self.plane.normal, (len(x), 1))
        d, (phi, first, _) = _shape(self.learnt, x, self.seen.places)
        value += size**2 * phi @ own
        slope += size**2 * 2.0 / ell * np.einsum("mn,mni,n->mi", first, d, own, optimize=True)
        d, (_, first, second) = _shape(self.learnt, x, self.seen.turned)
        towards = np.einsum("mni,ni->mn", d, along)
        value -= size**2 * 2.0 / ell * np.sum(first * towards, axis=1)
        slope -= size**2 / ell**2 * (4.0 * np.einsum("mn,mni->mi", second * towards, d) + 2.0 * first @ along)
        return value, slope

    def sd(self, queries: Array) -> Array:
        """Standard deviation of f at places (m, 3) [m], (m,)."""
        from scipy.linalg import solve_triangular

        out = np.empty(len(queries))
        none = np.zeros((0, 3))
        for rows in _blocks(len(queries)):
            asked = Observations(queries[rows], np.zeros(0), np.zeros(0), none, none)
            across = _covariance(self.learnt, self.seen, asked)
            known = solve_triangular(self._factor, across, lower=True, check_finite=False)
            out[rows] = np.sqrt(np.maximum(self.learnt.size**2 - np.einsum("ij,ij->j", known, known), 0.0))
        return out

    def left_out(self, turned: Sequence[Index]) -> Array:
        """What the others leave of the values that come first in `seen`, each without its own gradients, (n,) [m].

        In closed form, block by block (Rasmussen & Williams 2006, §5.4.2).

        Args:
            turned: numbers of the gradients that go with each value.
        """
        from scipy.linalg import cho_solve

        inverse = cho_solve((self._factor, True), np.eye(len(self._factor)), check_finite=False)
        behind, out = len(self.seen.places), np.empty(len(turned))
        for i, own in enumerate(turned):
            block = np.concatenate([[i], (behind + 3 * own[:, None] + np.arange(3)).ravel()])
            out[i] = np.linalg.solve(inverse[np.ix_(block, block)], self._weights[block])[0]
        return out

    def added(self, place: Array, normal: Array, sd: float) -> ImplicitSurface:
        """With one more touch, without learning anew."""
        seen = self.seen.with_value(place, 0.0, sd)
        turned, normals = np.vstack([seen.turned, place]), np.vstack([seen.normals, normal])
        return replace(self, seen=replace(seen, turned=turned, normals=normals))

    def outside(self, air: Array, clear: float) -> ImplicitSurface:
        """The most probable surface that leaves points in the air (k, 3) free: f ≥ `clear` [m] at each.

        Where the surface contradicts one of them, the worst becomes an observation of f = `clear`, until none is left:
        the active set of the most probable f under these bounds.
        """
        made, error = self, float(np.hypot(np.median(self.seen.sd), self.learnt.roughness))
        air = air[self.distance(air)[0] < clear] if len(air) else air
        for _ in range(min(MOST_ADDED, len(air))):
            short = clear - made.distance(air)[0] - CONTRADICTS * made.sd(air)
            worst = int(short.argmax())
            if short[worst] <= 0.0:
                break
            made = replace(made, seen=made.seen.with_value(air[worst], clear, error))
            air = np.delete(air, worst, axis=0)
        return made


def _blocks(n: int) -> Iterator[slice]:
    return (slice(a, min(a + BLOCK, n)) for a in range(0, n, BLOCK))


def _beside_plane(plane: Plane, seen: Observations) -> tuple[Array, Array]:
    """Observations less the prior's mean: (a,), (b, 3)."""
    return seen.values + plane.locate(seen.places).depth, seen.normals - plane.normal


def _noise(learnt: Hyperparameters, seen: Observations) -> Array:
    """Variance of each observation by itself, and what keeps the factor from rounding."""
    points = seen.sd**2 + learnt.roughness**2 + 1e-9 * learnt.size**2
    tilts = np.full(seen.normals.size, learnt.tilt**2 + 1e-9 * (learnt.size / learnt.length) ** 2)
    return np.concatenate([points, tilts])


def _shape(learnt: Hyperparameters, x: Array, y: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Differences d (m, n, 3), and φ with its two derivatives by s, (m, n) each.

    With ρ = √(2ν s): ν = 5/2: (1 + ρ + ρ²/3) e^(−ρ); 7/2: (1 + ρ + 2ρ²/5 + ρ³/15) e^(−ρ); ∞: e^(−s/2).
    """
    d = (x[:, None] - y) / learnt.length
    s = np.einsum("mni,mni->mn", d, d)
    if np.isinf(learnt.smoothness):
        e = np.exp(-0.5 * s)
        return d, (e, -0.5 * e, 0.25 * e)
    r = np.sqrt(2.0 * learnt.smoothness * s)
    e = np.exp(-r)
    if learnt.smoothness == SMOOTHNESS[0]:
        return d, ((1.0 + r + r**2 / 3.0) * e, -5.0 / 6.0 * (1.0 + r) * e, 25.0 / 12.0 * e)
    phi = (1.0 + r + 0.4 * r**2 + r**3 / 15.0) * e
    return d, (phi, -7.0 / 30.0 * (3.0 + 3.0 * r + r**2) * e, 49.0 / 60.0 * (1.0 + r) * e)


def _covariance(learnt: Hyperparameters, one: Observations, other: Observations) -> Array:
    """Of all that is observed of f, values first, then gradients point by point, (a + 3b, a' + 3b')."""
    ell, size = learnt.length, learnt.size**2
    a, b, c, e = len(one.places), len(one.turned), len(other.places), len(other.turned)
    out = np.empty((a + 3 * b, c + 3 * e))
    out[:a, :c] = size * _shape(learnt, one.places, other.places)[1][0]
    d, (_, first, _) = _shape(learnt, one.places, other.turned)
    out[:a, c:] = (-2.0 * size / ell * first[:, :, None] * d).reshape(a, 3 * e)
    d, (_, first, _) = _shape(learnt, one.turned, other.places)
    out[a:, :c] = (2.0 * size / ell * first[:, :, None] * d).transpose(0, 2, 1).reshape(3 * b, c)
    d, (_, first, second) = _shape(learnt, one.turned, other.turned)
    corner = 4.0 * second[:, :, None, None] * d[:, :, :, None] * d[:, :, None, :]
    corner += 2.0 * first[:, :, None, None] * np.eye(3)
    out[a:, c:] = (-size / ell**2 * corner).transpose(0, 2, 1, 3).reshape(3 * b, 3 * e)
    return out


def _evidence(logs: Array, kind: float, seen: Observations, away: Array, turned: Array) -> tuple[float, Array]:
    """Negative log marginal likelihood, and its derivative by the logarithms of length, size, roughness and tilt.

    That by the length takes the covariance's difference quotient: exact derivatives would ask for φ'''.
    """
    learnt = Hyperparameters(kind, *np.exp(logs))
    shared = _covariance(learnt, seen, seen)
    noise = _noise(learnt, seen)
    system = shared.copy()
    system[np.diag_indices_from(system)] += noise
    found = inverted(system)
    if found is None:
        return IMPOSSIBLE, np.zeros(4)
    inverse, half_log_determinant = found
    y = np.concatenate([away, turned.ravel()])
    weights = inverse @ y
    value = 0.5 * float(y @ weights) + half_log_determinant
    inner, step, points = np.outer(weights, weights) - inverse, 1e-4, len(away)
    further, nearer = (
        _covariance(learnt._replace(length=learnt.length * np.exp(h)), seen, seen) for h in (step, -step)
    )
    own = np.diag(inner)
    slope = -0.5 * np.array(
        [
            np.sum(inner * (further - nearer)) / (2.0 * step),
            2.0 * np.sum(inner * shared),
            2.0 * learnt.roughness**2 * own[:points].sum(),
            2.0 * learnt.tilt**2 * own[points:].sum(),
        ]
    )
    return value, slope
