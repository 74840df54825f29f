"""A tip that isn't where the kinematics have it."""

from __future__ import annotations

import dataclasses
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.frames import displaced
from kinid.parameter import Parameter


@final
class TipOffset(Effect):
    """The tip is at r + d in the sensor frame: other depth and slip as the tool tilts, and another arm of the contact
    force.

    δ −= n·(R d), slip += t·(R d), and their rates with ω × d; τ = (r + d) × f. On a curved surface to first order in d.
    Along the normal of a tool that never tilts it is a `surface-offset`.
    """

    id = "tip-offset"
    title = "position of the tip in the tool"
    equation = "r → r + d: δ −= n·(R d), τ += d × f"
    source = "R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, ch. 2"
    signature = "moments that aren't r × f, and a depth that is wrong by more as the tool tilts"
    confusions = {
        "surface-offset": "contact with a tilted tool",
        "sensor-crosstalk": "loads along several directions: moments follow every component of the force",
        "tool-com": "contact: weight has no part in it",
    }
    excited_by = "contact with the tool tilted in several directions"
    needs = ("normal", "wrench")
    null = {"offset": 0.0}
    admissible = {"offset": (-0.05, 0.05)}  # a tip elsewhere is another tool
    example = Example(("hooke", "coulomb-friction"), {"offset": (4e-4, -3e-4, 2e-4)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Displacement of the tip in the sensor frame."""
        return tuple(Parameter(f"offset[{axis}]", "d", "m", 0.0, -0.1, 0.1, scale=1e-4) for axis in "xyz")

    def geometry(self, s: Signals, p: Array) -> None:
        """Move the tip."""
        sensor = s.sensor
        if sensor is None:
            return
        moved, speed = np.empty((2, 3, len(s)))
        displaced(sensor.to_contact, sensor.omega, p, moved, speed)
        s.depth, s.depth_rate = s.depth - moved[2], s.depth_rate - speed[2]
        s.slip, s.slip_rate = s.slip + moved[:2], s.slip_rate + speed[:2]
        s.sensor = dataclasses.replace(sensor, tip=sensor.tip + p)
