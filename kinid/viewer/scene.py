"""What the viewer shows, as plain data: the robot's shapes and motion, forces at the tip, the surface in colours."""

from __future__ import annotations

import base64
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import kinid.urdf
from kinid.contact.series import ContactSeries, contact_series, tip_motion
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import KinidError
from kinid.estimators.estimate import NORMAL_95
from kinid.mapping.interpolation import METHOD_WORDS
from kinid.mapping.map_page import colour_range
from kinid.mapping.property_map import PropertyMap
from kinid.modeling.model import Model
from kinid.residuals.words import number
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane
from kinid.robotics.surface import load as load_surface
from kinid.robotics.urdf_model import off_screen
from kinid.writers import Json

Array = NDArray[np.float64]

#: frames a second of a log that are shown
FRAMES = 50.0
#: the largest force is drawn so long [m]
ARROW = 0.16
#: viridis at seven places: dark is low, also to colour-blind readers and in grey
VIRIDIS = np.array(
    [[68, 1, 84], [68, 57, 131], [49, 104, 142], [33, 145, 140], [53, 183, 121], [144, 215, 67], [253, 231, 37]]
)
INFERNO = np.array(
    [[0, 0, 4], [51, 10, 95], [120, 28, 109], [188, 55, 84], [237, 105, 37], [251, 180, 26], [252, 255, 164]]
)
UNKNOWN = (214, 217, 222, 255)
#: layer that shows where the model fails
FAILS = "model fails"
#: sizes of the shapes that are drawn, of Pinocchio's geometries by their names [m]
SIZES: dict[str, Callable[..., list[float]]] = {
    "box": lambda box: (2 * np.asarray(box.halfSide)).tolist(),
    "cylinder": lambda cylinder: [cylinder.radius, 2 * cylinder.halfLength],
    "sphere": lambda sphere: [sphere.radius],
}
#: opacity where a value is sure, and where its deviation is as large as the values' spread
SURE, UNSURE = 1.0, 0.25


def map_scene(
    grown: PropertyMap, *, shown: str | None = None, method: str = "gp", cells: int = 100, shape: bool = True
) -> Json:
    """A map's colours by property; with `shape` its vertices and faces too.

    Args:
        grown: the map. shown: property that is shown first. method: between probes. cells: along the longer side of a
            plane.
    """
    if isinstance(grown.surface, Plane):
        ticks = grown.grid(cells)
        x, y = np.meshgrid(*ticks, indexing="ij")
        flat = np.column_stack([x.ravel(), y.ravel()])
        queries: Array | NDArray[np.int64] = flat
        vertices = grown.raised(flat)
        faces = _quads(*x.shape)
        size = 0.05 * float(np.hypot(*np.ptp(queries, axis=0))) / max(3.0, np.sqrt(len(grown)))
    else:
        vertices, faces = grown.surface.vertices, grown.surface.faces
        queries = np.arange(len(vertices), dtype=np.int64)
        size = 0.004 * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    layers = []
    for item in grown.properties:
        values = grown.values(item.name)
        if not np.isfinite(values).any():
            continue
        guess = grown.interpolator(item.name, method).at(queries)
        low, high = colour_range(grown, item.name)
        spread = float(np.nanstd(values)) or abs(high) or 1.0
        doubt = np.nan_to_num(guess.sd / spread, nan=0.0)
        layers.append(
            _layer(item.name, item.unit, guess.mean, low, high, VIRIDIS, doubt, bool(np.isfinite(guess.sd).any()))
        )
    residual_over_noise = grown.residual_over_noise
    if np.isfinite(residual_over_noise).any():
        # of the nearest probe: a residual belongs to a place, nothing is guessed between
        from scipy.spatial import cKDTree

        finite = np.isfinite(residual_over_noise)
        near = cKDTree(grown.places[finite]).query(vertices)[1]
        known = grown.interpolator(grown.properties[0].name, "nearest").at(queries).known
        field = np.where(known, np.log10(np.maximum(residual_over_noise[finite][near], 1.0)), np.nan)
        layer = _layer(FAILS, "residual / noise", field, 0.0, 1.5, INFERNO, np.zeros(len(field)), False)
        layers.append(layer | {"low": "1", "high": "30"})
    out: Json = {
        "vertices": len(vertices),
        "layers": layers,
        "shown": shown or layers[0]["name"],
        "probes": packed(grown.places, "<f4"),
        "size": size,
        "probe_words": _probe_words(grown),
        "facts": f"{grown.words}; between them: {METHOD_WORDS[method]}",
    }
    if shape:
        out |= {"positions": packed(vertices, "<f4"), "faces": packed(faces, "<u4")}
    return out


def _probe_words(grown: PropertyMap) -> list[str]:
    """What each probe measured, in words."""
    flat = 1e3 * grown.flat(grown.places) if isinstance(grown.surface, Plane) else None
    known = [item for item in grown.properties if np.isfinite(grown.values(item.name)).any()]
    columns = [(item, grown.values(item.name), NORMAL_95 * grown.deviations(item.name)) for item in known]
    out = []
    for i, residual_over_noise in enumerate(grown.residual_over_noise):
        said = [
            f"{item.name} "
            + (f"{values[i]:.4g} ± {half[i]:.2g} {item.unit} (95 %)" if np.isfinite(values[i]) else "unknown")
            for item, values, half in columns
        ]
        said += [f"residual {residual_over_noise:.3g} times the noise"] if np.isfinite(residual_over_noise) else []
        place = "" if flat is None else f" at ({number(flat[i, 0])}, {number(flat[i, 1])}) mm"
        out.append(f"Probe{place}: {', '.join(said)}")
    return out


def layers_of(grown: PropertyMap) -> list[str]:
    """Names of what a map can be coloured by: the properties that some probe tells, and where the model fails."""
    names = [item.name for item in grown.properties if np.isfinite(grown.values(item.name)).any()]
    return [*names, FAILS] if np.isfinite(grown.residual_over_noise).any() else names


def robot_scene(rig: Rig, robot: Robot) -> Json:
    """The robot's shapes by joint, each with its place in the joint's frame; sticks where a URDF holds meshes only."""
    assert rig.robot is not None
    path = kinid.urdf.path(rig.robot.model, rig.folder)
    joints: list[list[Json]] = [[] for _ in range(robot.model.njoints)]
    try:
        with off_screen():
            shapes = pin.buildGeomFromUrdf(robot.model, str(path), pin.GeometryType.VISUAL).geometryObjects
    except (ValueError, RuntimeError):  # meshes that aren't where the URDF says
        shapes = []
    for item in shapes:
        kind = type(item.geometry).__name__.lower()
        if kind in SIZES:
            color = np.asarray(item.meshColor).tolist()
            joints[item.parentJoint].append(_shape(kind, SIZES[kind](item.geometry), color, item.placement.homogeneous))
    if not any(joints[1:]):
        for j in range(1, robot.model.njoints):
            joints[robot.model.parents[j]].append(_stick(np.asarray(robot.model.jointPlacements[j].translation)))
            joints[j].append(_shape("sphere", [0.04], [0.2, 0.21, 0.23, 1], np.eye(4)))
    if robot.tip_frame is not None:
        tip = robot.frame(robot.tip_frame)
        if not shapes or robot.sensor_frame is None:
            joints[tip.parentJoint].append(_stick(np.asarray(tip.placement.translation)))
    return {"joints": joints, "zero": packed(joint_poses(robot, pin.neutral(robot.model)), "<f4")}


def joint_poses(robot: Robot, configuration: Array) -> Array:
    """Places [m] and quaternions of all joints in the base frame, (N + 1, 7)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    return np.array([pin.SE3ToXYZQUAT(pose) for pose in data.oMi])


def motion_scene(log: Log, rig: Rig, robot: Robot, model: str | None = None) -> Json:
    """The arm's motion through a log at some 50 frames a second, and the forces at its tip, measured and predicted."""
    assert log.q is not None
    keep = np.flatnonzero(np.isfinite(log.q).all(axis=1))
    step = max(1, round(1.0 / (FRAMES * log.period))) if log.period > 0 else 1
    keep = keep[::step]
    configuration = robot.configuration(log.q[keep])
    poses = np.array([joint_poses(robot, row) for row in configuration]).reshape(len(keep), robot.model.njoints, 7)
    out: Json = {
        "t": packed(log.t[keep] - log.t[keep[0]], "<f4"),
        "poses": packed(poses, "<f4"),
        "n": len(keep),
        "joints": robot.model.njoints,
    }
    if log.phase is not None:
        out["phase"] = np.asarray(log.phase)[keep].tolist()
    forces = _forces(log, rig, robot, model)
    if forces:
        out["tip"] = packed(np.nan_to_num(forces.pop("tip")[keep]), "<f4")
        largest = np.nanquantile(np.linalg.norm(forces["measured"], axis=1), 0.999)
        out["scale"] = float(ARROW / max(largest, 0.1))
        out |= {name: packed(np.nan_to_num(vectors[keep]), "<f4") for name, vectors in forces.items()}
    return out


def _forces(log: Log, rig: Rig, robot: Robot, model: str | None) -> dict[str, Array]:
    """Tip (n, 3) [m], measured and predicted force on it in base axes (n, 3) [N]; empty without a wrench."""
    if log.wrench is None or robot.tip_frame is None:
        return {}
    motion = tip_motion(log, rig, robot=robot)
    if motion.force is None:
        return {}
    out = {"tip": motion.position, "measured": motion.force}
    try:
        surface = load_surface(rig)
        if surface is None:
            return out
        touch = contact_series(log, rig, robot=robot)
        axes = surface.locate(motion.position).axes
        parts = np.stack([touch.tangential_force1, touch.tangential_force2, touch.normal_force], axis=1)
        out["measured"] = np.where(touch.in_contact[:, None], np.einsum("ni,nij->nj", parts, axes), 0.0)
        out["predicted"] = np.einsum("ni,nij->nj", _predicted(touch, model), axes)
    except KinidError:  # a log that can't carry a model is shown without a prediction
        pass
    return out


def _predicted(touch: ContactSeries, model: str | None) -> Array:
    """Tangential and normal forces of a fitted model, (n, 3)."""
    slid = np.ptp(np.hypot(touch.slip1, touch.slip2)[touch.in_contact]) if touch.in_contact.any() else 0.0
    names = model.split(",") if model else ["kelvin-voigt", *(["coulomb-friction"] if slid > 1.5e-3 else [])]
    fit = Model(*names).fit(touch, held_out=False)
    out = np.zeros((len(touch), 3))
    column = {"tangential_force1": 0, "tangential_force2": 1, "normal_force": 2}
    for name, row in zip(fit.experiment.layout.channels, fit.predict()):
        if name in column:
            out[fit.experiment.rows, column[name]] = row
    out[~touch.in_contact] = 0.0
    return out


def patch_scene(rig: Rig, side: float = 0.12) -> Json | None:
    """A block under the surface's point; None for a mesh or without a surface."""
    surface = load_surface(rig)
    if not isinstance(surface, Plane):
        return None
    return _block(surface, np.full(2, -0.5 * side), np.full(2, 0.5 * side), 0.0)


def map_patch(grown: PropertyMap, ground_height: float) -> Json | None:
    """A block under all of a map on a plane, that stands on a ground at this height [m]; None on a mesh."""
    if not isinstance(grown.surface, Plane):
        return None
    low, high = _extent(grown)
    edge = 0.06 * float((high - low).max())
    return _block(grown.surface, low - edge, high + edge, ground_height)


def _block(surface: Plane, low: Array, high: Array, ground_height: float) -> Json:
    """From corner to corner along both tangents [m]; down to the ground where that is not far and the surface lies
    level.
    """
    side, height = float((high - low).max()), float(surface.point[2]) - ground_height
    level = surface.normal[2] > 0.99 and 0.05 * side < height < 3.0 * side
    thick = height if level else 0.25 * side
    matrix = np.eye(4)
    matrix[:3, :3] = surface.axes.T
    matrix[:3, 3] = surface.point + 0.5 * (low + high) @ surface.axes[:2] - (0.5 * thick + 4e-3 * side) * surface.normal
    return {"size": [*(high - low).tolist(), thick], "matrix": matrix.T.ravel().tolist()}


def axes_scene(grown: PropertyMap) -> Json | None:
    """Where the axes of a map on a plane run: its point, its axes, and its extent along both tangents [m]; None on a
    mesh.
    """
    if not isinstance(grown.surface, Plane):
        return None
    low, high = _extent(grown)
    facts = {"point": grown.surface.point, "axes": grown.surface.axes, "low": low, "high": high}
    return {name: values.tolist() for name, values in facts.items()}


def ground_scene(grown: PropertyMap) -> Json:
    """A level ground under a map that is seen without a robot: its middle [m], and the size of what stands on it
    [m].
    """
    if isinstance(grown.surface, Plane):
        low, high = _extent(grown)
        corners = grown.raised(np.array([[u, v] for u in (low[0], high[0]) for v in (low[1], high[1])]))
        below = 0.25 * float((high - low).max())
    else:
        corners, below = grown.surface.vertices, 0.0
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    return {"centre": [middle[0], middle[1], float(corners[:, 2].min()) - below - 2e-3 * size], "size": size}


def _extent(grown: PropertyMap) -> tuple[Array, Array]:
    """Lowest and highest coordinates of the coloured surface along both tangents [m]."""
    ticks = grown.grid(2)
    return np.array([t[0] for t in ticks]), np.array([t[-1] for t in ticks])


def views(grown: PropertyMap | None, arm: bool, moves: bool) -> list[Json]:
    """Cameras to choose from, the first one first: what each frames, its direction, and whether the arm is shown.

    Args:
        grown: a map, if any. arm: whether there is a robot. moves: whether a log moves it, with a force at its tip.
    """
    front = [0.72, -0.62, 0.55]
    out = []
    if arm:
        of = ["robot", "patch"] if grown is None else ["robot", "patch", "surface"]
        out.append({"name": "arm", "says": "all of the arm", "of": of, "away": front, "arm": True})
    if moves and grown is None:
        near = [front[0], front[1], 0.3]
        out.append({"name": "tip", "says": "the tool's tip and its forces", "of": ["tip"], "away": near, "arm": True})
    if grown is not None:
        plane = grown.surface if isinstance(grown.surface, Plane) else None
        normal = np.array([0.0, 0.0, 1.0]) if plane is None else plane.normal
        of = ["surface"] if plane is None else ["surface", "axes"]
        seen = {"name": "surface", "says": "the surface alone", "of": of, "away": _aside(plane), "arm": False}
        out.append(seen)
        # a trace to the side decides which way is up in the picture: the second tangent
        above = normal - 1e-3 * (np.array([0.0, 1.0, 0.0]) if plane is None else plane.axes[1])
        out.append(seen | {"name": "above", "says": "the surface from above", "of": of, "away": above.tolist()})
    return out


def _aside(plane: Plane | None) -> list[float]:
    """A direction from which a surface is seen as a whole, its axes in front."""
    if plane is None:
        return [0.72, -0.62, 0.55]
    t1, t2, normal = plane.axes
    away = 0.75 * normal + 0.35 * t1 - 0.62 * t2
    return (away + [0.0, 0.0, 0.25 if abs(normal[2]) < 0.5 else 0.0]).tolist()  # type: ignore[no-any-return]


def camera(target: Array, normal: Array, distance: float) -> Json:
    """From the front, above and a little to the side of what is looked at."""
    side = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    away = np.array([0.72, -0.62, 0.55]) if abs(normal[2]) > 0.9 else normal + 0.4 * side + np.array([0, 0, 0.4])
    return {"position": (target + distance * away / np.linalg.norm(away)).tolist(), "target": target.tolist()}


def packed(values: NDArray[np.generic], kind: str) -> str:
    """Numbers as base64 of their bytes."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def colours(field: Array, low: float, high: float, scale: NDArray[np.generic], doubt: Array) -> NDArray[np.uint8]:
    """RGBA of values, (n, 4); unknown ones in grey; the larger the doubt (deviation over spread), the more
    transparent.
    """
    place = np.clip((np.nan_to_num(field) - low) / (high - low if high > low else 1.0), 0.0, 1.0) * (len(scale) - 1)
    at = np.minimum(place.astype(int), len(scale) - 2)
    part = (place - at)[:, None]
    out = np.empty((len(field), 4))
    out[:, :3] = (1 - part) * scale[at] + part * scale[at + 1]
    out[:, 3] = 255 * (SURE + (UNSURE - SURE) * np.clip(doubt, 0.0, 1.0))
    out[~np.isfinite(field)] = UNKNOWN
    return np.asarray(np.round(out), dtype=np.uint8)


def _layer(
    name: str, unit: str, field: Array, low: float, high: float, scale: NDArray[np.generic], doubt: Array, fades: bool
) -> Json:
    stops = [f"rgb({r},{g},{b})" for r, g, b in scale.tolist()]
    return {
        "name": name,
        "unit": unit,
        "low": f"{low:.4g}",
        "high": f"{high:.4g}",
        "stops": stops,
        "fades": fades,
        "colors": packed(colours(field, low, high, scale, doubt), "u1"),
    }


def _quads(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles a cell of a grid, wound about the normal."""
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + columns, a + columns + 1, a + 1
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def _stick(end: Array) -> Json:
    """A cylinder from the origin to a point."""
    length = float(np.linalg.norm(end))
    matrix = np.eye(4)
    if length > 1e-9:
        z = end / length
        x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
        x /= np.linalg.norm(x)
        matrix[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    matrix[:3, 3] = end / 2
    return _shape("cylinder", [0.025, max(length, 1e-3)], [0.8, 0.81, 0.83, 1], matrix)


def _shape(kind: str, size: list[float], color: list[float], matrix: Array) -> Json:
    """A shape of one colour, where a homogeneous matrix (4, 4) puts it."""
    return {"kind": kind, "size": size, "color": color, "matrix": matrix.T.ravel().tolist()}
