"""Inside a loop: contact quantities of one sample in the frame of a mesh, without allocation.

What the compiled step needs of a mesh is one float64 array, its *sheet*, behind the store of `kinid.kernels.causal`:

    triangles, depth of the tree, last triangle, samples seen (4) | tangent rule (7) | closest point, distance,
    gradient, normal (10) | axes (9) | last tip and tangents (9) | slips (2) | corners 9 m | normal 3 m | across 9 m
    | corner normals 9 m | height 3 m | edge radius 3 m | corner radius 3 m | boxes | stack

for m triangles. Without a mesh it is empty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.kernels import chain
from kinid.kernels.mesh import MeshTree, axes_of, locate

Array = NDArray[np.float64]

TRIANGLES, TREE_DEPTH, LAST, SEEN = range(4)
#: numbers before those of the triangles, which are all that samples change; and of each triangle
HEAD, _EACH = 41, 39
#: a plane through the base's origin along its axes: with it a sample's quantities are tip and force in the base frame
BASE_FRAME: Array = np.concatenate([np.zeros(3), np.eye(3).ravel()])


class Sheet(NamedTuple):
    """Views of a sheet's parts; it has all that `kinid.kernels.mesh.locate` asks of a tree."""

    head: Array  # (4,)
    rule: Array  # (7,) of `axes_of`
    found: Array  # (10,) of `locate`
    axes: Array  # (9,) tangent1, tangent2, normal
    before: Array  # (9,) the last tip, and its tangents
    slips: Array  # (2,)
    corners: Array
    normal: Array
    across: Array
    corner_normal: Array
    height: Array
    edge_radius: Array
    corner_radius: Array
    box: Array
    stack: Array
    depth: int


def pack(tree: MeshTree, rule: Array) -> Array:
    """The sheet of a mesh that has seen no sample.

    Args:
        tree: of `kinid.kernels.mesh.build`. rule: of its tangents, (7,), as `axes_of` takes it.
    """
    head = np.zeros(HEAD)
    head[TRIANGLES], head[TREE_DEPTH], head[4:11] = len(tree.corners), tree.depth, rule
    triangles = (tree.corners, tree.normal, tree.across, tree.corner_normal)
    sizes = (tree.height, tree.edge_radius, tree.corner_radius, tree.box, np.zeros(2 * (tree.depth + 2)))
    return np.concatenate([head, *(part.ravel() for part in (*triangles, *sizes))])


def sheet_of(packed: Array) -> Sheet:
    """The parts of a sheet."""
    m, depth = int(packed[TRIANGLES]), int(packed[TREE_DEPTH])
    rest, boxes = packed[HEAD:], packed[HEAD + _EACH * m :]
    split = 6 << (depth + 1)
    return Sheet(
        packed[:4],
        packed[4:11],
        packed[11:21],
        packed[21:30],
        packed[30:39],
        packed[39:41],
        rest[: 9 * m].reshape(m, 3, 3),
        rest[9 * m : 12 * m].reshape(m, 3),
        rest[12 * m : 21 * m].reshape(m, 3, 3),
        rest[21 * m : 30 * m].reshape(m, 3, 3),
        rest[30 * m : 33 * m].reshape(m, 3),
        rest[33 * m : 36 * m].reshape(m, 3),
        rest[36 * m : _EACH * m].reshape(m, 3),
        boxes[:split].reshape(2 << depth, 6),
        boxes[split:].reshape(2, depth + 2),
        depth,
    )


_sheet_of = njit(forceinline=True)(sheet_of)


@njit(error_model="numpy", forceinline=True)
def onto_mesh(packed: Array, quantities: Array) -> None:
    """Turn quantities in the base frame into those of the mesh, in place.

    Depth is the distance below the surface and its rate that of the exact distance; tangents turn smoothly across
    edges; slip is the sum of the tip's steps, each along the mean of the tangents at its ends, from the first sample
    on. As `kinid.contact.surface_frame` works on a log.

    Args:
        packed: the sheet. quantities: of `chain.contact_block` with the plane `BASE_FRAME`, (9,).
    """
    s = _sheet_of(packed)
    x, y, z = quantities[chain.SLIP1], quantities[chain.SLIP2], -quantities[chain.DEPTH]
    vx, vy, vz = quantities[chain.SLIP_RATE1], quantities[chain.SLIP_RATE2], -quantities[chain.DEPTH_RATE]
    fx, fy, fz = quantities[chain.TANGENT1], quantities[chain.TANGENT2], quantities[chain.NORMAL]
    if not abs(x + y + z) < np.inf:  # an arm that gives way, and a wrench that isn't finite
        quantities[:] = np.nan
        return
    s.head[LAST] = locate(x, y, z, s, int(s.head[LAST]), s.stack, s.found)
    gradient, t1, t2, normal = s.found[4:7], s.axes[:3], s.axes[3:6], s.axes[6:]
    axes_of(s.found[7:], s.rule, s.axes)
    if s.head[SEEN] > 0.0:
        dx, dy, dz = x - s.before[0], y - s.before[1], z - s.before[2]
        for i in range(2):
            then, now = s.before[3 + 3 * i : 6 + 3 * i], s.axes[3 * i : 3 * i + 3]
            along = (then[0] + now[0]) * dx + (then[1] + now[1]) * dy + (then[2] + now[2]) * dz
            s.slips[i] += 0.5 * along
    else:
        s.slips[0] = s.slips[1] = 0.0
    s.head[SEEN] = 1.0
    s.before[0], s.before[1], s.before[2] = x, y, z
    for i in range(6):
        s.before[3 + i] = s.axes[i]
    quantities[chain.DEPTH] = -s.found[3]
    quantities[chain.DEPTH_RATE] = -(gradient[0] * vx + gradient[1] * vy + gradient[2] * vz)
    quantities[chain.SLIP1], quantities[chain.SLIP2] = s.slips[0], s.slips[1]
    quantities[chain.SLIP_RATE1] = t1[0] * vx + t1[1] * vy + t1[2] * vz
    quantities[chain.SLIP_RATE2] = t2[0] * vx + t2[1] * vy + t2[2] * vz
    quantities[chain.TANGENT1] = t1[0] * fx + t1[1] * fy + t1[2] * fz
    quantities[chain.TANGENT2] = t2[0] * fx + t2[1] * fy + t2[2] * fz
    quantities[chain.NORMAL] = normal[0] * fx + normal[1] * fy + normal[2] * fz
