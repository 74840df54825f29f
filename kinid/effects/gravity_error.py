"""Gravity that pulls at the arm otherwise than the rig and the URDF say."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, JointMotion, Layout, Signals
from kinid.parameter import Parameter

#: samples whose torques per first moment are kept at a time
AT_ONCE = 50_000
#: of an error of gravity [m/s²] and of a link's first moment [kg·m], what is usual
USUAL_GRAVITY, USUAL_MOMENT = 2.0, 0.5


@final
class GravityError(Effect):
    """τ += G(q) Δg + S(q) Δh: gravity is g₀ + Δg where the rig states g₀, link k's first moment m·c + Δh_k.

    Inverse dynamics is linear in gravity, so that the torques of its error are G(q) Δg with G the arm's at rest under
    gravity of 1 m/s² along each axis of the base; it is linear in the links' first moments alike. A base tilted by a
    small angle θ has Δg = g₀ × θ across g₀ and none along it; a link that is heavier than stated, or loaded elsewhere,
    has a Δh of its own. What lies beyond a force/torque sensor in the log is no part of either: the sensor says what it
    weighs.
    """

    id = "gravity-error"
    title = "gravity of the arm"
    equation = "τ += G(q) Δg + S(q) Δh"
    source = (
        "J. Y. S. Luh, M. W. Walker, R. P. C. Paul, J. Dyn. Syst. Meas. Control 102, 1980 (gravity as a base's "
        "acceleration); "
        "C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Robotics Research 5(3), 1986 (torques linear in first "
        "moments)"
    )
    signature = "torques that turn with the pose as those of gravity do, in axes that gravity shouldn't load too"
    confusions = {
        "payload": "several poses: a payload hangs from the end of the arm, gravity pulls at every link",
        "joint-torque-gain": "gravity's own direction: a gain can't load a vertical axis",
        "joint-torque-offset": "several poses: an offset stays",
    }
    excited_by = "several poses, the first joint turned too"
    needs = ("joints",)
    null = {"error": 0.0, "moment": 0.0}
    calibration_tolerance = {"error": 0.034}  # a base that is level to 0.2°, times g
    unremarkable = {
        "error": 0.068,
        "moment": 0.01,
    }  # the same, and links whose description is a kilogram-centimetre off
    # twice g: it points the other way; the whole upper arm of a robot for 10 kg has some 4 kg·m
    admissible = {"error": (-20.0, 20.0), "moment": (-10.0, 10.0)}
    generalises = ("payload",)
    example = Example(("rigid-body",), {"error": (0.8, -0.1, 0.3)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Error of gravity along the axes of the base frame, and of the links' first moments; none without a robot."""
        if layout.kind != "joints" or not layout.joints:
            return ()
        tilt = (Parameter(f"error[{axis}]", "Δg", "m/s²", 0.0, -25.0, 25.0, scale=0.1, linear=True) for axis in "xyz")
        return (
            *tilt,
            *(
                Parameter(f"moment[{joint}.{axis}]", "Δh", "kg·m", 0.0, -50.0, 50.0, scale=0.05, linear=True)
                for joint in layout.joints
                for axis in "xyz"
            ),
        )

    def prior(self, layout: Layout) -> Array | None:
        """No link is off by far more than is usual: torques leave some combinations of first moments open."""
        sizes = [USUAL_GRAVITY] * 3 + [USUAL_MOMENT] * (len(self.parameters(layout)) - 3)
        return np.diag(1.0 / np.square(sizes)) if len(sizes) > 3 else None

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torques."""
        motion = s.joints
        if motion is None or motion.gravity is None or not len(p):
            return
        if len(s) > AT_ONCE:  # what is kept of a short log would be much of a long one
            s.reading = s.reading + _torques(motion, p)
            return
        s.reading = s.reading + derived(
            "gravity error", lambda: _torques(motion, p), motion.q, motion.gravity, at=tuple(p.tolist())
        )


def _torques(motion: JointMotion, p: Array) -> Array:
    """Of gravity's error and of the links' moments, (N, n)."""
    assert motion.gravity is not None
    out, at, n = np.asarray(np.tensordot(p[:3], motion.gravity, axes=1)), motion.moments, motion.q.shape[1]
    if at is None or not p[3:].any():
        return out
    if n <= AT_ONCE:
        return out + np.tensordot(p[3:], derived("first moments", lambda: at(motion.q.T), motion.q), axes=1)
    for begin in range(0, n, AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        out[:, part] += np.tensordot(p[3:], at(motion.q[:, part].T), axes=1)
    return out
