"""A bank of Kalman filters against filters of matrices, once its gains have settled and while they move."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from kinid.kernels import intensity

Array = NDArray[np.float64]
ORDER = 4


def plain(tau: Array, y: Array, noise: Array, level: float, start: Array, spread: Array) -> Array:
    """Log-likelihood of each position by textbook matrices, less a constant, (n,)."""
    x, p, out = start.copy(), spread.copy(), np.empty(len(y))
    for t, h in enumerate(tau):
        move = np.array(
            [[h ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(ORDER)] for i in range(ORDER)]
        )
        to_end = [h ** (ORDER - 1 - i) / math.factorial(ORDER - 1 - i) for i in range(ORDER)]
        added = np.array(
            [[to_end[i] * to_end[j] * h / (2 * ORDER - 1 - i - j) for j in range(ORDER)] for i in range(ORDER)]
        )
        x, p = move @ x, move @ p @ move.T + level * added
        variance = p[0, 0] + noise[t]
        out[t] = norm.logpdf(y[t], x[0], variance**0.5)
        gain = p[:, 0] / variance
        x = x + gain * (y[t] - x[0])
        keep = np.eye(ORDER)
        keep[:, 0] -= gain
        p = keep @ p @ keep.T + noise[t] * np.outer(gain, gain)
    return out + 0.5 * math.log(2 * math.pi)


@pytest.mark.parametrize("uneven", ["nothing", "steps", "noise", "late"])
def test_bank_is_filters_of_matrices(uneven: str) -> None:
    n, rng = 1500, np.random.default_rng(3)
    tau, noise = np.ones(n), np.full(n, 1e-4)
    tau[0] = 0.0
    if uneven == "steps":
        tau[1:] += 0.1 * rng.random(n - 1)
    if uneven == "noise":
        noise *= 1.0 + rng.random(n)
    if uneven == "late":  # gains that have settled must move again
        tau[1200], noise[1300:] = 3.0, 4e-4
    y = np.sin(0.01 * np.cumsum(tau)) + 1e-2 * rng.standard_normal(n)
    # from a motion that hardly bends to one that follows every reading; slower ones have not settled by then
    levels = 1e-4 * 2.0 ** (8 * np.array([-6.0, -4.0, -2.0, 0.0, 2.0]))
    start, spread = np.array([y[0], 0.0, 0.0, 0.0]), np.diag([1e-2, 1e-2, 1e-4, 1e-6])
    out = np.empty((n, len(levels)), np.float32)
    intensity.bank(tau, y, noise, levels, start, spread, out)
    for j, level in enumerate(levels):
        # single precision of numbers up to some hundred
        np.testing.assert_allclose(out[:, j], plain(tau, y, noise, level, start, spread), rtol=2e-5, atol=1e-4)
