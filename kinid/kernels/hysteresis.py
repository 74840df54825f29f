"""Flags with two thresholds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]


@kernel
def contact_flag(signal: Array, depth: Array, on: float, off: float, reach: float, out: NDArray[np.bool_]) -> None:
    """True from where `signal` rises above `on` until it falls below `off`, only at depths above −`reach`.

    A sample that is not a number is not in contact, and the flag starts anew after it. All arrays (n,).
    """
    touching = False
    for i in range(signal.shape[0]):
        if not (np.isfinite(signal[i]) and depth[i] > -reach):
            touching = False
        elif touching:
            touching = signal[i] >= off
        else:
            touching = signal[i] > on
        out[i] = touching


@kernel
def steady_flag(
    signal: Array, depth: Array, on: float, off: float, reach: float, half: int, out: NDArray[np.bool_]
) -> None:
    """True on runs of samples above `off` that reach `on` somewhere; the same forward and backward in time.

    A run is sought in the mean of the signal over `half` samples on each side, and its ends are then those of the
    signal itself, so that noise splits no run and smears no edge. A sample that is not a number, or at a depth below
    −`reach`, belongs to no run. All arrays (n,).
    """
    n = signal.shape[0]
    start, reached = -1, False
    for i in range(n + 1):
        mean = -np.inf
        if i < n and np.isfinite(signal[i]) and depth[i] > -reach:
            total, count = 0.0, 0
            for j in range(max(0, i - half), min(n, i + half + 1)):
                if np.isfinite(signal[j]):
                    total += signal[j]
                    count += 1
            mean = total / count
        if i < n:
            out[i] = False
        if mean > off:
            if start < 0:
                start, reached = i, False
            reached = reached or mean > on
        elif start >= 0:
            first, last = start, i - 1
            while first < last and signal[first] <= off:
                first += 1
            while last > first and signal[last] <= off:
                last -= 1
            for j in range(first, last + 1):
                out[j] = reached
            start = -1
