"""Friction at rest: its form is chosen from the log, and what it is doesn't bend what is estimated."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, lsim, sosfiltfilt

import kinid
from kinid.effects._signals import Layout, RestForm, Signals
from kinid.identification.estimation import estimate
from kinid.identification.state import State
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model

NOISE = 0.02
MODEL = Model("hooke", "coulomb-friction")
VALUES = {"hooke.stiffness": 2000.0, "coulomb-friction.coefficient": 0.5}


def touches(n: int = 8000) -> Signals:
    """Twelve touches of a tool that trembles sideways by less than its bristles bend, in the air, too."""
    t = np.linspace(0.0, 40.0, n)
    dt = np.diff(t, prepend=t[0])
    w = 2 * np.pi * 0.3
    depth, rate = 2e-3 * np.sin(w * t), 2e-3 * w * np.cos(w * t)
    sway = [(9e-5, 1.9, 0.3), (5e-5, 4.3, 1.0)], [(7e-5, 2.7, 0.0), (6e-5, 3.1, 2.0)]
    slip = np.stack([sum(a * np.sin(k * t + p) for a, k, p in rows) for rows in sway])
    slip_rate = np.stack([sum(a * k * np.cos(k * t + p) for a, k, p in rows) for rows in sway])
    layout = Layout(("normal_force", "tangential_force1", "tangential_force2"), "contact")
    return Signals(layout, t, dt, depth, rate, slip, slip_rate)


def estimated(form: RestForm) -> State:
    """The model fitted to noisy readings of itself under a form."""
    signals = touches()
    reading = MODEL.predict(dataclasses.replace(signals, rest=form), VALUES)
    reading = reading + np.random.default_rng(5).normal(scale=NOISE, size=reading.shape)
    every = np.ones(len(signals), np.bool_)
    e = Experiment(signals, reading, every, np.full(3, NOISE), None, signals.depth > 0, np.arange(len(signals)))
    return estimate(MODEL, e)


@pytest.mark.parametrize(
    "form",
    [RestForm(), RestForm(kept=True), RestForm(share=0.7, kept=True), RestForm(length=8e-5), RestForm(length=2.5e-5)],
)
def test_the_form_of_friction_at_rest_is_found(form: RestForm) -> None:
    state = estimated(form)
    found = state.problem.experiment.signals.rest
    assert found.kept == form.kept
    assert found.length == pytest.approx(form.length, rel=0.03)
    friction = dict(zip(MODEL.parameters(state.problem.layout), state.values))["coulomb-friction.coefficient"]
    assert friction == pytest.approx(0.5, rel=0.02)  # a form that isn't the true one is off by 10 % and more
    assert np.sqrt(np.mean(state.residual**2)) < 1.1 * NOISE


def test_friction_that_is_full_from_some_hundred_micrometres_a_second_on_is_a_form_at_rest() -> None:
    state = estimated(RestForm(speed=3e-4))
    assert state.problem.experiment.signals.rest.speed == pytest.approx(3e-4, rel=0.05)
    friction = dict(zip(MODEL.parameters(state.problem.layout), state.values))["coulomb-friction.coefficient"]
    assert friction == pytest.approx(0.5, rel=0.02)
    assert np.sqrt(np.mean(state.residual**2)) < 1.1 * NOISE


def test_a_length_that_an_effect_states_is_kept_under_every_form() -> None:
    signals = touches()
    model = MODEL + "presliding"
    values = {**VALUES, "presliding.length": 4e-4}
    forms = [
        dataclasses.replace(signals, rest=rest) for rest in (RestForm(), RestForm(speed=3e-4), RestForm(length=2e-5))
    ]
    first, *others = (model.predict(each, values) for each in forms)
    assert all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("lag", [0.0, 0.012, 0.03])
def test_torques_behind_a_low_pass_are_those_of_a_model_that_is(swing: Callable[..., Any], lag: float) -> None:
    """Of first order, as drives have: friction and inertia come back, and the fit says so."""
    t = np.arange(8000) / 200.0
    q, dq, ddq = swing(np.zeros(1), seed=4, size=2.0, speed=6.0)(t)
    torque = (0.7 * ddq + 1.2 * np.tanh(dq / 2e-3) + 0.4 * dq)[:, 0]
    if lag:
        torque = lsim(([1.0], [lag, 1.0]), torque, t)[1]
    torque = torque + 0.02 * np.random.default_rng(6).standard_normal(len(t))
    log = kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=torque[:, None])
    fit = Model("rigid-body", "joint-coulomb-friction", "joint-viscous-friction").fit(log, kinid.Rig())
    assert any("low-pass" in doubt for doubt in fit.warnings) == (lag > 0.0)
    assert fit["coulomb"].value == pytest.approx(1.2, rel=0.03)
    assert fit["viscous"].value == pytest.approx(0.4, rel=0.05)
    assert fit["inertia"].value == pytest.approx(0.7, rel=0.02)


@pytest.mark.parametrize("order", [None, 1, 2])
def test_torques_filtered_without_delay_are_those_of_a_model_that_is(
    swing: Callable[..., Any], order: int | None
) -> None:
    """By a Butterworth of 8 Hz, forwards and backwards, or not at all: friction and inertia come back, and no
    elasticity.
    """
    t = np.arange(8000) / 200.0
    q, dq, ddq = swing(np.zeros(1), seed=4, size=2.0, speed=6.0)(t)
    torque = (0.7 * ddq + 1.2 * np.tanh(dq / 2e-3) + 0.4 * dq)[:, 0]
    if order is not None:
        torque = sosfiltfilt(butter(order, 2 * 8.0 / 200.0, output="sos"), torque)
    torque = torque + 0.02 * np.random.default_rng(6).standard_normal(len(t))
    log = kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=torque[:, None])
    model = Model("rigid-body", "joint-coulomb-friction", "joint-viscous-friction")
    fit = model.fit(log, kinid.Rig())
    smoothing = fit.state.problem.experiment.signals.rest.smoothing
    assert (smoothing > 0.0) == (order is not None)
    # a Gaussian is no Butterworth: it leaves 0.033 N·m at most where torques as they are expected leave 0.2
    assert fit.error.train < (1.05 if order is None else 1.8) * 0.02
    assert fit["coulomb"].value == pytest.approx(1.2, rel=0.06)
    assert fit["viscous"].value == pytest.approx(0.4, rel=0.03)
    assert fit["inertia"].value == pytest.approx(0.7, rel=0.01)
