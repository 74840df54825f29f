"""A material that is the same everywhere: its map says so, is filled, and is exported."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kinid.errors import InputError
from kinid.mapping.export import export, patches
from kinid.mapping.map_page import map_page, plane_figure
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Mesh, Plane

PLANE = Plane(np.array([0.55, 0.0, 0.1]), np.eye(3))
STIFFNESS = (Property("stiffness", "N/m"),)


def grid(values, error, side=4, spacing=0.01):
    """A square grid of probes with the given values, (side²,), and one standard error."""
    ticks = spacing * (np.arange(side) - 0.5 * (side - 1))
    places = PLANE.point + np.stack(np.meshgrid(ticks, ticks, [0.0], indexing="ij"), -1).reshape(-1, 3)
    probes = (Probe(p, np.array([v]), np.array([[error**2]])) for p, v in zip(places, values))
    return PropertyMap(PLANE, STIFFNESS, tuple(probes))


def flat(seed, scatter=0.6, side=4):
    return grid(732.0 + np.random.default_rng(seed).normal(scale=scatter, size=side**2), 0.4, side)


def test_a_uniform_material_is_known_everywhere_between_its_probes():
    """Chance looks like structure now and then: the criterion costs 2.8 in the logarithm, so 17 of 20 at least."""
    said = 0
    for seed in range(20):
        made = flat(seed)
        said += made.uniform("stiffness") is not None
        ticks = np.linspace(-0.015, 0.015, 31)
        guess = made.over_grid("stiffness", (ticks, ticks))
        if made.uniform("stiffness") is not None:
            assert guess.known.all()
            # 16 probes that scatter by 0.6: their mean is good to 0.15, and four times that holds surely
            assert np.abs(guess.mean - 732.0).max() < 0.6
            assert np.ptp(guess.mean) < 0.01
    assert said >= 17


@pytest.mark.parametrize("seed", range(4))
def test_one_value_is_as_sure_at_a_probe_as_between(seed):
    """Probes that chance put side by side above the mean are no reason to doubt it there."""
    made = flat(seed)
    found = made.uniform("stiffness")
    at = made.interpolator("stiffness").at(made.flat(made.places)).sd
    ticks = np.linspace(-0.015, 0.015, 31)
    between = made.over_grid("stiffness", (ticks, ticks)).sd
    assert at == pytest.approx(found.standard_error, rel=0.05)
    assert between == pytest.approx(found.standard_error, rel=0.05)


def test_errors_that_all_probes_share_stay_in_their_mean():
    """One exponent that all stiffnesses were told with: a hundred of them are as unsure as one."""
    made = grid(6900.0 + np.random.default_rng(5).normal(scale=4.0, size=100), 80.0, 10)
    found = made.uniform("stiffness")
    assert found.standard_error == pytest.approx(80.0, rel=0.1)
    assert made.interpolator("stiffness").at([[0.0, 0.0]]).sd == pytest.approx(80.0, rel=0.1)


def test_pictures_of_a_grid_that_is_not_quite_square_are_whole():
    """The tip is pushed aside by micrometres: no cell at the rim of a picture is lost by that."""
    made = flat(0)
    moved = np.random.default_rng(1).normal(scale=2e-5, size=(16, 3)) * [1, 1, 0]
    made = PropertyMap(PLANE, STIFFNESS, tuple(replace(p, place=p.place + d) for p, d in zip(made.probes, moved)))
    assert made.over_grid("stiffness", made.grid(60)).known.all()


def test_what_is_uniform_is_said_with_its_error():
    found = flat(0).uniform("stiffness")
    assert found is not None
    assert abs(found.value - 732.0) < 4 * found.standard_error
    # 0.6 / √16; the scatter of 16 numbers is known to a fifth
    assert found.standard_error == pytest.approx(0.15, rel=0.5)


@pytest.mark.parametrize(
    "shape", [lambda x, y: 100 * x, lambda x, y: 4.0 * (x > 0), lambda x, y: 3.0 * np.sin(200 * x)]
)
def test_a_slope_a_step_and_a_wave_are_no_uniform_material(shape):
    places = grid(np.zeros(36), 1.0, 6).places - PLANE.point
    made = grid(732.0 + shape(places[:, 0], places[:, 1]) + np.random.default_rng(1).normal(scale=0.4, size=36), 0.4, 6)
    assert made.uniform("stiffness") is None


def test_probes_that_differ_by_far_more_than_their_errors_are_no_uniform_material():
    """A property that varies more finely than the probes: the mean of what was found is not what lies between."""
    assert grid(np.random.default_rng(2).uniform(500.0, 1500.0, 36), 1.0, 6).uniform("stiffness") is None


def test_a_map_that_knows_no_patch_is_not_exported(tmp_path):
    """Four bunches of probes, and four patches whose middles lie further from all of them than their word carries."""
    along = np.linspace(-0.005, 0.005, 10)
    arm = np.column_stack([np.full(10, 0.05), along, np.zeros(10)])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    places = PLANE.point + np.vstack([arm @ np.linalg.matrix_power(turn, k) for k in range(4)])
    made = PropertyMap(PLANE, STIFFNESS, tuple(Probe(p, np.array([732.0]), np.eye(1)) for p in places))
    with pytest.raises(InputError, match="knows no whole patch"):
        export(made, tmp_path / "world", 2)
    assert not (tmp_path / "world").exists()


def test_a_uniform_map_is_exported(tmp_path):
    made = flat(0)
    names = {path.name for path in export(made, tmp_path / "world")}
    assert {"map.xml", "map.sdf", "map.glb", "map.json", "stiffness.png"} <= names
    about = json.loads((tmp_path / "world/map.json").read_text(encoding="utf-8"))
    assert about["properties"]["stiffness"]["low"] == pytest.approx(732.0, abs=0.6)
    # 21 × 21 cells, whose corners alone may lie beyond the probes' reach
    assert len(patches(made).centres) > 380


def test_the_page_says_it_and_its_colours_span_more_than_chance():
    made = flat(0)
    page = map_page(made, "m")
    assert "uniform, 73" in page
    assert "N/m (95 %)" in page
    heat = plane_figure(made, "stiffness").data[0]
    assert heat.zmax - heat.zmin > 0.1 * 732.0


def test_on_a_mesh_too():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    rng = np.random.default_rng(3)
    probes = (
        Probe(mesh.vertices[i], np.array([732.0 + rng.normal(scale=0.6)]), np.array([[0.16]]))
        for i in rng.choice(len(mesh.vertices), 40, replace=False)
    )
    made = PropertyMap(mesh, STIFFNESS, tuple(probes))
    found = made.uniform("stiffness")
    assert found is not None
    guess = made.interpolator("stiffness").at(np.arange(len(mesh.vertices)))
    # all of the ball lies within reach of a probe but for gaps that chance left
    assert guess.known.mean() > 0.8
    # the mean of 40 that scatter by 0.6, times four
    assert np.nanmax(np.abs(guess.mean - 732.0)) < 0.4


def test_fitted_once_however_often_it_is_asked():
    made = flat(0)
    assert made.interpolator("stiffness") is made.interpolator("stiffness")
    assert made.added(made.probes[0]).interpolator("stiffness") is not made.interpolator("stiffness")
