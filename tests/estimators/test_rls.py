"""Recursive least squares against the batch solution, against wind-up, and against bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from kinid.errors import InputError
from kinid.estimators import Constant, Excitation, Prior, RecursiveLeastSquares, Scheduled, Status, _machine

NAMES = ("a", "b", "c", "d", "e", "f")


def data(n: int, p: int, seed: int = 0, noise: float = 0.1):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(n, p)) @ (np.eye(p) + 0.3 * rng.normal(size=(p, p)))
    return rows, rows @ np.arange(1.0, p + 1.0) + noise * rng.normal(size=n)


def unit_covariance(online):
    return _machine.unit_covariance(online.machine.room.state, len(online.values))


def batch(rows, y, weights, prior_weight, prior):
    """Weighted ridge regression, by QR of the stacked rows: no normal equations in the reference."""
    root = np.linalg.cholesky(np.linalg.inv(prior.covariance)).T * math.sqrt(prior_weight)
    stacked = np.vstack([root, rows * np.sqrt(weights)[:, None]])
    right = np.concatenate([root @ prior.values, y * np.sqrt(weights)])
    theta = np.linalg.lstsq(stacked, right, rcond=None)[0]
    r = np.linalg.qr(stacked, mode="r")
    inverse = np.linalg.inv(r)
    return theta, inverse @ inverse.T


@pytest.mark.parametrize("p", [1, 2, 3, 4, pytest.param(6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("forgetting", [Constant(1.0), Constant(0.98), Scheduled(rate=5.0, start=0.3, drop=0.01)])
def test_equals_the_weighted_batch_solution(p, forgetting):
    n = 1500
    rows, y = data(n, p)
    t = np.arange(n) * 1e-3
    prior = Prior(np.full(p, 0.5), np.diag(np.linspace(2.0, 3.0, p)) + 0.4)
    estimator = RecursiveLeastSquares(NAMES[:p], forgetting, prior, covariance_limit=None)
    track = estimator.run(rows, y, t)
    beta = np.broadcast_to(forgetting.factors(t), n)
    for k in (0, p, 40, n - 1):
        after = np.cumprod(np.append(1.0, beta[: k + 1][::-1]))  # of samples k, k−1, …, and of the prior
        theta, covariance = batch(rows[: k + 1], y[: k + 1], after[:-1][::-1], after[-1], prior)
        np.testing.assert_allclose(track.theta[k], theta, rtol=1e-9, atol=1e-9)
    online = estimator.online()
    online.chunk(rows, y, t=t)
    unit = unit_covariance(online)
    np.testing.assert_allclose(unit, covariance, rtol=1e-9, atol=1e-9 * np.abs(covariance).max())
    print(f"p = {p}, {forgetting}: largest difference {np.abs(track.theta[-1] - theta).max():.1e}")


def test_noise_is_that_of_the_batch_residual():
    rows, y = data(400, 3)
    track = RecursiveLeastSquares(NAMES[:3]).run(rows, y)
    residual = y - rows @ np.linalg.lstsq(rows, y, rcond=None)[0]
    expected = residual @ residual / (400 - 3)
    assert track.noise_variance[-1] == pytest.approx(expected, rel=1e-8)  # the diffuse prior's share is about 1e-10
    covariance = expected * np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(track.final.covariance, covariance, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(track.variance[-1], np.diagonal(track.final.covariance), rtol=1e-9)


@pytest.mark.parametrize(("beta", "directional"), [(1.0, False), (0.97, False), (0.99, True)])
def test_intervals_cover_the_truth(beta, directional):
    p, n, runs = 3, 400, 1500
    estimator = RecursiveLeastSquares(NAMES[:p], Constant(beta), directional=directional, excitation=None)
    truth = np.arange(1.0, p + 1.0)
    rng = np.random.default_rng(5)
    inside = np.zeros(p)
    for _ in range(runs):
        rows = rng.normal(size=(n, p))
        low, high = estimator.run(rows, rows @ truth + rng.normal(size=n)).final.interval.T
        inside += (low < truth) & (truth < high)
    share = inside / runs
    print(f"β = {beta}, directional {directional}: 95 % intervals cover {np.round(100 * share, 1)} %")
    # 1500 runs: ±1.1 % is two standard deviations; with directional forgetting they are an upper bound
    low, high = (0.95, 1.0) if directional else (0.935, 0.965)
    assert ((share > low) & (share <= high)).all()


def test_directional_forgetting_is_kulhavys():
    rows, y = data(300, 3)
    beta = 0.95
    theta, unit = np.zeros(3), 100.0 * np.eye(3)
    for phi, value in zip(rows, y):
        s = phi @ unit @ phi
        theta = theta + unit @ phi * (value - phi @ theta) / (1.0 + s)
        unit = np.linalg.inv(np.linalg.inv(unit) + (beta - (1.0 - beta) / s) * np.outer(phi, phi))
    prior = Prior(np.zeros(3), np.full(3, 100.0))
    online = RecursiveLeastSquares(NAMES[:3], Constant(beta), prior, True, None).online()
    online.chunk(rows, y)
    np.testing.assert_allclose(online.values, theta, rtol=1e-9)
    np.testing.assert_allclose(unit_covariance(online), unit, rtol=1e-8)


AIR = {
    "zeros": lambda n, rng: np.zeros((n, 4)),
    "one direction": lambda n, rng: np.ones((n, 4)),
    "noise of 1e-9": lambda n, rng: 1e-9 * rng.normal(size=(n, 4)),
    "huge in one, tiny in the others": lambda n, rng: np.array([1e6, 1e-9, 1e-9, 1e-9]) * rng.normal(size=(n, 4)),
}


def survive(air: str, directional: bool, samples: int) -> None:
    rng = np.random.default_rng(2)
    prior = Prior(np.zeros(4), np.full(4, 1e6))
    online = RecursiveLeastSquares(NAMES[:4], Constant(0.98), prior, directional).online()
    rows, y = data(1000, 4, noise=1e-3)
    online.chunk(rows, y)
    learnt = online.values.copy()
    piece = 100_000
    for _ in range(samples // piece):
        quiet = AIR[air](piece, rng)
        track = online.chunk(quiet, quiet @ learnt)
    unit = unit_covariance(online)
    assert np.isfinite(unit).all()
    assert (np.diagonal(unit) <= 1e6 * (1 + 1e-9)).all()  # never above the limit, but for rounding
    assert np.linalg.eigvalsh(unit)[0] >= -1e-9 * np.linalg.eigvalsh(unit)[-1]
    assert (online.machine.room.state[4:8] >= 0.0).all()  # d of U·diag(d)·Uᵀ, exactly
    assert not track.valid[-1]
    assert track.final.status is Status.NOT_EXCITED
    np.testing.assert_allclose(online.values, learnt, atol=1e-6)  # rounding of values near 4 over all samples
    track = online.chunk(*data(1000, 4, seed=9, noise=1e-3))
    np.testing.assert_allclose(track.theta[-1], [1.0, 2.0, 3.0, 4.0], atol=2e-3)  # 1e-3 noise over 50 samples
    assert track.valid[-1] or air.startswith("huge")  # there the scale of excitation is now 1e6: documented


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize("air", AIR)
def test_survives_without_excitation(air, directional):
    survive(air, directional, 500_000)


def test_survives_ten_million_samples_without_excitation():
    survive("one direction", False, 10_000_000)
    survive("zeros", False, 10_000_000)


def test_without_a_limit_the_covariance_does_wind_up():
    rows, y = data(500, 2)
    quiet = np.zeros((2000, 2))  # the noise goes on, or it would be taken for gone
    estimator = RecursiveLeastSquares(NAMES[:2], Constant(0.98), Prior(np.zeros(2), np.ones(2)), covariance_limit=None)
    track = estimator.run(
        np.vstack([rows, quiet]), np.concatenate([y, 0.1 * np.random.default_rng(1).normal(size=2000)])
    )
    assert track.variance[-1, 0] > 1e15 * track.variance[499, 0]  # 0.98^-2000 = 3.5e17


def test_online_is_the_batch():
    rows, y = data(700, 4)
    y[100], rows[200, 2] = np.nan, np.inf
    t = np.arange(700) * 1e-3
    estimator = RecursiveLeastSquares(NAMES[:4], Scheduled(5.0, 0.2))
    track, online = estimator.run(rows, y, t), estimator.online()
    for k in range(700):
        estimate = online.update(rows[k], y[k], t=t[k])
        assert (estimate.values == track.theta[k]).all()
        assert estimate.status == track.status[k]
        assert estimate.innovation == track.innovation[k]
    assert estimate.skipped == track.skipped == track.final.skipped == 2
    assert estimate.updates == 698
    np.testing.assert_array_equal(estimate.covariance, track.final.covariance)


def test_step_returns_the_status_and_keeps_values():
    online = RecursiveLeastSquares(("slope",)).online()
    assert online.step([1.0], 2.0) is Status.STARTING
    assert online.values[0] == pytest.approx(2.0, rel=1e-9)  # the diffuse prior weighs 1e-12
    assert online.step([math.nan], 2.0) is Status.NOT_FINITE


def test_recovers_without_noise():
    rows, y = data(300, 4, noise=0.0)
    track = RecursiveLeastSquares(NAMES[:4], Constant(0.95)).run(rows, y)
    np.testing.assert_allclose(track.theta[-1], [1.0, 2.0, 3.0, 4.0], rtol=1e-9)
    assert track.valid[-1]


def test_follows_a_change_with_forgetting_only():
    rows, _ = data(2000, 2, noise=0.0)
    truth = np.where(np.arange(2000)[:, None] < 1000, [1.0, 2.0], [3.0, -1.0])
    y = (rows * truth).sum(axis=1)
    forgets = RecursiveLeastSquares(NAMES[:2], Constant(0.98)).run(rows, y).theta[-1]
    keeps = RecursiveLeastSquares(NAMES[:2]).run(rows, y).theta[-1]
    np.testing.assert_allclose(forgets, [3.0, -1.0], atol=1e-6)  # 0.98^1000 = 2e-9
    assert np.abs(keeps - [3.0, -1.0]).max() > 0.5


def test_warm_start_from_a_neighbour_is_better_at_once():
    truth = np.array([1.0, 2.0, 3.0])
    rows, y = data(500, 3, noise=0.3)
    estimator = RecursiveLeastSquares(NAMES[:3])
    neighbour = estimator.run(rows, y).final
    rows, y = data(500, 3, seed=4, noise=0.3)
    y = y + rows @ (0.05 * truth)  # the next place is 5 % stiffer
    warm = RecursiveLeastSquares(NAMES[:3], prior=Prior.near(neighbour, 0.1)).run(rows, y)
    cold = estimator.run(rows, y)
    target = 1.05 * truth
    early = slice(2, 12)
    error = [np.sqrt(np.mean((track.theta[early] - target) ** 2)) for track in (warm, cold)]
    print(f"error of samples 3 to 12: warm {error[0]:.3f}, cold {error[1]:.3f}")
    assert error[0] < 0.5 * error[1]
    # both end where the data say: of 500 samples the prior's 0.1…0.3 weighs under a per cent
    np.testing.assert_allclose(warm.theta[-1], cold.theta[-1], atol=0.01)


def test_constant_input_is_not_excited():
    track = RecursiveLeastSquares(("x", "v"), Constant(0.98)).run(np.full((500, 2), 0.3), np.full(500, 1.0))
    assert not track.valid.any()
    assert track.status[-1] == Status.NOT_EXCITED
    assert "vary depth" in track.final.status.remedy
    assert np.isfinite(track.theta).all()


def test_nothing_but_gaps_is_said():
    track = RecursiveLeastSquares(("x",)).run(np.full((20, 1), np.nan), np.zeros(20))
    assert track.skipped == 20
    assert track.final.status is Status.NOT_FINITE
    assert (track.theta == 0.0).all()
    assert np.isinf(track.variance).all()


@given(
    rows=hnp.arrays(
        np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.floats(width=64, allow_subnormal=True)
    ),
    seed=st.integers(0, 9),
    beta=st.floats(0.01, 1.0),
    directional=st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_whatever_comes_in_numbers_come_out(rows, seed, beta, directional):
    y = 1e3 * np.random.default_rng(seed).normal(size=len(rows))
    track = RecursiveLeastSquares(NAMES[:3], Constant(beta), directional=directional).run(rows, y)
    assert np.isfinite(track.theta).all()
    assert not np.isnan(track.variance).any()
    assert not np.isnan(track.innovation).any()
    assert (track.variance >= 0.0).all()
    usable = (np.abs(rows) < 1e50).all(axis=1)
    assert track.skipped == np.count_nonzero(~usable)
    assert track.final.updates == np.count_nonzero(usable)


@pytest.mark.parametrize(
    ("rows", "y", "t"),
    [
        (np.ones((5, 3)), np.ones(5), None),
        (np.ones((5, 2)), np.ones(4), None),
        (np.ones(5), np.ones(5), None),
        (np.ones((0, 2)), np.ones(0), None),
        (np.ones((5, 2)), np.ones((5, 1)), None),
        (np.ones((5, 2)), ["x"] * 5, None),
        (np.ones((5, 2)), np.ones(5), np.zeros(5)),
        (np.ones((5, 2)), np.ones(5), np.arange(4.0)),
        (np.ones((5, 2)), np.ones(5), [0.0, 1.0, np.nan, 3.0, 4.0]),
        (3.0, 4.0, None),
    ],
)
def test_wrong_shapes_are_named(rows, y, t):
    with pytest.raises(InputError, match="to mend it"):
        RecursiveLeastSquares(("x", "v")).run(rows, y, t)


def test_wrong_settings_are_named():
    for bad in (0.0, 1.1, math.nan):
        with pytest.raises(InputError, match="0 < β ≤ 1"):
            Constant(bad)
    with pytest.raises(InputError, match="rate"):
        Scheduled(rate=-1.0)
    with pytest.raises(InputError, match="all different"):
        RecursiveLeastSquares(("x", "x"))
    with pytest.raises(InputError, match="a value for each"):
        RecursiveLeastSquares(("x", "v"), prior=Prior(np.zeros(3), np.ones(3)))
    with pytest.raises(InputError, match="limit"):
        RecursiveLeastSquares(("x",), covariance_limit=0.0).online()
    with pytest.raises(InputError, match="without time"):
        RecursiveLeastSquares(("x",), Scheduled()).run(np.ones((3, 1)), np.ones(3))
    with pytest.raises(InputError, match="a sample of shapes"):
        RecursiveLeastSquares(("x", "v")).online().update([1.0, 2.0, 3.0], 1.0)
    with pytest.raises(InputError, match="order of run"):
        RecursiveLeastSquares(("x", "v")).online().chunk(np.ones((4, 3)), np.ones(4))
    with pytest.raises(InputError, match="one a regressor"):
        RecursiveLeastSquares(("x", "v"), excitation=Excitation(scale=(1.0,))).online()


def test_scheduled_forgetting_is_the_formula_and_stays_in_range():
    schedule = Scheduled(rate=5.0, start=2.0)
    t = np.array([0.0, 1.0, 2.0, 2.3, 4.0])
    np.testing.assert_allclose(schedule.factors(t)[2:], 1.0 - 0.01 * np.exp(-5.0 * (t[2:] - 2.0)), rtol=1e-15)
    np.testing.assert_array_equal(schedule.factors(t)[:2], 0.99)  # the bare formula says −219 at t = 0


def test_accuracies_are_one_for_each_parameter():
    for bad in ({"accuracy": (0.1,)}, {"beside": (0.1, -1.0)}):
        with pytest.raises(InputError, match="a share for each"):
            RecursiveLeastSquares(NAMES[:2], **bad)
