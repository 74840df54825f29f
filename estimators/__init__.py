"""Recursive and batch estimators, with no robot in them: numbers in, parameters with their uncertainty out.

`from kinid.estimators import SingleStage` loads what it needs and nothing else; compiled code loads at the first run.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.estimators.batch import Solution, solve
    from kinid.estimators.estimate import Estimate, Prior, Status, Track
    from kinid.estimators.excitation import Excitation
    from kinid.estimators.forgetting import Constant, Forgetting, Scheduled
    from kinid.estimators.friction import EquivalentFriction, Friction, equivalent_friction
    from kinid.estimators.hunt_crossley import SingleStage, TwoStage, restitution
    from kinid.estimators.kalman import HuntCrossleyKalman
    from kinid.estimators.kelvin_voigt import KelvinVoigt
    from kinid.estimators.offset import Offset
    from kinid.estimators.payload import Payload, fit_payload
    from kinid.estimators.plane import PlaneEstimate, fit_plane
    from kinid.estimators.power_law import PowerLaw, fit_power_law
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
    "Offset",
    "Payload",
    "PlaneEstimate",
    "PowerLaw",
    "Prior",
    "RecursiveLeastSquares",
    "Scheduled",
    "SingleStage",
    "Solution",
    "Status",
    "Track",
    "TwoStage",
    "equivalent_friction",
    "fit_payload",
    "fit_plane",
    "fit_power_law",
    "restitution",
    "solve",
]

_HOMES = {
    "batch": ("Solution", "solve"),
    "estimate": ("Estimate", "Prior", "Status", "Track"),
    "excitation": ("Excitation",),
    "forgetting": ("Constant", "Forgetting", "Scheduled"),
    "friction": ("EquivalentFriction", "Friction", "equivalent_friction"),
    "hunt_crossley": ("SingleStage", "TwoStage", "restitution"),
    "kalman": ("HuntCrossleyKalman",),
    "kelvin_voigt": ("KelvinVoigt",),
    "offset": ("Offset",),
    "payload": ("Payload", "fit_payload"),
    "plane": ("PlaneEstimate", "fit_plane"),
    "power_law": ("PowerLaw", "fit_power_law"),
    "rls": ("RecursiveLeastSquares",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'kinid.estimators' has no attribute '{name}'")
    return getattr(importlib.import_module(f"kinid.estimators.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
