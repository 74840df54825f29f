"""Persistence of excitation against the singular values of the window itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinid.errors import InputError
from kinid.estimators import Excitation
from kinid.estimators._excitation_kernels import smallest_eigenvalue


def test_is_the_smallest_singular_value_of_the_window():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(1000, 4)) * np.linspace(1.0, 0.1, 1000)[:, None] * [1.0, 1e-3, 50.0, 2.0]
    rows[:, 3] += 0.03 * rows[:, 2]
    values = Excitation(window=100, blocks=5).track(rows)
    for k in range(99, 1000, 20):
        window = rows[k - 99 : k + 1]
        scale = np.max([np.sqrt(np.mean(rows[j - 99 : j + 1] ** 2, axis=0)) for j in range(99, k + 1, 20)], axis=0)
        expected = np.linalg.svd(window / scale, compute_uv=False)[-1] / 10.0
        assert values[k] == pytest.approx(expected, rel=1e-9)  # rounding of a Gram matrix: 1e-16/σ²
    assert (values[100:119] == values[100]).all()  # renewed once a block


def test_ideal_motion_is_one_and_a_missing_or_copied_regressor_is_zero():
    phase = np.arange(2000) * 2 * np.pi / 100
    ideal = np.stack([np.sin(phase), 3.0 * np.cos(phase)], axis=1)
    assert Excitation(window=200).track(ideal)[-1] == pytest.approx(1.0, rel=1e-9)
    assert Excitation().track(ideal * [1.0, 0.0])[-1] == 0.0
    copied = np.stack([np.sin(phase), 2.0 * np.sin(phase)], axis=1)
    assert Excitation().track(copied)[-1] < 1e-7  # rounding of a Gram matrix: square root of 1e-16


def test_falls_when_motion_stops_and_comes_back():
    phase = np.arange(1000) * 2 * np.pi / 100
    motion = np.stack([np.sin(phase), np.cos(phase)], axis=1)
    motion[400:800] = [0.7, 0.0]
    values = Excitation(window=200).track(motion)
    assert values[399] > 0.9
    assert values[640] < 1e-7
    assert values[-1] > 0.9


def test_a_given_scale_tells_noise_from_motion_at_once():
    noise = 1e-4 * np.random.default_rng(0).normal(size=(400, 2))
    assert Excitation().track(noise)[-1] > 0.8  # nothing to compare with: looks well excited
    assert Excitation(scale=(0.01, 0.1)).track(noise)[-1] < 0.002


@given(p=st.integers(1, 7), seed=st.integers(0, 10_000), power=st.floats(0.0, 7.0))
@settings(max_examples=80, deadline=None)
def test_eigenvalue_is_lapacks(p, seed, power):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(p + 2, p)) * 10.0 ** (-power * rng.random(p))
    a = rows.T @ rows
    expected = np.linalg.eigvalsh(a)
    assert smallest_eigenvalue((0.0,) * p, a.copy()) == pytest.approx(expected[0], abs=1e-13 * expected[-1])


def test_bad_settings_and_rows_are_named():
    with pytest.raises(InputError, match="blocks ≤ window"):
        Excitation(window=3, blocks=5)
    with pytest.raises(InputError, match="positive numbers"):
        Excitation(scale=(1.0, 0.0))
    with pytest.raises(InputError, match="finite numbers"):
        Excitation().track(np.array([[1.0, np.nan]]))
    with pytest.raises(InputError, match="finite numbers"):
        Excitation().track(np.ones(3))
