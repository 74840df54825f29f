"""Parameters that are moved together: each changes its own channel alone, and sensitivities are as if each were moved
alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid
from kinid import effects
from kinid.diagnosis.screening import screen
from kinid.effects import Layout
from kinid.identification import jacobian
from kinid.identification.jacobian import ALL_CHANNELS, changes, parameter_groups
from kinid.identification.problem import Problem
from kinid.identification.solver import first_error_model, search
from kinid.modeling.applicability import candidate_effects
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_joint_torques

Array = NDArray[np.float64]

LAYOUT = Layout(("tau1", "tau2", "tau3"), "joints", ("base", "shoulder", "elbow"))
RIGID = kinid.Model("rigid-body")
#: what changes torques of every joint, beside what changes each alone
MODEL = kinid.Model(
    "rigid-body", "joint-coulomb-friction", "joint-torque-gain", "payload", "sensor-drift", "sensor-lag"
)


@pytest.fixture(scope="module")
def experiment(swing: Callable[..., Any]) -> Experiment:
    """Half a minute of an arm that rubs."""
    rng = np.random.default_rng(8)
    t = np.arange(6000) / 200.0
    q, dq, ddq = swing(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), seed=3, size=0.5, speed=3.0)(t)
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}})
    log = kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=np.zeros_like(q))
    still = from_joint_torques(log, rig)
    tau = RIGID.predict(still.signals, {}).T + 0.4 * np.tanh(20.0 * dq) + 0.02 * rng.standard_normal(q.shape)
    return from_joint_torques(kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=tau), rig)


def expand_names(names: list[str], _: Layout) -> list[dict[int, int]]:
    """Every parameter alone."""
    return [{ALL_CHANNELS: place} for place in range(len(names))]


def test_joints_in_brackets_go_together_and_all_others_alone() -> None:
    names = [
        "payload.mass",
        "joint-coulomb-friction.coulomb[base]",
        "joint-coulomb-friction.coulomb[elbow]",
        "sensor-drift.drift[tau1]",
        "sensor-drift.drift[tau2]",
        "gravity-error.error[x]",
    ]
    every = ALL_CHANNELS
    assert parameter_groups(names, LAYOUT) == [{every: 0}, {every: 5}, {0: 1, 2: 2, 1: 4}, {0: 3}]
    assert parameter_groups([], LAYOUT) == []
    contact = Layout(("fx", "fy"), "wrench")
    assert parameter_groups(["sensor-bias.bias[fx]", "sensor-bias.bias[fy]"], contact) == [{every: 0}, {every: 1}]


def test_each_changes_its_own_channel_alone(experiment: Experiment) -> None:
    """Of every effect of the catalogue that acts on joint torques, beside those that act behind it."""
    layout, seen = experiment.layout, 0
    for effect, why in candidate_effects(RIGID, layout):
        if why or effect.detector:
            continue
        model = kinid.Model(
            "rigid-body", *effect.requires[:1], effect.id, *({"joint-torque-gain", "sensor-lag"} - {effect.id})
        )
        named = list(model.parameters(layout))
        values = np.array([p.nominal if np.isfinite(p.nominal) else 1.0 for p in model.parameters(layout).values()])
        before = model.predict(experiment.signals, values)
        scale = [p.scale for p in model.parameters(layout).values()]
        for group in parameter_groups(named, layout):
            for channel, j in group.items():
                if channel == ALL_CHANNELS:
                    continue
                seen += 1
                other = values.copy()
                other[j] += scale[j]
                assert not np.delete(model.predict(experiment.signals, other) - before, channel, axis=0).any(), named[j]
    assert seen >= 8 * 7


def test_sensitivities_are_as_if_each_were_moved_alone(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a model's own parameters, and of a candidate's."""
    layout = experiment.layout
    values = np.array([0.3 * p.scale + p.nominal for p in MODEL.parameters(layout).values()])
    effect = effects.get("joint-viscous-friction")

    def found() -> tuple[Array, Array]:
        problem = Problem.build(experiment)
        error = first_error_model(problem)
        state = search(problem, RIGID, np.zeros(0), error)
        return search(problem, MODEL, values, error, max_steps=0).jacobian, screen(state, effect)[0].start

    many, predict = [], kinid.Model.predict
    monkeypatch.setattr(kinid.Model, "predict", lambda *a, **k: (many.append(1), predict(*a, **k))[1])
    fast = found()
    saved = len(many)
    monkeypatch.setattr(jacobian, "parameter_groups", expand_names)
    slow = found()
    print(f"{saved} predictions, {len(many) - saved} one by one")
    assert len(many) - saved > 1.5 * saved  # 32 parameters, 11 of which change every torque, and what both need besides
    for a, b in zip(fast, slow):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


def test_what_is_known_of_torques_is_what_would_be_predicted(experiment: Experiment) -> None:
    """Columns that one model left behind, beside those of another one that nothing is known of."""
    small = kinid.Model("rigid-body", "joint-coulomb-friction", "joint-stribeck-friction", "payload")
    large = kinid.Model(
        "rigid-body", "joint-viscous-friction", "payload", "joint-stribeck-friction", "joint-coulomb-friction"
    )
    problem, fresh = Problem.build(experiment), Problem.build(experiment)
    for model in (small, large):
        named = model.parameters(experiment.layout)
        values = np.array([p.nominal + 0.3 * p.scale for p in named.values()])
        numbers, steps = list(range(len(values))), np.array([p.scale for p in named.values()])
        here = model.course(experiment.signals, values)
        found = changes(problem, model, values, numbers, steps, here)
    assert len(problem.columns) > 3 * 7
    fresh.columns.clear()
    alone = changes(fresh, model, values, numbers, steps, here)
    np.testing.assert_allclose(found, alone, rtol=0, atol=1e-9 * np.abs(found).max())
