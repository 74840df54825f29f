"""Parameters that are moved together: each changes its own channel alone, and sensitivities are as if each were moved alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid
from kinid import effects
from kinid.diagnosis import descent
from kinid.diagnosis.candidates import able, screen
from kinid.diagnosis.descent import _Descent, fit, settled
from kinid.diagnosis.problem import Problem
from kinid.diagnosis.together import ALL, together
from kinid.effects import Layout
from kinid.experiment import Experiment, from_joint_torques

Array = NDArray[np.float64]

LAYOUT = Layout(("tau1", "tau2", "tau3"), "joints", ("base", "shoulder", "elbow"))
RIGID = kinid.Model("rigid-body")
#: what changes torques of every joint, beside what changes each alone
MODEL = kinid.Model("rigid-body", "joint-coulomb-friction", "joint-torque-gain", "payload", "sensor-drift", "sensor-lag")


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


def one_by_one(names: Any, layout: Layout) -> list[dict[int, int]]:
    """Every parameter alone."""
    return [{ALL: number} for number, _ in names]


def test_joints_in_brackets_go_together_and_all_others_alone() -> None:
    names = ["payload.mass", "joint-coulomb-friction.coulomb[base]", "joint-coulomb-friction.coulomb[elbow]",
             "sensor-drift.drift[tau1]", "sensor-drift.drift[tau2]", "gravity-error.error[x]"]  # fmt: skip
    numbered = list(enumerate(names))
    assert together(numbered, LAYOUT) == [{ALL: 0}, {ALL: 5}, {0: 1, 2: 2, 1: 4}, {0: 3}]
    assert together([], LAYOUT) == []
    contact = Layout(("fx", "fy"), "wrench")
    assert together([(7, "sensor-bias.bias[fx]"), (9, "sensor-bias.bias[fy]")], contact) == [{ALL: 7}, {ALL: 9}]


def test_each_changes_its_own_channel_alone(experiment: Experiment) -> None:
    """Of every effect of the catalogue that acts on joint torques, beside those that act behind it."""
    layout, seen = experiment.layout, 0
    for effect, why in able(RIGID, layout):
        if why or effect.detector:
            continue
        model = kinid.Model("rigid-body", *effect.wants[:1], effect.id, *({"joint-torque-gain", "sensor-lag"} - {effect.id}))
        named = list(model.parameters(layout))
        values = np.array([p.nominal if np.isfinite(p.nominal) else 1.0 for p in model.parameters(layout).values()])
        before = model.predict(experiment.signals, values)
        scale = [p.scale for p in model.parameters(layout).values()]
        for group in together(list(enumerate(named)), layout):
            for channel, j in group.items():
                if channel == ALL:
                    continue
                seen += 1
                other = values.copy()
                other[j] += scale[j]
                assert not np.delete(model.predict(experiment.signals, other) - before, channel, axis=0).any(), named[j]
    assert seen >= 8 * 7


def test_sensitivities_are_as_if_each_were_moved_alone(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a model's own parameters, of a candidate's, and of what enters linearly."""
    layout = experiment.layout
    values = np.array([0.3 * p.scale + p.nominal for p in MODEL.parameters(layout).values()])
    problem = Problem.build(experiment, MODEL, values)
    state = fit(Problem.build(experiment, RIGID, np.zeros(0)), RIGID, np.zeros(0))
    effect = effects.get("joint-viscous-friction")

    def found() -> tuple[Array, Array, Array]:
        at = _Descent(problem, MODEL, values, np.zeros(len(problem.calibration)))
        return at.sensitivity(), screen(state, effect)[0].start, settled(problem, MODEL, values)

    many, predict = [], kinid.Model.predict
    monkeypatch.setattr(kinid.Model, "predict", lambda *a, **k: (many.append(1), predict(*a, **k))[1])
    fast = found()
    saved = len(many)
    monkeypatch.setattr(descent, "together", one_by_one)
    monkeypatch.setattr("kinid.diagnosis.candidates.together", one_by_one)
    slow = found()
    print(f"{saved} predictions, {len(many) - saved} one by one")
    assert len(many) - saved > 3 * saved
    for a, b in zip(fast, slow):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
