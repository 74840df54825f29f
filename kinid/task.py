"""A least-squares problem made of a model and an experiment, and how its samples are dealt out to be held back."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.estimators.batch import Solution, solve
from kinid.experiment import Experiment
from kinid.model import Model
from kinid.parameter import Parameter

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: held-out samples come in blocks at least so long [s]; neighbours closer than that know each other's noise
BLOCK = 0.5


@dataclass(frozen=True, eq=False)
class Task:
    """A least-squares problem made of a model and an experiment.

    Attributes:
        model, experiment: what is fitted to what.
    """

    model: Model
    experiment: Experiment

    @cached_property
    def told(self) -> Mask:
        """Valid samples that say something to this model, (n,): none where it would pull at a tool that was let go."""
        valid = self.experiment.valid
        return valid & ~self.experiment.let_go if self.model.pulls else valid

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model's parameters, "effect.parameter", in order."""
        return tuple(self.model.parameters(self.experiment.layout))

    @property
    def free_bias(self) -> bool:
        """Whether a constant of each channel is fitted along.

        Bias and what couples or scales the sensor's channels change each other, so that a bias learnt without them would
        be wrong.
        """
        return self.experiment.layout.kind == "wrench" and "sensor-bias" not in self.model

    def __call__(self, values: Array) -> Array:
        """Readings for values of the model's parameters, and of the constants behind them."""
        own = len(values) - (len(self.experiment.measured) if self.free_bias else 0)
        readings = self.experiment.in_band(self.model.predict(self.experiment.signals, values[:own]))
        return readings + values[own:, None] if self.free_bias else readings

    @cached_property
    def held(self) -> tuple[Array, Array]:
        """Parameters that are read off the samples, as they are and as the search holds them; NaN for the free ones."""
        shown, search = [], []
        for effect in self.model.effects:
            free = np.full(len(effect.parameters(self.experiment.layout)), np.nan)
            marks = effect.marks(self.experiment.raw) if effect.detector else None
            shown.append(free if marks is None else marks[0])
            search.append(free if marks is None else marks[1])
        constants = np.full(len(self.experiment.measured) if self.free_bias else 0, np.nan)
        return np.concatenate([*shown, constants]), np.concatenate([*search, constants])

    @cached_property
    def measured(self) -> Array:
        """Readings that the model is held against, (channels, n)."""
        return self.experiment.in_band(self.experiment.measured)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the search is free in; none is linear where an effect bends what others predict."""
        layout = self.experiment.layout
        parameters = tuple(self.model.parameters(layout).values())
        if not all(effect.affine for effect in self.model.effects):
            parameters = tuple(dataclasses.replace(p, linear=False) for p in parameters)
        if self.free_bias:
            parameters += tuple(Parameter(f"constant[{name}]", "b", unit, 0.0, scale=0.1 if unit == "N" else 0.005, linear=True)
                                for name, unit in zip(layout.channels, layout.units))  # fmt: skip
        return parameters

    def solve(self, start: Array, mask: Mask, covariance: bool = True) -> Solution:
        """Fit to the samples of a mask; values and covariance of the model's own parameters, residual of everything."""
        own = len(start)
        if self.free_bias:
            start = np.append(start, np.zeros(len(self.experiment.measured)))
        if not self.parameters:
            none = np.zeros(0, np.bool_)
            return Solution(start, np.zeros((0, 0)), none, none, self.measured - self(start), 1.0, (), 1, True)
        shown, search = self.held
        free = np.isnan(shown)
        full = search.copy()

        def predict(values: Array) -> Array:
            full[free] = values
            return self(full)

        found = solve(predict, self.measured, [p for p, f in zip(self.parameters, free) if f], mask=mask,
                      sigma=weights(self.experiment), starts=[start[free]], nominal=False,
                      runs=self.experiment.signals.runs,
                      covariance=covariance)  # fmt: skip
        if not free.all():
            found = _widened(found, shown, free)
        return dataclasses.replace(
            found, values=found.values[:own], covariance=found.covariance[:own, :own],
            unidentified=found.unidentified[:own], at_bound=found.at_bound[:own],
        )  # fmt: skip

    def held_out_residual(self, start: Array) -> Array:
        """Residual of every sample from a fit that has not seen its block, (channels, n); two folds of alternating blocks.

        NaN where a fold is too small to be fitted.
        """
        even = folds(self.experiment)
        out = np.full_like(self.measured, np.nan)
        for fold in (even, ~even):
            seen = self.told & fold
            if seen.sum() * len(self.experiment.measured) > 2 * len(self.parameters):
                out[:, ~fold] = self.solve(start, seen, covariance=False).residual[:, ~fold]
        return out


def _widened(found: Solution, shown: Array, free: Mask) -> Solution:
    """A solution of the free parameters with the held ones in their places, known exactly."""
    values, covariance = shown.copy(), np.zeros((len(shown), len(shown)))
    values[free] = found.values
    covariance[np.ix_(free, free)] = found.covariance
    unidentified, at_bound = np.zeros(len(shown), np.bool_), np.zeros(len(shown), np.bool_)
    unidentified[free], at_bound[free] = found.unidentified, found.at_bound
    return dataclasses.replace(found, values=values, covariance=covariance, unidentified=unidentified, at_bound=at_bound)


def weights(experiment: Experiment) -> Array:
    """Noise of each channel, never less than a hundredth of the largest of the same unit: no channel drowns the others."""
    units = np.array(experiment.layout.units)
    sigma = experiment.noise.copy()
    for unit in set(units.tolist()):
        alike = units == unit
        sigma[alike] = np.maximum(sigma[alike], 1e-2 * sigma[alike].max())
    return sigma


def blocks(experiment: Experiment) -> NDArray[np.int64]:
    """Number of the held-out block each sample lies in, (n,): stretches of time, longer than the noise remembers."""
    span = float(experiment.signals.t[-1]) if len(experiment.signals.t) else 0.0
    length = max(BLOCK, span / 200) if span >= 4 * BLOCK else max(span / 8, 1e-9)
    return np.asarray((experiment.signals.t / length).astype(np.int64))


def folds(experiment: Experiment) -> Mask:
    """Which of two folds each sample lies in, (n,): blocks of time, dealt out so that both folds hold alike contact.

    Neighbours in the order of their share of contact and depth go to different folds, by a fixed lot: blocks that
    alternated in time would beat with a periodic motion, and one fold would see nothing but air.
    """
    number = blocks(experiment)
    count = np.maximum(1, np.bincount(number))
    inside = np.bincount(number, experiment.signals.depth > 0) / count
    deep = np.bincount(number, np.maximum(experiment.signals.depth, 0.0)) / count
    order = np.lexsort((deep, np.round(inside, 2)))
    lot = np.random.default_rng(0)
    even = np.zeros(len(count), dtype=np.bool_)
    for i in range(0, len(order), 2):
        pair = order[i : i + 2]
        even[pair[lot.integers(len(pair))]] = True
    return even[number]
