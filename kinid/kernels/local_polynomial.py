"""Derivatives of a polynomial fitted around each sample: convolution where sampling is even, least squares
elsewhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

#: steps that differ from the period by less than this share of it are equal: it is the rounding of their difference
EXACT = 1e-6


@kernel
def _fit_at(t: Array, x: Array, low: int, high: int, at: int, order: int, first: Array, second: Array) -> None:
    """Least-squares polynomial over samples low…high (inclusive), derivatives at sample `at`.

    Orthogonal polynomials on these very times (Forsythe 1957) keep the fit well-conditioned without a matrix.
    """
    columns = x.shape[1]
    scale = max(t[high] - t[at], t[at] - t[low])
    count = high - low + 1
    p0, p1 = np.zeros(count), np.ones(count)  # values of the last two polynomials at the samples
    a0, a1, a2 = 0.0, 0.0, 0.0  # value, first and second derivative of the last but one, at `at`
    b0, b1, b2 = 1.0, 0.0, 0.0  # and of the last
    for j in range(columns):
        first[at, j] = 0.0
        second[at, j] = 0.0
    norm_before = 1.0
    for degree in range(order + 1):
        norm, mean = 0.0, 0.0
        for i in range(count):
            u = (t[low + i] - t[at]) / scale
            norm += p1[i] * p1[i]
            mean += u * p1[i] * p1[i]
        mean /= norm
        for j in range(columns):
            dot = 0.0
            for i in range(count):
                dot += p1[i] * x[low + i, j]
            dot /= norm
            first[at, j] += dot * b1
            second[at, j] += dot * b2
        if degree == order:
            break
        ratio = norm / norm_before if degree > 0 else 0.0
        for i in range(count):
            u = (t[low + i] - t[at]) / scale
            p0[i], p1[i] = p1[i], (u - mean) * p1[i] - ratio * p0[i]
        # (u − mean) p − ratio p₋₁ and its derivatives at u = 0
        c0 = -mean * b0 - ratio * a0
        c1 = b0 - mean * b1 - ratio * a1
        c2 = 2.0 * b1 - mean * b2 - ratio * a2
        a0, a1, a2, b0, b1, b2 = b0, b1, b2, c0, c1, c2
        norm_before = norm
    for j in range(columns):
        first[at, j] /= scale
        second[at, j] /= scale * scale


@kernel(fastmath={"contract", "nsz"})
def _convolve(
    flat: Array, columns: int, taps: Array, start: int, stop: int, half: int, first: Array, second: Array
) -> None:
    """Both derivatives of rows start…stop by convolution of the flattened (n, columns) array.

    The first derivative's taps are odd and the second's even in time, so that pairs of samples share a multiplication.
    """
    size = 512
    for begin in range(start * columns, stop * columns, size):
        count = min(size, stop * columns - begin)
        # views that start at 0, so that no index can be negative and the loops compile to SIMD instructions
        one, two, now = first[begin : begin + count], second[begin : begin + count], flat[begin : begin + count]
        for i in range(count):
            one[i] = 0.0
            two[i] = taps[1, half] * now[i]
        for k in range(1, half + 1):
            odd, even, reach = taps[0, half + k], taps[1, half + k], k * columns
            ahead, behind = flat[begin + reach : begin + count + reach], flat[begin - reach : begin + count - reach]
            for i in range(count):
                one[i] += odd * (ahead[i] - behind[i])
                two[i] += even * (ahead[i] + behind[i])


@kernel(fastmath={"contract", "nsz"})  # a sum of times in another order would round off the jitter
def _chain_rule(
    t: Array, period: float, taps: Array, start: int, stop: int, half: int, first: Array, second: Array
) -> None:
    """Turn derivatives by the sample's number (times the period) into derivatives by the actual time.

    With s the nominal and t the actual time, ẋ = x' / t' and ẍ = (x'' − ẋ t'') / t'². The jitter of t stands in x and
    in t alike, so that it falls out to first order.
    """
    size = 512
    rate, change = np.empty(size), np.empty(size)
    for begin in range(start, stop, size):
        count = min(size, stop - begin)
        rate[:count] = 1.0
        change[:count] = 0.0
        now = t[begin : begin + count]
        for k in range(1, half + 1):
            odd, even = taps[0, half + k], taps[1, half + k]
            ahead, behind = t[begin + k : begin + count + k], t[begin - k : begin + count - k]
            for i in range(count):
                rate[i] += odd * ((ahead[i] - behind[i]) - 2.0 * k * period)
                change[i] += even * ((ahead[i] - now[i]) - (now[i] - behind[i]))
        for i in range(count):
            for j in range(first.shape[1]):
                first[begin + i, j] /= rate[i]
                second[begin + i, j] = (second[begin + i, j] - first[begin + i, j] * change[i]) / (rate[i] * rate[i])


@kernel
def _along(
    t: Array,
    x: Array,
    taps: Array,
    uneven: bool,
    period: float,
    start: int,
    stop: int,
    half: int,
    first: Array,
    second: Array,
) -> None:
    """Rows start…stop by convolution, and by the chain rule where steps differ at all."""
    _convolve(x.ravel(), x.shape[1], taps, start, stop, half, first.ravel(), second.ravel())
    if uneven:
        _chain_rule(t, period, taps, start, stop, half, first, second)


@kernel
def differentiate(
    t: Array, x: Array, half: int, order: int, taps: Array, tolerance: float, period: float, first: Array, second: Array
) -> None:
    """Fill `first` and `second` (n, k) with derivatives of `x` (n, k) over `t` [s].

    Args:
        t: times [s], (n,), of one piece without gaps.
        x: samples, (n, k), contiguous.
        half: samples on each side of an instant; at the ends of the piece the window keeps its width and moves inward.
        order: degree of the polynomial.
        taps: convolution for even sampling, (2, 2·half + 1), or (2, 0) where only the general fit applies.
        tolerance: how far a time step may be from the period [s] to count as even.
        period: median time between samples [s].
        first, second: results, (n, k), contiguous.
    """
    n = x.shape[0]
    uneven = False  # among the steps that count as even
    for i in range(1, n):
        off = abs(t[i] - t[i - 1] - period)
        uneven = uneven or EXACT * period < off <= tolerance
    run = 0  # even steps in a row that end at sample i
    even_from = -1
    for i in range(n):
        if i > 0 and abs(t[i] - t[i - 1] - period) <= tolerance:
            run += 1
        else:
            run = 0
        centre = i - half
        if taps.shape[1] > 0 and run >= 2 * half and centre >= half:
            if even_from < 0:
                even_from = centre
            if i < n - 1:
                continue
            _along(t, x, taps, uneven, period, even_from, centre + 1, half, first, second)
            even_from = -1
        else:
            if even_from >= 0:
                _along(t, x, taps, uneven, period, even_from, centre, half, first, second)
                even_from = -1
            if centre >= 0:
                low = max(0, min(centre - half, n - 1 - 2 * half))
                high = min(n - 1, low + max(2 * half, order))
                _fit_at(t, x, max(0, high - max(2 * half, order)), high, centre, order, first, second)
    for centre in range(max(0, n - half), n):
        high = n - 1
        _fit_at(t, x, max(0, high - max(2 * half, order)), high, centre, order, first, second)
