"""Edges between probes: segments that a sharp step parts, so that a guess on one side doesn't smear into the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: sorted steps between neighbours part into small and large ones where one is so many times the one before it
GAP = 1.3
#: so many ways to part them are tried at most
TRIES = 2
#: a segment has so many probes at least, and this share of all probes lies in such segments
FEWEST, SHARE = 3, 0.7
#: shares of the values' range that part where no gap shows
SHARES = (0.03, 0.08)
#: how fast belonging to a segment fades beyond its nearest probe, in spacings
FADE = 0.15
#: so many of the nearest probes say which segment a place is in
VOTERS = 8


def neighbours(places: Array) -> Index:
    """Pairs of neighbouring places, (e, 2): Delaunay's edges, without the long ones along the hull."""
    from scipy.spatial import Delaunay, QhullError, cKDTree

    if len(places) < 4:
        return np.zeros((0, 2), dtype=np.int64)
    try:
        triangles = Delaunay(places).simplices
    except QhullError:  # places in one line
        order = np.argsort(places @ np.ptp(places, axis=0))
        return np.column_stack([order[:-1], order[1:]]).astype(np.int64)
    pairs = np.unique(
        np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1), axis=0
    )
    length = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    near = cKDTree(places).query(places, k=2)[0][:, 1]
    return np.asarray(pairs[length <= 3.0 * np.maximum(near[pairs[:, 0]], np.median(near))], dtype=np.int64)


def candidates(places: Array, values: Array, noise: Array) -> list[tuple[float, Index]]:
    """Ways to part probes into segments: the step that parts, and each probe's (n,); those with clear gaps first."""
    pairs = neighbours(places)
    if len(pairs) < 6:
        return []
    values, noise = scaled(values, noise)
    step = np.abs(values[pairs[:, 0]] - values[pairs[:, 1]])
    # steps within the noise are no steps
    floor = 3.0 * np.hypot(noise[pairs[:, 0]], noise[pairs[:, 1]])
    size = np.sort(np.maximum(step, np.minimum(floor, np.median(step) + 1e-300)))
    ratio = size[1:] / np.maximum(size[:-1], 1e-12 * size[-1] + 1e-300)
    upper = np.flatnonzero((ratio > GAP) & (np.arange(1, len(size)) > len(size) // 2))
    limits = [float(np.sqrt(size[k] * size[k + 1])) for k in upper[np.argsort(-ratio[upper])][:TRIES]]
    # probes that lie on borders fill the gap: then shares of the whole range part as well
    limits += [share * float(np.ptp(values)) for share in SHARES]
    out: list[tuple[float, Index]] = []
    for limit in limits:
        alike = pairs[(step <= limit) | (step <= floor)]
        for segments in (connected(len(places), alike), _cores(len(places), alike)):
            counts = np.bincount(segments)
            fresh = all(not np.array_equal(segments, other) for _, other in out)
            if fresh and len(counts) > 1 and counts[counts >= FEWEST].sum() >= SHARE * len(places):
                out.append((limit, segments))
    return out


def _cores(n: int, pairs: Index) -> Index:
    """Segments of probes: connected through such as have several neighbours of their kind (Ester et al., DBSCAN, 1996).

    A probe that lies on a border has hardly any: it joins nothing together, and is a segment of its own.
    """
    like = np.bincount(pairs.ravel(), minlength=n)
    core = like >= np.minimum(FEWEST, np.maximum(1, np.quantile(like, 0.5)))
    segments = connected(n, pairs[core[pairs].all(axis=1)])
    # a probe at the rim of its segment belongs to the one core that it is like
    for a, b in pairs[core[pairs].sum(axis=1) == 1].tolist():
        if core[a]:
            segments[b] = segments[a]
        else:
            segments[a] = segments[b]
    return np.asarray(np.unique(segments, return_inverse=True)[1], dtype=np.int64)


def scaled(values: Array, noise: Array) -> tuple[Array, Array]:
    """Values and noise on the scale that steps are compared on: logarithmic where all are surely positive, as stiffness
    is.
    """
    if np.all(values > 3.0 * noise) and np.all(values > 0.0):
        return np.log(values), noise / values
    return values, noise


def connected(n: int, pairs: Index) -> Index:
    """Number of the connected part that each of n belongs to, (n,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def belonging(queries: Array, places: Array, segments: Index, spacing: float) -> tuple[Index, Array]:
    """The two likeliest segments of each query and how sure it lies in each, (m, 2) both; the second is 0 where there
    is one only.

    The probes around vote, with weights that fade with their distance: beside one nearest probe a place is of its
    segment, and among several that are as near, of the segment of most of them.
    """
    from scipy.spatial import cKDTree

    distance, index = cKDTree(places).query(queries, k=np.arange(1, min(VOTERS, len(places)) + 1))
    weight, kinds = np.exp(-(distance - distance[:, :1]) / (FADE * spacing)), np.unique(segments)
    votes = np.column_stack([np.sum(weight * (segments[index] == kind), axis=1) for kind in kinds])
    if len(kinds) == 1:
        return np.repeat(kinds[None], len(queries), axis=0).repeat(2, axis=1), np.tile([1.0, 0.0], (len(queries), 1))
    order = np.argsort(-votes, axis=1)[:, :2]
    share = np.take_along_axis(votes, order, axis=1)
    return kinds[order], share / share.sum(axis=1, keepdims=True)
