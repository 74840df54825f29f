"""A sensor that follows slowly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.acquisition import lag
from kinid.parameter import Parameter

#: time constant within which the filter of a drive's torques is left open [s]: 25 Hz and faster, twice this
DRIVE_FILTER = 3e-3


@final
class SensorLag(Effect):
    """T ẏ = f − y: a first-order low-pass on all channels, in balance where the log or a piece of it begins."""

    id = "sensor-lag"
    title = "low-pass of the sensor"
    equation = "T ẏ = f − y"
    source = "any amplifier's data sheet (first-order low-pass)"
    signature = "fast changes come late and smaller"
    confusions = {"time-offset": "high frequencies: a delay doesn't make them smaller"}
    excited_by = "forces that change within a few time constants"
    needs = ()
    null = {"time-constant": 0.0}
    grid = {"time-constant": (1e-3, 4e-3, 1.5e-2, 6e-2)}
    unremarkable = {"time-constant": 3.2e-3}  # sensors come with filters of 50 Hz and faster
    tolerated_in_joints = {"time-constant": 0.032}  # torques of drives are filtered at 5 Hz and faster
    admissible = {"time-constant": (0.0, 0.1)}  # slower than 1.6 Hz, a sensor is none of contact forces
    example = Example(("kelvin-voigt",), {"time-constant": 0.011}, Motion.WAVES)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Time constant."""
        return (Parameter("time-constant", "T", "s", 0.002, 0.0, 1.0, scale=5e-4),)

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """Torques of drives come through a filter of their own."""
        return {"time-constant": DRIVE_FILTER} if signals.layout.kind == "joints" else {}

    def acquisition(self, s: Signals, p: Array) -> None:
        """Filter the readings."""
        out = np.empty(s.reading.shape)
        lag(np.ascontiguousarray(s.reading), s.dt, float(p[0]), out)
        s.reading = out
