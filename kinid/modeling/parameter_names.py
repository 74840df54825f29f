"""Names of a model's parameters as users give them, with their effect or without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from kinid.effects import Layout
from kinid.errors import InputError, expect, near
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model


def full_name(name: str, named: Iterable[str], model: Model, what: str = "parameter ") -> str:
    """The full name "effect.parameter" that a name, perhaps without its effect, stands for.

    Raises:
        InputError: none, or several; `what` says what was named.
    """
    expect(name, str, "a parameter", "its name", "as 'stiffness'")
    named = list(named)
    if name in named:
        return name
    ends = [full for full in named if full.split(".", 1)[1] == name]
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise InputError(f"{what}'{name}', which {len(ends)} effects have", f"one of {', '.join(ends)}", "say which")
    ends = [full.split(".", 1)[1] for full in named]
    # what several effects have is offered with its effect
    shown = named if "." in name else [end if ends.count(end) == 1 else full for full, end in zip(named, ends)]
    raise InputError(f"{what}'{name}'", f"a parameter of {model}", near(name, shown))


def assumed_values(model: Model, values: Mapping[str, float], layout: Layout) -> dict[str, float]:
    """Values that are assumed of a model for logs of a layout, under their full names.

    Raises:
        InputError: a name that no parameter has, or several, or a value outside its bounds.
    """
    named = model.parameters(layout)
    whole = {}
    for given, value in values.items():
        name = full_name(given, named, model, "value for ")
        p = named[name]
        if not p.low <= value <= p.high:
            raise InputError(
                f"{name} = {value:g} {p.unit}", f"a value from {p.low:g} to {p.high:g} {p.unit}", "correct it"
            )
        whole[name] = float(value)
    return whole


def starting_values(model: Model, experiment: Experiment, start: Mapping[str, float] | None) -> dict[str, float]:
    """Values that the caller knows, by full name.

    Raises:
        InputError: a name that no parameter has, or a value outside its bounds.
    """
    expect(start or {}, Mapping, "starting values", "values by a parameter's name", "as start={'stiffness': 900}")
    named, out = model.for_log(experiment.signals).parameters(experiment.layout), {}
    for given, value in (start or {}).items():
        name = full_name(given, named, model, "starting value for ")
        p = named[name]
        expect(value, (int, float), f"the starting value of {name}", "a number", "correct it")
        if not p.low <= value <= p.high:
            raise InputError(
                f"starting value {value:g} {p.unit} for '{name}'",
                f"a value from {p.low:g} to {p.high:g} {p.unit}",
                "start inside",
            )
        out[name] = value
    return out
