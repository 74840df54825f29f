"""Bristles of free length."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: end of the bristles' length [m]
SHORTEST = 1e-6


@final
class Presliding(Effect):
    """u̇ = (v − |v| u) / ℓ with ℓ free: friction needs a slip of about ℓ [m] to turn around (Dahl; with Stribeck:
    LuGre).

    Bristles of less than twice the length of those of `coulomb-friction` are a form of friction at rest that a fit
    chooses by itself.
    """

    id = "presliding"
    title = "friction that gives before it slips"
    equation = "ℓ u̇ = v − |v| u"
    source = (
        "P. R. Dahl, Aerospace Corp. TOR-0158(3107-18)-1, 1968; "
        "C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE Trans. Autom. Control 40, 1995"
    )
    signature = "rounded reversals of the tangential force"
    confusions = {
        "structural-compliance": "other loads: an arm bends in proportion to the force, bristles don't",
        "friction-rounding": "a hold under load after a slip: bristles keep their force, and turn over a length",
        "time-offset": "slow and fast reversals: a delay grows with speed, a length doesn't",
    }
    excited_by = "reversals of slip, slow ones, and slips shorter than ℓ"
    needs = ("normal", "slip")
    requires = ("coulomb-friction",)
    null = {"length": 1e-4}  # the length that friction has without this effect
    tolerated = {"length": math.inf}  # no friction has the form of a model where it comes to rest
    grid = {"length": (3e-4, 1e-3, 3e-3)}
    admissible = {"length": (SHORTEST, 0.02)}  # soft skins shear by millimetres before they slip, not by centimetres
    example = Example(("kelvin-voigt", "coulomb-friction"), {"length": 4.2e-4})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Length."""
        return (Parameter("length", "ℓ", "m", 3e-4, SHORTEST, 0.1, scale=1e-4),)

    def friction(self, s: Signals, p: Array) -> None:
        """Set the bristles' length."""
        s.bristle, s.rounding = float(p[0]), 0.0
