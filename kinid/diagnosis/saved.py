"""A diagnosis on disk: what `save` and `kinid diagnose --json` write, read again with every field checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from kinid import effects
from kinid.diagnosis.result import EffectStatus, EffectVerdict, Findings, Step, Verdict
from kinid.errors import InputError
from kinid.identification.fitted import FittedModel, parameters_in
from kinid.identification.saved_schema import Number, SavedFacts, Share, Size, Unit, checked
from kinid.inputs import read_json
from kinid.modeling.model import Model
from kinid.writers import Json

WHAT, MEND = "what found.save or kinid diagnose --json wrote", "diagnose anew and save that"


class _Errors(SavedFacts):
    unit: Unit
    before: Size
    after: Size
    noise_floor: Size


class _Step(SavedFacts):
    class Errors(SavedFacts):
        train: Size | None
        held_out: Size

    added: str | None
    model: list[str]
    explained: Share
    error: Errors


class _Cell(SavedFacts):
    channel: str
    phase: str
    share: Share
    says: str
    rms: Size
    unit: str


class _Left(SavedFacts):
    rms: Size
    share_of_reading: Size | None
    memory_s: Size | None


class _Effect(SavedFacts):
    id: str
    verdict: Literal["present", "absent", "not-excited", "indistinguishable"]
    evidence: Number | None
    equivalent_to: list[str]
    held_out_gain: Number | None
    parameters: dict[str, dict[str, object]]
    separate_by: str
    says: str
    acts: bool
    left_out: bool = False
    within: str = ""
    stand_in: bool = False


class _Facts(SavedFacts):
    """Of `found.save` and `kinid diagnose --json`."""

    model: list[str]
    verdict: Literal["adequate", "missing", "unexplained"]
    says: str
    added: list[str]
    error: _Errors
    steps: Annotated[list[_Step], Field(min_length=1)]
    corrected: list[str]
    where: list[_Cell]
    tolerance: Size
    explained: Share
    left: _Left
    left_where: list[_Cell]
    effects: Annotated[list[_Effect], Field(min_length=1)]
    warnings: list[str]
    fit: dict[str, object]

    @model_validator(mode="after")
    def _agrees(self) -> _Facts:
        first, last = self.steps[0], self.steps[-1]
        if first.model != self.model or set(self.added) - set(last.model) or last.model != self.fit.get("model"):
            raise PydanticCustomError("ladder", "steps lead from the model over what was added to the model of the fit")
        if (self.error.before, self.error.after) != (first.error.held_out, last.error.held_out):
            raise PydanticCustomError("error", "errors before and after are those of the first and the last step")
        if self.verdict == "missing" and not self.added:
            raise PydanticCustomError("verdict", "a model that lacks something has it added")
        return self


@dataclass(frozen=True, eq=False, repr=False)
class SavedDiagnosis(Findings):
    """What a diagnosis found, without the log that it was made of.

    Attributes:
        facts: all that the file holds. fit: of the best model.
    """

    fit: FittedModel
    facts: Json

    def to_dict(self) -> Json:
        """The facts as they were read."""
        return self.facts


def load(path: Path) -> SavedDiagnosis:
    """A diagnosis that was saved.

    Raises:
        InputError: no such file, one that is too large or nested too deeply, or no diagnosis.
    """
    facts = read_json(path, "diagnosis", WHAT, MEND)
    if not isinstance(facts, dict):
        raise InputError(f"{path}, which is no diagnosis", WHAT, MEND)
    known, fit = checked(facts, _Facts, path, WHAT, MEND), FittedModel.load(path)
    return SavedDiagnosis(
        Model(*known.model),
        Model(*known.steps[-1].model),
        Verdict(known.verdict),
        known.says,
        tuple(known.added),
        tuple(
            Step(
                step.added,
                tuple(step.model),
                np.nan if step.error.train is None else step.error.train,
                step.error.held_out,
                step.explained,
            )
            for step in known.steps
        ),
        known.error.noise_floor,
        known.error.unit,
        tuple(_effect(effect, path) for effect in known.effects),
        tuple(known.warnings),
        fit,
        facts,
    )


def _effect(known: _Effect, path: Path) -> EffectVerdict:
    effects.get(known.id)
    found = parameters_in(known.parameters, path, {})
    return EffectVerdict(
        known.id,
        EffectStatus(known.verdict),
        np.inf if known.evidence is None else known.evidence,
        known.says,
        tuple(known.equivalent_to),
        np.nan if known.held_out_gain is None else known.held_out_gain,
        {name: replace(p, name=f"{known.id}.{name}") for name, p in found.items()},
        known.separate_by,
        known.acts,
        known.left_out,
        known.within,
        known.stand_in,
    )
