"""Which effects can act in a log beside a model, and at which points of their shapes they are looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid import effects as catalogue
from kinid.effects import Effect, Layout, Signals
from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.remembered import remembered

Array = NDArray[np.float64]


def base_of(model: Model) -> str | None:
    """Name of its base law, or None."""
    return next((effect.id for effect in model.effects if effect.base), None)


def candidate_effects(model: Model, layout: Layout) -> Iterator[tuple[Effect, str]]:
    """Every effect that isn't a base and isn't in the model, with why it can't act in this log ("" where it can)."""
    known = tuple(catalogue.catalogue().values())
    return iter(_candidates(known, model, layout))


@remembered
def _candidates(known: tuple[type[Effect], ...], model: Model, layout: Layout) -> tuple[tuple[Effect, str], ...]:
    base, lacking = base_of(model), [kind() for kind in known if not kind.base and kind.id not in model]
    return tuple((effect, why_inapplicable(effect, model, base, layout)) for effect in lacking)


def why_inapplicable(effect: Effect, model: Model, base: str | None, layout: Layout) -> str:
    """Why an effect can't act in this log, "" where it can: the first reason that holds."""
    stages = {stage.value for stage in effect.stages()}
    on_reading = bool(stages & {"tool", "sensor", "acquisition"})
    torques = layout.kind == "joints"
    slides = any(channel.startswith("tangential") for channel in layout.channels)
    foreign = "joint" not in stages and (not on_reading or "tool" in stages or "wrench" in effect.needs)
    reasons = (
        (torques and foreign, "it acts on contact forces, and this model is of joint torques"),
        (not torques and "joint" in stages, "it acts on joint torques, and this model is of contact forces"),
        (torques and bool(effect.same_for_joints), f"of joint torques it is {effect.same_for_joints}"),
        (
            layout.kind == "contact" and "wrench" in effect.needs,
            "it acts on the whole wrench: record joints and the six channels of the sensor",
        ),
        (layout.kind == "contact" and not slides and stages <= {"friction"}, "no tangential force was recorded"),
        (
            not torques and "normal" in effect.needs and base is None,
            "it acts on contact, and the model has no contact law",
        ),
        (
            any(effect.id in other.includes for other in model.effects),
            f"{next((other.id for other in model.effects if effect.id in other.includes), '')} holds it already",
        ),
        (
            bool(effect.requires) and not any(name in model for name in effect.requires),
            f"it acts on {' or '.join(effect.requires)}, which the model lacks",
        ),
        (not effect.parameters(layout), "this log lacks the channels that it acts on"),
    )
    return next((why for holds, why in reasons if holds), "")


def amplitudes(effect: Effect, layout: Layout, base: str | None) -> dict[int, float]:
    """Which of its parameters make it vanish, with the value at which they do: index → null."""
    null = effect.null_for(base)
    out = {}
    for i, p in enumerate(effect.parameters(layout)):
        key = p.name if p.name in null else p.name.split("[")[0]
        if key in null and not p.fixed:
            out[i] = null[key]
    return out


def shape_points(effect: Effect, signals: Signals, amplitude: dict[int, float]) -> Iterator[tuple[Array, list[int]]]:
    """Points to look at: values of all its parameters, and which amplitudes are away from null there, each alone.

    Shapes come from what the effect calls worth starting from in this log. An amplitude that has a grid of its own (a
    delay, an exponent) changes readings differently when it is large; it is looked at point by point.
    """
    parameters = effect.parameters(signals.layout)
    null = np.array([amplitude.get(i, p.nominal) for i, p in enumerate(parameters)])
    own = [i for i in amplitude if parameters[i].name in effect.grid]
    seen = set()
    for point in effect.initial_guesses(signals) or (null,):
        at = null.copy()
        for i in range(len(at)):
            if i not in amplitude or i in own:
                at[i] = point[i]
        moving = [i for i in own if at[i] != null[i]] if own else list(amplitude)
        key = tuple(at)
        if moving and key not in seen:
            seen.add(key)
            yield at, moving
    if own:  # and a small step of each
        yield null, list(amplitude)


def expand_names(add: Sequence[str], model: Model) -> list[str]:
    """Names of effects to add, for those that stand for several what the model lacks of them."""
    together = catalogue.TOGETHER
    return [part for name in add for part in together.get(name, (name,)) if name not in together or part not in model]


def refuse_names(add: Sequence[str], model: Model, max_effects: int) -> None:
    """Names and numbers that no log could make good; each addition joins the model with those before it."""
    if max_effects < 0:
        raise InputError(f"max_effects of {max_effects}", "0 or more", "0 compares and adds nothing")
    for name in add:
        effect = catalogue.get(name)
        if name in model:
            raise InputError(
                f"effect '{name}' to be added to {model}, which has it",
                "each effect once",
                "don't ask for it: the model is asked about as it is",
            )
        model = model + effect


def refuse_inapplicable(add: Sequence[str], model: Model, experiment: Experiment) -> None:
    """Additions that can't act in this log."""
    for name in add:
        why = {effect.id: why for effect, why in candidate_effects(model, experiment.layout)}
        model = model + catalogue.get(name)
        if why.get(name):
            raise InputError(f"effect '{name}', and {why[name]}", "an effect that can act in this log", "leave it out")
