"""What can't be diagnosed, said before anything is fitted: what was found, what was expected, how to mend it."""

from __future__ import annotations

from collections.abc import Sequence

from kinid import effects
from kinid.errors import InputError
from kinid.identification.applicability import candidate_effects
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model


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
