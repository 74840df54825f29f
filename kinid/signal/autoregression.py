"""Coloured noise as an autoregression."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: the noise model is an autoregression of at most this order
MAX_ORDER = 24


def autoregression(residual: Array, runs: Sequence[slice] | None = None) -> tuple[Array, float]:
    """Coefficients (order,) and innovation variance of the autoregression that a residual (n,) calls for.

    Yule-Walker estimates from autocovariances over finite pairs of samples within runs (Levinson 1946); the order is
    the one with the least Bayesian information criterion (Schwarz 1978). Samples that are NaN break no run.
    """
    runs = runs or [slice(0, len(residual))]
    finite = np.isfinite(residual)
    filled = np.where(finite, residual, 0.0)
    total = max(1, int(finite.sum()))
    longest = max(run.stop - run.start for run in runs)
    most = int(min(MAX_ORDER, total // 20, longest - 1))
    gamma = np.zeros(most + 1)
    for run in runs:
        x = filled[run]
        for lag in range(min(most + 1, len(x))):
            gamma[lag] += x[lag:] @ x[: len(x) - lag]
    gamma /= total
    if gamma[0] <= 0:
        return np.zeros(0), 0.0
    best, coefficients, variance = (total * np.log(gamma[0]), np.zeros(0), float(gamma[0]))
    a, v = np.zeros(0), float(gamma[0])
    for order in range(1, most + 1):
        reflection = (gamma[order] - a @ gamma[order - 1 : 0 : -1]) / v if order > 1 else gamma[1] / v
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        v *= 1.0 - reflection**2
        if v <= 1e-12 * gamma[0]:
            break
        score = total * np.log(v) + order * np.log(total)
        if score < best:
            best, coefficients, variance = score, a.copy(), float(v)
    return coefficients, variance
