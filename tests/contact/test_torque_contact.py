"""Contact forces from joint torques against the wrist sensor of the virtual laboratory."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinid
from kinid.calibration.free_torques import without_free_torques
from kinid.data.rig import SensorSpec
from kinid.errors import InputError
from kinid.identification.fitted import FittedModel
from kinid.lab.experiments import prepare

Array = NDArray[np.float64]

FORCES = ("tangential_force1", "tangential_force2", "normal_force")
#: experiments at places, on materials and on slopes that nothing here was chosen on
RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    "poke aside": ("poke", {"point": (0.5, 0.2, 0.15), "seed": 11}),
    "poke on a stiffer silicone": ("poke", {"material": "dragon-skin-10", "point": (0.6, -0.1, 0.2), "seed": 12}),
    "poke on a slope": ("poke", {"point": (0.6, 0.0, 0.35), "normal": (-0.5, 0.0, 1.0), "seed": 13}),
    "slide aside": ("slide", {"point": (0.5, 0.2, 0.15), "seed": 14}),
    "slide on a slope": ("slide", {"normal": (0.3, 0.2, 1.0), "seed": 16}),
}


@cache
def run(name: str) -> tuple[kinid.Log, kinid.Rig]:
    experiment, places = RUNS[name]
    result = prepare(experiment, **places).run()
    return result.log, result.setup.rig


def bare(rig: kinid.Rig, **changes: Any) -> kinid.Rig:
    """A rig without a wrist sensor."""
    return rig.model_copy(update={"sensor": SensorSpec(), **changes})


@cache
def touches(name: str) -> tuple[kinid.ContactSeries, kinid.ContactSeries]:
    """By the wrist sensor, and by joint torques."""
    log, rig = run(name)
    return kinid.contact_series(log, rig), kinid.contact_series(log.replace(wrench=None), bare(rig))


@pytest.mark.parametrize("name", RUNS)
def test_forces_against_the_wrist_sensor(name: str) -> None:
    """Joint torques with 0.05 N·m of noise and up to 0.5 N·m of friction, at arm's length."""
    sensor, found = touches(name)
    assert found.force_sd is not None
    inside = sensor.in_contact
    for k, force in enumerate(FORCES):
        error, sd = (getattr(found, force) - getattr(sensor, force))[inside], found.force_sd[k][inside]
        rms, share = float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error) < 2 * sd))
        print(f"\n{name}, {force}: {rms:.3f} N rms, said {np.median(sd):.3f}, inside two {100 * share:.1f} %", end="")
        # 0.05 N·m at half a metre make 0.1 N, what is left of the friction as much again; four times the noise alone
        assert rms < 0.4
        # 95 % of a normal distribution; errors of friction last, so that a log holds few that are independent
        assert share >= 0.9
        assert np.median(sd) < 3 * rms  # nor do wide deviations buy it
    assert np.mean(found.in_contact == sensor.in_contact) > 0.97


@pytest.mark.parametrize("name", RUNS)
def test_stiffness_against_the_wrist_sensor(name: str) -> None:
    log, rig = run(name)
    model = kinid.Model("kelvin-voigt", "coulomb-friction")
    sensor, found = model.fit(log, rig), model.fit(log.replace(wrench=None), bare(rig))
    best, here = sensor["stiffness"].value, found["stiffness"]
    print(f"\n{name}: {here.value:.0f} [{here.low:.0f}, {here.high:.0f}], by the sensor {best:.0f} N/m", end="")
    assert here.low < best < here.high
    assert here.value == pytest.approx(best, rel=0.06)
    assert any("forces come from joint torques" in warning for warning in found.warnings)


def test_the_output_says_where_forces_come_from() -> None:
    _, found = touches("poke aside")
    (said,) = (line for line in found.warnings if "joint torques" in line)
    assert "standard deviation is 0.21 N along the normal" in said
    columns = found.columns()
    for name in FORCES:
        assert np.isfinite(columns[f"{name}_sd"]).all()
    assert "normal_force_sd" not in touches("poke aside")[0].columns()


def test_diagnosis_finds_what_is_missing_and_nothing_in_the_joints_friction() -> None:
    log, rig = run("slide aside")
    log, rig = log.replace(wrench=None), bare(rig)
    right = kinid.Model("kelvin-voigt", "coulomb-friction")
    assert kinid.diagnose(log, rig, model=right).verdict == "adequate"
    found = kinid.diagnose(log, rig, model=kinid.Model("kelvin-voigt"))
    assert found.verdict == "missing"
    assert found.added[0] == "coulomb-friction"


def test_models_are_compared() -> None:
    log, rig = run("slide aside")
    models = [kinid.Model("hooke"), kinid.Model("hooke", "coulomb-friction")]
    found = kinid.compare(models, log.replace(wrench=None), bare(rig))
    assert str(found.rows[0].fit.model) == "hooke + coulomb-friction"
    assert found.rows[1].difference > 4 * found.rows[1].standard_error  # friction is there beyond doubt


def test_a_fit_to_free_motion_makes_forces_surer(tmp_path: Path) -> None:
    """What a motion in the air tells of friction and offsets is taken off the torques of a log of touches."""
    result = prepare("wave", seed=3).run()
    log, rig = run("poke aside")
    log, rig = log.replace(wrench=None), bare(rig)
    model = kinid.Model("rigid-body", "joint-torque-offset", "joint-coulomb-friction", "joint-viscous-friction")
    model.fit(result.log.replace(wrench=None), rig).save(tmp_path / "free.json")
    made = without_free_torques(log, rig, FittedModel.load(tmp_path / "free.json"))
    sensor, found = touches("poke aside")
    errors = [
        np.sqrt(np.mean((touch.normal_force - sensor.normal_force)[sensor.in_contact] ** 2))
        for touch in (found, made.touch)
    ]
    print(f"\nnormal force {errors[0]:.3f} N rms by free motion of the log, {errors[1]:.3f} by the fit")
    assert errors[1] < 0.8 * errors[0]
    assert "joint-coulomb-friction" in made.line()
    with pytest.raises(InputError, match="without \\[sensor\\]"):
        without_free_torques(*run("poke aside"), FittedModel.load(tmp_path / "free.json"))


def test_a_turned_base_changes_nothing() -> None:
    """Base axes turned about the first joint's, with gravity and the surface: the contact is the same."""
    log, rig = run("poke on a slope")
    log, rig = log.replace(wrench=None), bare(rig)
    angle = 0.7
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    assert rig.surface is not None
    surface = {name: turn @ getattr(rig.surface, name) for name in ("point", "normal", "tangent")}
    tables = {"robot": {"model": "lwr4plus"}, "tool": rig.tool, "surface": {k: v.tolist() for k, v in surface.items()}}
    here = kinid.contact_series(log, rig)
    there = kinid.contact_series(log.replace(q=np.asarray(log.q) + angle * np.eye(7)[0]), kinid.Rig.parse(tables))
    for name in ("depth", *FORCES):
        # the smoother rounds positions anew: 1e-5 N beside some N
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), atol=1e-4)
    np.testing.assert_allclose(there.force_sd, here.force_sd, atol=1e-4)


def test_external_torques_are_taken_as_they_are() -> None:
    log, rig = run("poke aside")
    log, rig = log.replace(wrench=None), bare(rig)
    assert rig.robot is not None
    external = rig.model_copy(update={"robot": rig.robot.model_copy(update={"torques": "external"})})
    residual = kinid.joint_torques(log, rig).residual
    here = kinid.contact_series(log, rig)
    there = kinid.contact_series(log.replace(tau=residual), external)
    np.testing.assert_allclose(there.normal_force, here.normal_force, atol=1e-9)
    for refused in (
        lambda: kinid.joint_torques(log, external),
        lambda: kinid.Model("rigid-body").fit(log, external),
    ):
        with pytest.raises(InputError, match='torques = "external" for inverse dynamics'):
            refused()


def test_a_touch_at_another_link_is_doubted() -> None:
    """A push at the elbow while the tip is inside the material."""
    log, rig = run("poke aside")
    robot = kinid.Robot.load(rig)
    units = np.eye(7)
    elbow = np.stack([robot.kinematics("link_4", log.q, np.tile(u, (len(log), 1))).velocity for u in units], axis=2)
    push = np.where((log.phase == "poke")[:, None], [20.0, -20.0, 10.0], 0.0)
    tau = np.asarray(log.tau) - np.einsum("nij,ni->nj", elbow, push)
    found = kinid.contact_series(log.replace(wrench=None, tau=tau), bare(rig))
    assert any("the arm touches elsewhere" in line for line in found.warnings)
    assert not any("elsewhere" in line for line in touches("poke aside")[1].warnings)


def test_a_stated_sensor_keeps_forces_unknown() -> None:
    from kinid.contact.doubts import contact_doubts

    log, rig = run("poke aside")
    log = log.replace(wrench=None)
    touch = kinid.contact_series(log, rig)
    assert np.isnan(touch.normal_force).all()
    assert touch.force_sd is None
    assert any(
        "take [sensor] out of the rig" in line for line in contact_doubts(log, rig, kinid.Robot.load(rig), touch)
    )


def test_rows_without_torques_are_left_out() -> None:
    log, rig = run("poke aside")
    tau = np.array(log.tau)
    tau[3000:3010, 2] = np.nan
    found = kinid.contact_series(log.replace(wrench=None, tau=tau), bare(rig))
    assert np.array_equal(np.flatnonzero(~found.valid), np.arange(3000, 3010))


def test_a_log_without_free_motion_is_doubted() -> None:
    log, rig = run("poke aside")
    inside = np.flatnonzero(log.phase == "poke")
    cut = {name: np.asarray(getattr(log, name))[inside] for name in ("t", "q", "tau", "phase")}
    found = kinid.contact_series(kinid.Log(**cut), bare(rig))
    assert any("no free motion to learn" in line for line in found.warnings)
    assert found.force_sd is not None
    assert np.median(found.force_sd[2]) > 5 * np.median(touches("poke aside")[1].force_sd[2])  # type: ignore[index]


def test_a_tool_needs_the_frame_that_it_is_in() -> None:
    tables = {
        "robot": {"model": "panda", "tip_frame": "panda_link8", "joints": [f"panda_joint{k}" for k in range(1, 8)]},
        "tool": {"mass": 0.3},
        "surface": {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, 1.0]},
    }
    q = np.tile([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.0], (300, 1))
    log = kinid.Log(np.arange(300) / 500.0, q=q, tau=np.zeros((300, 7)))
    with pytest.raises(InputError, match=r"name \[robot\] sensor_frame"):
        kinid.contact_series(log, kinid.Rig.parse(tables))
    with pytest.raises(InputError, match="torques = 'motor'"):
        kinid.Rig.parse({"robot": {"model": "panda", "torques": "motor"}})
