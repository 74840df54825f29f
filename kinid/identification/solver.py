"""Weighted nonlinear least squares with nuisance parameters (Levenberg-Marquardt), and what its end tells of other
folds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.identification.error_model import ErrorModel, learn, motion_variance, reading_variance
from kinid.identification.jacobian import changes
from kinid.identification.nuisance import Nuisance, nuisance_columns, nuisances
from kinid.identification.problem import Problem
from kinid.modeling.forward import Course
from kinid.modeling.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: precision of a prior that keeps directions that no reading sees from wandering, per squared scale of a parameter
RIDGE = 1e-8
#: a search ends where a step gains less than this, in units of a mean's error, and than this share of what is left;
#: where models are only compared, a rougher end does
CONVERGED, ROUGHLY = (1e-2, 1e-7), (0.3, 1e-5)
#: share of the common fit's information that holds a fold's directions which that fold doesn't see
FOLD_RIDGE = 1e-3
#: how often the error model is learnt anew from the residual of the fit
RELEARNED = 2
#: a step is taken where it gains this share of what the linear view expects, at least
FAITHFUL = 0.05
#: a step that gains less than this share of what the linear view expects is made good along what enters linearly
CURVED = 0.5
#: what nuisances do is looked at anew where a search has come to this share of the cost
FAR = 0.7
#: discrepancy before anything is known of it, as a share of a channel's size
FIRST_SHARE = 0.02
#: parameters are moved by this share of their scale to see what they do
DIFFERENCE = 1e-2


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
        out: Array = self.weighted.T @ self.weighted + self.prior[np.ix_(self.free, self.free)]
        return out

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
        """Step of all directions, in scales, from the common fit to that of each fold alone (one Gauss-Newton step), (p
        + k,).
        """
        channels, groups = self.problem.shape
        p, fold, f = len(self.values), self.problem.fold, np.flatnonzero(self.free)
        rows = self.weighted.reshape(channels, groups, -1)
        weighted = self.residual / self.error.sigma
        prior = self.prior[np.ix_(f, f)]
        placed = np.r_[np.zeros(p), self.shift][f]
        bound = np.array([n.bound for n in self.open_])
        ends = parameter_bounds(self.model, self.problem)
        low, high = (
            np.r_[(end - self.values) / self.scale, side * bound - self.shift] for end, side in zip(ends, (-1.0, 1.0))
        )
        out = []
        for seen in (fold, ~fold):
            step = np.zeros(p + len(self.shift))
            if len(f):
                j = rows[:, seen].reshape(-1, rows.shape[2])
                gradient = j.T @ weighted[:, seen].ravel() - prior @ placed
                h = j.T @ j + prior + FOLD_RIDGE * np.diag(np.diag(self.information))
                step[f] = solve_between(h, gradient, low[f], high[f])
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
        """How much more a mean over neighbours varies than with white errors: the residual's memory over the means'
        spacing.
        """
        return max(1.0, self.error.memory / self.problem.spacing)

    @cached_property
    def standard_errors(self) -> Array:
        """Rough standard error of each parameter, from the information and the residual's memory, infinite where held,
        (p,).
        """
        out = np.full(len(self.values), np.inf)
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


def held_parameters(model: Model, problem: Problem) -> Array:
    """Parameters that are read off the samples (of a converter, of the end of a range) or fixed, NaN for the free ones,
    (p,).
    """
    out = []
    for effect in model.effects:
        free = np.array([p.nominal if p.fixed else np.nan for p in effect.parameters(problem.layout)])
        marks = effect.marks(problem.whole.raw) if effect.detector else None
        out.append(free if marks is None else marks[1])
    return np.concatenate(out) if out else np.zeros(0)


def parameter_bounds(model: Model, problem: Problem) -> tuple[Array, Array]:
    """Lowest and highest values of a model's parameters, each (p,)."""
    named = model.parameters(problem.layout).values()
    return np.array([p.low for p in named]), np.array([p.high for p in named])


def linear_parameters(model: Model, problem: Problem) -> Mask:
    """Parameters that readings are affine in, all others held, (p,): not those of effects that bend what others
    predict.
    """
    return np.array(
        [p.linear and effect.affine for effect in model.effects for p in effect.parameters(problem.layout)], np.bool_
    )


def shown_values(state: State) -> Array:
    """Values as a reader has them, (p,): of a converter, what the samples show, where the search leaves it out."""
    values = state.values.copy()
    for effect in state.model.effects:
        marks = effect.marks(state.problem.whole.raw) if effect.detector else None
        if marks is not None:
            at = state.model.place(effect.id, state.problem.layout)
            values[at] = np.where(np.isnan(marks[1]), values[at], marks[0])
    return values


class _Search:
    """One search; all quantities belong to its present place."""

    def __init__(
        self,
        problem: Problem,
        model: Model,
        start: Array,
        shift: Array | None,
        error: ErrorModel,
        bounds: tuple[Array, Array] | None,
        known: Array | None,
        like: State | None,
    ) -> None:
        self.problem, self.model, self.error = problem, model, error
        named = model.parameters(problem.layout)
        self.scale = np.array([p.scale for p in named.values()])
        self.low, self.high = parameter_bounds(model, problem) if bounds is None else bounds
        held = held_parameters(model, problem)
        self.moving = np.isnan(held)
        room = 1e-6 * self.scale
        inside = np.clip(
            start,
            np.where(np.isfinite(self.low), self.low + room, self.low),
            np.where(np.isfinite(self.high), self.high - room, self.high),
        )
        self.x = np.where(self.moving, inside, held)
        self.open_ = nuisances(model, problem.experiment.signals)
        self.bound = np.array([nuisance.bound for nuisance in self.open_])
        self.shift = np.zeros(len(self.open_)) if shift is None or len(shift) != len(self.open_) else shift
        self.prior = prior_precision(model, problem, len(self.open_))
        linear = linear_parameters(model, problem)
        self.linear = np.flatnonzero(self.moving & linear) if (self.moving & ~linear).any() else np.zeros(0, np.int64)
        self.weight = 1.0 / error.sigma
        self.here = model.course(problem.experiment.signals, self.x)
        self.moved = False
        count = len(self.x) + len(self.open_)
        #: weighted change of the means per scale of each parameter and per tolerance of each nuisance, and its products
        self.jacobian = np.zeros((problem.target.size, count), order="F")
        self.squares = np.zeros((count, count))
        if known is not None:
            np.multiply(known, self.weight.reshape(-1, 1), out=self.jacobian)
            self.squares = self.jacobian.T @ self.jacobian
        if known is None:
            self.open_up(like)
        self.residual, self.cost = self.compare(self.here, self.x, self.shift)
        self.renewed = self.cost
        if known is None:
            self.differentiate()

    def open_up(self, like: State | None = None) -> None:
        """What nuisances do here, or to begin with, what they do to a state of a model that is nearly the same."""
        p = len(self.x)
        there = {} if like is None else {(n.effect.id, n.index): j for j, n in enumerate(like.open_, len(like.values))}
        places = [there.get((n.effect.id, n.index), -1) for n in self.open_]
        if like is not None and -1 not in places:
            columns = like.jacobian[:, places]
        else:
            columns = nuisance_columns(self.problem, self.model, self.x, self.here, self.open_)
        np.multiply(columns, self.weight.reshape(-1, 1), out=self.jacobian[:, p:])
        self.squares[p:, p:] = self.jacobian[:, p:].T @ self.jacobian[:, p:]

    def compare(self, course: Course, x: Array, shift: Array) -> tuple[Array, float]:
        """Weighted residual of the means, (channels · g,), and cost."""
        residual = ((self.problem.target - self.problem.means(course.reading)) * self.weight).reshape(-1)
        if len(shift):
            residual -= self.jacobian[:, len(x) :] @ shift
        own = np.r_[np.zeros(len(x)) if not len(x) else x / self.scale, shift]
        return residual, float(residual @ residual + own @ self.prior @ own)

    def differentiate(self, last: bool = False) -> None:
        """The jacobian here; nuisances' part is renewed where a search has ended by itself, and after long ways."""
        p = len(self.x)
        if len(self.open_) and (last or self.cost < FAR * self.renewed):
            self.open_up()
            self.residual, self.cost = self.compare(self.here, self.x, self.shift)
            self.renewed = self.cost
        own, moving = self.jacobian[:, :p], np.flatnonzero(self.moving)
        step = DIFFERENCE * np.where(self.x + DIFFERENCE * self.scale <= self.high, self.scale, -self.scale)
        found = changes(self.problem, self.model, self.x, moving, step[moving], self.here)
        for j, change in zip(moving, found.T):
            np.multiply(change, self.weight.reshape(-1) * (self.scale[j] / step[j]), out=own[:, j])
        self.squares[:p] = own.T @ self.jacobian
        self.squares[p:, :p] = self.squares[:p, p:].T
        self.fresh = True

    def correct(self, moved: Array, actual: Array) -> None:
        """Make the parameters' part of the jacobian tell the last step's change (C. G. Broyden, Math. Comp. 19,
        1965).
        """
        p = len(self.x)
        v = np.r_[moved[:p] / (moved[:p] @ moved[:p]), np.zeros(len(moved) - p)]
        missed = actual - self.jacobian @ moved
        along = self.jacobian.T @ missed
        self.squares += np.outer(along, v) + np.outer(v, along) + (missed @ missed) * np.outer(v, v)
        for j in np.flatnonzero(v):
            self.jacobian[:, j] += missed * v[j]
        self.fresh = False

    def run(self, max_steps: int, ends: tuple[float, float]) -> State:
        """Search, and tell where it ended."""
        # a jacobian that came along belongs to this place
        self.fresh = True
        damping, converged, taken = 1e-3, not self.moving.any() and not len(self.open_), 0
        while taken < max_steps and not converged:
            taken += 1
            gradient, free = self.slope()
            before = self.cost
            gain, moved, actual, expected = self.step(gradient, free, damping)
            if gain <= 0.0:
                if abs(expected) < ends[0] and self.fresh:
                    converged = True
                elif not self.fresh:
                    self.differentiate()
                elif damping > 1e6:
                    converged = True
                else:
                    damping = max(damping, 1e-6) * 10.0
                continue
            if gain < ends[0] + ends[1] * before and self.fresh:
                converged = True
                break
            damping = max(damping / 10.0, 1e-9) if gain > 0.5 * expected else damping * 3.0
            if gain < 0.3 * expected or gain < max(1.0, 1e-4 * before) or not moved[: len(self.x)].any():
                self.differentiate()
            else:
                self.correct(moved, actual)
        if self.moved:
            self.differentiate(last=converged)
        free = self.slope()[1]
        sigma = self.error.sigma
        residual, jacobian = self.residual.reshape(sigma.shape) * sigma, self.jacobian * sigma.reshape(-1, 1)
        return State(
            self.problem,
            self.model,
            self.error,
            self.x,
            self.open_,
            self.shift,
            self.here,
            residual,
            jacobian,
            free,
            converged,
            taken,
        )

    def slope(self) -> tuple[Array, Mask]:
        """Negative half gradient of the cost, and which directions no bound holds."""
        p = len(self.x)
        own = np.r_[np.zeros(p) if not p else self.x / self.scale, self.shift]
        gradient = self.jacobian.T @ self.residual - self.prior @ own
        room = 1e-9 * self.scale
        pinned = ((self.x <= self.low + room) & (gradient[:p] < 0)) | (
            (self.x >= self.high - room) & (gradient[:p] > 0)
        )
        free = self.moving & ~pinned & (np.diag(self.squares)[:p] > 1e-12)
        far = (np.abs(self.shift) >= self.bound - 1e-9) & (gradient[p:] * self.shift > 0)
        return gradient, np.r_[free, ~far]

    def step(self, gradient: Array, free: Mask, damping: float) -> tuple[float, Array, Array, float]:
        """Try one step and take it if it helps: gain, step in scales, weighted change, and the gain that was
        expected.
        """
        p, f = len(self.x), np.flatnonzero(free)
        information = self.squares + self.prior
        h = information[np.ix_(f, f)] + damping * np.diag(np.diag(self.squares)[f])
        low = np.r_[(self.low - self.x) / self.scale, -self.bound - self.shift][f]
        high = np.r_[(self.high - self.x) / self.scale, self.bound - self.shift][f]
        step = np.zeros(len(gradient))
        step[f] = solve_between(h, gradient[f], low, high)
        x = np.clip(self.x + step[:p] * self.scale, self.low, self.high) if p else self.x
        shift = np.clip(self.shift + step[p:], -self.bound, self.bound)
        step = np.r_[(x - self.x) / self.scale if p else x, shift - self.shift]
        expected = float(2 * gradient @ step - step @ information @ step)
        course = self.model.course(self.problem.experiment.signals, x, self.here)
        residual, cost = self.compare(course, x, shift)
        if len(self.linear) and self.cost - cost < CURVED * expected:  # a valley that bends away under the step
            better = self.project(x, shift, course, residual)
            if better is not None and better[3] < cost:
                x, course, residual, cost = better
                step = np.r_[(x - self.x) / self.scale, step[p:]]
        if not self.cost - cost > FAITHFUL * expected:
            return 0.0, step, residual, expected
        gain, change, self.moved = self.cost - cost, self.residual - residual, True
        self.x, self.shift, self.here, self.residual, self.cost = x, shift, course, residual, cost
        return gain, step, change, expected

    def project(
        self, x: Array, shift: Array, course: Course, residual: Array
    ) -> tuple[Array, Course, Array, float] | None:
        """The place with all that enters linearly at its best (variable projection: G. H. Golub, V. Pereyra, 1973)."""
        columns = changes(self.problem, self.model, x, self.linear, self.scale[self.linear], course)
        columns *= self.weight.reshape(-1, 1)
        if not np.isfinite(columns).all():
            return None
        inner = self.prior[np.ix_(self.linear, self.linear)]
        gradient = columns.T @ residual - inner @ (x / self.scale)[self.linear]
        gram = columns.T @ columns
        low, high = (
            (self.low - x)[self.linear] / self.scale[self.linear],
            (self.high - x)[self.linear] / self.scale[self.linear],
        )
        moved = x.copy()
        step = solve_between(gram + inner + 1e-9 * np.diag(np.diag(gram)), gradient, low, high)
        moved[self.linear] += step * self.scale[self.linear]
        moved = np.clip(moved, self.low, self.high)
        found = self.model.course(self.problem.experiment.signals, moved, course)
        return moved, found, *self.compare(found, moved, shift)


def solve_between(h: Array, g: Array, low: Array, high: Array) -> Array:
    """The x (f,) of h x = g between two ends: what would leave stays at its end, and the others make the best of it."""
    x, held = np.zeros(len(g)), np.zeros(len(g), np.bool_)
    while not held.all():
        rest = ~held
        x[rest] = np.linalg.solve(h[np.ix_(rest, rest)], g[rest] - h[np.ix_(rest, held)] @ x[held])
        beyond = (x < low) | (x > high)
        if not beyond.any():
            break
        x, held = np.clip(x, low, high), held | beyond
    return x


def search(
    problem: Problem,
    model: Model,
    start: Array,
    error: ErrorModel,
    *,
    shift: Array | None = None,
    known: Array | None = None,
    max_steps: int = 30,
    bounds: tuple[Array, Array] | None = None,
    like: State | None = None,
    ends: tuple[float, float] = CONVERGED,
) -> State:
    """Weighted least squares from a start, with a given error model.

    Args:
        problem, model: what is fitted to what. start: values (p,). error: that weighs. shift: of nuisances to begin at,
        (k,).
        known: the jacobian at the start, where another search ended there. max_steps: of the search.
        bounds: of the values, each (p,); those of the parameters if None. like: of a model that is nearly the same,
            whose nuisances' columns do to begin with. ends: what a step must gain, absolutely and as a share, for the
            search to go on.
    """
    with np.errstate(all="ignore"):  # a step too far is taken back
        return _Search(problem, model, start, shift, error, bounds, known, like).run(max_steps, ends)


def first_error_model(problem: Problem) -> ErrorModel:
    """Before anything is fitted: channels weigh by the readings' own noise and a share of their size.

    That of the largest of their unit where they are parts of one vector: what is wrong with a small part must not bend
    what explains the large one.
    """
    size, units = problem.channel_rms.copy(), np.array(problem.layout.units)
    for unit in set(units.tolist()) if problem.layout.kind != "joints" else ():
        size[units == unit] = size[units == unit].max()
    return ErrorModel(reading_variance(problem), np.zeros(problem.shape), FIRST_SHARE * size, 0.0)


def solve(problem: Problem, model: Model, start: Array, *, max_steps: int = 60) -> State:
    """Fit a model and learn its error model along.

    Args:
        problem, model: what is fitted to what. start: values to begin at, (p,). max_steps: of each search.
    """
    return relearn(search(problem, model, start, first_error_model(problem), max_steps=max_steps), max_steps)


def relearn(state: State, max_steps: int = 60) -> State:
    """The same model with an error model that is learnt from its own residual."""
    motion = motion_variance(state.problem, state.model, state.values)
    for _ in range(RELEARNED):
        learnt = learn(state.problem, state.model, state.values, state.residual, motion)
        state = search(
            state.problem,
            state.model,
            state.values,
            learnt,
            shift=state.shift,
            known=state.jacobian,
            max_steps=max_steps,
        )
    return state
