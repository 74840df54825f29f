"""Springs beside the joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._axes import axes, usual_offset
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: effect that holds the torque of a spring at the encoder's zero, too
OFFSET = "joint-torque-offset"


@final
@dataclass(frozen=True)
class JointSpring(Effect):
    """τ += k q + τ₀: a balancer, a hose or a cable that pulls back in proportion to the angle; k < 0 where it pushes
    on.

    q counts from the encoder's zero, where the spring pulls with τ₀: it is at rest at −τ₀/k. Nothing tells τ₀ from an
    offset of the torque's zero: beside `joint-torque-offset`, which holds both, it is fixed at 0.

    Args:
        preloaded: whether τ₀ is open.
    """

    preloaded: bool = True

    id = "joint-spring"
    title = "springs beside the joints"
    equation = "τ += k q + τ₀"
    source = (
        "R. Hooke, De potentia restitutiva, 1678; of arms: J. L. Herder, Energy-free Systems, TU Delft, "
        "2001 (balancers)"
    )
    signature = "torque that follows the angle of its joint in a straight line, whatever the others do"
    confusions = {
        "gravity-error": "other joints turned: gravity follows them too",
        "payload": "other joints turned: a payload's torque follows them too",
        "joint-torque-offset": "a wide range of angles",
        "joint-torque-gain": "other joints turned, and a wide range of angles: gravity bends, a spring is straight",
    }
    excited_by = "a wide range of angles, with the other joints in several positions"
    needs = ("joints",)
    null = {"rate": 0.0, "preload": 0.0}
    admissible = {"rate": (-1e5, 1e5)}  # of either sign: a balancer pushes on beyond its dead centre
    generalises = (OFFSET,)
    includes = (OFFSET,)
    example = Example(("rigid-body",), {"rate": (2.5, -0.7)}, Motion.ARM)

    def beside(self, names: Collection[str]) -> JointSpring:
        """Without a torque at the encoder's zero where an offset holds it."""
        return JointSpring(OFFSET not in names)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Rate of the spring of each joint, and its torque at the encoder's zero."""
        out = []
        for a in axes(layout):
            stiff, most, scale = 1e6 * a.size, 1e6 * a.size if self.preloaded else 0.0, 0.1 * a.size
            out += [
                Parameter(f"rate{a.suffix}", "k", a.per(), 0.0, -stiff, stiff, scale=scale, linear=True),
                Parameter(f"preload{a.suffix}", "τ₀", a.torque, 0.0, -most, most, scale=scale, linear=True),
            ]
        return tuple(out)

    def usual(self, parameter: Parameter) -> float:
        """The offset of a sensor, and as much over a radian."""
        return usual_offset(parameter.name)

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A spring that is nowhere near its rest, too: what it pulls with is an offset."""
        for j, axis in enumerate(axes(signals.layout) if signals is not None and signals.joints is not None else ()):
            q = signals.joints.q[j]  # type: ignore[union-attr]
            rate, preload = values.get(f"rate{axis.suffix}", 0.0), values.get(f"preload{axis.suffix}", 0.0)
            middle, reach = (
                0.5 * float(q.min() + q.max()),
                1.5 * float(np.ptp(q)) + (np.pi if axis.position == "rad" else 0.0),
            )
            if abs(rate * middle + preload) > abs(rate) * reach + usual_offset(f"preload{axis.suffix}"):
                return (
                    f"a pull of {preload:.3g} {axis.torque} that {rate:.3g} {axis.per()} bring to rest far beyond "
                    "the travel"
                )
        return super().implausible(values, model_values, signals)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        rate, preload = p.reshape(-1, 2).T[:, :, None]
        s.reading = s.reading + rate * s.joints.q + preload
