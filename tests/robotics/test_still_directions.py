"""Accelerations along directions in which an arm doesn't move."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.data.log import Log
from kinid.robotics.motion import JointMotion, axes_motion

#: encoder's noise [rad], and one direction of three joints that moves
NOISE, ALONG = 2e-5, np.array([0.6, -0.64, 0.48])


def moved(amplitude: float, seed: int = 0) -> tuple[JointMotion, np.ndarray]:
    """Motion of three joints along one direction, and its true acceleration, (n,)."""
    t, rate = np.arange(0.0, 40.0, 0.004), 5.0
    course = amplitude * np.sin(rate * t)
    q = course[:, None] * ALONG + NOISE * np.random.default_rng(seed).standard_normal((len(t), 3))
    return axes_motion(Log(t, q=q)), -(rate**2) * course


def test_an_arm_accelerates_along_the_directions_in_which_it_moves() -> None:
    motion, true = moved(0.02)
    assert motion.smoothed is not None
    across = np.eye(3) - np.outer(ALONG, ALONG)
    smoothed, kept = (np.sqrt(np.mean((ddq @ across) ** 2)) for ddq in (motion.smoothed.second, motion.ddq))
    assert kept < 0.05 * smoothed  # what is left is the smoother's own: directions are found to a few hundredths
    # what moves stays: 1 − 1/λ with λ the ratio to an error of a hundredth
    assert np.mean((motion.ddq @ ALONG) * true) / np.mean(true**2) == pytest.approx(1.0, abs=0.02)


def test_drawn_motions_differ_along_directions_that_move() -> None:
    motion, _ = moved(0.02)
    across = np.eye(3) - np.outer(ALONG, ALONG)
    for drawn in motion.draws(2):
        error = drawn.ddq - motion.ddq
        assert np.std(error @ ALONG) > 10.0 * np.std(error @ across)


def test_an_arm_that_moves_along_all_directions_keeps_them() -> None:
    t = np.arange(0.0, 20.0, 0.004)
    q = 0.1 * np.sin(np.outer(t, [3.0, 4.0, 5.0])) + NOISE * np.random.default_rng(1).standard_normal((len(t), 3))
    motion = axes_motion(Log(t, q=q))
    assert motion.smoothed is not None
    np.testing.assert_allclose(motion.shrinkage, np.eye(3), atol=2e-3)  # the error is less than a thousandth of it
    np.testing.assert_allclose(motion.ddq, motion.smoothed.second, atol=2e-3 * np.abs(motion.ddq).max())


def test_motion_without_noise_is_left_alone() -> None:
    t = np.arange(0.0, 20.0, 0.004)
    motion = axes_motion(Log(t, q=np.outer(np.sin(t), ALONG)))
    assert motion.smoothed is not None
    np.testing.assert_allclose(motion.ddq @ ALONG, motion.smoothed.second @ ALONG, rtol=1e-6, atol=1e-6)
