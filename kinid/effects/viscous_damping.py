"""A dashpot beside the material."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class ViscousDamping(Effect):
    """N += c δ̇ for δ > 0: c [N·s/m]."""

    id = "viscous-damping"
    title = "dashpot"
    equation = "N += c δ̇"
    source = "W. Voigt, Ann. Phys. 283, 1892"
    signature = "a loop over depth whose width follows the speed and doesn't depend on the force"
    confusions = {
        "relaxation": "a wide range of frequencies: a dashpot's loop widens without limit, relaxation's narrows again",
        "hunt-crossley-damping": "fast motion deep inside and near the surface",
        "time-offset": "fast motion in one direction, then the other, at different stiffness or depth",
    }
    tensile = True
    excited_by = "in and out at several speeds"
    requires = ("hooke", "hertz", "hunt-crossley", "maxwell", "zener")  # kelvin-voigt has one
    null = {"damping": 0.0}
    admissible = {"damping": (0.0, 1e6)}  # a dashpot gives no energy
    example = Example(("hertz",), {"damping": 11.0})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Damping."""
        return (Parameter("damping", "c", "N·s/m", 0.0, -1e8, 1e8, scale=1.0, linear=True),)

    def normal(self, s: Signals, p: Array) -> None:
        """Add the damping."""
        s.normal = s.normal + p[0] * s.depth_rate * s.inside
