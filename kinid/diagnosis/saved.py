"""A diagnosis on disk: what `save` and `kinid diagnose --json` write, read again with every field checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from kinid.diagnosis.result import EffectStatus, EffectVerdict, Findings, Step, Verdict
from kinid.errors import InputError
from kinid.identification.fitted import FittedModel, parameters_in
from kinid.identification.saved import model_in, number_in
from kinid.inputs import read_json
from kinid.modeling.model import Model
from kinid.writers import Json

#: fields of the file that are read, and their types
FIELDS = {"verdict": str, "says": str, "error": dict, "fit": dict}
FIELDS |= dict.fromkeys(("added", "steps", "effects", "warnings"), list)
WHAT, MEND = "what found.save or kinid diagnose --json wrote", "diagnose anew and save that"


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
    if not isinstance(facts, dict) or not all(isinstance(facts.get(name), kind) for name, kind in FIELDS.items()):
        raise InputError(f"{path}, which is no diagnosis", WHAT, MEND)
    fit = FittedModel.load(path)
    try:
        steps = tuple(_step(step, path) for step in facts["steps"])
        return SavedDiagnosis(
            model_in(facts, path),
            Model(*steps[-1].model),
            Verdict(facts["verdict"]),
            str(facts["says"]),
            tuple(map(str, facts["added"])),
            steps,
            number_in(facts["error"], "noise_floor", path),
            str(facts["error"]["unit"]),
            tuple(_effect(effect, path) for effect in facts["effects"]),
            tuple(map(str, facts["warnings"])),
            fit,
            facts,
        )
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}, which is no whole diagnosis ({error})", WHAT, MEND) from None


def _step(facts: Json, path: Path) -> Step:
    error = facts["error"]
    train, held_out = number_in(error, "train", path), number_in(error, "held_out", path)
    return Step(facts["added"], tuple(facts["model"]), train, held_out, number_in(facts, "explained", path))


def _effect(facts: Json, path: Path) -> EffectVerdict:
    found = parameters_in(facts["parameters"], path, {})
    return EffectVerdict(
        str(facts["id"]),
        EffectStatus(facts["verdict"]),
        number_in(facts, "evidence", path, open_end=np.inf),
        str(facts["says"]),
        tuple(map(str, facts["equivalent_to"])),
        number_in(facts, "held_out_gain", path),
        {name: replace(p, name=f"{facts['id']}.{name}") for name, p in found.items()},
        str(facts["separate_by"]),
        bool(facts["acts"]),
        bool(facts.get("left_out", False)),
        str(facts.get("within", "")),
        bool(facts.get("stand_in", False)),
    )
