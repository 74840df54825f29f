"""Less touching: borders along slides with intervals and a kept false-alarm rate, and pokes where they tell most."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import kinid
from kinid.errors import InputError
from kinid.exploration import explore, next_poke, pokes_after_slides
from kinid.exploration_slide import SlidePath, by_slope, changes, paths
from kinid.interpolation import PlaneGround
from kinid.interpolation_gp import GaussianProcess


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
CROSSINGS = [((0.0, -0.025), 0.0, 0, 1.5e-3 * np.sin(90 * -0.025)), ((-0.025, 0.0), np.pi / 2, 1, -1.2e-3 * np.sin(110 * -0.025))]


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
    """Noise of two colours on a level: at a stated 5 % some 5 % alarm (300 tries: 1.3 % standard error), never far more."""
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


def test_the_next_poke_goes_where_nothing_is_known():
    rng = np.random.default_rng(7)
    places = rng.uniform(0, 0.1, (60, 2))
    places = places[np.hypot(*(places - [0.07, 0.03]).T) > 0.025]
    process = GaussianProcess.fit(PlaneGround(places), 800 + 300 * np.sin(60 * places[:, 0]), np.full(len(places), 2.0))
    ticks = np.linspace(0.005, 0.095, 19)
    candidates = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    chosen = next_poke(process, candidates, apart=0.004)
    assert np.hypot(*(chosen.place - [0.07, 0.03])) < 0.02
    # a picture that is sure of that corner sends the poke elsewhere
    sure = next_poke(process, candidates, apart=0.004, prior=lambda p: (np.hypot(*(p - [0.07, 0.03]).T) < 0.03).astype(float))
    assert np.hypot(*(sure.place - [0.07, 0.03])) > 0.02
    with pytest.raises(InputError, match="every place poked"):
        next_poke(process, places[:5], apart=0.004)


def test_exploring_ends_with_its_count():
    maps = list(explore(lambda p: (800.0 + 1e3 * p[0], 1.0), np.random.default_rng(8).uniform(0, 0.1, (80, 2)),
                        np.array([[0.01, 0.01], [0.09, 0.01], [0.01, 0.09], [0.09, 0.09]]), apart=0.003, most=9))  # fmt: skip
    assert [len(m.values) for m in maps] == [4, 5, 6, 7, 8, 9]
