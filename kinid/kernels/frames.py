"""Forces from one frame to another, for all samples of a log."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def contact_wrench(tangential: Array, normal: Array, axes: Array, tip: Array, load: Array, out: Array) -> None:
    """Wrench at the sensor's origin, in its axes: f = Rᵀ (T₁, T₂, N), τ = r × f, and the tool's load.

    Args:
        tangential: (2, n) [N]. normal: (n,) [N]. axes: R, from sensor to contact axes, (n, 3, 3). tip: r, (3,) [m].
        load: (6, n) [N, N·m]. out: (6, n).
    """
    for i in range(normal.shape[0]):
        a, b, c = tangential[0, i], tangential[1, i], normal[i]
        x = axes[i, 0, 0] * a + axes[i, 1, 0] * b + axes[i, 2, 0] * c
        y = axes[i, 0, 1] * a + axes[i, 1, 1] * b + axes[i, 2, 1] * c
        z = axes[i, 0, 2] * a + axes[i, 1, 2] * b + axes[i, 2, 2] * c
        out[0, i] = x + load[0, i]
        out[1, i] = y + load[1, i]
        out[2, i] = z + load[2, i]
        out[3, i] = tip[1] * z - tip[2] * y + load[3, i]
        out[4, i] = tip[2] * x - tip[0] * z + load[4, i]
        out[5, i] = tip[0] * y - tip[1] * x + load[5, i]
