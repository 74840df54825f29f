"""Friction while sliding, and the equivalent coefficient."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.estimators import Friction, Prior, Status, equivalent_friction


def slide(n=2000, mu=0.6, viscous=3.0, noise=0.0, seed=0):
    """Coulomb's own friction, which turns around at once."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 1e-3
    load = 3.0 + 1.5 * np.sin(2 * np.pi * 0.7 * t)
    slip = np.stack([0.05 * np.sin(2 * np.pi * 1.1 * t), 0.03 * np.cos(2 * np.pi * 0.6 * t)], axis=1)
    speed = np.linalg.norm(slip, axis=1)
    force = -slip / speed[:, None] * (mu * load + viscous * speed)[:, None]
    return load, slip, force + noise * rng.normal(size=force.shape)


def bent(n=8000, mu=0.6, viscous=3.0, length=1e-4, seed=0, noise=(0.02, 0.03, 5e-5), zeros=(0.0, 0.0, 0.0)):
    """To and fro at several speeds, turned around by Dahl's bristles: load, slip, force, noise in all of them.

    Noise and zeros are of tangential force, normal force and slip rate, and of both tangential forces and the normal.
    """
    rng = np.random.default_rng(seed)
    load, speed, u = turning(n, length)
    slip = np.stack([speed, np.zeros(n)], axis=1)
    force = np.stack([-(mu * load * u + viscous * speed), np.zeros(n)], axis=1) + zeros[:2]
    return (
        load + zeros[2] + noise[1] * rng.normal(size=n),
        slip + noise[2] * rng.normal(size=slip.shape),
        force + noise[0] * rng.normal(size=force.shape),
    )


@cache
def turning(n, length):
    """Load, speed, and the deflection of Dahl's bristles."""
    t = np.arange(n) * 1e-3
    load = 2.0 + 0.8 * np.sin(2 * np.pi * 0.31 * t)
    speed = (0.004 + 0.003 * np.sin(2 * np.pi * 0.23 * t)) * np.sign(np.sin(2 * np.pi * 0.5 * t))
    u, last = np.empty(n), 0.0
    for k in range(n):
        step = speed[k] * 1e-3
        last = np.sign(step) + (last - np.sign(step)) * np.exp(-abs(step) / length)
        u[k] = last
    return load, speed, u


def test_recovers_coulomb_and_viscous_friction():
    for axes in (2, 1):
        load, slip, force = slide(noise=0.01)
        if axes == 1:
            slip = slip[:, 0]
            rng = np.random.default_rng(1)
            force = -np.sign(slip) * (0.6 * load + 3.0 * np.abs(slip)) + 0.01 * rng.normal(size=len(load))
        track = Friction(bristle=0.0, drift=(0.0, 0.0)).run(load, slip, force)
        # 0.01 N of noise in 2000 samples of 2 N and more: 0.02 % of μ, 1 % of c
        np.testing.assert_allclose(track.theta[-1], [0.6, 3.0], rtol=3e-2)
        assert track.valid[-1]


def test_intervals_cover_the_truth_with_noise_in_all_variables():
    inside, errors = np.zeros(2), []
    for seed in range(100):
        track = Friction().run(*bent(seed=seed))
        low, high = track.final.interval.T
        inside += (low < [0.6, 3.0]) & (high > [0.6, 3.0])
        errors.append(track.theta[-1] - [0.6, 3.0])
    print(f"friction: 95 % intervals of μ and c cover {inside} %, means {np.mean(errors, axis=0)}")
    # 100 runs: ± 4.4 % is two standard deviations; zeros may walk, which here they don't, so it may be more
    assert (inside / 100 > 0.90).all()
    assert np.abs(np.mean(errors, axis=0) / [0.6, 3.0]).max() < 0.02
    assert track.noise[-1] == pytest.approx(np.hypot(0.02, 0.6 * 0.03), rel=0.1)


def test_zeros_that_were_read_in_the_air_are_taken_off():
    zeros = (0.03, -0.02, 0.05)
    load, slip, force = bent(zeros=zeros)
    air = 2000
    rng = np.random.default_rng(1)
    load = np.concatenate([zeros[2] + 0.03 * rng.normal(size=air), load])
    slip = np.concatenate([np.zeros((air, 2)), slip])
    force = np.concatenate([np.array(zeros[:2]) + 0.02 * rng.normal(size=(air, 2)), force])
    touches = np.arange(len(load)) >= air
    known = Friction().run(load, slip, force, in_contact=touches).final
    # 0.05 N of 2 N is 2.5 % of μ where nobody knows of it; the filter's own zeros find a part
    assert known["friction"] == pytest.approx(0.6, rel=0.01)
    assert Friction().run(load[air:], slip[air:], force[air:]).final["friction"] < 0.6 * 0.99


def test_bristles_of_another_length_are_noticed():
    """The worst answer is a wrong one with a narrow interval: then innovations have a colour, and nothing is valid."""
    track = Friction().run(*bent(length=1e-3))
    assert abs(track.final["friction"] / 0.6 - 1.0) > 0.5
    assert (track.status == Status.MISFIT).any()
    assert not track.valid.any()
    assert Friction(bristle=1e-3).run(*bent(length=1e-3)).final["friction"] == pytest.approx(0.6, rel=0.02)


def test_a_force_across_the_slip_is_not_friction():
    load, slip, force = slide()
    across = np.stack([-slip[:, 1], slip[:, 0]], axis=1)
    plain = Friction(bristle=0.0, drift=(0.0, 0.0))
    # it is 2 N at most; what is left is the prior
    np.testing.assert_allclose(plain.run(load, slip, force + 40.0 * across).theta[-1], [0.6, 3.0], rtol=2e-3)


def test_rest_and_air_do_not_update():
    load, slip, force = slide()
    slip[500:700] *= 1e-4
    load[900:1000] = 0.01
    track = Friction(bristle=0.0).run(load, slip, force)
    # the speed is a mean over the last 20 samples: it takes a while to be at rest
    assert (track.status[620:700] == Status.NOT_SLIDING).all()
    assert (track.status[900:1000] == Status.NO_CONTACT).all()
    assert (track.theta[620:700] == track.theta[619]).all()
    assert "slide faster" in Status.NOT_SLIDING.remedy


def test_one_load_and_one_speed_cannot_tell_them_apart():
    n = 1000
    noise = 0.01 * np.random.default_rng(0).normal(size=n)
    track = Friction().run(np.full(n, 2.0), np.full(n, 0.02), -1.3 + noise)
    assert track.final.status is Status.NOT_EXCITED


def test_a_prior_is_where_it_starts():
    prior = Prior(np.array([0.6, 3.0]), np.array([1e-8, 1e-6]))
    track = Friction(prior=prior).run(*bent(n=300))
    np.testing.assert_allclose(track.theta[-1], [0.6, 3.0], rtol=1e-3)


def test_online_is_the_batch():
    load, slip, force = bent(300)
    touches = np.arange(300) > 100
    load[7] = np.nan
    track, online = Friction().run(load, slip, force, in_contact=touches), Friction().online()
    for k in range(300):
        estimate = online.update(load[k], slip[k], force[k], touches[k])
        assert (estimate.values == track.theta[k]).all()
    assert estimate.skipped == 1
    assert estimate.std == pytest.approx(np.sqrt(np.diagonal(estimate.covariance)), rel=1e-9)


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
    with pytest.raises(InputError, match="bristle"):
        Friction(bristle=-1.0)
    with pytest.raises(InputError, match="accuracy"):
        Friction(accuracy=0.0)
    with pytest.raises(InputError, match="friction, viscous"):
        Friction(prior=Prior(np.zeros(3), np.ones(3)))
    with pytest.raises(InputError, match="in_contact"):
        Friction().run(np.ones(5), np.ones(5), np.ones(5), in_contact=np.ones(4, np.bool_))
    with pytest.raises(InputError, match="one length"):
        equivalent_friction(np.ones(5), np.ones(4), np.ones(5))
