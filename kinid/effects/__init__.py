"""The catalogue of effects: every file of this folder whose name has no leading underscore holds one effect."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from kinid.effects._effect import Effect, Stage
from kinid.effects._samples import Detection, Samples
from kinid.effects._signals import AsRead, JointMotion, Layout, SensorMotion, Signals
from kinid.errors import InputError, near

__all__ = [
    "TOGETHER",
    "AsRead", "Detection", "Effect", "JointMotion", "Layout", "Samples", "SensorMotion", "Signals", "Stage", "catalogue", "get",
]  # fmt: skip


#: names that stand for several effects
TOGETHER = {
    "dahl-friction": ("coulomb-friction", "presliding"),
    "lugre-friction": ("coulomb-friction", "stribeck-friction", "presliding", "viscous-friction"),
    "none": (),
}


@cache
def catalogue() -> dict[str, type[Effect]]:
    """All effects by name, found by scanning the folder."""
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(__path__):
        if module.name.startswith("_"):
            continue
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        classes = [value for value in vars(loaded).values()
                   if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == loaded.__name__]  # fmt: skip
        if len(classes) != 1:
            raise ImportError(f"{loaded.__name__} holds {len(classes)} effects, one file holds one")
        effect = classes[0]
        if effect.id != module.name.replace("_", "-"):
            raise ImportError(f"{loaded.__name__} holds '{effect.id}': file and effect have one name")
        found[effect.id] = effect
    return found


def get(name: str) -> Effect:
    """The effect of this name.

    Raises:
        InputError: there is none; near names are listed.
    """
    known = catalogue()
    if name not in known:
        mend = near(name, known, also={id: _words(effect) for id, effect in known.items()})
        raise InputError(f"effect '{name}'", "a name of the catalogue (kinid diagnose --explain all)", mend)
    return known[name]()


def _words(effect: type[Effect]) -> str:
    """What people may call an effect by instead of its name: what it does, its parameters, who wrote of it first."""
    return f"{effect.title} {' '.join([*effect.null, *effect.grid])} {effect.source}"
