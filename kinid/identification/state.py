"""A fitted model: values, residual and jacobian where a search ended, and what these tell of other folds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.identification.error_model import ErrorModel
from kinid.identification.nuisance import Nuisance, shift_bounds
from kinid.identification.problem import Problem
from kinid.modeling.forward import Course
from kinid.modeling.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: precision of a prior that keeps directions that no reading sees from wandering, per squared scale of a parameter
RIDGE = 1e-8
#: share of the common fit's information that holds a fold's directions which that fold doesn't see
FOLD_RIDGE = 1e-3


@dataclass(frozen=True, eq=False)
class State:
    """A fitted model.

    Attributes:
        problem, model: what was fitted to what. error: error model that it was weighted with.
        values: (p,). open_: nuisances; shift: of each, in tolerances, (k,).
        course: the prediction. residual: of the means, nuisances included, (channels, g).
        jacobian: change of the means per scale of each parameter and per tolerance of each nuisance, (channels · g, p +
            k).
        free: which of these no bound holds, (p + k,). converged: whether the search ended by itself. steps: that it
            took.
    """

    problem: Problem
    model: Model
    error: ErrorModel
    values: Array
    open_: tuple[Nuisance, ...]
    shift: Array
    course: Course
    residual: Array
    jacobian: Array
    free: Mask
    converged: bool
    steps: int

    @cached_property
    def scale(self) -> Array:
        """Scale of each parameter, (p,)."""
        return np.array([p.scale for p in self.model.parameters(self.problem.layout).values()])

    @cached_property
    def means(self) -> Array:
        """The prediction in means, without nuisances, (channels, g)."""
        return self.problem.means(self.course.reading)

    @cached_property
    def weighted(self) -> Array:
        """Jacobian of the free directions over σ, (channels · g, f)."""
        out: Array = self.jacobian[:, self.free] / self.error.sigma.reshape(-1, 1)
        return out

    @cached_property
    def prior(self) -> Array:
        """Prior precision of all directions, (p + k, p + k)."""
        return prior_precision(self.model, self.problem, len(self.open_))

    @cached_property
    def information(self) -> Array:
        """Information of the free directions, prior included, (f, f)."""
        # a candidate whose predictions are beyond all numbers comes last
        with np.errstate(over="ignore", invalid="ignore"):
            out: Array = self.weighted.T @ self.weighted + self.prior[np.ix_(self.free, self.free)]
        return out

    @property
    def finite(self) -> bool:
        """Whether predictions are numbers, so that the log tells something of the values."""
        return bool(np.isfinite(self.information).all())

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squares, prior included."""
        own = np.concatenate([self.values / self.scale, self.shift]) if len(self.values) else self.shift
        prior = self.prior - RIDGE * np.diag(np.r_[np.ones(len(self.values)), np.zeros(len(self.shift))])
        return float(np.sum((self.residual / self.error.sigma) ** 2) + own @ prior @ own)

    def cost_with(self, error: ErrorModel) -> float:
        """Squares of what is left held out, in another error model's units."""
        return float(np.sum((self.held_out / error.sigma) ** 2) + self.shift @ self.shift)

    @cached_property
    def fold_steps(self) -> tuple[Array, Array]:
        """Gauss-Newton step, in scales, from the common fit to the fit of each fold alone, (p + k,)."""
        channels, groups = self.problem.shape
        p, fold, f = len(self.values), self.problem.fold, np.flatnonzero(self.free)
        rows = self.weighted.reshape(channels, groups, -1)
        weighted = self.residual / self.error.sigma
        prior = self.prior[np.ix_(f, f)]
        placed = np.r_[np.zeros(p), self.shift][f]
        ends = zip(parameter_bounds(self.model, self.problem), shift_bounds(self.open_))
        low, high = (np.r_[(end - self.values) / self.scale, furthest - self.shift] for end, furthest in ends)
        out = []
        for seen in (fold, ~fold):
            step = np.zeros(p + len(self.shift))
            if len(f):
                j = rows[:, seen].reshape(-1, rows.shape[2])
                with np.errstate(over="ignore", invalid="ignore"):
                    gradient = j.T @ weighted[:, seen].ravel() - prior @ placed
                    h = j.T @ j + prior + FOLD_RIDGE * np.diag(np.diag(self.information))
                step[f] = solve_box_constrained(h, gradient, low[f], high[f])
            out.append(step)
        return out[0], out[1]

    @cached_property
    def held_out(self) -> Array:
        """Residual of each fold from parameters of the other one, (channels, g)."""
        out = self.residual.copy()
        for seen, step in zip((self.problem.fold, ~self.problem.fold), self.fold_steps):
            change = (self.jacobian @ step).reshape(out.shape)
            out[:, ~seen] -= change[:, ~seen]
        return out

    @property
    def inflation(self) -> float:
        """Variance inflation of a mean over neighbours: memory of the residual over spacing of the means."""
        return max(1.0, self.error.memory / self.problem.spacing)

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error from the information and the memory of the residual, infinite where held or unknown, (p,)."""
        out = np.full(len(self.values), np.inf)
        if not self.finite:
            return out
        p = np.flatnonzero(self.free[: len(self.values)])
        size = np.sqrt(np.diag(self.information))
        inverse = np.linalg.pinv(self.information / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(
            size, size
        )
        variance = np.diag(inverse)[: len(p)] * self.inflation
        out[p] = np.sqrt(np.maximum(variance, 0.0)) * self.scale[p]
        return out

    def slim(self) -> State:
        """The same without what takes memory; `held_out` is worked out first."""
        _ = self.held_out, self.information, self.cost, self.standard_errors
        self.__dict__.pop("weighted", None)
        return self


def prior_precision(model: Model, problem: Problem, nuisance_count: int) -> Array:
    """Prior precision in scaled directions, (p + k, p + k): the effects' own, and one per squared tolerance."""
    named = model.parameters(problem.layout)
    p = len(named)
    out = np.zeros((p + nuisance_count, p + nuisance_count))
    out[np.arange(p), np.arange(p)] = RIDGE
    scale = np.array([q.scale for q in named.values()])
    for effect in model.effects:
        own, at = effect.prior(problem.layout), model.place(effect.id, problem.layout)
        if own is not None:
            out[at, at] += own * np.outer(scale[at], scale[at])
    out[np.arange(p, p + nuisance_count), np.arange(p, p + nuisance_count)] = 1.0
    return out


def fixed_parameters(model: Model, problem: Problem) -> Array:
    """Values of parameters that are fixed or read off the samples (quantization, saturation), NaN if free, (p,)."""
    out = []
    for effect in model.effects:
        free = np.array([p.nominal if p.fixed else np.nan for p in effect.parameters(problem.layout)])
        marks = effect.detected(problem.whole.raw) if effect.detector else None
        out.append(free if marks is None else marks[1])
    return np.concatenate(out) if out else np.zeros(0)


def parameter_bounds(model: Model, problem: Problem) -> tuple[Array, Array]:
    """Lowest and highest values of a model's parameters, each (p,)."""
    named = model.parameters(problem.layout).values()
    return np.array([p.low for p in named]), np.array([p.high for p in named])


def linear_parameters(model: Model, problem: Problem) -> Mask:
    """Whether readings are affine, or nearly so, in each parameter with all others held, (p,)."""
    return np.array(
        [
            p.linear and (effect.affine or effect.nearly_affine)
            for effect in model.effects
            for p in effect.parameters(problem.layout)
        ],
        np.bool_,
    )


def shown_values(state: State) -> Array:
    """Values as a reader has them, (p,): of a converter, what the samples show, where the search leaves it out."""
    values = state.values.copy()
    for effect in state.model.effects:
        marks = effect.detected(state.problem.whole.raw) if effect.detector else None
        if marks is not None:
            at = state.model.place(effect.id, state.problem.layout)
            values[at] = np.where(np.isnan(marks[1]), values[at], marks[0])
    return values


def solve_box_constrained(h: Array, g: Array, low: Array, high: Array) -> Array:
    """The x (f,) of h x = g between two ends: what would leave stays at its end, and the others make the best of it."""
    x, bound = np.zeros(len(g)), np.zeros(len(g), np.bool_)
    while not bound.all():
        rest = ~bound
        x[rest] = np.linalg.solve(h[np.ix_(rest, rest)], g[rest] - h[np.ix_(rest, bound)] @ x[bound])
        beyond = (x < low) | (x > high)
        if not beyond.any():
            break
        x, bound = np.clip(x, low, high), bound | beyond
    return x
