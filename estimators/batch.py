"""Offline fits: weighted nonlinear least squares, the linear part solved exactly at every step (variable projection).

Golub & Pereyra 1973: for given nonlinear parameters α the best linear ones follow from a linear least-squares problem,
so that only α is searched for. Residuals of contact models are autocorrelated; the covariance of the estimates knows it
through a model of the residual (sandwich form, White 1980): autoregressive (Box & Jenkins 1970), with a random walk
beside it where one shows (`kinid.estimators.wander`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators.wander import walk_scatter
from kinid.parameter import Parameter
from kinid.signal.autoregression import autoregression

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: singular values of the scaled sensitivity below this share of the largest mark a direction as unidentified
UNIDENTIFIED = 1e-8
#: effect of one scale of a parameter on all weighted readings, as a length, below which it is not seen
UNSEEN = 1e-6
#: condition of the sensitivity, its columns brought to length one, above which a fit is called ill-conditioned
ILL_CONDITIONED = 1e5
#: steps after which a search that goes on is given up
MOST_STEPS = 60
#: with more nonlinear parameters than this, all are searched for together
MOST_PROJECTED = 6


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit's outcome.

    Attributes:
        values: (p,), in the parameters' order. covariance: (p, p); infinite in the rows of unidentified parameters.
        unidentified: parameters that this data leave open, (p,). at_bound: those that ended at a bound, (p,).
        residual: measured less predicted, (channels, n). condition: of the normalised sensitivity.
        lags: order of the noise's autoregression per channel. evaluations: predictions that were made.
        converged: whether the search for the nonlinear parameters ended by itself.
    """

    values: Array
    covariance: Array
    unidentified: Mask
    at_bound: Mask
    residual: Array
    condition: float
    lags: tuple[int, ...]
    evaluations: int
    converged: bool

    @property
    def standard_errors(self) -> Array:
        """Standard error of each parameter, infinite where unidentified, (p,)."""
        out: Array = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return out


def solve(
    predict: Callable[[Array], Array],
    measured: Array,
    parameters: Sequence[Parameter],
    *,
    mask: Mask | None = None,
    sigma: Array | None = None,
    starts: Sequence[Array] = (),
    nominal: bool = True,
    runs: Sequence[slice] | None = None,
    covariance: bool = True,
) -> Solution:
    """Fit parameters to readings.

    Args:
        predict: readings for parameter values (p,) → (channels, n); affine in those marked linear.
        measured: (channels, n).
        parameters: what is free, with bounds, starting values and scales.
        mask: samples that count, (n,).
        sigma: weight of each channel is 1/σ; default: its root mean square.
        starts: further starting values (p,); the best end is kept.
        nominal: start from the nominal values, too; without `starts` in any case.
        runs: samples between which noise is correlated; default: all.
        covariance: compute it; a search over many models does without.

    Raises:
        InputError: fewer samples than parameters.
    """
    work = _Work.build(predict, measured, parameters, mask, sigma)
    if work.y.size <= len(parameters):
        raise InputError(
            f"{work.y.size} usable readings for {len(parameters)} parameters",
            "more readings than parameters",
            "record a longer log, or use a smaller model",
        )
    nominal_too = nominal or not len(starts)
    first = [np.array([p.nominal for p in parameters])] if nominal_too else []
    values, converged = work.best_of([*first, *starts])
    residual = measured - predict(values)
    low, high = work.bounds
    span = np.array([p.scale for p in parameters])
    at_bound = (values <= low + 1e-9 * span) | (values >= high - 1e-9 * span)
    if not covariance:
        empty = np.full((len(values), len(values)), np.nan)
        return Solution(
            values,
            empty,
            np.zeros(len(values), np.bool_),
            at_bound,
            residual,
            float("nan"),
            (),
            work.evaluations,
            converged,
        )
    matrix, unidentified, condition, lags = _settled_covariance(work, values, residual, runs, span)
    return Solution(values, matrix, unidentified, at_bound, residual, condition, lags, work.evaluations, converged)


def _settled_covariance(
    work: _Work, values: Array, residual: Array, runs: Sequence[slice] | None, span: Array
) -> tuple[Array, NDArray[np.bool_], float, tuple[int, ...]]:
    """The covariance, unidentified parameters, condition and lags, of steps as wide as what they tell (p,)."""
    # Where a law has a kink (contact begins), its derivative at a point says nothing: what counts is how much readings
    # change over the interval itself. Steps and standard errors are brought into agreement, from wide steps downwards.
    step = 0.3 * span
    for _ in range(6):
        jacobian = work.jacobian(values, step)
        matrix, unidentified, condition, lags = _covariance(work, jacobian, residual, runs)
        wide = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        wider = np.clip(
            0.5 * np.where(np.isfinite(wide), wide, 0.0), 6e-6 * np.maximum(np.abs(values), span), 0.3 * span
        )
        settled = (wider < 1.5 * step) & (step < 1.5 * wider)
        step = wider
        if settled[work.nonlinear].all():
            break
    return matrix, unidentified, condition, lags


@dataclass(eq=False)
class _Work:
    """A least-squares problem, its readings stacked and weighted."""

    predict: Callable[[Array], Array]
    parameters: Sequence[Parameter]
    keep: Mask
    weight: Array  # (channels, 1)
    y: Array
    linear: NDArray[np.int64]
    nonlinear: NDArray[np.int64]
    bounds: tuple[Array, Array]
    evaluations: int = 0

    @classmethod
    def build(
        cls,
        predict: Callable[[Array], Array],
        measured: Array,
        parameters: Sequence[Parameter],
        mask: Mask | None,
        sigma: Array | None,
    ) -> _Work:
        keep: Mask = np.asarray(np.isfinite(measured).all(axis=0))
        if mask is not None:
            keep = keep & mask
        if sigma is None:
            sigma = np.sqrt(np.mean(measured[:, keep] ** 2, axis=1)) if keep.any() else np.ones(len(measured))
            sigma[sigma == 0] = 1.0
        weight = 1.0 / np.asarray(sigma, dtype=float)[:, None]
        marked = np.array([p.linear for p in parameters], dtype=np.bool_)
        low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
        return cls(
            predict,
            parameters,
            keep,
            weight,
            (measured[:, keep] * weight).ravel(),
            np.flatnonzero(marked),
            np.flatnonzero(~marked),
            (low, high),
        )

    def stacked(self, values: Array) -> Array:
        self.evaluations += 1
        out: Array = (self.predict(values)[:, self.keep] * self.weight).ravel()
        return out

    def columns(self, values: Array) -> tuple[Array, Array]:
        """Reading with all linear parameters zero (m,), and change per unit of each (m, k)."""
        zero = values.copy()
        zero[self.linear] = 0.0
        offset = self.stacked(zero)
        out = np.empty((len(offset), len(self.linear)), order="F")
        for k, j in enumerate(self.linear):
            # a step of the parameter's own size keeps the difference clear of rounding
            step = max(abs(self.parameters[j].nominal), self.parameters[j].scale)
            zero[j] = step
            out[:, k] = (self.stacked(zero) - offset) / step
            zero[j] = 0.0
        return offset, out

    def project(self, values: Array) -> tuple[Array, Array]:
        """Best linear parameters for the given nonlinear ones: all values, and the residual (m,)."""
        values = values.copy()
        if not len(self.linear):
            return values, self.y - self.stacked(values)
        offset, columns = self.columns(values)
        target = self.y - offset
        size = np.linalg.norm(columns, axis=0)
        size[size == 0] = 1.0
        scaled = columns / size
        solution = np.linalg.lstsq(scaled, target, rcond=1e-12)[0]
        low, high = self.bounds[0][self.linear] * size, self.bounds[1][self.linear] * size
        if (solution < low).any() or (solution > high).any():
            from scipy.optimize import lsq_linear

            solution = lsq_linear(scaled, target, bounds=(low, high), method="bvls" if len(size) < 30 else "trf").x
        values[self.linear] = solution / size
        return values, target - scaled @ solution

    def best_of(self, starts: Sequence[Array]) -> tuple[Array, bool]:
        """The values of the lowest cost from several starts, and whether that search ended by itself."""
        best: tuple[float, Array, bool] | None = None
        for i, start in enumerate(starts):
            if any(np.array_equal(start, other) for other in starts[:i]):
                continue
            values, cost, converged = self.search(np.asarray(start, dtype=float))
            if best is None or cost < best[0] * (1 - 1e-9):
                best = (cost, values, converged)
        assert best is not None
        return best[1:]

    def search(self, start: Array) -> tuple[Array, float, bool]:
        """The best values from a start: values, cost, and whether the search ended by itself."""
        low, high = self.bounds[0][self.nonlinear], self.bounds[1][self.nonlinear]
        if not len(self.nonlinear):
            values, residual = self.project(start)
            return values, float(residual @ residual), True
        if len(self.nonlinear) > MOST_PROJECTED:
            return self.search_all(start)
        scale = np.array([self.parameters[j].scale for j in self.nonlinear])

        def residual_of(x: Array) -> Array:
            trial = start.copy()
            trial[self.nonlinear] = x
            return self.project(trial)[1]

        # a start on a bound would pin the search there: it begins a little inside
        inside = np.clip(start[self.nonlinear], low + 1e-6 * scale, high - 1e-6 * scale)
        values = start.copy()
        values[self.nonlinear], converged = levenberg_marquardt(residual_of, inside, low, high, scale)
        values, residual = self.project(values)
        return values, float(residual @ residual), converged

    def search_all(self, start: Array) -> tuple[Array, float, bool]:
        """The same without projection at every step, which takes fewer predictions where many parameters aren't
        linear.
        """
        low, high = self.bounds
        scale = np.array([p.scale for p in self.parameters])
        inside = np.clip(start, low + 1e-6 * scale, high - 1e-6 * scale)
        inside[self.linear] = np.clip(self.project(inside)[0], low + 1e-6 * scale, high - 1e-6 * scale)[self.linear]
        found, converged = levenberg_marquardt(lambda x: self.y - self.stacked(x), inside, low, high, scale)
        values, residual = self.project(found)
        return values, float(residual @ residual), converged

    def jacobian(self, values: Array, step: Array) -> Array:
        """Sensitivity of the weighted readings, (m, p): exact for linear parameters, central differences for others."""
        out = np.empty((len(self.y), len(values)), order="F")
        _, columns = self.columns(values)
        out[:, self.linear] = columns
        low, high = self.bounds
        for j in self.nonlinear:
            h = step[j]
            ahead, behind = values.copy(), values.copy()
            ahead[j], behind[j] = min(values[j] + h, high[j]), max(values[j] - h, low[j])
            out[:, j] = (self.stacked(ahead) - self.stacked(behind)) / (ahead[j] - behind[j])
        return out


def levenberg_marquardt(
    residual_of: Callable[[Array], Array], start: Array, low: Array, high: Array, scale: Array
) -> tuple[Array, bool]:
    """Least squares within bounds: the values, and whether the search ended by itself.

    Marquardt 1963 with Nielsen's 1999 damping; parameters that a step would carry over a bound stay on it. The normal
    equations are formed, because there are many readings and few parameters, in units of each parameter's scale.
    """
    x, residual = start.copy(), residual_of(start)
    cost, damping, growth, least = float(residual @ residual), 1.0, 2.0, 0
    for _ in range(MOST_STEPS):
        jacobian = np.empty((len(residual), len(x)), order="F")
        for j in range(len(x)):
            h = 1e-7 * max(abs(x[j]), scale[j])
            h = h if x[j] + h <= high[j] else -h
            ahead = x.copy()
            ahead[j] += h
            jacobian[:, j] = (residual_of(ahead) - residual) / h * scale[j]
        slope, curvature = jacobian.T @ residual, jacobian.T @ jacobian
        pinned = ((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0))
        free = np.flatnonzero(~pinned & (np.diag(curvature) > 0))
        if not len(free):
            return x, True
        h_free = curvature[np.ix_(free, free)]
        while True:
            step = np.zeros(len(x))
            step[free] = np.linalg.solve(h_free + damping * np.diag(np.diag(h_free)), -slope[free])
            trial = np.clip(x + step * scale, low, high)
            moved = (trial - x) / scale
            if np.abs(moved).max() < 1e-10 * max(1.0, float(np.abs(x / scale).max())):
                return x, True
            tried = residual_of(trial)
            new = float(tried @ tried)
            expected = -float(2 * slope @ moved + moved @ curvature @ moved)
            if new < cost:
                gain = min((cost - new) / max(expected, 1e-300), 10.0)
                damping = max(1e-15, damping * max(1 / 3, 1 - (2 * gain - 1) ** 3))
                growth = 2.0
                fell = cost - new
                x, residual, cost = trial, tried, new
                break
            damping, growth = damping * growth, growth * 2
            if damping > 1e12:
                return x, True
        # the end: two steps in a row that gained next to nothing (a flat valley gains little, but steadily)
        least = least + 1 if fell < 1e-9 * cost else 0
        if least >= 2 or cost == 0.0:
            return x, True
    return x, False


def _covariance(
    work: _Work, jacobian: Array, residual: Array, runs: Sequence[slice] | None
) -> tuple[Array, Mask, float, tuple[int, ...]]:
    """Sandwich covariance; the noise of each channel is an autoregression and a random walk."""
    p = jacobian.shape[1]
    scale = np.array([parameter.scale for parameter in work.parameters])
    scaled = jacobian * scale
    lengths = np.linalg.norm(scaled, axis=0)
    # of the triangular factor, which is small: the readings are many
    singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"))[1:]
    open_ = singular <= UNIDENTIFIED * max(float(singular[0]) if p else 0.0, 1e-300)
    # a parameter is open when an open direction holds a noticeable part of it
    unidentified = (np.abs(right[open_]) > 1e-3).any(axis=0) if open_.any() else np.zeros(p, np.bool_)
    # nor does one whose whole scale moves all readings together by a millionth of their noise
    unidentified |= lengths < UNSEEN
    kept = ~open_ & (singular >= UNSEEN)
    unit = scaled[:, ~unidentified] / np.where(lengths[~unidentified] > 0, lengths[~unidentified], 1.0)
    condition = float(np.linalg.cond(unit)) if unit.shape[1] else 1.0
    inverse = right[kept].T / singular[kept]  # maps left-singular coordinates to scaled parameters
    channels, n = residual.shape
    count = int(work.keep.sum())
    whole = np.full((channels, n), np.nan)
    whole[:, work.keep] = (residual[:, work.keep]) * work.weight
    meat = np.zeros((int(kept.sum()), int(kept.sum())))
    lags = []
    basis = scaled @ right[kept].T / singular[kept]
    for c in range(channels):
        rows = slice(c * count, (c + 1) * count)
        coefficients, variance = autoregression(whole[c], runs)
        lags.append(len(coefficients))
        filtered = np.zeros((n, basis.shape[1]))
        filtered[work.keep] = basis[rows]
        for run in (runs or [slice(0, n)]) if kept.any() else []:
            # Σ = T Tᵀ with T the noise's impulse response: Tᵀ J is J filtered backwards in time
            from scipy.signal import lfilter

            backwards = lfilter([1.0], np.concatenate([[1.0], -coefficients]), filtered[run][::-1], axis=0)
            meat += variance * backwards.T @ backwards
        meat += walk_scatter(whole[c], filtered, coefficients, variance)
    spent = max(1, work.y.size - p)
    core = inverse @ meat @ inverse.T * (work.y.size / spent)
    covariance = core * np.outer(scale, scale)
    covariance[unidentified, :] = 0.0
    covariance[:, unidentified] = 0.0
    covariance[unidentified, unidentified] = np.inf
    return covariance, unidentified, condition, tuple(lags)
