"""What a diagnosis says: where the model fails, which effect it lacks, how sure that is, and what to measure next."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, expect, near
from kinid.identification.fit import Fit
from kinid.identification.fitted import FittedParameter
from kinid.identification.lack_of_fit import LackOfFit
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.residuals import Cell
from kinid.shown import Shown
from kinid.writers import Json, finite, write_json

if TYPE_CHECKING:
    from kinid.diagnosis.saved import SavedDiagnosis

Array = NDArray[np.float64]


class Verdict(StrEnum):
    """What a diagnosis says of a model."""

    ADEQUATE = "adequate"
    MISSING = "missing"
    UNEXPLAINED = "unexplained"


class EffectStatus(StrEnum):
    """What a diagnosis says of an effect."""

    PRESENT = "present"
    ABSENT = "absent"
    NOT_EXCITED = "not-excited"
    INDISTINGUISHABLE = "indistinguishable"


class EffectGroup(StrEnum):
    """Where a reader looks for an effect: its status, and of what is not excited, why."""

    PRESENT = "present"
    INDISTINGUISHABLE = "indistinguishable"
    ABSENT = "absent"
    NOT_EXCITED = "not-excited"
    LEFT_OUT = "left-out"
    FOREIGN = "foreign"


@dataclass(frozen=True)
class EffectVerdict:
    """What the log says about one effect.

    Attributes:
        id: its name. verdict: what the log says of it.
        evidence: significance of its paired held-out gain, which is the gain over its standard error; 4 is the least
            that is accepted. Infinite for what stands in the samples themselves.
        says: the verdict in words. equivalent_to: effects that this log can't tell it from.
        held_out_gain: by how much it lowers the held-out error, in the error's unit.
        parameters: with 95 % intervals, where it was fitted.
        separate_by: how to tell it from what it is mistaken for, or what to record to see it.
        acts: whether it can act at all in a log of this kind and beside this model.
        left_out: whether it promised much, and the search ended before it was tried: the log may well tell.
        stand_in: whether it takes off too little beside what is left, where the diagnosis ends unexplained.
        within: of an absent one, how far that reaches, where it says nothing of one elsewhere.
    """

    id: str
    verdict: EffectStatus
    evidence: float
    says: str
    equivalent_to: tuple[str, ...] = ()
    held_out_gain: float = 0.0
    parameters: dict[str, FittedParameter] = field(default_factory=dict)
    separate_by: str = ""
    acts: bool = True
    left_out: bool = False
    within: str = ""
    stand_in: bool = False

    @property
    def group(self) -> EffectGroup:
        """Where a reader looks for it."""
        if self.verdict != EffectStatus.NOT_EXCITED or (self.acts and not self.left_out):
            return EffectGroup(self.verdict)
        return EffectGroup.LEFT_OUT if self.left_out else EffectGroup.FOREIGN

    @property
    def label(self) -> str:
        """Its name, with how far its absence reaches."""
        return f"{self.id} ({self.within})" if self.within else self.id

    def to_dict(self) -> Json:
        """For JSON."""
        return {
            "id": self.id,
            "verdict": self.verdict,
            "evidence": finite(self.evidence),
            "equivalent_to": list(self.equivalent_to),
            "held_out_gain": self.held_out_gain,
            "parameters": {name: p.to_dict() for name, p in self.parameters.items()},
            "separate_by": self.separate_by,
            "says": self.says,
            "acts": self.acts,
            "left_out": self.left_out,
            "stand_in": self.stand_in,
            "within": self.within,
        }


@dataclass(frozen=True)
class Step:
    """One step of the model's path: what was added, the model then, its error on samples seen and held out.

    `explained` is the share of the first model's squared error beyond noise that is gone by then, 0…1.
    """

    added: str | None
    model: tuple[str, ...]
    train: float
    held_out: float
    explained: float = 0.0

    def to_dict(self) -> Json:
        """For JSON."""
        return {
            "added": self.added,
            "model": list(self.model),
            "explained": self.explained,
            "error": {"train": self.train, "held_out": self.held_out},
        }


@dataclass(frozen=True, eq=False, repr=False)
class Findings(Shown):
    """What a diagnosis found, be it at hand or on disk.

    Attributes:
        model: that was asked about. best: with what it lacked.
        verdict: of `model`. says: why, in words.
        added: names, in the order in which they help.
        steps: the ladder, from the model to the best one; errors are of the same samples on each.
        noise_floor: what the noise alone explains; unit: of all errors.
        effects: a verdict for every effect of the catalogue.
        warnings: what to doubt.
    """

    model: Model
    best: Model
    verdict: Verdict
    says: str
    added: tuple[str, ...]
    steps: tuple[Step, ...]
    noise_floor: float
    unit: str
    effects: tuple[EffectVerdict, ...]
    warnings: tuple[str, ...]

    @classmethod
    def load(cls, path: str | Path) -> SavedDiagnosis:
        """What `save` or `kinid diagnose --json` wrote, without the log that it was made of.

        Raises:
            InputError: no such file, one that is too large or nested too deeply, or no diagnosis.
        """
        from kinid.diagnosis import saved

        expect(path, (str, Path), "a diagnosis' file", "a path", "name the file")
        return saved.load(Path(path))

    @abstractmethod
    def to_dict(self) -> Json:
        """The facts as `kinid diagnose --json` writes them."""

    def save(self, path: str | Path) -> None:
        """Write it as JSON, as `kinid diagnose --json` does; `Diagnosis.load` reads it again.

        Raises:
            InputError: a folder that isn't there or can't be written to.
        """
        expect(path, (str, Path), "a diagnosis' file", "a path", "name the file")
        write_json(Path(path), self.to_dict())

    @property
    def explained(self) -> float:
        """Share of the squared error beyond noise that the additions take off, 0…1."""
        return self.steps[-1].explained

    def __repr__(self) -> str:
        added = ", ".join(with_alternatives(self.added, self.effects)) or "nothing added"
        before, after = self.steps[0].held_out, self.steps[-1].held_out
        error = f"{before:.4g} → {after:.4g} {self.unit} held out"
        return f"<{type(self).__name__} of {self.model}: {self.verdict}, {added}; {error}>"

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Effects, one a row: what the log says of each."""
        texts = {name: np.array([getattr(e, name) for e in self.effects], dtype=str) for name in ("verdict", "says")}
        numbers = {
            name: np.array([getattr(e, name) for e in self.effects], dtype=float)
            for name in ("evidence", "held_out_gain")
        }
        return {"effect": np.array([e.id for e in self.effects], dtype=str), **texts, **numbers}

    def notes(self) -> tuple[str, ...]:
        """Why, and what to doubt."""
        return (self.says, *(f"doubt: {warning}" for warning in self.warnings))

    def __getitem__(self, name: str) -> EffectVerdict:
        for effect in self.effects:
            if effect.id == name:
                return effect
        raise InputError(f"effect '{name}'", "one that was looked at", near(name, [e.id for e in self.effects]))


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Findings):
    """Where a model fails, and which effects it lacks; the attributes of `Findings`, and what is at hand with its log.

    Attributes:
        corrected: what was added first and is every log's own (a sensor's zero, a surface's place, a clock).
        where: cells in which the error of `model` sits beside that, the largest share first. left_where: the same of
            the best model.
        left: what the best model leaves beside noise and tolerance.
        experiment: what was looked at. residual: of `model`, held out, (channels, n); residual_after: of the best one.
        fit: of the best model, to everything.
    """

    corrected: tuple[str, ...]
    where: tuple[Cell, ...]
    left_where: tuple[Cell, ...]
    left: LackOfFit
    experiment: Experiment
    residual: Array
    residual_after: Array
    fit: Fit

    def __str__(self) -> str:
        warnings = "".join(f"\ndoubt: {warning}" for warning in self.warnings)
        added = ", ".join(with_alternatives(self.added, self.effects)) or "nothing added"
        before, after = self.steps[0].held_out, self.steps[-1].held_out
        error = f"held-out error {before:.3g} → {after:.3g} {self.unit}, noise {self.noise_floor:.3g} {self.unit}"
        return f"{self.verdict}: {added}; {error}\n{self.says}{warnings}\n{self.fit}"

    def to_dict(self) -> Json:
        """The facts as `kinid diagnose --json` writes them."""
        return {
            "model": list(self.model.names),
            "verdict": self.verdict,
            "says": self.says,
            "added": list(self.added),
            "error": {
                "unit": self.unit,
                "before": self.steps[0].held_out,
                "after": self.steps[-1].held_out,
                "noise_floor": self.noise_floor,
            },
            "steps": [step.to_dict() for step in self.steps],
            "corrected": list(self.corrected),
            "where": [cell.to_dict() for cell in self.where],
            "tolerance": self.left.tolerance,
            "explained": self.explained,
            "left": self.left.to_dict(),
            "left_where": [cell.to_dict() for cell in self.left_where],
            "effects": [effect.to_dict() for effect in self.effects],
            "warnings": list(self.warnings),
            "fit": self.fit.to_save(),
        }


def with_alternatives(names: Iterable[str], effects: Iterable[EffectVerdict]) -> list[str]:
    """Each effect as "a or b or …" with those that the log can't tell it from."""
    alternatives = {effect.id: effect.equivalent_to for effect in effects}
    return [" or ".join([name, *alternatives.get(name, ())]) for name in names]
