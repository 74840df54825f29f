"""Whether the arm touches itself or the surface, by coal through Pinocchio.

What belongs to the touching end of the tool may enter the surface; nothing else may. A plane of a rig is endless, the
material isn't: it is taken to be a block below the plane around the places that are touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import kinid.urdf
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Mesh, Plane, Surface
from kinid.robotics.urdf_model import off_screen, parsed

if TYPE_CHECKING:
    import coal

Array = NDArray[np.float64]

#: kept free between shapes [m]. Postures that stand for others are so near them that no point of the arm differs by
#: more
CLEARANCE = 0.006
#: how far the material reaches beyond the places touched, and down [m]
BLOCK = (0.08, 0.05)


@dataclass(eq=False)
class Scene:
    """Shapes of the arm, and the surface where there is one.

    Attributes:
        robot: whose postures are checked. model, geometry: Pinocchio's, of the same joints.
        notes: what is not checked, for the user.
    """

    robot: Robot
    model: pin.Model
    geometry: pin.GeometryModel
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._data, self._found = self.model.createData(), self.geometry.createData()
        for request in self._found.collisionRequests:
            request.security_margin = CLEARANCE
        # a joint of one radian moves no point further than the arm is long
        self._reach = max(1.0, sum(float(np.linalg.norm(place.translation)) for place in self.model.jointPlacements))

    @classmethod
    def of(
        cls,
        robot: Robot,
        folder: Path,
        surface: Surface | None = None,
        *,
        places: Array | None = None,
        deepest: float = 0.0,
    ) -> Scene:
        """The scene of a robot and a surface.

        Args:
            robot: of a rig in `folder`. surface: touched, or None. places: touched, base frame [m], (k, 3), with a
                plane.
            deepest: how far the tip goes below the surface [m].
        """
        path = kinid.urdf.path(robot.name, folder)
        model, geometry = _shapes(robot, path)
        notes = (
            []
            if len(geometry.geometryObjects)
            else [f"{robot.name} has no collision shapes: collisions are not checked"]
        )
        count = len(geometry.geometryObjects)
        parents = [shape.parentJoint for shape in geometry.geometryObjects]
        pairs = [(a, b) for a in range(count) for b in range(a) if not _neighbours(model, parents[a], parents[b])]
        if surface is not None and count:
            shape, place = _block(surface, places)
            number = geometry.addGeometryObject(pin.GeometryObject("surface", 0, place, shape))
            tool = _touching(robot, model, geometry, deepest)
            pairs += [(a, number) for a in range(count) if a not in tool and parents[a] > 0]
            if isinstance(surface, Plane):
                notes.append(
                    f"the material is taken to be a block that reaches {BLOCK[0]:g} m beyond the places touched and "
                    f"{BLOCK[1]:g} m down"
                )
        for a, b in pairs:
            geometry.addCollisionPair(pin.CollisionPair(a, b))
        scene = cls(robot, model, geometry, tuple(notes))
        # shapes of other robots' links may overlap wherever the arm is; what touches in the middle of its range always
        # does
        lower, upper = (np.nan_to_num(v, posinf=0.0, neginf=0.0) for v in (robot.lower, robot.upper))
        always = (
            []
            if robot.name in kinid.urdf.shipped()
            else [pair for pair in scene._hits(0.5 * (lower + upper)) if max(pair) < count]
        )
        if always:
            for a, b in always:
                geometry.removeCollisionPair(pin.CollisionPair(a, b))
            notes.append(
                f"{len(always)} pairs of shapes of {robot.name} overlap in the middle of its range and are not checked"
            )
            scene = cls(robot, model, geometry, tuple(notes))
        return scene

    def check(self, q: Array, what: str = "the motion", depth: Array | None = None) -> int:
        """How many postures of a motion (n, N) were checked: those that stand for all others within the clearance.

        Args:
            q: joints. what: is checked, for the message. depth: of the tip below the surface [m], (n,), where it is
                known.

        Raises:
            InputError: which links touch, and where.
        """
        rows = representatives(q, CLEARANCE / self._reach)
        for row in rows.tolist():
            hits = self._hits(q[row])
            if hits:
                a, b = sorted((self._name(k) for k in hits[0]), key=lambda name: name == "surface")
                shown = ", ".join(f"{v:.2f}" for v in q[row])
                deep = b == "surface" and depth is not None and depth[row] > 0
                where = f" at a depth of {1e3 * depth[row]:.3g} mm and" if deep and depth is not None else " at"
                raise InputError(
                    f"{what}, in which {a} comes within {1e3 * CLEARANCE:g} mm of {b}{where} joints ({shown})",
                    "an arm that touches nothing but with its tip",
                    ("press less deep, " if deep else "")
                    + "move the surface, turn the tool with --yaw, or make the motion smaller",
                )
        return len(rows)

    def _hits(self, q: Array) -> list[tuple[int, int]]:
        if not len(self.geometry.collisionPairs):
            return []
        configuration = self.robot.configuration(q)[0]
        if not pin.computeCollisions(self.model, self._data, self.geometry, self._found, configuration, False):
            return []
        pairs = zip(self.geometry.collisionPairs, self._found.collisionResults)
        return [(pair.first, pair.second) for pair, result in pairs if result.isCollision()]

    def _name(self, number: int) -> str:
        shape = self.geometry.geometryObjects[number]
        return "surface" if shape.name == "surface" else str(self.model.frames[shape.parentFrame].name)


def representatives(q: Array, spread: float) -> NDArray[np.int64]:
    """Rows of q (n, N) such that each row has one of them within `spread`, in the sum of the joints' differences
    [rad].
    """
    left, kept, cell = np.arange(len(q)), [], 0.5 * spread
    while len(left):
        cells = np.round(q[left] / cell).astype(np.int64)
        moved = np.ones(len(left), dtype=np.bool_)
        moved[1:] = (cells[1:] != cells[:-1]).any(axis=1)
        runs = np.flatnonzero(moved)
        _, first, group = np.unique(cells[runs], axis=0, return_index=True, return_inverse=True)
        stand = left[runs[first]][group.reshape(-1)][np.cumsum(moved) - 1]
        kept.append(left[runs[first]])
        left = left[np.abs(q[left] - q[stand]).sum(axis=1) > spread]
        cell *= 0.5
    return np.sort(np.concatenate(kept)) if kept else np.zeros(0, dtype=np.int64)


def _shapes(robot: Robot, path: Path) -> tuple[pin.Model, pin.GeometryModel]:
    """Pinocchio's model and collision shapes of a URDF, its joints those of the robot."""
    full = parsed(path)
    folders = [str(parent) for parent in (path.parent, *path.parents[:5])]
    try:
        with off_screen():
            geometry = pin.buildGeomFromUrdf(full, str(path), pin.GeometryType.COLLISION, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"collision shapes of {robot.name} that can't be read ({str(error)[:120]})",
            "the meshes that its URDF names",
            "put them where the URDF says, or plan with --no-collision",
        ) from None
    locked = [j for j in range(1, full.njoints) if full.names[j] not in robot.joint_names]
    if locked:
        full, geometry = pin.buildReducedModel(full, geometry, locked, pin.neutral(full))
    return full, geometry


def _neighbours(model: pin.Model, a: int, b: int) -> bool:
    """Whether two joints carry the same link or links that a joint holds together."""
    return bool(a == b or model.parents[a] == b or model.parents[b] == a)


def _block(surface: Surface, places: Array | None) -> tuple[coal.CollisionGeometry, pin.SE3]:
    """The surface as a shape of coal, and where it stands."""
    import coal

    if isinstance(surface, Mesh):
        shape = coal.BVHModelOBBRSS()
        shape.beginModel(len(surface.faces), len(surface.vertices))
        shape.addVertices(surface.vertices)
        shape.addTriangles(np.asarray(surface.faces, dtype=np.int64))
        shape.endModel()
        return shape, pin.SE3.Identity()
    assert isinstance(surface, Plane)
    points = surface.point[None, :] if places is None or not len(places) else places
    flat = (points - surface.point) @ surface.axes.T
    low, high = flat[:, :2].min(axis=0) - BLOCK[0], flat[:, :2].max(axis=0) + BLOCK[0]
    centre = surface.point + np.append(0.5 * (low + high), -0.5 * BLOCK[1]) @ surface.axes
    return coal.Box(*map(float, high - low), BLOCK[1]), pin.SE3(np.ascontiguousarray(surface.axes.T), centre)


def _touching(robot: Robot, model: pin.Model, geometry: pin.GeometryModel, deepest: float) -> set[int]:
    """Shapes beside the tip, none of what it is mounted on, that are below the surface when the tip is deepest."""
    import coal

    tip = model.frames[model.getFrameId(robot.tip_frame)]
    link, shaped = model.getFrameId(robot.tip_frame), {shape.parentFrame for shape in geometry.geometryObjects}
    while link not in shaped and model.frames[link].parentFrame != link:
        link = model.frames[link].parentFrame
    carrying = set()
    while model.frames[link].parentFrame != link:
        link = model.frames[link].parentFrame
        carrying.add(link)
    out = set()
    probe = coal.Sphere(1e-6)
    request, where = coal.DistanceRequest(), coal.Transform3s(tip.placement.rotation, tip.placement.translation)
    for number, shape in enumerate(geometry.geometryObjects):
        if shape.parentFrame in carrying or shape.parentJoint != tip.parentJoint:
            continue
        place = coal.Transform3s(shape.placement.rotation, shape.placement.translation)
        if (
            coal.distance(shape.geometry, place, probe, where, request, coal.DistanceResult())
            <= max(deepest, 0.0) + CLEARANCE
        ):
            out.add(number)
    return out
