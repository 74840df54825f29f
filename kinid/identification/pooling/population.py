"""A parameter that differs from log to log as a normal population does: how widely, learnt from all logs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from kinid.identification.pooling.normals import Normals
from kinid.identification.pooling.sharing import Directions

Array = NDArray[np.float64]

#: a spread is looked for down to this share of what a log tells a value to, and up to so many times the values' own
NARROWEST, WIDEST = 1e-2, 10.0


@dataclass(frozen=True)
class Population:
    """A normal population of one parameter: its standard deviation between logs and the standard error of that, in
    scales.
    """

    spread: float
    error: float


def log_alone(normals: Normals, at: Directions, own_prior: Array, own: Array, place: int) -> tuple[float, float]:
    """What one log alone says of one of its own directions, all others of its own free: deviation and variance, in
    scales.

    Args:
        normals: of the log, at its place. at: its directions. own_prior: precision of its own, (o, o), that of the
            population included. own: where they are, (o,). place: which of them is meant.
    """
    o = at.own
    rest = np.arange(len(o)) != place
    h = normals.squares[np.ix_(o, o)] + own_prior
    b = normals.slope[o] - own_prior @ own
    h[place, place] -= own_prior[place, place]
    b[place] += own_prior[place, place] * own[place]
    cross = h[place, rest]
    solved = np.linalg.solve(h[np.ix_(rest, rest)], np.column_stack([cross, b[rest]])) if rest.any() else None
    information = h[place, place] - (0.0 if solved is None else float(cross @ solved[:, 0]))
    slope = b[place] - (0.0 if solved is None else float(cross @ solved[:, 1]))
    information = max(information, 1e-12)
    return own[place] + slope / information, normals.inflation / information


def learn_population(deviations: Array, variances: Array) -> Population:
    """The spread under which deviations with these variances are most likely, their mean unknown.

    Restricted maximum likelihood (H. D. Patterson, R. Thompson, Biometrika 58, 1971).

    Args:
        deviations: of each log, in scales, (n,). variances: of these, (n,).
    """
    low = NARROWEST * float(np.sqrt(np.min(variances)))
    high = max(10.0 * low, WIDEST * float(np.ptp(deviations)))

    def unlikely(log_spread: float) -> float:
        v = variances + np.exp(2.0 * log_spread)
        mean = np.sum(deviations / v) / np.sum(1.0 / v)
        return float(np.sum(np.log(v)) + np.log(np.sum(1.0 / v)) + np.sum((deviations - mean) ** 2 / v))

    found = minimize_scalar(unlikely, bounds=(np.log(low), np.log(high)), method="bounded")
    spread = float(np.exp(found.x))
    # Fisher's information about a variance is ½ Σ (τ² + v)⁻²; of its root, 4 τ² times that
    known = 2.0 * spread**2 * float(np.sum((spread**2 + variances) ** -2))
    return Population(spread, float(known**-0.5))
