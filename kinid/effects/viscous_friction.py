"""Friction in proportion to speed."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class ViscousFriction(Effect):
    """T −= c v while in contact: v the slip's velocity, c [N·s/m]; whatever the load."""

    id = "viscous-friction"
    title = "friction in proportion to speed"
    equation = "T −= c v"
    source = "O. Reynolds, Phil. Trans. R. Soc. 177, 1886"
    signature = "a tangential force that follows the slip's speed, not the load"
    confusions = {
        "stribeck-friction": "three speeds: one grows with speed, the other fades",
        "coulomb-friction": "two speeds at one load",
    }
    excited_by = "slides at three speeds"
    needs = ("normal", "slip")
    null = {"damping": 0.0}
    admissible = {"damping": (0.0, 1e5)}  # friction takes energy
    example = Example(("hooke", "coulomb-friction"), {"damping": 7.0})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Damping."""
        return (Parameter("damping", "c", "N·s/m", 0.0, -1e8, 1e8, scale=0.5, linear=True),)

    def friction(self, s: Signals, p: Array) -> None:
        """Add the force."""
        s.tangential = s.tangential - p[0] * s.slip_rate * s.inside
