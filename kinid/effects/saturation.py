"""A sensor at the end of its range."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: so many samples at the very same largest value are a flat top
FLAT = 5


@final
class Saturation(Effect):
    """y = min(max(f, −L), L) for each channel."""

    id = "saturation"
    title = "end of the sensor's range"
    equation = "y = min(max(f, −L), L)"
    source = "any sensor's data sheet (range)"
    signature = "flat tops at one value"
    confusions = {"stiffening-layer": "flat tops have no noise"}
    excited_by = "loads beyond the range"
    needs = ()
    detector = True
    null = {"limit": 1e12}
    affine = False
    turn = 3

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One limit a channel."""
        sizes = {"N": 100.0, "N·m": 5.0}
        return tuple(
            Parameter(f"limit[{name}]", "L", unit, sizes[unit], 0.0, 1e12, scale=0.01 * sizes[unit])
            for name, unit in zip(layout.channels, layout.units)
        )

    def marks(self, measured: Array) -> tuple[Array, Array]:
        """The largest reading of each channel where several samples share it; else no limit."""
        sizes = np.abs(np.where(np.isfinite(measured), measured, 0.0))
        top = sizes.max(axis=1)
        flat = (sizes >= top[:, None] * (1 - 1e-9)).sum(axis=1) >= FLAT
        limits: Array = np.where(flat & (top > 0), top, self.null["limit"])
        return limits, limits

    def acquisition(self, s: Signals, p: Array) -> None:
        """Clip the readings."""
        s.reading = np.clip(s.reading, -p[:, None], p[:, None])
