"""The force at the tip from joint torques: against Pinocchio's Jacobian, planted errors, and the exact observer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.robotics.external_force import (
    FEWEST,
    PRIOR,
    UNLEARNT,
    Directions,
    TorqueError,
    directions,
    tip_force,
    tip_jacobian,
    torque_error,
)
from kinid.robotics.inverse_dynamics import inverse_dynamics
from kinid.robotics.momentum_observer import MomentumObserver
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: rounding of torques up to some 100 N·m
EXACT = 1e-10


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(Rig.parse({"robot": {"model": "lwr4plus", "gravity": [1.0, -2.0, -9.4]}}))


def by_pinocchio(robot: Robot, frame: str, q: Array) -> Array:
    """Linear rows of a frame's Jacobian in base axes, (n, 3, N)."""
    data, at = robot.model.createData(), robot.model.getFrameId(frame)
    return np.stack(
        [
            pin.computeFrameJacobian(robot.model, data, row, at, pin.LOCAL_WORLD_ALIGNED)[:3]
            for row in robot.configuration(q)
        ]
    )


def known(n: int, sd: float, joints: int = 7) -> TorqueError:
    """An error of mean zero and one standard deviation for all joints."""
    return TorqueError(np.zeros((n, joints)), sd**2 * np.eye(joints), np.zeros((n, joints)), FEWEST)


def bent(n: int, seed: int) -> Array:
    """Poses of the arm away from its singular ones: elbow and wrist bent."""
    rng = np.random.default_rng(seed)
    return np.array([0.2, 0.6, -0.1, -1.3, 0.3, 0.9, 0.0]) + rng.uniform(-0.3, 0.3, (n, 7))


def test_the_jacobian_is_pinocchio_s(robot: Robot) -> None:
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (50, 7))
    np.testing.assert_allclose(tip_jacobian(robot, q), by_pinocchio(robot, "tool_tip", q), atol=EXACT)


def test_torques_that_hold_a_force_give_it_back(robot: Robot) -> None:
    """The torques of statics are made by Newton-Euler with the force on the last link, not by a Jacobian."""
    q, still = bent(40, 1), np.zeros((40, 7))
    force = np.random.default_rng(2).normal(size=(40, 3)) * 20.0
    model, data = robot.model, robot.model.createData()
    frame = robot.frame("tool_tip")
    tau = np.empty((40, 7))
    for i, row in enumerate(robot.configuration(q)):
        pin.framesForwardKinematics(model, data, row)
        turn = data.oMf[model.getFrameId("tool_tip")].rotation
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        forces[frame.parentJoint] = frame.placement.act(pin.Force(turn.T @ force[i], np.zeros(3)))
        tau[i] = pin.rnea(model, data, row, still[i], still[i], forces)
    residual = tau - inverse_dynamics(robot, q, still, still)
    np.testing.assert_allclose(
        residual, -np.einsum("nij,ni->nj", by_pinocchio(robot, "tool_tip", q), force), atol=EXACT
    )
    found = tip_force(tip_jacobian(robot, q), residual, known(40, 1e-4))
    # the prior takes off (sd/PRIOR)², a ten-billionth here; and a force at the tip leaves nothing over
    np.testing.assert_allclose(found.force, force, atol=1e-6)
    assert found.reduced_chi_square.max() < 1e-6


def test_standard_deviations_are_those_of_the_errors(robot: Robot) -> None:
    q, sd = np.tile(bent(1, 3), (4000, 1)), 0.3
    force = np.array([3.0, -5.0, 12.0])
    jacobian = by_pinocchio(robot, "tool_tip", q)
    noise = sd * np.random.default_rng(4).normal(size=(4000, 7))
    found = tip_force(jacobian, noise - np.einsum("nij,i->nj", jacobian, force), known(4000, sd))
    # a covariance of 4000 samples is known to some 2 % (1/√2000); five of these
    np.testing.assert_allclose(
        np.cov(found.force.T), found.covariance[0], rtol=0.1, atol=0.1 * found.covariance[0].max()
    )
    np.testing.assert_allclose(found.force.mean(axis=0), force, atol=5 * np.sqrt(found.covariance[0].max() / 4000))
    assert found.reduced_chi_square.mean() == pytest.approx(1.0, abs=0.1)


def test_a_singular_pose_gives_a_wide_deviation_and_no_absurd_force(robot: Robot) -> None:
    """Stretched upwards, no joint moves the tip along the vertical: what noise says of it counts for nothing."""
    # nearly, so that least squares would still divide by it; turned about its length, it moves sideways both ways
    q = np.tile([0.0, 1e-4, 1.2, 1e-4, 0.5, 1e-4, 0.0], (200, 1))
    jacobian = by_pinocchio(robot, "tool_tip", q)
    torque = -np.einsum("nij,i->nj", jacobian, [4.0, -3.0, 0.0]) + 0.1 * np.random.default_rng(5).normal(size=(200, 7))
    found = tip_force(jacobian, torque, known(200, 0.1))
    sd = np.sqrt(np.einsum("nii->ni", found.covariance))
    assert (sd[:, 2] > 0.95 * PRIOR).all()
    assert np.abs(found.force[:, 2]).max() < 0.2 * PRIOR  # a mean spreads by √(PRIOR² − sd²) about zero
    assert (sd[:, :2] < 0.5).all()
    assert np.abs(found.force[:, :2] - [4.0, -3.0]).max() < 2.5  # five deviations
    absurd = np.array([np.linalg.lstsq(-j.T, r, rcond=None)[0] for j, r in zip(jacobian, torque)])
    assert np.abs(absurd[:, 2]).max() > 10 * PRIOR


@settings(max_examples=30, deadline=None)
@given(angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3), seed=st.integers(0, 1000))
def test_forces_turn_with_the_axes_that_they_are_seen_in(angles: tuple[float, float, float], seed: int) -> None:
    """Other base axes are another (3, N) Jacobian of the same joints: forces and covariances turn, chi-squares stay."""
    turn = pin.rpy.rpyToMatrix(*angles)
    rng = np.random.default_rng(seed)
    jacobian, torque = rng.normal(size=(5, 3, 7)), rng.normal(size=(5, 7))
    here, there = (tip_force(j, torque, known(5, 0.3)) for j in (jacobian, turn @ jacobian))
    np.testing.assert_allclose(there.force, here.force @ turn.T, atol=1e-9)
    np.testing.assert_allclose(there.covariance, turn @ here.covariance @ turn.T, atol=1e-9)
    np.testing.assert_allclose(there.reduced_chi_square, here.reduced_chi_square, atol=1e-9)


def test_a_force_at_the_elbow_is_no_force_at_the_tip(robot: Robot) -> None:
    q = bent(30, 6)
    torque = -np.einsum("nij,i->nj", by_pinocchio(robot, "link_4", q), [10.0, -10.0, 5.0])
    assert (
        np.median(tip_force(tip_jacobian(robot, q), torque, known(30, 0.1)).reduced_chi_square) > 20.0
    )  # where the tip alone makes 1


class Swing:
    """A joint to and fro and then at rest, with dry and viscous friction, an offset and noise, one joint of two."""

    t = np.arange(8000) / 500.0
    moving = t < 12.0
    dq = np.where(moving, 0.4 * np.sin(2.0 * t), 0.0)[:, None] * np.array([1.0, 0.5])
    noise = 0.02 * np.random.default_rng(7).normal(size=(8000, 2))

    @classmethod
    def residual(cls) -> Array:
        turned = directions(cls.t, cls.dq, 0.002, [False, False]).turned
        return 0.3 + np.array([0.5, 0.2]) * turned + np.array([0.1, 0.4]) * cls.dq + cls.noise


def test_friction_and_offset_are_learnt_from_free_motion() -> None:
    s = Swing
    residual, free = s.residual(), np.flatnonzero(s.t < 10.0)
    moved = directions(s.t, s.dq, 0.002, [False, False])
    found = torque_error(s.t, residual, s.dq, moved, free, residual)
    left = residual - found.mean
    # from 5000 samples coefficients are known to a few thousandths; the level beside them to the noise of a block
    np.testing.assert_allclose(left, s.noise, atol=0.03)
    sd = np.sqrt(np.einsum("njj->nj", found.covariance))
    assert (sd > 0.018).all()
    assert np.mean(np.abs(left[s.t > 10.0]) < 2 * sd[s.t > 10.0]) > 0.9


def test_friction_that_free_motion_does_not_show_widens_the_deviation() -> None:
    """One way only in free motion: what the joint's friction is the other way is known within loose bounds alone."""
    s = Swing
    one_way = np.flatnonzero((s.dq[:, 0] > 0.05) & (s.t < 10.0))
    both = np.flatnonzero(s.t < 10.0)
    moved = directions(s.t, s.dq, 0.002, [False, False])
    back = (s.dq[:, 0] < -0.05) & (s.t > 10.0) & s.moving
    sd = [
        np.sqrt(torque_error(s.t, s.residual(), s.dq, moved, free, s.residual()).covariance[back, 0, 0]).mean()
        for free in (one_way, both)
    ]
    assert sd[0] > 2.0 * sd[1]


def test_without_free_motion_an_error_is_stated() -> None:
    measured = np.tile([10.0, -2.0], (300, 1))
    none = Directions(np.zeros((300, 2)), np.zeros((300, 2)))
    free = np.arange(FEWEST - 1)
    found = torque_error(np.arange(300.0), np.zeros((300, 2)), np.zeros((300, 2)), none, free, measured)
    assert found.learnt == 0
    np.testing.assert_allclose(found.covariance[0], (UNLEARNT * 10.0) ** 2 * np.eye(2))


def moving(robot: Robot, external: Array) -> tuple[Array, Array, Array, Array]:
    """A swinging arm that something pushes with torques `external` (n, N): t, q, dq, tau."""
    t = np.arange(len(external)) / 1000.0
    size, rate = 0.4, np.array([1.1, 1.7, 2.3, 1.3, 2.9, 1.9, 2.1])
    phase = np.outer(t, rate)
    q = np.array([0.2, 0.5, -0.1, -1.2, 0.3, 0.9, 0.0]) + size * np.sin(phase)
    dq, ddq = size * rate * np.cos(phase), -size * rate**2 * np.sin(phase)
    return t, q, dq, inverse_dynamics(robot, q, dq, ddq) - external


def test_the_observer_follows_external_torques_behind_its_lag(robot: Robot) -> None:
    """From a step on, r = −τ_ext (1 − e^(−K t)): no other lag, whatever the arm does meanwhile."""
    gain, step = 30.0, np.array([2.0, -3.0, 1.0, 0.5, -0.5, 0.3, 0.1])
    external = np.zeros((1500, 7))
    external[500:] = step
    t, q, dq, tau = moving(robot, external)
    observer = MomentumObserver(robot, gain)
    found = np.array([observer.update(*row) for row in zip(t, q, dq, tau)])
    # the step falls half-way between two samples, as a trapezoid sees it
    after = np.maximum(0.0, t - 0.4995)
    # what goes straight between samples of 1 ms is off by h²/12 of its second derivative, some 1e-5 N·m here
    np.testing.assert_allclose(found, -np.outer(1.0 - np.exp(-gain * after), step), atol=2e-3)


def test_the_observer_passes_over_what_is_no_number(robot: Robot) -> None:
    external = np.tile([2.0, -3.0, 1.0, 0.5, -0.5, 0.3, 0.1], (400, 1))
    t, q, dq, tau = moving(robot, external)
    tau[200] = np.nan
    observer = MomentumObserver(robot, 200.0)
    found = np.array([observer.update(*row) for row in zip(t, q, dq, tau)])
    assert np.isnan(found[200]).all()
    np.testing.assert_allclose(found[399], -external[0], atol=1e-3)
    observer.reset()
    assert not observer.update(0.0, q[0], dq[0], tau[0]).any()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda o, q: o.update(0.0, q, q, q), "a time of 0 s after 0 s"),
        (lambda o, q: o.update(1.0, q[:3], q, q), r"\(7,\) each"),
        (lambda o, q: MomentumObserver(o.robot, -1.0), "a gain of -1.0"),
    ],
)
def test_what_the_observer_refuses(robot: Robot, call: Any, words: str) -> None:
    observer, q = MomentumObserver(robot), np.zeros(7)
    observer.update(0.0, q, q, q)
    with pytest.raises(InputError, match=words):
        call(observer, q)
