"""A parameter owns its name, symbol, unit, bounds and size."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterId:
    """Which parameter of a model: its effect, its name there, and the joint, channel or node that it is of, if any.

    As text it is "effect.name[index]", in JSON and on screens.
    """

    effect: str
    name: str
    index: str = ""

    @classmethod
    def parse(cls, text: str) -> ParameterId:
        """From its text; without an effect where there is none before a dot."""
        name, _, index = text.partition("[")
        effect, _, name = name.rpartition(".")
        return cls(effect, name, index.removesuffix("]"))

    def __str__(self) -> str:
        return ".".join(filter(None, (self.effect, self.name))) + (f"[{self.index}]" if self.index else "")


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
    def stem(self) -> str:
        """Its name without the joint, channel or node that it is of."""
        return ParameterId.parse(self.name).name

    @property
    def is_share(self) -> bool:
        """Whether it is a share of something, of which none and all are cases of the law."""
        return (self.unit, self.low, self.high) == ("1", 0.0, 1.0)

    @property
    def fixed(self) -> bool:
        """Whether nothing is left to estimate."""
        return self.low == self.high
