"""Means over neighbouring samples, weighted and laid end to end: what a search compares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]


@kernel
def weighted_sums(readings: Array, begin: NDArray[np.int64], end: NDArray[np.int64], weight: Array, out: Array) -> None:
    """Sum of each group of samples times its weight, channel after channel.

    Args:
        readings: (channels, n). begin, end: samples of each group, (g,). weight: (channels, g). out: (channels · g,).
    """
    g = begin.shape[0]
    for c in range(readings.shape[0]):
        x, w, o = readings[c], weight[c], out[c * g : (c + 1) * g]
        for k in range(g):
            i = begin[k]
            total = x[i]
            for j in range(i + 1, end[k]):
                total += x[j]
            o[k] = w[k] * total


@kernel
def weighted_changes(
    after: Array,
    before: Array,
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
    weight: Array,
    factor: float,
    out: Array,
) -> None:
    """A factor times the weighted sums of what readings changed by; arguments as those of `weighted_sums`."""
    g = begin.shape[0]
    for c in range(after.shape[0]):
        x, y, w, o = after[c], before[c], weight[c], out[c * g : (c + 1) * g]
        for k in range(g):
            i = begin[k]
            if end[k] - i == 2:  # by far the most; a loop takes as long again
                total = (x[i] - y[i]) + (x[i + 1] - y[i + 1])
            else:
                total = x[i] - y[i]
                for j in range(i + 1, end[k]):
                    total += x[j] - y[j]
            o[k] = factor * w[k] * total
