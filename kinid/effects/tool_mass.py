"""Mass that the rig's tool lacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.effects._vectors import point_load
from kinid.parameter import Parameter

#: share of a tool's mass to which a rig states it: bolts, cables and paint are left out
WEIGHED = 0.01


@final
class ToolMass(Effect):
    """f += Δm (g − a_c), τ += c × Δm (g − a_c): mass at the tool's centre c beyond the rig's, of either sign.

    a_c = a + α × c + ω × (ω × c). Without a tool in the rig, c is the sensor's origin; `tool-com` moves it.
    """

    id = "tool-mass"
    title = "mass of the tool"
    equation = "f += Δm (g − a_c), τ += c × Δm (g − a_c)"
    source = "C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Robotics Research 5(3), 1986"
    signature = "a force in the air that turns with the orientation of the tool and shakes with its acceleration"
    confusions = {
        "sensor-bias": "free rotation: a bias doesn't turn with the tool",
        "sensor-gain": "contact: a gain scales it too",
    }
    excited_by = "free motion in several orientations"
    needs = ("wrench",)
    null = {"mass": 0.0}
    example = Example(("hooke",), {"mass": 0.043}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Mass."""
        return (Parameter("mass", "Δm", "kg", 0.0, -50.0, 50.0, scale=0.01, linear=True),)

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """A share of the mass that the rig states."""
        stated = 0.0 if signals.sensor is None else abs(signals.sensor.mass)
        return {"mass": WEIGHED * stated} if stated > 0.0 else {}

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A tool that weighs less than nothing."""
        stated = 0.0 if signals is None or signals.sensor is None else signals.sensor.mass
        if signals is not None and stated + values.get("mass", 0.0) < 0.0:
            return f"mass = {values['mass']:.3g} kg beside the rig's {stated:.3g} kg: a tool of negative mass"
        return super().implausible(values, model_values, signals)

    def tool(self, s: Signals, p: Array) -> None:
        """Add its load, and let what follows know."""
        assert s.sensor is not None
        s.reading = s.reading + point_load(s.sensor, p[0], s.sensor.com)
        s.sensor = dataclasses.replace(s.sensor, mass=s.sensor.mass + float(p[0]))
