"""A reading without a load."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class SensorBias(Effect):
    """y = f + b: a constant added to each channel."""

    id = "sensor-bias"
    title = "constant sensor offset"
    equation = "y = f + b"
    source = "any strain-gauge sensor's data sheet"
    signature = "a constant in every phase, in the air too"
    confusions = {"tool-mass": "free rotation: weight turns with the tool, bias doesn't"}
    excited_by = "samples in free motion, best in several orientations"
    per_log = True
    constant = True
    needs = ()
    null = {"offset": 0.0}
    order = 2
    same_for_joints = "joint-torque-offset"
    # zeroed in the air, for minutes
    calibration_tolerance = {"offset[N]": 0.02, "offset[N·m]": 1e-3}
    example = Example(("hooke",), {"offset": (1.0, -0.7, 1.4, 0.05, 0.03, -0.04)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One offset a channel."""
        return tuple(
            Parameter(f"offset[{name}]", "b", unit, 0.0, scale=0.1 if unit == "N" else 0.005, linear=True)
            for name, unit in zip(layout.channels, layout.units)
        )

    def calibration_bound(self, layout: Layout) -> float:
        """None for a raw wrench: every such sensor has a bias, and a fit must not bend the material to it."""
        return math.inf if layout.kind == "wrench" else 2.0

    def sensor(self, s: Signals, p: Array) -> None:
        """Add the offsets."""
        s.reading = s.reading + p[:, None]
