"""A Gaussian process over a plane whose probes have each their own noise, and whose smoothness the data choose.

Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006: regression §2.2, marginal likelihood §5.4.1,
leaving out in closed form §5.4.2. Covariances are Matérn's with ν = 1/2, 3/2 or 5/2. Where probes part into segments
with a sharp step between them, and the evidence says so too, segments share only a part of their covariance, and near a
border a guess is a mixture of both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError, near
from kinid.mapping.interpolation import METHODS, Biharmonic, Guess, Interpolator, Nearest, PlaneSites, on_plane
from kinid.mapping.interpolation.covariance import Covariance, constant, diagonal, distances, doubted, learn
from kinid.mapping.interpolation.local_bias import (
    continued,
    local_bias,
    shared_error,
    spread_over,
    steps_to_side,
    unexplained,
)
from kinid.mapping.interpolation.segments import belonging, candidates, neighbours, scaled
from kinid.mapping.interpolation.uniform import Uniform, blended, uniform_value
from kinid.parallel import one_blas_thread

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SMOOTHNESS = (0.5, 1.5, 2.5)
#: queries are answered in blocks of this size, which stay in a processor's cache
BLOCK = 512
#: shares of covariance between segments that are tried
ACROSS = (0.0, 0.5)
#: where the process knows no more than this share of its prior, the place is unknown
IGNORANCE = 0.9


@final
@dataclass(frozen=True, eq=False)
class GaussianProcess(Interpolator):
    """Fitted to n probes; make it with `fit`, enlarge it with `added`.

    Attributes:
        sample_sites: places. values: (n,). noise: standard deviation of each (n,). covariance: what was learnt. mean:
            of the prior.
        factor: lower Cholesky factor of all probes' covariance, (n, n). weights: its solution for the values, (n,).
        segments: of the probes, (n,). across: share of the covariance that segments have in common; 1 without edges.
        step: a larger difference between neighbours (of logarithms, where all values are positive) parts segments.
        shared: the part of each probe's error that its neighbours make too, (n,); it isn't in `noise`, but in what is
            stated.
        uniform: the one value, where the probes say that the property has one.
        lasting: the part of each probe's error that no further probe averages away, (n,).
        border: what each probe of a uniform property reads of what lies beside it, (n,).
    """

    sample_sites: PlaneSites
    values: Array
    noise: Array
    covariance: Covariance
    mean: float
    factor: Array
    weights: Array
    segments: Index
    across: float = 1.0
    step: float = float("inf")
    shared: Array | None = None
    uniform: Uniform | None = None
    lasting: Array | None = None
    border: Array | None = None

    @classmethod
    def fit(
        cls,
        sample_sites: PlaneSites,
        values: Array,
        noise: Array | None = None,
        smoothness: float | None = None,
        edges: bool = True,
        lasting: Array | None = None,
    ) -> GaussianProcess:
        """Learn smoothness (unless given), length, size and nugget by the marginal likelihood, and edges.

        Args:
            sample_sites: places. values: (n,). noise: standard deviations (n,), infinite ones count for nothing.
            smoothness: one of `SMOOTHNESS`. edges: look for segments with sharp steps between them.
            lasting: the part of `noise` that a law makes which is wrong there, (n,): the mean of many probes has it
            too.
        """
        values = np.asarray(values, dtype=float)
        noise = np.zeros(len(values)) if noise is None else np.asarray(noise, dtype=float)
        spread = float(np.std(values)) or max(abs(float(values[0])), 1.0)
        noise = np.clip(np.where(np.isfinite(noise), noise, 1e3 * spread), 0.0, 1e3 * spread)
        shared = shared_error(sample_sites.places, values, noise, neighbours(sample_sites.places))
        found, evidence = cls._fitted(sample_sites, values, noise, spread, smoothness, edges)
        if shared.any():
            other, better = cls._fitted(sample_sites, values, np.sqrt(noise**2 - shared**2), spread, smoothness, edges)
            # errors that are large explain any step, also one that all around agree on: what neighbours tell of each
            # other counts
            if better > evidence or np.mean(other.left_out**2) < np.mean(found.left_out**2):
                uniform = None if other.uniform is None else other.uniform.with_shared(shared)
                return replace(other, shared=shared, uniform=uniform, lasting=lasting)
        return replace(found, lasting=lasting)

    @classmethod
    @one_blas_thread()
    def _fitted(
        cls, sample_sites: PlaneSites, values: Array, noise: Array, spread: float, smoothness: float | None, edges: bool
    ) -> tuple[GaussianProcess, float]:
        """As `fit`, with errors that are each a probe's own; and its evidence."""
        trust = 1.0 / (noise**2 + spread**2)
        mean = float(trust @ values / trust.sum())
        kinds = (smoothness,) if smoothness else SMOOTHNESS
        one = np.zeros(len(values), dtype=np.int64)
        best = (*learn(sample_sites, values - mean, noise, spread, kinds, one, 1.0), one, 1.0, float("inf"))
        for limit, segments in candidates(sample_sites.places, values, noise) if edges else []:
            for across in ACROSS:
                kind = (best[0].smoothness,)
                learnt, evidence = learn(sample_sites, values - mean, noise, spread, kind, segments, across, best[0])
                if evidence > best[1]:
                    best = (learnt, evidence, segments, across, limit)
        learnt, evidence, segments, across, step = best
        uniform = uniform_value(values, noise, evidence)
        if uniform is not None:
            bordering = sample_sites.bordering
            border = np.where(bordering, blended(values, noise, bordering), 0.0)
            wide = np.hypot(noise, border)
            uniform = doubted(sample_sites, values, wide, uniform_value(values, wide, evidence) or uniform)
            learnt, mean = constant(sample_sites, spread, uniform.scatter), uniform.value
            made = cls._built(sample_sites, values, wide, learnt, mean, one, 1.0)
            return replace(made, uniform=uniform, border=border), evidence
        return cls._built(sample_sites, values, noise, learnt, mean, segments, across, step), evidence

    @classmethod
    def _built(
        cls,
        sample_sites: PlaneSites,
        values: Array,
        noise: Array,
        learnt: Covariance,
        mean: float,
        segments: Index,
        across: float,
        step: float = float("inf"),
    ) -> GaussianProcess:
        from scipy.linalg import cho_solve, cholesky

        system = learnt.size**2 * learnt.correlation(distances(sample_sites.places, sample_sites.places))
        if across < 1.0:
            system[segments[:, None] != segments] *= across
        system[np.diag_indices_from(system)] += diagonal(noise, learnt)
        factor = cholesky(system, lower=True, overwrite_a=True, check_finite=False)
        weights = cho_solve((factor, True), values - mean, check_finite=False)
        return cls(sample_sites, values, noise, learnt, mean, factor, weights, segments, across, step)

    def added(self, place: Array, value: float, noise: float) -> GaussianProcess:
        """With one more probe, without learning anew: a row of the factor."""
        from scipy.linalg import cho_solve, solve_triangular

        place = np.asarray(place, dtype=float).reshape(1, 2)
        distance = distances(place, self.sample_sites.places)
        segment = self._segment_of(distance[0], value)
        row = self.covariance.size**2 * self.covariance.correlation(distance)[0]
        row[self.segments != segment] *= self.across
        side = solve_triangular(self.factor, row, lower=True, check_finite=False)
        noises = np.append(self.noise, noise)
        corner = self.covariance.size**2 + diagonal(noises[-1:], self.covariance)[0] - side @ side
        n = len(row)
        factor = np.zeros((n + 1, n + 1))
        factor[:n, :n], factor[n, :n] = self.factor, side
        factor[n, n] = np.sqrt(max(float(corner), 1e-12 * self.covariance.size**2))
        values = np.append(self.values, value)
        weights = cho_solve((factor, True), values - self.mean, check_finite=False)
        sites = replace(self.sample_sites, places=np.vstack([self.sample_sites.places, place]))
        more: dict[str, Any] = {"factor": factor, "weights": weights, "segments": np.append(self.segments, segment)}
        for name in ("shared", "lasting", "border"):
            if (part := getattr(self, name)) is not None:
                more[name] = np.append(part, 0.0)
        return replace(self, sample_sites=sites, values=values, noise=noises, **more)

    def _segment_of(self, distance: Array, value: float) -> int:
        """Segment of a new probe: that of the neighbour whose value is nearest to it, or a new one beyond the step."""
        if self.across >= 1.0:
            return int(self.segments[0])
        near = np.argsort(distance)[:6]
        values, _ = scaled(np.append(self.values, value), np.append(self.noise, 0.0))
        step = np.abs(values[near] - values[-1])
        return int(self.segments[near[step.argmin()]]) if step.min() <= self.step else int(self.segments.max()) + 1

    def at(self, queries: ArrayLike, sd: bool = True) -> Guess:
        """Mean and standard deviation of the property itself (no probe's noise), (m,) each.

        Where probes side by side deviate from the mean to one side by more than chance, that is in the standard
        deviation; so is what probes around differ by beyond what the others say of them, what a border beyond the
        outermost ones would change, and what a change that these show would go on to. Many queries are answered in
        single precision: the standard deviation is good to 0.1 % of the prior's there.
        """
        q = on_plane(queries)
        if self.across >= 1.0:
            mean, variance = self._of_segment(q, None, sd)
        else:
            mean, variance = self._mixture(q, sd)
        known = self.sample_sites.known(q)
        deviation = np.sqrt(variance)
        if sd and self.across >= 1.0:
            known &= deviation <= IGNORANCE * self.covariance.size
        if sd:
            sites = self.sample_sites
            unlike = spread_over(sites.places, self._unlike, q, sites.spacing, self.values)
            beyond = spread_over(sites.places, self._beyond, q, sites.spacing)
            deviation = np.maximum.reduce([deviation, np.hypot(unlike, beyond), self._at_side(q)])
            deviation = np.hypot(deviation, spread_over(sites.places, self._off, q))
            if self.uniform is not None:
                deviation = np.maximum(deviation, self.uniform.standard_error)
        return Guess(np.where(known, mean, np.nan), np.where(known, deviation, np.nan), known)

    @cached_property
    def local_bias(self) -> Array:
        """What the mean may be off by at each probe, as the residuals around it say, (n,)."""
        own = diagonal(self.noise, self.covariance)
        # the covariance of the property times the weights is the guess, so that its diagonal times them is what is left
        return local_bias(
            self.sample_sites.places,
            own * self.weights,
            np.sqrt(own),
            self.sample_sites.spacing,
            self.uniform is not None,
        )

    @property
    def _off(self) -> Array:
        """What the mean may be off by at each probe beyond chance, (n,)."""
        off = self.local_bias if self.shared is None else np.hypot(self.local_bias, self.shared)
        off = off if self.border is None else np.hypot(off, self.border)
        return off if self.lasting is None else np.maximum(off, self.lasting)

    @cached_property
    def _unlike(self) -> Array:
        """What each probe and its surroundings differ by beyond what the other probes say, (n,)."""
        if self.uniform is not None:
            return np.zeros(len(self.values))
        return unexplained(self.left_out, np.sqrt(diagonal(self.noise, self.covariance)))

    @cached_property
    def _beyond(self) -> Array:
        """What a border beyond the outermost probes would change at each, (n,), were they as many as between probes."""
        if self.across >= 1.0:
            return np.zeros(len(self.values))
        a, b = neighbours(self.sample_sites.places).T
        heights, _ = scaled(self.values, self.noise)
        size = np.std(heights) * (1.0 if heights is self.values else self.values)
        border = size * np.sqrt(np.mean(self.segments[a] != self.segments[b]))
        return np.where(self.sample_sites.outermost, border, 0.0)

    def _at_side(self, q: Array) -> Array:
        """What a change towards the material's side, as the outermost probes show it, does beyond them, (m,)."""
        sites = self.sample_sites
        last = sites.outermost
        if not self._steps[last].any():
            return np.zeros(len(q))
        return spread_over(sites.places[last], self._steps[last], q) * continued(sites.beyond(q) / sites.spacing)

    @cached_property
    def _steps(self) -> Array:
        """What the outermost probes differ by from those further in, (n,)."""
        if self.uniform is not None:
            return np.zeros(len(self.values))
        own = np.sqrt(diagonal(self.noise, self.covariance))
        return steps_to_side(self.sample_sites.places, self.values, own, self.sample_sites.outermost)

    def _mixture(self, q: Array, sd: bool) -> tuple[Array, Array]:
        """Mean and variance over the two segments that a query may lie in."""
        segments, share = belonging(q, self.sample_sites.places, self.segments, self.sample_sites.spacing)
        means, variances = np.zeros((len(q), 2)), np.zeros((len(q), 2))
        for side in (0, 1):
            asked = share[:, side] > 0.01
            for segment in np.unique(segments[asked, side]):
                rows = np.flatnonzero(asked & (segments[:, side] == segment))
                means[rows, side], variances[rows, side] = self._of_segment(q[rows], int(segment), sd)
        share = np.where(share > 0.01, share, 0.0)
        share /= share.sum(axis=1, keepdims=True)
        mean = np.sum(share * means, axis=1)
        return mean, np.sum(share * (variances + (means - mean[:, None]) ** 2), axis=1)

    def _of_segment(self, q: Array, segment: int | None, sd: bool) -> tuple[Array, Array]:
        """Mean and variance at places (m, 2) that lie in a segment; of no segment where there are no edges."""
        mean, variance = np.empty(len(q)), np.full(len(q), np.nan)
        many = len(q) * len(self.values) > 1_000_000
        kind: type[np.floating] = np.float32 if many else np.float64
        centre = self.sample_sites.places.mean(axis=0)
        places, asked = (self.sample_sites.places - centre).astype(kind), (q - centre).astype(kind)
        prior = self.covariance.size**2
        shared = np.ones(len(places)) if segment is None else np.where(self.segments == segment, 1.0, self.across)
        weights = (self.weights * prior * shared).astype(kind)
        inverse = None
        if sd:
            from scipy.linalg import solve_triangular
            from scipy.linalg.blas import dtrmm, strmm

            inverse = solve_triangular(self.factor, np.eye(len(self.values)), lower=True, check_finite=False)
            inverse = np.asfortranarray(inverse * (self.covariance.size * shared), dtype=kind)
            product = strmm if many else dtrmm
        room = np.empty((2, min(BLOCK, max(len(q), 1)), len(places)), dtype=kind)
        for a in range(0, len(q), BLOCK):
            rows = slice(a, min(a + BLOCK, len(q)))
            size = rows.stop - a
            k = self.covariance.correlation(
                distances(asked[rows], places, room[0, :size], room[1, :size]), room[1, :size]
            )
            mean[rows] = k @ weights
            if inverse is not None:
                whitened = product(1.0, inverse, k.T, lower=1, overwrite_b=1)  # in place: k's rows are its columns
                variance[rows] = prior * np.maximum(1.0 - np.einsum("ij,ij->i", whitened.T, whitened.T), 0.0)
        return mean + self.mean, variance

    @property
    def left_out(self) -> Array:
        """Value less what the others say of its place, (n,): of the segment that they say it is in."""
        return self.values - self._left_out_guess[0]

    @property
    def left_out_sd(self) -> Array:
        """Standard deviation that the others state for each value, with its own noise, (n,)."""
        own = np.sqrt(self._left_out_guess[1])
        return np.asarray(own if self.shared is None else np.hypot(own, self.shared))

    @cached_property
    def _left_out_guess(self) -> tuple[Array, Array]:
        """Mean and variance of each value by the others, with its own noise, (n,) each."""
        from scipy.linalg import solve_triangular

        inverse = solve_triangular(self.factor, np.eye(len(self.values)), lower=True, check_finite=False)
        inverse = inverse.T @ inverse
        own = np.diag(inverse)
        if self.across >= 1.0:
            return self.values - self.weights / own, 1.0 / own
        # left out, a probe's segment is no longer known: it is mixed from those of its neighbours
        n, prior = len(self.values), self.covariance.size**2
        correlation = self.covariance.correlation(distances(self.sample_sites.places, self.sample_sites.places))
        spacing, noise = self.sample_sites.spacing, diagonal(self.noise, self.covariance)
        voted = []
        for i in range(n):
            others = np.arange(n) != i
            voted.append(
                belonging(
                    self.sample_sites.places[[i]], self.sample_sites.places[others], self.segments[others], spacing
                )
            )
        segments, share = (np.concatenate(part) for part in zip(*voted))  # (n, 2) each
        means, variances = np.empty((n, 2)), np.empty((n, 2))
        for side in (0, 1):
            row = prior * correlation * np.where(self.segments == segments[:, side, None], 1.0, self.across)
            np.fill_diagonal(row, 0.0)
            # the inverse without row and column i (Schur complement), for row i
            row_weights = row @ inverse
            row_weights -= inverse * (np.diag(row_weights) / own)[:, None]
            means[:, side] = row_weights @ (self.values - self.mean)
            variances[:, side] = np.maximum(prior - np.einsum("ij,ij->i", row_weights, row), 1e-12 * prior) + noise
        mean = np.sum(share * means, axis=1)
        return mean + self.mean, np.sum(share * (variances + (means - mean[:, None]) ** 2), axis=1)


def interpolator(
    method: str, sample_sites: PlaneSites, values: Array, noise: Array | None = None, lasting: Array | None = None
) -> Interpolator:
    """One of `METHODS` for values (n,) with standard deviations `noise` (n,) at sample sites, of which probes share the
    part `lasting` (n,).

    Raises:
        InputError: no such method, or values that don't go with the places.
    """
    values = np.asarray(values, dtype=float)
    if values.shape != (len(sample_sites.places),) or not np.isfinite(values).all():
        raise InputError(
            f"values of shape {values.shape} for {len(sample_sites.places)} places",
            "a number for each place",
            "leave out places without a value",
        )
    if method == "nearest":
        return Nearest(sample_sites, values)
    if method == "biharmonic":
        return Biharmonic(sample_sites, values, noise)
    if method == "triangles":
        from kinid.mapping.interpolation.triangles import Triangles

        errors = np.zeros(len(values)) if noise is None else np.asarray(noise, dtype=float)
        return Triangles(sample_sites, values, errors, lasting=lasting)
    if method == "gp":
        return GaussianProcess.fit(sample_sites, values, noise, lasting=lasting)
    raise InputError(f"method '{method}'", f"one of {', '.join(METHODS)}", near(method, METHODS))
