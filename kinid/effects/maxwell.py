"""A spring behind a dashpot."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.memory import lowpass
from kinid.parameter import Parameter


@final
class Maxwell(Effect):
    """N = F_e − y with τ ẏ = F_e − y and F_e = k δ: a spring k [N/m] behind a dashpot k τ [N·s/m]; it can't hold a
    load.

    The branch is driven by F_e, so that effects on the elastic force act on it too (quasi-linear, Fung 1981). F_e is
    instantaneous; with a linear spring this is Ṅ + N/τ = k δ̇. A tool that retracts leaves what has flowed: nothing
    pulls.
    """

    id = "maxwell"
    title = "spring and dashpot in a row"
    equation = "N = F_e − y, τ ẏ = F_e − y, F_e = k δ"
    source = "J. C. Maxwell, Phil. Trans. R. Soc. 157, 1867"
    base = True
    signature = "force that falls to nothing while depth is held, and ends early on the way out"
    confusions = {"zener": "a hold of several time constants: does a force remain?"}
    excited_by = "a fast approach, then a hold of several time constants"
    grid = {"time-constant": (0.02, 0.1, 0.5, 2.0, 10.0, 60.0)}
    # stable; slower than a day or faster than samples, a flow is none
    admissible = {"stiffness": (0.0, 1e8), "time-constant": (1e-4, 1e5)}
    example = Example((), {"stiffness": 1200.0, "time-constant": 0.8})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness, time constant."""
        return (
            Parameter("stiffness", "k", "N/m", 1000.0, 0.0, 1e8, scale=100.0, linear=True),
            Parameter("time-constant", "τ", "s", 1.0, 1e-4, 1e5, scale=0.1),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the force of the spring before anything has flowed."""
        s.elastic = p[0] * s.penetration

    def normal(self, s: Signals, p: Array) -> None:
        """Take off what has flowed."""
        flowed = np.empty(len(s))
        lowpass(s.elastic, s.flowing, p[1], flowed)
        s.normal = s.normal - np.minimum(flowed, s.elastic) * s.inside
