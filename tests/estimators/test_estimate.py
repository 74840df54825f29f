"""What an estimate says, priors, and how the package loads."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import kinid.estimators
from kinid.errors import InputError
from kinid.estimators import Estimate, Prior, RecursiveLeastSquares, Status
from kinid.estimators import _kernels as kernels
from kinid.estimators._machine import factor


def test_says_values_uncertainty_and_remedy():
    estimate = Estimate(
        ("k", "b"),
        np.array([100.0, 2.0]),
        np.array([4.0, 0.01]),
        0.1,
        0.02,
        0.3,
        Status.NOT_EXCITED,
        50,
        0,
        lambda: np.diag([4.0, 0.01]),
    )
    assert str(estimate).startswith("k 100 ± 3.9, b 2 ± 0.2 (not excited: the motion")
    np.testing.assert_allclose(estimate.interval, [[96.080072, 103.919928], [1.804004, 2.195996]], rtol=1e-6)
    assert estimate["b"] == 2.0
    assert not estimate.valid
    with pytest.raises(InputError, match="'k'"):
        estimate["kk"]


@pytest.mark.parametrize("name", ["Friction", "HuntCrossleyKalman", "KelvinVoigt", "SingleStage", "TwoStage"])
def test_nothing_stands_before_the_first_sample(name):
    estimate = getattr(kinid.estimators, name)().online().estimate
    assert estimate.status == Status.STARTING
    assert not estimate.valid
    assert np.isinf(estimate.std).all()
    assert "the estimate stands" not in str(estimate)


def test_every_status_has_a_remedy_and_the_kernels_number():
    for status in Status:
        assert status.remedy
        assert getattr(kernels, status.name) == status.value


@pytest.mark.parametrize(
    "covariance",
    [
        -np.ones(2),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.array([[1.0, 0.5], [0.2, 1.0]]),
        np.full(2, np.nan),
        np.ones(3),
    ],
)
def test_impossible_priors_are_named(covariance):
    with pytest.raises(InputError, match="covariance"):
        Prior(np.zeros(2), covariance)


def test_prior_noise_has_to_be_positive():
    with pytest.raises(InputError, match="noise"):
        Prior(np.zeros(2), np.ones(2), 0.0)


def test_a_neighbour_that_knows_nothing_is_named():
    young = RecursiveLeastSquares(("a",)).run(np.ones((1, 1)), np.ones(1)).final
    with pytest.raises(InputError, match="measured longer"):
        Prior.near(young)


def test_factors_give_the_covariance_back():
    rng = np.random.default_rng(0)
    for p in range(1, 6):
        root = rng.normal(size=(p, p))
        matrix = root @ root.T
        u, d = factor(matrix)
        np.testing.assert_allclose(u @ np.diag(d) @ u.T, matrix, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(np.tril(u), np.eye(p))
    u, d = factor(np.zeros((2, 2)))
    assert (d == 0.0).all()


def test_names_load_late_and_only_what_they_need():
    code = (
        "import sys, kinid.estimators as e; assert 'numpy' not in sys.modules; e.SingleStage();"
        "assert 'numba' not in sys.modules; assert set(e.__all__) <= set(dir(e)); [getattr(e, n) for n in e.__all__]"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        kinid.estimators.nonsense
