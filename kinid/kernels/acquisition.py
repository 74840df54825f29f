"""What electronics make of readings over time: lag and delay, within each run of samples without a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

#: steps of time that differ by this share are rounded differently
ALIKE = 1e-9


@kernel
def lag(x: Array, dt: Array, tau: float, out: Array) -> None:
    """First-order low-pass τ ẏ = x − y, exact for an input that runs between samples as that of `delay`; y begins in
    balance.

    Args:
        x: input, (k, n). dt: time since the sample before [s], 0 where memory begins anew, (n,).
        tau: time constant [s]; none is no lag. out: y, (k, n).
    """
    n = x.shape[1]
    g = h = f = 0.0  # steps to the sample before, to this one and to the next, 0 where there is none
    kept = between = before = after = 0.0
    for i in range(n):
        if i == 0 or dt[i] <= 0.0 or tau <= 0.0:
            for k in range(x.shape[0]):
                out[k, i] = x[k, i]
            continue
        g_now = max(dt[i - 1], 0.0) if i > 1 else 0.0
        f_now = max(dt[i + 1], 0.0) if i + 1 < n else 0.0
        if abs(g_now - g) + abs(dt[i] - h) + abs(f_now - f) > ALIKE * dt[i]:
            g, h, f = g_now, dt[i], f_now
            kept = np.exp(-h / tau)
            one, two, three = _driven(h / tau)
            between, before, after = _differences(
                3.0 * two - 2.0 * three, one - 2.0 * two + three, three - two, g, h, f
            )
        first, last = i - 2 if g > 0.0 else i - 1, i + 1 if f > 0.0 else i
        for k in range(x.shape[0]):
            a, b = x[k, i - 1], x[k, i]
            out[k, i] = (
                a
                + kept * (out[k, i - 1] - a)
                + (between * (b - a) + before * (a - x[k, first]) + after * (x[k, last] - b))
            )


@kernel
def _driven(r: float) -> tuple[float, float, float]:
    """What a low-pass makes of u, u² and u³ over a step of r time constants, u from 0 to 1: ∫ r exp(−r (1 − u)) uᵏ
    du.
    """
    if r > 0.1:
        one = 1.0 + np.expm1(-r) / r
        two = 1.0 - 2.0 * one / r
        return one, two, 1.0 - 3.0 * two / r
    one = two = three = 0.0
    # a series where the differences would cancel: Σ (−1)ʲ rʲ⁺¹ k! / (k + j + 1)!
    term = r
    for j in range(9):
        one += term / ((j + 1) * (j + 2))
        two += 2.0 * term / ((j + 1) * (j + 2) * (j + 3))
        three += 6.0 * term / ((j + 1) * (j + 2) * (j + 3) * (j + 4))
        term *= -r / (j + 1)
    return one, two, three


@kernel
def _differences(step: float, left: float, right: float, g: float, h: float, f: float) -> tuple[float, float, float]:
    """Of a course between two samples: what the differences between, before and behind them weigh, its slopes' shares
    included.

    Args:
        step, left, right: what the difference between the two weighs, and the slopes there, each times the time
        between. g, h, f: time before, between and behind them [s]; g and f 0 where there is no sample.
    """
    between = step + left * (g / (g + h) if g > 0.0 else 1.0) + right * (f / (f + h) if f > 0.0 else 1.0)
    before = left * h * h / (g * (g + h)) if g > 0.0 else 0.0
    after = right * h * h / (f * (f + h)) if f > 0.0 else 0.0
    return between, before, after


@kernel
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
            first, last = max(j - 1, start), min(j + 2, stop - 1)
            between, before, after = _differences(
                u * u * (3.0 - 2.0 * u), u * (1.0 - u) ** 2, u * u * (u - 1.0), t[j] - t[first], h, t[last] - t[j + 1]
            )
            for k in range(x.shape[0]):
                a, b = x[k, j], x[k, j + 1]
                out[k, i] = a + between * (b - a) + before * (a - x[k, first]) + after * (x[k, last] - b)
        start = stop


@kernel
def slopes(x: Array, dt: Array, tolerance: float, out: Array) -> None:
    """What x changes by in such a time, from the sample before to the one after; 0 where memory begins anew.

    Args:
        x: (k, n). dt: as in `lag`. tolerance: [s]. out: (k, n).
    """
    n = x.shape[1]
    for k in range(x.shape[0]):
        for i in range(n):
            out[k, i] = 0.0
            if i > 0 and dt[i] > 0.0:
                last = i + 1 if i + 1 < n and dt[i + 1] > 0.0 else i
                out[k, i] = tolerance * (x[k, last] - x[k, i - 1]) / (dt[i] + (dt[last] if last > i else 0.0))
