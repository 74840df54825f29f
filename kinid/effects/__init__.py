"""The catalogue of effects: every file of this folder whose name has no leading underscore holds one effect, and so
does every such file of a user's own folders.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from kinid.effects._effect import Effect, Stage
from kinid.effects._example import Example, Motion
from kinid.effects._foreign import VARIABLE, effect_options, foreign_effects, load_effect, only_effect
from kinid.effects._samples import Detection, Samples
from kinid.effects._signals import Array, AsRead, JointMotion, Kind, Layout, SensorMotion, Signals
from kinid.effects._template import effect_file
from kinid.errors import InputError, near

__all__ = [
    "TOGETHER",
    "VARIABLE",
    "Array",
    "AsRead",
    "Detection",
    "Effect",
    "Example",
    "JointMotion",
    "Kind",
    "Layout",
    "Motion",
    "Samples",
    "SensorMotion",
    "Signals",
    "Stage",
    "catalogue",
    "effect_file",
    "effect_options",
    "get",
    "load_effect",
]


#: names that stand for several effects
TOGETHER = {
    "dahl-friction": ("coulomb-friction", "presliding"),
    "lugre-friction": ("coulomb-friction", "stribeck-friction", "presliding", "viscous-friction"),
    "none": (),
}


@cache
def catalogue() -> dict[str, type[Effect]]:
    """All effects by name: the files of this folder, of the folders that `KINID_EFFECTS` names, and those of installed
    packages.

    Raises:
        InputError: a file of another folder, or a package, that holds no effect, several, or one whose name is taken.
    """
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(__path__):
        if not module.name.startswith("_"):
            effect = only_effect(importlib.import_module(f"{__name__}.{module.name}"), module.name)
            found[effect.id] = effect
    for effect in foreign_effects():
        if effect.id in TOGETHER:
            raise InputError(
                f"an effect '{effect.id}', in {effect.__module__}, a name that stands for others",
                "a name of its own",
                "rename the file and its id",
            )
        if effect.id in found:
            where = effect.__module__
            raise InputError(
                f"a second effect '{effect.id}', in {where}", "a name of its own", "rename the file and its id"
            )
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
