"""A torque reading with a wrong scale."""

from __future__ import annotations

from typing import final

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointTorqueGain(Effect):
    """y = (1 + g) τ for each joint: a torque constant, a gear ratio or a calibration that is off.

    It scales what stands before it in the model. For a log of motor currents 1 + g is what turns torque into current.
    Of an axis without a robot, nothing tells it from inertia and friction.
    """

    id = "joint-torque-gain"
    title = "gain error of the joint torques"
    equation = "y = (1 + g) τ"
    source = "M. Gautier, S. Briot, J. Dyn. Syst. Meas. Control 136(5), 2014 (drive gains)"
    signature = "a residual proportional to the torque itself, gravity included"
    confusions = {
        "payload": "several poses: a payload's torque has another shape",
        "rotor-inertia": "poses at rest",
        "joint-elasticity": "slow and fast motion: a gain is the same at all frequencies",
        "joint-load-friction": "motion in both directions: friction pulls them apart, a gain doesn't",
    }
    excited_by = "gravity and acceleration that the robot's model knows"
    needs = ("joints",)
    null = {"gain": 0.0}
    calibration_tolerance = {"gain": 0.01}  # no calibration of an arm's torques is better
    admissible = {
        "gain": (-0.995, 1e3)
    }  # a gain of 0 reads nothing; as a current in A, 1 N·m is some hundredths at least
    example = Example(("rigid-body",), {"gain": (0.06, -0.11)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Gain error of each joint."""
        return tuple(Parameter(f"gain{a.suffix}", "g", "1", 0.0, -0.999, 1e3, scale=0.01) for a in axes(layout))

    def sensor(self, s: Signals, p: Array) -> None:
        """Scale the readings."""
        if len(p):
            s.reading = (1.0 + p[:, None]) * s.reading
