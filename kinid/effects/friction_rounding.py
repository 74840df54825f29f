"""Friction that vanishes with speed."""

from __future__ import annotations

import math
from typing import final

import numpy as np

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
        """Add the whole of dry friction, and leave none to the bristles."""
        if p[0] <= 0.0:
            return
        v = s.slip_rate
        touching = s.inside if s.touch is None else s.touch > 0.0
        u = np.where(touching, v / np.sqrt(np.sum(v**2, axis=0) + p[0] ** 2), 0.0)
        s.tangential = s.tangential - s.mu * s.load * u
        s.mu = s.zeros[1]
