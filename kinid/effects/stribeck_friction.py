"""More friction when slow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StribeckFriction(Effect):
    """μ += Δμ exp(−(v/v_s)²): friction at rest exceeds that of fast slip by Δμ, which fades over v_s [m/s]."""

    id = "stribeck-friction"
    title = "friction that fades with speed"
    equation = "μ += Δμ exp(−(v/v_s)²)"
    source = "R. Stribeck, Z. VDI 46, 1902; B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30, 1994"
    signature = "more tangential force for its load where slip is slow"
    confusions = {"viscous-friction": "three speeds: one fades with speed, the other grows"}
    excited_by = "slides at three speeds, the slowest well below v_s"
    needs = ("normal", "slip")
    requires = ("coulomb-friction",)
    null = {"coefficient": 0.0}
    tolerated = {"coefficient": math.inf}  # no friction has the form of a model where it comes to rest
    grid = {"speed": (1e-3, 3e-3, 1e-2, 3e-2, 0.1)}
    unremarkable = {"coefficient": 0.02}  # coefficients are told to two digits
    # friction fades with speed, it doesn't grow (that is viscous); hydrodynamic films form within 1 m/s
    admissible = {"coefficient": (0.0, 4.0), "speed": (1e-5, 1.0)}
    example = Example(("hooke", "coulomb-friction"), {"coefficient": 0.17, "speed": 8e-3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Excess at rest, speed over which it fades."""
        return (
            Parameter("coefficient", "Δμ", "1", 0.1, -5.0, 5.0, scale=0.05),
            Parameter("speed", "v_s", "m/s", 5e-3, 1e-6, 10.0, scale=1e-3),
        )

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A coefficient that is negative at rest, too."""
        rest = model_values.get("coulomb-friction.coefficient", 0.0) + values.get("coefficient", 0.0)
        if rest < 0.0:
            return f"coefficient = {values['coefficient']:.3g} makes friction at rest {rest:.3g}: friction takes energy"
        return super().implausible(values, model_values, signals)

    def friction(self, s: Signals, p: Array) -> None:
        """Add to the coefficient."""
        s.mu = s.mu + p[0] * np.exp(-np.sum((s.slip_rate / p[1]) ** 2, axis=0))
