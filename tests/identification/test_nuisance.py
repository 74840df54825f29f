"""What calibration leaves open: amounts inside their ranges, which act as the effects themselves do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured.cases import planned, unchanged
from scripted import RIG, scripted_poke

import kinid
from kinid.identification.fit import fit_model
from kinid.identification.nuisance import nuisance_columns, nuisances, with_calibration
from kinid.modeling.model import Model
from kinid.robotics.inverse_dynamics import inverse_dynamics

JOINT_MODEL = ("rigid-body", "joint-torque-offset", "joint-coulomb-friction", "joint-viscous-friction")
#: where the measured drive's friction ends, whatever of it a model begins without
DRIVE = {*JOINT_MODEL, "joint-friction-asymmetry", "joint-stribeck-friction"}


def rubbing(swing: Callable[..., Any], viscous: float, ahead: float = 0.0) -> kinid.Log:
    """Half a minute of an arm in free motion, whose torques are so much ahead [s]."""
    rng, t = np.random.default_rng(8), np.arange(6000) / 200.0
    path = swing(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), seed=3, size=0.5, speed=3.0)
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}})
    q, dq, ddq = path(t)
    later, speed, acceleration = path(t + ahead)
    tau = inverse_dynamics(kinid.Robot.load(rig), later, speed, acceleration)
    tau = tau + 0.4 * np.tanh(40.0 * speed) + viscous * speed
    return kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=tau + 0.02 * rng.standard_normal(q.shape))


def test_amounts_act_as_the_effects_themselves(swing: Callable[..., Any]) -> None:
    """A lag, a delay and gains at once: the readings of the model that has them, not the sum of their first orders."""
    fit = Model(*JOINT_MODEL).fit(rubbing(swing, 0.2), kinid.Rig.parse({"robot": {"model": "lwr4plus"}}))
    signals, model = fit.experiment.signals, fit.model
    open_ = [n for n in nuisances(model, signals) if n.effect.id in ("sensor-lag", "time-offset", "joint-torque-gain")]
    amounts = np.array([1.2 + 0.05 * i for i in range(len(open_))])
    whole = model + "sensor-lag" + "time-offset" + "joint-torque-gain"
    values = dict(zip(model.parameters(fit.layout), fit.values))
    for nuisance, amount in zip(open_, amounts):
        values[f"{nuisance.effect.id}.{nuisance.name}"] = amount * nuisance.sd
    assert len(open_) == 9
    got = with_calibration(model, fit.values, open_, amounts, signals)
    np.testing.assert_allclose(got, whole.predict(signals, values), rtol=0, atol=1e-12)


def test_amounts_stay_inside_the_range_of_their_parameter(swing: Callable[..., Any]) -> None:
    """Torques that are ahead have a filter with a negative time constant to a first order: there is none."""
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}})
    state = Model(*JOINT_MODEL).fit(rubbing(swing, 0.2, ahead=0.004), rig).state
    (lag,) = [i for i, n in enumerate(state.open_) if n.effect.id == "sensor-lag"]
    assert state.open_[lag].low == 0.0
    assert state.shift[lag] >= 0.0


@pytest.mark.parametrize("amount", [-1.7, -1.0, 1.3])
def test_a_change_is_that_to_where_an_amount_is(amount: float) -> None:
    """Of a power law and a misplaced surface: not the slope at one side for both, times the amount."""
    t = np.arange(1600) / 200.0
    depth = 2e-3 * np.sin(3.0 * t)
    contact = {"depth": depth, "normal_force": 6000.0 * np.maximum(depth, 0.0) ** 1.3}
    state = Model("hunt-crossley").fit(kinid.Log(t=t, contact=contact)).state
    here = state.model.course(state.problem.experiment.signals, state.values)
    (offset,) = [n for n in state.open_ if n.effect.id == "surface-offset"]
    got = nuisance_columns(state.problem, state.model, state.values, here, (offset,), np.array([amount]))[:, 0] * amount
    values = dict(zip(state.model.parameters(state.problem.layout), state.values))
    values["surface-offset.offset"] = amount * offset.sd
    moved = (state.model + "surface-offset").predict(state.problem.experiment.signals, values)
    wanted = (state.problem.means(moved) - state.problem.means(here.reading)).ravel()
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-12)


def test_a_stated_gain_is_in_intervals_of_what_scales_with_it() -> None:
    """Of the forces' scale, stiffness and damping; not of a ratio or an exponent."""
    t = np.arange(20_000) / 500.0
    depth = 2e-3 * np.sin(3.0 * t)
    rng, contact = np.random.default_rng(2), {"depth": depth, "slip1": 0.01 * np.sin(1.3 * t), "slip2": 0.0 * t}
    normal = 5e4 * np.maximum(depth, 0.0) ** 1.4 * 1.01  # the sensor reads one per cent too much
    along = -0.4 * normal * np.sign(np.cos(1.3 * t))
    for name, force in (("normal_force", normal), ("tangential_force1", along), ("tangential_force2", 0.0 * t)):
        contact[name] = force + 0.01 * rng.standard_normal(len(t))
    log, model = kinid.Log(t=t, contact=contact), Model("hunt-crossley", "coulomb-friction")
    plain, stated = (model.fit(log, kinid.Rig.parse({"sensor": sensor})) for sensor in ({}, {"gain_sd": 0.01}))
    for name, widens in (("stiffness", True), ("exponent", False), ("coefficient", False)):
        before, after = plain[name], stated[name]
        assert after.value == pytest.approx(before.value, rel=1e-2)
        assert ((after.high - after.low) > 1.2 * (before.high - before.low)) == widens, name
    assert stated["stiffness"].low <= 5e4 <= stated["stiffness"].high


@pytest.mark.real
def test_a_measured_drive_ends_in_one_model_from_wherever_it_begins(real_data: Path) -> None:
    """Models that lack another part of the friction each end with the same effects at the same error."""
    ends, errors = [], []
    for source, model in sorted({(s, s.model) for s, _, _ in planned("drive-friction/", [2.0])}, key=lambda p: p[1]):
        for left_out in ("joint-viscous-friction", "joint-coulomb-friction"):
            begun = tuple(name for name in model if name != left_out)
            found = kinid.diagnose(*unchanged(source, begun, real_data), model=Model(*begun))
            ends.append({*begun, *found.added})
            errors.append(found.steps[-1].held_out)
    assert all(end >= DRIVE for end in ends)
    assert max(errors) < 1.05 * min(errors)


@pytest.mark.parametrize(("late", "doubted"), [(0.0, False), (-0.005, True), (0.01, True)])
@pytest.mark.parametrize("seed", [0, 2])
def test_what_one_reversal_bends_is_no_clock_that_is_off(late: float, doubted: bool, seed: int) -> None:
    """Friction of another form at rest, which the model lacks, asks for an earlier clock at the one reversal."""
    made = scripted_poke(seed=seed)
    t = np.asarray(made.log.t)
    wrench = np.stack([np.interp(t - late, t, channel) for channel in np.asarray(made.log.wrench).T], axis=1)
    rig = kinid.Rig.parse_text(RIG)
    rig = rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"bias": tuple(made.bias)})})
    log = kinid.Log(t=t, q=made.log.q, wrench=wrench, phase=made.log.phase)
    fit = fit_model(Model("kelvin-voigt", "coulomb-friction"), log, rig, held_out=False)
    assert any("time-offset beyond what calibration is trusted to" in said for said in fit.warnings) == doubted
    # whatever is said of the clock, a bias that the rig doesn't state shows everywhere
    fit = fit_model(Model("kelvin-voigt", "coulomb-friction"), log, kinid.Rig.parse_text(RIG), held_out=False)
    assert any("sensor-bias beyond what calibration is trusted to (offset[fx]" in said for said in fit.warnings)
