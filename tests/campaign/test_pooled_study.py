"""Figures over many draws: small versions for every run, the whole studies behind the slow marker."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from campaign.study import TRUTH, Draws, found_effects, named, recovered, swapped

#: laws that bend a spring over depth, which a small one can't be told by
BENDS = {"stiffening-layer", "hertz-exponent"}
#: N/m²: single logs find a spring that stiffens so in 1 of 30 draws
WEAK = 1.6e4


def test_intervals_hold_the_truth_in_a_few_draws() -> None:
    found = recovered(draws=6, logs=3)
    print("covered", found.covered.mean(axis=0), "spread", found.spread)
    # of 18 intervals of 95 %, fewer than 14 hold the truth once in a thousand studies
    assert found.covered.sum() >= 14


def test_a_weak_effect_is_found_in_several_logs_and_by_none_of_them() -> None:
    assert found_effects(draws=2, logs=1, stiffening=WEAK, seed=40) == [()] * 2
    assert BENDS & {*found_effects(draws=1, logs=8, stiffening=WEAK, seed=41)[0]}


def test_an_odd_log_is_named_in_each_of_a_few_draws() -> None:
    assert all(names == ["log 6"] for names in named(draws=2, logs=6, kind="tool"))


@cache
def of_200_draws() -> Draws:
    return recovered(draws=200, logs=20)


@pytest.mark.slow
def test_coverage_over_200_draws_of_20_logs() -> None:
    share = of_200_draws().covered.mean(axis=0)
    print("covered", dict(zip(TRUTH, share)))
    assert ((share >= 0.93) & (share <= 0.97)).all()


@pytest.mark.slow
def test_pooled_estimates_lie_to_no_side() -> None:
    found = of_200_draws()
    # 200 draws tell a mean to 0.07 spreads
    away = (found.estimates.mean(axis=0) - list(TRUTH.values())) / found.spread
    print("bias in spreads", away)
    assert (np.abs(away) < 0.25).all()


@pytest.mark.slow
def test_spread_falls_as_the_root_of_the_number_of_logs() -> None:
    spreads = np.array([np.sqrt(logs) * recovered(200, logs, seed=1000 * logs).spread for logs in (1, 4, 16)])
    print("spread × √logs", spreads)
    # 200 draws tell a spread to 5 %
    assert np.abs(spreads / spreads.mean(axis=0) - 1.0).max() < 0.1


@pytest.mark.slow
def test_a_weak_effect_is_found_in_20_logs_and_nothing_where_nothing_is() -> None:
    weak, none = found_effects(50, 20, WEAK), found_effects(50, 20, 0.0, seed=100)
    print("found", np.mean([bool(BENDS & set(added)) for added in weak]), "false", np.mean([bool(a) for a in none]))
    assert np.mean([bool(BENDS & set(added)) for added in weak]) >= 0.9
    assert np.mean([bool(added) for added in none]) <= 0.03


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tool", "surface", "sensor"])
def test_odd_logs_among_20(kind: str) -> None:
    found = named(50, 20, kind)
    print(kind, np.mean(["log 20" in names for names in found]))
    assert np.mean(["log 20" in names for names in found]) >= 0.95
    assert np.mean([bool({*names} - {"log 20"}) for names in found]) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["calibration", "turned"])
def test_a_swapped_wrist_sensor_among_20(kind: str) -> None:
    found = swapped(10, 20, kind)
    print(kind, np.mean(["log 20" in names for names in found]))
    assert np.mean(["log 20" in names for names in found]) >= 0.95
    assert np.mean([bool({*names} - {"log 20"}) for names in found]) <= 0.05
