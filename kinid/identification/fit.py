"""A model fitted to a log: estimates with intervals, errors on samples that it saw and didn't see, and what to
doubt.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from kinid.contact.series import ContactSeries, contact_series
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Stage
from kinid.errors import InputError, near
from kinid.estimators.batch import Solution
from kinid.identification import warnings as doubts
from kinid.identification.covariance import covariance_of
from kinid.identification.estimation import estimate
from kinid.identification.lack_of_fit import LackOfFit, error_rows, error_unit, lack_of_fit, rms
from kinid.identification.nuisance import with_calibration
from kinid.identification.solver import State, shown_values
from kinid.identification.whole import held_out_residual, train_residual
from kinid.modeling.data_warnings import doubts_of
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_contact, from_joint_torques, from_wrench
from kinid.modeling.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: 97.5 % quantile of the normal distribution: logs are long, so that Student's t is the same
Z95 = 1.959963984540054
CONTACT_FORCES = ("normal_force", "tangential_force1", "tangential_force2")
#: fewer samples in contact than this can't carry a contact law
FEWEST_TOUCHING = 20


@dataclass(frozen=True)
class FittedParameter:
    """One estimate: value, 95 % interval, unit; infinite bounds where the log leaves it open."""

    name: str
    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.name} = {self.value:.5g} [{self.low:.5g}, {self.high:.5g}] {self.unit}"

    def to_dict(self) -> dict[str, Any]:
        """For JSON, which has no infinity: an open end is null."""
        low, high = (end if np.isfinite(end) else None for end in (self.low, self.high))
        return {"value": self.value, "low": low, "high": high, "unit": self.unit}


@dataclass(frozen=True)
class FitError:
    """Root mean square of measured less predicted force (or torque): seen, unseen, and what the noise alone
    explains.
    """

    train: float
    held_out: float
    noise_floor: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """For JSON; None where there is no figure."""
        figures = {"train": self.train, "held_out": self.held_out, "noise_floor": self.noise_floor}
        return {"unit": self.unit} | {name: value if np.isfinite(value) else None for name, value in figures.items()}


@dataclass(frozen=True, eq=False)
class Fit:
    """A model with its estimates. `fit["stiffness"]` or `fit["hooke.stiffness"]` is a `FittedParameter`.

    Attributes:
        state: the search's end, from which a diagnosis goes on.
        left: what the model leaves beside noise and tolerance.
    """

    model: Model
    parameters: dict[str, FittedParameter]
    error: FitError
    warnings: tuple[str, ...]
    solution: Solution
    experiment: Experiment
    state: State
    left: LackOfFit

    def __str__(self) -> str:
        lines = [
            f"{name} = {p.value:.4g} [{p.low:.4g}, {p.high:.4g}] {p.unit}".removesuffix(" 1")
            for name, p in self.parameters.items()
        ]
        error = f"error {self.error.train:.4g} {self.error.unit}, held out {self.error.held_out:.4g}"
        return "\n".join([f"{self.model}: {error}", *lines])

    def __getitem__(self, name: str) -> FittedParameter:
        return self.parameters[full_name(name, self.parameters, self.model)]

    @property
    def values(self) -> Array:
        """Estimates in the model's order, (p,)."""
        return self.solution.values

    def predict(self, experiment: Experiment | None = None, *, calibrated: bool = True) -> Array:
        """Readings that the fitted model expects, under the form of friction at rest that was found, (channels, n).

        Args:
            experiment: other signals than those of the fit. calibrated: with what was found of the rig's calibration.
        """
        signals = dataclasses.replace(
            (experiment or self.experiment).signals, rest=self.state.problem.whole.signals.rest
        )
        if not calibrated or signals.layout != self.experiment.layout:
            return self.model.predict(signals, self.values)
        return with_calibration(self.model, self.values, self.state.open_, self.state.shift, signals)

    def equation(self) -> str:
        """The model as equations with its numbers."""
        lines = []
        for effect in self.model.effects:
            numbers = ", ".join(
                f"{p.symbol}{p.name.removeprefix(p.name.partition('[')[0])} = "
                f"{self.parameters[f'{effect.id}.{p.name}'].value:.4g} {p.unit}".removesuffix(" 1")
                for p in effect.parameters(self.experiment.layout)
                if not p.fixed
            )
            lines.append(f"{effect.id}: {effect.equation}" + (f"   with {numbers}" if numbers else ""))
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The facts as `kinid fit --json` writes them."""
        return {
            "model": list(self.model.names),
            "parameters": {name: p.to_dict() for name, p in self.parameters.items()},
            "error": self.error.to_dict(),
            "warnings": list(self.warnings),
        }


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
    experiment = experiment_for(model, data, rig, channels)
    if train is not None and np.shape(train) != (len(experiment.signals),):
        raise InputError(
            f"a mask of training samples of shape {np.shape(train)}",
            f"one flag for each of the {len(experiment.signals)} samples",
            "make it from the experiment's own time",
        )
    if not experiment.valid.any():
        raise InputError(
            f"no sample with all of {', '.join(experiment.layout.channels)}",
            "readings that are numbers",
            "leave out the channels that the log doesn't have, or look for a column that holds nothing",
        )
    _refuse_idle(model, experiment)
    warnings = check_excitation(model, experiment)
    known = starting_values(model, experiment, start)
    told = experiment if train is None else dataclasses.replace(experiment, valid=experiment.valid & train)
    with threadpool_limits(1, user_api="blas"):  # many small products: threads would only wait for each other
        state = estimate(model, told, known)
        return fit_of(state, experiment, held_out=held_out, train=train, warnings=warnings, known=known)


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
    shown = shown_values(state)
    solution = Solution(
        shown,
        found.matrix,
        found.unidentified,
        _at_bound(state),
        residual,
        found.condition,
        (),
        state.steps,
        state.converged,
    )
    left = lack_of_fit(state, residual)
    error = FitError(rms(residual[rows][:, mask]), unseen, left.noise, error_unit(experiment))
    if held_out and not np.isfinite(unseen):
        out.append(
            "no held-out error: all samples are trained on"
            if train is not None
            else "no held-out error: too few samples to leave some out; record a longer log"
        )
    out += doubts.of_fit(named, solution, left, known or {}, found.inverse) + doubts.of_nuisances(state, left)
    half = Z95 * solution.standard_errors
    fitted = {}
    for (name, p), v, h in zip(named.items(), solution.values, half):
        if p.fixed:
            continue
        low, high = (max(v - h, p.low), min(v + h, p.high)) if np.isfinite(h) else (-np.inf, np.inf)
        fitted[name] = FittedParameter(name, float(v), float(low), float(high), p.unit)
    return Fit(model, fitted, error, tuple(out), solution, experiment, state, left)


def _at_bound(state: State) -> Mask:
    named = state.model.parameters(state.problem.layout).values()
    return np.array(
        [
            not p.fixed and (v <= p.low + 1e-6 * p.scale or v >= p.high - 1e-6 * p.scale)
            for p, v in zip(named, state.values)
        ],
        np.bool_,
    )


def _refuse_idle(model: Model, experiment: Experiment) -> None:
    """Refuse effects that can do nothing in this log, instead of leaving them out without a word."""
    kind = experiment.layout.kind
    for effect in model.effects:
        acts = {stage.value for stage in effect.stages()}
        reading = bool(acts & {"tool", "sensor", "acquisition"})
        if kind == "joints" and "joint" not in acts and not reading:
            raise InputError(
                f"'{effect.id}' for joint torques",
                "effects of joints, sensor or acquisition",
                "fit it to a contact law without rigid-body",
            )
        if kind != "joints" and "joint" in acts:
            raise InputError(
                f"'{effect.id}' for contact forces",
                "effects of contact, tool or sensor",
                "fit it with rigid-body to joint torques",
            )
        if not effect.base and not effect.parameters(experiment.layout):
            raise InputError(
                f"'{effect.id}', which has nothing to act on in this log",
                "what it needs: " + (effect.excited_by or "more channels"),
                "leave it out, or give the robot in the rig",
            )
    if "slip" in model.needs and not any(effect.base for effect in model.effects):
        raise InputError(
            f"{model} without a contact law",
            "friction with the normal force it grows with",
            "add one, e.g. --model kelvin-voigt,coulomb-friction",
        )


def experiment_for(
    model: Model, data: ContactSeries | Log | Experiment, rig: Rig | None, channels: Sequence[str] | None = None
) -> Experiment:
    """Signals and readings that this model speaks about."""
    if isinstance(data, Experiment):
        return data
    if isinstance(data, ContactSeries):
        if data.source is not None and not channels and _asks_for_more(model, *data.source):
            return experiment_for(model, *data.source)
        if model.needs_log:
            raise InputError(
                f"contact-frame quantities for {model}, which acts on the whole wrench or on joint torques",
                "the log itself with its rig",
                "call fit(log, rig)",
            )
        for name in channels or ():
            if name not in CONTACT_FORCES:
                raise InputError(f"channel '{name}'", f"one of {', '.join(CONTACT_FORCES)}", near(name, CONTACT_FORCES))
        return from_contact(data, tuple(channels or contact_channels(model, data)))
    if not isinstance(data, Log):
        raise InputError(
            f"{type(data).__name__} to fit to",
            "a log with its rig, or contact-frame quantities",
            "read it with kinid.read(path, rig)",
        )
    rig = rig_of(data, rig, "fit(log, rig)")
    if channels is None:
        return all_channels(data, rig, model)
    return experiment_for(model, contact_series(data, rig), None, channels)


def all_channels(data: ContactSeries | Log, rig: Rig | None, model: Model) -> Experiment:
    """Every channel of a log that this kind of model speaks about: joint torques, the whole wrench, or contact
    forces.
    """
    if isinstance(data, Log):
        rig = rig_of(data, rig, "diagnose(log, rig, model=…)")
        if "joints" in model.needs:
            return from_joint_torques(data, rig)
        if data.wrench is not None and data.q is not None and rig.robot is not None:
            return from_wrench(data, rig)
        data = contact_series(data, rig)
    elif data.source is not None and "joints" not in model.needs:
        log, rig = data.source
        if log.wrench is not None and log.q is not None and rig.robot is not None:
            return from_wrench(log, rig)
    slides = [
        f"tangential_force{i}"
        for i in (1, 2)
        if np.isfinite(getattr(data, f"tangential_force{i}")).any()
        and np.isfinite(getattr(data, f"slip_rate{i}")).any()
    ]
    return from_contact(data, tuple(dict.fromkeys([*contact_channels(model, data), *slides])))


def rig_of(log: Log, rig: Rig | None, call: str) -> Rig:
    """The rig that goes with a log; a material tester's needs none.

    Raises:
        InputError: the log of a robot alone.
    """
    if rig is None and "depth" not in log.contact:
        raise InputError("a log without its rig", "both", f"call {call}")
    return rig or Rig()


def _asks_for_more(model: Model, log: Log, rig: Rig) -> bool:
    """Whether a model acts on what contact quantities no longer hold, and the log behind them does."""
    if "joints" in model.needs:
        return log.tau is not None
    return log.wrench is not None and log.q is not None and rig.robot is not None and model.needs_log


def contact_channels(model: Model, touch: ContactSeries) -> tuple[str, ...]:
    """The contact forces that a model says something about."""
    if not touch.valid.any():
        empty = [
            name for name, x in (touch.source[0].contact.items() if touch.source else ()) if not np.isfinite(x).any()
        ]
        if empty:
            raise InputError(
                f"no number in {', '.join(empty)} of {touch.provenance.source}",
                "readings in each column",
                "record it, or leave the column out",
            )
        raise InputError(
            f"no usable sample among the {len(touch)} of {touch.provenance.source}",
            "depth, its rate and the forces as numbers in the same rows",
            "record more than a few samples, and look for columns that hold nothing",
        )
    if not np.isfinite(touch.normal_force).any():
        raise InputError(
            f"no normal force in {touch.provenance.source}",
            "a force to hold the model against",
            "record the force/torque sensor too",
        )
    if "slip" not in model.needs:
        return ("normal_force",)
    known = [
        i
        for i in (1, 2)
        if np.isfinite(getattr(touch, f"slip_rate{i}")).any()
        and np.isfinite(getattr(touch, f"tangential_force{i}")).any()
    ]
    slides = np.isfinite([touch.slip_rate1, touch.slip_rate2]).any()
    if not known and slides and Stage.FRICTION not in model.stages:
        return ("normal_force",)  # where the tool is says what differs from place to place
    if not known:
        raise InputError(
            f"no slip or tangential force in {touch.provenance.source} for {model}",
            "slip1, slip2, tangential_force1, tangential_force2",
            "leave friction out, or log them",
        )
    return ("normal_force", *(f"tangential_force{i}" for i in known))


def check_excitation(model: Model, experiment: Experiment) -> list[str]:
    """Refuse data that can't carry a contact law; say what will stay in doubt.

    Raises:
        InputError: too few samples in contact, depth that is never positive, or an input that doesn't change.
    """
    if "normal" not in model.needs or experiment.layout.kind == "joints":
        return []
    depth = experiment.signals.depth[experiment.valid]
    inside = depth > 0
    if not inside.any():
        raise InputError(
            f"a depth that is never positive (at most {1e3 * depth.max(initial=-np.inf):.3g} mm)",
            "samples inside the material",
            "check [surface] point and normal, or let touches find them with kinid contact --find-surface; the log's "
            "own depth "
            "is positive inside, depth = { scale = -1 } in [columns] turns it",
        )
    if inside.sum() < FEWEST_TOUCHING:
        raise InputError(
            f"{int(inside.sum())} samples inside the material",
            f"{FEWEST_TOUCHING} at least",
            "poke for longer, or log faster",
        )
    if np.ptp(depth[inside]) < 1e-9:
        raise InputError(
            "a depth that never changes inside the material",
            "at least two depths",
            "poke with a motion of a few tenths of a millimetre",
        )
    if "normal_force" in experiment.layout.channels:
        force = experiment.measured[experiment.layout.channels.index("normal_force")][experiment.valid]
        if np.ptp(force[inside]) == 0.0:
            raise InputError(
                f"a normal force that is {force[inside][0]:.4g} N at every depth",
                "a force that the depth changes",
                "check the sensor, and which column the force is read from",
            )
    return doubts_of(experiment)


def starting_values(model: Model, experiment: Experiment, start: Mapping[str, float] | None) -> dict[str, float]:
    """Values that the caller knows, by full name.

    Raises:
        InputError: a name that no parameter has, or a value outside its bounds.
    """
    named, out = model.for_log(experiment.signals).parameters(experiment.layout), {}
    for given, value in (start or {}).items():
        name = full_name(given, named, model, "starting value for ")
        p = named[name]
        if not p.low <= value <= p.high:
            raise InputError(
                f"starting value {value:g} {p.unit} for '{name}'",
                f"a value from {p.low:g} to {p.high:g} {p.unit}",
                "start inside",
            )
        out[name] = value
    return out


def full_name(name: str, named: Iterable[str], model: Model, what: str = "parameter ") -> str:
    """The full name "effect.parameter" that a name, perhaps without its effect, stands for.

    Raises:
        InputError: none, or several; `what` says what was named.
    """
    named = list(named)
    if name in named:
        return name
    ends = [full for full in named if full.split(".", 1)[1] == name]
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise InputError(f"{what}'{name}', which {len(ends)} effects have", f"one of {', '.join(ends)}", "say which")
    shown = named if "." in name else [full.split(".", 1)[1] for full in named]
    raise InputError(f"{what}'{name}'", f"a parameter of {model}", near(name, shown))
