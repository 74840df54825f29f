"""The law of Hunt and Crossley."""

from __future__ import annotations

from typing import final

from kinid.effects._derived import power_of_depth
from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels import contact_laws
from kinid.parameter import Parameter


@final
class HuntCrossley(Effect):
    """N = K δⁿ + B δⁿ δ̇ for δ > 0: a power law whose loss grows with the force, so that nothing pulls at separation."""

    id = "hunt-crossley"
    title = "power-law spring with damping that grows with depth"
    equation = "N = K δⁿ + B δⁿ δ̇"
    source = "K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42, 1975, eq. 8"
    base = True
    signature = "a loop over depth that closes at zero force and widens with force and speed"
    confusions = {"kelvin-voigt": "a wide range of depths, in and out at several speeds"}
    excited_by = "several depths at several speeds"
    recursive = "SingleStage"
    grid = {"exponent": (1.0, 1.3, 1.6, 2.1)}
    # stable, gives no energy; exponents from a skin that softens (Sneddon 1965: 1 and more) to densifying foam
    admissible = {"stiffness": (0.0, 1e12), "damping": (0.0, 1e12), "exponent": (0.8, 3.5)}
    example = Example((), {"stiffness": 2300.0, "damping": 1700.0, "exponent": 1.31})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness, damping, exponent."""
        return (
            Parameter("stiffness", "K", "N/m^n", 1000.0, 0.0, 1e12, scale=100.0, linear=True),
            Parameter("damping", "B", "N·s/m^(n+1)", 0.0, -1e12, 1e12, scale=100.0, linear=True),
            Parameter("exponent", "n", "1", 1.2, 0.3, 4.0, scale=0.1),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the elastic force."""
        s.exponent = float(p[2])
        s.elastic = contact_laws.hunt_crossley(power_of_depth(s, p[2]), s.zeros[0], p[0], 0.0)

    def normal(self, s: Signals, p: Array) -> None:
        """Add the damping."""
        s.normal = s.normal + contact_laws.hunt_crossley(power_of_depth(s, p[2]), s.depth_rate, 0.0, p[1])
