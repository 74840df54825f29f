"""A reading that walks."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
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
    null = {"drift": 0.0}
    turn = 2
    unremarkable = {"drift[N/min]": 0.05, "drift[N·m/min]": 0.002}  # any sensor in any room
    # a strain gauge of 0.1 % of 1 kN a kelvin, warming up by 10 K a minute
    admissible = {"drift[N/min]": (-10.0, 10.0), "drift[N·m/min]": (-1.0, 1.0)}

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One slope a channel."""
        return tuple(
            Parameter(f"drift[{name}]", "d", f"{unit}/min", 0.0, scale=0.1 if unit == "N" else 0.005, linear=True)
            for name, unit in zip(layout.channels, layout.units)
        )

    def sensor(self, s: Signals, p: Array) -> None:
        """Add the ramps."""
        s.reading = s.reading + p[:, None] * (s.t / 60.0)
