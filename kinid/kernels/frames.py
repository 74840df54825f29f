"""Forces and motion from one frame to another, for all samples of a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]


@kernel
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


@kernel
def point_load(specific: Array, omega: Array, alpha: Array, com: Array, out: Array) -> None:
    """Wrench at the sensor's origin of 1 kg at a point c of its frame: f = g − a − α × c − ω × (ω × c), τ = c × f.

    Args:
        specific: g − a [m/s²], (3, n). omega: [rad/s], (3, n). alpha: [rad/s²], (3, n). com: c [m], (3,).
        out: [N/kg, N·m/kg], (6, n).
    """
    x, y, z = com[0], com[1], com[2]
    for i in range(specific.shape[1]):
        p, q, r = omega[0, i], omega[1, i], omega[2, i]
        u, v, w = q * z - r * y, r * x - p * z, p * y - q * x
        a = specific[0, i] - (alpha[1, i] * z - alpha[2, i] * y) - (q * w - r * v)
        b = specific[1, i] - (alpha[2, i] * x - alpha[0, i] * z) - (r * u - p * w)
        c = specific[2, i] - (alpha[0, i] * y - alpha[1, i] * x) - (p * v - q * u)
        out[0, i], out[1, i], out[2, i] = a, b, c
        out[3, i], out[4, i], out[5, i] = y * c - z * b, z * a - x * c, x * b - y * a


@kernel
def displaced(axes: Array, omega: Array, offset: Array, moved: Array, speed: Array) -> None:
    """Where a point of the sensor frame is from its origin, and how fast it moves about it, in contact axes: R d, R (ω
    × d).

    Args:
        axes: R, from sensor to contact axes, (n, 3, 3). omega: in sensor axes [rad/s], (3, n). offset: d, (3,) [m].
        moved: (3, n) [m]. speed: (3, n) [m/s].
    """
    x, y, z = offset[0], offset[1], offset[2]
    for i in range(axes.shape[0]):
        p, q, r = omega[0, i], omega[1, i], omega[2, i]
        u, v, w = q * z - r * y, r * x - p * z, p * y - q * x
        for k in range(3):
            moved[k, i] = axes[i, k, 0] * x + axes[i, k, 1] * y + axes[i, k, 2] * z
            speed[k, i] = axes[i, k, 0] * u + axes[i, k, 1] * v + axes[i, k, 2] * w
