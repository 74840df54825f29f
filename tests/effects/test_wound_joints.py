"""Joints that wind up where friction turns: angles that jump with the torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid
from kinid import Model
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import get
from kinid.modeling.from_logs import from_joint_torques
from kinid.robotics.inverse_dynamics import inverse_dynamics
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]
LWR = Rig.parse({"robot": {"model": "lwr4plus"}})
POSE = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])
#: stiffness of springs between encoders and links [N·m/rad], and the links' dry friction [N·m]
STIFFNESS = np.array([2500.0, 2500.0, 2000.0, 2000.0, 1500.0, 900.0, 900.0])
FRICTION = np.array([3.0, 3.0, 2.5, 2.5, 1.5, 1.0, 1.0])


def wind_up(swing: Callable[..., Any], stiffness: Array, seed: int = 3) -> Log:
    """A log of motor-side encoders: links swing, springs carry their torque and friction, θ = q + τ/K."""
    rng, robot, t = np.random.default_rng(seed), Robot.load(LWR), np.arange(0.0, 20.0, 0.004)
    q, dq, ddq = swing(POSE, seed, size=0.25, speed=3.0)(t)
    torque = inverse_dynamics(robot, q, dq, ddq) + FRICTION * np.tanh(dq / 2e-3)
    angle = q + torque / stiffness + 1e-5 * rng.standard_normal(q.shape)
    read = torque + 0.03 * rng.standard_normal(q.shape)

    return Log(t, q=angle, tau=read)


def test_springs_are_found_where_friction_turns(swing: Callable[..., Any]) -> None:
    """An instrument against the torque's noise: jumps tell 1/K within 10 %, and what is left falls to half and less."""
    log = wind_up(swing, STIFFNESS)
    signals = from_joint_torques(log, LWR).signals
    wound = dict(get("joint-elasticity").for_log(signals).wound)  # type: ignore[attr-defined]
    assert list(wound) == list(Robot.load(LWR).joint_names)
    np.testing.assert_allclose(list(wound.values()), 1.0 / STIFFNESS, rtol=0.1)
    rigid, elastic = (
        Model("rigid-body", "joint-coulomb-friction", *more).fit(log, LWR) for more in ((), ("joint-elasticity",))
    )
    assert elastic.error.held_out < 0.5 * rigid.error.held_out
    # the jumps are smeared by what the first look at 1/K was off: what is fitted is nearer to the truth, or as near
    fitted = [elastic.parameters[f"joint-elasticity.sag[{name}.all]"].value for name in list(wound)[:4]]
    np.testing.assert_allclose(fitted, 1.0 / STIFFNESS[:4], rtol=0.15)


def test_a_diagnosis_has_the_parameters_that_the_log_needs(swing: Callable[..., Any]) -> None:
    """Of joints that jump no ε is asked, of one that doesn't there is: marks are looked for with that model, too."""
    log = wind_up(swing, np.r_[STIFFNESS[:6], 1e7])
    model = Model("rigid-body", "joint-coulomb-friction", "joint-elasticity")
    fit = model.fit(log, LWR)
    assert [name for name in fit.parameters if ".elasticity[" in name] == ["joint-elasticity.elasticity[joint_7]"]
    found = kinid.diagnose(log, LWR, model=model, max_effects=0)
    assert found.steps[0].held_out == pytest.approx(fit.error.held_out, rel=1e-3)


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_stiff_joints_are_not_wound_up(swing: Callable[..., Any], seed: int) -> None:
    log = wind_up(swing, np.full(7, 1e7), seed)
    assert get("joint-elasticity").for_log(from_joint_torques(log, LWR).signals).wound == ()  # type: ignore[attr-defined]
