"""A fitted state at the log's own rate: predictions, nuisances included, and residuals seen and held out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kinid.identification.nuisance import trusted
from kinid.identification.solver import State

Array = NDArray[np.float64]


def whole_prediction(state: State, values: Array, shift: Array) -> Array:
    """What a state expects of the whole log with these parameters and nuisances, (channels, n)."""
    problem = state.problem
    out = state.model.predict(problem.whole.signals, values)
    if len(shift):
        added = (state.jacobian[:, len(values) :] @ shift).reshape(problem.shape)
        centre = problem.mean_at(problem.experiment.signals.t)
        # what neighbours have in common is a small and slow change
        out = out + np.stack([np.interp(problem.whole.signals.t, centre, row) for row in added])
    return out


def train_residual(state: State) -> Array:
    """Measured less predicted, (channels, n); NaN where a sample doesn't count."""
    return _counted(state, state.problem.whole.measured - whole_prediction(state, state.values, trusted(state.shift)))


def fold_predictions(state: State) -> Iterator[tuple[NDArray[np.bool_], Array]]:
    """For each fold, its samples (n,) and what parameters of the other one expect of the whole log, (channels, n)."""
    fold, p = state.problem.whole_fold, len(state.values)
    for seen, step in zip((fold, ~fold), state.fold_steps):
        values = state.values + step[:p] * state.scale if p else state.values
        yield ~seen, whole_prediction(state, values, trusted(state.shift + step[p:]))


def held_out_residual(state: State) -> Array:
    """The residual with each fold predicted from parameters of the other one, (channels, n)."""
    out = state.problem.whole.measured.copy()
    for part, predicted in fold_predictions(state):
        out[:, part] -= predicted[:, part]
    return _counted(state, out)


def _counted(state: State, residual: Array) -> Array:
    residual[:, ~state.problem.whole.valid] = np.nan
    return residual
