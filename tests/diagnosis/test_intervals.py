"""Intervals of a diagnosed model: of an effect whose size the log leaves to another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import kinid
from kinid.diagnosis.descent import State, fit
from kinid.diagnosis.inquiry import experiment_of
from kinid.diagnosis.intervals import covariance, fitted, unsized
from kinid.diagnosis.problem import Problem

if TYPE_CHECKING:
    from conftest import Tester


def layered(tester: Tester, stiffness: float, depth: float) -> State:
    """A spring and a dashpot with a layer of this stiffness from this depth on, fitted from the truth."""
    model = kinid.Model("kelvin-voigt", "stiffening-layer")
    force = tester.kelvin_voigt() + stiffness * np.maximum(tester.depth - depth, 0.0)
    experiment = experiment_of(tester.log(force), kinid.Rig(), model)
    truth = np.array([800.0, 6.0, stiffness, depth])
    return fit(Problem.build(experiment, model, truth), model, truth)


@pytest.mark.parametrize(("stiffness", "depth", "expected"), [
    (300.0, 1.5e-3, None),  # half-way: both stiffnesses are seen
    (0.0, 1.5e-3, []),  # none at all
    (300.0, 1e-5, ["kelvin-voigt.stiffness"]),  # from the first touch on: one stiffness, and the other one as it likes
])  # fmt: skip
def test_an_effect_without_a_size_is_told_from_one_with(tester: Tester, stiffness: float, depth: float,
                                                        expected: list[str] | None) -> None:  # fmt: skip
    state = layered(tester, stiffness, depth)
    variance = covariance(state)
    assert unsized(state, "stiffening-layer", fitted(state, variance), variance) == expected
