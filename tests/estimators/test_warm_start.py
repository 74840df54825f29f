"""A touch joined with what was expected of its place: right where that holds, and its own where it doesn't."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.estimators.warm_start import UNKNOWN_RANGE, Candidate, WarmStart


def candidate(value, sd, share=1.0):
    return Candidate(np.array([value]), np.array([[sd**2]]), share)


def by_quadrature(start, value, sd):
    """Mean and deviation of the posterior of one parameter, on a fine grid."""
    x = np.linspace(value - 12 * sd, value + 12 * sd, 200_001)

    def normal(mean, deviation):
        return np.exp(-0.5 * ((x - mean) / deviation) ** 2) / deviation / np.sqrt(2 * np.pi)

    total = sum(c.share for c in start.candidates)
    prior = sum(
        (1 - start.another) * c.share / total * normal(c.values[0], np.sqrt(c.covariance[0, 0]))
        for c in start.candidates
    )
    # "any other material": even over logarithms, and here a constant over the touch's own interval
    density = (prior + start.another / (UNKNOWN_RANGE * value)) * normal(value, sd)
    density /= density.sum()
    mean = density @ x
    return mean, np.sqrt(density @ (x - mean) ** 2)


@pytest.mark.parametrize("value", [700.0, 735.0, 760.0, 990.0])
def test_it_is_the_mixture_s_posterior(value):
    start = WarmStart([candidate(732.0, 15.0), candidate(994.0, 20.0, 3.0)], 0.2)
    learnt = start.after(np.array([value]), np.array([[30.0**2]]))
    mean, sd = by_quadrature(start, value, 30.0)
    assert learnt.values[0] == pytest.approx(mean, rel=1e-5)
    assert np.sqrt(learnt.covariance[0, 0]) == pytest.approx(sd, rel=1e-4)


def test_a_touch_that_contradicts_is_taken_at_its_word():
    start = WarmStart([Candidate(np.array([732.0, 9.9]), np.diag([7.0, 0.2]) ** 2, 1.0)], 0.2)
    values, covariance = np.array([994.0, 14.5]), np.diag([6.0, 0.7]) ** 2
    learnt = start.after(values, covariance)
    assert np.allclose(learnt.values, values, rtol=1e-6)
    assert np.allclose(learnt.covariance, covariance, rtol=1e-3)
    assert learnt.another > 0.999
    agrees = start.after(np.array([735.0, 10.6]), covariance)
    assert agrees.another < 0.05
    assert agrees.covariance[1, 1] < 0.2 * covariance[1, 1]
    assert not learnt.within(0.05)
    assert agrees.within(0.05)


def test_of_what_nothing_is_expected_the_touch_alone_speaks():
    start = WarmStart([Candidate(np.array([732.0, 0.0]), np.diag([49.0, np.inf]), 1.0)], 0.2)
    values, covariance = np.array([735.0, 12.0]), np.diag([36.0, 0.49])
    learnt = start.after(values, covariance)
    assert learnt.values[1] == pytest.approx(12.0)
    assert learnt.covariance[1, 1] == pytest.approx(0.49)
    assert learnt.covariance[0, 0] < 30.0
    alone = WarmStart().after(values, covariance)
    assert np.array_equal(alone.values, values)
    assert alone.another == 1.0


def test_intervals_hold_over_places_alike_and_others():
    """Places of which a fifth are another material, any within two decades: intervals hold in 95 of 100 cases."""
    rng = np.random.default_rng(3)
    inside, touch = [], np.diag([5.0, 0.6])
    for _ in range(4000):
        if rng.random() < 0.2:
            truth = np.exp(rng.uniform(np.log([80.0, 1.2]), np.log([8000.0, 120.0])))
        else:
            truth = np.array([732.0, 9.9]) + rng.standard_normal(2) * [15.0, 0.3]
        start = WarmStart([Candidate(np.array([732.0, 9.9]), np.diag([15.0, 0.3]) ** 2, 1.0)], 0.2)
        learnt = start.after(truth + touch @ rng.standard_normal(2), touch**2)
        inside.append(np.abs(learnt.values - truth) <= 1.96 * np.sqrt(np.diag(learnt.covariance)))
    assert np.mean(inside, axis=0) == pytest.approx([0.95, 0.95], abs=0.015)


def test_what_is_none_is_refused():
    with pytest.raises(InputError, match="a candidate of 1 values"):
        candidate(732.0, 0.0)
    with pytest.raises(InputError, match="with a share of"):
        candidate(732.0, 1.0, 0.0)
    with pytest.raises(InputError, match="for another material"):
        WarmStart([candidate(732.0, 1.0)], 0.0)
