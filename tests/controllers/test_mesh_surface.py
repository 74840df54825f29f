"""A mesh under the hand: the god-object against planes, a sphere, walls, edges and grooves; energy at 1 kHz."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.controllers import (
    EnergyTank,
    HapticRendering,
    HapticSettings,
    Hooke,
    HuntCrossley,
    KelvinVoigt,
    MeshSurface,
    Observer,
    Plane,
    Properties,
    Uniform,
)
from kinid.controllers.passivity import Passivity
from kinid.robotics.surface import Mesh

Array = NDArray[np.float64]
PERIOD = 1e-3
SOFT = Uniform(Properties(1000.0, 2.0, 1.0, 0.4))
SMOOTH = Uniform(Properties(1000.0))
FREE = Observer(0.0)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A box, two triangles a side."""
    v = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(v, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))


def ball(radius: float, parts: int = 4) -> Mesh:
    """An icosahedron, each face cut into four so many times, on a sphere."""
    g = (1 + 5**0.5) / 2
    v = [
        (-1, g, 0),
        (1, g, 0),
        (-1, -g, 0),
        (1, -g, 0),
        (0, -1, g),
        (0, 1, g),
        (0, -1, -g),
        (0, 1, -g),
        (g, 0, -1),
        (g, 0, 1),
        (-g, 0, -1),
        (-g, 0, 1),
    ]
    f = [
        (0, 11, 5),
        (0, 5, 1),
        (0, 1, 7),
        (0, 7, 10),
        (0, 10, 11),
        (1, 5, 9),
        (5, 11, 4),
        (11, 10, 2),
        (10, 7, 6),
        (7, 1, 8),
        (3, 9, 4),
        (3, 4, 2),
        (3, 2, 6),
        (3, 6, 8),
        (3, 8, 9),
        (4, 9, 5),
        (2, 4, 11),
        (6, 2, 10),
        (8, 6, 7),
        (9, 8, 1),
    ]
    corners = np.array(v, dtype=float)[np.array(f)]
    for _ in range(parts):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = a + b, b + c, c + a
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    corners = radius * corners / np.linalg.norm(corners, axis=2, keepdims=True)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def groove() -> Mesh:
    """A sheet with a V of 90° along y, its bottom at the origin."""
    v = np.array([[-0.1, -0.2, 0.1], [-0.1, 0.2, 0.1], [0, -0.2, 0], [0, 0.2, 0], [0.1, -0.2, 0.1], [0.1, 0.2, 0.1]])
    return Mesh(v, np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]]))


def room() -> Mesh:
    """Three walls that meet in a corner, seen from inside."""
    v = 0.05 * np.array([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1], [1, 1, -1], [1, -1, -1], [-1, 1, -1]])
    return Mesh(v, np.array([[0, 1, 2], [0, 2, 3], [0, 5, 1], [0, 4, 5], [0, 6, 4], [0, 3, 6]]))


def feel(
    mesh: Mesh,
    materials: Uniform = SMOOTH,
    law: KelvinVoigt | Hooke | HuntCrossley | None = None,
    passivity: Passivity = FREE,
    shear: float = 500.0,
) -> HapticRendering:
    return HapticRendering(materials, HapticSettings(law or Hooke(), MeshSurface(mesh), shear, passivity=passivity))


def trace(rendering: HapticRendering, path: Array) -> Array:
    """Forces along a path that is walked at 1 kHz, (n, 3)."""
    speeds = np.gradient(path, PERIOD, axis=0)
    return np.array([rendering.command(x, v).force for x, v in zip(path, speeds)])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_top_of_a_box_is_a_plane(seed: int) -> None:
    """Friction, damping and all, wherever the path touches, leaves and comes back."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(300, 3)) * [2e-4, 2e-4, 2e-4], axis=0)
    path = np.clip(walk, -0.04, 0.04) + [0, 0, 1e-3]
    flat = HapticRendering(SOFT, HapticSettings(KelvinVoigt(), Plane(), passivity=FREE))
    on_box = feel(box((-0.05, -0.05, -0.5), (0.05, 0.05, 0.0)), SOFT, KelvinVoigt())
    # the god-object's skin of 0.1 µm decides where touch begins
    np.testing.assert_allclose(trace(on_box, path), trace(flat, path), atol=1e-9 + 1000.0 * 3e-7 + 500 * 3e-7)


def test_a_sphere_pushes_out_of_its_middle() -> None:
    mesh, radius = ball(0.05), 0.05
    rng, angles, depths = np.random.default_rng(2), [], []
    for _ in range(300):
        out = rng.normal(size=3)
        out /= np.linalg.norm(out)
        rendering = feel(mesh)
        for r in np.linspace(1.02 * radius, 0.9 * radius, 12):
            found = rendering.command(r * out, np.zeros(3))
        size = float(np.linalg.norm(found.force))
        angles.append(float(np.arccos(np.clip(found.force @ out / size, -1, 1))))
        depths.append(found.depth)
    # 5120 facets: half the angle between two is 1.7°, and their middles lie inside the sphere
    assert max(angles) < np.radians(2.5)
    sunk = radius - np.linalg.norm(mesh.vertices[mesh.faces].mean(axis=1), axis=1).min()
    assert sunk < 1e-4
    np.testing.assert_allclose(depths, 0.1 * radius - sunk / 2, atol=sunk)


def test_stroking_a_sphere_turns_the_force_smoothly() -> None:
    """A third of a turn at 0.1 m/s, 2 mm deep: direction and size without a jump, friction against the slip."""
    angle = np.linspace(-1.0, 1.0, 1000)
    path = np.column_stack([np.sin(angle), 0.3 * np.cos(angle), np.cos(angle)])
    path *= 0.048 / np.linalg.norm(path, axis=1, keepdims=True)
    smooth = trace(feel(ball(0.05)), path)[5:]
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.25 * 2.0  # 2 N in all; facets turn by 3.5°
    rough = trace(feel(ball(0.05), SOFT), path)[300:]
    along = np.gradient(path, axis=0)[300:]
    out = path[300:] / np.linalg.norm(path[300:], axis=1, keepdims=True)
    normal = np.sum(rough * out, axis=1)
    tangential = -np.sum(rough * along, axis=1) / np.linalg.norm(along, axis=1)
    # the cone: within a facet's angle of μ N
    np.testing.assert_allclose(tangential / normal, 0.4, atol=0.06)


def test_a_thin_wall_isn_t_pushed_through() -> None:
    """5 mm into a sheet metal of 1 mm: the nearest way out is the other side, the force still points back."""
    mesh = box((-0.1, -0.1, -0.001), (0.1, 0.1, 0.0))
    rendering = feel(mesh)
    path = np.column_stack([np.zeros(60), np.zeros(60), np.linspace(0.001, -0.005, 60)])
    force = trace(rendering, path)
    assert float(mesh.locate(path[-1]).gradient[0, 2]) < 0
    np.testing.assert_allclose(force[-1], [0, 0, 1000 * 0.005], atol=1e-3)
    # even in one stride
    np.testing.assert_allclose(trace(feel(mesh), np.array([[0, 0, 0.02], [0, 0, -0.03]]))[-1], [0, 0, 30.0], atol=1e-3)


def test_over_an_edge_the_force_goes_on_without_a_jump() -> None:
    """Along the top, round the edge, down the side, 2 mm deep: the force turns, and over the edge there is none
    left.
    """
    mesh = box((-0.1, -0.1, -0.1), (0.0, 0.1, 0.0))
    # the device stays at 2 mm inside the top until it leaves the box through the side
    x = np.linspace(-0.02, 0.004, 800)
    force = trace(feel(mesh), np.column_stack([x, np.zeros_like(x), np.full_like(x, -0.002)]))
    np.testing.assert_allclose(force[5:600, 2], 2.0, atol=1e-3)
    assert not force[-60:].any()
    # a device that comes back touches the side
    back = feel(mesh)
    pushed = trace(back, np.column_stack([np.linspace(0.004, -0.002, 200), np.zeros(200), np.full(200, -0.002)]))
    np.testing.assert_allclose(pushed[-1], [2.0, 0, 0], atol=1e-3)


def test_in_a_groove_both_walls_push() -> None:
    """5 mm below the bottom: the god-object rests in the corner, where only the distance to it counts."""
    rendering = feel(groove())
    path = np.column_stack([np.linspace(0.003, 0.001, 100), np.zeros(100), np.linspace(0.05, -0.005, 100)])
    force = trace(rendering, path)
    np.testing.assert_allclose(force[-1], 1000.0 * -path[-1], atol=2e-3)
    # along the groove nothing holds it
    y = np.linspace(0.0, 0.05, 200)
    slid = trace(rendering, np.column_stack([np.full(200, 0.001), y, np.full(200, -0.005)]))
    np.testing.assert_allclose(slid[5:, 1], 0.0, atol=1e-3)
    np.testing.assert_allclose(slid[5:, 2], 5.0, atol=2e-3)


def test_three_walls_hold_a_corner() -> None:
    path = np.linspace([0.0, 0.0, 0.0], [0.056, 0.054, 0.053], 80)
    np.testing.assert_allclose(trace(feel(room()), path)[-1], [-6.0, -4.0, -3.0], atol=2e-3)


def test_a_map_on_a_mesh_is_read_where_the_proxy_is() -> None:
    class Ramp:
        def properties(self, x: float, y: float) -> Properties:
            return Properties(500.0 + 1e4 * x)

    surface = MeshSurface(box((-0.05, -0.05, -0.5), (0.05, 0.05, 0.0)), place=lambda p: (p[1], p[0]))
    rendering = HapticRendering(Ramp(), HapticSettings(Hooke(), surface, shear=0.0, passivity=FREE))
    found = [rendering.command(np.array([0.01, 0.03, z]), np.zeros(3)).force[2] for z in (0.001, -0.001)]
    assert found[1] == pytest.approx((500.0 + 1e4 * 0.03) * 0.001, rel=1e-3)


def toss(
    rendering: HapticRendering, mass: float, towards: Array, start: Array, velocity: Array, steps: int
) -> tuple[Array, Array]:
    """A device without damping, drawn to a point by a soft spring, force held each period: its energy, and where it
    was.
    """
    x, v, pull = start.astype(float), velocity.astype(float), 20.0
    energy, places = [], []
    for _ in range(steps):
        force = rendering.command(x, v).force
        energy.append(0.5 * mass * v @ v + 0.5 * pull * (x - towards) @ (x - towards))
        places.append(x)
        # the soft spring exactly enough: 2 rad/s times 1 ms
        a = (force - pull * (x + 0.5 * PERIOD * v - towards)) / mass
        x, v = x + PERIOD * v + 0.5 * PERIOD**2 * a, v + PERIOD * a
    return np.array(energy), np.array(places)


@pytest.mark.parametrize("passivity", [Observer(50.0), EnergyTank(2e-3)], ids=["observer", "tank"])
@pytest.mark.parametrize("shape", ["ball", "box", "groove"])
def test_energy_of_an_undamped_device_on_a_mesh_is_bounded(shape: str, passivity: Passivity) -> None:
    """10 s of bouncing and sliding over facets, edges and walls at 1 kHz."""
    mesh = {"ball": ball(0.05, 2), "box": box((-0.03, -0.03, -0.03), (0.03, 0.03, 0.03)), "groove": groove()}[shape]
    rendering = feel(mesh, Uniform(Properties(2000.0, 0.0, 1.0, 0.2)), passivity=passivity)
    stiffness, mass = 2000.0, 0.2
    start = np.array([0.01, 0.02, 0.08])
    energy, places = toss(rendering, mass, np.zeros(3), start, np.array([0.1, 0.05, -0.1]), 10_000)
    assert np.isfinite(energy).all()
    speed = np.sqrt(2 * energy[0] / mass)
    slack = (
        2 * np.sqrt(stiffness * mass) * PERIOD * speed**2
        if isinstance(passivity, Observer)
        else 2e-3 + 0.05 * energy[0]
    )
    assert energy.max() < energy[0] + slack
    inside = mesh.locate(places).depth > 0
    assert inside.sum() > 100  # it touched, and it let go
    assert (~inside).sum() > 20
    assert np.ptp(places, axis=0).max() > 0.02


def test_it_keeps_up_with_1_khz() -> None:
    mesh, took = ball(0.05, 5), []
    rendering = feel(mesh, SOFT, KelvinVoigt(), Observer())
    angle = np.linspace(0.0, 6.0, 1500)
    for a in angle:
        x = 0.048 * np.array([np.sin(a), 0.1, np.cos(a)])
        began = time.perf_counter()
        rendering.command(x, np.zeros(3))
        took.append(time.perf_counter() - began)
    middle, late = 1e6 * np.quantile(took, [0.5, 0.99])
    print(f"a mesh of {len(mesh.faces)} faces: {middle:.0f} µs a period, 99 % within {late:.0f} µs")
    assert np.median(took) < PERIOD
