"""Friction of the joints that grows with speed."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointViscousFriction(Effect):
    """τ += b q̇."""

    id = "joint-viscous-friction"
    title = "viscous friction of the joints"
    equation = "τ += b q̇"
    source = (
        "G. G. Stokes, 1851; for robots: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7), 1994"
    )
    signature = "torque proportional to the speed of a joint"
    confusions = {"joint-coulomb-friction": "several speeds"}
    excited_by = "several speeds"
    needs = ("joints",)
    null = {"viscous": 0.0}
    admissible = {"viscous": (0.0, math.inf)}  # friction takes energy
    example = Example(("rigid-body",), {"viscous": (0.6, 0.2)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Viscosity of each joint."""
        return tuple(
            Parameter(
                f"viscous{a.suffix}", "b", a.per("·s"), a.size, 0.0, 1e5 * a.size, scale=0.1 * a.size, linear=True
            )
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + p[:, None] * s.joints.dq
