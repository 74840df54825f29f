"""Two clocks."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.acquisition import delay
from kinid.parameter import Parameter


@final
class TimeOffset(Effect):
    """y(t) = f(t − d): readings come late by d, or early where it is negative; within each piece without a gap."""

    id = "time-offset"
    title = "offset between the clocks of joints and readings"
    equation = "y(t) = f(t − d)"
    source = "E. Catmull, R. Rom, Computer Aided Geometric Design, 1974 (interpolation)"
    signature = "a residual proportional to the rate of the reading"
    confusions = {
        "sensor-lag": "high frequencies: a lag makes them smaller",
        "viscous-damping": "free motion: weight is late too",
    }
    excited_by = "forces that change fast"
    needs = ()
    per_log = True
    null = {"delay": 0.0}
    grid = {"delay": (-5e-2, -1e-2, -2e-3, 2e-3, 1e-2, 5e-2)}
    order = 1
    calibration_tolerance = {"delay": 2.5e-4}  # a quarter of the period of a bus at 1 kHz
    tolerated = {"delay": 5e-3}  # stamps of two machines, and filters of 30 Hz and faster
    tolerated_in_joints = {"delay": 0.032}  # torques of drives are filtered at 5 Hz and faster
    admissible = {"delay": (-0.25, 0.25)}  # buffers and buses; more is another recording
    example = Example(("hooke", "coulomb-friction"), {"delay": -0.0043}, Motion.WAVES)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Delay of the readings."""
        return (Parameter("delay", "d", "s", 0.0, -0.5, 0.5, scale=5e-4),)

    def acquisition(self, s: Signals, p: Array) -> None:
        """Shift the readings."""
        out = np.empty(s.reading.shape)
        delay(np.ascontiguousarray(s.reading), s.t, s.dt, float(p[0]), out)
        s.reading = out
