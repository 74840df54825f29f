"""The surface that is touched, a plane or a triangle mesh in the base frame, and where points lie to it.

Lengths in m. The normal points out of the material; depth is > 0 inside.
"""

from __future__ import annotations

import io
import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.log import frozen, frozen_as
from kinid.data.rig import Rig
from kinid.errors import InputError, near
from kinid.inputs import check_regular

if TYPE_CHECKING:
    from kinid.kernels.mesh import MeshTree

# trimesh logs the traceback of what it raises, which would reach the screen
logging.getLogger("trimesh").addHandler(logging.NullHandler())

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: file formats of meshes
FORMATS = (".stl", ".obj", ".ply")
#: meshes of a folder that are looked at for a name like a missing one
MOST_NAMED = 1000
#: no vertex is farther away [m]: volumes of such meshes would overflow
FARTHEST = 1e30
#: a mesh that is wider than this [m] is probably in mm
WIDE = 20.0
#: vertices closer than this share of the mesh's size are one, and faces lower than it have no normal worth
#: the name; the second part is the rounding of the single precision in which STL files hold coordinates
MERGE, ROUNDING = 1e-6, 2.0**-22


@dataclass(frozen=True, eq=False)
class Located:
    """Where n points lie relative to a surface, base frame; NaN where a point is not finite.

    Attributes:
        depth: distance below the surface [m], > 0 inside the material, (n,).
        gradient: of the signed distance (= −depth) by the point: unit, outward, (n, 3). Exact, for rates:
            that of the depth is −gradient · velocity.
        axes: rows tangent1, tangent2 = normal × tangent1, normal at the closest point, (n, 3, 3). A mesh's
            normal turns smoothly across edges; the gradient jumps where the closest point does.
        closest: closest point of the surface [m], (n, 3).
    """

    depth: Array
    gradient: Array
    axes: Array
    closest: Array


class Surface(ABC):
    """What a tool touches. `Plane` and `Mesh` are the two there are."""

    @abstractmethod
    def locate(self, points: ArrayLike) -> Located:
        """Where points (n, 3) in the base frame lie relative to the surface."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What a user should know about this surface before trusting a depth; empty when all is well."""


@final
@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """A plane through `point` (3,) [m] with orthonormal `axes` (3, 3): rows tangent1, tangent2, normal."""

    point: Array
    axes: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen(self.point))
        object.__setattr__(self, "axes", frozen(self.axes))
        if self.point.shape != (3,) or self.axes.shape != (3, 3):
            raise ValueError(f"point {self.point.shape} and axes {self.axes.shape}, not (3,) and (3, 3)")
        small = (np.abs(self.axes) < 2.0).all() and (np.abs(self.point) < FARTHEST).all()  # no product overflows
        if not small or not np.allclose(self.axes @ self.axes.T, np.eye(3), atol=1e-9) or np.linalg.det(self.axes) < 0:
            raise ValueError("a plane has a point within reach, and axes that are orthonormal and right-handed")

    @property
    def normal(self) -> Array:
        """Unit normal out of the material, (3,)."""
        normal: Array = self.axes[2]
        return normal

    @property
    def notes(self) -> tuple[str, ...]:
        """Nothing to say of a plane."""
        return ()

    def packed(self) -> Array:
        """For the kernels: the point, then the axes row by row, (12,)."""
        return np.concatenate([self.point, self.axes.ravel()])

    def locate(self, points: ArrayLike) -> Located:
        """Where points (n, 3) in the base frame lie relative to the plane."""
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        depth = (self.point - p) @ self.normal
        hole = np.where(np.isfinite(depth), 0.0, np.nan)  # carries NaN to what doesn't depend on the point
        return Located(
            depth=depth + hole,
            gradient=self.normal + hole[:, None],
            axes=self.axes + hole[:, None, None],
            closest=p + (depth + hole)[:, None] * self.normal,
        )


@final
@dataclass(frozen=True, eq=False)
class Mesh(Surface):
    """A triangle mesh in the base frame, cleaned and checked as it is made.

    The sign of the depth is exact for a closed mesh that doesn't cut itself. A sheet is allowed: there the
    material is behind the faces, and beyond its rim the sign is that of the side of the nearest face.

    The first tangent is `tangent` projected on the local tangent plane; where the normal is parallel to it
    (within 2.5°), the base axis furthest from it. Without a tangent it is the base x axis, or y where the
    normal is within 26° of x, as on a plane. A field of tangents on a closed surface always jumps somewhere.

    Attributes:
        vertices: [m], (k, 3), after merging.
        faces: vertex numbers, counter-clockwise seen from outside, (m, 3), without degenerate ones.
        edge_radius: distance from an edge within which the normal turns [m]; less beside small faces.
        tangent: direction of the first tangential axis, (3,), or None.
        source: where the mesh came from, for messages.

    Raises:
        InputError: no faces, vertices that are not finite, faces wound against each other, a mesh inside out.
    """

    vertices: Array
    faces: Index
    edge_radius: float = 1e-3
    tangent: Array | None = None
    source: str = "the mesh"
    notes: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, dtype=np.float64)
        faces = np.asarray(self.faces, dtype=np.int64)
        if vertices.size == 0 or faces.size == 0:
            raise InputError(f"no triangles in {self.source}", "a triangle mesh", "save it as STL, OBJ or PLY")
        if faces.min() < 0 or faces.max() >= len(vertices) or not (np.abs(vertices) < FARTHEST).all():
            raise InputError(
                f"vertices of {self.source} that are absent, not numbers or too far away",
                f"a mesh of vertices with finite coordinates in m, below {FARTHEST:g}",
                "save it again from its source",
            )
        vertices, faces, slivers = _clean(vertices, faces)
        if len(faces) == 0:
            raise InputError(
                f"only triangles without an area in {self.source}",
                "a triangle mesh in m",
                "check its scale and save it again",
            )
        object.__setattr__(self, "vertices", frozen(vertices))
        object.__setattr__(self, "faces", frozen_as(np.int64, faces))
        object.__setattr__(self, "tangent", None if self.tangent is None else frozen(self.tangent))
        object.__setattr__(self, "notes", _check(vertices, faces, slivers, self.source))

    @cached_property
    def tree(self) -> MeshTree:
        """What queries need of the mesh."""
        from kinid.kernels import mesh

        return mesh.build(self.vertices, self.faces, self.edge_radius)

    def locate(self, points: ArrayLike) -> Located:
        """Where points (n, 3) in the base frame lie relative to the mesh; fastest when they follow a path."""
        from kinid.kernels import mesh

        found = mesh.closest(points, self.tree)
        axes = np.empty((len(found.normal), 9))
        mesh.all_axes(found.normal, self._tangent_rule(), axes)
        return Located(-found.distance, found.gradient, axes.reshape(-1, 3, 3), found.point)

    def packed(self) -> Array:
        """For the step of a loop (`kinid.kernels.on_mesh`)."""
        from kinid.kernels import on_mesh

        return on_mesh.pack(self.tree, self._tangent_rule())

    def _tangent_rule(self) -> Array:
        """The rule of the first tangent as `kinid.kernels.mesh.axes_of` takes it, (7,)."""
        if self.tangent is None:
            return np.array([1.0, 0.0, 0.0, 0.9, 0.0, 1.0, 0.0])
        wanted = self.tangent / np.linalg.norm(self.tangent)
        return np.concatenate([wanted, [0.999], np.eye(3)[np.abs(wanted).argmin()]])


def load(rig: Rig) -> Surface | None:
    """The rig's surface; None when it has none.

    Raises:
        InputError: a mesh and a plane at once; a mesh outside the rig's folder, absent or unusable.
    """
    spec = rig.surface
    if spec is None:
        return None
    if spec.mesh is None:
        return Plane(np.asarray(spec.point), np.asarray(rig.axes))
    if spec.normal is not None:
        raise InputError("both a normal and a mesh in [surface]", "a plane or a mesh", "remove one of them")
    vertices, faces = _read(_inside(rig.folder, spec.mesh))
    tangent = None if spec.tangent is None else np.asarray(spec.tangent)
    return Mesh(vertices, faces, spec.edge_radius, tangent, source=spec.mesh)


def _inside(folder: Path, name: str) -> Path:
    """The file `name` in the rig's folder: a rig from elsewhere has no business with other files."""
    try:
        path = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a ring of links, a zero byte
        raise InputError(f"[surface] mesh = {name!r} ({error})", "the name of a file", "correct it") from None
    if not path.is_relative_to(folder.resolve()):
        raise InputError(
            f"[surface] mesh = '{name}', which leaves the rig's folder",
            "a mesh beside or below rig.toml",
            "copy it there and name it relative to rig.toml",
        )
    return path


def _meshes_near(path: Path) -> str:
    """Which mesh a name may mean, of those in its folder."""
    try:
        there = sorted(file.name for file in path.parent.iterdir() if file.suffix.lower() in FORMATS)[:MOST_NAMED]
    except OSError:
        return f"correct the name: there is no folder {path.parent}"
    return near(path.name, there) if there else f"put the file into {path.parent}, which holds no mesh"


def _read(path: Path) -> tuple[Array, Index]:
    """Vertices and faces of a mesh file, as they stand in it."""
    import trimesh

    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"mesh file {path.name}", f"one of {', '.join(FORMATS)}", "convert it")
    wanted = "the file that [surface] mesh names, relative to rig.toml"
    check_regular(path, "mesh", wanted, "name a mesh file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"no readable mesh at {path} ({error.strerror})", wanted, _meshes_near(path)) from None
    try:
        # from memory, so that an OBJ file can't have materials read from elsewhere
        with np.errstate(all="ignore"):  # of vertices that aren't finite, which are refused below
            mesh = trimesh.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
        return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's readers raise whatever comes up in a broken file
        raise InputError(
            f"{path} that can't be read as {kind[1:].upper()} ({str(error)[:80]})",
            "a triangle mesh",
            "save it again from its source",
        ) from None


def mesh_bytes(vertices: Array, faces: Index, ending: str) -> bytes:
    """A mesh as a file of one of `FORMATS`, for [surface] mesh: vertices (k, 3) [m] and their numbers (m, 3)."""
    import trimesh

    packed = trimesh.Trimesh(vertices, faces, process=False).export(file_type=ending.lower()[1:])
    return packed.encode() if isinstance(packed, str) else bytes(packed)


def _clean(vertices: Array, faces: Index) -> tuple[Array, Index, int]:
    """Merge vertices, drop degenerate faces, turn slivers away; the last number counts slivers that stay.

    A sliver, lower than rounding, has a normal at random that would show at its neighbours' edges and
    corners. Dropped, it would leave a slit. So the quadrilateral that it makes with the face beyond its
    longest edge is cut the other way.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    tolerance = MERGE * size + ROUNDING * float(np.abs(vertices).max())
    vertices, same = np.unique(vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[faces]
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    if len(pairs):
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(vertices), len(vertices)))
        _, group = connected_components(graph, directed=False)
        _, first = np.unique(group, return_index=True)
        vertices, faces = vertices[first], group[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int64)
    if len(faces):  # each once: turned to begin with their smallest number
        turned = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
        faces = np.unique(np.take_along_axis(faces, turned, axis=1), axis=0)
    faces, slivers = _flip_slivers(vertices, faces, tolerance)
    return vertices, faces, slivers


def _low(vertices: Array, faces: Index) -> tuple[Array, Index]:
    """Smallest height of each face [m] and the corner it is measured from."""
    corners = vertices[faces]
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    length = np.linalg.norm(edges, axis=2)
    area2 = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return area2 / length.max(axis=1), length.argmax(axis=1)


def _flip_slivers(vertices: Array, faces: Index, tolerance: float) -> tuple[Index, int]:
    """Cut each sliver and its neighbour the other way; one without a neighbour there is dropped."""
    low, _ = _low(vertices, faces)
    todo: list[int] = np.flatnonzero(low < tolerance).tolist()
    if not todo:
        return faces, 0
    faces = faces.copy()
    owner: dict[tuple[int, int], list[int]] = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        for e in ((a, b), (b, c), (c, a)):
            owner.setdefault(e, []).append(f)
    gone: list[int] = []
    patience = 20 * len(todo)  # ends flips that chase each other round
    while todo and patience:
        patience -= 1
        f = todo.pop()
        height, corner = _low(vertices, faces[f : f + 1])
        if height[0] >= tolerance:
            continue
        m, a, b = (int(v) for v in np.roll(faces[f], -int(corner[0])))
        across = owner.get((b, a), [])
        if not across and len(owner[a, b]) == 1:
            gone.append(f)
            for e in ((m, a), (a, b), (b, m)):
                owner[e].remove(f)
            continue
        g = across[0] if across else -1
        c = int(faces[g].sum()) - a - b
        if len(across) != 1 or len(owner[a, b]) != 1 or c == m or owner.get((m, c)) or owner.get((c, m)):
            continue
        faces[f], faces[g] = (m, a, c), (m, c, b)
        owner[a, b], owner[b, a] = [], []
        owner[b, m] = [g if x == f else x for x in owner[b, m]]
        owner[a, c] = [f if x == g else x for x in owner[a, c]]
        owner[m, c], owner[c, m] = [g], [f]
        todo += [f, g]
    keep = np.ones(len(faces), dtype=np.bool_)
    keep[gone] = False
    faces = faces[keep]
    flat = _low(vertices, faces)[0]
    return faces[flat > 0.0], int((flat < tolerance).sum())


def _check(vertices: Array, faces: Index, slivers: int, source: str) -> tuple[str, ...]:
    """Notes on a mesh that can be used; InputError for one that can't."""
    notes = []
    start, end = faces, np.roll(faces, -1, axis=1)
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    _, edge = np.unique(key, return_inverse=True)
    edge = edge.reshape(-1)
    count = np.bincount(edge)
    balance = np.bincount(edge, weights=np.where(start < end, 1.0, -1.0).reshape(-1))
    if (against := int(((count == 2) & (balance != 0)).sum())) > 0:
        raise InputError(
            f"{against} edges of {source} whose two faces are wound against each other",
            "faces that all turn the same way round, counter-clockwise seen from outside",
            "recompute the outward normals where the mesh was made, save it again",
        )
    a, b, c = np.moveaxis(vertices[faces], 1, 0) - vertices.mean(axis=0)
    volume = float(np.einsum("ij,ij", a, np.cross(b, c))) / 6.0
    if (rim := int((balance != 0).sum())) > 0:
        notes.append(f"{source} is not closed ({rim} open edges): material is taken to be behind its faces")
    elif volume < -MERGE * float(np.prod(np.ptp(vertices, axis=0))):
        raise InputError(
            f"{source} inside out (its faces enclose {volume:.3g} m³)",
            "normals that point out of the material",
            "flip its faces (reverse its normals) and save it again",
        )
    if (many := int((count > 2).sum())) > 0:
        notes.append(f"{source} has {many} edges with more than two faces: the sign is unsure near them")
    if slivers:
        notes.append(f"{source} has {slivers} faces lower than rounding: beside them the normal is unsure")
    if (width := float(np.ptp(vertices, axis=0).max())) > WIDE:
        notes.append(f"{source} is {width:.4g} m wide: a rig's mesh is in m, many mesh files are in mm")
    return tuple(notes)
