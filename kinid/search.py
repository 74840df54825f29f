"""How a fit finds its best values: starts worth a search, and the smaller form of a law where the larger says no more."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.estimators.batch import Solution, autoregression
from kinid.model import Model
from kinid.task import Task, weights

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: readings that starts are judged by: a longer log is thinned
JUDGED = 20_000
#: a start must leave less than this share of the sum of squares of the one before to be taken
BETTER = 0.999
#: so many variances of a reading the sum of squares must fall for another valley to be the better one
CHANCE = 10.0


def search(task: Task, begin: Array, mask: Mask, known: Collection[str] = ()) -> Solution:
    """The best fit of a task to the samples of a mask.

    Args:
        task: model and experiment.
        begin: starting values of the model's parameters, (p,).
        mask: samples that count, (n,).
        known: parameters ("effect.parameter") whose starting value isn't to be varied.
    """
    other = promising(task, begin, mask, known)
    if other is not None:
        here, there = (task.solve(start, mask, covariance=False) for start in (begin, other))
        # along a valley in which nothing is identified, whichever end is nearer serves as well
        left, less = _squares(here, task, mask), _squares(there, task, mask)
        use = mask & np.isfinite(task.measured).all(axis=0)
        begin = (there if left - less > CHANCE * left / max(1, use.sum() * len(task.measured)) else here).values
    full = task.solve(begin, mask)
    small = _simpler(task.model)
    if small is None:
        return full
    part = Task(small, task.experiment)
    places = [list(task.model.parameters(task.experiment.layout)).index(name) for name in part.names]
    part_fit = part.solve(full.values[places], mask)
    extra = len(full.values) - len(part_fit.values)
    return full if _worth(full, part_fit, extra, task, mask) else _widened(part_fit, task, places)


def promising(task: Task, begin: Array, mask: Mask, known: Collection[str] = ()) -> Array | None:
    """A start that the effects' own suggestions lead to, or None where none is better than `begin`.

    Effect by effect its suggestions are tried, everything that enters linearly and its own amplitudes brought to their
    best; the best one stays for the next effect. Twice around, because what one effect needs may show only with another.
    """
    layout = task.experiment.layout
    names = task.names
    suggestions = {effect.id: effect.starts(task.experiment.signals) for effect in task.model.effects}
    suggestions = {name: starts for name, starts in suggestions.items() if len(starts)}
    if not suggestions:
        return None
    step = 1 + task.measured.size // JUDGED
    view = Task(task.model, task.experiment.thinned(step))
    judge = _Judge(view, mask[::step])
    best, least = judge.settled(begin, ())
    begun = least
    for _ in range(2 if len(suggestions) > 1 else 1):
        before = least
        for effect in task.model.effects:
            own = [i for i, name in enumerate(names) if name.split(".", 1)[0] == effect.id]
            varied = [k for k, i in enumerate(own) if names[i] not in known]
            grid = {k for k, p in enumerate(effect.parameters(layout)) if p.name in effect.grid}
            amplitudes = [own[k] for k in varied if k not in grid]
            for start in suggestions.get(effect.id, ()):
                trial = best.copy()
                trial[[own[k] for k in varied]] = np.asarray(start)[varied]
                settled, cost = judge.settled(trial, amplitudes)
                if cost < BETTER * least:
                    best, least = settled, cost
        if not least < BETTER * before:
            break
    return best if least < BETTER * begun else None


class _Judge:
    """Sums of squares of starts, with what enters linearly brought to its best first."""

    def __init__(self, task: Task, mask: Mask) -> None:
        self.task = task
        self.own = len(task.names)
        shown, search = task.held
        self.held = np.flatnonzero(np.isfinite(shown))
        self.search = search
        self.keep = mask & np.isfinite(task.measured).all(axis=0)
        self.weight = 1.0 / weights(task.experiment)[:, None]
        # as the effects have it: where a model isn't affine they still say what readings follow in proportion, nearly
        listed = list(task.model.parameters(task.experiment.layout).values())
        self.parameters = [*listed, *task.parameters[self.own :]]
        self.linear = [i for i, p in enumerate(self.parameters) if p.linear and i not in set(self.held.tolist())]

    def settled(self, start: Array, amplitudes: Sequence[int]) -> tuple[Array, float]:
        """The start with linear parameters and these amplitudes at their best, and its sum of squares."""
        values = np.append(start, np.zeros(len(self.parameters) - len(start)))
        values[self.held] = self.search[self.held]
        residual = self._residual(values)
        for free in (self.linear, [*self.linear, *(i for i in amplitudes if i not in self.linear)]):
            if free and (free is not self.linear or len(free)):
                values, residual = self._step(values, residual, free)
        return values[: self.own], float(residual @ residual)

    def _residual(self, values: Array) -> Array:
        out: Array = ((self.task.measured - self.task(values)) * self.weight)[:, self.keep].ravel()
        return out

    def _step(self, values: Array, residual: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """One step of Gauss and Newton, halved while it makes things worse."""
        columns = np.empty((len(residual), len(free)), order="F")
        for k, i in enumerate(free):
            p = self.parameters[i]
            h = max(abs(p.nominal), p.scale) if p.linear else 0.01 * p.scale
            ahead = values.copy()
            ahead[i] += h if ahead[i] + h <= p.high else -h
            columns[:, k] = (residual - self._residual(ahead)) / (ahead[i] - values[i])
        size = np.linalg.norm(columns, axis=0)
        size[size == 0] = 1.0
        step = np.linalg.lstsq(columns / size, residual, rcond=1e-8)[0] / size
        low, high = (np.array([getattr(self.parameters[i], end) for i in free]) for end in ("low", "high"))
        for share in (1.0, 0.5, 0.25):
            trial = values.copy()
            trial[list(free)] = np.clip(values[list(free)] + share * step, low, high)
            left = self._residual(trial)
            if left @ left < residual @ residual:
                return trial, left
        return values, residual


def _simpler(model: Model) -> Model | None:
    """The model with each effect in its smaller form, where any has one."""
    forms = [effect.simpler() for effect in model.effects]
    if all(form is None for form in forms):
        return None
    return Model(*(form or effect for form, effect in zip(forms, model.effects)))


def _worth(full: Solution, less: Solution, extra: int, task: Task, mask: Mask) -> bool:
    """Whether a fit with so many more parameters explains what chance would not.

    Schwarz's criterion (1978), for one more parameter than there are, because the place of something local is searched
    for; by as many samples as the noise leaves independent of each other.
    """
    use = mask & np.isfinite(task.measured).all(axis=0)
    spread = np.where(use, full.residual / weights(task.experiment)[:, None], np.nan)
    left = _squares(full, task, mask)
    variance = left / max(1, use.sum() * len(spread))
    if variance <= 0.0:
        return _squares(less, task, mask) > 0.0
    longest = 1.0
    for channel in spread:
        coefficients, innovation = autoregression(channel)
        own = float(np.nanmean(channel**2))
        if own > 0 and innovation > 0:
            longest = max(longest, innovation / (1.0 - coefficients.sum()) ** 2 / own)
    gain = (_squares(less, task, mask) - left) / variance / longest
    return bool(gain > (extra + 1) * np.log(max(3.0, use.sum() / longest)))


def _squares(found: Solution, task: Task, mask: Mask) -> float:
    """Weighted sum of squares of what a fit leaves of the samples that count."""
    use = mask & np.isfinite(task.measured).all(axis=0)
    left = (found.residual / weights(task.experiment)[:, None])[:, use]
    return float(np.sum(left**2))


def _widened(found: Solution, task: Task, places: Sequence[int]) -> Solution:
    """A smaller form's solution with the parameters that it lacks: where they do nothing, and open."""
    named = task.model.parameters(task.experiment.layout)
    base = next((effect.id for effect in task.model.effects if effect.base), None)
    nulls = {effect.id: effect.null_for(base) for effect in task.model.effects}
    values = np.empty(len(named))
    for i, (name, p) in enumerate(named.items()):
        effect, _, own = name.partition(".")
        values[i] = nulls[effect].get(own.split("[")[0], p.nominal)
    values[list(places)] = found.values
    covariance = np.zeros((len(named), len(named)))
    unidentified, at_bound = np.ones(len(named), np.bool_), np.zeros(len(named), np.bool_)
    covariance[np.diag_indices(len(named))] = np.inf
    covariance[np.ix_(places, places)] = found.covariance
    unidentified[list(places)], at_bound[list(places)] = found.unidentified, found.at_bound
    return dataclasses.replace(found, values=values, covariance=covariance, unidentified=unidentified, at_bound=at_bound)
