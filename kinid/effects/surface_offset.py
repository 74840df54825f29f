"""A surface that lies elsewhere than believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class SurfaceOffset(Effect):
    """δ → δ + z₀: the surface lies z₀ [m] further out than the rig says."""

    id = "surface-offset"
    title = "misplaced surface"
    equation = "δ → δ + z₀"
    source = "S. L. Crick, F. C.-P. Yin, Biomech. Model. Mechanobiol. 6, 2007 (why the point of contact matters)"
    signature = (
        "an error as large as the slope of force over depth, from the first touch on; contact at the wrong depth"
    )
    confusions = {
        "tip-offset": "a tilted poke: an offset of the tip turns with the tool",
        "adhesion": "a slow retraction: only a bond leaves a negative force",
    }
    excited_by = "touch and separation"
    per_log = True
    null = {"offset": 0.0}
    grid = {"offset": (-2e-3, -7e-4, -2e-4, 2e-4, 7e-4, 2e-3)}
    calibration_tolerance = {"offset": 3e-5}  # touch is found to some hundredths of a millimetre
    admissible = {"offset": (-0.02, 0.02)}  # further away it is another surface
    example = Example(("kelvin-voigt", "coulomb-friction"), {"offset": 2.1e-4})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Offset."""
        return (Parameter("offset", "z₀", "m", 0.0, -0.05, 0.05, scale=1e-4),)

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """What the rig states of its surface, else what touching it by hand leaves open."""
        return {name: signals.surface_sd[0] or sd for name, sd in super().calibration_sd(signals).items()}

    def geometry(self, s: Signals, p: Array) -> None:
        """Shift the depth."""
        s.depth = s.depth + p[0]
