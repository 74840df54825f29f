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
    many = x.shape[0]
    for i in range(x.shape[1]):
        if i > 0 and dt[i] > 0.0 and tau > 0.0:
            h = dt[i] / tau
            e = np.exp(-h)
            # ∫ of the straight line against the kernel; a series where the difference would cancel
            g = 1.0 - (1.0 - e) / h if h > 1e-5 else 0.5 * h - h * h / 6.0
            f = 1.0 - e - g
            for k in range(many):
                out[k, i] = e * out[k, i - 1] + (f * x[k, i - 1] + g * x[k, i])
        else:
            for k in range(many):
                out[k, i] = x[k, i]


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
            # what the differences to, between and behind the two neighbours weigh: the slopes' shares in them included
            left, right = u * (1.0 - u) ** 2, u * u * (u - 1.0)
            between, before, after = u * u * (3.0 - 2.0 * u), 0.0, 0.0
            first, last = j, j + 1
            if j > start:
                g = t[j] - t[j - 1]
                between += left * g / (g + h)
                before, first = left * h * h / (g * (g + h)), j - 1
            else:
                between += left
            if j + 2 < stop:
                g = t[j + 2] - t[j + 1]
                between += right * g / (g + h)
                after, last = right * h * h / (g * (g + h)), j + 2
            else:
                between += right
            for k in range(x.shape[0]):
                a, b = x[k, j], x[k, j + 1]
                out[k, i] = a + between * (b - a) + before * (a - x[k, first]) + after * (x[k, last] - b)
        start = stop
