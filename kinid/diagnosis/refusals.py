"""What can't be diagnosed, said before anything is fitted: what was found, what was expected, how to mend it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinid import effects
from kinid.errors import InputError
from kinid.identification.applicability import candidate_effects
from kinid.modeling.data_warnings import DEEPEST, DEPTH_UNIT
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model

#: a log must last so long [s], and hold so many blocks of half a second that count
SHORTEST, FEWEST_BLOCKS = 4.0, 8


def one_by_one(add: Sequence[str], model: Model) -> list[str]:
    """Names of effects to add, for those that stand for several what the model lacks of them."""
    together = effects.TOGETHER
    return [part for name in add for part in together.get(name, (name,)) if name not in together or part not in model]


def refuse_names(add: Sequence[str], model: Model, max_effects: int) -> None:
    """Names and numbers that no log could make good; each addition joins the model with those before it."""
    if max_effects < 0:
        raise InputError(f"max_effects of {max_effects}", "0 or more", "0 compares and adds nothing")
    for name in add:
        effect = effects.get(name)
        if name in model:
            raise InputError(
                f"effect '{name}' to be added to {model}, which has it",
                "each effect once",
                "don't ask for it: the model is asked about as it is",
            )
        model = model + effect


def refuse_idle(add: Sequence[str], model: Model, experiment: Experiment) -> None:
    """Additions that can't act in this log."""
    for name in add:
        why = {effect.id: why for effect, why in candidate_effects(model, experiment.layout)}
        model = model + effects.get(name)
        if why.get(name):
            raise InputError(f"effect '{name}', and {why[name]}", "an effect that can act in this log", "leave it out")


def refuse_log(experiment: Experiment, model: Model) -> None:
    """Too little of it, or a depth that no tool has."""
    s = experiment.signals
    if not experiment.valid.any():
        raise InputError("no sample with all of its channels", "readings that are numbers", "check the log's columns")
    span = float(np.ptp(s.t[experiment.valid]))
    if span < SHORTEST:
        raise InputError(
            f"{span:.3g} s of log",
            f"{SHORTEST:g} s at least, to hold half of it out in blocks of half a second",
            "record several pokes, with holds and slides between them",
        )
    blocks = len(np.unique((s.t[experiment.valid] / 0.5).astype(int)))
    if blocks < FEWEST_BLOCKS:
        raise InputError(
            f"{blocks} blocks of half a second with readings",
            f"{FEWEST_BLOCKS} at least",
            "record for longer, or find out why so many samples are invalid",
        )
    if "normal" in model.needs and s.layout.kind != "joints" and not (s.depth[experiment.valid] > 0).any():
        raise InputError(
            f"a depth that is never positive, for {model}",
            "samples inside the material",
            "check [surface] of the rig, or ask about --model none",
        )
    deep = float(s.depth[experiment.valid].max()) if "normal" in model.needs and s.layout.kind == "contact" else 0.0
    if deep > DEEPEST:
        raise InputError(f"depths of up to {deep:.3g} m", "metres inside the material", f"say so {DEPTH_UNIT}")
