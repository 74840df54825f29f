"""Recursive estimators, with no robot in them: rows of numbers in, parameters with their uncertainty out.

`from kinid.estimators import SingleStage` loads what it needs and nothing else; compiled code loads at the first run.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.estimators.estimate import Estimate, Prior, Status, Track
    from kinid.estimators.excitation import Excitation
    from kinid.estimators.forgetting import Constant, Forgetting, Scheduled
    from kinid.estimators.friction import EquivalentFriction, Friction, equivalent_friction
    from kinid.estimators.hunt_crossley import SingleStage, TwoStage, restitution
    from kinid.estimators.kalman import HuntCrossleyKalman
    from kinid.estimators.kelvin_voigt import KelvinVoigt
    from kinid.estimators.rls import RecursiveLeastSquares

__all__ = [
    "Constant",
    "EquivalentFriction",
    "Estimate",
    "Excitation",
    "Forgetting",
    "Friction",
    "HuntCrossleyKalman",
    "KelvinVoigt",
    "Prior",
    "RecursiveLeastSquares",
    "Scheduled",
    "SingleStage",
    "Status",
    "Track",
    "TwoStage",
    "equivalent_friction",
    "restitution",
]

_HOMES = {
    "estimate": ("Estimate", "Prior", "Status", "Track"),
    "excitation": ("Excitation",),
    "forgetting": ("Constant", "Forgetting", "Scheduled"),
    "friction": ("EquivalentFriction", "Friction", "equivalent_friction"),
    "hunt_crossley": ("SingleStage", "TwoStage", "restitution"),
    "kalman": ("HuntCrossleyKalman",),
    "kelvin_voigt": ("KelvinVoigt",),
    "rls": ("RecursiveLeastSquares",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'kinid.estimators' has no attribute '{name}'")
    return getattr(importlib.import_module(f"kinid.estimators.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
