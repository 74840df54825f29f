"""Dry friction of the joints."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._axes import axes, directions
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointCoulombFriction(Effect):
    """τ += F_c u: as large at every speed; at rest it keeps the direction that the last motion left.

    u is the deflection of bristles of a fixed length of 1e-4 rad (or 1e-5 m), so that it turns within that travel at a
    reversal (Dahl) and jitter at rest wears it off.
    """

    id = "joint-coulomb-friction"
    title = "dry friction of the joints"
    equation = "τ += F_c u, u = sign q̇ in motion"
    source = "C. A. Coulomb, Théorie des machines simples, 1785; bristles: P. R. Dahl, 1968"
    signature = "a step in the torque where a joint reverses"
    confusions = {
        "joint-viscous-friction": "several speeds",
        "joint-torque-offset": "motion in both directions",
        "joint-stribeck-friction": "several speeds, slow ones too",
        "joint-load-friction": "poses that load the joint and poses that don't",
    }
    excited_by = "motion in both directions"
    needs = ("joints",)
    null = {"coulomb": 0.0}
    admissible = {"coulomb": (0.0, math.inf)}  # friction takes energy
    example = Example(("rigid-body",), {"coulomb": (0.8, 0.5)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Friction torque of each joint."""
        return tuple(
            Parameter(f"coulomb{a.suffix}", "F_c", a.torque, a.size, 0.0, 1e4 * a.size, scale=0.1 * a.size, linear=True)
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        s.reading = s.reading + p[:, None] * directions(s)
