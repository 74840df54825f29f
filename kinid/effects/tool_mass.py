"""Mass that the rig's tool lacks."""

from __future__ import annotations

import dataclasses
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.effects._vectors import point_load
from kinid.parameter import Parameter


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

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Mass."""
        return (Parameter("mass", "Δm", "kg", 0.0, -50.0, 50.0, scale=0.01, linear=True),)

    def tool(self, s: Signals, p: Array) -> None:
        """Add its load, and let what follows know."""
        assert s.sensor is not None
        s.reading = s.reading + point_load(s.sensor, p[0], s.sensor.com)
        s.sensor = dataclasses.replace(s.sensor, mass=s.sensor.mass + float(p[0]))
