"""kinid: from raw robot logs to contact-frame quantities, and to the physical effect that a model lacks.

Names load where they are first used, so that `import kinid` stays fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.contact import ContactSeries, contact_series, tip_motion
    from kinid.derivative import Differentiator
    from kinid.diagnosis import Diagnosis, diagnose
    from kinid.errors import InputError, KinidError
    from kinid.inverse_dynamics import JointTorques, joint_torques
    from kinid.log import Log
    from kinid.model import Model
    from kinid.reading import read
    from kinid.rig import Rig
    from kinid.robot import Robot
    from kinid.touch import find_surface

__version__ = "0.1.0"

_HOME = {
    "ContactSeries": "contact", "contact_series": "contact", "tip_motion": "contact",
    "Differentiator": "derivative",
    "Diagnosis": "diagnosis", "diagnose": "diagnosis",
    "InputError": "errors", "KinidError": "errors",
    "JointTorques": "inverse_dynamics", "joint_torques": "inverse_dynamics",
    "Log": "log",
    "Model": "model",
    "read": "reading",
    "Rig": "rig",
    "Robot": "robot",
    "find_surface": "touch",
}  # fmt: skip

__all__ = [
    "ContactSeries",
    "Diagnosis",
    "Differentiator",
    "InputError",
    "JointTorques",
    "KinidError",
    "Log",
    "Model",
    "Rig",
    "Robot",
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
    return sorted([*globals(), *__all__])
