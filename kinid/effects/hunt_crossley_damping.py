"""Damping that grows with the elastic force."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class HuntCrossleyDamping(Effect):
    """N += λ F_e δ̇: λ [s/m]. Nothing jumps at touch and nothing pulls at separation while λ |δ̇| < 1.

    For a base K δⁿ this is the law of Hunt and Crossley with B = λ K; a slow impact at speed v then loses the share
    2/3 · λ v of its speed.
    """

    id = "hunt-crossley-damping"
    title = "damping that grows with force"
    equation = "N += λ F_e δ̇"
    source = "K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42, 1975, eq. 8"
    signature = "a loop over depth that grows with the force and closes at the surface"
    confusions = {
        "viscous-damping": "depth × speed: fast motion deep inside and near the surface",
        "relaxation": "a wide range of frequencies, and holds",
        "hysteresis": "the same path at other speeds",
    }
    excited_by = "several depths at several speeds"
    requires = ("hooke", "kelvin-voigt", "hertz", "maxwell", "zener")  # hunt-crossley has its own
    null = {"damping": 0.0}
    admissible = {
        "damping": (0.0, 1e3)
    }  # gives no energy; 2/3 λ v is the loss of speed: at 1e3 all of it from 1.5 mm/s on
    example = Example(("hertz",), {"damping": 2.2})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Damping."""
        return (Parameter("damping", "λ", "s/m", 1.0, -1e4, 1e4, scale=0.1),)

    def normal(self, s: Signals, p: Array) -> None:
        """Add the damping."""
        s.normal = s.normal + p[0] * s.elastic * s.depth_rate
