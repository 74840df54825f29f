"""Friction that depends on direction."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class FrictionAnisotropy(Effect):
    """μ₁ = μ (1 + a), μ₂ = μ (1 − a): more friction along the tangent than across it (grain, fibres, grooves)."""

    id = "friction-anisotropy"
    title = "friction that depends on direction"
    equation = "μ₁ = μ (1 + a), μ₂ = μ (1 − a)"
    source = "A. Zmitrowicz, Wear 73, 1981"
    signature = (
        "the ratio of tangential to normal force changes with the slip's direction, and the force turns away from it"
    )
    confusions = {
        "coulomb-friction": "slides along both tangents",
        "sensor-crosstalk": "pure pokes: an anisotropic surface is quiet there",
    }
    excited_by = "slides along and across the tangent"
    needs = ("normal", "slip")
    requires = ("coulomb-friction",)
    null = {"ratio": 0.0}
    order = 1
    admissible = {"ratio": (-1.0, 1.0)}  # no coefficient is negative
    example = Example(("hooke", "coulomb-friction"), {"ratio": 0.21})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Anisotropy."""
        return (Parameter("ratio", "a", "1", 0.0, -1.0, 1.0, scale=0.05),)

    def friction(self, s: Signals, p: Array) -> None:
        """Scale the coefficient along and across."""
        s.mu = s.mu * np.array([[1.0 + p[0]], [1.0 - p[0]]])
