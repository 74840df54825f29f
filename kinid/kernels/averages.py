"""Means over neighbouring samples, weighted and laid end to end: what a search compares."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def weighted_means(readings: Array, begin: NDArray[np.int64], end: NDArray[np.int64], sigma: Array, out: Array) -> None:
    """Mean of each group of samples over its standard deviation, channel after channel.

    Args:
        readings: (channels, n). begin, end: samples of each group, (g,). sigma: of the means, (channels, g).
        out: (channels · g,).
    """
    g = begin.shape[0]
    for c in range(readings.shape[0]):
        for k in range(g):
            total = 0.0
            for i in range(begin[k], end[k]):
                total += readings[c, i]
            out[c * g + k] = total / ((end[k] - begin[k]) * sigma[c, k])
