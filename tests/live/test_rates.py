"""Velocities of another sign or unit are found while joints move; noise, bias, lag and coarse encoders are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinid.live.rates import Rates

EVERY = 0.02


def asked(q: np.ndarray, dq: np.ndarray, every: float = EVERY) -> tuple[int, np.ndarray] | None:
    """The first sample at which velocities contradict the positions, and their slopes."""
    rates = Rates(q.shape[1])
    for k, (position, velocity) in enumerate(zip(q, dq)):
        slopes = rates.take(k * every, position, velocity)
        if slopes is not None:
            return k, slopes
    return None


def motion(seconds: float = 20.0, size: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Positions of two joints and their rates; the second joint stands still."""
    t = np.arange(0.0, seconds, EVERY)
    w = 2 * np.pi * 0.3
    return np.column_stack([size * np.sin(w * t), 0 * t]), np.column_stack([size * w * np.cos(w * t), 0 * t])


@pytest.mark.parametrize("by", [-1.0, 180.0 / np.pi, np.pi / 180.0, 1e-3, -57.3])
def test_another_sign_or_unit_is_found(by: float) -> None:
    q, dq = motion()
    found = asked(q, by * dq)
    assert found is not None
    at, slopes = found
    assert at * EVERY < 2.0  # eight pieces of 0.02 rad take a third of a second here
    assert slopes[0] == pytest.approx(by, rel=0.02)  # the trapezoid of a sine of 0.3 Hz sampled at 50 Hz
    assert np.isnan(slopes[1])  # which hasn't moved


@given(
    seed=st.integers(0, 2**31),
    step=st.sampled_from([2e-6, 1e-4, 1e-3]),
    noise=st.floats(0.0, 5e-3),
    bias=st.floats(-2e-3, 2e-3),
    lag=st.floats(0.0, 0.03),
    size=st.floats(0.0, 1.0),
)
def test_what_encoders_filters_and_noise_do_is_none(
    seed: int, step: float, noise: float, bias: float, lag: float, size: float
) -> None:
    q, _ = motion(8.0, size)
    t = EVERY * np.arange(len(q))
    w = 2 * np.pi * 0.3
    dq = np.column_stack([size * w * np.cos(w * (t - lag)), 0 * t])
    dq += bias + np.random.default_rng(seed).normal(scale=noise, size=dq.shape)
    assert asked(np.round(q / step) * step, dq) is None


def test_slow_motion_with_a_bias_is_left_alone() -> None:
    t = np.arange(0.0, 60.0, EVERY)
    q = 0.004 * t[:, None]
    assert asked(q, np.full_like(q, 0.001)) is None


def test_velocities_that_are_missing_are_none() -> None:
    q, dq = motion()
    assert asked(q, np.full_like(dq, np.nan)) is None
