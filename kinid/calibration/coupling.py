"""Coupling between the axes: estimated as effects of a model, told apart as far as the log allows, and taken out again.

What a sensor's cross-talk, a turned sensor, a tilted surface and a material that pulls sideways do to a pure poke looks
alike. They are fitted together; `identifiability` says which of them the log separates.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries, contact_series
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Signals, catalogue
from kinid.errors import InputError
from kinid.identification.fit import Fit
from kinid.identification.fitted import estimates_in
from kinid.identification.saved import fit_facts
from kinid.modeling.from_logs import from_contact, from_wrench
from kinid.modeling.model import Model
from kinid.parameter import ParameterId
from kinid.writers import Json

Array = NDArray[np.float64]

#: effects that carry force or motion from one axis into another
COUPLING = tuple(name for name, effect in catalogue().items() if effect.couples)
FORCES = ("tangential_force1", "tangential_force2", "normal_force")
#: parameters whose estimates are correlated more than this can't be told apart by the log
ALIKE = 0.98


def identifiability(fit: Fit) -> list[str]:
    """Which coupling parameters this log separates, one line each for those that it doesn't; empty when all are."""
    open_ = [
        name
        for name, is_open in zip(fit.parameters, fit.solution.unidentified)
        if is_open and ParameterId.parse(name).effect in COUPLING
    ]
    return [f"{name} is open: this log doesn't excite it, or not apart from the others" for name in open_] + alike(fit)


def alike(fit: Fit) -> list[str]:
    """Pairs of parameters of different coupling effects whose estimates hang on each other, one line each."""
    names, covariance = [ParameterId.parse(name) for name in fit.parameters], fit.solution.covariance
    mine = [i for i, name in enumerate(names) if name.effect in COUPLING]
    out = []
    for k, i in enumerate(mine):
        for j in mine[k + 1 :]:
            if names[i].effect == names[j].effect:
                continue
            both = covariance[i, i] * covariance[j, j]
            if np.isfinite(both) and both > 0 and abs(covariance[i, j]) > ALIKE * np.sqrt(both):
                out.append(f"{names[i]} and {names[j]} can't be told apart by this log")
    return out


@dataclass(frozen=True, eq=False)
class Compensated:
    """Contact quantities with the estimated coupling taken out, and lateral forces in contact [N rms].

    Attributes:
        touch: without coupling. effects: that were taken out.
        before, after: the whole lateral force, friction and all: while sliding friction is most of it, and coupling may
            have hidden a part.
        coupling: the lateral force that coupling made.
    """

    touch: ContactSeries
    effects: tuple[str, ...]
    before: float
    after: float
    coupling: float

    def line(self) -> str:
        """What a reader wants to know of it: what coupling did, not what friction does."""
        return (
            f"coupling taken out ({', '.join(self.effects)}): it made {self.coupling:.4g} N rms of lateral force in "
            f"contact; what is left, friction and all, is {self.after:.4g} N rms"
        )

    def facts(self) -> Json:
        """For JSON."""
        return {
            "effects": self.effects,
            "lateral_rms_before": self.before,
            "lateral_rms_after": self.after,
            "lateral_rms_of_coupling": self.coupling,
        }


def load_fit(path: Path) -> tuple[Model, dict[str, float]]:
    """Model and values from what `kinid fit --json` wrote, or of the best model of `kinid diagnose --json`.

    Raises:
        InputError: no such file, not a fit, a value that is no number or in another unit, or one of no effect of its.
    """
    model, found = estimates_in(fit_facts(path), path)
    return model, {name: p.value for name, p in found.items()}


def compensate(touch: ContactSeries, log: Log, rig: Rig, model: Model, values: Mapping[str, float]) -> Compensated:
    """Take out of contact forces what the coupling effects of a fitted model put there.

    Args:
        touch: contact quantities of the log. log, rig: where they came from.
        model, values: the fit; it must hold a coupling effect.

    Raises:
        InputError: no coupling effect in the model.
    """
    there = tuple(name for name in model.names if name in COUPLING)
    if not there:
        raise InputError(
            f"a fit of {model} without a coupling effect",
            f"one of {', '.join(COUPLING)} in it",
            "fit with --model kelvin-voigt,surface-tilt,… and pass that fit",
        )
    done = {"effects": list(there)}
    if model.needs_log:
        # taken out of the wrench itself, before bias and tool are: both look different to a sensor that couples
        experiment = from_wrench(log, rig, bias="auto")
        wrench = np.array(log.wrench)
        wrench[experiment.rows] -= _contribution(model, values, experiment.signals).T
        out = contact_series(log.replace(wrench=wrench), rig)
        out = dataclasses.replace(out, provenance=out.provenance.then("coupling taken out of the wrench", **done))
    else:
        experiment = from_contact(touch, FORCES)
        force = _contribution(model, values, experiment.signals)
        changed: Json = {name: np.array(getattr(touch, name)) for name in FORCES}
        for axis, name in enumerate(FORCES):
            changed[name][experiment.rows] -= force[axis]
        provenance = touch.provenance.then("coupling taken out", **done)
        out = dataclasses.replace(touch, provenance=provenance, **changed)
    before, after = _pair(touch), _pair(out)
    made = before[0] - after[0], before[1] - after[1]
    return Compensated(out, there, *(_lateral(pair, touch) for pair in (before, after, made)))


def _contribution(model: Model, values: Mapping[str, float], signals: Signals) -> Array:
    """Readings with the coupling less readings without it."""
    named = model.parameters(signals.layout)
    base = next((effect.id for effect in model.effects if effect.base), None)
    full = {name: values.get(name, p.nominal) for name, p in named.items()}
    without = dict(full)
    for effect in model.effects:
        if effect.id in COUPLING:
            for name, p in named.items():
                if ParameterId.parse(name).effect == effect.id:
                    without[name] = effect.null_for(base).get(p.stem, p.nominal)
    difference: Array = model.predict(signals, full) - model.predict(signals, without)
    return difference


def _pair(touch: ContactSeries) -> tuple[Array, Array]:
    """Both tangential forces [N], (n,) each."""
    return touch.tangential_force1, touch.tangential_force2


def _lateral(forces: tuple[Array, Array], reference: ContactSeries) -> float:
    """Root mean square of a lateral force where the reference is in contact [N]."""
    inside = reference.in_contact & np.isfinite(forces[0])
    if not inside.any():
        return 0.0
    return float(np.sqrt(np.mean(forces[0][inside] ** 2 + forces[1][inside] ** 2)))
