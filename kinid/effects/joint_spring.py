"""Springs beside the joints."""

from __future__ import annotations

from typing import final

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointSpring(Effect):
    """τ += k q: a balancer, a hose or a cable that pulls back in proportion to the angle; k < 0 where it pushes on.

    q counts from the encoder's zero. Of a spring that is at rest at q₀ the rest, −k q₀, is a constant, and nothing tells it
    from the zero of the torque: `joint-torque-offset` holds both. With it in the model the spring rests at q₀ = −τ₀/k, as far
    as the torque has no offset of its own.
    """

    id = "joint-spring"
    title = "springs beside the joints"
    equation = "τ += k q"
    source = "R. Hooke, De potentia restitutiva, 1678; of arms: J. L. Herder, Energy-free Systems, TU Delft, 2001 (balancers)"
    signature = "torque that follows the angle of its joint in a straight line, whatever the others do"
    confusions = {
        "gravity-error": "other joints turned: gravity follows them too",
        "payload": "other joints turned: a payload's torque follows them too",
        "joint-torque-offset": "a wide range of angles",
        "joint-torque-gain": "other joints turned, and a wide range of angles: gravity bends, a spring is straight",
    }
    excited_by = "a wide range of angles, with the other joints in several positions"
    needs = ("joints",)
    null = {"rate": 0.0}
    admissible = {"rate": (-1e5, 1e5)}  # of either sign: a balancer pushes on beyond its dead centre

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Spring rate of each joint."""
        return tuple(
            Parameter(f"rate{a.suffix}", "k", a.per(), 0.0, -1e6 * a.size, 1e6 * a.size, scale=0.1 * a.size, linear=True)
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + p[:, None] * s.joints.q
