"""How fast the past is forgotten: the factor β by which each new sample multiplies the weight of all older ones."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from kinid.errors import InputError
from kinid.estimators.estimate import Array


class Forgetting(ABC):
    """A rule for β, 0 < β ≤ 1."""

    @abstractmethod
    def factors(self, t: Array | None) -> Array:
        """β at the times t [s], (n,); or (1,) where it is the same at all of them."""

    def at(self, t: float | None) -> float:
        """β at one time t [s]: the same number as `factors` gives, to the last bit."""
        return float(self.factors(None if t is None else np.array([t], dtype=np.float64))[0])


@dataclass(frozen=True)
class Constant(Forgetting):
    """β constant: a memory of 1/(1 − β) samples; 1 forgets nothing.

    Raises:
        InputError: β not in (0, 1].
    """

    beta: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.beta <= 1.0:
            raise InputError(f"a forgetting factor of {self.beta}", "0 < β ≤ 1", "use 0.95 … 0.999, or 1 for none")

    def factors(self, t: Array | None) -> Array:
        """The one β, (1,)."""
        return np.array([self.beta])


@dataclass(frozen=True)
class Scheduled(Forgetting):
    """β(t) = 1 − drop · exp(−rate · (t − start)), quick at first and then ever slower (Haddadi & Hashtrudi-Zaad 2012).

    Before `start` the formula would fall below 0; there β is 1 − drop. Two seconds later it is 1 to four digits and the
    estimate stands still: right for a constant material, and wrong for one that goes on changing. `memory` ends that: β
    never passes 1 − 1/memory. A parameter that drifts by r in a second is late by r times the memory's time.

    Args:
        rate: c [1/s], ≥ 0.
        start: t₀ [s], when contact began or the environment changed.
        drop: 1 − β at the start, 0 ≤ drop < 1.
        memory: longest [samples], > 1; without end as published.

    Raises:
        InputError: a number outside its range.
    """

    rate: float = 5.0
    start: float = 0.0
    drop: float = 0.01
    memory: float = math.inf

    def __post_init__(self) -> None:
        if not self.memory > 1.0:
            raise InputError(f"a memory of {self.memory} samples", "more than 1", "use 50 … 1000, or inf for no end")
        if not (math.isfinite(self.rate) and self.rate >= 0 and math.isfinite(self.start) and 0 <= self.drop < 1):
            raise InputError(str(self), "rate ≥ 0, a finite start, 0 ≤ drop < 1", "use the numbers of the docstring")

    def factors(self, t: Array | None) -> Array:
        """β at each time, (n,)."""
        if t is None:
            raise _timeless()
        drop = self.drop * np.exp(-self.rate * np.maximum(t - self.start, 0.0))
        return np.asarray(1.0 - np.maximum(drop, 1.0 / self.memory))

    def at(self, t: float | None) -> float:
        """See `Forgetting`; NumPy's exponential here too, since that of `math` may differ in the last bit."""
        if t is None:
            raise _timeless()
        return 1.0 - max(self.drop * float(np.exp(-self.rate * max(t - self.start, 0.0))), 1.0 / self.memory)


def _timeless() -> InputError:
    return InputError("scheduled forgetting without time", "the time of each sample", "pass t [s]")
