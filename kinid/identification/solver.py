"""Weighted nonlinear least squares with nuisance parameters (Levenberg-Marquardt)."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from kinid.identification.error_model import ErrorModel, learn, motion_variance, reading_variance
from kinid.identification.jacobian import changes
from kinid.identification.nuisance import nuisance_columns, nuisances, shift_bounds
from kinid.identification.problem import Problem
from kinid.identification.state import (
    State,
    fixed_parameters,
    linear_parameters,
    parameter_bounds,
    prior_precision,
    solve_box_constrained,
)
from kinid.modeling.forward import Course
from kinid.modeling.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: a search ends where a step gains less than this, in units of a mean's error, and than this share of what is left;
#: where models are only compared, a rougher end does
CONVERGED_GAIN, ROUGH_GAIN = (1e-2, 1e-7), (0.3, 1e-5)
#: how often the error model is learnt anew from the residual of the fit
ERROR_MODEL_ITERATIONS = 2
#: a step is taken where it gains this share of what the linear view expects, at least
MIN_GAIN_RATIO = 0.05
#: a step that gains less than this share of what the linear view expects is made good along what enters linearly
PROJECTION_GAIN_RATIO = 0.5
#: what nuisances do is looked at anew where a search has come to this share of the cost
NUISANCE_RENEWAL_RATIO = 0.7
#: discrepancy before anything is known of it, as a share of a channel's size
INITIAL_DISCREPANCY = 0.02
#: parameters are moved by this share of their scale to see what they do
DIFFERENCE_STEP = 1e-2


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
        fixed = fixed_parameters(model, problem)
        self.moving = np.isnan(fixed)
        room = 1e-6 * self.scale
        inside = np.clip(
            start,
            np.where(np.isfinite(self.low), self.low + room, self.low),
            np.where(np.isfinite(self.high), self.high - room, self.high),
        )
        self.x = np.where(self.moving, inside, fixed)
        self.open_ = nuisances(model, problem.experiment.signals)
        self.shift_low, self.shift_high = shift_bounds(self.open_)
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
            columns = nuisance_columns(self.problem, self.model, self.x, self.here, self.open_, self.shift)
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
        if len(self.open_) and (last or self.cost < NUISANCE_RENEWAL_RATIO * self.renewed):
            self.open_up()
            self.residual, self.cost = self.compare(self.here, self.x, self.shift)
            self.renewed = self.cost
        own, moving = self.jacobian[:, :p], np.flatnonzero(self.moving)
        step = DIFFERENCE_STEP * np.where(self.x + DIFFERENCE_STEP * self.scale <= self.high, self.scale, -self.scale)
        found = changes(self.problem, self.model, self.x, moving, step[moving], self.here)
        for j, change in zip(moving, found.T):
            np.multiply(change, self.weight.reshape(-1) * (self.scale[j] / step[j]), out=own[:, j])
        self.squares[:p] = own.T @ self.jacobian
        self.squares[p:, :p] = self.squares[:p, p:].T
        self.fresh = True

    def correct(self, moved: Array, actual: Array) -> None:
        """Update the parameters' columns from the last step's change (C. G. Broyden, Math. Comp. 19, 1965)."""
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
        far = ((self.shift <= self.shift_low + 1e-9) & (gradient[p:] < 0)) | (
            (self.shift >= self.shift_high - 1e-9) & (gradient[p:] > 0)
        )
        return gradient, np.r_[free, ~far]

    def step(self, gradient: Array, free: Mask, damping: float) -> tuple[float, Array, Array, float]:
        """Try a step and take it if it helps: gain, step in scales, weighted change, expected gain."""
        p, f = len(self.x), np.flatnonzero(free)
        information = self.squares + self.prior
        h = information[np.ix_(f, f)] + damping * np.diag(np.diag(self.squares)[f])
        low = np.r_[(self.low - self.x) / self.scale, self.shift_low - self.shift][f]
        high = np.r_[(self.high - self.x) / self.scale, self.shift_high - self.shift][f]
        step = np.zeros(len(gradient))
        step[f] = solve_box_constrained(h, gradient[f], low, high)
        x = np.clip(self.x + step[:p] * self.scale, self.low, self.high) if p else self.x
        shift = np.clip(self.shift + step[p:], self.shift_low, self.shift_high)
        step = np.r_[(x - self.x) / self.scale if p else x, shift - self.shift]
        expected = float(2 * gradient @ step - step @ information @ step)
        course = self.model.course(self.problem.experiment.signals, x, self.here)
        residual, cost = self.compare(course, x, shift)
        # a valley that bends away under the step
        if len(self.linear) and self.cost - cost < PROJECTION_GAIN_RATIO * expected:
            better = self.project(x, shift, course, residual)
            if better is not None and better[3] < cost:
                x, course, residual, cost = better
                step = np.r_[(x - self.x) / self.scale, step[p:]]
        if not self.cost - cost > MIN_GAIN_RATIO * expected:
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
        step = solve_box_constrained(gram + inner + 1e-9 * np.diag(np.diag(gram)), gradient, low, high)
        moved[self.linear] += step * self.scale[self.linear]
        moved = np.clip(moved, self.low, self.high)
        found = self.model.course(self.problem.experiment.signals, moved, course)
        return moved, found, *self.compare(found, moved, shift)


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
    ends: tuple[float, float] = CONVERGED_GAIN,
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

    That of the largest of their unit where they are parts of one vector, of moments also that of the force at its
    lever: what is wrong with a small part must not bend what explains the large one.
    """
    size, units = problem.channel_rms.copy(), np.array(problem.layout.units)
    for unit in set(units.tolist()) if problem.layout.kind != "joints" else ():
        size[units == unit] = size[units == unit].max()
    sensor = problem.experiment.signals.sensor
    if sensor is not None and {"N", "N·m"} <= set(units.tolist()):
        lever = float(np.linalg.norm(sensor.tip))
        size[units == "N·m"] = np.maximum(size[units == "N·m"], lever * size[units == "N"].max())
    return ErrorModel(reading_variance(problem), np.zeros(problem.shape), INITIAL_DISCREPANCY * size, 0.0)


def solve(problem: Problem, model: Model, start: Array, *, max_steps: int = 60, known: Array | None = None) -> State:
    """Fit a model and learn its error model along.

    Args:
        problem, model: what is fitted to what. start: values to begin at, (p,). max_steps: of each search.
        known: the jacobian there, where it was worked out already.
    """
    error = first_error_model(problem)
    return relearn(search(problem, model, start, error, known=known, max_steps=max_steps), max_steps)


def relearn(state: State, max_steps: int = 60) -> State:
    """The same model with an error model that is learnt from its own residual."""
    motion = motion_variance(state.problem, state.model, state.values)
    for _ in range(ERROR_MODEL_ITERATIONS):
        known = dataclasses.replace(state.error, motion=motion)
        learnt = learn(state.problem, state.model, state.values, state.residual, known)
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
