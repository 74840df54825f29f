"""Shapes of the shipped LWR4+: primitives only, as large as the real links, and free of self-collision."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from kinid import urdf

Array = NDArray[np.float64]
URDF = urdf.path("lwr4plus", Path.cwd())

# bounding box of each link in its frame [m], volume [L] and centroid [m] of its mesh:
# kjyv/FloBaRoID, model/meshes/kuka
ENVELOPES = {
    "base_link": ((-0.081, -0.081, 0), (0.081, 0.081, 0.102), 1.210, (0, 0, 0.0482)),
    "link_1": ((-0.060, -0.060, -0.008), (0.060, 0.094, 0.2605), 2.236, (0, 0.0240, 0.1131)),
    "link_2": ((-0.060, -0.094, -0.060), (0.060, 0.060, 0.1915), 2.236, (0, -0.0239, 0.0756)),
    "link_3": ((-0.060, -0.094, -0.008), (0.060, 0.060, 0.2605), 2.236, (0, -0.0240, 0.1131)),
    "link_4": ((-0.060, -0.060, -0.060), (0.060, 0.094, 0.1915), 2.236, (0, 0.0239, 0.0756)),
    "link_5": ((-0.060, -0.060, -0.008), (0.060, 0.094, 0.2505), 1.535, (0, 0.0216, 0.0812)),
    "link_6": ((-0.071, -0.080, -0.071), (0.071, 0.056, 0.057), 1.485, (0, -0.0045, -0.0029)),
    "link_7": ((-0.040, -0.040, -0.031), (0.040, 0.040, 0), 0.108, (0, 0, -0.0158)),
}

ORDINARY = (
    (0, 0, 0, 0, 0, 0, 0),
    (0, 30, 0, -60, 0, 60, 0),
    (0, -30, 0, 70, 0, -80, 0),
    (20, 45, -15, -90, 10, 60, 30),
    (-70, -40, 100, 75, -120, -80, 150),
    (90, 0, 0, -90, 0, 90, 0),
    (169, 119, -169, -119, 169, 119, -169),
)  # [deg]


@cache
def shapes() -> tuple[Any, Any]:
    model = pin.buildModelFromUrdf(str(URDF))
    geometry = pin.buildGeomFromUrdf(model, str(URDF), pin.GeometryType.COLLISION)
    geometry.addAllCollisionPairs()
    return model, geometry


def link_of(shape: Any) -> str:
    return str(shapes()[0].frames[shape.parentFrame].name)


def placed(link: str) -> list[tuple[Any, Array, Array]]:
    """Collision primitives of a link with rotation and position in the link's frame."""
    model, geometry = shapes()
    own = [shape for shape in geometry.geometryObjects if link_of(shape) == link]
    local = [model.frames[shape.parentFrame].placement.actInv(shape.placement) for shape in own]
    return [(shape.geometry, place.rotation, place.translation) for shape, place in zip(own, local)]


def bounds(link: str) -> tuple[Array, Array]:
    """Bounding box of a link's primitives; exact, as all of them stand along the axes."""
    corners = []
    for primitive, rotation, position in placed(link):
        primitive.computeLocalAABB()
        box = primitive.aabb_local
        corners += [rotation @ np.array(c) + position for c in product(*zip(box.min_, box.max_))]
    return np.min(corners, axis=0), np.max(corners, axis=0)


def inside(link: str, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 3) lie in one of the link's primitives."""
    import coal

    hit = np.zeros(len(points), dtype=bool)
    for primitive, rotation, position in placed(link):
        local = (points - position) @ rotation
        if isinstance(primitive, coal.Sphere):
            hit |= np.linalg.norm(local, axis=1) <= primitive.radius
        elif isinstance(primitive, coal.Cylinder):
            across = np.hypot(local[:, 0], local[:, 1]) <= primitive.radius
            hit |= across & (np.abs(local[:, 2]) <= primitive.halfLength)
        else:
            hit |= np.all(np.abs(local) <= primitive.halfSide, axis=1)
    return hit


def collisions(degrees: tuple[float, ...]) -> set[tuple[str, str]]:
    """Names of the links that collide; pairs rigidly joined are none in Pinocchio."""
    model, geometry = shapes()
    data, results = model.createData(), geometry.createData()
    pin.computeCollisions(model, data, geometry, results, np.radians(degrees), False)
    pairs = zip(geometry.collisionPairs, results.collisionResults)
    hit = [pair for pair, result in pairs if result.isCollision()]
    objects = geometry.geometryObjects
    return {(link_of(objects[pair.first]), link_of(objects[pair.second])) for pair in hit}


def test_yourdfpy_loads_it_with_both_scenes_and_no_mesh_file() -> None:
    import yourdfpy

    robot = yourdfpy.URDF.load(
        str(URDF), build_collision_scene_graph=True, load_collision_meshes=True, force_collision_mesh=False
    )
    assert robot.validate()
    assert robot.actuated_joint_names == [f"joint_{i}" for i in range(1, 8)]
    assert next(iter(ElementTree.parse(URDF).iter("mesh")), None) is None
    for scene in (robot.scene, robot.collision_scene):
        # upright: from the base plate to the tip of the tool, 1.1785 + 0.0122 + 0.1 m
        np.testing.assert_allclose(scene.bounds[:, 2], (0, 1.2907), rtol=0, atol=1e-6)
    robot.update_cfg(np.radians((0, 30, 0, -60, 0, 60, 0)))
    np.testing.assert_allclose(robot.get_transform("flange")[:3, 3], (-0.629, 0, 0.589360180), rtol=0, atol=1e-9)


@pytest.mark.parametrize("link", ENVELOPES)
def test_collision_shapes_fill_the_real_links_envelope(link: str) -> None:
    low, high, volume, centroid = ENVELOPES[link]
    found_low, found_high = bounds(link)
    if link == "link_7":
        low = (low[0], low[1], -0.0205)  # the rest is the 10 mm that the real flange sinks into link 6
    # 1 mm: half of it is the gap that keeps neighbours apart
    np.testing.assert_allclose(found_low, low, rtol=0, atol=1e-3)
    np.testing.assert_allclose(found_high, high, rtol=0, atol=1e-3)

    cloud = np.random.default_rng(7).uniform(low, high, (40_000, 3))
    hit = inside(link, cloud)
    filled = hit.mean() * np.prod(np.subtract(high, low)) * 1e3
    # boxes and cylinders round up the real, tapered body; most so the base, drawn as one cylinder
    assert 0.9 * volume < filled < (1.8 if link == "base_link" else 1.3) * volume
    np.testing.assert_allclose(cloud[hit].mean(axis=0), centroid, rtol=0, atol=0.01)


@pytest.mark.parametrize("degrees", ORDINARY)
def test_no_self_collision_in_ordinary_poses(degrees: tuple[float, ...]) -> None:
    assert collisions(degrees) == set()


def test_a_folded_arm_does_hit_its_base() -> None:
    found = collisions((0, -120, 0, 120, 0, -90, 0))
    assert ("base_link", "flange") in found
    assert ("base_link", "link_5") in found


def test_neighbours_never_touch_up_to_the_joint_limits() -> None:
    model, _ = shapes()
    for joint in range(7):
        limit = np.degrees(model.upperPositionLimit[joint])
        for angle in np.linspace(-limit, limit, 25):
            degrees = [0.0] * 7
            degrees[joint] = float(angle)
            assert collisions(tuple(degrees)) == set(), f"joint_{joint + 1} at {angle:.0f} deg"
