"""What a motion will tell about a model's parameters: sensitivities, information, and intervals before anything
moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.identification.fit import Z95
from kinid.parameter import Parameter
from kinid.writers import Json, finite

Array = NDArray[np.float64]

#: D: the volume of the parameters' confidence region; A: the sum of squared relative intervals
CRITERIA = ("D", "A")
#: a direction of the parameters that the information holds less of than this is open
OPEN = 1e-12


@dataclass(frozen=True)
class Interval:
    """A 95 % interval that a motion is expected to give: around the value assumed, ± half; infinite where it tells
    nothing.
    """

    name: str
    value: float
    half: float
    unit: str

    def to_dict(self) -> Json:
        """For JSON."""
        return {"value": self.value, "half": finite(self.half), "unit": self.unit}


def sensitivities(predict: Callable[[Array], Array], values: Array, parameters: Mapping[str, Parameter]) -> Array:
    """Change of every reading per relative change of each parameter, (channels, n, p); central differences.

    Relative to the parameter's value, or to its scale where that is larger: see `sizes`.
    """
    size, step = sizes(values, parameters), 1e-3
    columns = []
    for k, p in enumerate(parameters.values()):
        both = []
        for sign in (1.0, -1.0):
            there = values.copy()
            there[k] = np.clip(values[k] + sign * step * size[k], p.low, p.high)
            both.append((there[k], predict(there)))
        columns.append((both[0][1] - both[1][1]) / (both[0][0] - both[1][0]) * size[k])
    return np.stack(columns, axis=2)


def sizes(values: Array, parameters: Mapping[str, Parameter]) -> Array:
    """What parameters are measured in: their values, or their scales where those are larger, (p,)."""
    return np.array([max(abs(v), p.scale) for v, p in zip(values, parameters.values())])


def information(sensitivity: Array, noise: Array, repeats: float = 1.0) -> Array:
    """Fisher's information of relative changes under white noise, (p, p).

    Args:
        sensitivity: (channels, n, p). noise: standard deviation of each channel, (channels,).
        repeats: readings for each sample of the sensitivity, where that is thinned.
    """
    weighted = sensitivity / noise[:, None, None]
    flat = weighted.reshape(-1, sensitivity.shape[2])
    out: Array = repeats * flat.T @ flat
    return out


def without(matrix: Array, nuisance: int) -> Array:
    """Information about all but the last `nuisance` parameters, when those have to be estimated too (Schur's
    complement).
    """
    if not nuisance:
        return matrix
    a, b, c = matrix[:-nuisance, :-nuisance], matrix[:-nuisance, -nuisance:], matrix[-nuisance:, -nuisance:]
    out: Array = a - b @ np.linalg.pinv(c) @ b.T
    return out


def cost(matrix: Array, criterion: str) -> float:
    """What an optimal motion makes least: −½ log det (D), or ½ log of the trace of the covariance (A)."""
    values = np.maximum(np.linalg.eigvalsh(matrix), 1e-300)
    if criterion == "D":
        return float(-0.5 * np.sum(np.log(values)))
    if criterion == "A":
        return float(0.5 * np.log(np.sum(1.0 / values)))
    raise InputError(f"criterion '{criterion}'", f"one of {', '.join(CRITERIA)}", "choose one")


def intervals(matrix: Array, values: Array, parameters: Mapping[str, Parameter]) -> dict[str, Interval]:
    """95 % intervals from information of relative changes."""
    size = sizes(values, parameters)
    eigen, vectors = np.linalg.eigh(matrix)
    largest = float(eigen[-1]) if len(eigen) else 0.0
    known = eigen > OPEN * largest
    with np.errstate(divide="ignore"):
        variance = (vectors[:, known] ** 2 / eigen[known]).sum(axis=1)
    open_ = (vectors[:, ~known] ** 2).sum(axis=1) > 1e-6
    half = np.where(open_, np.inf, Z95 * np.sqrt(variance) * size)
    return {
        name: Interval(name, float(v), float(h), p.unit) for (name, p), v, h in zip(parameters.items(), values, half)
    }
