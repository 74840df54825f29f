"""A model fitted to a log: estimates with intervals, errors seen and held out, warnings."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Signals
from kinid.errors import InputError
from kinid.estimators.batch import Solution
from kinid.identification import warnings as doubts
from kinid.identification.covariance import covariance_of
from kinid.identification.estimation import estimate
from kinid.identification.fitted import FitError, FittedModel, FittedParameter, on_all_rows
from kinid.identification.lack_of_fit import LackOfFit, error_rows, error_unit, lack_of_fit, rms
from kinid.identification.nuisance import with_calibration
from kinid.identification.state import State, parameter_bounds, shown_values
from kinid.identification.whole import held_out_residual, train_residual
from kinid.modeling.applicability import amplitudes, base_of
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import starting_values
from kinid.modeling.readings import check_excitation, experiment_for, refuse_inactive_effects
from kinid.parallel import one_blas_thread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: 97.5 % quantile of the normal distribution: logs are long, so that Student's t is the same
Z95 = 1.959963984540054


@dataclass(frozen=True, eq=False, repr=False)
class Fit(FittedModel):
    """A fitted model with the log that it was fitted to. `fit["stiffness"]` or `fit["hooke.stiffness"]` is a
    `FittedParameter`.

    Attributes:
        solution: estimates with their covariance. experiment: what it was fitted to.
        state: the search's end, from which a diagnosis goes on.
        left: what the model leaves beside noise and tolerance.
    """

    solution: Solution
    experiment: Experiment
    state: State
    left: LackOfFit

    @property
    def values(self) -> Array:
        """Estimates in the model's order, (p,)."""
        return self.solution.values

    def predict(
        self, data: Experiment | ContactSeries | Log | None = None, rig: Rig | None = None, *, calibrated: bool = True
    ) -> Array:
        """Readings that the fitted model expects, under the form of friction at rest that was found, (channels, n).

        Args:
            data: contact-frame quantities, or a log with its `rig`; or an experiment; default: what the fit was made
                to.
            rig: goes with a log. calibrated: with what was found of the rig's calibration.

        Returns:
            A row a channel of `layout.channels`, a column a sample of the data; NaN where the motion isn't known.

        Raises:
            InputError: data that lacks what the fit was made to.
        """
        if data is not None and not isinstance(data, Experiment):
            made = self.experiment_of(data, rig)
            return on_all_rows(made, len(data), lambda s: self._calibrated(s, calibrated))
        return self._calibrated((data or self.experiment).signals, calibrated)

    def _calibrated(self, signals: Signals, calibrated: bool) -> Array:
        signals = dataclasses.replace(signals, rest=self.rest)
        if not calibrated or signals.layout != self.layout:
            return self.model.predict(signals, self.values)
        return with_calibration(self.model, self.values, self.state.open_, self.state.shift, signals)


def fit_model(
    model: Model,
    data: ContactSeries | Log | Experiment,
    rig: Rig | None = None,
    *,
    channels: Sequence[str] | None = None,
    train: Mask | None = None,
    start: Mapping[str, float] | None = None,
    held_out: bool = True,
) -> Fit:
    """Estimate a model's parameters.

    Args:
        model: what is fitted.
        data: contact-frame quantities; or a log with its rig, for models that act on the whole wrench or on joint
            torques.
        rig: goes with a log.
        channels: of a contact frame, which to fit; default: those that the model says something about.
        train: samples to fit to, (n,) of the experiment; the others are held out. Default: all, and the held-out error
            comes from blocks left out in turn.
        start: starting values by parameter name, with its effect or without: where the caller knows them, no others are
            tried.
        held_out: compute the held-out error, which costs two more fits.

    Raises:
        InputError: data that can't carry the model, and what to record instead.
    """
    experiment, warnings = checked_experiment(model, data, rig, channels)
    if train is not None and np.shape(train) != (len(experiment.signals),):
        raise InputError(
            f"a mask of training samples of shape {np.shape(train)}",
            f"one flag for each of the {len(experiment.signals)} samples",
            "make it from the experiment's own time",
        )
    known = starting_values(model, experiment, start)
    shown = experiment if train is None else dataclasses.replace(experiment, valid=experiment.valid & train)
    with one_blas_thread():
        state = estimate(model, shown, known)
        return fit_of(state, experiment, held_out=held_out, train=train, warnings=warnings, known=known)


def checked_experiment(
    model: Model,
    data: ContactSeries | Log | Experiment,
    rig: Rig | None = None,
    channels: Sequence[str] | None = None,
) -> tuple[Experiment, list[str]]:
    """Signals and readings that a model is fitted to, and what to doubt of them; arguments as of `fit_model`.

    Raises:
        InputError: data that can't carry the model, and what to record instead.
    """
    experiment = experiment_for(model, data, rig, channels)
    if not experiment.valid.any():
        raise InputError(
            f"no sample with all of {', '.join(experiment.layout.channels)}",
            "readings that are numbers",
            "leave out the channels that the log doesn't have, or look for a column that holds nothing",
        )
    refuse_inactive_effects(model, experiment)
    return experiment, check_excitation(model, experiment)


Model.fitter = fit_model  # `model.fit(…)` reads well, and models stand on the floor below


def fit_of(
    state: State,
    experiment: Experiment,
    *,
    held_out: bool = True,
    train: Mask | None = None,
    warnings: Sequence[str] = (),
    known: Mapping[str, float] | None = None,
) -> Fit:
    """The fit that a state is.

    Args:
        state: as estimated. experiment: the whole log. held_out: work out the held-out error.
        train: samples that the state was fitted to, (n,), where those are not all. warnings: of the data. known: start
            values.
    """
    model, rows, out = state.model, error_rows(experiment), list(warnings)
    named = model.parameters(experiment.layout)
    residual = train_residual(state, experiment)
    least = state.problem.shape[0] * min(np.bincount(state.problem.fold, minlength=2))
    if train is not None:
        unseen = rms(residual[rows][:, experiment.valid & ~train])
    elif held_out and least > 2 * len(state.values):  # each fold has readings enough to be fitted alone
        unseen = rms(held_out_residual(state)[rows][:, experiment.valid])
    else:
        unseen = float("nan")
    mask = experiment.valid if train is None else experiment.valid & train
    found = covariance_of(state)
    at_bound, open_ = _at_bound(state), found.unidentified
    ended = ((), state.steps, state.converged)
    solution = Solution(shown_values(state), found.matrix, open_, at_bound, residual, found.condition, *ended)
    left = lack_of_fit(state, residual)
    error = FitError(rms(residual[rows][:, mask]), unseen, left.noise, error_unit(experiment))
    if held_out and not np.isfinite(unseen):
        out.append(
            "no held-out error: all samples are trained on"
            if train is not None
            else "no held-out error: too few samples to leave some out; record a longer log"
        )
    out += doubts.of_fit(named, solution, left, known or {}, found.inverse) + doubts.of_nuisances(state, left)
    out += doubts.of_joints(state, residual, left) + doubts.of_filter(state)
    half = Z95 * solution.standard_errors
    fitted = {}
    for (name, p), v, h in zip(named.items(), solution.values, half):
        if p.fixed:
            continue
        low, high = (max(v - h, p.low), min(v + h, p.high)) if np.isfinite(h) else (-np.inf, np.inf)
        fitted[name] = FittedParameter(name, float(v), float(low), float(high), p.unit)
    rest = state.problem.whole.signals.rest
    found_by = (solution, experiment, state, left)
    return Fit(model, fitted, error, tuple(out), experiment.layout, rest, *found_by)


def _at_bound(state: State) -> Mask:
    """Which free parameters ended at a bound, (p,)."""
    low, high = parameter_bounds(state.model, state.problem)
    fixed = np.array([p.fixed for p in state.model.parameters(state.problem.layout).values()], np.bool_)
    room = 1e-6 * state.scale
    out: Mask = ~fixed & ((state.values <= low + room) | (state.values >= high - room))
    layout, base = state.problem.layout, base_of(state.model)
    for effect in state.model.effects:  # one of several amplitudes that isn't needed, as a channel that isn't clipped
        begin, null = state.model.place(effect.id, layout).start, amplitudes(effect, layout, base)
        nothing = [begin + i for i, value in null.items() if abs(state.values[begin + i] - value) <= room[begin + i]]
        if len(nothing) < len(null):
            out[nothing] = False
    return out
