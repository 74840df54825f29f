"""What the last link carries besides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: share of a tool's mass that its statement leaves open, and of its centre's place [m]
WEIGHED, PLACED = 0.01, 5e-4


@final
class Payload(Effect):
    """τ −= Jᵀ w, w the load of a mass m with first moment h = m·com in the sensor frame (without one, the tip's).

    f = m (g − a) − α × h − ω × (ω × h), τ = h × (g − a); its inertia about that frame's origin is left out. A gravity
    model that is wrong at the end of the arm is a payload as well, of either sign.
    """

    id = "payload"
    title = "payload"
    equation = "τ −= Jᵀ w(m, h)"
    source = "C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Robotics Research 5(3), 1986"
    signature = "torques that turn with the pose as gravity does, in all joints that lift"
    confusions = {"joint-torque-offset": "several poses", "joint-torque-gain": "several poses"}
    excited_by = "several poses"
    needs = ("joints",)
    null = {"mass": 0.0, "moment": 0.0}
    admissible = {
        "mass": (-50.0, 50.0),
        "moment": (-50.0, 50.0),
    }  # of either sign: the rig's tool may be stated too heavy
    example = Example(("rigid-body",), {"mass": 0.7, "moment": (0.02, 0.05, -0.01)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Mass and first moment; none without a robot."""
        if layout.kind != "joints" or not layout.joints:
            return ()
        moments = (Parameter(f"moment[{a}]", "h", "kg·m", 0.0, -50.0, 50.0, scale=0.01, linear=True) for a in "xyz")
        return (Parameter("mass", "m", "kg", 0.0, -50.0, 50.0, scale=0.05, linear=True), *moments)

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """A share of the mass and the first moment that the rig states of its tool."""
        mass, moment = (0.0, 0.0) if signals.joints is None else signals.joints.tool
        if mass <= 0.0:
            return {}
        return {"mass": WEIGHED * mass} | {f"moment[{a}]": WEIGHED * moment + PLACED * mass for a in "xyz"}

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torques."""
        if s.joints is not None and s.joints.payload is not None and len(p):
            s.reading = s.reading + np.tensordot(p, s.joints.payload, axes=1)
