"""A model with its estimates: what a fit says, on disk and for data that it has not seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Effect, Layout, Signals
from kinid.effects._signals import RestForm
from kinid.errors import InputError, expect
from kinid.identification.saved import MEND, WHAT, fit_facts, layout_in, model_in, number_in, rest_in
from kinid.identification.saved_schema import SavedFit, checked
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import full_name
from kinid.modeling.readings import experiment_for
from kinid.shown import Shown
from kinid.writers import Json, finite, write_json

Array = NDArray[np.float64]

READ = "read it with kinid.read(path, rig), and make contact-frame quantities with kinid.contact_series(log, rig)"


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

    def to_dict(self) -> Json:
        """For JSON: an open end is null."""
        return {"value": self.value, "low": finite(self.low), "high": finite(self.high), "unit": self.unit}


@dataclass(frozen=True)
class FitError:
    """Root mean square of measured less predicted force or torque: seen, held out, and what noise alone explains."""

    train: float
    held_out: float
    noise_floor: float
    unit: str

    def to_dict(self) -> Json:
        """For JSON; None where there is no figure."""
        figures = {"train": self.train, "held_out": self.held_out, "noise_floor": self.noise_floor}
        return {"unit": self.unit} | {name: finite(value) for name, value in figures.items()}


@dataclass(frozen=True, eq=False, repr=False)
class FittedModel(Shown):
    """A model with its estimates, as `Fit.load` reads them again. `fit["stiffness"]` or `fit["hooke.stiffness"]` is a
    `FittedParameter`.

    Attributes:
        model: that was fitted. parameters: by "effect.parameter". error: seen and held out. warnings: what to doubt.
        layout: the channels that it was fitted to. rest: the form of friction at rest that was found.
    """

    model: Model
    parameters: dict[str, FittedParameter]
    error: FitError
    warnings: tuple[str, ...]
    layout: Layout
    rest: RestForm

    @classmethod
    def load(cls, path: str | Path) -> FittedModel:
        """A fit that `save`, `kinid fit --json` or `kinid diagnose --json` wrote, without the log that it was made to.

        Raises:
            InputError: no such file, one that is too large or nested too deeply, or no fit.
        """
        expect(path, (str, Path), "a fit's file", "a path", "name the file")
        path = Path(path)
        facts = fit_facts(path)
        model, parameters = estimates_in(facts, path)
        layout = layout_in(facts, path)
        known = checked(facts, SavedFit, path, WHAT, MEND)
        error = (known.error.train, known.error.held_out, known.error.noise_floor)
        train, held_out, noise = (np.nan if value is None else value for value in error)
        return FittedModel(
            model,
            parameters,
            FitError(train, held_out, noise, known.error.unit),
            tuple(known.warnings),
            layout,
            rest_in(facts, path),
        )

    def save(self, path: str | Path) -> None:
        """Write it as JSON, as `kinid fit --json` does; `Fit.load` reads it again.

        Raises:
            InputError: a folder that isn't there or can't be written to.
        """
        expect(path, (str, Path), "a fit's file", "a path", "name the file")
        write_json(Path(path), self.to_save())

    def __repr__(self) -> str:
        many = len(self.parameters)
        error = f"{self.error.held_out:.4g} {self.error.unit} held out" if np.isfinite(self.error.held_out) else "none"
        return f"<{type(self).__name__} {self.model}: {many} parameter{'s' * (many != 1)}, error {error}>"

    def __str__(self) -> str:
        lines = [
            f"{name} = {p.value:.4g} [{p.low:.4g}, {p.high:.4g}] {p.unit}".removesuffix(" 1")
            for name, p in self.parameters.items()
        ]
        error = f"error {self.error.train:.4g} {self.error.unit}, held out {self.error.held_out:.4g}"
        return "\n".join([f"{self.model}: {error}", *lines])

    def __getitem__(self, name: str) -> FittedParameter:
        return self.parameters[full_name(name, self.parameters, self.model)]

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Estimates, one a row: name, value, ends of the 95 % interval, unit."""
        rows = list(self.parameters.values())
        numbers = {name: np.array([getattr(p, name) for p in rows], dtype=float) for name in ("value", "low", "high")}
        return {
            "parameter": np.array([p.name for p in rows], dtype=str),
            **numbers,
            "unit": np.array([p.unit for p in rows], dtype=str),
        }

    def notes(self) -> tuple[str, ...]:
        """What to doubt."""
        return tuple(f"doubt: {warning}" for warning in self.warnings)

    @property
    def values(self) -> Array:
        """Estimates in the model's order, (p,).

        Raises:
            InputError: a model whose parameters hang on the log that it was fitted to.
        """
        named = self.model.parameters(self.layout)
        if set(self.parameters) != {name for name, p in named.items() if not p.fixed}:
            raise InputError(
                f"a saved fit of {self.model}, whose parameters are those of its log",
                "a model that is the same for every log",
                "fit it anew to the log at hand",
            )
        return np.array([self.parameters[name].value if not p.fixed else p.nominal for name, p in named.items()])

    def predict(self, data: ContactSeries | Log, rig: Rig | None = None) -> Array:
        """Readings that the fitted model expects of other data, (channels, n); the channels are `layout.channels`.

        Args:
            data: contact-frame quantities, or a log with its rig. rig: goes with a log.

        Returns:
            A row a channel, a column a sample of the data; NaN where the motion isn't known.

        Raises:
            InputError: data that lacks what the fit was made to.

        What a fit found of its rig's calibration (a bias, the surface's offset) is of its log, and is not on disk: what
        was loaded predicts without it, as `Fit.predict(…, calibrated=False)` does.
        """
        return on_all_rows(self.experiment_of(data, rig), len(data), self._predicted)

    def experiment_of(self, data: ContactSeries | Log, rig: Rig | None = None) -> Experiment:
        """Data as what the fit was made to; arguments and errors as of `predict`."""
        expect(data, (ContactSeries, Log), "data to predict", "a log with its rig, or contact-frame quantities", READ)
        own = self.layout
        made = experiment_for(self.model, data, rig, own.channels if own.kind == "contact" else None)
        if made.layout != own:
            raise InputError(
                f"{', '.join(made.layout.channels)} to predict",
                f"{', '.join(own.channels)}, which the fit was made to",
                "fit to data of this kind, or predict data of that",
            )
        return made

    def _predicted(self, signals: Signals) -> Array:
        return self.model.predict(dataclasses.replace(signals, rest=self.rest), self.values)

    def equation(self) -> str:
        """The model as equations with its numbers."""
        lines = []
        for effect in self.model.effects:
            numbers = ", ".join(
                f"{p.symbol}{p.name.removeprefix(p.name.partition('[')[0])} = "
                f"{self.parameters[f'{effect.id}.{p.name}'].value:.4g} {p.unit}".removesuffix(" 1")
                for p in effect.parameters(self.layout)
                if not p.fixed and f"{effect.id}.{p.name}" in self.parameters
            )
            lines.append(f"{effect.id}: {effect.equation}" + (f"   with {numbers}" if numbers else ""))
        return "\n".join(lines)

    def to_dict(self) -> Json:
        """The facts, for JSON."""
        return {
            "model": list(self.model.names),
            "parameters": {name: p.to_dict() for name, p in self.parameters.items()},
            "error": self.error.to_dict(),
            "warnings": list(self.warnings),
        }

    def to_save(self) -> Json:
        """The facts as `save` and `kinid fit --json` write them, with what a prediction needs beside them."""
        own = self.layout
        return self.to_dict() | {
            "layout": {"channels": list(own.channels), "kind": own.kind, "joints": list(own.joints)},
            "rest": dataclasses.asdict(self.rest),
        }


def estimates_in(facts: Json, path: Path) -> tuple[Model, dict[str, FittedParameter]]:
    """The model of a saved fit, and its estimates by name.

    Raises:
        InputError: no model, an estimate of no effect of it, or one that `parameters_in` refuses.
    """
    model = model_in(facts, path)
    own = model.parameters(layout_in(facts, path)) if "layout" in facts else {}
    found = parameters_in(facts["parameters"], path, {name: p.unit for name, p in own.items()})
    stray = [name for name in found if name.split(".", 1)[0] not in model.names]
    if stray:
        raise InputError(f"{stray[0]} beside the model {model} in {path}", WHAT, MEND)
    whole = {effect.id for effect in model.effects if type(effect).for_log is Effect.for_log}
    for name, p in own.items():
        if name not in found and name.split(".", 1)[0] in whole:
            raise InputError(f"no {name} in {path}, whose model has it", WHAT, MEND)
        if name in found and not p.low <= found[name].value <= p.high:
            expected = f"{p.low:g} to {p.high:g} {p.unit}".removesuffix(" 1")
            raise InputError(f"{name} = {found[name].value:g} in {path}", expected, MEND)
    return model, found


def parameters_in(facts: Json, path: Path, units: Mapping[str, str]) -> dict[str, FittedParameter]:
    """Estimates by name, of a file.

    Args:
        facts: of each parameter. units: that the model has them in, as far as the file tells.

    Raises:
        InputError: one without a value, whose numbers are none, outside its interval, or in another unit.
    """
    out = {}
    for name, found in facts.items():
        if not isinstance(found, dict) or found.get("value") is None:
            raise InputError(f"{name} without a value in {path}", WHAT, MEND)
        unit = found.get("unit", units.get(name, "1"))
        if unit != units.get(name, unit) or not isinstance(unit, str):
            raise InputError(f"{name} in {str(unit)[:40]} in {path}", f"it in {units.get(name, 'its unit')}", MEND)
        ends = (number_in(found, "low", path, open_end=-np.inf), number_in(found, "high", path, open_end=np.inf))
        value = number_in(found, "value", path)
        if not ends[0] <= value <= ends[1]:
            raise InputError(f"{name} = {value:g} outside its interval in {path}", WHAT, MEND)
        out[name] = FittedParameter(name, value, *ends, unit)
    return out


def on_all_rows(experiment: Experiment, n: int, predicted: Callable[[Signals], Array]) -> Array:
    """A prediction (channels, n) for all n samples that an experiment was made of; NaN on those that it left out."""
    out = np.full((len(experiment.layout.channels), n), np.nan)
    out[:, experiment.rows] = predicted(experiment.signals)
    return out
