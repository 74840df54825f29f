"""What electronics make of readings over time: lag and delay, within each run of samples without a gap."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def lag(x: Array, dt: Array, tau: float, out: Array) -> None:
    """First-order low-pass τ ẏ = x − y, exact for an input that runs straight between samples; y begins in balance, at x.

    Args:
        x: input, (k, n). dt: time since the sample before [s], 0 where memory begins anew, (n,).
        tau: time constant [s]; none is no lag. out: y, (k, n).
    """
    for k in range(x.shape[0]):
        y = 0.0
        for i in range(x.shape[1]):
            if i == 0 or dt[i] <= 0.0 or tau <= 0.0:
                y = x[k, i]
            else:
                h = dt[i] / tau
                e = np.exp(-h)
                # ∫ of the straight line against the kernel; a series where the difference would cancel
                g = 1.0 - (1.0 - e) / h if h > 1e-5 else 0.5 * h - h * h / 6.0
                y = e * y + (1.0 - e - g) * x[k, i - 1] + g * x[k, i]
            out[k, i] = y


@njit(cache=True, nogil=True)
def delay(x: Array, t: Array, dt: Array, late: float, out: Array) -> None:
    """y(t) = x(t − late) by cubic Hermite interpolation, whose slopes at the samples are those of the parabola through
    three neighbours (Catmull-Rom on uneven times): y has a continuous derivative in `late`. Ends of runs are held.

    Args:
        x: input, (k, n). t: [s], (n,). dt: as in `lag`. late: [s], of either sign. out: y, (k, n).
    """
    n = x.shape[1]
    start = 0
    while start < n:
        stop = start + 1
        while stop < n and dt[stop] > 0.0:
            stop += 1
        j = start
        for i in range(start, stop):
            at = t[i] - late
            if at <= t[start] or stop - start == 1:
                for k in range(x.shape[0]):
                    out[k, i] = x[k, start]
                continue
            if at >= t[stop - 1]:
                for k in range(x.shape[0]):
                    out[k, i] = x[k, stop - 1]
                continue
            while t[j + 1] <= at:
                j += 1
            h = t[j + 1] - t[j]
            u = (at - t[j]) / h
            for k in range(x.shape[0]):
                a, b = x[k, j], x[k, j + 1]
                middle = (b - a) / h
                left = right = middle
                if j > start:
                    g = t[j] - t[j - 1]
                    left = (middle * g + (a - x[k, j - 1]) / g * h) / (g + h)
                if j + 2 < stop:
                    g = t[j + 2] - t[j + 1]
                    right = (middle * g + (x[k, j + 2] - b) / g * h) / (g + h)
                out[k, i] = a + u * (h * left + u * (3.0 * (b - a) - h * (2.0 * left + right)
                                                     + u * (2.0 * (a - b) + h * (left + right))))  # fmt: skip
        start = stop
