"""A model fitted to a log: estimates with intervals, errors on samples that it saw and didn't see, and what to doubt."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid import doubts
from kinid.contact import ContactSeries
from kinid.doubts_of_data import doubts_of
from kinid.errors import InputError, near
from kinid.estimators.batch import Solution
from kinid.estimators.power_law import fit_power_law
from kinid.experiment import Experiment, from_contact, from_joint_torques, from_wrench
from kinid.log import Log
from kinid.model import Model
from kinid.parameter import Parameter
from kinid.rig import Rig
from kinid.search import search
from kinid.task import Task

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
    """Root mean square of measured less predicted force (or torque): seen, unseen, and what the noise alone explains."""

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

    `constants` (channels,) were fitted along where the sensor's bias is no part of the model; zero elsewhere.
    """

    model: Model
    parameters: dict[str, FittedParameter]
    error: FitError
    warnings: tuple[str, ...]
    solution: Solution
    experiment: Experiment
    constants: Array

    def __str__(self) -> str:
        lines = [f"{name} = {p.value:.4g} [{p.low:.4g}, {p.high:.4g}] {p.unit}".removesuffix(" 1")
                 for name, p in self.parameters.items()]  # fmt: skip
        error = f"error {self.error.train:.4g} {self.error.unit}, held out {self.error.held_out:.4g}"
        return "\n".join([f"{self.model}: {error}", *lines])

    def __getitem__(self, name: str) -> FittedParameter:
        return self.parameters[full_name(name, self.parameters, self.model)]

    @property
    def values(self) -> Array:
        """Estimates in the model's order, (p,)."""
        return self.solution.values

    def predict(self, experiment: Experiment | None = None) -> Array:
        """Readings that the fitted model expects, (channels, n)."""
        return self.model.predict((experiment or self.experiment).signals, self.values) + self.constants[:, None]

    def equation(self) -> str:
        """The model as equations with its numbers."""
        lines = []
        for effect in self.model.effects:
            numbers = ", ".join(
                f"{p.symbol}{_bracket(p.name)} = {self.parameters[f'{effect.id}.{p.name}'].value:.4g} {p.unit}".removesuffix(" 1")
                for p in effect.parameters(self.experiment.layout)
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
        }  # fmt: skip


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
        data: contact-frame quantities; or a log with its rig, for models that act on the whole wrench or on joint torques.
        rig: goes with a log.
        channels: of a contact frame, which to fit; default: those that the model says something about.
        train: samples to fit to, (n,) of the experiment; the others are held out. Default: all, and the held-out error
            comes from blocks left out in turn.
        start: starting values by parameter name, with its effect or without: where the caller knows them, no others are tried.
        held_out: compute the held-out error, which costs two more fits.

    Raises:
        InputError: data that can't carry the model, and what to record instead.
    """
    experiment = experiment_for(model, data, rig, channels)
    if train is not None and np.shape(train) != (len(experiment.signals),):
        raise InputError(f"a mask of training samples of shape {np.shape(train)}", f"one flag for each of the "
                         f"{len(experiment.signals)} samples", "make it from the experiment's own time")  # fmt: skip
    if not experiment.valid.any():
        raise InputError(f"no sample with all of {', '.join(experiment.layout.channels)}", "readings that are numbers",
                         "leave out the channels that the log doesn't have, or look for a column that holds nothing")  # fmt: skip
    _refuse_idle(model, experiment)
    named = model.parameters(experiment.layout)
    warnings = check_excitation(model, experiment)
    task = Task(model, experiment)
    begin, known = starting_values(model, experiment, named, start)
    mask = task.told if train is None else task.told & train
    solution = search(task, begin, mask, known)
    rows = error_rows(experiment)
    if train is not None:
        unseen = rms(solution.residual[rows][:, experiment.valid & ~train])
    elif held_out:
        unseen = rms(task.held_out_residual(solution.values)[rows][:, experiment.valid])
    else:
        unseen = float("nan")
    error = FitError(rms(solution.residual[rows][:, mask]), unseen, rms(experiment.noise[rows]), error_unit(experiment))
    if held_out and not np.isfinite(unseen):
        warnings.append("no held-out error: all samples are trained on" if train is not None else
                        "no held-out error: too few samples to leave some out; record a longer log")  # fmt: skip
    warnings += doubts.of_fit(named, solution, error.train, error.noise_floor, begin)
    half = Z95 * solution.standard_errors
    fitted = {
        name: FittedParameter(name, float(v), float(v - h), float(v + h), p.unit)
        for (name, p), v, h in zip(named.items(), solution.values, half)
    }
    own = experiment.in_band(model.predict(experiment.signals, solution.values))
    constants = np.nanmedian(task.measured - solution.residual - own, axis=1)
    return Fit(model, fitted, error, tuple(warnings), solution, experiment, constants)


def _refuse_idle(model: Model, experiment: Experiment) -> None:
    """Refuse effects that can do nothing in this log, instead of leaving them out without a word."""
    kind = experiment.layout.kind
    for effect in model.effects:
        acts = {stage.value for stage in effect.stages()}
        reading = bool(acts & {"tool", "sensor", "acquisition"})
        if kind == "joints" and "joint" not in acts and not reading:
            raise InputError(f"'{effect.id}' for joint torques", "effects of joints, sensor or acquisition",
                             "fit it to a contact law without rigid-body")  # fmt: skip
        if kind != "joints" and "joint" in acts:
            raise InputError(f"'{effect.id}' for contact forces", "effects of contact, tool or sensor",
                             "fit it with rigid-body to joint torques")  # fmt: skip
        if not effect.base and not effect.parameters(experiment.layout):
            raise InputError(f"'{effect.id}', which has nothing to act on in this log", "what it needs: "
                             + (effect.excited_by or "more channels"), "leave it out, or give the robot in the rig")  # fmt: skip
    if "slip" in model.needs and not any(effect.base for effect in model.effects):
        raise InputError(f"{model} without a contact law", "friction with the normal force it grows with",
                         "add one, e.g. --model kelvin-voigt,coulomb-friction")  # fmt: skip


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
        raise InputError(f"{type(data).__name__} to fit to", "a log with its rig, or contact-frame quantities",
                         "read it with kinid.read(path, rig)")  # fmt: skip
    rig = rig_of(data, rig, "fit(log, rig)")
    if "joints" in model.needs:
        return from_joint_torques(data, rig)
    if model.needs_log or (data.wrench is not None and data.q is not None and model.acts_on_reading):
        return from_wrench(data, rig)
    from kinid.contact import contact_series

    return experiment_for(model, contact_series(data, rig), None, channels)


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
        empty = [name for name, x in (touch.source[0].contact.items() if touch.source else ()) if not np.isfinite(x).any()]
        if empty:
            raise InputError(f"no number in {', '.join(empty)} of {touch.provenance.source}", "readings in each column",
                             "record it, or leave the column out")  # fmt: skip
        raise InputError(f"no usable sample among the {len(touch)} of {touch.provenance.source}",
                         "depth, its rate and the forces as numbers in the same rows",
                         "record more than a few samples, and look for columns that hold nothing")  # fmt: skip
    if not np.isfinite(touch.normal_force).any():
        raise InputError(f"no normal force in {touch.provenance.source}", "a force to hold the model against",
                         "record the force/torque sensor too")  # fmt: skip
    if "slip" not in model.needs:
        return ("normal_force",)
    known = [i for i in (1, 2) if np.isfinite(getattr(touch, f"slip_rate{i}")).any()
             and np.isfinite(getattr(touch, f"tangential_force{i}")).any()]  # fmt: skip
    if not known:
        raise InputError(f"no slip or tangential force in {touch.provenance.source} for {model}",
                         "slip1, slip2, tangential_force1, tangential_force2", "leave friction out, or log them")  # fmt: skip
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
            f"a depth that is never positive (at most {1e3 * depth.max(initial=-np.inf):.3g} mm)", "samples inside the material",
            "check [surface] point and normal, or let touches find them with kinid contact --find-surface; the log's own depth "
            "is positive inside, depth = { scale = -1 } in [columns] turns it")  # fmt: skip
    if inside.sum() < FEWEST_TOUCHING:
        raise InputError(f"{int(inside.sum())} samples inside the material", f"{FEWEST_TOUCHING} at least",
                         "poke for longer, or log faster")  # fmt: skip
    if np.ptp(depth[inside]) < 1e-9:
        raise InputError("a depth that never changes inside the material", "at least two depths",
                         "poke with a motion of a few tenths of a millimetre")  # fmt: skip
    if "normal_force" in experiment.layout.channels:
        force = experiment.measured[experiment.layout.channels.index("normal_force")][experiment.valid]
        if np.ptp(force[inside]) == 0.0:
            raise InputError(f"a normal force that is {force[inside][0]:.4g} N at every depth", "a force that the depth changes",
                             "check the sensor, and which column the force is read from")  # fmt: skip
    return doubts_of(experiment)


def starting_values(
    model: Model, experiment: Experiment, named: dict[str, Parameter], start: Mapping[str, float] | None
) -> tuple[Array, frozenset[str]]:
    """Nominal values, a power law's exponent from a fit of its own, and what the caller knows better; which are known."""
    values, names = np.array([p.nominal for p in named.values()]), list(named)
    known = set()
    if "hunt-crossley.exponent" in named and "normal_force" in experiment.layout.channels:
        row = experiment.layout.channels.index("normal_force")
        keep = experiment.valid
        quick = fit_power_law(experiment.signals.depth[keep], experiment.signals.depth_rate[keep],
                              experiment.measured[row][keep])  # fmt: skip
        if quick.converged:
            known.add("hunt-crossley.exponent")
            values[names.index("hunt-crossley.exponent")] = quick.exponent
    for given, value in (start or {}).items():
        name = full_name(given, named, model, "starting value for ")
        p = named[name]
        if not p.low <= value <= p.high:
            raise InputError(f"starting value {value:g} {p.unit} for '{name}'", f"a value from {p.low:g} to {p.high:g} {p.unit}",
                             "start inside")  # fmt: skip
        known.add(name)
        values[names.index(name)] = value
    return values, frozenset(known)


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


def error_rows(experiment: Experiment) -> Mask:
    """Channels that the error figure is over: forces where there are any."""
    units = np.array(experiment.layout.units)
    return np.asarray(units == "N") if (units == "N").any() else np.ones(len(units), np.bool_)


def error_unit(experiment: Experiment) -> str:
    """Unit of the error figure."""
    return "N" if "N" in experiment.layout.units else "N·m"


def rms(values: Array) -> float:
    """Root mean square over everything."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _bracket(name: str) -> str:
    return f"[{name.split('[', 1)[1]}" if "[" in name else ""
