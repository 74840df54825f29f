"""Controllers: impedance of an arm's tip, wrenches through Jᵀ, haptic rendering of a map, and bilateral teleoperation.

Each has `command(state)`. `from kinid.controllers import Impedance` loads what it needs and nothing else.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinid.controllers.adaptive import AdaptiveImpedance, Schedule
    from kinid.controllers.cartesian import DecoupledImpedance, Impedance, JacobianTranspose
    from kinid.controllers.force import (
        ContactGains,
        FixedGains,
        ForceControl,
        GainSource,
        MapGains,
        OnlineGains,
        Reading,
    )
    from kinid.controllers.gains import Gains, design_damping, sampled_radius
    from kinid.controllers.haptic import HapticRendering, HapticSettings, Hooke, HuntCrossley, KelvinVoigt, Rendered
    from kinid.controllers.impedance import impedance_torque, potential
    from kinid.controllers.measured import Measured
    from kinid.controllers.mesh_surface import MeshSurface
    from kinid.controllers.packets import Network
    from kinid.controllers.passivity import EnergyTank, Observer
    from kinid.controllers.properties import Foot, Plane, Properties, PropertyMap, Touchable, Uniform
    from kinid.controllers.rigid_teleoperation import RigidMotion, Tool, simulate_rigid
    from kinid.controllers.state import ArmState, Target
    from kinid.controllers.teleoperation import Study, measured_impedance, simulate, study
    from kinid.controllers.teleoperator import Environment, Teleoperator

__all__ = [
    "AdaptiveImpedance",
    "ArmState",
    "ContactGains",
    "DecoupledImpedance",
    "EnergyTank",
    "Environment",
    "FixedGains",
    "Foot",
    "ForceControl",
    "GainSource",
    "Gains",
    "HapticRendering",
    "HapticSettings",
    "Hooke",
    "HuntCrossley",
    "Impedance",
    "JacobianTranspose",
    "KelvinVoigt",
    "MapGains",
    "Measured",
    "MeshSurface",
    "Network",
    "Observer",
    "OnlineGains",
    "Plane",
    "Properties",
    "PropertyMap",
    "Reading",
    "Rendered",
    "RigidMotion",
    "Schedule",
    "Study",
    "Target",
    "Teleoperator",
    "Tool",
    "Touchable",
    "Uniform",
    "design_damping",
    "impedance_torque",
    "measured_impedance",
    "potential",
    "sampled_radius",
    "simulate",
    "simulate_rigid",
    "study",
]

_HOMES = {
    "adaptive": ("AdaptiveImpedance", "Schedule"),
    "cartesian": ("DecoupledImpedance", "Impedance", "JacobianTranspose"),
    "force": ("ContactGains", "FixedGains", "ForceControl", "GainSource", "MapGains", "OnlineGains", "Reading"),
    "gains": ("Gains", "design_damping", "sampled_radius"),
    "haptic": ("HapticRendering", "HapticSettings", "Hooke", "HuntCrossley", "KelvinVoigt", "Rendered"),
    "impedance": ("impedance_torque", "potential"),
    "measured": ("Measured",),
    "mesh_surface": ("MeshSurface",),
    "packets": ("Network",),
    "passivity": ("EnergyTank", "Observer"),
    "properties": ("Foot", "Plane", "Properties", "PropertyMap", "Touchable", "Uniform"),
    "rigid_teleoperation": ("RigidMotion", "Tool", "simulate_rigid"),
    "state": ("ArmState", "Target"),
    "teleoperation": ("Study", "measured_impedance", "simulate", "study"),
    "teleoperator": ("Environment", "Teleoperator"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'kinid.controllers' has no attribute '{name}'")
    return getattr(importlib.import_module(f"kinid.controllers.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
