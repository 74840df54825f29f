"""Velocity and acceleration inside a loop: differences through first-order low-passes, nothing from the future."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def advance(q: Array, columns: NDArray[np.int64], dt: float, cutoff: float, motion: Array) -> None:
    """Take in one sample of joint positions.

    Args:
        q: positions, (N,), in the log's order. columns: of the chain's joints in it, (N,).
        dt: time since the last sample [s]; not positive for the first one, which starts at rest.
        cutoff: of both low-passes [rad/s].
        motion: position, velocity, acceleration of the last sample, (3, 1, N); replaced.
    """
    gain = cutoff * dt / (1.0 + cutoff * dt)
    for j in range(columns.shape[0]):
        new = q[columns[j]]
        if dt > 0.0:
            before = motion[1, 0, j]
            motion[1, 0, j] += gain * ((new - motion[0, 0, j]) / dt - before)
            motion[2, 0, j] += gain * ((motion[1, 0, j] - before) / dt - motion[2, 0, j])
        else:
            motion[1, 0, j] = 0.0
            motion[2, 0, j] = 0.0
        motion[0, 0, j] = new
