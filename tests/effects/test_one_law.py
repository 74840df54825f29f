"""One law, wherever it is asked for: effects, controllers and estimators give the same force."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.controllers import HuntCrossley, KelvinVoigt, Properties
from kinid.effects import Layout, Signals
from kinid.estimators.hunt_crossley import force as hunt_crossley
from kinid.estimators.kelvin_voigt import force as kelvin_voigt
from kinid.modeling.model import Model

ROUNDING = 1e-12  # a few operations on doubles
LAYOUT = Layout(("normal_force",), "contact")


def touch() -> Signals:
    """In and out of a material, partly in the air."""
    t = np.linspace(0.0, 2.0, 201)
    depth, rate = 4e-3 * np.sin(np.pi * t) - 1e-3, 4e-3 * np.pi * np.cos(np.pi * t)
    pair = np.zeros((2, len(t)))
    return Signals(LAYOUT, t, np.diff(t, prepend=t[0]), depth, rate, pair, pair)


@pytest.mark.parametrize("exponent", [1.0, 1.35, 2.0])
def test_hunt_and_crossley(exponent: float) -> None:
    stiffness, damping, s = 900.0, 400.0, touch()
    effect = Model("hunt-crossley").predict(s, np.array([stiffness, damping, exponent]))[0]
    estimator = hunt_crossley(s.depth, s.depth_rate, stiffness, damping, exponent)
    np.testing.assert_allclose(effect, estimator, rtol=ROUNDING, atol=1e-15)
    inside, material = s.depth > 0, Properties(stiffness, damping, exponent)
    controller = [HuntCrossley().force(x, v, material) for x, v in zip(s.depth[inside], s.depth_rate[inside])]
    np.testing.assert_allclose(effect[inside], controller, rtol=ROUNDING)


def test_kelvin_and_voigt() -> None:
    stiffness, damping, s = 730.0, 9.9, touch()
    effect = Model("kelvin-voigt").predict(s, np.array([stiffness, damping]))[0]
    np.testing.assert_allclose(
        effect, kelvin_voigt(s.depth, s.depth_rate, stiffness, damping), rtol=ROUNDING, atol=1e-15
    )
    pressed, material = (s.depth > 0) & (effect > 0), Properties(stiffness, damping)  # a haptic device never pulls
    controller = [KelvinVoigt().force(x, v, material) for x, v in zip(s.depth[pressed], s.depth_rate[pressed])]
    np.testing.assert_allclose(effect[pressed], controller, rtol=ROUNDING)
