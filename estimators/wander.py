"""Noise that wanders: how much of a residual's slow part is a random walk, as a strain-gauge sensor's zero is.

An autoregression of a few lags at the log's rate sees white and coloured noise, but not a zero that creeps by
millinewtons in seconds: that hides under white noise a hundred times larger, and still decides how well a mean is
known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: the residual is looked at in so many stretches at most, and at least; each of so many samples at least
MOST_BLOCKS, FEWEST_BLOCKS, SHORTEST = 64, 12, 16
#: by how much a walk must make the residual likelier, as a logarithm. Where a walk hides, asking for more makes
#: intervals too narrow; asking for nothing makes those of logs without one too wide
EVIDENCE = 0.7
#: variance of the walk over the whole log, relative to that of a stretch's mean, that is tried
_TRIED = np.concatenate([[0.0], np.geomspace(1e-3, 1e5, 161)])


def walk_variance(residual: Array, sensitivity: Array, coefficients: Array, variance: float) -> float:
    """Variance that a random walk gains from one sample to the next, beside an autoregression; 0 where none shows.

    From the residual's means over stretches of the log, by their restricted likelihood: what the fit's parameters could
    have taken up is projected out (H. D. Patterson, R. Thompson, Biometrika 58, 1971; local level model: A. C. Harvey,
    Forecasting, Structural Time Series Models and the Kalman Filter, 1989).

    Args:
        residual: of one channel, NaN where it doesn't count, (n,). sensitivity: of the same channel to the parameters,
            in any basis, (n, k). coefficients, variance: of the residual's autoregression.
    """
    rows = np.flatnonzero(np.isfinite(residual))
    blocks = min(MOST_BLOCKS, len(rows) // SHORTEST)
    if blocks < FEWEST_BLOCKS or variance <= 0.0:
        return 0.0
    # as many samples in each, wherever they lie
    edges = (np.arange(blocks) * len(rows)) // blocks
    count = np.diff(np.append(edges, len(rows))).astype(float)
    level, at = (np.add.reduceat(values, edges) / count for values in (residual[rows], rows.astype(float)))
    known = np.add.reduceat(sensitivity[rows], edges, axis=0) / count[:, None]
    # an autoregression's means have the variance of its spectrum at zero; those of a unit walk share the way before
    # them
    own = variance / (1.0 - float(coefficients.sum())) ** 2 / count
    walked = np.minimum.outer(at, at) - np.diag(count / 6.0)
    scale = 1.0 / np.sqrt(own)
    left, singular, _ = np.linalg.svd(known * scale[:, None], full_matrices=True)
    rank = int((singular > 1e-9 * max(float(singular.max(initial=0.0)), 1e-300)).sum())
    free = left[:, rank:]
    if free.shape[1] < FEWEST_BLOCKS // 2:
        return 0.0
    share, turn = np.linalg.eigh(free.T @ (walked * np.outer(scale, scale)) @ free)
    share = np.maximum(share, 0.0)
    power = (turn.T @ (free.T @ (level * scale))) ** 2
    tried = _TRIED / max(float(share.max()), 1e-300)
    spread = 1.0 + np.outer(tried, share)
    # the autoregression took a part of the walk for its own: how much of it stays is free
    level2 = (power / spread).mean(axis=1)
    likelihood = -0.5 * (np.log(spread).sum(axis=1) + len(power) * np.log(np.maximum(level2, 1e-300)))
    if likelihood.max() - likelihood[0] < EVIDENCE:
        return 0.0
    # few stretches tell of a slow walk, and its most likely variance is as often too small as too large; the mean over
    # what is likely, of all orders of magnitude alike, knows that
    likely = np.exp(likelihood[1:] - likelihood.max())
    return float((likely * tried[1:] * level2[1:]).sum() / likely.sum())


def walk_scatter(residual: Array, sensitivity: Array, coefficients: Array, variance: float) -> Array:
    """What a residual's walk adds to the scatter of its moments with the sensitivity, (k, k); arguments as above."""
    onwards = np.cumsum(sensitivity[::-1], axis=0)  # a walk's step reaches every later sample
    return np.asarray(walk_variance(residual, sensitivity, coefficients, variance) * onwards.T @ onwards)
