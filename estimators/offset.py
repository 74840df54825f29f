"""An error that all outputs share: the zero of a sensor, which is off from the start and wanders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinid.errors import InputError
from kinid.estimators.estimate import Array

#: standard deviation of a strain gauge's zero at the start of a log [N]: the rig's bias was just taken off
ZERO_AT_START = 1e-3
#: the same of what the zero of the normal force gains in a second [N/√s]: millinewtons
ZERO_DRIFT = 8e-4


@dataclass(frozen=True)
class Offset:
    """A random walk that is added to every output, and isn't estimated: intervals alone know of it.

    Args:
        start: standard deviation at the first sample, in the output's unit.
        drift: standard deviation gained in a second.
        period: sample time [s] where no time is given.

    Raises:
        InputError: a number that is negative or not finite, a period that isn't positive.
    """

    start: float = ZERO_AT_START
    drift: float = ZERO_DRIFT
    period: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("start", "drift"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} = {value} of an offset", "a finite number ≥ 0", "use the sensor's data")
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise InputError(f"period = {self.period} s", "a positive number", "give the sample time")

    def memory(self, p: int) -> Array:
        """Its part of the state of p parameters, as `_store` lays it out."""
        return np.concatenate([[self.start**2, self.drift**2, self.period, math.nan], np.zeros(p + p * p)])
