"""A triangle mesh to be felt: the proxy that stays on the side from which the device came.

The closest point of the surface won't do: pressed through a thin wall, or past the middle of an edge, a device would be
let out on the other side. The god-object (C. Zilles, K. Salisbury, A constraint-based god-object method for haptic
display, IROS 1995) is moved instead: straight towards the device, stopped by each face that it would cross from
outside, and from there along the face, or the edge or corner of those that stop it, to where it is nearest to the
device.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers.properties import Foot, Tracker
from kinid.kernels.mesh import MeshTree
from kinid.robotics.surface import Mesh

Array = NDArray[np.float64]

#: the god-object keeps so far outside of the faces [m], so that the next step begins outside of them
SKIN = 1e-7
#: faces that may stop it one after the other within a period; it goes on in the next
MOST_STOPS = 32


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """A mesh that is rendered, and how its places are found on a map.

    Args:
        mesh: in the base frame. place: of a point (3,) of the surface on the map, x and y [m]; default: the base's x
            and y.
    """

    mesh: Mesh
    place: Callable[[Array], tuple[float, float]] = lambda point: (float(point[0]), float(point[1]))

    def tracker(self) -> Tracker:
        """A god-object that hasn't touched anything yet."""
        return _GodObject(self.mesh)

    def chart(self, point: Array) -> tuple[float, float]:
        """Where a point of the surface lies on the map [m]."""
        return self.place(point)


class _GodObject(Tracker):
    """Follows a device; remembers where it is."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self._tree = mesh, mesh.tree
        self._at: Array | None = None

    def follow(self, position: Array) -> Foot:
        """Where the device would be if the surface were hard."""
        if self._at is None:  # nobody knows where it came from: the nearest way out
            found = self._mesh.locate(position)
            inside = float(found.depth[0]) > 0.0
            self._at = found.closest[0] + SKIN * found.gradient[0] if inside else np.array(position, dtype=float)
        normal = np.zeros(3)
        stopped = _follow(self._at, np.ascontiguousarray(position, dtype=float), self._tree, normal)
        if not stopped:
            return Foot(self._at.copy(), normal, 0.0)
        way = self._at - position
        far = float(np.sqrt(way @ way))
        if far > 2.0 * SKIN:
            normal = way / far
        return Foot(self._at - SKIN * normal, normal, max(far - SKIN, 0.0))


@njit(cache=True, error_model="numpy")
def _follow(at: Array, goal: Array, tree: MeshTree, normal: Array) -> bool:
    """Move the god-object `at` (3,) towards a goal; whether faces keep it away, with the normal of the last one."""
    planes = np.empty((3, 3))
    way, best, side = np.empty(3), np.empty(3), np.empty(3)
    nodes = np.empty(tree.depth + 2, dtype=np.int64)
    stops = 0
    while True:
        # each round begins free: a face that was left over its edge doesn't hold any more
        count, moved = 0, 0.0
        way[:] = goal - at
        while True:
            face, share = _first_hit(at, way, tree, nodes)
            if face < 0:
                for j in range(3):
                    at[j] += way[j]
                    moved += abs(way[j])
                break
            n = tree.normal[face]
            # stop before it, SKIN outside
            speed = way[0] * n[0] + way[1] * n[1] + way[2] * n[2]
            share = max(0.0, share + SKIN / speed)
            for j in range(3):
                moved += abs(share * way[j])
                at[j] += share * way[j]
                normal[j] = n[j]
            stops += 1
            if _is_among(n, planes, count) or count == 3 or stops >= MOST_STOPS:
                break
            planes[count] = n
            count += 1
            way[:] = goal - at
            _allowed(way, planes, count, best, side)
            way[:] = best
            if abs(way[0]) + abs(way[1]) + abs(way[2]) < 1e-12:
                break
        if count == 0:
            return False
        if moved < 1e-10 or stops >= MOST_STOPS:
            return True


@njit(cache=True, error_model="numpy")
def _is_among(normal: Array, planes: Array, count: int) -> bool:
    """Whether a plane of this normal is among the first so many."""
    for k in range(count):
        if planes[k, 0] * normal[0] + planes[k, 1] * normal[1] + planes[k, 2] * normal[2] > 1.0 - 1e-12:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _allowed(way: Array, planes: Array, count: int, best: Array, side: Array) -> None:
    """The way (3,) nearest to the wanted one that goes against no plane: the projection on a cone."""
    least = np.inf
    best[:] = 0.0  # the corner itself
    least = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
    for i in range(count):
        along = way[0] * planes[i, 0] + way[1] * planes[i, 1] + way[2] * planes[i, 2]
        for j in range(3):
            side[j] = way[j] - along * planes[i, j]
        least = _better(side, way, planes, count, least, best)
        for k in range(i):
            side[0] = planes[i, 1] * planes[k, 2] - planes[i, 2] * planes[k, 1]
            side[1] = planes[i, 2] * planes[k, 0] - planes[i, 0] * planes[k, 2]
            side[2] = planes[i, 0] * planes[k, 1] - planes[i, 1] * planes[k, 0]
            size = side[0] ** 2 + side[1] ** 2 + side[2] ** 2
            if size > 1e-18:
                along = (way[0] * side[0] + way[1] * side[1] + way[2] * side[2]) / size
                for j in range(3):
                    side[j] *= along
                least = _better(side, way, planes, count, least, best)


@njit(cache=True, error_model="numpy")
def _better(side: Array, way: Array, planes: Array, count: int, least: float, best: Array) -> float:
    """Take a candidate that goes against no plane, if it is nearer to the wanted way; the least squared distance."""
    off = (way[0] - side[0]) ** 2 + (way[1] - side[1]) ** 2 + (way[2] - side[2]) ** 2
    if off >= least:
        return least
    size = np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
    for k in range(count):
        if side[0] * planes[k, 0] + side[1] * planes[k, 1] + side[2] * planes[k, 2] < -1e-12 * size:
            return least
    best[:] = side
    return float(off)


@njit(cache=True, error_model="numpy")
def _first_hit(at: Array, way: Array, tree: MeshTree, nodes: NDArray[np.int64]) -> tuple[int, float]:
    """The first face that the segment from `at` along `way` crosses from outside, and the share of the way; −1 for
    none.

    (T. Möller, B. Trumbore, Fast, minimum storage ray-triangle intersection, J. Graphics Tools 2, 1997.)
    """
    low0, high0 = min(at[0], at[0] + way[0]), max(at[0], at[0] + way[0])
    low1, high1 = min(at[1], at[1] + way[1]), max(at[1], at[1] + way[1])
    low2, high2 = min(at[2], at[2] + way[2]), max(at[2], at[2] + way[2])
    m, leaves = tree.corners.shape[0], 1 << tree.depth
    found, first = -1, 1.0
    nodes[0], top = 1, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        box = tree.box[node]
        if (
            box[0] > high0 + SKIN
            or box[3] < low0 - SKIN
            or box[1] > high1 + SKIN
            or box[4] < low1 - SKIN
            or box[2] > high2 + SKIN
            or box[5] < low2 - SKIN
        ):
            continue
        if node < leaves:
            nodes[top], nodes[top + 1] = 2 * node, 2 * node + 1
            top += 2
            continue
        leaf = node - leaves
        for k in range((leaf * m) >> tree.depth, ((leaf + 1) * m) >> tree.depth):
            n, tri = tree.normal[k], tree.corners[k]
            speed = way[0] * n[0] + way[1] * n[1] + way[2] * n[2]
            if speed >= 0.0:
                continue
            height = (at[0] - tri[0, 0]) * n[0] + (at[1] - tri[0, 1]) * n[1] + (at[2] - tri[0, 2]) * n[2]
            # a god-object lies SKIN outside; below half of that it is on the other side already
            if height < -0.5 * SKIN or height + speed > 0.5 * SKIN:
                continue
            share = max(0.0, min(1.0, -height / speed))
            if share > first or (share == first and found >= 0):
                continue
            x, y, z = at[0] + share * way[0], at[1] + share * way[1], at[2] + share * way[2]
            if _within(x, y, z, tri, n):
                found, first = k, share
    return found, first


@njit(cache=True, error_model="numpy")
def _within(x: float, y: float, z: float, tri: Array, n: Array) -> bool:
    """Whether a point of a triangle's plane lies in it, or within SKIN of its edges."""
    for a in range(3):
        b = (a + 1) % 3
        ex, ey, ez = tri[b, 0] - tri[a, 0], tri[b, 1] - tri[a, 1], tri[b, 2] - tri[a, 2]
        px, py, pz = x - tri[a, 0], y - tri[a, 1], z - tri[a, 2]
        inward = (n[0] * (ey * pz - ez * py) + n[1] * (ez * px - ex * pz) + n[2] * (ex * py - ey * px)) / np.sqrt(
            ex * ex + ey * ey + ez * ez
        )
        if inward < -SKIN:
            return False
    return True
