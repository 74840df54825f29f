"""A filter forwards and backwards over readings, so that nothing is late."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def zero_phase(sections: Array, settled: Array, x: Array, beyond: int, out: Array) -> None:
    """Two second-order sections forwards, then backwards, over rows that go on beyond their ends, mirrored in them.

    It does what `scipy.signal.sosfiltfilt` does (F. Gustafsson, IEEE Trans. Signal Process. 44(4), 1996), which would work out
    anew for each of many thousand short calls what the filter remembers of a step.

    Args:
        sections: b₀ b₁ b₂ 1 a₁ a₂ of two, (2, 6). settled: memory of each that has settled on a step of 1, (2, 2).
        x: (k, n), n > `beyond`. beyond: so many samples at each end. out: (k, n); may be `x`.
    """
    n = x.shape[1]
    row = np.empty(n + 2 * beyond)
    for k in range(x.shape[0]):
        for i in range(beyond):
            row[i] = 2.0 * x[k, 0] - x[k, beyond - i]
            row[beyond + n + i] = 2.0 * x[k, n - 1] - x[k, n - 2 - i]
        row[beyond : beyond + n] = x[k]
        _pass(sections, settled, row)
        _pass(sections, settled, row[::-1])
        out[k] = row[beyond : beyond + n]


@njit(cache=True, nogil=True)
def _pass(sections: Array, settled: Array, row: Array) -> None:
    """Both sections over a row (m,), in place; what they remember stays in registers."""
    a0, a1, a2, a3, a4 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    b0, b1, b2, b3, b4 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    p, q, r, s = settled[0, 0] * row[0], settled[0, 1] * row[0], settled[1, 0] * row[0], settled[1, 1] * row[0]
    for i in range(row.shape[0]):
        x = row[i]
        y = a0 * x + p
        p = a1 * x - a3 * y + q
        q = a2 * x - a4 * y
        z = b0 * y + r
        r = b1 * y - b3 * z + s
        s = b2 * y - b4 * z
        row[i] = z
