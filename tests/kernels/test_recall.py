"""What laws say that they remember, against what they do when their path is moved; and what is solved with it, by
matrices.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.effects._signals import Recall
from kinid.kernels.memory import ELASTIC, bond, bristles, deepest
from kinid.kernels.recall import forwards, recalled_bristles, recalled_deepest, remembered

Array = NDArray[np.float64]


def path(seed: int, many: int = 400) -> tuple[Array, Array, Array]:
    """Depth, its rate and steps of time: in and out, with noise, gaps, and samples outside of the material."""
    rng = np.random.default_rng(seed)
    dt = rng.uniform(1e-3, 3e-3, many)
    t = np.cumsum(dt)
    dt[[0, many // 3]] = 0.0
    depth = 1e-3 * np.sin(9.0 * t) + 0.3e-3 + 2e-6 * rng.standard_normal(many)
    return depth, rng.standard_normal(many) * 3e-3 + 9e-3 * np.cos(9.0 * t), dt


def remembered_change(recall: Recall, dx: Array, dv: Array, dt: Array) -> Array:
    """What a memory says of a path that is moved."""
    out = np.empty(len(dt))
    remembered(dx, dv, dt, recall.keep, recall.before, recall.now, recall.reach, recall.size, out)
    return out


@pytest.mark.parametrize("length", [3e-5, 1e-3])
def test_bristles_that_are_moved(length: float) -> None:
    depth, rate, dt = path(1)
    rng = np.random.default_rng(2)
    h = 1e-7 * rng.standard_normal(len(dt))
    recall = Recall.blank(len(dt), 2)
    recalled_bristles(rate, dt, depth, length, ELASTIC, recall.keep, recall.before, recall.now)
    recall.size[:] = (1.0 - ELASTIC, 1.0 / length)

    def z(v: Array) -> Array:
        out = np.empty((2, len(dt)))
        bristles(v, np.zeros(len(dt)), dt, depth, length, out)
        return out[0]

    changed = 0.5 * (z(rate + h) - z(rate - h))
    assert np.abs(changed).max() > 1e-10 / length
    # but for a sample that the step moves over a kink
    off = np.abs(remembered_change(recall, np.zeros(len(dt)), h, dt) - changed)
    assert np.quantile(off, 0.98) < 1e-5 * np.abs(changed).max()


@pytest.mark.parametrize("kind", ["bond", "softening"])
def test_the_deepest_that_is_moved(kind: str) -> None:
    """All but the sample's own move, as a law's own slope over depth counts separately."""
    depth, _, dt = path(3)
    length, n = 4e-4, len(dt)
    recall, most = Recall.blank(n, 1), np.empty(n)
    recalled_deepest(depth, dt, -length if kind == "bond" else -np.inf, recall.keep, recall.reach, most)

    def law(x: Array, own: Array) -> Array:
        out = np.empty(n)
        if kind == "bond":
            bond(x, dt, length, out)
            return out
        deepest(x, dt, out)
        return np.exp((np.maximum(x, 0.0) - out) / length)

    value = law(depth, depth)
    inside = most > 0.0
    if kind == "bond":
        left = (1.0 - (np.minimum(depth, 0.0) / length) ** 2) ** 2
        recall.size[:, 0] = np.where(inside, left * np.exp((depth - most) / length) / length, 0.0)
    else:
        recall.size[:, 0] = np.where(inside, -value / length, 0.0)
    reaching = np.flatnonzero(recall.reach[:, 0] > 0.0)
    assert 20 < len(reaching) < n // 2
    for i in reaching[::3]:
        step = np.zeros(n)
        step[i] = 1e-10
        changed = 0.5 * (law(depth + step, depth) - law(depth - step, depth))
        changed[i] = 0.0
        np.testing.assert_allclose(
            remembered_change(recall, step, np.zeros(n), dt), changed, atol=1e-4 * 1e-10 / length
        )


@pytest.mark.parametrize("parts", [0, 1, 3])
def test_forwards_solves_what_remembered_says(parts: int) -> None:
    """y + C (k y + l ẏ) − Σ A z = rest, with z of the path dx = −C y, dv = −C ẏ."""
    depth, _, dt = path(4)
    rng, n, c = np.random.default_rng(5), len(dt), 2e-4
    recall = Recall(
        0.5 * rng.standard_normal((n, parts, parts)),
        *rng.uniform(0.0, 1e-3, (2, n, parts)),
        rng.uniform(0.0, 1.0, (n, parts)),
        rng.uniform(0.0, 300.0, (n, parts)),
    )
    rest, stiff, lossy = rng.standard_normal(n), rng.uniform(0.0, 3e3, n), rng.uniform(0.0, 5.0, n)
    y = np.empty(n)
    forwards(rest, dt, c, stiff, lossy, recall.keep, recall.before, recall.now, recall.reach, recall.size, y)
    rate = np.zeros(n)
    goes_on = dt > 0.0
    rate[goes_on] = np.diff(y, prepend=y[0])[goes_on] / dt[goes_on]
    memory = remembered_change(recall, -c * y, -c * rate, dt)
    memory[~goes_on] = 0.0  # where all begins anew nothing is remembered
    np.testing.assert_allclose(y + c * (stiff * y + lossy * rate) - memory, rest, atol=1e-9)
