"""Maps on a curved surface: what is near through the air isn't near along it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kinid.errors import InputError
from kinid.mapping.interpolation.mesh import MeshSites, on_mesh, shares
from kinid.robotics.surface import Mesh


@pytest.fixture(scope="module")
def ball():
    made = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


@pytest.mark.parametrize(("method", "limit"), [("gp", 0.06), ("biharmonic", 0.06), ("nearest", 0.25)])
def test_a_smooth_function_of_a_ball_comes_back(ball, method, limit):
    # enough probes that neighbours see less than a radian of the ball
    rng = np.random.default_rng(0)
    places = rng.normal(size=(120, 3))
    places *= 0.05 / np.linalg.norm(places, axis=1, keepdims=True)

    def height(p):
        return 1000 + 300 * p[:, 2] / 0.05 + 150 * p[:, 0] * p[:, 1] / 0.05**2

    sample_sites = MeshSites(ball, places, reach=1.0)
    guess = on_mesh(method, sample_sites, height(places), np.full(120, 5.0)).at(np.arange(len(ball.vertices)))
    truth = height(ball.vertices)
    assert np.sqrt(np.nanmean((guess.mean - truth) ** 2)) / np.ptp(truth) < limit


def test_the_process_knows_how_sure_it_is(ball):
    rng = np.random.default_rng(1)
    places = rng.normal(size=(60, 3))
    places[:, 2] = np.abs(places[:, 2])  # the lower half is never touched
    places *= 0.05 / np.linalg.norm(places, axis=1, keepdims=True)
    values = 1000 + 4000 * places[:, 0]
    guess = on_mesh("gp", MeshSites(ball, places), values, np.full(60, 5.0)).at(np.arange(len(ball.vertices)))
    top, bottom = ball.vertices[:, 2] > 0.02, ball.vertices[:, 2] < -0.03
    assert guess.known[top].mean() > 0.8
    assert not guess.known[bottom].any()


def test_distance_runs_along_the_surface():
    """Two sheets 2 mm apart, joined at one end far away: the value of one is not that of the other."""
    x = np.linspace(0, 0.1, 41)
    y = np.linspace(0, 0.02, 9)
    fold = np.concatenate([np.stack([x, np.zeros_like(x)], 1), np.stack([x[::-1], np.full_like(x, 2e-3)], 1)])
    vertices = np.array([[u, v, w] for u, w in fold for v in y])
    n = len(y)
    quads = [
        (i * n + j, (i + 1) * n + j, (i + 1) * n + j + 1, i * n + j + 1)
        for i in range(len(fold) - 1)
        for j in range(n - 1)
    ]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    mesh = Mesh(vertices, faces)
    places = np.array([[0.02, 0.01, 0.0], [0.02, 0.01, 2e-3]])
    probe, _ = MeshSites(mesh, places, reach=1.0).nearest
    for i, place in enumerate(places):
        beside = np.argmin(np.linalg.norm(mesh.vertices - place, axis=1))
        assert probe[beside] == i
    # on the lower sheet, 30 mm from its probe and 30.1 mm through the air from the other one
    lower = np.argmin(np.linalg.norm(mesh.vertices - [0.05, 0.01, 0.0], axis=1))
    assert probe[lower] == 0


def test_places_are_mixtures_of_corners(ball):
    rng = np.random.default_rng(2)
    picked = rng.integers(len(ball.faces), size=20)
    parts = rng.dirichlet(np.ones(3), size=20)
    places = np.einsum("ni,nij->nj", parts, ball.vertices[ball.faces[picked]])
    assert np.allclose(shares(ball, places) @ ball.vertices, places, atol=1e-9)


@pytest.mark.parametrize("method", ["gp", "biharmonic", "nearest"])
def test_a_mesh_is_asked_by_vertices(ball, method):
    places = ball.vertices[::20]
    between = on_mesh(method, MeshSites(ball, places), places[:, 2], np.full(len(places), 1e-3))
    for query in (ball.vertices[:3], [0.5], [np.nan], [-1], [len(ball.vertices)], ["first"]):
        with pytest.raises(InputError, match=f"vertex numbers, whole, 0 to {len(ball.vertices) - 1}"):
            between.at(query)
    assert between.at([0, 20]).mean.shape == (2,)


def test_where_probes_agree_against_the_surface_it_is_not_sure(ball):
    """Probes about the pole say 700 less, each with an error that alone would excuse it."""
    v = ball.vertices[::3]
    values, noise = 2400.0 + np.random.default_rng(0).normal(scale=5.0, size=len(v)), np.full(len(v), 5.0)
    pole = v[:, 2] > 0.043
    values[pole], noise[pole] = 1700.0, 450.0
    assert pole.sum() >= 5
    guess = on_mesh("gp", MeshSites(ball, v), values, noise).at(np.arange(0, len(ball.vertices), 3))
    assert (guess.sd[pole] >= 0.5 * np.abs(guess.mean - values)[pole]).all()
    assert np.median(guess.sd[~pole]) < 20.0
