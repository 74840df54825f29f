"""Less touching: borders along slides with intervals and a kept false-alarm rate, and pokes where they tell most."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import kinid
from kinid.errors import InputError
from kinid.mapping.boundaries import SlidePath, by_slope, changes, paths
from kinid.mapping.exploration import Region, explore, next_poke, pokes_after_slides
from kinid.mapping.interpolation import METHODS, PlaneSites
from kinid.mapping.interpolation.gaussian_process import interpolator
from kinid.mapping.interpolation.triangles import Triangles


def slid(place, angle, seed, material="mould"):
    """A virtual arm slides out and back about a place, at 8 mm/s."""
    from kinid.lab.experiments import prepare
    from kinid.lab.protocol import Slide, five_phases

    base = prepare("slide", material=material, seed=seed)
    slide = Slide(depth=2.5e-3, speed=8e-3, length=0.012, directions=(angle,))
    script = five_phases(slide, place=place, height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
    setup = dataclasses.replace(base, script=script, seed=seed + 5)
    return kinid.contact_series(setup.run().log, setup.rig, robot=setup.robot)


#: borders of the mould wind a little: where they cross the ways of these slides [m]
CROSSINGS = [
    ((0.0, -0.025), 0.0, 0, 1.5e-3 * np.sin(90 * -0.025)),
    ((-0.025, 0.0), np.pi / 2, 1, -1.2e-3 * np.sin(110 * -0.025)),
]


@pytest.mark.parametrize(("place", "angle", "axis", "truth"), CROSSINGS)
def test_a_border_is_found_within_a_millimetre(place, angle, axis, truth):
    across = max(paths(slid(place, angle, 0)), key=lambda path: len(path.x))
    found = changes(across)
    assert len(found) == 1
    border = found[0]
    assert across.at(border.place)[axis] == pytest.approx(truth, abs=1e-3)
    low, high = sorted((across.at(border.low)[axis], across.at(border.high)[axis]))
    assert low <= truth <= high
    assert high - low < 2.5e-3
    # the plain threshold finds it too, less sharply
    steep = by_slope(across, 40.0)
    assert any(a - 2e-3 <= border.place <= b + 2e-3 for a, b in steep)


def alarms(seeds):
    return [len(changes(path)) for seed in seeds for path in paths(slid((-0.025, -0.025), 0.0, seed))]


def test_one_material_gives_no_alarm():
    assert sum(alarms(range(4))) == 0


@pytest.mark.slow
def test_one_material_gives_no_alarm_in_a_hundred_seeds():
    assert sum(alarms(range(100))) == 0


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_the_false_alarm_rate_is_the_one_stated(rho):
    """Noise of two colours on a level: at a stated 5 % some 5 % alarm (300 tries: 1.3 % standard error), never far
    more.
    """
    rng = np.random.default_rng(4)
    count = 0
    for _ in range(300):
        noise = rng.standard_normal((2, 120))
        for k in range(1, 120):
            noise[:, k] += rho * noise[:, k - 1]
        x = np.arange(100) * 2e-4
        # so small that a step of 4 % of the mean is a large one: only chance could alarm, so the level is small too
        n = 0.01 + noise[0, 20:]
        path = SlidePath(x, n, n * (0.01 + noise[1, 20:]), np.ones(100), np.zeros(2), np.array([1.0, 0.0]))
        count += len(changes(path, false_alarms=0.05)) > 0
    assert count / 300 < 0.10


def test_two_borders_on_one_way():
    rng = np.random.default_rng(5)
    x = np.arange(150) * 2e-4
    k = np.where(x < 0.01, 500.0, np.where(x < 0.02, 900.0, 700.0))
    depth = np.full(150, 2.5e-3)
    normal = k * depth + 0.01 * rng.standard_normal(150)
    found = changes(SlidePath(x, normal, 0.8 * normal, depth, np.zeros(2), np.array([1.0, 0.0])))
    assert [round(1e3 * b.place) for b in found] == [10, 20]
    assert [b.stiffness_step > 0 for b in found] == [True, False]


def test_pokes_after_slides_stand_beside_borders():
    x = np.arange(150) * 2e-4
    k = np.where(x < 0.01, 500.0, 900.0)
    noise = 1 + 1e-3 * np.random.default_rng(6).standard_normal(150)
    path = SlidePath(x, k * 2.5e-3 * noise, k * 2e-3, np.full(150, 2.5e-3), np.array([0.0, 0.01]), np.array([1.0, 0.0]))
    pokes = pokes_after_slides([(path, changes(path))], beside=3e-3, apart=2e-3)
    assert np.allclose(pokes, [[0.0, 0.01], [0.007, 0.01], [0.013, 0.01], [0.0298, 0.01]], atol=3e-4)


REGION = Region((-0.045, -0.045), (0.045, 0.045))


def mould(shift):
    """Stiffness of the mould with its borders shifted [m], as an exact poke would feel it."""
    from kinid.lab import materials

    values = tuple(tuple(np.asarray(float(m.stiffness)) for m in row) for row in materials._QUARTERS)

    def at(q):
        u, v = (np.asarray(q) - shift).T
        body = materials._quarters(u, v, values) * materials._rim(*np.asarray(q).T)
        film = materials._film(u, v)
        return (1 - film) * body + film * 0.75 * body

    return at


def error(guess, truth):
    return float(np.mean(np.abs(guess / truth - 1)))


def explored(seed, count, prior=None, moved=True):
    """The error of the explored map after `count` pokes, and of a grid of a hundred."""
    rng = np.random.default_rng(seed)
    at = mould(rng.uniform(-0.01, 0.01, 2) * moved)
    q = REGION.grid(45)
    truth = at(q)

    def poke(places):
        return at(places) * (1 + 0.005 * rng.standard_normal(len(places)))

    ticks = np.linspace(-0.045, 0.045, 10)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    values = poke(grid)
    even = Triangles(PlaneSites(grid, reach=1.0), values, 0.005 * values)
    expect = None if prior is None else prior(at)
    *_, grown = explore(
        lambda p: ((v := float(poke(p[None])[0])), 0.005 * v),
        REGION,
        REGION.grid(4),
        apart=4e-3,
        most=count,
        prior=expect,
    )
    # what the grid's mid-cells and rim are to it, all the region is to the exploration
    wide = Triangles(PlaneSites(grown.sample_sites.places, reach=1.0), grown.values, grown.noise, expect)
    return error(wide.at(q).mean, truth), error(even.at(q).mean, truth)


def test_fifty_pokes_where_they_tell_most_are_as_good_as_a_grid_of_a_hundred():
    """Moulds poured each a little elsewhere: where a border lies in a grid's cell is luck, so the mean counts."""
    few, grid = np.mean([explored(seed, 50) for seed in range(200, 206)], axis=0)
    assert few < grid


def test_fifty_pokes_are_as_good_where_borders_run_half_way_between_the_grids_probes():
    """The mould as it is placed, which is the grid's luck: the mean over the noise of pokes."""
    few, grid = np.mean([explored(seed, 50, moved=False) for seed in range(210, 214)], axis=0)
    assert few < grid


def slid_over(at, rng, axis, across):
    """What a slide along one tangent would feel, 0.2 mm a bin, with noise of 0.01 N."""
    x = np.arange(REGION.low[axis] + 1.5e-3, REGION.high[axis], 2e-4)
    places = np.full((len(x), 2), across)
    places[:, axis] = x
    depth = np.full(len(x), 2.5e-3)
    normal, tangential = (share * at(places) * depth + 0.01 * rng.standard_normal(len(x)) for share in (1.0, 0.8))
    return SlidePath(x, normal, tangential, depth, across * np.eye(2)[1 - axis], np.eye(2)[axis])


def felt_along(way, bins=10):
    """Places every 2 mm and what was felt there: (n, 2) and (n,)."""
    cuts = np.arange(bins, len(way.x), bins)
    return (
        np.array([way.at(part.mean()) for part in np.split(way.x, cuts)]),
        np.array([part.mean() for part in np.split(way.felt[0], cuts)]),
    )


@pytest.mark.slow
@pytest.mark.parametrize(("moved", "seeds"), [(True, range(500, 520)), (False, range(600, 606))])
def test_eight_slides_and_thirty_five_pokes_are_better_than_a_grid_of_a_hundred(moved, seeds):
    """Moulds poured each a little elsewhere, and the mould as it is placed: what slides and pokes felt, together."""
    q, errors = REGION.grid(45), []
    ticks = np.linspace(-0.045, 0.045, 10)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        at = mould(rng.uniform(-0.01, 0.01, 2) * moved)
        ways = [
            slid_over(at, rng, axis, across) for axis in (0, 1) for across in (-0.03375, -0.01125, 0.01125, 0.03375)
        ]
        slides = [(way, changes(way)) for way in ways]
        # the closest that 35 pokes allow
        tried = (pokes_after_slides(slides, beside=3e-3, apart=1e-3 * apart) for apart in range(4, 20))
        start = next(places for places in tried if len(places) <= 35)

        def poke(place, at=at, rng=rng):
            value = float(at(place[None])[0] * (1 + 0.005 * rng.standard_normal()))
            return value, 0.005 * value

        *_, poked = explore(poke, REGION, start, apart=4e-3, most=35)
        places, values = zip(*(felt_along(way) for way in ways))
        places, values = np.vstack([poked.sample_sites.places, *places]), np.concatenate([poked.values, *values])
        even = at(grid) * (1 + 0.005 * rng.standard_normal(100))
        few, many = (Triangles(PlaneSites(p, reach=1.0), v, 0.005 * v) for p, v in ((places, values), (grid, even)))
        errors.append([error(grown.at(q).mean, at(q)) for grown in (few, many)])
    few, many = np.mean(errors, axis=0)
    print(f"eight slides and 35 pokes {100 * few:.2f} %, a grid of 100 pokes {100 * many:.2f} %, {len(errors)} moulds")
    assert few < many


def test_what_is_expected_saves_pokes_and_a_wrong_guess_costs_little():
    def good(at):
        return lambda q: (at(q) * (1 + 0.08 * np.sin(900 * q[:, 0])), 0.08 * at(q))

    def wrong(at):
        return lambda q: (np.full(len(q), 3000.0), np.full(len(q), 100.0))

    def silent(at):
        return lambda q: (np.full(len(q), np.nan), np.full(len(q), np.nan))

    seeds = range(200, 203)
    plain = np.mean([explored(seed, 25)[0] for seed in seeds])
    assert np.mean([explored(seed, 25, good)[0] for seed in seeds]) < 0.7 * plain
    assert np.mean([explored(seed, 25, wrong)[0] for seed in seeds]) < 1.3 * plain
    assert np.mean([explored(seed, 25, silent)[0] for seed in seeds]) == pytest.approx(plain)


def test_the_next_poke_halves_the_widest_open_border():
    ticks = np.linspace(-0.045, 0.045, 4)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    grown = Triangles(PlaneSites(places), np.where(places[:, 0] < 0.02, 500.0, 1000.0), np.full(16, 1.0))
    assert next_poke(grown, REGION, apart=4e-3).place[0] == pytest.approx(0.03)
    with pytest.raises(InputError, match="every place poked"):
        next_poke(grown, REGION, apart=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_any_map_on_a_plane_says_where_to_poke_next(method):
    ticks = np.linspace(-0.045, 0.045, 4)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    grown = interpolator(method, PlaneSites(places), np.where(places[:, 0] < 0.02, 500.0, 1000.0), np.full(16, 1.0))
    assert next_poke(grown, REGION, apart=4e-3).place[0] == pytest.approx(0.03)
    with pytest.raises(InputError, match="a positive distance"):
        next_poke(grown, REGION, apart=float("nan"))


def test_a_map_on_a_mesh_has_no_next_poke():
    import trimesh

    from kinid.mapping.interpolation.mesh import MeshSites, on_mesh
    from kinid.robotics.surface import Mesh

    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    grown = on_mesh("nearest", MeshSites(mesh, mesh.vertices[:5]), np.ones(5))
    with pytest.raises(InputError, match="'triangles'"):
        next_poke(grown, REGION, apart=4e-3)


def test_exploring_ends_with_its_count():
    region = Region((0.0, 0.0), (0.1, 0.1))
    maps = list(explore(lambda p: (800.0 + 1e3 * p[0], 1.0), region, region.grid(2), apart=0.003, most=9))
    assert [len(m.values) for m in maps] == [4, 5, 6, 7, 8, 9]
    with pytest.raises(InputError, match="starting places"):
        next(explore(lambda p: (1.0, 1.0), region, region.grid(1), apart=0.003, most=9))
    with pytest.raises(InputError, match="a region from"):
        Region((0.1, 0.0), (0.0, 0.1))


def test_a_long_slide_is_cut_into_places_with_their_own_friction():
    """Across a border of the virtual mould, from joints and wrench alone, beside the truth."""
    from kinid.lab.experiments import prepare
    from kinid.lab.materials import MOULD
    from kinid.lab.protocol import Slide, five_phases
    from kinid.mapping.probes import Prober

    base = prepare("slide", material="mould", seed=1)
    slide = Slide(depth=2.5e-3, speed=8e-3, length=0.018, directions=(0.0,))
    script = five_phases(slide, place=(0.0, -0.025), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
    setup = dataclasses.replace(base, script=script, seed=3)
    prober = Prober.of(setup.rig, ["kelvin-voigt", "coulomb-friction"])
    properties, probes = prober.of_log(setup.run().log, "slide")
    names = [p.name for p in properties]
    assert len(probes) > 12
    flat = np.array([(p.place - prober.surface.point) @ prober.surface.axes[:2].T for p in probes])
    truth = MOULD.at(*flat.T)
    away = np.abs(flat[:, 0] - 1.5e-3 * np.sin(90 * -0.025)) > 5e-3
    stiffness = np.array([p.values[names.index("stiffness")] for p in probes])
    friction = np.array([p.values[names.index("friction")] for p in probes])
    assert np.allclose(stiffness[away], (truth["stiffness"] + truth["layer"])[away], rtol=0.03)
    assert np.allclose(friction[away], truth["friction"][away], rtol=0.05)
    assert all(np.isinf(p.covariance[names.index("damping"), names.index("damping")]) for p in probes)
    whole = Prober.of(setup.rig, ["kelvin-voigt"], along=0).of_log(setup.run().log, "slide")[1]
    assert len(whole) == 1
    with pytest.raises(InputError, match="pieces of slides"):
        Prober.of(setup.rig, along=1.0)
