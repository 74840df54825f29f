"""Hooke's law."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class Hooke(Effect):
    """F_e = k δ for δ > 0: a spring without loss, k [N/m]."""

    id = "hooke"
    title = "linear spring"
    equation = "N = k δ"
    source = "R. Hooke, De potentia restitutiva, 1678"
    base = True
    signature = "force proportional to depth, the same in and out"
    excited_by = "two depths"
    recursive = "KelvinVoigt"
    admissible = {"stiffness": (0.0, 1e8)}  # stable, and no stiffer than a steel ball on steel at kilonewtons (Hertz)
    example = Example((), {"stiffness": 830.0})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Stiffness."""
        return (Parameter("stiffness", "k", "N/m", 1000.0, 0.0, 1e8, scale=100.0, linear=True),)

    def elastic(self, s: Signals, p: Array) -> None:
        """Set the elastic force."""
        s.elastic = p[0] * s.penetration
