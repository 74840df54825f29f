"""Where the tip goes: spots of a surface, ways down, along and between them, with the tool upright on the surface.

Base frame, m. The tool's z axis points into the material.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.planning.course import line_nodes
from kinid.planning.touches import Poke, Touch
from kinid.robotics.surface import Plane, Surface

Array = NDArray[np.float64]

#: a path over a mesh: distance of its points, and over which their normals are smoothed [m]
MESH_STEP, SMOOTH = 0.002, 0.004
#: a point named on a mesh may be so far off it [m]
OFF = 0.02
#: how far from the tip the point of the tool is whose way counts where it turns on the spot [m]
LEVER = 0.1


@dataclass(frozen=True, eq=False)
class Spot:
    """A point of the surface and its outward normal, (3,) each; how the tool is tilted there, about both tangents
    [rad].
    """

    point: Array
    normal: Array
    tilt: tuple[float, float] = (0.0, 0.0)

    def above(self, height: float) -> Array:
        """The point a height [m] above it."""
        return np.asarray(self.point + height * self.normal)


@dataclass(frozen=True, eq=False)
class Frames:
    """Rotations of an upright tool that turn as little as possible from place to place.

    Attributes:
        tangent: direction that the tool's x axis is opposed to, before the yaw, (3,).
        yaw: about the tool's axis [rad].
    """

    tangent: Array
    yaw: float

    def __init__(self, normal: Array, surface: Surface, yaw: float) -> None:
        tangent = surface.axes[0] if isinstance(surface, Plane) else _across(normal)
        object.__setattr__(self, "tangent", tangent)
        object.__setattr__(self, "yaw", float(yaw))

    def rotation(self, normal: Array) -> Array:
        """Columns are the tool's axes in the base frame, (3, 3)."""
        t = self.tangent - (self.tangent @ normal) * normal
        size = np.linalg.norm(t)
        if size < 0.2:
            raise InputError(
                "a path over a mesh whose normal turns by nearly a right angle",
                "a patch that faces one way",
                "plan it in parts",
            )
        t = t / size
        s = np.cross(normal, t)
        c, d = np.cos(self.yaw), np.sin(self.yaw)
        base = np.stack([-t, s, -normal], axis=1)
        out: Array = base @ np.array([[c, -d, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]])
        return out

    def at(self, spot: Spot) -> Array:
        """The same above a spot, the tool tilted about its tip as is asked for there."""
        upright = self.rotation(spot.normal)
        if not any(spot.tilt):
            return upright
        from scipy.spatial.transform import Rotation

        first = self.tangent - (self.tangent @ spot.normal) * spot.normal
        first /= np.linalg.norm(first)
        about = spot.tilt[0] * first + spot.tilt[1] * np.cross(spot.normal, first)
        out: Array = Rotation.from_rotvec(about).as_matrix() @ upright
        return out


Poses = tuple[Array, Array, Array]  # lengths (k,), positions (k, 3), rotations (k, 3, 3)


def spots(surface: Surface, touch: Touch, height: float) -> list[Spot]:
    """The spots of a touch's corners.

    Raises:
        InputError: two numbers on a mesh, three off it, or a surface above which there is no air.
    """
    out, tilt = [], touch.tilt if isinstance(touch, Poke) else (0.0, 0.0)
    for place in touch.corners:
        if isinstance(surface, Plane):
            if len(place) != 2:
                raise InputError(
                    f"the place {place} on a plane", "two numbers, along its tangents [m]", "leave one out"
                )
            out.append(
                Spot(surface.point + place[0] * surface.axes[0] + place[1] * surface.axes[1], surface.normal, tilt)
            )
            continue
        if len(place) != 3:
            raise InputError(f"the place {place} on a mesh", "a point in the base frame, three numbers [m]", "add one")
        found = surface.locate(np.array([place]))
        if np.abs(found.depth[0]) > OFF:
            raise InputError(
                f"the place {place}, {1e3 * abs(found.depth[0]):.0f} mm off the mesh", "a point on it", "move it there"
            )
        spot = Spot(found.closest[0], found.axes[0, 2], tilt)
        up = surface.locate(spot.above(height)[None, :]).depth[0]
        if up > -0.5 * height:
            raise InputError(
                f"the place {place}, above which the mesh leaves {-1e3 * up:.1f} mm of air",
                f"{1e3 * height:g} mm",
                "choose a place in the open, or a smaller --height",
            )
        out.append(spot)
    return out


def down(spot: Spot, height: float, deepest: float, frames: Frames) -> Poses:
    """From above a spot straight into the material."""
    nodes = line_nodes(height + deepest)
    positions = spot.above(height) - nodes[:, None] * spot.normal
    return nodes, positions, np.broadcast_to(frames.at(spot), (len(nodes), 3, 3))


def travel(a: Spot, b: Spot, frames: Frames, height: float) -> Poses:
    """Straight through the air from above one spot to above another, the tool turning evenly."""
    start, end = a.above(height), b.above(height)
    first, last = frames.at(a), frames.at(b)
    # a turn on the spot counts as a way, too: that of a point of the tool
    angle = float(np.arccos(np.clip(0.5 * (np.trace(first.T @ last) - 1.0), -1.0, 1.0)))
    length = max(float(np.linalg.norm(end - start)), LEVER * angle if angle > 1e-6 else 0.0)
    nodes = line_nodes(length)
    positions = start + (nodes / max(length, 1e-12))[:, None] * (end - start)
    if np.abs(first - last).max() < 1e-12:
        return nodes, positions, np.broadcast_to(first, (len(nodes), 3, 3))
    from scipy.spatial.transform import Rotation, Slerp

    turn = Slerp([0.0, max(length, 1e-12)], Rotation.from_matrix(np.stack([first, last])))
    return nodes, positions, turn(np.minimum(nodes, length)).as_matrix()


def leg(surface: Surface, a: Spot, b: Spot, depth: float, frames: Frames) -> Poses:
    """Along the surface from one spot to another at a depth; on a mesh above the straight line, smoothed."""
    if isinstance(surface, Plane):
        start, end = a.above(-depth), b.above(-depth)
        nodes = line_nodes(float(np.linalg.norm(end - start)))
        positions = start + (nodes / nodes[-1])[:, None] * (end - start)
        return nodes, positions, np.broadcast_to(frames.rotation(a.normal), (len(nodes), 3, 3))
    chord = float(np.linalg.norm(b.point - a.point))
    u = np.linspace(0.0, 1.0, max(13, 1 + int(np.ceil(chord / MESH_STEP))))
    found = surface.locate(a.point + u[:, None] * (b.point - a.point))
    if np.abs(found.depth).max() > OFF:
        raise InputError(
            f"a slide whose straight line lies {1e3 * np.abs(found.depth).max():.0f} mm off the mesh",
            "corners between which the surface is nearly straight",
            "add corners",
        )
    normals = _smoothed(found.axes[:, 2], u * chord)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = _smoothed(found.closest, u * chord)
    normals[0], normals[-1], points[0], points[-1] = a.normal, b.normal, a.point, b.point
    positions = points - depth * normals
    nodes = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    return nodes, positions, np.stack([frames.rotation(n) for n in normals])


def in_surface(surface: Surface, t: Array, points: Array, velocities: Array) -> tuple[Array, Array, Array]:
    """slip1, slip2, depth [m] of points, their rates [m/s], both (n, 3), and the surface's axes there, (n, 3, 3).

    On a mesh, where no two coordinates cover a surface, the slips are the way travelled along the local tangents.
    """
    found = surface.locate(points)
    rates = np.einsum("nij,nj->ni", found.axes, velocities)
    rates[:, 2] = -np.einsum("nj,nj->n", found.gradient, velocities)
    place = np.empty_like(rates)
    place[:, 2] = found.depth
    if isinstance(surface, Plane):
        place[:, :2] = (points - surface.point) @ surface.axes[:2].T
    else:
        step = np.diff(t)[:, None] * 0.5 * (rates[1:, :2] + rates[:-1, :2])
        place[:, :2] = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return place, rates, found.axes


def _smoothed(values: Array, s: Array) -> Array:
    """A Gaussian average of `SMOOTH` over values (k, 3) at lengths s (k,), its weights cut off and renewed at the
    ends.
    """
    weight = np.exp(-0.5 * ((s[:, None] - s[None, :]) / SMOOTH) ** 2)
    # mirrored about each end, so that it isn't drawn inwards there
    near = np.minimum(s, s[-1] - s)[:, None]
    weight[np.abs(s[:, None] - s[None, :]) > near + 1e-12] = 0.0
    out: Array = (weight / weight.sum(axis=1, keepdims=True)) @ values
    return out


def _across(normal: Array) -> Array:
    """The base axis x, or y where the normal is near it."""
    return np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
