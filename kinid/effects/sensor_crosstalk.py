"""Channels that copy one another."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: of an entry's size, what is usual, and what any calibration leaves
USUAL, CALIBRATED = 0.05, 0.01


@final
class SensorCrosstalk(Effect):
    """y_i = f_i + Σ_j≠i c_ij f_j, c_ij the share of channel j that channel i reads.

    All of a wrench's thirty, or those of the forces in a contact frame, which are the sensor's own as long as the tool
    keeps its orientation. A log of joint torques, or of one channel, has none.
    """

    id = "sensor-crosstalk"
    title = "cross-talk between channels"
    equation = "y = (1 + C) f, C with an empty diagonal"
    source = "any six-axis sensor's data sheet (calibration matrix)"
    signature = "one channel copies another, whatever causes the load"
    confusions = {
        "sensor-misalignment": "loads along x and along y: a rotation copies both ways with opposite signs",
        "tip-offset": "loads along several directions",
    }
    excited_by = "loads along every direction, one at a time"
    couples = True
    needs = ()
    null = {"crosstalk": 0.0}
    order = 1
    # data sheets state some per cent; more is another channel
    admissible = {"crosstalk[1]": (-0.3, 0.3), "crosstalk[1/m]": (-6.0, 6.0), "crosstalk[m]": (-0.05, 0.05)}
    example = Example(
        ("hooke", "coulomb-friction"),
        {
            "crosstalk": (
                *(-0.025, -0.016, 0.30, 0.08, -0.41),
                *(-0.004, -0.001, -0.34, 0.23, -0.39),
                *(-0.007, 0.001, -0.07, 0.09, 0.24),
                *(1.8e-3, -9e-4, 6e-4, 0.012, -0.012),
                *(-2e-3, 1.9e-3, -8e-4, -0.011, 0.024),
                *(3e-4, -1e-4, 1.1e-3, -0.028, 0.012),
            )
        },
        Motion.WRENCH,
    )

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Off-diagonal entries, row by row."""
        if layout.kind == "joints":
            return ()
        named = list(zip(layout.channels, layout.units))
        pairs = [(f"{i},{j}", *_SHARES[u, v]) for i, u in named for j, v in named if i != j]
        return tuple(
            Parameter(f"crosstalk[{pair}]", "c", unit, 0.0, -size, size, scale=0.01 * size)
            for pair, unit, size in pairs
        )

    def prior(self, layout: Layout) -> Array | None:
        """No entry is far beyond what data sheets state: few motions load a sensor along every direction alone."""
        sizes = [USUAL * parameter.high for parameter in self.parameters(layout)]
        return np.diag(1.0 / np.square(sizes)) if sizes else None

    def usual(self, parameter: Parameter) -> float:
        """What is left after calibration, as data sheets state it."""
        return CALIBRATED * parameter.high

    def sensor(self, s: Signals, p: Array) -> None:
        """Mix the channels."""
        n = len(s.layout.channels)
        if not len(p):
            return
        matrix = np.eye(n)
        matrix[~np.eye(n, dtype=np.bool_)] = p
        s.reading = matrix @ s.reading


# unit and size of a share by the units of the reading channel and the copied one: forces are some 20 times torques
_SHARES = {("N", "N"): ("1", 1.0), ("N·m", "N·m"): ("1", 1.0), ("N", "N·m"): ("1/m", 20.0), ("N·m", "N"): ("m", 0.05)}
