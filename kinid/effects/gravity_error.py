"""A base that isn't mounted as the rig says."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class GravityError(Effect):
    """τ += g(q; Δg): gravity is g₀ + Δg in the base frame, where the rig states g₀ [m/s²]; all masses of the arm weigh in.

    Inverse dynamics is linear in gravity, so that the torques are G(q) Δg with G the arm's at rest under gravity of 1 m/s²
    along each axis of the base. A base tilted by a small angle θ has Δg = g₀ × θ across g₀ and none along it. What lies
    beyond a force/torque sensor in the log is no part of G: the sensor says what it weighs.
    """

    id = "gravity-error"
    title = "direction of gravity in the base frame"
    equation = "τ += G(q) Δg"
    source = "J. Y. S. Luh, M. W. Walker, R. P. C. Paul, J. Dyn. Syst. Meas. Control 102, 1980 (gravity as a base's acceleration)"
    signature = "torques that turn with the pose as those of gravity do, in axes that gravity shouldn't load too"
    confusions = {
        "payload": "several poses: a payload hangs from the end of the arm, gravity pulls at every link",
        "joint-torque-gain": "gravity's own direction: a gain can't load a vertical axis",
        "joint-torque-offset": "several poses: an offset stays",
    }
    excited_by = "several poses, the first joint turned too"
    needs = ("joints",)
    null = {"error": 0.0}
    calibration_tolerance = {"error": 0.034}  # a base that is level to 0.2°, times g
    admissible = {"error": (-20.0, 20.0)}  # twice g: it points the other way

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Error of gravity along the axes of the base frame; none without a robot."""
        if layout.kind != "joints" or not layout.joints:
            return ()
        return tuple(Parameter(f"error[{axis}]", "Δg", "m/s²", 0.0, -25.0, 25.0, scale=0.1, linear=True) for axis in "xyz")

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torques."""
        if s.joints is not None and s.joints.gravity is not None and len(p):
            s.reading = s.reading + np.tensordot(p, s.joints.gravity, axes=1)
