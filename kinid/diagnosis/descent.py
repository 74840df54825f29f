"""A model fitted to a problem: a search that carries its sensitivities along, and what was held out of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.problem import Problem
from kinid.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: calibration moves no further than so many times its tolerance
MOST_SHIFT = 2.0
#: between two halves of a log, a parameter is not believed to move by more than so many of its scales
WANDER = 30.0
#: precision that keeps parameters which a log doesn't move where they are, in units of their scales
LOOSE = 1e-9
#: share of its own size that keeps a parameter apart from those that do exactly the same
SINGULAR = 1e-13
#: a search has ended when a step gains less than this share of a sample's misfit
ENOUGH = 0.05


@dataclass(frozen=True, eq=False)
class State:
    """A model fitted to a problem.

    Attributes:
        model, values: as fitted. shift: of the calibration quantities, in tolerances.
        residual: weighted, stacked, (m,).
        held: residual of each half from parameters that fit the other, (m,). loss: of `held`, per block.
        free: columns that the log moves and no bound holds, (p + k,). scale: of each parameter, (p,).
        converged: whether the search ended by itself.
    """

    problem: Problem
    model: Model
    values: Array
    shift: Array
    residual: Array
    free: Mask  # of all columns
    scale: Array
    converged: bool

    @cached_property
    def jacobian(self) -> Array:
        """Of weighted readings against parameters in their scales, then tolerances of calibration, (m, p + k)."""
        return _Descent(self.problem, self.model, self.values, len(self.shift) > 0).everything()

    def light(self) -> State:
        """The same without its sensitivities, by far the most of it; they are worked out anew if they are asked for."""
        assert self.loss is not None  # what it is known by is worked out first
        self.__dict__.pop("jacobian", None)
        return self

    @cached_property
    def halves(self) -> tuple[Array, Array]:
        """Values of the model's parameters fitted to the even half and to the odd half, each (p,)."""
        even, odd = (fit(self.problem.only(half), self.model, self.plain.values, steps=15, calibrate=False).values
                     for half in (self.problem.even, ~self.problem.even))  # fmt: skip
        return even, odd

    @cached_property
    def plain(self) -> State:
        """The same model with calibration as it was stated: what its errors and estimates are told from."""
        return fit(self.problem, self.model, self.values, calibrate=False)

    @cached_property
    def _normal(self) -> tuple[Array, Array, Array, Array]:
        even = self.problem.half
        je, jo = self.jacobian[even], self.jacobian[~even]
        return je.T @ je, jo.T @ jo, je.T @ self.residual[even], jo.T @ self.residual[~even]

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """Step of all columns' coefficients from the whole fit to that of each half."""
        out = []
        at = np.r_[np.zeros(len(self.values)), self.shift]  # what pulls calibration back to where it was stated
        ae, ao, ge, go = self._normal
        for a, g in ((ae, ge), (ao, go)):
            step = np.zeros(len(at))
            f = np.flatnonzero(self.free)
            prior = np.r_[np.full(len(self.values), 1.0 / WANDER**2), np.ones(len(self.shift))][f]
            step[f] = np.linalg.solve(a[np.ix_(f, f)] + np.diag(prior), g[f] - at[f])
            out.append(step)
        return out[0], out[1]

    @cached_property
    def held(self) -> Array:
        """Residual of each half with the parameters of the other, weighted, (m,); to first order in their difference."""
        even = self.problem.half
        from_even, from_odd = self._steps
        out = self.residual.copy()
        out[~even] -= self.jacobian[~even] @ from_even
        out[even] -= self.jacobian[even] @ from_odd
        return out

    @cached_property
    def loss(self) -> Array:
        """Minus log-likelihood of what was held out, per block."""
        return self.problem.loss(self.held)

    @cached_property
    def inverse(self) -> Array:
        """Covariance of all columns' coefficients for white noise, (p + k, p + k)."""
        ae, ao, _, _ = self._normal
        f = np.flatnonzero(self.free)
        out = np.zeros_like(ae)
        prior = np.r_[np.full(len(self.values), LOOSE), np.ones(len(self.shift))][f]
        h = (ae + ao)[np.ix_(f, f)] + np.diag(prior)
        size = 1.0 / np.sqrt(np.diag(h))
        scaled = h * np.outer(size, size) + SINGULAR * np.eye(len(f))
        out[np.ix_(f, f)] = np.linalg.inv(scaled) * np.outer(size, size)
        return out

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squares, calibration's share included."""
        return float(self.residual @ self.residual + self.shift @ self.shift)

    @cached_property
    def rms(self) -> float:
        """Weighted held-out error: 1 is noise."""
        return float(np.sqrt(np.mean(self.held**2)))


def bounds(model: Model, problem: Problem) -> tuple[Array, Array]:
    """Least and greatest values of a model's parameters, each (p,)."""
    parameters = model.parameters(problem.experiment.layout).values()
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def fit(problem: Problem, model: Model, start: Array, *, guess: Array | None = None, steps: int = 30, calibrate: bool = True
        ) -> State:  # fmt: skip
    """Weighted least squares with calibration free inside its tolerance (Levenberg-Marquardt).

    Sensitivities are carried along by Broyden's rank-one updates and worked out anew when they mislead, and at the end.

    Args:
        problem, model: what is fitted to what.
        start: values to begin at, (p,).
        guess: sensitivity to begin with, (m, p), in scales of the parameters.
        steps: at most so many. calibrate: leave calibration free inside its tolerance.
    """
    with np.errstate(all="ignore"):  # a step too far is taken back
        return _Descent(problem, model, start, calibrate).run(guess, steps)


class _Descent:
    """One search; all quantities belong to its present place."""

    def __init__(self, problem: Problem, model: Model, start: Array, calibrate: bool) -> None:
        self.problem, self.model = problem, model
        parameters = tuple(model.parameters(problem.experiment.layout).values())
        self.scale = np.array([p.scale for p in parameters])
        self.low, self.high = bounds(model, problem)
        held = _held(model, problem)
        self.moving = np.isnan(held)
        room = 1e-6 * self.scale
        inside = np.clip(start, np.where(np.isfinite(self.low), self.low + room, self.low),
                         np.where(np.isfinite(self.high), self.high - room, self.high))  # fmt: skip
        self.x = np.where(self.moving, inside, held)
        self.y = problem.stack(problem.measured)
        self.predicted = problem.predict(model, self.x)
        self.stacked = problem.stack(self.predicted)
        self.columns = problem.nuisance(model, self.x, self.predicted) if calibrate else np.zeros((len(self.y), 0))
        self.shift = np.zeros(self.columns.shape[1])
        self.settled = False
        self.residual = self.y - self.stacked
        self.cost = float(self.residual @ self.residual)

    def run(self, guess: Array | None, steps: int) -> State:
        fresh = guess is None
        jacobian = self.sensitivity() if guess is None else guess
        damping, converged = 1e-4, False
        free = np.r_[self.moving, np.ones(len(self.shift), np.bool_)]
        for _ in range(steps):
            a, g, free = self.normal(jacobian)
            gain, change = self.step(a, g, free, damping)
            if gain is None:
                if fresh and damping > 1e3:
                    if self.recalibrated():
                        damping = 1e-4
                        continue
                    converged = True
                    break
                if not fresh:
                    jacobian, fresh = self.sensitivity(), True
                    damping = max(damping, 1e-3)
                else:
                    damping = max(damping, 1e-6) * 30.0
                continue
            moved, actual, expected = change
            small = gain < ENOUGH * max(1.0, self.cost / len(self.y))
            if small and fresh:
                if self.recalibrated():
                    continue
                converged = True
                break
            if small or gain < 0.3 * expected:
                jacobian, fresh = self.sensitivity(), True
            else:
                size = float(moved @ moved)
                if size > 0:
                    jacobian = jacobian + np.outer((actual - jacobian @ moved) / size, moved)
                fresh = False
            damping = max(damping / 10.0, 1e-9) if gain > 0.5 * expected else damping * 3.0
        if not fresh:
            jacobian = self.sensitivity()
            a, g, free = self.normal(jacobian)
        state = State(self.problem, self.model, self.x, self.shift, self.residual, free, self.scale, converged)
        state.__dict__["jacobian"] = np.concatenate([jacobian, self.columns], axis=1)
        return state

    def everything(self) -> Array:
        """Sensitivities of parameters and calibration here, (m, p + k)."""
        return np.concatenate([self.sensitivity(), self.columns], axis=1)

    def recalibrated(self) -> bool:
        """Whether what calibration does is another thing here than where the search began; it is worked out anew, once."""
        if self.settled or not len(self.shift):
            return False
        self.settled = True
        before = self.cost
        self.columns = self.problem.nuisance(self.model, self.x, self.predicted)
        self.residual = self.y - self.stacked - self.columns @ self.shift
        self.cost = float(self.residual @ self.residual + self.shift @ self.shift)
        full = self.columns.T
        gain = full @ self.residual - self.shift  # slope of the cost along the columns, of which a sure step is the square
        size = (full**2).sum(axis=1) + 1.0
        return bool(abs(self.cost - before) + float((gain**2 / size).max()) > ENOUGH * max(1.0, self.cost / len(self.y)))

    def normal(self, jacobian: Array) -> tuple[Array, Array, Mask]:
        """Normal equations of parameters and calibration, and which parameters no bound holds."""
        p = len(self.x)
        full = np.concatenate([jacobian, self.columns], axis=1)
        a, g = full.T @ full, full.T @ self.residual
        g[p:] -= self.shift
        room = 1e-9 * self.scale
        pinned = ((self.x <= self.low + room) & (g[:p] < 0)) | ((self.x >= self.high - room) & (g[:p] > 0))
        free = self.moving & ~pinned & (np.diag(a)[:p] > 1e-12)
        far = (np.abs(self.shift) >= MOST_SHIFT - 1e-9) & (g[p:] * self.shift > 0)
        return a, g, np.r_[free, ~far]

    def step(self, a: Array, g: Array, free: Mask, damping: float) -> tuple[float | None, tuple[Array, Array, float]]:
        """Try one step and take it if it helps: what it gained (None if nothing), and what there is to learn from it."""
        p = len(self.x)
        f = np.flatnonzero(free)
        prior = np.r_[np.full(p, LOOSE), np.ones(len(self.shift))][f]
        h = a[np.ix_(f, f)] + np.diag(prior + damping * np.diag(a)[f])
        step = np.zeros(len(g))
        step[f] = np.linalg.solve(h, g[f])
        x = np.clip(self.x + step[:p] * self.scale, self.low, self.high)
        moved = (x - self.x) / self.scale
        step[:p] = moved
        step[p:] = np.clip(self.shift + step[p:], -MOST_SHIFT, MOST_SHIFT) - self.shift
        expected = float(2 * g @ step - step @ a @ step)
        predicted = self.problem.predict(self.model, x)
        stacked = self.problem.stack(predicted)
        shift = self.shift + step[p:]
        residual = self.y - stacked - self.columns @ shift
        cost = float(residual @ residual + shift @ shift)
        actual = stacked - self.stacked
        if not cost < self.cost:
            return None, (moved, actual, expected)
        gain = self.cost - cost
        self.x, self.predicted, self.stacked, self.shift = x, predicted, stacked, shift
        self.residual, self.cost = residual, cost
        return gain, (moved, actual, expected)

    def sensitivity(self) -> Array:
        """Change of the weighted readings per scale of each parameter, forward differences of a hundredth of it, (m, p)."""
        out = np.zeros((len(self.y), len(self.x)), order="F")
        for j in np.flatnonzero(self.moving):
            h = 1e-2 * self.scale[j]
            h = h if self.x[j] + h <= self.high[j] else -h
            ahead = self.x.copy()
            ahead[j] += h
            out[:, j] = (self.problem.stack(self.problem.predict(self.model, ahead)) - self.stacked) * (self.scale[j] / h)
        return out


def _held(model: Model, problem: Problem) -> Array:
    """Parameters that are read off the samples, as the search holds them; NaN for the free ones."""
    out = []
    for effect in model.effects:
        free = np.full(len(effect.parameters(problem.experiment.layout)), np.nan)
        marks = effect.marks(problem.experiment.raw) if effect.detector else None
        out.append(free if marks is None else marks[1])
    return np.concatenate(out) if out else np.zeros(0)
