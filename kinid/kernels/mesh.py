"""Closest points on a triangle mesh: a tree of boxes in flat arrays, descended for a whole path at once.

Lengths in m; everything in the mesh's frame. Corners of a face count counter-clockwise seen from outside;
edge k of a face lies opposite its corner k.

The sign of the distance comes from pseudonormals: J. A. Bærentzen, H. Aanæs, "Signed distance computation
using the angle weighted pseudonormal", IEEE Trans. Visualization and Computer Graphics 11(3), 2005. Regions
of a triangle: C. Ericson, "Real-Time Collision Detection", 2005, §5.1.5.

The smooth normal turns from face to face without a jump. With d₁ ≤ d₂ the distances of the closest point to
the two nearest edges of its face f, g the face across the nearest edge, h a smooth step from h(0) = 1 to h(1)
= 0, and d_v the distance to the nearest corner v:

    N = n_f + h(max(d₁ / r_e, 2 d₁ / (d₁ + d₂))) n_g     on the edge n_f + n_g, same from both sides
    N ← (1 − V) N / |N| + V n_v,  V = h(d_v / r_v)       at a corner its pseudonormal

Only the nearest edge has a say: the second term of the maximum reaches 1 where another edge is as near, so a
point that crosses one edge carries nothing of another one over, however short the edges or sharp the corners.
The radii are the wanted one, cut to `FEATURE` times the local feature size. For an edge that is the smaller
height of its two faces above it, so that beside a thin strip the normal turns as far on one side of the edge
as on the other. For a corner it is the smallest height of its faces below it, so that the balls of two
corners never overlap (a height is no longer than the edges beside it, and 2 · 0.4 < 1) and none reaches over
the opposite edge to a face that does not know this corner. The normal thus turns by the angle between faces
over a length of about the smaller of the wanted radius and the feature size, and further than the wanted
radius from every edge whose faces differ it is the face's. It is no property of the shape alone: where flat
material is cut into thin triangles beside a crease, the turn is narrower near their tips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: share of the local feature size that the normal may take to turn; below 1/2, see above
FEATURE = 0.4
#: about so many triangles in a leaf: fewer cost more boxes, more cost more triangles
LEAF = 4


class MeshTree(NamedTuple):
    """Triangles in the order of the leaves, what a query needs of their neighbours, and the tree above.

    The tree is complete and balanced: node i has the children 2i and 2i + 1, the root is 1, the leaves are
    the last 2^depth nodes, and leaf j holds the triangles (j m) >> depth up to ((j + 1) m) >> depth.
    """

    corners: Array  # (m, 3, 3)
    normal: Array  # (m, 3) unit, outward
    across: Array  # (m, 3, 3) sum of the other faces' normals at each edge; zero at the rim of a sheet
    corner_normal: Array  # (m, 3, 3) angle-weighted vertex pseudonormals, unit
    height: Array  # (m, 3) of each corner above its opposite edge
    edge_radius: Array  # (m, 3)
    corner_radius: Array  # (m, 3)
    face: Index  # (m,) index of the triangle in the mesh as given
    box: Array  # (2^(depth + 1), 6) lower and upper corner of each node; row 0 is unused
    depth: int


class Closest(NamedTuple):
    """What lies closest to each of n points; NaN, face −1, where a point is not finite."""

    point: Array  # (n, 3)
    face: Index  # (n,)
    distance: Array  # (n,) signed, > 0 outside
    gradient: Array  # (n, 3) of the signed distance: unit, outward
    normal: Array  # (n, 3) smooth, unit


def build(vertices: ArrayLike, faces: ArrayLike, edge_radius: float) -> MeshTree:
    """Prepare a mesh for queries.

    Args:
        vertices: (k, 3), merged: faces that touch share their vertices.
        faces: (m, 3) rows of vertex numbers, m ≥ 1, without degenerate triangles, wound the same way round.
        edge_radius: distance from an edge within which the smooth normal turns [m], > 0.
    """
    points = np.asarray(vertices, dtype=np.float64)
    tri = np.asarray(faces, dtype=np.int64)
    corners = points[tri]
    order, box, depth = _tree(corners)
    tri, corners = tri[order], np.ascontiguousarray(corners[order])

    # edge k from corner k + 1 to corner k + 2, its length, and the height of corner k above it
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    length = np.linalg.norm(edges, axis=2)
    doubled = np.cross(edges[:, 0], edges[:, 1])
    area2 = np.linalg.norm(doubled, axis=1)
    normal = doubled / area2[:, None]
    height = area2[:, None] / length

    one, other = np.roll(tri, -1, axis=1), np.roll(tri, -2, axis=1)
    _, edge = np.unique(np.minimum(one, other) * len(points) + np.maximum(one, other), return_inverse=True)
    edge = edge.reshape(-1, 3)
    at_edge = np.zeros((edge.max() + 1, 3))
    np.add.at(at_edge, edge, normal[:, None, :])
    low_edge = np.full(len(at_edge), np.inf)
    np.minimum.at(low_edge, edge, height)

    # corner k lies between edge k + 1, which ends there, and edge k + 2, which starts there
    back, ahead = -np.roll(edges, -1, axis=1), np.roll(edges, -2, axis=1)
    angle = np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=2), np.sum(ahead * back, axis=2))
    at_corner = np.zeros_like(points)
    np.add.at(at_corner, tri, angle[:, :, None] * normal[:, None, :])
    size = np.linalg.norm(at_corner, axis=1, keepdims=True)
    at_corner = np.divide(at_corner, size, out=np.zeros_like(at_corner), where=size > 1e-12)
    low_corner = np.full(len(points), np.inf)
    np.minimum.at(low_corner, tri, height)

    return MeshTree(
        corners=corners,
        normal=normal,
        across=at_edge[edge] - normal[:, None, :],
        corner_normal=at_corner[tri],
        height=height,
        edge_radius=np.minimum(edge_radius, FEATURE * low_edge[edge]),
        corner_radius=np.minimum(edge_radius, FEATURE * low_corner[tri]),
        face=order,
        box=box,
        depth=depth,
    )


def closest(points: ArrayLike, tree: MeshTree) -> Closest:
    """What of the mesh is closest to each of n points (n, 3); fastest when they follow a path."""
    # one writeable layout, so that one compiled version serves every caller
    queries = np.require(np.asarray(points, dtype=np.float64).reshape(-1, 3), requirements=["C", "W"])
    n = len(queries)
    out = Closest(
        np.full((n, 3), np.nan),
        np.full(n, -1, dtype=np.int64),
        np.full(n, np.nan),
        np.full((n, 3), np.nan),
        np.full((n, 3), np.nan),
    )
    _closest(queries, tree, out)
    return out


def _tree(corners: Array) -> tuple[Index, Array, int]:
    """Order of the triangles, boxes, depth: level by level, each node is halved along its longest side."""
    m = len(corners)
    depth = max(0, int(np.ceil(np.log2(m / LEAF))))
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 0.5 * (low + high)
    order = np.arange(m)
    for level in range(depth):
        starts = (np.arange(2**level) * m) >> level
        node = np.repeat(np.arange(2**level), np.diff(starts, append=m))
        at = middle[order]
        spread = np.maximum.reduceat(at, starts) - np.minimum.reduceat(at, starts)
        order = order[np.lexsort((at[np.arange(m), spread.argmax(axis=1)[node]], node))]
    box = np.empty((2 ** (depth + 1), 6))
    box[0] = np.nan
    starts = (np.arange(2**depth) * m) >> depth
    leaves = box[2**depth :]
    leaves[:, :3] = np.minimum.reduceat(low[order], starts)
    leaves[:, 3:] = np.maximum.reduceat(high[order], starts)
    for level in range(depth - 1, -1, -1):
        nodes, below = slice(2**level, 2 ** (level + 1)), box[2 ** (level + 1) : 2 ** (level + 2)]
        box[nodes, :3] = np.minimum(below[::2, :3], below[1::2, :3])
        box[nodes, 3:] = np.maximum(below[::2, 3:], below[1::2, 3:])
    return order, box, depth


@kernel(inline="always")
def _dot(a0: float, a1: float, a2: float, b0: float, b1: float, b2: float) -> float:
    return a0 * b0 + a1 * b1 + a2 * b2


@kernel
def _weights(x: float, y: float, z: float, tri: Array) -> tuple[float, float, float]:  # noqa: PLR0911 regions
    """Barycentric weights of a triangle's point closest to (x, y, z): exact zeros on edges and corners."""
    ab0, ab1, ab2 = tri[1, 0] - tri[0, 0], tri[1, 1] - tri[0, 1], tri[1, 2] - tri[0, 2]
    ac0, ac1, ac2 = tri[2, 0] - tri[0, 0], tri[2, 1] - tri[0, 1], tri[2, 2] - tri[0, 2]
    p0, p1, p2 = x - tri[0, 0], y - tri[0, 1], z - tri[0, 2]
    d1 = _dot(ab0, ab1, ab2, p0, p1, p2)
    d2 = _dot(ac0, ac1, ac2, p0, p1, p2)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    p0, p1, p2 = x - tri[1, 0], y - tri[1, 1], z - tri[1, 2]
    d3 = _dot(ab0, ab1, ab2, p0, p1, p2)
    d4 = _dot(ac0, ac1, ac2, p0, p1, p2)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return 1.0 - v, v, 0.0
    p0, p1, p2 = x - tri[2, 0], y - tri[2, 1], z - tri[2, 2]
    d5 = _dot(ab0, ab1, ab2, p0, p1, p2)
    d6 = _dot(ac0, ac1, ac2, p0, p1, p2)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return 1.0 - w, 0.0, w
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - w, w
    scale = 1.0 / (va + vb + vc)
    return va * scale, vb * scale, vc * scale


@kernel
def _gap(x: float, y: float, z: float, box: Array) -> float:
    """Squared distance from a point to a box (6,)."""
    dx = max(box[0] - x, 0.0, x - box[3])
    dy = max(box[1] - y, 0.0, y - box[4])
    dz = max(box[2] - z, 0.0, z - box[5])
    return float(dx * dx + dy * dy + dz * dz)


@kernel
def _squared(x: float, y: float, z: float, tri: Array) -> float:
    """Squared distance from a point to a triangle (3, 3)."""
    a, b, c = _weights(x, y, z, tri)
    dx = x - (a * tri[0, 0] + b * tri[1, 0] + c * tri[2, 0])
    dy = y - (a * tri[0, 1] + b * tri[1, 1] + c * tri[2, 1])
    dz = z - (a * tri[0, 2] + b * tri[1, 2] + c * tri[2, 2])
    return float(dx * dx + dy * dy + dz * dz)


@kernel
def _find(x: float, y: float, z: float, tree: MeshTree, start: int, stack: Array) -> int:
    """The triangle closest to a point; `start` gives the first bound, on a path nearly the answer.

    Args:
        stack: scratch, (2, depth + 2): nodes that wait, and the squared gap to each.
    """
    best = start
    bound = _squared(x, y, z, tree.corners[start])
    m, leaves = tree.corners.shape[0], 1 << tree.depth
    nodes, gaps = stack[0], stack[1]
    nodes[0], gaps[0] = 1.0, _gap(x, y, z, tree.box[1])
    top = 1
    while top > 0:
        top -= 1
        if gaps[top] >= bound:
            continue
        node = int(nodes[top])
        if node >= leaves:
            leaf = node - leaves
            for k in range((leaf * m) >> tree.depth, ((leaf + 1) * m) >> tree.depth):
                tri, n = tree.corners[k], tree.normal[k]
                # no triangle is nearer than its plane
                off = _dot(n[0], n[1], n[2], x - tri[0, 0], y - tri[0, 1], z - tri[0, 2])
                if off * off < bound:
                    squared = _squared(x, y, z, tri)
                    if squared < bound:
                        best, bound = k, squared
            continue
        near, far = 2 * node, 2 * node + 1
        near_gap, far_gap = _gap(x, y, z, tree.box[near]), _gap(x, y, z, tree.box[far])
        if far_gap < near_gap:
            near, far, near_gap, far_gap = far, near, far_gap, near_gap
        if far_gap < bound:
            nodes[top], gaps[top] = far, far_gap
            top += 1
        if near_gap < bound:
            nodes[top], gaps[top] = near, near_gap
            top += 1
    return best


@kernel
def _fade(x: float) -> float:
    """A smooth step from 1 at x ≤ 0 to 0 at x ≥ 1."""
    x = min(max(x, 0.0), 1.0)
    return 1.0 - x * x * (3.0 - 2.0 * x)


@kernel
def _unit(vector: Array, otherwise: Array) -> None:
    """Bring a vector (3,) to unit length; one without a direction becomes the other vector."""
    size = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    for j in range(3):
        vector[j] = vector[j] / size if size > 1e-9 else otherwise[j]


@kernel
def _smooth(k: int, weights: tuple[float, float, float], point: Array, tree: MeshTree, normal: Array) -> None:
    """Write the smooth normal (3,) at a point of triangle k with these barycentric weights."""
    height = tree.height[k]
    gap = weights[0] * height[0], weights[1] * height[1], weights[2] * height[2]
    e = _least(gap)
    d1, d2 = gap[e], min(gap[(e + 1) % 3], gap[(e + 2) % 3])
    share = _fade(max(d1 / tree.edge_radius[k, e], 2.0 * d1 / (d1 + d2))) if d2 > 0.0 else 0.0
    for j in range(3):
        normal[j] = tree.normal[k, j] + share * tree.across[k, e, j]
    _unit(normal, tree.normal[k])  # on the edge of a fold by 180° there is no other
    for v in range(3):
        corner = tree.corners[k, v]
        away = (point[0] - corner[0]) ** 2 + (point[1] - corner[1]) ** 2 + (point[2] - corner[2]) ** 2
        share = _fade(np.sqrt(away) / tree.corner_radius[k, v])
        if share > 0.0:  # for one corner at most: their balls are disjoint
            for j in range(3):
                normal[j] = (1.0 - share) * normal[j] + share * tree.corner_normal[k, v, j]
            _unit(normal, tree.normal[k])


@kernel
def _least(three: tuple[float, float, float]) -> int:
    """The first of the smallest of three numbers."""
    if three[0] <= three[1] and three[0] <= three[2]:
        return 0
    return 1 if three[1] <= three[2] else 2


@kernel
def locate(x: float, y: float, z: float, tree: MeshTree, start: int, stack: Array, found: Array) -> int:
    """What of the mesh is closest to a finite point; allocates nothing.

    Args:
        tree: or whatever else has its attributes. start, stack: as `_find`.
        found: the closest point, signed distance, its gradient, and the smooth normal, (10,), to be filled.

    Returns:
        The triangle, in the tree's order: the start for the next point of a path.
    """
    k: int = _find(x, y, z, tree, start, stack)
    tri = tree.corners[k]
    weights = _weights(x, y, z, tri)
    point, gradient = found[:3], found[4:7]
    for j in range(3):
        point[j] = weights[0] * tri[0, j] + weights[1] * tri[1, j] + weights[2] * tri[2, j]
    dx, dy, dz = x - point[0], y - point[1], z - point[2]

    zeros = (weights[0] == 0.0) + (weights[1] == 0.0) + (weights[2] == 0.0)
    for j in range(3):
        outward = tree.normal[k, j]
        if zeros == 1:
            outward += tree.across[k, _least(weights), j]
        elif zeros == 2:
            outward = tree.corner_normal[k, _least((-weights[0], -weights[1], -weights[2])), j]
        gradient[j] = outward
    if zeros == 0:
        # above a face the gradient is its normal, without the rounding of a difference
        found[3] = _dot(x - tri[0, 0], y - tri[0, 1], z - tri[0, 2], gradient[0], gradient[1], gradient[2])
    else:
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        sign = 1.0 if _dot(dx, dy, dz, gradient[0], gradient[1], gradient[2]) >= 0.0 else -1.0
        found[3] = sign * distance
        if distance > 1e-12:
            gradient[0], gradient[1], gradient[2] = sign * dx / distance, sign * dy / distance, sign * dz / distance
        else:  # on the edge itself any direction between the faces is a gradient
            _unit(gradient, tree.normal[k])
    _smooth(k, weights, point, tree, found[7:])
    return k


@kernel
def axes_of(normal: Array, rule: Array, axes: Array) -> None:
    """Write tangent1, tangent2 and normal (9,) for a normal (3,).

    Args:
        rule: the wanted first tangent (3,), the cosine between it and the normal from which the other is taken, and the
            other (3,).
    """
    along = abs(_dot(normal[0], normal[1], normal[2], rule[0], rule[1], rule[2]))
    wanted = rule[4:] if along >= rule[3] else rule[:3]
    out = _dot(normal[0], normal[1], normal[2], wanted[0], wanted[1], wanted[2])
    x, y, z = wanted[0] - out * normal[0], wanted[1] - out * normal[1], wanted[2] - out * normal[2]
    size = np.sqrt(_dot(x, y, z, x, y, z))
    axes[0], axes[1], axes[2] = x / size, y / size, z / size
    axes[3] = normal[1] * axes[2] - normal[2] * axes[1]
    axes[4] = normal[2] * axes[0] - normal[0] * axes[2]
    axes[5] = normal[0] * axes[1] - normal[1] * axes[0]
    axes[6], axes[7], axes[8] = normal[0], normal[1], normal[2]


@kernel
def all_axes(normals: Array, rule: Array, out: Array) -> None:
    """`axes_of` for normals (n, 3), into (n, 9)."""
    for i in range(normals.shape[0]):
        axes_of(normals[i], rule, out[i])


@kernel
def _closest(points: Array, tree: MeshTree, out: Closest) -> None:
    """Fill `out` for points (n, 3)."""
    stack, found = np.empty((2, tree.depth + 2)), np.empty(10)
    last = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not np.isfinite(x + y + z):
            continue
        last = locate(x, y, z, tree, last, stack, found)
        out.face[i], out.distance[i] = tree.face[last], found[3]
        for j in range(3):
            out.point[i, j], out.gradient[i, j], out.normal[i, j] = found[j], found[4 + j], found[7 + j]
