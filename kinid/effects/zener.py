"""The standard linear solid."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.memory import lowpass
from kinid.parameter import Parameter


@final
class Zener(Effect):
    """A spring k [N/m] beside a Maxwell branch of stiffness k₁ = ρ k and time constant τ [s]: the standard linear
    solid.

    N = k δ + k₁ (δ − y) with τ ẏ = δ − y. Written with the instantaneous force F_e = (1 + ρ) k δ the branch takes off
    ρ/(1 + ρ) of F_e, low-pass filtered, so that effects on the elastic force act on spring and branch alike
    (quasi-linear, Fung 1981). k alone remains in the end. A tool that retracts faster than the material recovers leaves
    it: nothing pulls.
    """

    id = "zener"
    title = "standard linear solid"
    equation = "N = k δ + ρ k (δ − y), τ ẏ = δ − y"
    source = "C. Zener, Elasticity and Anelasticity of Metals, 1948; R. M. Christensen, Theory of Viscoelasticity, 1982"
    base = True
    signature = "force that falls to a lower level while depth is held"
    confusions = {
        "kelvin-voigt": "a hold after a fast approach: only this one goes on falling",
        "maxwell": "a hold of several time constants: does a force remain?",
    }
    excited_by = "a fast approach, then a hold of several time constants"
    grid = {"branch-ratio": (0.2, 1.0, 5.0), "time-constant": (0.02, 0.1, 0.4, 1.5, 6.0, 30.0)}
    # glass is a thousand times as stiff as the same polymer when it has relaxed (J. D. Ferry 1980, ch. 2)
    admissible = {"stiffness": (0.0, 1e8), "branch-ratio": (0.0, 1e3), "time-constant": (1e-4, 1e5)}
    example = Example((), {"stiffness": 600.0, "branch-ratio": 0.7, "time-constant": 0.35})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness in the end, the branch's stiffness relative to it, time constant."""
        return (
            Parameter("stiffness", "k", "N/m", 1000.0, 0.0, 1e8, scale=100.0, linear=True),
            Parameter("branch-ratio", "ρ", "1", 0.5, 0.0, 1e4, scale=0.05),
            Parameter("time-constant", "τ", "s", 0.5, 1e-4, 1e5, scale=0.1),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the force of both springs before anything has flowed."""
        s.elastic = (1.0 + p[1]) * p[0] * s.penetration

    def normal(self, s: Signals, p: Array) -> None:
        """Take off what has flowed in the branch."""
        flowed = np.empty(len(s))
        lowpass(s.elastic, s.flowing, p[2], flowed)
        s.normal = s.normal - np.minimum(p[1] / (1.0 + p[1]) * flowed, s.elastic) * s.inside
