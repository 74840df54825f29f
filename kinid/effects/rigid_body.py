"""Inverse dynamics of the robot."""

from __future__ import annotations

from typing import final

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class RigidBody(Effect):
    """τ = M(q) q̈ + C(q, q̇) q̇ + g(q) of the rig's robot, without a free parameter; of an axis without a robot τ = M
    q̈.
    """

    id = "rigid-body"
    title = "rigid-body dynamics"
    equation = "τ = M(q) q̈ + C(q, q̇) q̇ + g(q)"
    source = "J. Y. S. Luh, M. W. Walker, R. P. C. Paul, J. Dyn. Syst. Meas. Control 102, 1980"
    base = True
    signature = "torque that follows acceleration and pose"
    excited_by = "motion; an axis without a robot needs acceleration"
    needs = ("joints",)
    admissible = {"inertia": (0.0, 1e6)}  # kinetic energy is positive
    example = Example((), {"inertia": 94.0}, Motion.DRIVE)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Inertia of each axis, where there is no robot to know it."""
        if layout.joints:
            return ()
        return tuple(
            Parameter(f"inertia{a.suffix}", "M", a.per("·s²"), a.size, 0.0, 1e6, scale=0.01 * a.size, linear=True)
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + (s.joints.rigid if s.layout.joints else p[:, None] * s.joints.ddq)
