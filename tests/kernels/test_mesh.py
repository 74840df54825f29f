"""The closest-point kernel against brute force, winding numbers, coal, a sphere and finite differences."""

from __future__ import annotations

import resource
import time

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinid.kernels import mesh as kernel

RADIUS = 1e-3  # edge radius [m]


def spiky(seed: int, low: float) -> trimesh.Trimesh:
    """A star-shaped closed surface of 320 faces with spikes and dents: every kind of edge and corner."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    ball.vertices *= np.random.default_rng(seed).uniform(low, 1.0, (len(ball.vertices), 1))
    return ball


def bent_sheet() -> trimesh.Trimesh:
    """An open sheet of 8 × 8 squares, bumpy by a cell's size: with a rim, and corners of both curvatures."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9), indexing="ij")
    z = 0.02 * np.random.default_rng(5).normal(size=x.shape)
    i = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.vstack([np.stack([i, i + 9, i + 10], axis=1), np.stack([i, i + 10, i + 1], axis=1)])
    return trimesh.Trimesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, process=False)


CLOSED = {
    "box": trimesh.creation.box((0.2, 0.1, 0.05)),
    "sphere": trimesh.creation.icosphere(subdivisions=2, radius=0.1),
    "torus": trimesh.creation.torus(0.08, 0.03, major_sections=24, minor_sections=12),
    "spiky": spiky(0, 0.4),
    "needles": spiky(3, 0.1),
}
SHAPES = {**CLOSED, "sheet": bent_sheet()}
TREES = {name: kernel.build(shape.vertices, shape.faces, RADIUS) for name, shape in SHAPES.items()}
#: an edge radius wider than the faces, which has to be cut
WIDE = {name: kernel.build(shape.vertices, shape.faces, 0.5) for name, shape in SHAPES.items()}


def brute_distance(points: np.ndarray, shape: trimesh.Trimesh) -> np.ndarray:
    """Unsigned distance another way: to the planes of the faces that a point is above, and to all edges."""
    corners = np.asarray(shape.triangles)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    out = np.empty(len(points))
    for i, p in enumerate(points):
        off = np.sum((p - a) * normal, axis=1)
        above = np.ones(len(a), dtype=bool)
        found = []
        for start, end in ((a, b), (b, c), (c, a)):
            edge = end - start
            above &= np.sum(np.cross(edge, p - start) * normal, axis=1) >= 0
            along = np.clip(np.sum((p - start) * edge, axis=1) / np.sum(edge**2, axis=1), 0, 1)
            found.append(np.linalg.norm(start + along[:, None] * edge - p, axis=1).min())
        out[i] = min(*found, np.abs(off[above]).min(initial=np.inf))
    return out


def winding(points: np.ndarray, shape: trimesh.Trimesh) -> np.ndarray:
    """How often the surface goes round each point, from solid angles (Van Oosterom, Strackee 1983)."""
    out = np.empty(len(points))
    for i, p in enumerate(points):
        a, b, c = np.moveaxis(np.asarray(shape.triangles) - p, 1, 0)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        volume = np.sum(a * np.cross(b, c), axis=1)
        ab, bc, ca = np.sum(a * b, axis=1), np.sum(b * c, axis=1), np.sum(c * a, axis=1)
        rest = la * lb * lc + ab * lc + bc * la + ca * lb
        out[i] = np.arctan2(volume, rest).sum() / (2 * np.pi)
    return out


def around(shape: trimesh.Trimesh, seed: int, far: int = 300, near: int = 400) -> np.ndarray:
    """Points anywhere, and points 0.1 µm to 10 mm from corners and from the middles of edges."""
    draw = np.random.default_rng(seed)
    spots = np.vstack([shape.vertices, shape.vertices[shape.edges_unique].mean(axis=1)])
    spots = spots[draw.integers(0, len(spots), near)]
    offset = draw.normal(size=(near, 3)) * 10.0 ** draw.uniform(-7, -2, (near, 1))
    return np.vstack([draw.uniform(-0.15, 0.15, (far, 3)), spots + offset])


def on_surface(shape: trimesh.Trimesh, draw: np.random.Generator, count: int) -> np.ndarray:
    """Points on the surface, most of them close to a corner or an edge."""
    weights = draw.dirichlet([0.1] * 3, count)
    return np.einsum("nk,nkj->nj", weights, shape.triangles[draw.integers(0, len(shape.faces), count)])


@pytest.mark.parametrize("name", SHAPES)
def test_distance_is_that_of_brute_force(name):
    points = around(SHAPES[name], seed=1)
    found = kernel.closest(points, TREES[name])
    # both are exact but for rounding: coordinates of 0.2 m, 3e-17 m, a few operations
    assert np.abs(found.distance) == pytest.approx(brute_distance(points, SHAPES[name]), abs=1e-15)
    assert np.linalg.norm(points - found.point, axis=1) == pytest.approx(np.abs(found.distance), abs=1e-15)


@pytest.mark.parametrize("name", SHAPES)
def test_closest_point_lies_on_the_face_named(name):
    shape = SHAPES[name]
    found = kernel.closest(around(shape, seed=2), TREES[name])
    weights = trimesh.triangles.points_to_barycentric(shape.triangles[found.face], found.point)
    assert weights.min() > -1e-9  # thin faces magnify rounding in these weights
    off = np.sum((found.point - shape.triangles[found.face, 0]) * shape.face_normals[found.face], axis=1)
    assert np.abs(off).max() < 1e-15


@pytest.mark.parametrize("name", CLOSED)
def test_sign_is_that_of_the_winding_number(name):
    points = around(CLOSED[name], seed=3)
    inside = winding(points, CLOSED[name]) > 0.5
    assert 0.1 < inside.mean() < 0.9
    assert ((kernel.closest(points, TREES[name]).distance < 0) == inside).all()


def test_sign_near_a_sharp_edge_needs_more_than_the_nearest_face():
    # a wedge of 20°: beyond its edge the faces' own normals disagree about the side of many points
    wedge = trimesh.convex.convex_hull(
        [[0, -1, 0], [0, 1, 0], [1, -1, 0.18], [1, 1, 0.18], [1, -1, -0.18], [1, 1, -0.18]]
    )
    draw = np.random.default_rng(0)
    x = -(10.0 ** draw.uniform(-6, -1, 500))
    beyond = np.column_stack([x, draw.uniform(-0.9, 0.9, 500), x * draw.uniform(-5, 5, 500)])
    found = kernel.closest(beyond, kernel.build(wedge.vertices, wedge.faces, RADIUS))
    naive = np.sum((beyond - found.point) * wedge.face_normals[found.face], axis=1)
    assert (naive < 0).any()  # the trap is there
    assert (found.distance > 0).all()


@pytest.mark.parametrize("name", ["box", "torus", "needles"])
def test_distance_outside_is_that_of_coal(name):
    coal = pytest.importorskip("coal")
    shape = CLOSED[name]
    other = coal.BVHModelOBBRSS()
    other.beginModel(len(shape.faces), len(shape.vertices))
    other.addVertices(np.asarray(shape.vertices))
    other.addTriangles(np.asarray(shape.faces))
    other.endModel()
    points = around(shape, seed=4, far=150, near=150)
    distance = kernel.closest(points, TREES[name]).distance
    # coal's iterative solver is asked for a ball's distance; what it is good to is what is asked of it here
    ball, ball_radius = coal.Sphere(1e-4), 1e-4
    clear = distance > 2e-4
    assert clear.sum() > 50
    for p, d in zip(points[clear], distance[clear]):
        result = coal.DistanceResult()
        coal.distance(
            other, coal.Transform3s.Identity(), ball, coal.Transform3s(np.eye(3), p), coal.DistanceRequest(), result
        )
        assert result.min_distance + ball_radius == pytest.approx(d, abs=1e-6)


def test_a_fine_sphere_is_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    draw = np.random.default_rng(0)
    direction = draw.normal(size=(2000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = draw.uniform(0.05, 0.2, 2000)
    found = kernel.closest(direction * radius[:, None], kernel.build(ball.vertices, ball.faces, RADIUS))
    # a face of edges l sags by l² / 6R at most below the sphere, and its normal leans by l / √3 R
    edge = ball.edges_unique_length.max()
    sag, lean = edge**2 / (6 * 0.1), edge / (np.sqrt(3) * 0.1)
    assert (found.distance >= radius - 0.1 - 1e-15).all()
    assert (found.distance <= radius - 0.1 + sag).all()
    assert np.linalg.norm(found.normal - direction, axis=1).max() < 1.1 * lean


@pytest.mark.parametrize("name", SHAPES)
def test_gradient_is_that_of_finite_differences(name):
    points = around(SHAPES[name], seed=6)
    tree = TREES[name]
    here = kernel.closest(points, tree)
    step = 1e-8
    difference = np.empty_like(points)
    kept = np.abs(here.distance) > 1e-6
    for j in range(3):
        ahead, behind = (kernel.closest(points + s * step * np.eye(3)[j], tree) for s in (1, -1))
        difference[:, j] = (ahead.distance - behind.distance) / (2 * step)
        # across the medial axis the gradient jumps; a difference over the jump is no gradient
        kept &= np.linalg.norm(ahead.point - behind.point, axis=1) < 20 * step
        kept &= np.linalg.norm(ahead.gradient - behind.gradient, axis=1) < 0.1
    assert kept.mean() > 0.8
    assert np.linalg.norm(here.gradient, axis=1) == pytest.approx(1.0, abs=1e-12)
    # rounding 3e-17 m / 1e-8 m; curvature of the distance around a corner at 1e-6 m: (1e-8 / 1e-6)²
    assert np.abs(difference - here.gradient)[kept].max() < 1e-3


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(sorted(SHAPES)),
    radius=st.sampled_from([RADIUS, 0.5]),
    seed=st.integers(0, 10_000),
    exponent=st.floats(-9, -5),
)
def test_smooth_normal_is_continuous_on_walks_across_edges_and_corners(name, radius, seed, exponent):
    shape, draw = SHAPES[name], np.random.default_rng(seed)
    tree = (TREES if radius == RADIUS else WIDE)[name]
    # turns take at least this length: a tenth for the thin wedges between a crease and a diagonal beside it
    length = 0.1 * min(radius, 0.4 * tree.height.min())
    step = min(10.0**exponent, 0.01 * length)
    before = kernel.closest(on_surface(shape, draw, 50), tree)
    for _ in range(10):
        after = kernel.closest(before.point + step * draw.normal(size=(50, 3)), tree)
        moved = np.linalg.norm(after.point - before.point, axis=1)
        turned = np.linalg.norm(after.normal - before.normal, axis=1)
        # a jump at an edge or corner would be of the order of the angle there, some 0.1 to 3, at any step
        assert (turned <= 4.0 * moved / length + 1e-9).all()
        before = after


@pytest.mark.parametrize("name", SHAPES)
def test_smooth_normal_far_from_edges_on_edges_and_at_corners(name):
    shape, tree = SHAPES[name], TREES[name]
    corners = shape.triangles
    edges = np.diff(corners, axis=1, append=corners[:, :1])
    heights = 2 * shape.area_faces[:, None] / np.linalg.norm(edges, axis=2)
    centre = kernel.closest(shape.triangles_center, tree)
    wide = heights.min(axis=1) / 3 > RADIUS  # the centroid lies a third of each height from its edge
    assert wide.any()
    assert centre.normal[wide] == pytest.approx(shape.face_normals[centre.face[wide]], abs=1e-12)

    ends = shape.vertices[shape.face_adjacency_edges]
    middles = ends.mean(axis=1)
    clear = np.linalg.norm(np.ptp(ends, axis=1), axis=1) > 2 * RADIUS  # of the corners' balls
    half = shape.face_normals[shape.face_adjacency].sum(axis=1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    # the middle of an edge is rounded off it by 1e-17 m or so, over at least 1e-5 m that the turn takes
    assert kernel.closest(middles[clear], tree).normal == pytest.approx(half[clear], abs=1e-9)

    used = np.unique(shape.faces)
    angles = np.zeros((len(shape.vertices), 3))
    np.add.at(angles, shape.faces, shape.face_angles[:, :, None] * shape.face_normals[:, None, :])
    angles /= np.linalg.norm(angles, axis=1, keepdims=True)
    assert kernel.closest(shape.vertices[used], tree).normal == pytest.approx(angles[used], abs=1e-9)


def test_smooth_normal_beside_an_edge():
    # along the top of the box towards its long edge at y = 0.05, away from corners and diagonals
    away = RADIUS * np.array([0.0, 0.25, 0.5, 1.0, 1.5])
    points = np.column_stack([np.full(5, 0.09), 0.05 - away, np.full(5, 0.025)])
    share = np.array([1.0, 0.84375, 0.5, 0.0, 0.0])  # 1 − 3 x² + 2 x³
    wanted = np.column_stack([np.zeros(5), share, np.ones(5)])
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert kernel.closest(points, TREES["box"]).normal == pytest.approx(wanted, abs=1e-9)


def test_beside_a_thin_strip_the_normal_turns_no_wider_than_on_it():
    strip = trimesh.creation.box((0.2, 0.1, 0.0005))
    tree = kernel.build(strip.vertices, strip.faces, RADIUS)
    away = np.array([1e-5, 1e-4, 1.9e-4, 2.1e-4, 9e-4])
    points = np.column_stack([np.full(5, 0.07), 0.05 - away, np.full(5, 0.00025)])
    leaning = kernel.closest(points, tree).normal[:, 1] > 1e-9
    assert leaning.tolist() == [True, True, True, False, False]  # 0.4 times the strip's 0.5 mm


@settings(max_examples=25, deadline=None)
@given(turn=st.integers(0, 1000), shift=st.tuples(*[st.floats(-1, 1)] * 3))
def test_moves_with_the_mesh(turn, shift):
    shape, motion = SHAPES["spiky"], Rotation.random(random_state=turn)
    points = around(shape, seed=turn, far=60, near=60)
    here = kernel.closest(points, TREES["spiky"])
    tree = kernel.build(motion.apply(shape.vertices) + shift, shape.faces, RADIUS)
    there = kernel.closest(motion.apply(points) + shift, tree)
    # rounding of coordinates of a metre: 1e-16 m; of the normal, over a turn that takes 4e-4 m at least
    assert there.distance == pytest.approx(here.distance, abs=1e-14)
    same = np.linalg.norm(there.point - (motion.apply(here.point) + shift), axis=1) < 1e-12  # but for ties
    assert same.mean() > 0.95
    assert there.normal[same] == pytest.approx(motion.apply(here.normal[same]), abs=1e-9)


def test_order_of_the_points_does_not_matter():
    points = around(SHAPES["torus"], seed=8)
    order = np.random.default_rng(0).permutation(len(points))
    one, other = kernel.closest(points, TREES["torus"]), kernel.closest(points[order], TREES["torus"])
    assert (one.distance[order] == other.distance).all()


def test_points_that_are_not_finite():
    points = around(SHAPES["box"], seed=9)
    clean = kernel.closest(points, TREES["box"])
    holes = points.copy()
    holes[0], holes[50, 1], holes[-1, 2] = np.nan, np.inf, np.nan
    found = kernel.closest(holes, TREES["box"])
    bad = np.zeros(len(points), dtype=bool)
    bad[[0, 50, -1]] = True
    assert (found.face[bad] == -1).all()
    for array, whole in zip(found, clean):
        assert array.dtype == np.int64 or np.isnan(array[bad]).all()
        assert (array[~bad] == whole[~bad]).all()


def test_takes_read_only_strided_and_single_precision_points():
    points = np.zeros((40, 4), dtype=np.float32)
    points[:, :3] = around(SHAPES["box"], seed=10)[:40]
    view = points[::2, :3]
    view.setflags(write=False)
    found = kernel.closest(view, TREES["box"])
    assert (found.distance == kernel.closest(view.astype(float).copy(), TREES["box"]).distance).all()
    assert kernel.closest(np.empty((0, 3)), TREES["box"]).normal.shape == (0, 3)


def test_one_triangle():
    tree = kernel.build([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], [[0, 1, 2]], RADIUS)
    found = kernel.closest([[0.2, 0.2, 0.3], [0.2, 0.2, -0.3], [2, 0, 0], [-3, -4, 0.0]], tree)
    assert found.distance == pytest.approx([0.3, -0.3, 1.0, 5.0], abs=1e-15)
    assert found.point[2:] == pytest.approx(np.array([[1, 0, 0], [0, 0, 0.0]]), abs=1e-15)
    assert found.normal == pytest.approx(np.tile([0, 0, 1.0], (4, 1)), abs=1e-15)


def test_the_tree_holds_every_triangle_once():
    for name, tree in TREES.items():
        assert (np.sort(tree.face) == np.arange(len(SHAPES[name].faces))).all()
        low, high = tree.corners.min(axis=(0, 1)), tree.corners.max(axis=(0, 1))
        assert (tree.box[1] == [*low, *high]).all()


def test_speed_and_memory_of_a_long_path():
    """Printed (pytest -s), not asserted: machines differ."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    begin = time.perf_counter()
    tree = kernel.build(ball.vertices, ball.faces, RADIUS)
    built = time.perf_counter() - begin
    s = np.linspace(0.0, 12.0, 200_000)
    path = np.stack([np.sin(s) * np.cos(3 * s), np.sin(s) * np.sin(3 * s), np.cos(s)], axis=1)
    path *= 0.1 - 0.003 * np.sin(40 * s[:, None])
    begin = time.perf_counter()
    found = kernel.closest(path, tree)
    taken = time.perf_counter() - begin
    size = sum(a.nbytes for a in tree if isinstance(a, np.ndarray))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"\n{len(ball.faces)} faces: built in {built:.3f} s, {size / 1e6:.1f} MB; {len(path)} points in "
        f"{taken:.3f} s, {1e6 * taken / len(path):.2f} µs each; process peak {peak:.0f} MB"
    )
    assert np.isfinite(found.distance).all()
    assert np.abs(found.distance).max() < 4e-3
