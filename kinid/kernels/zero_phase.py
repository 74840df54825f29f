"""Filters that leave nothing late: forwards and backwards over readings, or symmetric."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]


#: samples that are worked on at once, within a first-level cache
BLOCK = 256
#: samples beyond each end: those of `scipy.signal.sosfiltfilt` for two sections
BEYOND = 15


@kernel
def zero_phase(sections: Array, settled: Array, x: Array) -> None:
    """Two second-order sections forwards, then backwards, over readings that go on beyond their ends, mirrored in them;
    in place.

    It does what `scipy.signal.sosfiltfilt` does (F. Gustafsson, IEEE Trans. Signal Process. 44(4), 1996), which would
    work out anew for each of many thousand short calls what the filter remembers of a step. A filter waits for its own
    last result; two rows that are filtered side by side wait together.

    Args:
        sections: b₀ b₁ b₂ 1 a₁ a₂ of two, (2, 6). settled: memory of each that has settled on a step of 1, (2, 2).
        x: (rows, n), n > `BEYOND`.
    """
    rows, n = x.shape
    padded = np.empty((2, n + 2 * BEYOND))
    for first in range(0, rows, 2):
        two = x[first : first + 2]
        for k in range(2):
            row = two[min(k, two.shape[0] - 1)]  # a last one without a second is filtered twice
            for i in range(BEYOND):
                padded[k, i] = 2.0 * row[0] - row[BEYOND - i]
                padded[k, BEYOND + n + i] = 2.0 * row[n - 1] - row[n - 2 - i]
            for i in range(n):
                padded[k, BEYOND + i] = row[i]
        _pass(sections, settled, padded[0], padded[1])
        _pass(sections, settled, padded[0, ::-1], padded[1, ::-1])
        for k in range(two.shape[0]):
            for i in range(n):
                two[k, i] = padded[k, BEYOND + i]


@kernel
def _pass(sections: Array, settled: Array, row: Array, other: Array) -> None:
    """Both sections over two rows (m,), in place; what they remember stays in registers."""
    a0, a1, a2, a3, a4 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    b0, b1, b2, b3, b4 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    p0, q0, r0, s0 = settled[0, 0] * row[0], settled[0, 1] * row[0], settled[1, 0] * row[0], settled[1, 1] * row[0]
    p1, q1, r1, s1 = (
        settled[0, 0] * other[0],
        settled[0, 1] * other[0],
        settled[1, 0] * other[0],
        settled[1, 1] * other[0],
    )
    for i in range(row.shape[0]):
        x0, x1 = row[i], other[i]
        y0, y1 = a0 * x0 + p0, a0 * x1 + p1
        p0, p1 = a1 * x0 + q0 - a3 * y0, a1 * x1 + q1 - a3 * y1
        q0, q1 = a2 * x0 - a4 * y0, a2 * x1 - a4 * y1
        z0, z1 = b0 * y0 + r0, b0 * y1 + r1
        r0, r1 = b1 * y0 + s0 - b3 * z0, b1 * y1 + s1 - b3 * z1
        s0, s1 = b2 * y0 - b4 * z0, b2 * y1 - b4 * z1
        row[i], other[i] = z0, z1


@kernel(fastmath={"contract", "nsz"})
def symmetric(weights: Array, edges: NDArray[np.int64], x: Array, out: Array) -> None:
    """Weighted mean over neighbours on both sides, piece by piece; beyond its ends a piece stays at their values.

    It does what `scipy.ndimage.correlate1d` does with a symmetric window, in loops that compile to SIMD instructions.

    Args:
        weights: of a sample itself and of its neighbours, (r + 1,). edges: where pieces begin, and the end, (k + 1,).
        x: (rows, n). out: (rows, n).
    """
    r = len(weights) - 1
    padded = np.empty(x.shape[1] + 2 * r)
    for row in range(x.shape[0]):
        for begin, end in zip(edges[:-1], edges[1:]):
            n = end - begin
            if n < 1:
                continue
            padded[:r] = x[row, begin]
            padded[r : r + n] = x[row, begin:end]
            padded[r + n : n + 2 * r] = x[row, end - 1]
            for first in range(0, n, BLOCK):
                last = min(n, first + BLOCK)
                to, own = out[row, begin + first : begin + last], padded[r + first : r + last]
                for i in range(last - first):
                    to[i] = weights[0] * own[i]
                for k in range(1, r + 1):
                    before, after = padded[r + first - k : r + last - k], padded[r + first + k : r + last + k]
                    for i in range(last - first):
                        to[i] += weights[k] * (before[i] + after[i])
