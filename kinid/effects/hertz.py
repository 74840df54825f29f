"""Hertzian contact."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class Hertz(Effect):
    """N = K δ^1.5 for δ > 0: a round tip on an elastic half-space, K [N/m^1.5].

    For a sphere of radius R on a material of modulus E and Poisson's ratio ν, K = 4/3 · E/(1 − ν²) · √R.
    """

    id = "hertz"
    title = "round tip on an elastic half-space"
    equation = "N = K δ^1.5"
    source = "H. Hertz, J. reine angew. Math. 92, 1882"
    base = True
    signature = "force that grows with the 3/2 power of depth, the same in and out"
    confusions = {"hooke": "a wide range of depths"}
    excited_by = "two depths"
    admissible = {"stiffness": (0.0, 1e11)}  # 4/3 E* √R of a steel ball of 0.1 m on steel: 5e10
    example = Example((), {"stiffness": 1.4e4})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness."""
        return (Parameter("stiffness", "K", "N/m^1.5", 1e4, 0.0, 1e12, scale=1e3, linear=True),)

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the elastic force."""
        s.exponent = 1.5
        s.elastic = p[0] * s.penetration * np.sqrt(s.penetration)
