"""Dry friction between tool and material."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class CoulombFriction(Effect):
    """T = −μ N u: along the slip; at rest it keeps the direction that the last slip left.

    u is the deflection of bristles of a fixed length of 0.1 mm (Dahl): motion alone can't tell the force at rest.
    `presliding` frees this length.
    """

    id = "coulomb-friction"
    title = "dry friction"
    equation = "T = −μ N u, where u turns along the slip over 0.1 mm and keeps its direction at rest"
    source = "C. A. Coulomb, Théorie des machines simples, 1785; bristles: P. R. Dahl, 1968"
    signature = "a step in the tangential force where the slip reverses, as high as the normal force is large"
    confusions = {"viscous-friction": "slow and fast slides: dry friction doesn't grow with the speed"}
    excited_by = "slip, best in both directions"
    map_names = {"coefficient": "friction"}
    recursive = "Friction"
    needs = ("normal", "slip")
    null = {"coefficient": 0.0}
    admissible = {"coefficient": (0.0, 4.0)}  # friction takes energy; rubber on clean glass reaches 4 (Persson 2001)
    example = Example(("hunt-crossley",), {"coefficient": 0.34})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Friction coefficient."""
        return (Parameter("coefficient", "μ", "1", 0.3, 0.0, 5.0, scale=0.1),)

    def friction(self, s: Signals, p: Array) -> None:
        """Add to the coefficient."""
        s.mu = s.mu + p[0]
