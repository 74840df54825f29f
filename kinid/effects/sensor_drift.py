"""A reading that walks."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class SensorDrift(Effect):
    """y = f + d t: each channel by so much a minute, from the log's first sample; strain gauges that warm up."""

    id = "sensor-drift"
    title = "linear sensor drift"
    equation = "y = f + d t"
    source = "any strain-gauge sensor's data sheet (temperature drift)"
    signature = "a ramp in every phase, in the air too"
    confusions = {"stiffness-drift": "look in the air: there, stiffness has no part"}
    excited_by = "free motion early and late in a long log"
    needs = ()
    per_log = True
    null = {"drift": 0.0}
    order = 2
    # a strain gauge of 0.1 % of 1 kN a kelvin, warming up by 10 K a minute
    admissible = {"drift[N/min]": (-10.0, 10.0), "drift[N·m/min]": (-1.0, 1.0)}
    example = Example(("hooke",), {"drift": (1.0, -0.7, 1.4, 0.05, 0.03, -0.04)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One slope a channel."""
        arm = 0.5 if layout.joints else 0.02  # sensors in joints carry a hundred times what one at a wrist does
        scale = {"N": 0.1, "N·m": arm if layout.kind == "joints" else 0.005}
        return tuple(
            Parameter(f"drift[{name}]", "d", f"{unit}/min", 0.0, scale=scale[unit], linear=True)
            for name, unit in zip(layout.channels, layout.units)
        )

    def usual(self, parameter: Parameter) -> float:
        """Half of a slope that matters: any sensor in any room has so much."""
        return 0.5 * parameter.scale

    def sensor(self, s: Signals, p: Array) -> None:
        """Add the ramps."""
        s.reading = s.reading + p[:, None] * (s.t / 60.0)
