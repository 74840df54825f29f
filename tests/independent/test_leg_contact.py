"""A measured two-joint leg above an ATI sensor: what joint torques say of the contact force, against the sensor.

Two massless links, so that inverse dynamics is −Jᵀ f alone. What it finds about signs: the sensor under the foot
reports the ground's push on the foot (positive upwards), the load that the log format wants; a motor torque τ holds the
foot against it with τ = −Jᵀ f. What it finds about the leg: friction, 0.02 to 0.04 N·m in the hip and 0.09 to 0.13 in
the knee, which Jᵀ alone can't know of.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid
from kinid.robotics.motion import joint_motion

Array = NDArray[np.float64]

# z = −(l cos q1 + l cos(q1 + q2)), x = −(l sin q1 + l sin(q1 + q2)): both joints turn about +y, both links hang down
URDF = """\
<robot name="leg">
  <link name="body"/><link name="thigh"/><link name="shin"/><link name="foot"/>
  <joint name="hip" type="revolute">
    <parent link="body"/><child link="thigh"/><axis xyz="0 1 0"/>
    <limit lower="-3.1" upper="3.1" velocity="50" effort="5"/>
  </joint>
  <joint name="knee" type="revolute">
    <parent link="thigh"/><child link="shin"/><origin xyz="0 0 -0.16"/><axis xyz="0 1 0"/>
    <limit lower="-3.1" upper="3.1" velocity="50" effort="5"/>
  </joint>
  <joint name="ankle" type="fixed"><parent link="shin"/><child link="foot"/><origin xyz="0 0 -0.16"/></joint>
</robot>
"""
RIG = """\
[robot]
model = "leg.urdf"
sensor_frame = "foot"
tip_frame = "foot"

[sensor]
wrench_frame = "base"  # the sensor stands on the ground, it does not turn with the shin
"""
SLOW = 0.1  # [rad/s] below this, friction turns over gradually

pytestmark = pytest.mark.real


@pytest.fixture
def rig(tmp_path: Path) -> kinid.Rig:
    (tmp_path / "leg.urdf").write_text(URDF)
    (tmp_path / "rig.toml").write_text(RIG)
    return kinid.Rig.load(tmp_path / "rig.toml")


@cache
def record(folder: Path) -> kinid.Log:
    """The files of a record, joined on the counter of milliseconds in their first column."""
    names = ("joint_positions", "joint_torques", "ati_force")
    tables = [np.loadtxt(folder / f"dg_hopper_teststand-{name}.dat") for name in names]
    counter = tables[0][:, 0]
    for table in tables[1:]:
        counter = np.intersect1d(counter, table[:, 0])
    q, tau, force = (table[np.searchsorted(table[:, 0], counter), 1:] for table in tables)
    return kinid.Log(t=1e-3 * counter, q=q, tau=tau, wrench=np.hstack([force, np.zeros_like(force)]))


def ground(log: kinid.Log) -> Array:
    """Vertical force that the sensor reads [N], (n,)."""
    return np.asarray(log.wrench)[:, 2]


def vertical(rig: kinid.Rig, log: kinid.Log, tau: Array) -> Array:
    """Vertical force of the ground on the foot from joint torques, −J⁻ᵀ τ in the plane of the leg [N], (n,)."""
    robot = kinid.Robot.load(rig)
    columns = [robot.kinematics("foot", log.q, np.tile(unit, (len(log), 1))).velocity for unit in np.eye(2)]
    jacobian = np.stack(columns, axis=2)[:, [0, 2]]  # rows x, z
    force = -np.linalg.solve(np.swapaxes(jacobian, 1, 2), tau[:, :, None])
    return np.asarray(force[:, 1, 0])


def friction(rig: kinid.Rig, log: kinid.Log) -> Array:
    """Coulomb friction of each joint from what inverse dynamics with the sensor's force leaves [N·m], (2,)."""
    residual = kinid.joint_torques(log, rig, bias="none").residual
    turn = np.tanh(joint_motion(log, kinid.Robot.load(rig)).dq / SLOW)
    fits = [np.polyfit(turn[:, j], residual[:, j], 1) for j in (0, 1)]
    return np.array([slope for slope, _ in fits])


def correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])


def test_the_foot_is_where_the_leg_s_own_controller_had_it(rig: kinid.Rig, real_data: Path) -> None:
    log = record(real_data / "leg-contact" / "jump")
    table = np.loadtxt(real_data / "leg-contact" / "jump" / "dg_rel_pos_foot_hopper-sout.dat")
    logged = table[np.searchsorted(table[:, 0], np.round(1e3 * log.t)), 1:]
    foot = kinid.Robot.load(rig).kinematics("foot", log.q).position
    # six digits were logged; sideways the controller has an offset of the leg, which this model has not
    assert np.abs(foot - logged)[:, [0, 2]].max() < 2e-6


def test_jacobian_transpose_force_on_the_jump(rig: kinid.Rig, real_data: Path) -> None:
    """From half a second before the foot leaves the ground until it comes back; and the other parts, for honesty."""
    log = record(real_data / "leg-contact" / "jump")
    sensor = ground(log)
    top = int(sensor.argmax())
    leave = top + int(np.argmax(sensor[top:] < 0.05 * sensor[top]))
    land = leave + 50 + int(np.argmax(sensor[leave + 50 :] > 0.1 * sensor[top]))
    assert np.abs(sensor[leave + 10 : land]).max() < 0.1 * sensor[top]  # in the air the sensor reads nothing
    force = vertical(rig, log, np.asarray(log.tau))
    parts = {"push-off": slice(leave - 500, leave), "jump": slice(leave - 500, land), "whole record": slice(None)}
    found = {name: correlation(force[rows], sensor[rows]) for name, rows in parts.items()}
    print(
        f"\nin the air for {land - leave} ms; correlation of the vertical force from −J⁻ᵀ τ with the sensor: "
        + ", ".join(f"{name} {value:.4f}" for name, value in found.items())
    )
    assert found["push-off"] >= 0.97
    assert found["jump"] >= 0.95
    assert found["whole record"] >= 0.93  # friction, impact and the landing leg's own inertia are in it


def test_push_and_pull(rig: kinid.Rig, real_data: Path) -> None:
    log = record(real_data / "leg-contact" / "push_pull")
    force, sensor = vertical(rig, log, np.asarray(log.tau)), ground(log)
    print(f"\npush and pull, {sensor.min():.0f} to {sensor.max():.0f} N: correlation {correlation(force, sensor):.4f}")
    assert correlation(force, sensor) >= 0.95
    # the sign, too: force and reading agree, and are no mirror images
    assert 0.7 < np.polyfit(force, sensor, 1)[0] < 1.3


def test_friction_learnt_on_one_record_improves_the_other(rig: kinid.Rig, real_data: Path) -> None:
    """What is missing on the whole jump is friction: found on the other record, it lifts the correlation above 0.95."""
    jump, pull = (record(real_data / "leg-contact" / name) for name in ("jump", "push_pull"))
    for learnt, tried, least in ((pull, jump, 0.95), (jump, pull, 0.99)):
        coulomb, sensor = friction(rig, learnt), ground(tried)
        turn = np.tanh(joint_motion(tried, kinid.Robot.load(rig)).dq / SLOW)
        bare, helped = (
            correlation(vertical(rig, tried, np.asarray(tried.tau) - part), sensor) for part in (0.0, coulomb * turn)
        )
        print(
            f"\nfriction {coulomb.round(3)} N·m from the other record: whole record {bare:.4f} → {helped:.4f}", end=""
        )
        assert (coulomb > 0).all()
        assert helped > bare
        assert helped >= least


def test_joint_torques_predict_the_motors(rig: kinid.Rig, real_data: Path) -> None:
    """The other way round: the sensor's force through Jᵀ, in base axes, against the measured torque of the knee."""
    log = record(real_data / "leg-contact" / "push_pull")
    found = kinid.joint_torques(log, rig, bias="none")
    rows = [correlation(found.predicted[:, j], found.measured[:, j]) for j in (0, 1)]
    print(
        f"\njoint torques from the sensor: rms {found.rms.round(3)} of {found.measured_rms.round(3)} N·m, "
        f"correlation hip {rows[0]:.3f}, knee {rows[1]:.3f}"
    )
    assert rows[1] >= 0.98
    assert rows[0] >= 0.85  # the foot is nearly under the hip, which then carries little
