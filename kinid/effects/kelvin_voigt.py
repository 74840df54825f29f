"""A spring beside a dashpot."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels import contact_laws
from kinid.parameter import Parameter


@final
class KelvinVoigt(Effect):
    """N = k δ + c δ̇ for δ > 0: k [N/m], c [N·s/m]. The dashpot jumps at touch and pulls at separation."""

    id = "kelvin-voigt"
    title = "linear spring and dashpot side by side"
    equation = "N = k δ + c δ̇"
    source = "W. Thomson (Lord Kelvin), Proc. R. Soc. 14, 1865; W. Voigt, Ann. Phys. 283, 1892"
    base = True
    signature = "a loop over depth as wide at the surface as deep inside, wider the faster it is run through"
    confusions = {"hunt-crossley": "a wide range of depths, in and out at several speeds"}
    tensile = True
    excited_by = "two depths at two speeds"
    recursive = "KelvinVoigt"
    # stable, no stiffer than steel on steel; a dashpot gives no energy
    admissible = {"stiffness": (0.0, 1e8), "damping": (0.0, 1e6)}
    example = Example((), {"stiffness": 830.0, "damping": 14.0})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness, damping."""
        return (
            Parameter("stiffness", "k", "N/m", 1000.0, 0.0, 1e8, scale=100.0, linear=True),
            Parameter("damping", "c", "N·s/m", 0.0, -1e8, 1e8, scale=1.0, linear=True),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the elastic force."""
        s.elastic = contact_laws.kelvin_voigt(s.penetration, s.zeros[0], p[0], 0.0)

    def normal(self, s: Signals, p: Array) -> None:
        """Add the damping."""
        s.normal = s.normal + contact_laws.kelvin_voigt(s.zeros[0], s.depth_rate * s.inside, 0.0, p[1])
