"""Friction while sliding, and the equivalent coefficient."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.estimators import Constant, Friction, Status, equivalent_friction


def slide(n=2000, mu=0.6, viscous=3.0, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 1e-3
    load = 3.0 + 1.5 * np.sin(2 * np.pi * 0.7 * t)
    slip = np.stack([0.05 * np.sin(2 * np.pi * 1.1 * t), 0.03 * np.cos(2 * np.pi * 0.6 * t)], axis=1)
    speed = np.linalg.norm(slip, axis=1)
    force = -slip / speed[:, None] * (mu * load + viscous * speed)[:, None]
    return load, slip, force + noise * rng.normal(size=force.shape)


def test_recovers_coulomb_and_viscous_friction():
    for axes in (2, 1):
        load, slip, force = slide()
        if axes == 1:
            slip = slip[:, 0]
            force = -np.sign(slip) * (0.6 * load + 3.0 * np.abs(slip))
        track = Friction().run(load, slip, force)
        np.testing.assert_allclose(track.theta[-1], [0.6, 3.0], rtol=1e-9)
        assert track.valid[-1]


def test_intervals_cover_the_truth():
    inside = np.zeros(2)
    for seed in range(400):
        track = Friction().run(*slide(noise=0.05, seed=seed))
        low, high = track.final.interval.T
        inside += (low < [0.6, 3.0]) & (high > [0.6, 3.0])
    print(f"friction: 95 % intervals of μ and c cover {inside / 4} %")
    assert (np.abs(inside / 400 - 0.95) < 0.03).all()  # 400 runs: ±2.2 % is two standard deviations
    assert track.noise[-1] == pytest.approx(0.05, rel=0.1)  # 2000 samples: 1.6 % is one standard deviation


def test_a_force_across_the_slip_is_not_friction():
    load, slip, force = slide()
    across = np.stack([-slip[:, 1], slip[:, 0]], axis=1)
    np.testing.assert_allclose(Friction().run(load, slip, force + 40.0 * across).theta[-1], [0.6, 3.0], rtol=1e-9)


def test_rest_and_air_do_not_update():
    load, slip, force = slide()
    slip[500:700] *= 1e-4
    load[900:1000] = 0.01
    track = Friction(Constant(0.99)).run(load, slip, force)
    assert (track.status[500:700] == Status.NOT_SLIDING).all()
    assert (track.status[900:1000] == Status.NO_CONTACT).all()
    assert (track.theta[500:700] == track.theta[499]).all()
    assert "slide faster" in Status.NOT_SLIDING.remedy


def test_one_load_and_one_speed_cannot_tell_them_apart():
    n = 1000
    track = Friction().run(np.full(n, 2.0), np.full(n, 0.02), np.full(n, -1.3))
    assert track.final.status is Status.NOT_EXCITED


def test_online_is_the_batch():
    load, slip, force = slide(300, noise=0.02)
    load[7] = np.nan
    track, online = Friction().run(load, slip, force), Friction().online()
    for k in range(300):
        estimate = online.update(load[k], slip[k], force[k])
        assert (estimate.values == track.theta[k]).all()
    assert estimate.skipped == 1


def test_equivalent_friction_is_the_ratio_while_sliding():
    load, slip, force = slide(viscous=0.0)
    slip[:100] = 0.0
    load[200], force[300] = np.nan, np.inf
    found = equivalent_friction(load, slip, force)
    assert found.sliding.sum() == len(found.values) == 1898
    np.testing.assert_allclose(found.values, 0.6, rtol=1e-12)
    assert found.mean == pytest.approx(0.6, rel=1e-12)
    assert found.std < 1e-9
    assert "1898 of 2000" in found.status


def test_equivalent_friction_of_nothing_says_so():
    found = equivalent_friction(np.ones(10), np.zeros(10), np.ones(10))
    assert len(found.values) == 0
    assert found.mean == 0.0
    assert "slide under load" in found.status


def test_bad_input_is_named():
    with pytest.raises(InputError, match="same axes"):
        Friction().run(np.ones(5), np.ones((5, 2)), np.ones(5))
    with pytest.raises(InputError, match="≥ 0"):
        Friction(least_speed=-1.0)
    with pytest.raises(InputError, match="one length"):
        equivalent_friction(np.ones(5), np.ones(4), np.ones(5))
