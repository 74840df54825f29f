"""A filter forwards and backwards over readings, so that nothing is late."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


#: samples beyond each end: those of `scipy.signal.sosfiltfilt` for two sections
BEYOND = 15


@njit(cache=True, nogil=True)
def zero_phase(sections: Array, settled: Array, x: Array) -> None:
    """Two second-order sections forwards, then backwards, over readings that go on beyond their ends, mirrored in them; in place.

    It does what `scipy.signal.sosfiltfilt` does (F. Gustafsson, IEEE Trans. Signal Process. 44(4), 1996), which would work out
    anew for each of many thousand short calls what the filter remembers of a step.

    Args:
        sections: b₀ b₁ b₂ 1 a₁ a₂ of two, (2, 6). settled: memory of each that has settled on a step of 1, (2, 2).
        x: (n,), n > `BEYOND`.
    """
    n = x.shape[0]
    row = np.empty(n + 2 * BEYOND)
    for i in range(BEYOND):
        row[i] = 2.0 * x[0] - x[BEYOND - i]
        row[BEYOND + n + i] = 2.0 * x[n - 1] - x[n - 2 - i]
    row[BEYOND : BEYOND + n] = x
    _pass(sections, settled, row)
    _pass(sections, settled, row[::-1])
    x[:] = row[BEYOND : BEYOND + n]


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
