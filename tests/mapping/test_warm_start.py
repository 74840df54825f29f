"""What a map, a picture or pooled logs let expect of a place."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.mapping.property_map import PICTURE, Probe, Property, PropertyMap
from kinid.mapping.warm_start import NEAREST, SPREADS, Expectation, Neighbourhood
from kinid.robotics.surface import Plane

PLANE = Plane(np.array([0.55, 0.0, 0.1]), np.eye(3))
KINDS = (Property("stiffness", "N/m"), Property("damping", "N·s/m"))
NAMES = ("stiffness", "damping")


def probe(x, values, sd, **more):
    return Probe(PLANE.point + [x, 0.0, 0.0], np.array(values), np.diag(np.square(sd)), **more)


def row(values, sd=(3.0, 0.5), n=12, seed=0):
    """Places 10 mm apart of one material, as touches feel them."""
    rng = np.random.default_rng(seed)
    return [probe(0.01 * k, values + rng.standard_normal(2) * sd, sd) for k in range(n)]


def joined(probes, near=None):
    near, grown = near or Neighbourhood(Expectation()), PropertyMap(PLANE, KINDS)
    for each in probes:
        grown = grown.added(near.applied(grown, NAMES, each))
    return grown, near


def test_how_much_neighbours_differ_is_learnt():
    alike, near = joined(row([732.0, 9.9]))
    assert Neighbourhood(Expectation()).spread == max(SPREADS)
    assert near.spread <= 0.02
    assert alike.deviations("damping")[-1] < 0.3
    assert alike.values("damping")[-1] == pytest.approx(9.9, abs=0.6)
    rng = np.random.default_rng(1)
    uneven = [probe(0.01 * k, [732.0, 9.9] * np.exp(0.1 * rng.standard_normal(2)), (3.0, 0.5)) for k in range(30)]
    _, near = joined(uneven)
    assert near.spread >= 0.08


def test_another_material_and_a_law_that_fails_stay_what_their_touches_say():
    soft, hard = row([510.0, 7.2], n=10), probe(0.1, [994.0, 14.5], (3.0, 0.5))
    grown, near = joined([*soft, hard])
    assert grown.values("damping")[-1] == pytest.approx(14.5, rel=1e-3)
    assert grown.deviations("damping")[-1] == pytest.approx(0.5, rel=1e-2)
    fails = probe(0.11, [520.0, 7.2], (200.0, 3.0), residual=0.3, noise=0.03)
    assert near.applied(grown, NAMES, fails) is fails
    # nor is it expected anywhere else
    after = grown.added(fails)
    start = near.at(after, fails.place, NAMES)
    assert len(start.candidates) == NEAREST
    assert all(520.0 not in candidate.values for candidate in start.candidates)


def test_what_a_touch_leaves_open_stays_open():
    near = Neighbourhood(Expectation())
    grown, _ = joined(row([510.0, 7.2]), near)
    piece = probe(0.02, [500.0, 0.0], (30.0, np.inf))
    made = near.applied(grown, NAMES, piece)
    assert np.isinf(made.covariance[1, 1])
    assert made.covariance[0, 0] < 100.0


def test_a_picture_or_a_pooled_fit_is_expected_too(tmp_path):
    cells = [probe(0.01 * k, [732.0, 0.0], (20.0, 1.0)) for k in range(4)]
    seen = PropertyMap(PLANE, KINDS[:1], (), PICTURE).added(
        *(Probe(c.place + [0.0, y, 0.0], c.values[:1], c.covariance[:1, :1]) for c in cells for y in (0.0, 0.01))
    )
    seen.write(tmp_path / "seen.parquet")
    near = Neighbourhood(Expectation.read(str(tmp_path / "seen.parquet")))
    touch = probe(0.012, [735.0, 10.2], (60.0, 0.7))
    made = near.applied(None, NAMES, touch)
    assert np.sqrt(made.covariance[0, 0]) < 60.0
    assert made.values[1] == pytest.approx(10.2)
    known = Expectation(pooled={"stiffness": (732.0, 5.0), "damping": (9.9, 0.1)})
    made = Neighbourhood(known).applied(None, NAMES, probe(0.0, [735.0, 11.5], (6.0, 2.0)))
    assert abs(made.values[1] - 9.9) < abs(11.5 - 9.9)
    assert Expectation.read("neighbours").candidates(touch.place, NAMES) == []
    with pytest.raises(InputError, match="a prior 'nearby'"):
        Expectation.read("nearby")


def test_a_fit_of_many_logs_is_a_pooled_material(tmp_path):
    import kinid
    from kinid.mapping.warm_start import pooled

    t = np.arange(0, 2, 2e-3)
    depth = 3e-3 + 1e-3 * np.sin(6 * t) + 5e-4 * np.sin(31 * t)
    rate = np.gradient(depth, t)
    force = 732.0 * depth + 9.9 * rate + 0.02 * np.random.default_rng(0).standard_normal(len(t))
    log = kinid.Log(t, contact={"depth": depth, "depth_rate": rate, "normal_force": force})
    fit = kinid.Model("kelvin-voigt").fit(kinid.contact_series(log, kinid.Rig.parse({})))
    fit.save(tmp_path / "fit.json")
    found = Expectation.read(str(tmp_path / "fit.json")).pooled
    assert found.keys() == {"stiffness", "damping"} == pooled(fit).keys()
    assert found["stiffness"][0] == pytest.approx(732.0, rel=0.01)
    assert 0.0 < found["damping"][1] < 1.0
