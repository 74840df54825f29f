"""Centre of mass of the tool, where it isn't the rig's."""

from __future__ import annotations

import dataclasses
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.effects._vectors import point_load
from kinid.parameter import Parameter


@final
class ToolCom(Effect):
    """The tool's mass m acts at c + d: f += −m (α × d + ω × (ω × d)), τ += (c + d) × f(c + d) − c × f(c).

    The inertia about the centre of mass goes with it. m is the rig's, plus that of `tool-mass` where the model has it;
    without any mass a centre does nothing.
    """

    id = "tool-com"
    title = "centre of mass of the tool"
    equation = "τ += m d × (g − a), and what follows for a turning tool"
    source = "C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Robotics Research 5(3), 1986"
    signature = "torques in the air that turn with the orientation of the tool, without forces that do"
    confusions = {
        "sensor-misalignment": "free rotation: a misalignment turns the weight too",
        "sensor-bias": "free rotation: a bias doesn't turn with the tool",
    }
    excited_by = "free motion in several orientations"
    needs = ("wrench",)
    null = {"com": 0.0}
    calibration_tolerance = {"com": 5e-4}  # drawn, or weighed in three orientations
    admissible = {"com": (-0.5, 0.5)}  # inside a tool
    example = Example(("hooke",), {"com": (3e-3, -2e-3, 5e-3)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Displacement of the centre of mass in the sensor frame."""
        return tuple(Parameter(f"com[{axis}]", "d", "m", 0.0, -1.0, 1.0, scale=1e-3) for axis in "xyz")

    def tool(self, s: Signals, p: Array) -> None:
        """Move the load, and let what follows know."""
        assert s.sensor is not None
        here, there = s.sensor.com, s.sensor.com + p
        s.reading = s.reading + point_load(s.sensor, s.sensor.mass, there) - point_load(s.sensor, s.sensor.mass, here)
        s.sensor = dataclasses.replace(s.sensor, com=there)
