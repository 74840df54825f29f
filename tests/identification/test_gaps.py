"""Logs that rest for longer than anything can be held in memory of."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.modeling.model import Model


@pytest.mark.parametrize("rest", [1.0, 3e7, 3e9])
def test_a_log_may_rest_for_a_century(rest: float) -> None:
    """Blocks between which nothing was logged take neither time nor memory, and change no estimate."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 8.0, 0.01)
    depth = 2e-3 * np.sin(2.0 * t)
    force = 900.0 * np.maximum(depth, 0.0) + 0.01 * rng.standard_normal(len(t))
    log = Log(np.where(t < 4.0, t, t + rest), contact={"depth": depth, "normal_force": force})
    fit = Model("hooke").fit(log, Rig())
    estimate = fit.parameters["hooke.stiffness"]
    # 0.01 N at 400 samples of 1.3 mm rms is 0.4 N/m; the motion's own noise and the stamps' rounding are a few more
    assert estimate.value == pytest.approx(900.0, abs=5.0)
    assert fit.error.held_out < 0.03
