"""Friction that vanishes with speed."""

from __future__ import annotations

import math
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class FrictionRounding(Effect):
    """T = −μ N v/√(|v|² + v_r²) instead of bristles: friction is full from a few v_r [m/s] on, and there is none at
    rest.

    A film of lubricant does so, and most simulators do, which have no bristles. μ is whatever the other effects make of
    it: `stribeck-friction`, `load-dependent-friction` and `friction-anisotropy` act before. It replaces bristles of any
    length: beside it, `presliding` does nothing. At v_r = 0 the bristles of `coulomb-friction` stay: the effect isn't
        there.
    """

    id = "friction-rounding"
    title = "friction that vanishes with speed"
    equation = "T = −μ N v / √(|v|² + v_r²)"
    source = (
        "E. Pennestrì, V. Rossi, P. Salvini, P. P. Valentini, Nonlinear Dynamics 83, 2016 (smoothed Coulomb laws); "
        "in simulators: A. M. Castro et al., IEEE Robotics and Automation Letters 5(2), 2020"
    )
    signature = (
        "a tangential force that goes to nothing where the slip rests under load, and rounded reversals of fast slips"
    )
    confusions = {
        "presliding": "a hold under load after a slip: bristles keep their force, and turn over a length, not over a "
        "speed",
        "viscous-friction": "fast slips at two loads: this one follows the load, and ends where the slip is fast",
        "stribeck-friction": "slow slips: this one has the least friction there, the other one the most",
    }
    excited_by = "slips from well below v_r to well above it, and holds under load"
    needs = ("normal", "slip")
    requires = ("coulomb-friction",)
    null = {"speed": 0.0}
    tolerated = {"speed": math.inf}  # no friction has the form of a model where it comes to rest
    grid = {"speed": (3e-4, 1e-3, 3e-3, 1e-2, 3e-2)}
    admissible = {"speed": (0.0, 0.3)}  # films carry from some millimetres a second on; no slide of a robot is faster
    order = 2
    example = Example(("kelvin-voigt", "coulomb-friction"), {"speed": 6e-3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Speed."""
        return (Parameter("speed", "v_r", "m/s", 3e-3, 0.0, 1.0, scale=5e-4),)

    def friction(self, s: Signals, p: Array) -> None:
        """Set the speed that stands in place of the bristles."""
        if p[0] > 0.0:
            s.rounding = float(p[0])
