"""A fitted state at the log's own rate: predictions, nuisances included, and residuals seen and held out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinid.identification.nuisance import with_calibration
from kinid.identification.state import State
from kinid.modeling.experiment import Experiment

Array = NDArray[np.float64]
Reader = Callable[[Array], Array]


def train_residual(state: State, whole: Experiment | None = None, read: Reader = lambda predicted: predicted) -> Array:
    """Measured less predicted, (channels, n); NaN where a sample doesn't count.

    Args:
        whole: the log where that is another one than the problem's. read: predictions as they were read.
    """
    whole = whole or state.problem.whole
    residual = whole.measured - read(_prediction(state, state.values, state.shift))
    residual[:, ~whole.valid] = np.nan
    return residual


def held_out_residual(
    state: State, whole: Experiment | None = None, read: Reader = lambda predicted: predicted
) -> Array:
    """The same with each fold predicted from parameters of the other one, (channels, n)."""
    whole = whole or state.problem.whole
    out, fold, p = whole.measured.copy(), state.problem.whole_fold, len(state.values)
    for seen, step in zip((fold, ~fold), state.fold_steps):
        values = state.values + step[:p] * state.scale if p else state.values
        out[:, ~seen] -= read(_prediction(state, values, state.shift + step[p:]))[:, ~seen]
    out[:, ~whole.valid] = np.nan
    return out


def _prediction(state: State, values: Array, shift: Array) -> Array:
    """What a state expects of its whole log with these parameters and nuisances, (channels, n)."""
    return with_calibration(state.model, values, state.open_, shift, state.problem.whole.signals)
