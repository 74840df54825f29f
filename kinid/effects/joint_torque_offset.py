"""A torque reading without a torque."""

from __future__ import annotations

from typing import final

from kinid.effects._axes import axes, usual_offset
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointTorqueOffset(Effect):
    """τ += τ₀: a constant for each joint, of its sensor or of a dry friction that differs between the directions."""

    id = "joint-torque-offset"
    title = "constant offset of the joint torques"
    equation = "τ += τ₀"
    source = "A. Janot, P.-O. Vandanjon, M. Gautier, IEEE Trans. Control Systems Technology 22(1), 2014 (drive offsets)"
    signature = "a constant, in every pose and at every speed"
    confusions = {
        "payload": "several poses: gravity turns with them",
        "joint-coulomb-friction": "motion in both directions",
    }
    excited_by = "motion in both directions, in several poses"
    needs = ("joints",)
    null = {"offset": 0.0}
    example = Example(("rigid-body",), {"offset": (-0.6, 0.2)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Offset of each joint."""
        return tuple(
            Parameter(
                f"offset{a.suffix}", "τ₀", a.torque, 0.0, -1e4 * a.size, 1e4 * a.size, scale=0.1 * a.size, linear=True
            )
            for a in axes(layout)
        )

    def usual(self, parameter: Parameter) -> float:
        """What the sensor of an arm's joint is off by."""
        return usual_offset(parameter.name)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the offset."""
        s.reading = s.reading + p[:, None]
