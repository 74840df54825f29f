"""A model fitted to a log: estimates with intervals, errors on samples that it saw and didn't see, and what to doubt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.contact import ContactSeries
from kinid.errors import InputError, near
from kinid.estimators.batch import ILL_CONDITIONED, Solution
from kinid.estimators.power_law import fit_power_law
from kinid.experiment import Experiment, from_contact, from_joint_torques, from_wrench
from kinid.log import Log
from kinid.model import Model
from kinid.parameter import Parameter
from kinid.rig import Rig
from kinid.task import Task

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: 97.5 % quantile of the normal distribution: logs are long, so that Student's t is the same
Z95 = 1.959963984540054
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


@dataclass(frozen=True)
class FitError:
    """Root mean square of measured less predicted force (or torque): seen, unseen, and what the noise alone explains."""

    train: float
    held_out: float
    noise_floor: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"unit": self.unit, "train": self.train, "held_out": self.held_out, "noise_floor": self.noise_floor}


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

    def __getitem__(self, name: str) -> FittedParameter:
        if name in self.parameters:
            return self.parameters[name]
        ends = [full for full in self.parameters if full.split(".", 1)[1] == name]
        if len(ends) == 1:
            return self.parameters[ends[0]]
        if ends:
            raise InputError(f"parameter '{name}', which {len(ends)} effects have", f"one of {', '.join(ends)}", "say which")
        raise InputError(f"parameter '{name}'", f"a parameter of {self.model}", near(name, self.parameters))

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
            "parameters": {name: {"value": p.value, "low": p.low, "high": p.high, "unit": p.unit}
                           for name, p in self.parameters.items()},
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
    start: dict[str, float] | None = None,
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
        start: starting values by parameter name.
        held_out: compute the held-out error, which costs two more fits.

    Raises:
        InputError: data that can't carry the model, and what to record instead.
    """
    experiment = experiment_for(model, data, rig, channels)
    _refuse_idle(model, experiment)
    named = model.parameters(experiment.layout)
    warnings = check_excitation(model, experiment)
    task = Task(model, experiment)
    begin = starting_values(model, experiment, named, start)
    mask = experiment.valid if train is None else experiment.valid & train
    solution = task.solve(begin, mask)
    rows = error_rows(experiment)
    if train is not None:
        unseen = rms(solution.residual[rows][:, experiment.valid & ~train])
    elif held_out:
        unseen = rms(task.held_out_residual(solution.values)[rows][:, experiment.valid])
    else:
        unseen = float("nan")
    error = FitError(rms(solution.residual[rows][:, mask]), unseen, rms(experiment.noise[rows]), error_unit(experiment))
    warnings += _doubts(named, solution, error, begin)
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
        if model.needs_log:
            raise InputError(
                f"contact-frame quantities for {model}, which acts on the whole wrench or on joint torques",
                "the log itself with its rig",
                "call fit(log, rig)",
            )
        return from_contact(data, tuple(channels or contact_channels(model, data)))
    if rig is None:
        raise InputError("a log without its rig", "both", "call fit(log, rig)")
    if "joints" in model.needs:
        return from_joint_torques(data, rig)
    if model.needs_log or (data.wrench is not None and data.q is not None and model.acts_on_reading):
        return from_wrench(data, rig)
    from kinid.contact import contact_series

    return experiment_for(model, contact_series(data, rig), None, channels)


def contact_channels(model: Model, touch: ContactSeries) -> tuple[str, ...]:
    """The contact forces that a model says something about."""
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
            "check [surface] point and normal, or let touches find them with --find-surface")  # fmt: skip
    if inside.sum() < FEWEST_TOUCHING:
        raise InputError(f"{int(inside.sum())} samples inside the material", f"{FEWEST_TOUCHING} at least",
                         "poke for longer, or log faster")  # fmt: skip
    if np.ptp(depth[inside]) < 1e-9:
        raise InputError("a depth that never changes inside the material", "at least two depths",
                         "poke with a motion of a few tenths of a millimetre")  # fmt: skip
    if (~experiment.in_contact & experiment.valid).any():
        return []
    return ["no free motion in the log: a bias of the sensor would look like stiffness"]


def starting_values(model: Model, experiment: Experiment, named: dict[str, Parameter], start: dict[str, float] | None) -> Array:
    """Nominal values, a power law's exponent from a fit of its own, and what the caller knows better."""
    values = np.array([p.nominal for p in named.values()])
    if "hunt-crossley.exponent" in named and "normal_force" in experiment.layout.channels:
        row = experiment.layout.channels.index("normal_force")
        keep = experiment.valid
        quick = fit_power_law(experiment.signals.depth[keep], experiment.signals.depth_rate[keep],
                              experiment.measured[row][keep])  # fmt: skip
        if quick.converged:
            values[list(named).index("hunt-crossley.exponent")] = quick.exponent
    for name, value in (start or {}).items():
        if name not in named:
            raise InputError(f"starting value for '{name}'", f"a parameter of {model}", near(name, named))
        values[list(named).index(name)] = value
    return values


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


def _doubts(named: dict[str, Parameter], solution: Solution, error: FitError, start: Array) -> list[str]:
    """What a reader of the estimates should doubt, each with what to do about it."""
    out = []
    for name, p, value, bound, open_, began in zip(
        named, named.values(), solution.values, solution.at_bound, solution.unidentified, start
    ):
        if open_:
            out.append(f"{name} is not identified by this log: its interval is infinite")
        elif bound:
            out.append(f"{name} = {value:.4g} ended at its bound: the law may be the wrong one, or the log doesn't excite it")
        if began in (p.low, p.high) and p.low != p.nominal != p.high:
            out.append(f"{name} started at its bound {began:.4g}: start inside")
    if solution.condition > ILL_CONDITIONED:
        out.append(f"ill-conditioned ({solution.condition:.1e}): some parameters can trade against each other in this log")
    if not solution.converged:
        out.append("the search stopped before it converged: start nearer, or use a smaller model")
    if np.isfinite(error.train) and error.noise_floor > 0 and error.train > 1.5 * error.noise_floor:
        out.append(f"the residual is {error.train / error.noise_floor:.1f} times the noise: this structure is rejected, "
                   "kinid diagnose says what may be missing")  # fmt: skip
    return out


def _bracket(name: str) -> str:
    return f"[{name.split('[', 1)[1]}" if "[" in name else ""
