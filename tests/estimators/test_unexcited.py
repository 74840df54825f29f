"""A tool that rests in a material, or in the air, for hours: estimators stay finite, and say nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinid.estimators import Friction, HuntCrossleyKalman, KelvinVoigt, RecursiveLeastSquares, SingleStage, TwoStage

#: one sample in [N], [m] and [m/s]: at rest in the material, and in the air
CONTACT = {"pressed": (0.003, 0.0, 2.0, True), "air": (0.0, 0.0, 0.0, False)}
FRICTION = {"pressed": (2.0, (0.0, 0.0), (0.1, 0.0), True), "air": (0.0, (0.0, 0.0), (0.0, 0.0), False)}
ESTIMATORS: dict[str, tuple[Callable[[], Any], dict[str, tuple[Any, ...]]]] = {
    "Kelvin-Voigt": (lambda: KelvinVoigt().online(), CONTACT),
    "single stage": (lambda: SingleStage().online(), CONTACT),
    "two stages": (lambda: TwoStage().online(), CONTACT),
    "Kalman": (lambda: HuntCrossleyKalman().online(), CONTACT),
    "friction": (lambda: Friction().online(), FRICTION),
    "least squares": (lambda: RecursiveLeastSquares(("a", "b")).online(), {"pressed": ((1.0, 0.0), 2.0)}),
}
CASES = [(name, state) for name, (_, states) in ESTIMATORS.items() for state in states]


@pytest.mark.parametrize("many", [10_000, pytest.param(10_000_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "state"), CASES)
def test_nothing_grows_without_excitation(name: str, state: str, many: int, capfd: pytest.CaptureFixture[str]) -> None:
    make, states = ESTIMATORS[name]
    online, sample = make(), states[state]
    step = online.step
    for k in range(many):
        step(*sample, t=1e-3 * k)
    estimate = online.update(*sample, t=1e-3 * many)
    assert np.isfinite(estimate.values).all()
    # infinite: nothing is known of it yet
    assert not np.isnan(estimate.covariance).any()
    assert (np.diag(estimate.covariance) >= 0.0).all()
    assert capfd.readouterr() == ("", "")
