"""Noise that wanders: found where it is, not where it isn't, and taken into intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from kinid.estimators.batch import autoregression, solve
from kinid.estimators.wander import walk_variance
from kinid.parameter import Parameter

N = 6000


def _residual(rng: np.random.Generator, walk: float, colour: float = 0.0) -> np.ndarray:
    """Noise of standard deviation 1 that wanders by `walk` a sample, less the mean that a fit takes out."""
    noise = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], rng.normal(size=N)) + walk * np.cumsum(rng.normal(size=N))
    return np.asarray(noise - noise.mean())


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_noise_that_stays_hardly_widens_an_interval(colour: float) -> None:
    """By a walk that isn't there, the standard error of a force in the middle of a log grows by some per cent."""
    rng, wider, at = np.random.default_rng(1), [], np.arange(N)
    columns = np.column_stack([(at > 0.3 * N) & (at < 0.7 * N), np.ones(N)]).astype(float)
    inverse, onwards = np.linalg.inv(columns.T @ columns), np.cumsum(columns[::-1], axis=0)
    for _ in range(200):
        residual = _residual(rng, 0.0, colour)
        coefficients, variance = autoregression(residual)
        walk = walk_variance(residual, columns, coefficients, variance)
        extra = (inverse @ (walk * onwards.T @ onwards) @ inverse)[0, 0]
        wider.append(np.sqrt(1.0 + extra / (variance / (1.0 - coefficients.sum()) ** 2 * inverse[0, 0])))
    print(
        f"wider by {100 * (np.median(wider) - 1):.1f} % in the median, {100 * (np.mean(wider) - 1):.1f} % in the mean"
    )
    assert np.median(wider) < 1.01
    assert np.mean(wider) < 1.10


@pytest.mark.parametrize("walk", [0.003, 0.02])
def test_a_walk_is_measured(walk: float) -> None:
    rng, found = np.random.default_rng(2), []
    for _ in range(60):
        residual = _residual(rng, walk)
        residual[1000:1500] = np.nan  # a hole
        found.append(walk_variance(residual, np.ones((N, 1)), *autoregression(residual)))
    assert 0.6 * walk**2 < np.median(found) < 1.6 * walk**2


def test_what_parameters_took_up_is_no_walk() -> None:
    """A ramp that the model has is taken out of the account, not out of the residual alone."""
    rng = np.random.default_rng(3)
    residual = _residual(rng, 0.0) + np.linspace(-1, 1, N)
    coefficients, variance = autoregression(residual)
    blind = walk_variance(residual, np.ones((N, 1)), coefficients, variance)
    assert walk_variance(residual, np.column_stack([np.ones(N), np.arange(N)]), coefficients, variance) < 1e-2 * blind


def test_a_short_log_tells_nothing() -> None:
    assert walk_variance(np.ones(100), np.ones((100, 1)), np.zeros(0), 1.0) == 0.0
    assert walk_variance(np.full(5000, np.nan), np.ones((5000, 1)), np.zeros(0), 1.0) == 0.0
    assert walk_variance(np.zeros(5000), np.ones((5000, 1)), np.zeros(0), 0.0) == 0.0


@pytest.mark.parametrize("walk", [0.0, 0.01])
def test_intervals_cover_under_a_zero_that_creeps(walk: float) -> None:
    """A force in the second half of a log, beside a constant: without the walk a third of the intervals would miss."""
    rng, step = np.random.default_rng(4), (np.arange(N) > N / 2).astype(float)
    columns = np.stack([step, np.ones(N)])
    parameters = [Parameter(name, name, "N", 0.0, linear=True) for name in ("force", "zero")]
    inside, narrow = [], []
    for _ in range(150):
        y = 2.0 * step + _residual(rng, walk)
        found = solve(lambda p: (p @ columns)[None, :], y[None, :], parameters)
        error = abs(found.values[0] - 2.0)
        inside.append(error < 1.96 * found.standard_errors[0])
        narrow.append(error < 1.96 * 2.0 / np.sqrt(N))
    print(
        f"walk {walk}: {100 * np.mean(inside):.1f} % cover; {100 * np.mean(narrow):.1f} % if the zero were taken to "
        f"stay"
    )
    assert 0.88 <= np.mean(inside) <= 0.99
    if walk:
        assert np.mean(narrow) < 0.7
