"""Friction of the joints that grows with the load."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._axes import axes, directions
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointLoadFriction(Effect):
    """τ += c |τ_r| u: teeth and bearings rub in proportion to the torque τ_r that they transmit.

    τ_r is that of rigid-body inverse dynamics; u that of `joint-coulomb-friction`. Gears of an efficiency η lose
    c = 1/η − 1 when they drive, and 1 − η when they are driven: c is a mean of both. Of an axis without a robot, all
    that the other effects of the joint say is transmitted.
    """

    id = "joint-load-friction"
    title = "friction of the joints that grows with the torque"
    equation = "τ += c |τ_r| u"
    source = (
        "P. Hamon, M. Gautier, P. Garrec, IEEE/RSJ IROS 2010 (dry friction that depends on the load); "
        "A. C. Bittencourt, S. Gunnarsson, J. Dyn. Syst. Meas. Control 134(5), 2012"
    )
    signature = "a step in the torque at reversals that is higher in poses that load the joint"
    confusions = {
        "joint-coulomb-friction": "poses that load the joint and poses that don't",
        "joint-torque-gain": "reversals: a gain scales both directions alike, friction pulls them apart",
        "joint-stribeck-friction": "one speed in several poses",
    }
    excited_by = "motion in both directions, in poses of different load"
    needs = ("joints",)
    null = {"load": 0.0}
    order = 1
    admissible = {"load": (0.0, 1.0)}  # friction takes energy; gears of an efficiency below one half lock
    example = Example(("rigid-body",), {"load": (0.1, 0.04)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Friction for each unit of torque, joint by joint."""
        return tuple(
            Parameter(f"load{a.suffix}", "c", "1", 0.05, -1.0, 2.0, scale=0.01, linear=True) for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        load = s.joints.rigid if s.layout.joints else s.reading
        s.reading = s.reading + p[:, None] * np.abs(load) * directions(s)
