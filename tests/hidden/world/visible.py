"""How much of an effect a starting model can't absorb, as a multiple of the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def visible(change: Array, absorbed: Sequence[Array], noise: Array) -> float:
    """Rms of a change of the readings relative to the noise, less what columns of the starting model can follow.

    Args:
        change: of the readings, (n, k). absorbed: columns, each (n, k). noise: of each channel, (k,).
    """
    weight = 1.0 / noise
    y = (change * weight)[::5].ravel()
    if absorbed:
        a = np.stack([(column * weight)[::5].ravel() for column in absorbed], axis=1)
        a = a[:, np.abs(a).max(axis=0) > 0]
        if a.shape[1]:
            a = a / np.linalg.norm(a, axis=0)
            y = y - a @ np.linalg.lstsq(a, y, rcond=1e-10)[0]
    return float(np.sqrt(np.mean(y**2)))


def only(k: int, channel: int, values: Array) -> Array:
    """Values in one of k channels, zero in the others, (n, k)."""
    out = np.zeros((len(values), k))
    out[:, channel] = values
    return out
