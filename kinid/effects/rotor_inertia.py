"""Inertia of the motors, seen through the gears."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class RotorInertia(Effect):
    """τ += J q̈, J the motor's inertia times the gear ratio squared; a sensor behind the gear doesn't see it.

    Beside the unknown inertia of an axis without a robot it is the same parameter twice.
    """

    id = "rotor-inertia"
    title = "reflected inertia of the rotors"
    equation = "τ += J q̈"
    source = "M. W. Spong, J. Dyn. Syst. Meas. Control 109(4), 1987 (gears that make rotors heavy)"
    signature = "torque proportional to the acceleration of a joint, in every pose alike"
    confusions = {"joint-torque-gain": "several poses: gravity is scaled too", "payload": "several poses"}
    excited_by = "acceleration in several poses"
    needs = ("joints",)
    null = {"inertia": 0.0}
    unremarkable = {"inertia[N·m·s²/rad]": 0.005}  # a payload about itself; rotors of arms have 20 times more
    admissible = {"inertia": (0.0, math.inf)}  # kinetic energy is positive
    example = Example(("rigid-body",), {"inertia": (0.9, 0.3)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Reflected inertia of each joint."""
        return tuple(
            Parameter(
                f"inertia{a.suffix}",
                "J",
                a.per("·s²"),
                0.1 * a.size,
                0.0,
                1e5 * a.size,
                scale=0.01 * a.size,
                linear=True,
            )
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + p[:, None] * s.joints.ddq
