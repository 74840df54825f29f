"""Logs turned into what models are fitted to: channels, validity, memory, bias, and where each quantity comes from."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scripted import RIG, Scripted, scripted_poke

from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.data.rig import WRENCH, Rig, ToolSpec
from kinid.effects import Layout
from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import FAR, from_contact, from_wrench
from kinid.modeling.model import Model
from kinid.modeling.readings import check_excitation
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]
NOISE = np.array([0.015, 0.015, 0.029, 0.0005, 0.0006, 0.0003])


@pytest.fixture(scope="module")
def poke() -> Scripted:
    return scripted_poke(seed=2)


@pytest.fixture(scope="module")
def experiment(poke: Scripted) -> Experiment:
    return from_wrench(poke.log, Rig.parse_text(RIG))


def test_the_truth_predicts_the_raw_wrench(poke: Scripted, experiment: Experiment) -> None:
    """Material, friction and bias as they were planted leave what the encoders' steps and the noise do."""
    assert experiment.layout == Layout(WRENCH, "wrench")
    model = Model("kelvin-voigt", "coulomb-friction", "sensor-bias")
    values = {
        "kelvin-voigt.stiffness": poke.material.stiffness,
        "kelvin-voigt.damping": poke.material.damping,
        "coulomb-friction.coefficient": poke.material.friction,
    }
    values |= {f"sensor-bias.offset[{name}]": b for name, b in zip(WRENCH, poke.bias)}
    # motion doesn't tell friction at rest, nor within a millimetre of a reversal
    sure = experiment.valid & ((np.linalg.norm(experiment.signals.slip_rate, axis=0) > 15e-3) | ~experiment.in_contact)
    assert (sure & experiment.in_contact).sum() > 100
    left = (experiment.measured - model.predict(experiment.signals, values))[:, sure]
    # accelerations from encoders of 2 µrad and steps of the converter come on top of the noise
    assert (np.sqrt(np.mean(left**2, axis=1)) < 2.0 * NOISE).all()
    assert 0.05 < experiment.in_contact.mean() < 0.9
    assert experiment.phase is not None
    np.testing.assert_array_equal(experiment.phase, poke.log.phase)


def test_contact_quantities_are_those_of_the_contact_frame(poke: Scripted, experiment: Experiment) -> None:
    touch = contact_series(poke.log, Rig.parse_text(RIG))
    np.testing.assert_array_equal(experiment.signals.depth, touch.depth)
    np.testing.assert_array_equal(experiment.signals.slip_rate, [touch.slip_rate1, touch.slip_rate2])
    np.testing.assert_array_equal(experiment.in_contact, touch.in_contact)
    sensor, driving = experiment.signals.sensor, experiment.signals.measured
    assert sensor is not None
    assert driving is not None
    force = np.einsum("nij,jn->in", sensor.to_contact, driving[:3] - sensor.load[:3])
    np.testing.assert_allclose(force, [touch.tangential_force1, touch.tangential_force2, touch.normal_force], atol=1e-9)


def test_what_is_known_of_the_noise_is_its_floor(poke: Scripted, experiment: Experiment) -> None:
    assert (experiment.noise >= NOISE).all()
    assert (experiment.noise < 1.5 * NOISE).all()
    silent = from_wrench(poke.log, Rig.parse_text(RIG.split("[sensor]")[0]))
    np.testing.assert_allclose(silent.noise, NOISE, rtol=0.2)  # found in the readings themselves


def test_bias(poke: Scripted) -> None:
    rig = Rig.parse_text(RIG)
    raw = np.asarray(poke.log.wrench).T
    none, auto = from_wrench(poke.log, rig), from_wrench(poke.log, rig, bias="auto")
    given = from_wrench(poke.log, rig, bias=[1.0, 0, 0, 0, 0, 0.5])
    sensor = rig.sensor.model_copy(update={"bias": tuple(poke.bias)})
    stated = from_wrench(poke.log, rig.model_copy(update={"sensor": sensor}))
    np.testing.assert_array_equal(none.measured, raw)
    np.testing.assert_allclose(raw - auto.measured, np.repeat(poke.bias[:, None], raw.shape[1], 1), atol=0.02)
    np.testing.assert_allclose(raw - given.measured, np.array([1.0, 0, 0, 0, 0, 0.5])[:, None] + 0 * raw, atol=1e-12)
    np.testing.assert_allclose(raw - stated.measured, poke.bias[:, None] + 0 * raw, atol=1e-12)
    for one in (none, given):  # what drives laws is free of bias all the same
        assert one.signals.measured is not None
        np.testing.assert_array_equal(one.signals.measured, auto.measured)
    with pytest.raises(InputError, match="six"):
        from_wrench(poke.log, rig, bias=[1.0])
    with pytest.raises(InputError, match="'auto', 'none'"):
        from_wrench(poke.log, rig, bias="any")  # type: ignore[arg-type]


def test_crosstalk_that_the_rig_states_is_removed(poke: Scripted) -> None:
    rig = Rig.parse_text(RIG)
    matrix = np.eye(6) + 0.02 * np.random.default_rng(0).uniform(-1, 1, (6, 6))
    rows = tuple(tuple(row) for row in matrix)
    stated = rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"crosstalk": rows})})
    mixed = poke.log.replace(wrench=np.asarray(poke.log.wrench) @ matrix.T)
    np.testing.assert_allclose(from_wrench(mixed, stated).measured, np.asarray(poke.log.wrench).T, atol=1e-9)


def test_without_a_surface_all_is_free_motion(swing: Callable[..., Any]) -> None:
    tool = {"mass": 0.5, "com": [0.01, 0.0, 0.05]}
    rig = Rig.parse({"robot": {"model": "lwr4plus"}, "tool": tool})
    robot, t = Robot.load(rig), np.linspace(0.0, 3.0, 600)
    q, dq, ddq = swing(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), seed=4)(t)
    true = tool_load(
        ToolSpec(mass=0.62, com=(0.01, 0.0, 0.05)), robot.kinematics("ft_sensor", q, dq, ddq), robot.gravity
    )
    e = from_wrench(
        Log(t, q=q, dq=dq, ddq=ddq, wrench=true + 0.3), rig, differentiator=Differentiator()
    )  # motion as logged
    assert (e.signals.depth == FAR).all()
    assert not e.in_contact.any()
    values = {"tool-mass.mass": 0.12, **{f"sensor-bias.offset[{name}]": 0.3 for name in WRENCH}}
    np.testing.assert_allclose(Model("tool-mass", "sensor-bias").predict(e.signals, values), e.measured, atol=1e-9)


def test_missing_samples_are_left_out_and_gaps_end_memory(poke: Scripted) -> None:
    log = poke.log
    assert log.q is not None
    assert log.wrench is not None
    t, wrench = log.t.copy(), log.wrench.copy()
    t[4000:] += 0.5
    wrench[100] = np.nan
    e = from_wrench(Log(t, q=log.q, wrench=wrench, phase=log.phase), Rig.parse_text(RIG))
    assert np.isfinite(e.measured[:, e.valid]).all()
    rows = np.flatnonzero(e.signals.dt == 0.0)
    assert len(rows) == 2
    assert (
        e.valid.sum() == len(log) - 1 - 500
    )  # in contact a second after the gap counts for nothing: who knows what came before
    assert not e.valid[rows[1] : rows[1] + 500].any()
    assert e.signals.t[rows[1]] == pytest.approx(t[4000] - t[0])
    assert e.signals.dt.max() <= 2.001 * log.period  # one sample that is missing is bridged


def test_without_a_wrench(poke: Scripted) -> None:
    assert poke.log.q is not None
    with pytest.raises(InputError, match="fx fy fz"):
        from_wrench(Log(poke.log.t, q=poke.log.q), Rig.parse_text(RIG))


def test_a_curved_surface_turns_with_the_place(poke: Scripted, tmp_path: Path) -> None:
    """A box whose top is the plane: the same contact axes, up to the tangents' choice."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((0.6, 0.6, 0.1), trimesh.transformations.translation_matrix([0.55, 0.0, 0.05]))
    box.export(tmp_path / "box.stl")
    text = RIG.split("[surface]")[0] + '[surface]\nmesh = "box.stl"\n[sensor]' + RIG.split("[sensor]")[1]
    e = from_wrench(poke.log, Rig.parse_text(text, folder=tmp_path))
    plane = from_wrench(poke.log, Rig.parse_text(RIG))
    near = e.signals.depth > -2e-3
    assert near.any()
    assert e.signals.sensor is not None
    assert plane.signals.sensor is not None
    np.testing.assert_allclose(
        e.signals.sensor.to_contact[near, 2], plane.signals.sensor.to_contact[near, 2], atol=1e-6
    )
    np.testing.assert_allclose(e.signals.depth[near], plane.signals.depth[near], atol=1e-6)


def material_tester() -> Log:
    t = np.arange(400) * 2e-3
    depth = 3e-3 * np.sin(2 * np.pi * t)
    force = np.round(900 * np.maximum(depth, 0.0) / 0.05) * 0.05
    return Log(t, contact={"depth": depth, "normal_force": force})


def test_a_quantised_reading_has_the_noise_of_its_steps() -> None:
    e = from_contact(contact_series(material_tester(), Rig.parse({})), ("normal_force",))
    assert e.noise[0] >= 0.99 * 0.05 / np.sqrt(12)
    assert e.signals.measured is not None
    np.testing.assert_array_equal(e.signals.measured, e.measured)


def test_a_contact_log_with_holes() -> None:
    log = material_tester()
    force = log.contact["normal_force"].copy()
    force[50] = np.nan
    t = log.t.copy()
    t[200:] += 1.0
    holed = Log(t, contact={**log.contact, "normal_force": force})
    e = from_contact(contact_series(holed, Rig.parse({})), ("normal_force",))
    np.testing.assert_array_equal(e.signals.t[e.signals.dt == 0.0], [0.0, t[200]])
    # the gap is in contact: until the tool leaves, what came before isn't known
    after = np.arange(399) >= np.flatnonzero(e.signals.dt == 0.0)[1]
    left = int(np.flatnonzero(after & ~e.in_contact)[0])
    assert 240 < left < 260
    assert e.valid[left:].all()
    np.testing.assert_array_equal(np.flatnonzero(~e.valid), np.flatnonzero(after[:left]))
    assert e.phase is None


def test_draws_of_the_motion_are_thinned_along(poke: Scripted) -> None:
    e = from_wrench(poke.log, Rig.parse_text(RIG))
    assert e.band is None
    thin = e.thinned(5)
    assert len(e.motion_draws) == len(thin.motion_draws) > 2
    for whole, some in zip(e.motion_draws, thin.motion_draws):
        assert (whole.depth != e.signals.depth).any()
        np.testing.assert_allclose(some.depth, whole.depth[::5], atol=1e-12)
        np.testing.assert_allclose(some.slip_rate, whole.slip_rate[:, ::5], atol=1e-9)
        np.testing.assert_allclose(some.sensor.specific, whole.sensor.specific[:, ::5], atol=1e-9)  # type: ignore[union-attr]


def test_a_bias_that_the_rig_does_not_state_is_said_as_the_rig_would_state_it(poke: Scripted) -> None:
    """What is pasted is what free motion shows, after which nothing is said, nor of a model that has it."""
    rig, model = Rig.parse_text(RIG), Model("kelvin-voigt", "coulomb-friction")
    raw = from_wrench(poke.log, rig)
    (said,) = [line for line in check_excitation(model, raw) if "doesn't state" in line]
    pasted = re.search(r"bias = (\[.*?\])", said)
    assert pasted is not None
    stated = RIG.replace("[sensor]", f"[sensor]\nbias = {pasted[1]}")
    np.testing.assert_allclose(Rig.parse_text(stated).sensor.bias, poke.bias, atol=0.03)  # a few steps of the converter
    as_stated = from_wrench(poke.log, Rig.parse_text(stated))
    np.testing.assert_allclose(
        as_stated.measured, from_wrench(poke.log, rig, bias="auto").measured, atol=1e-3
    )  # 4 digits
    for experiment, asked in ((as_stated, model), (raw, model + "sensor-bias")):
        assert not any("doesn't state" in line for line in check_excitation(asked, experiment))
