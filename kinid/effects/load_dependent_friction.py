"""A friction coefficient that depends on the load."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class LoadDependentFriction(Effect):
    """μ ·= (N/N₀)^p with N₀ = 1 N: T grows with the power 1 + p of the load; −1/3 for a smooth round tip (T ∝ area)."""

    id = "load-dependent-friction"
    title = "friction coefficient that depends on load"
    equation = "μ ·= (N/N₀)^p, N₀ = 1 N"
    source = "J. F. Archard, Proc. R. Soc. A 243, 1957; rubber: A. Schallamach, Proc. Phys. Soc. B 65, 1952"
    signature = "the ratio of tangential to normal force changes with load"
    confusions = {
        "coulomb-friction": "two depths: its ratio is the same at both",
        "adhesion": "light loads: a bond adds force where the load goes to zero",
    }
    excited_by = "slides at loads that differ by a factor of three or more"
    needs = ("normal", "slip")
    requires = ("coulomb-friction",)
    null = {"exponent": 0.0}
    affine = False  # the tangential force is a power of the normal one
    grid = {"exponent": (-0.5, -0.25, 0.25, 0.5)}
    order = 1
    unremarkable = {"exponent": 0.03}  # nothing rubs in proportion to its load better than that
    admissible = {"exponent": (-0.9, 1.0)}  # T grows with the load: −1/3 Hertzian, 0 Amontons (Archard 1957)
    example = Example(("hooke", "coulomb-friction"), {"exponent": -0.27})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Exponent."""
        return (Parameter("exponent", "p", "1", 0.0, -0.9, 3.0, scale=0.05),)

    def friction(self, s: Signals, p: Array) -> None:
        """Scale the coefficient."""
        # below a millinewton the coefficient stays what it is there: its power would be infinite at no load. A dashpot
        # that pulls where a tool retracts is a load of the other sign
        s.mu = s.mu * np.power(np.maximum(np.abs(s.load), 1e-3), p[0])
