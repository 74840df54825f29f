"""Kalman filters, scores of intensities and the smoother against the same of textbook matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from kinid.kernels import fixed_interval, intensity

Array = NDArray[np.float64]
ORDER = 4


def step(h: float) -> tuple[Array, Array]:
    """F and Q of a step h."""
    move = np.array(
        [[h ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(ORDER)] for i in range(ORDER)]
    )
    to_end = [h ** (ORDER - 1 - i) / math.factorial(ORDER - 1 - i) for i in range(ORDER)]
    added = np.array(
        [[to_end[i] * to_end[j] * h / (2 * ORDER - 1 - i - j) for j in range(ORDER)] for i in range(ORDER)]
    )
    return move, added


def update(x: Array, p: Array, c: int, z: float, r: float) -> tuple[Array, Array, float, float, Array]:
    """State and covariance after a measurement of part c, its innovation, the variance of that, and 1 − K H."""
    variance, e = p[c, c] + r, z - x[c]
    gain, keep = p[:, c] / variance, np.eye(ORDER)
    keep[:, c] -= gain
    return x + gain * e, keep @ p @ keep.T + r * np.outer(gain, gain), e, variance, keep


def plain(tau: Array, y: Array, noise: Array, level: float, start: Array, spread: Array) -> Array:
    """Log-likelihood of each position, less a constant, (n,)."""
    x, p, out = start, spread, np.empty(len(y))
    for t, h in enumerate(tau):
        move, added = step(h)
        x, p, e, variance, _ = update(move @ x, move @ p @ move.T + level * added, 0, y[t], noise[t])
        out[t] = norm.logpdf(e, 0.0, variance**0.5)
    return out + 0.5 * math.log(2 * math.pi)


def measured(uneven: bool, kinds: int, octaves: float) -> tuple[Array, ...]:
    """A log whose jerk's intensity varies by so many octaves, as rests and turns make it: arguments of kernels."""
    n, rng = 1500, np.random.default_rng(5)
    tau = np.r_[0.0, 1.0 + 0.3 * uneven * rng.random(n - 1)]
    swing = np.stack([np.sin(0.01 * np.cumsum(tau) + c * np.pi / 2) * 0.01**c for c in range(kinds)], axis=1)
    variance = np.tile(1e-8 * np.array([1.0, 1e-2, 1e-4])[:kinds], (n, 1))
    z = swing + np.sqrt(variance) * rng.standard_normal((n, kinds))
    variance[rng.random((n, kinds)) < 0.1] = np.inf
    variance[0, 0] = 1e-8
    drive = 1e-10 * 2.0 ** (octaves * (0.5 - np.clip(3.0 * np.sin(0.01 * np.arange(n)), 0.0, 1.0)))
    return tau, z, variance, drive, np.array([z[0, 0], 0.0, 0.0, 0.0]), np.diag([1e-6, 1e-4, 1e-6, 1e-8])


CASES = pytest.mark.parametrize(("uneven", "kinds", "octaves"), [(False, 1, 80.0), (True, 1, 20.0), (True, 3, 40.0)])


@CASES
def test_score_is_that_of_matrices(uneven: bool, kinds: int, octaves: float) -> None:
    tau, z, variance, drive, start, spread = given = measured(uneven, kinds, octaves)
    n, total, passed = len(tau), 0.0, []
    x, p = start, spread
    for k in range(n):
        move, added = step(tau[k])
        x, p, own = move @ x, move @ p @ move.T + drive[k] * added, []
        for c in np.flatnonzero(variance[k] < np.inf).tolist():
            x, p, e, f, keep = update(x, p, c, z[k, c], variance[k, c])
            total += norm.logpdf(e, 0.0, f**0.5) + 0.5 * math.log(2 * math.pi)
            own.append((c, e, f, keep))
        passed.append((move, added, own))
    r, big, expected, fits = np.zeros(ORDER), np.zeros((ORDER, ORDER)), np.empty((n, 2)), np.zeros((kinds, 2))
    for k in range(n - 1, -1, -1):
        move, added, own = passed[k]
        for c, e, f, keep in own[::-1]:
            unit, gain = np.eye(ORDER)[c], (np.eye(ORDER) - keep)[:, c]
            fits[c] += variance[k, c] * np.array([(e / f - gain @ r) ** 2, 1.0 / f + gain @ big @ gain])
            r, big = keep.T @ r + unit * e / f, keep.T @ big @ keep + np.outer(unit, unit) / f
            big = 0.5 * (big + big.T)  # what rounding makes of its two triangles grows backwards
        expected[k] = drive[k] * (r @ added @ r), drive[k] * np.sum(added * big)
        r, big = move.T @ r, move.T @ big @ move
    out, got = np.empty((n, 2)), np.empty((kinds, 2))
    score = intensity.score(*given, np.empty((n, kinds, 2 + ORDER)), out, got)
    assert score == pytest.approx(total, rel=1e-9)
    np.testing.assert_allclose(out, expected, rtol=1e-6, atol=1e-7 * expected.max())
    np.testing.assert_allclose(got, fits, rtol=1e-7)


@CASES
@pytest.mark.parametrize("draws", [0, 2])
def test_smoother_is_that_of_matrices(uneven: bool, kinds: int, octaves: float, draws: int) -> None:
    tau, z, variance, drive, start, spread = given = measured(uneven, kinds, min(octaves, 30.0))
    n, x, p, filtered = len(tau), start, spread, []
    for k in range(n):
        move, added = step(tau[k])
        x, p = move @ x, move @ p @ move.T + drive[k] * added
        for c in np.flatnonzero(variance[k] < np.inf).tolist():
            x, p, *_ = update(x, p, c, z[k, c], variance[k, c])
        filtered.append((x, p))
    states, sd = np.empty((n, ORDER)), np.empty((n, ORDER))
    states[-1], sd[-1] = x, np.sqrt(np.diag(p))
    for k in range(n - 2, -1, -1):
        (own, now), (move, added) = filtered[k], step(tau[k + 1])
        back = np.linalg.solve(move @ now @ move.T + drive[k + 1] * added, move @ now).T
        left = np.eye(ORDER) - back @ move
        x = own + back @ (x - move @ own)
        p = left @ now @ left.T + back @ (drive[k + 1] * added + p) @ back.T
        states[k], sd[k] = x, np.sqrt(np.diag(p))
    got, got_sd, drawn = np.empty((n, ORDER)), np.empty((n, ORDER)), np.zeros((draws, n, 3), np.float32)
    fixed_interval.smooth(*given, got, got_sd, np.random.default_rng(0), drawn)
    np.testing.assert_allclose(got_sd, sd, rtol=1e-6)
    assert np.abs((got - states) / sd).max() < 1e-5
    assert (np.abs(drawn).max(axis=(1, 2)) > 0.0).all()
    assert np.abs(drawn / sd[:, :3]).max(initial=0.0) < 6.0


@pytest.mark.parametrize("uneven", ["nothing", "steps", "noise", "late"])
def test_bank_is_filters_of_matrices(uneven: str) -> None:
    n, rng = 1500, np.random.default_rng(3)
    tau, noise = np.ones(n), np.full(n, 1e-4)
    tau[0] = 0.0
    if uneven == "steps":
        tau[1:] += 0.1 * rng.random(n - 1)
    if uneven == "noise":
        noise *= 1.0 + rng.random(n)
    if uneven == "late":  # gains that have settled must move again
        tau[1200], noise[1300:] = 3.0, 4e-4
    y = np.sin(0.01 * np.cumsum(tau)) + 1e-2 * rng.standard_normal(n)
    # from a motion that hardly bends to one that follows every reading; slower ones have not settled by then
    levels = 1e-4 * 2.0 ** (8 * np.array([-6.0, -4.0, -2.0, 0.0, 2.0]))
    start, spread = np.array([y[0], 0.0, 0.0, 0.0]), np.diag([1e-2, 1e-2, 1e-4, 1e-6])
    out = np.empty((n, len(levels)), np.float32)
    intensity.bank(tau, y, noise, levels, start, spread, out)
    for j, level in enumerate(levels):
        # single precision of numbers up to some hundred
        np.testing.assert_allclose(out[:, j], plain(tau, y, noise, level, start, spread), rtol=2e-5, atol=1e-4)
