"""A parameter owns its name, symbol, unit, bounds and size."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One number of a physical law.

    Attributes:
        name: kebab-case, unique within its effect; a parameter of one joint or channel ends in its name in brackets.
        symbol: how it stands in the effect's equation.
        unit: SI, "1" for none.
        nominal: a plausible value, from which a fit starts.
        low, high: what is physically possible; the same where a model fixes it.
        scale: a change that matters, in the same unit; fits and conditioning are judged in it.
        linear: whether the prediction is affine in it, together with all other linear ones of a model.
    """

    name: str
    symbol: str
    unit: str
    nominal: float
    low: float = -math.inf
    high: float = math.inf
    scale: float = 1.0
    linear: bool = False

    def __post_init__(self) -> None:
        if not self.low <= self.nominal <= self.high:
            raise ValueError(f"{self.name}: nominal {self.nominal} outside [{self.low}, {self.high}]")
        if not (self.scale > 0 and math.isfinite(self.scale)):
            raise ValueError(f"{self.name}: scale {self.scale} is not positive")

    @property
    def fixed(self) -> bool:
        """Whether nothing is left to estimate."""
        return self.low == self.high
