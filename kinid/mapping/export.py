"""A property map for other programs: MuJoCo XML, SDF for Gazebo, and glTF with PNG and JSON for game engines.

The surface becomes patches (squares of a plane, or one for each face of a mesh), each with stiffness, damping and
friction. A body that touches several patches at once feels them all: make them wider than the tip (`cells_of`);
`map.json` says up to which radius a tip on the middle of a patch feels that patch alone. Physics engines have their own
notion of softness, so that what is written says how it was converted:

- MuJoCo: `solref = (−stiffness, −damping)`, its direct form, per unit of the contact's effective mass, which the file
  states. A contact's acceleration there is d (k r − b v) + (1 − d) g with the impedance d; a small d makes it the map's
  spring and damper under all but the share d of gravity. That holds for elliptic friction cones, which the file asks
  for: each edge of a pyramidal one would be a spring of its own. An engine pushes a body out of the face of a box that
  is nearest to the body's middle: one that is pressed deeper than `deepest` is pushed aside and down, so that under a
  plane's patches lies a rigid floor that nothing falls through.
- SDF: `<kp>` [N/m], `<kd>` [N·s/m], `<mu>`.
- glTF 2.0 (binary, `.glb`): one mesh with vertex colours by a property; a PNG holds each property as 16-bit grey over
  the same grid, and a JSON file its scale, so that an engine reads numbers and not colours.
"""

from __future__ import annotations

import json
import struct
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.inputs import raised, size_limit
from kinid.mapping.png import to_png
from kinid.mapping.property_map import PropertyMap
from kinid.robotics.surface import Mesh
from kinid.writers import Json, made_folder, write_bytes, write_json, write_text

Array = NDArray[np.float64]

#: of the body that touches: MuJoCo's direct solref is per unit of effective mass [kg]
EFFECTIVE_MASS = 1.0
#: impedance d of the patches in MuJoCo; for a constant one its direct form divides both numbers by d
IMPEDANCE = 0.02
#: thickness of the patches [m]
THICK = 0.02
#: a mesh of more faces is too many patches for an engine
MOST_FACES = 5000
#: a plane of more patches is too many too
MOST_PATCHES = 40_000
#: along the longer side of a plane, unless the user says more
CELLS = 20
#: property names that become stiffness, damping and friction
ROLES = ("stiffness", "damping", "friction")
FRICTION = 0.5  # where the map holds none; written into the file as assumed


@dataclass(frozen=True, eq=False)
class Patches:
    """Rectangles of a plane, or squares that stand for a mesh's faces, and what each is made of.

    Attributes:
        centres: base frame [m], (k, 3). axes: rows tangent1, tangent2, normal of each, (k, 3, 3). half: half sides [m],
            (k, 2).
        values: stiffness, damping, friction, (k, 3); NaN where the map holds none. cells: row and column of each, (k,
            2).
        shape: of the grid; (0, 0) on a mesh. assumed: roles that the map doesn't hold.
    """

    centres: Array
    axes: Array
    half: Array
    values: Array
    cells: NDArray[np.int64]
    shape: tuple[int, int]
    assumed: tuple[str, ...]

    @property
    def thick(self) -> float:
        """Of the boxes [m]: on a mesh no more than they are wide, so that they don't come out of its other side."""
        return THICK if self.shape != (0, 0) else min(THICK, 2.0 * float(np.median(self.half)))


def patches(grown: PropertyMap, cells: int = CELLS, method: str = "gp") -> Patches:
    """Patches of what a map knows; unknown places get none. On a mesh one stands for each face, of its area.

    Raises:
        InputError: a map without stiffness, or a mesh of too many faces.
    """
    names = [p.name for p in grown.properties]
    if "stiffness" not in names:
        raise InputError(f"a map of {', '.join(names)}", "one that holds stiffness", "map with a model that has one")
    known_roles = [role in names and bool(np.isfinite(grown.values(role)).any()) for role in ROLES]
    assumed = tuple(role for role, there in zip(ROLES, known_roles) if not there)
    if isinstance(grown.surface, Mesh):
        return _of_faces(grown, grown.surface, known_roles, assumed, method)
    edges = grown.grid(cells)
    ticks = (0.5 * (edges[0][1:] + edges[0][:-1]), 0.5 * (edges[1][1:] + edges[1][:-1]))
    half = np.array([0.5 * (edges[0][1] - edges[0][0]), 0.5 * (edges[1][1] - edges[1][0])])
    fields, known = [], np.ones((len(ticks[0]), len(ticks[1])), np.bool_)
    for role, there in zip(ROLES, known_roles):
        if there:
            guess = grown.over_grid(role, ticks, method)
            fields.append(np.maximum(guess.mean, 0.0))
            known &= guess.known
        else:
            fields.append(np.full(known.shape, np.nan))
    if not known.any():
        raise InputError(
            "a map that knows no whole patch between its probes",
            "probes near enough to each other to tell what lies between",
            "poke more closely, or export with --method nearest",
        )
    rows, columns = np.nonzero(known)
    flat = np.column_stack([ticks[0][rows], ticks[1][columns]])
    return Patches(
        grown.raised(flat),
        np.tile(grown.surface.axes, (len(rows), 1, 1)),
        np.tile(half, (len(rows), 1)),
        np.column_stack([f[rows, columns] for f in fields]),
        np.column_stack([rows, columns]),
        (len(ticks[0]), len(ticks[1])),
        assumed,
    )


def cells_of(grown: PropertyMap, cell: float) -> int:
    """Cells along the longer side of a map on a plane for patches no smaller than `cell` [m].

    Raises:
        InputError: a mesh, whose patches are its faces; a size that is none, or that leaves fewer than two patches.
    """
    if isinstance(grown.surface, Mesh):
        raise InputError(
            f"patches of {cell} m on a mesh",
            "a plane; a mesh has a patch for each of its faces",
            "leave the size out, or remesh the surface",
        )
    ticks = grown.grid(2)
    side = max(float(np.ptp(t)) for t in ticks)
    if not (np.isfinite(cell) and 0 < cell <= 0.5 * side):
        raise InputError(
            f"patches of {cell} m",
            f"more than 0, up to half the map's longer side, {0.5 * side:.3g} m",
            "correct it, or map more of the surface",
        )
    count, most = float(np.prod([np.ptp(t) / cell for t in ticks])), size_limit(MOST_PATCHES)
    if count > most:
        raise InputError(
            f"patches of {cell} m, which are {count:.3g} of them",
            f"{most:.6g} patches at most, {np.sqrt(count / most) * cell:.2g} m wide here",
            f"make them wider, {raised(count, MOST_PATCHES)}",
        )
    # the shorter side is cut into a whole number of cells too, which may be smaller: one less along the longer side
    # mends it
    for count in range(int(side / cell + 1e-9), 1, -1):
        if min(float(np.min(np.diff(t))) for t in grown.grid(count)) >= cell * (1 - 1e-9):
            return count
    return 2


def _of_faces(
    grown: PropertyMap, mesh: Mesh, known_roles: list[bool], assumed: tuple[str, ...], method: str
) -> Patches:
    """A square for each face whose corners are all known, of its area, at its middle, lying in it."""
    if (count := len(mesh.faces)) > (most := size_limit(MOST_FACES)):
        mend = f"export a coarser mesh, {raised(count, MOST_FACES)}"
        raise InputError(f"a mesh of {count} faces", f"{most:.6g} at most, a patch each", mend)
    corner = mesh.vertices[mesh.faces]  # (k, 3, 3)
    along = corner[:, 1] - corner[:, 0]
    normal = np.cross(along, corner[:, 2] - corner[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    fields = np.full((len(corner), len(ROLES)), np.nan)
    known = area > 0
    for k, (role, there) in enumerate(zip(ROLES, known_roles)):
        if there:
            guess = grown.interpolator(role, method).at(np.arange(len(mesh.vertices), dtype=np.int64))
            fields[:, k] = np.maximum(guess.mean[mesh.faces].mean(axis=1), 0.0)
            known &= guess.known[mesh.faces].all(axis=1)
    if not known.any():
        raise InputError(
            "a map that knows no whole face", "probes that reach one at least", "poke more, or refine the mesh"
        )
    t1 = along[known] / np.linalg.norm(along[known], axis=1, keepdims=True)
    n = normal[known] / (2 * area[known, None])
    half = np.repeat(0.5 * np.sqrt(area[known])[:, None], 2, axis=1)
    number = np.flatnonzero(known)
    return Patches(
        corner[known].mean(axis=1),
        np.stack([t1, np.cross(n, t1), n], axis=1),
        half,
        fields[known],
        np.column_stack([number, np.zeros_like(number)]),
        (0, 0),
        assumed,
    )


def to_mujoco(made: Patches, effective_mass: float = EFFECTIVE_MASS) -> str:
    """MuJoCo XML: a static box a patch; the stiffness acts on a body of `effective_mass` [kg]."""
    root = ET.Element("mujoco", model="property map")
    ET.SubElement(root, "compiler", angle="radian")
    ET.SubElement(root, "option", timestep="0.0005", cone="elliptic")
    body = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name="surface")
    share, quats = (1.0 - IMPEDANCE) / effective_mass, _quaternions(made.axes)
    middles = made.centres - 0.5 * made.thick * made.axes[:, 2]
    for i, (centre, quat, half, (k, c, mu)) in enumerate(zip(middles, quats, made.half, made.values)):
        damping = 0.0 if np.isnan(c) else c
        friction = FRICTION if np.isnan(mu) else mu
        ET.SubElement(
            body,
            "geom",
            name=f"patch_{i}",
            type="box",
            pos=_text(centre),
            quat=_text(quat),
            size=_text([*half, 0.5 * made.thick]),
            friction=f"{friction:.6g} 0.005 0.0001",
            priority="1",
            # both negative says that the form is the direct one, and so an undamped one isn't allowed
            solref=f"{-k * share:.9g} {-max(damping * share, 1e-3):.9g}",
            solimp=f"{IMPEDANCE} {IMPEDANCE} 0.001",
        )
    if made.shape != (0, 0):
        ET.SubElement(body, "geom", _floor(made))
    ET.SubElement(ET.SubElement(root, "custom"), "numeric", name="effective_mass", data=f"{effective_mass:.9g}")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _floor(made: Patches) -> dict[str, str]:
    """A rigid box under all patches of a plane, as thick as they are."""
    axes, middle = made.axes[0], made.centres.mean(axis=0)
    flat = (made.centres - middle) @ axes[:2].T
    low, high = (flat - made.half).min(axis=0), (flat + made.half).max(axis=0)
    centre = middle + 0.5 * (low + high) @ axes[:2] - 1.5 * made.thick * axes[2]
    return {
        "name": "floor",
        "type": "box",
        "pos": _text(centre),
        "quat": _text(_quaternions(axes[None])[0]),
        "size": _text([*(0.5 * (high - low)), 0.5 * made.thick]),
    }


def to_sdf(made: Patches) -> str:
    """SDF 1.9 for Gazebo: a static model with a collision a patch."""
    root = ET.Element("sdf", version="1.9")
    model = ET.SubElement(root, "model", name="property_map")
    ET.SubElement(model, "static").text = "true"
    link = ET.SubElement(model, "link", name="surface")
    middles, turns = made.centres - 0.5 * made.thick * made.axes[:, 2], _rpy(made.axes)
    for i, (centre, turn, half, (k, c, mu)) in enumerate(zip(middles, turns, made.half, made.values)):
        collision = ET.SubElement(link, "collision", name=f"patch_{i}")
        ET.SubElement(collision, "pose").text = _text([*centre, *turn])
        box = ET.SubElement(ET.SubElement(collision, "geometry"), "box")
        ET.SubElement(box, "size").text = _text([*(2 * half), made.thick])
        surface = ET.SubElement(collision, "surface")
        ode = ET.SubElement(ET.SubElement(surface, "contact"), "ode")
        ET.SubElement(ode, "kp").text = f"{k:.9g}"
        ET.SubElement(ode, "kd").text = f"{0.0 if np.isnan(c) else c:.9g}"
        rub = ET.SubElement(ET.SubElement(surface, "friction"), "ode")
        for name in ("mu", "mu2"):
            ET.SubElement(rub, name).text = f"{FRICTION if np.isnan(mu) else mu:.9g}"
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def to_gltf(made: Patches, role: str = "stiffness") -> bytes:
    """GlTF 2.0, binary: the patches as quads with vertex colours by one property, y up as the format has it."""
    column = ROLES.index(role)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    offset = np.einsum("ci,ki,kij->kcj", corners, made.half, made.axes[:, :2])
    points = (made.centres[:, None, :] + offset).reshape(-1, 3)
    points = np.column_stack([points[:, 0], points[:, 2], -points[:, 1]]).astype("<f4")
    quad = np.array([0, 1, 2, 0, 2, 3])
    index = (np.arange(len(made.centres))[:, None] * 4 + quad).ravel().astype("<u4")
    v = made.values[:, column]
    low, high = float(np.nanmin(v)), float(np.nanmax(v))
    grey = np.repeat((v - low) / (high - low if high > low else 1.0), 4)
    colour = np.column_stack([grey, 0.35 + 0.3 * (1 - grey), 1 - grey, np.ones(len(grey))]).astype("<f4")
    blobs = [points.tobytes(), colour.tobytes(), index.tobytes()]
    views, at = [], 0
    for blob, target in zip(blobs, (34962, 34962, 34963)):
        views.append({"buffer": 0, "byteOffset": at, "byteLength": len(blob), "target": target})
        at += len(blob)
    accessors = [
        {
            "bufferView": 0,
            "componentType": 5126,
            "count": len(points),
            "type": "VEC3",
            "min": points.min(axis=0).tolist(),
            "max": points.max(axis=0).tolist(),
        },
        {"bufferView": 1, "componentType": 5126, "count": len(points), "type": "VEC4"},
        {"bufferView": 2, "componentType": 5125, "count": len(index), "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}
    document = {
        "asset": {"version": "2.0", "generator": "kinid"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "property map"}],
        "meshes": [{"primitives": [primitive], "extras": {"property": role, "low": low, "high": high}}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}, "doubleSided": True}],
        "buffers": [{"byteLength": at}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(blobs)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


def export(grown: PropertyMap, folder: Path, cells: int = CELLS, method: str = "gp") -> list[Path]:
    """All of them, into a folder: map.xml, map.sdf, map.glb, map.json, and on a plane a PNG a property; the paths.

    On a mesh the JSON holds the numbers by face.

    Raises:
        InputError: as `patches`, or a folder that can't be written to.
    """
    made = patches(grown, cells, method)
    with made_folder(folder):
        out = [folder / name for name in ("map.xml", "map.sdf", "map.glb", "map.json")]
        write_text(out[0], to_mujoco(made))
        write_text(out[1], to_sdf(made))
        write_bytes(out[2], to_gltf(made))
        about: Json = {"assumed": {role: FRICTION if role == "friction" else 0.0 for role in made.assumed}}
        about["alone"] = {
            "tip_radius": float(made.half.min()),
            "unit": "m",
            "means": "a tip up to this radius, on the middle of a patch, feels that patch alone; a wider one feels "
            "several, and their stiffnesses add up",
            "deepest": float(min(made.half.min(), 0.5 * made.thick)),
            "deepest_means": "a round tip pressed deeper than its radius and this goes aside, not out",
        }
        roles = {k: role for k, role in enumerate(ROLES) if role not in made.assumed}
        units = {role: grown.properties[grown.index(role)].unit for role in roles.values()}
        if isinstance(grown.surface, Mesh):
            about |= {
                "faces": made.cells[:, 0].tolist(),
                "centres": made.centres.tolist(),
                "normals": made.axes[:, 2].tolist(),
                "properties": {
                    role: {"unit": units[role], "values": made.values[:, k].tolist()} for k, role in roles.items()
                },
            }
        else:
            about |= {
                "frame": {"origin": made.centres.mean(axis=0).tolist(), "axes": made.axes[0].tolist()},
                "cell": (2 * made.half[0]).tolist(),
                "rows": "along tangent 1",
                "columns": "along tangent 2",
                "properties": {},
            }
            for k, role in roles.items():
                field = np.full(made.shape, np.nan)
                field[tuple(made.cells.T)] = made.values[:, k]
                low, high = float(np.nanmin(field)), float(np.nanmax(field))
                path = folder / f"{role}.png"
                write_bytes(path, to_png(field, low, high))
                out.append(path)
                about["properties"][role] = {
                    "image": path.name,
                    "unit": units[role],
                    "low": low,
                    "high": high,
                    "value": "low + (grey − 1)/65534 · (high − low); grey 0 is unknown",
                }
        write_json(out[3], about)
        return out


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(v):.9g}" for v in values)


def _quaternions(axes: Array) -> Array:
    """(w, x, y, z) of the rotations whose columns are tangent1, tangent2, normal, for rows of them (k, 3, 3), (k,
    4).
    """
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(np.swapaxes(axes, 1, 2)).as_quat()[:, [3, 0, 1, 2]])


def _rpy(axes: Array) -> Array:
    """Roll, pitch, yaw about fixed axes [rad] of the same rotations, (k, 3)."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where roll and yaw turn about one axis, any share between them is right
        return np.asarray(Rotation.from_matrix(np.swapaxes(axes, 1, 2)).as_euler("ZYX")[:, ::-1])
