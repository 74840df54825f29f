"""A model fitted to a problem: a search that carries its sensitivities along, and what was held out of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.course import Course
from kinid.diagnosis.calibration import MOST_SHIFT
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.effort import weight_of
from kinid.diagnosis.problem import Problem
from kinid.diagnosis.together import together
from kinid.effects import Signals
from kinid.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: between two halves of a log, a parameter is not believed to move by more than so many of its scales
WANDER = 30.0
#: precision that keeps parameters which a log doesn't move where they are, in units of their scales
LOOSE = 1e-9
#: share of its own size that keeps a parameter apart from those that do exactly the same
SINGULAR = 1e-13
#: a linear view that leaves so many times the squares that were left without it looks round a corner
STRAIGHT = 2.0
#: a search has ended when a step gains less than this share of a sample's misfit
ENOUGH = 0.25
#: steps on end that keep next to nothing of what they promise: a kink holds the search
KINK = 3


@dataclass(frozen=True, eq=False)
class State:
    """A model fitted to a problem.

    Attributes:
        model, values: as fitted. shift: of the calibration quantities, in tolerances.
        residual: weighted, stacked, (m,).
        held: residual of each half from parameters that fit the other, (m,). loss: of `held`, per block.
        free: columns that the log moves and no bound holds, (p + k,). scale: of each parameter, (p,).
        converged: whether the search ended by itself. work: predictions that it took, as `effort` counts them.
    """

    problem: Problem
    model: Model
    values: Array
    shift: Array
    residual: Array
    free: Mask  # of all columns
    scale: Array
    converged: bool
    work: float = 0.0

    @cached_property
    def jacobian(self) -> Array:
        """Of weighted readings against parameters in their scales, then tolerances of calibration, (m, p + k)."""
        return _Descent(self.problem, self.model, self.values, self.shift).sensitivity()

    def signals(self) -> Signals:
        """The motion with the surface where the search left it."""
        return self.problem.calibration.signals(self.shift)

    def standing(self, predicted: Array) -> Array:
        """Predictions of that motion (channels, n) with clock and biases where the search left them."""
        calibration = self.problem.calibration
        return predicted + calibration.added(self.shift, calibration.late(predicted)) if len(self.shift) else predicted

    @cached_property
    def course(self) -> Course:
        """The way of its prediction along the chain, calibration apart."""
        return self.model.course(self.signals(), self.values)

    def own(self, name: str) -> Mask:
        """Which of the parameters are those of an effect, (p,)."""
        named = self.model.parameters(self.problem.experiment.layout)
        return np.array([full.split(".")[0] == name for full in named], np.bool_)

    def light(self) -> State:
        """The same without its sensitivities, by far the most of it."""
        assert self.loss is not None  # what it is known by is worked out first
        self.forget("jacobian", "course")
        return self

    def forget(self, *large: str) -> None:
        """Let go of what is large, and worked out anew if it is asked for."""
        for name in large:
            self.__dict__.pop(name, None)

    @cached_property
    def halves(self) -> tuple[Array, Array]:
        """Values of the model's parameters fitted to the even half and to the odd half, each (p,)."""
        (even, _), (odd, _) = self.plain._each_half
        return even, odd

    @cached_property
    def _each_half(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Values and shift of the same model fitted to the even half and to the odd half, from here."""
        even, odd = side_by_side(
            lambda half: fit(self.problem.only(half), self.model, self.values, shift=self.shift, steps=15,
                             calibrate=bool(len(self.shift))),
            (self.problem.even, ~self.problem.even))  # fmt: skip
        return (even.values, even.shift), (odd.values, odd.shift)

    @property
    def apart(self) -> Array:
        """`held` with the halves fitted in any case, where that leaves less, (m,)."""
        return min(self.held, self._apart, key=lambda r: float(r @ r))

    @cached_property
    def _apart(self) -> Array:
        of_even, of_odd = (_Descent(self.problem, self.model, *found).residual for found in self._each_half)
        return np.where(self.problem.half, of_odd, of_even)

    @cached_property
    def plain(self) -> State:
        """The same model with calibration as it was stated: what its errors and estimates are told from."""
        return fit(self.problem, self.model, self.values, calibrate=False)

    @cached_property
    def _normal(self) -> tuple[Array, Array, Array, Array]:
        even = self.problem.half
        je, jo = self.jacobian[even], self.jacobian[~even]
        return je.T @ je, jo.T @ jo, je.T @ self.residual[even], jo.T @ self.residual[~even]

    @property
    def _pull(self) -> Array:
        """What pulls calibration back to where it was stated, for all columns, (p + k,)."""
        return np.concatenate([np.zeros(len(self.values)), self.shift])

    @cached_property
    def promised(self) -> Array:
        """Coefficients of all columns that the linear view still promises something for, (p + k,): a search ends a little
        beside the lowest place.
        """
        _, _, ge, go = self._normal
        out: Array = self.inverse @ (ge + go - self._pull)
        return out

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """Step of all columns' coefficients from the whole fit to that of each half."""
        at = self._pull
        ae, ao, ge, go = self._normal
        f = np.flatnonzero(self.free)
        prior = np.diag(np.r_[np.full(len(self.values), 1.0 / WANDER**2), np.ones(len(self.shift))][f])

        def step(a: Array, g: Array) -> Array:
            out = np.zeros(len(at))
            out[f] = np.linalg.solve(a[np.ix_(f, f)] + prior, (g - at)[f])
            return out

        # a kink may hold a search where the linear view still promises something: no half may cash that in
        promised = step(ae + ao, ge + go)
        return step(ae, ge) - promised, step(ao, go) - promised

    @cached_property
    def held(self) -> Array:
        """Residual of each half with the parameters of the other, weighted, (m,).

        To first order in their difference; where that view leaves far more than the search did, the halves are fitted.
        """
        even = self.problem.half
        from_even, from_odd = self._steps
        out = self.residual.copy()
        out[~even] -= self.jacobian[~even] @ from_even
        out[even] -= self.jacobian[even] @ from_odd
        if float(out @ out) > STRAIGHT * float(self.residual @ self.residual):
            return min(out, self._apart, key=lambda r: float(r @ r))
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
    def at_word(self) -> float:
        """Weighted error that is left of readings of a coarse converter, taken at their word."""
        problem = self.problem
        predicted = self.standing(problem.predict(self.model, self.values, self.signals()))
        left = problem.target - problem.of_stairs.expected(predicted)
        return float(np.sqrt(np.mean(left**2)))

    @cached_property
    def rms(self) -> float:
        """Weighted held-out error: 1 is noise."""
        return float(np.sqrt(np.mean(self.held**2))) / self.problem.quiet


def bounds(model: Model, problem: Problem) -> tuple[Array, Array]:
    """Least and greatest values of a model's parameters, each (p,)."""
    parameters = model.parameters(problem.experiment.layout).values()
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def fit(problem: Problem, model: Model, start: Array, *, shift: Array | None = None, guess: Array | None = None,
        steps: int = 30, calibrate: bool = True) -> State:  # fmt: skip
    """Weighted least squares with calibration free inside its tolerance (Levenberg-Marquardt).

    Sensitivities are carried along by Broyden's rank-one updates and worked out anew when they mislead, and at the end.

    Args:
        problem, model: what is fitted to what.
        start: values to begin at, (p,). shift: of calibration to begin at, (k,); as it was stated, if None.
        guess: sensitivity to begin with, (m, p), in scales of the parameters.
        steps: at most so many. calibrate: leave calibration free inside its tolerance.
    """
    if shift is None or not calibrate:
        shift = np.zeros(len(problem.calibration) if calibrate else 0)
    with np.errstate(all="ignore"):  # a step too far is taken back
        if problem.experiment.steps is not None:
            # inside of a step nothing shows the way: the stairs themselves do
            rough = _Descent(problem.of_stairs, model, start, shift).run(guess, steps)
            found = _Descent(problem, model, rough.values, rough.shift).run(None, steps)
            return dataclasses.replace(found, work=found.work + rough.work)
        return _Descent(problem, model, start, shift).run(guess, steps)


def cost_of(problem: Problem, model: Model, values: Array, shift: Array) -> float:
    """Weighted sum of squares of a model there, calibration's share included."""
    return _Descent(problem, model, values, shift).cost


def settled(problem: Problem, model: Model, start: Array) -> Array:
    """The start with all that enters linearly at its best, weighted least squares inside the bounds, (p,)."""
    problem, out = problem.of_stairs, start.copy()  # inside of a converter's step nothing shows the way
    layout = problem.experiment.layout
    named = model.parameters(layout)
    free = [i for i, p in enumerate(named.values()) if p.linear]
    if not free:
        return out
    here = model.course(problem.experiment.signals, start)
    before, columns = here.reading, np.zeros((len(problem.target), len(free)), order="F")
    steps = np.array([max(abs(p.nominal), p.scale) for p in named.values() if p.linear])
    names = list(named)
    for group in together([(j, names[i]) for j, i in enumerate(free)], layout):
        ahead, own = start.copy(), list(group.values())
        ahead[[free[j] for j in own]] += steps[own]
        problem.changed_apart(problem.predict(model, ahead, near=here), before, before, group, 1.0 / steps, columns)
    rest = problem.target - problem.expected(before)
    with np.errstate(all="ignore"):
        out[free] += np.linalg.lstsq(columns, rest)[0]
    low, high = bounds(model, problem)
    return np.clip(out, low, high) if np.isfinite(out).all() else start


class _Descent:
    """One search; all quantities belong to its present place: values of parameters, and calibration's shift."""

    def __init__(self, problem: Problem, model: Model, start: Array, shift: Array) -> None:
        self.problem, self.model, self.shift, self.asked = problem, model, shift, 0
        parameters = tuple(model.parameters(problem.experiment.layout).values())
        self.scale = np.array([p.scale for p in parameters])
        self.low, self.high = bounds(model, problem)
        held = _held(model, problem)
        self.moving = np.isnan(held)
        room = 1e-6 * self.scale
        inside = np.clip(start, np.where(np.isfinite(self.low), self.low + room, self.low),
                         np.where(np.isfinite(self.high), self.high - room, self.high))  # fmt: skip
        self.x = np.where(self.moving, inside, held)
        self.y = problem.target
        self.here = self.course(self.x, shift)
        self.late = problem.calibration.late(self.predicted) if len(shift) else np.zeros(0)
        self.stacked, self.residual, self.cost = self.compared(self.predicted, shift)
        names = model.parameters(problem.experiment.layout)
        self.groups = together([(j, name) for j, name in enumerate(names) if self.moving[j]], problem.experiment.layout)
        # what acts through the law, and is to be learnt on the way; the rest of calibration only adds
        self.curved = len(self.x) + int(bool(len(shift)) and problem.calibration.surface)

    @property
    def predicted(self) -> Array:
        """What the law expects at the present place, (channels, n)."""
        return self.here.reading

    def predict(self, x: Array, shift: Array, near: Course | None = None) -> Array:
        """What the law expects with the surface at a shift, (channels, n)."""
        self.asked += 1
        return self.problem.predict(self.model, x, self.problem.calibration.signals(shift), near)

    def course(self, x: Array, shift: Array, near: Course | None = None) -> Course:
        """The way to that."""
        self.asked += 1
        return self.model.course(self.problem.calibration.signals(shift), x, near)

    def standing(self, predicted: Array, shift: Array) -> Array:
        """That with clock and biases at a shift, (channels, n)."""
        return predicted + self.problem.calibration.added(shift, self.late) if len(shift) else predicted

    def compared(self, predicted: Array, shift: Array) -> tuple[Array, Array, float]:
        """Predictions stacked, weighted residual, each (m,), and cost."""
        stacked = self.problem.expected(self.standing(predicted, shift))
        residual = self.y - stacked
        return stacked, residual, float(residual @ residual + shift @ shift)

    def run(self, guess: Array | None, steps: int) -> State:
        fresh = guess is None
        jacobian, squares = self.view(guess)
        damping, converged, caught = 1e-4, False, 0
        equations = self.normal(jacobian, squares)
        for _ in range(steps):
            gain, (moved, actual, expected) = self.step(jacobian, squares, *equations, damping)
            sample = max(1.0, self.cost / len(self.y))
            # a shorter step promises still less
            if fresh and abs(expected) < ENOUGH * sample:
                converged = True
                break
            if gain is None and fresh:
                damping = max(damping, 1e-6) * 30.0
                continue
            if gain is None:
                (jacobian, squares), fresh = self.view(), True
                equations, damping = self.normal(jacobian, squares), max(damping, 1e-3)
                continue
            small = gain < ENOUGH * sample
            caught = caught + 1 if gain < min(sample, 0.3 * expected) else 0
            if (small and fresh and gain > 0.3 * expected) or caught == KINK:
                converged = True
                break
            if small or gain < 0.3 * expected:
                (jacobian, squares), fresh = self.view(), True
            else:
                self.learn(jacobian, squares, moved, actual)
                fresh = False
            equations = self.normal(jacobian, squares)
            damping = max(damping / 10.0, 1e-9) if gain > 0.5 * expected else damping * 3.0
        if not fresh:
            jacobian, squares = self.view()
        free = self.normal(jacobian, squares)[1]
        if self.here.bent:  # what was agreed on from step to step, agreed on from nothing, as all other predictions are
            self.here = self.course(self.x, self.shift)
            self.stacked, self.residual, self.cost = self.compared(self.predicted, self.shift)
        state = State(self.problem, self.model, self.x, self.shift, self.residual, free, self.scale, converged,
                      self.asked * weight_of(self.model, self.problem))  # fmt: skip
        state.__dict__["jacobian"] = jacobian
        return state

    def view(self, guess: Array | None = None) -> tuple[Array, Array]:
        """The linear view from here: sensitivities J, (m, p + k), and JᵀJ."""
        jacobian = self.sensitivity(guess)
        return jacobian, jacobian.T @ jacobian

    def learn(self, jacobian: Array, squares: Array, moved: Array, actual: Array) -> None:
        """Broyden's update of what acts through the law, and of JᵀJ, from a step (p + k,) and what it did (m,)."""
        curved = np.r_[moved[: self.curved], np.zeros(len(moved) - self.curved)]
        size = float(curved @ curved)
        if size > 0:
            missed = (actual - jacobian @ moved) / size
            mixed = np.outer(jacobian.T @ missed, curved)
            squares += mixed + mixed.T + float(missed @ missed) * np.outer(curved, curved)
            for j in np.flatnonzero(curved):  # column by column: an outer product would take as much memory again
                jacobian[:, j] += curved[j] * missed

    def normal(self, jacobian: Array, a: Array) -> tuple[Array, Mask]:
        """Slope of the normal equations of parameters and calibration, and which of them no bound holds; a is JᵀJ."""
        p = len(self.x)
        g = jacobian.T @ self.residual
        g[p:] -= self.shift
        room = 1e-9 * self.scale
        pinned = ((self.x <= self.low + room) & (g[:p] < 0)) | ((self.x >= self.high - room) & (g[:p] > 0))
        free = self.moving & ~pinned & (np.diag(a)[:p] > 1e-12)
        far = (np.abs(self.shift) >= MOST_SHIFT - 1e-9) & (g[p:] * self.shift > 0)
        return g, np.r_[free, ~far]

    def step(self, jacobian: Array, a: Array, g: Array, free: Mask, damping: float
             ) -> tuple[float | None, tuple[Array, Array, float]]:  # fmt: skip
        """Try one step and take it if it helps: what it gained (None if nothing), and what there is to learn from it.

        Where a valley bends away under the step, it is made good by what the bend costs, seen through the same sensitivities
        (geodesic acceleration: M. K. Transtrum, J. P. Sethna, arXiv:1201.5885, 2012).
        """
        p = len(self.x)
        f = np.flatnonzero(free)
        prior = np.r_[np.full(p, LOOSE), np.ones(len(self.shift))][f]
        h = a[np.ix_(f, f)] + np.diag(prior + damping * np.diag(a)[f])
        low = np.r_[(self.low - self.x) / self.scale, -MOST_SHIFT - self.shift][f]
        high = np.r_[(self.high - self.x) / self.scale, MOST_SHIFT - self.shift][f]
        step, slope, expected = np.zeros(len(g)), g, 0.0
        for corrected in (False, True):
            step[f] += _between(h, slope[f], low - step[f], high - step[f])
            x = np.clip(self.x + step[:p] * self.scale, self.low, self.high)
            shift = np.clip(self.shift + step[p:], -MOST_SHIFT, MOST_SHIFT)
            step = np.r_[(x - self.x) / self.scale, shift - self.shift]
            expected = expected if corrected else float(2 * g @ step - step @ a @ step)
            course = self.course(x, shift, self.here)
            stacked, residual, cost = self.compared(course.reading, shift)
            if cost < self.cost:
                change = step, stacked - self.stacked, expected
                gain = self.cost - cost
                self.x, self.here, self.stacked, self.shift = x, course, stacked, shift
                self.residual, self.cost = residual, cost
                return gain, change
            if not np.isfinite(cost) or expected < ENOUGH * max(1.0, self.cost / len(self.y)):
                break
            slope = jacobian.T @ (jacobian @ step - (stacked - self.stacked))
        return None, (step, stacked - self.stacked, expected)

    def sensitivity(self, known: Array | None = None) -> Array:
        """Change of the weighted readings per scale of each parameter and per tolerance of calibration, (m, p + k).

        Forward differences of a hundredth of a parameter's scale.

        Args:
            known: that of the parameters (m, p), where it is at hand.
        """
        p, calibration = len(self.x), self.problem.calibration
        out = np.zeros((len(self.y), p + len(self.shift)), order="F")
        if len(self.shift):
            self.late = calibration.late(self.predicted)
            self.stacked, self.residual, self.cost = self.compared(self.predicted, self.shift)
        beside = self.standing(self.predicted, self.shift)
        if known is not None:
            out[:, :p] = known
        step = 1e-2 * np.where(self.x + 1e-2 * self.scale <= self.high, self.scale, -self.scale)
        for group in self.groups if known is None else ():
            own, ahead = list(group.values()), self.x.copy()
            ahead[own] += step[own]
            moved = self.predict(ahead, self.shift, self.here)
            self.problem.changed_apart(moved, self.predicted, beside, group, self.scale / step, out)
        if not len(self.shift):
            return out
        if calibration.surface:
            further = self.shift.copy()
            further[0] += 1.0 if further[0] < 0 else -1.0
            way = float(further[0] - self.shift[0])  # a tolerance, forwards or back
            self.problem.changed(self.predict(self.x, further, self.here), self.predicted, beside, way, out[:, p])
        added = p + int(calibration.surface)
        out[:, added] = self.problem.change(self.late, beside)
        if self.problem.experiment.steps is None:
            out[:, added + 1 :] = self.problem.of_biases
        else:  # a bias shows where a reading contradicts what is expected
            for channel in range(len(self.predicted)):
                out[:, added + 1 + channel] = self.problem.change(calibration.constant(channel, self.predicted), beside)
        return out


def _between(h: Array, g: Array, low: Array, high: Array) -> Array:
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


def _held(model: Model, problem: Problem) -> Array:
    """Parameters that are read off the samples, as the search holds them; NaN for the free ones."""
    out = []
    for effect in model.effects:
        free = np.full(len(effect.parameters(problem.experiment.layout)), np.nan)
        marks = effect.marks(problem.experiment.raw) if effect.detector else None
        out.append(free if marks is None else marks[1])
    return np.concatenate(out) if out else np.zeros(0)
