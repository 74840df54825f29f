"""What a tool does at a time: how deep, in or out, and which way along the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: a tool moves where it is faster than this share of its usual greatest speed
MOVES = 0.1


def kinds_of_motion(depth: Array, depth_rate: Array, slip_rate: Array) -> NDArray[np.int64]:
    """Number of the kind of motion of each sample, (n,), without holes.

    Samples are alike where they share a third of the depths (or the air), in or out or neither, and the tangent that the slip
    goes along, which way, or none.

    Args:
        depth: > 0 in the material [m], (1, n). depth_rate: [m/s], (1, n). slip_rate: along both tangents [m/s], (2, n).
    """
    inside = depth[0] > 0.0
    edges = np.quantile(depth[0, inside], [1 / 3, 2 / 3]) if inside.any() else np.zeros(0)
    level = np.where(inside, 1 + np.searchsorted(edges, depth[0]), 0)
    along = np.argmax(np.abs(slip_rate), axis=0)
    way = np.take_along_axis(_sign(slip_rate), along[None], axis=0)[0]
    kinds = np.stack([level, _sign(depth_rate)[0], along * (way != 0.0), way])
    return np.asarray(np.unique(kinds, axis=1, return_inverse=True)[1].reshape(-1), np.int64)


def _sign(rate: Array) -> Array:
    """1 and −1 where a rate (k, n) is fast, 0 where it is next to none."""
    return np.asarray(np.sign(rate) * (np.abs(rate) > MOVES * np.quantile(np.abs(rate), 0.95, axis=1, keepdims=True)))
