"""What a tool does at a time: how deep it is, whether it goes in or out, and which way along the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: a tool moves where it is faster than this share of its usual greatest speed
MOVES = 0.1


def kinds_of_motion(depth: Array, *rates: Array) -> list[Numbers]:
    """Several ways to tell motion apart, each a number for every sample, without holes, (n,); those that tell any
    apart.

    Args:
        depth: > 0 in the material [m], (n,). rates: of depth or slip [m/s], (n,) each.
    """
    kinds = labels_of_motion(depth, *rates)
    return [np.asarray(np.unique(kind, return_inverse=True)[1], np.int64) for kind in kinds if np.ptp(kind) > 0]


def labels_of_motion(depth: Array, *rates: Array) -> list[Numbers]:
    """Each way to tell motion apart as a label from −1 to 3 for every sample that means the same in every log, (n,).

    The air and each third of the depths; then, for each rate, one way, the other way or next to none.

    Args:
        depth: > 0 in the material [m], (n,). rates: of depth or slip [m/s], (n,) each.
    """
    inside = depth > 0.0
    edges = np.quantile(depth[inside], [1 / 3, 2 / 3]) if inside.any() else np.zeros(0)
    kinds = [np.where(inside, 1 + np.searchsorted(edges, depth), 0)]
    kinds += [np.sign(v) * (np.abs(v) > MOVES * np.quantile(np.abs(v), 0.95)) for v in rates if len(v)]
    return [np.asarray(kind, np.int64) for kind in kinds]
