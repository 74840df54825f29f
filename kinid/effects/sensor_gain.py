"""A sensor with a wrong scale."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class SensorGain(Effect):
    """y = (1 + g) f, one gain for all channels: a calibration, an excitation voltage or an amplifier that is off.

    It scales the tool's weight too. In a contact frame, where weight was taken off before, stiffness does the same.
    """

    id = "sensor-gain"
    title = "gain error of the sensor"
    equation = "y = (1 + g) f"
    source = "any strain-gauge sensor's data sheet (span error)"
    signature = "a residual proportional to the reading itself, the tool's weight included"
    confusions = {
        "tool-mass": "contact: a mass doesn't scale it",
        "hooke": "free rotation: stiffness doesn't scale weight",
    }
    excited_by = "free rotation of a tool of known mass"
    needs = ()
    null = {"gain": 0.0}
    admissible = {"gain": (-0.8, 4.0)}  # a gain of 0 reads nothing; pounds for newtons are 3.45
    example = Example(("hooke",), {"gain": 0.035}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Gain error."""
        return (Parameter("gain", "g", "1", 0.0, -0.9, 9.0, scale=0.01),)

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """What the rig states: a data sheet's accuracy, which no log of contact shows."""
        return {"gain": signals.gain_sd} if signals.gain_sd > 0.0 else {}

    def sensor(self, s: Signals, p: Array) -> None:
        """Scale the readings."""
        s.reading = (1.0 + p[0]) * s.reading
