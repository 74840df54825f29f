"""A power law of free exponent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class HertzExponent(Effect):
    """F_e = k δⁿ: the base's spring, of exponent n; its stiffness k then has the unit N/mⁿ.

    n = 1 is a flat punch, 1.5 a sphere, 2 a cone on a half-space; thin and porous materials have others.
    """

    id = "hertz-exponent"
    title = "power law over depth"
    equation = "F_e = k δⁿ"
    source = "H. Hertz, J. reine angew. Math. 92, 1882; I. N. Sneddon, Int. J. Eng. Sci. 3, 1965"
    signature = "curvature of force over depth"
    confusions = {
        "stiffening-layer": "a wider range of depths: a layer stiffens at one depth, a power law at all of them"
    }
    excited_by = "depths that differ by a factor of three or more"
    requires = ("hooke", "kelvin-voigt", "hertz", "maxwell", "zener")
    null = {"exponent": 1.0}
    grid = {"exponent": (0.8, 1.2, 1.5, 2.0, 2.6)}
    unremarkable = {"exponent": 0.03}  # no tip and no material is a power law to better than that
    tolerated = {"exponent": math.inf}  # no material has exactly the form of a law
    admissible = {
        "exponent": (0.8, 3.5)
    }  # punch 1, sphere 1.5, cone 2 (Sneddon 1965); below, skins; above, foam that densifies
    example = Example(("hooke",), {"hooke.stiffness": 5200.0, "exponent": 1.37})

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """The base's own exponent."""
        return {"exponent": 1.5} if base == "hertz" else self.null

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Exponent."""
        return (Parameter("exponent", "n", "1", 1.2, 0.3, 4.0, scale=0.1),)

    def elastic(self, s: Signals, p: Array) -> None:
        """Replace the base's exponent."""
        shape = np.power(s.penetration, p[0] - s.exponent, out=np.zeros(len(s)), where=s.inside)
        s.elastic = s.elastic * shape
        s.exponent = float(p[0])
