"""Free motion for tool and joints: within limits, and it tells what it promises."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import kinid
from kinid.data.log import Log
from kinid.errors import InputError
from kinid.identification.fit import fit_model
from kinid.modeling.from_logs import from_wrench
from kinid.planning.check import breaks, check
from kinid.planning.free_motion import WRENCH_NOISE, Swing, excite_free
from kinid.planning.limits import Limits
from kinid.planning.poke_design import Bounds


def test_a_swing_has_its_derivatives() -> None:
    rng = np.random.default_rng(0)
    swing = Swing(
        rng.normal(size=3), rng.uniform(0, 1, (3, 2)), rng.uniform(0.2, 2, (3, 2)), rng.uniform(0, 6, (3, 2)), 5.0, 1.0
    )
    t, h = np.linspace(0.01, 4.99, 500), 1e-5
    for order in range(3):
        slope = (swing(t + h)[order] - swing(t - h)[order]) / (2 * h)
        np.testing.assert_allclose(slope, swing(t)[order + 1], atol=1e-4 * np.abs(swing(t)[order + 1]).max())
    ends = swing(np.array([0.0, 5.0]))
    np.testing.assert_allclose(ends[0], np.tile(swing.base, (2, 1)), atol=1e-15)
    np.testing.assert_allclose(np.stack(ends[1:]), 0.0, atol=1e-12)


def test_values_are_those_of_parameters_by_short_names_too(rig: Any) -> None:
    model, bounds = kinid.Model("tool-mass", "tool-com"), Bounds(duration=3.0, bandwidth=1.5)
    for values, words in (
        ({"stiffness": 900.0}, "value for 'stiffness'"),
        ({"tool-mass.error": 0.1}, "'tool-mass.error'"),
        ({"mass": 1e9}, "tool-mass.mass = 1e.09 kg"),
    ):
        with pytest.raises(InputError, match=words):
            excite_free(rig, model, values, bounds=bounds, rate=50.0)
    short, full = (
        excite_free(rig, kinid.Model("tool-mass"), {name: 0.3}, bounds=bounds, rate=50.0, sines=1, collisions=False)
        for name in ("mass", "tool-mass.mass")
    )
    assert short.intervals["tool-mass.mass"].value == full.intervals["tool-mass.mass"].value == 0.3


def test_the_tools_load(rig: Any) -> None:
    """Expected intervals beside those of fits to simulated wrenches; and more than a motion at random tells."""
    model = kinid.Model("tool-mass", "tool-com")
    found = excite_free(rig, model, bounds=Bounds(duration=6.0, bandwidth=1.5), rate=100.0)
    motion = found.trajectory
    limits = Limits.of(kinid.Robot.load(rig))
    assert breaks(motion, limits) <= 1e-9
    assert max(use.share for use in check(motion, limits)) <= 0.75
    bare = rig.model_copy(update={"surface": None})
    log = Log(motion.t, motion.q, motion.dq, motion.ddq, wrench=np.zeros((len(motion), 6)), phase=motion.phase)
    experiment = from_wrench(log, bare, bias=np.zeros(6), trust_wrench=True)
    truth = np.zeros(4)
    clean = model.predict(experiment.signals, truth)
    halves, values = [], []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(size=clean.shape) * WRENCH_NOISE[:, None]
        fit = fit_model(
            model, dataclasses.replace(experiment, measured=clean + noise, noise=WRENCH_NOISE), held_out=False
        )
        halves.append([0.5 * (p.high - p.low) for p in fit.parameters.values()])
        values.append([p.value for p in fit.parameters.values()])
    expected = np.array([each.half for each in found.intervals.values()])
    np.testing.assert_allclose(np.median(halves, axis=0), expected, rtol=0.2)
    assert (np.abs(values) < 3 * expected).all()


def test_joint_effects(rig: Any) -> None:
    found = excite_free(
        rig,
        kinid.Model("rigid-body", "joint-coulomb-friction", "joint-viscous-friction"),
        bounds=Bounds(duration=6.0, bandwidth=1.0),
        rate=100.0,
    )
    assert len(found.intervals) == 14
    assert all(np.isfinite(each.half) for each in found.intervals.values())
    assert (np.abs(found.trajectory.dq).max(axis=0) > 0.05).all()  # every joint moves


def test_what_cannot_be_planned(rig: Any) -> None:
    with pytest.raises(InputError, match="free motion"):
        excite_free(rig, kinid.Model("hooke"))
    with pytest.raises(InputError, match="posture"):
        excite_free(rig, kinid.Model("tool-mass"), start=np.full(7, 9.0))
