"""kinid: from raw robot logs to contact-frame quantities, and to the physical effect that a model lacks.

Names load where they are first used, so that `import kinid` stays fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.campaign import Campaign
    from kinid.contact.registration import find_surface
    from kinid.contact.series import ContactSeries, contact_series, tip_motion
    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.diagnosis import Diagnosis, diagnose
    from kinid.errors import InputError, KinidError
    from kinid.identification.compare import Comparison, compare
    from kinid.identification.fit import Fit
    from kinid.modeling.model import Model
    from kinid.robotics.inverse_dynamics import JointTorques, joint_torques
    from kinid.robotics.reading import read
    from kinid.robotics.robot import Robot
    from kinid.signal.derivative import Differentiator

__version__ = "0.1.0"

_HOME = {
    "Campaign": "campaign",
    "Comparison": "identification.compare",
    "compare": "identification.compare",
    "ContactSeries": "contact.series",
    "contact_series": "contact.series",
    "tip_motion": "contact.series",
    "Differentiator": "signal.derivative",
    "Diagnosis": "diagnosis",
    "diagnose": "diagnosis",
    "InputError": "errors",
    "KinidError": "errors",
    "JointTorques": "robotics.inverse_dynamics",
    "joint_torques": "robotics.inverse_dynamics",
    "Log": "data.log",
    "figure_of": "reports.figures",
    "Fit": "identification.fit",
    "Model": "identification.fit",
    "read": "robotics.reading",
    "Rig": "data.rig",
    "Robot": "robotics.robot",
    "find_surface": "contact.registration",
}

__all__ = [
    "Campaign",
    "Comparison",
    "ContactSeries",
    "Diagnosis",
    "Differentiator",
    "Fit",
    "InputError",
    "JointTorques",
    "KinidError",
    "Log",
    "Model",
    "Rig",
    "Robot",
    "compare",
    "contact_series",
    "diagnose",
    "find_surface",
    "joint_torques",
    "read",
    "tip_motion",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"kinid.{_HOME[name]}"), name)
    raise AttributeError(f"module 'kinid' has no attribute '{name}'")


def __dir__() -> list[str]:
    """What is public, and what every module has."""
    return sorted([*__all__, *(name for name in globals() if name.startswith("__") and name != "__getattr__")])
