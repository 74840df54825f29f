"""Logs of real machines, each read with the rig that its description asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from kinid.data.readers import read
from kinid.data.rig import Rig
from kinid.errors import InputError

pytestmark = pytest.mark.real
UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")


def rig(**columns: Any) -> Rig:
    return Rig.parse({"columns": columns})


@pytest.fixture
def bag(real_data: Path) -> Path:
    pytest.importorskip("rosbags")
    return real_data / "ur10e-bags"


def test_lwr4plus_motion(real_data: Path) -> None:
    names = {
        "t": "times",
        "q": "positions",
        "dq": "velocities",
        "ddq": "accelerations",
        "tau": "torques",
        "q_cmd": "target_positions",
    }
    path = real_data / "lwr4plus-motion" / "measurements_1.npz"
    log = read(path, rig(**{quantity: {"column": name} for quantity, name in names.items()}))
    assert (len(log), log.joint_count) == (5027, 7)
    assert log.valid.all()
    assert 1 / log.period == pytest.approx(200, rel=0.01)
    assert log.t[-1] - log.t[0] == pytest.approx(25.1, abs=0.1)
    with np.load(path, allow_pickle=False) as raw:
        np.testing.assert_array_equal(log.t, raw["times"])  # Unix seconds are kept
        np.testing.assert_array_equal(log.tau, raw["torques"])
        np.testing.assert_array_equal(log.q_cmd, raw["target_positions"])


def test_drive_friction(real_data: Path) -> None:
    path = real_data / "drive-friction" / "DATA_EMPS.mat"
    raw = scipy.io.loadmat(path)
    gain = {"column": "vir", "unit": "V", "scale": float(raw["gtau"][0, 0])}  # 35.15065 N/V
    log = read(path, rig(q1={"column": "qm"}, q_cmd1={"column": "qg"}, tau1=gain))
    assert (len(log), log.joint_count) == (24841, 1)
    assert 1 / log.period == pytest.approx(1000, rel=1e-4)
    assert log.tau is not None
    np.testing.assert_allclose(log.tau[:, 0], (raw["gtau"] * raw["vir"])[:, 0], rtol=1e-12)
    np.testing.assert_array_equal(log.q, raw["qm"])


@pytest.mark.parametrize(("name", "samples"), [("14harm50sec", 5375), ("push_pose_1", 1727)])
def test_ur10e_motion(real_data: Path, name: str, samples: int) -> None:
    spec = rig(t={"column": 0}, q={"column": 1}, dq={"column": 7}, tau={"column": 25})
    log = read(real_data / "ur10e-motion" / f"{name}.csv", spec, joint_names=UR)
    assert (len(log), log.joint_count) == (samples, 6)
    assert log.valid.all()
    assert 1 / log.period == pytest.approx(100, rel=0.05)
    assert log.q is not None
    assert log.dq is not None
    # the rates are the positions' rates: their sum over time is where each joint went, to the columns' last digits
    # (5e-5 rad) and the trapezoid on an irregular clock
    went = np.trapezoid(log.dq, log.t, axis=0)
    np.testing.assert_allclose(went, log.q[-1] - log.q[0], atol=0.01)


def test_leg_contact(real_data: Path) -> None:
    folder = real_data / "leg-contact" / "push_pull"
    clock = {"column": 0, "unit": "ms"}
    spec = rig(t=clock, q={"column": 1})
    log = read(folder / "dg_hopper_teststand-joint_positions.dat", spec, joint_names=("hip", "knee"))
    assert (len(log), log.joint_count) == (23391, 2)
    assert log.t[0] == pytest.approx(2068.155, abs=1e-9)  # the counter stays, for joining files on it
    force = rig(t=clock, tangential_force1={"column": 1}, tangential_force2={"column": 2}, normal_force={"column": 3})
    pushed = read(folder / "dg_hopper_teststand-ati_force.dat", force)
    assert len(pushed) == 23372
    assert np.isin(np.round(1e3 * pushed.t), np.round(1e3 * log.t)).all()
    assert pushed.contact["normal_force"].max() > 10


def test_sensor_on_a_med14(real_data: Path) -> None:
    log = read(real_data / "med14-ft-imu" / "1-baseline_wrench.csv", rig(t={"unit": "us"}))
    assert log.wrench is not None
    assert len(log) == 4376
    assert 1 / log.period == pytest.approx(698, abs=1)
    assert log.t[0] == 0.0
    assert log.provenance.steps[0].facts["time_origin"] == pytest.approx(1708857503.929545, abs=1e-6)
    with pytest.raises(InputError, match=r"no time in .* with columns 'fx'"):
        read(real_data / "med14-ft-imu" / "0-steady-state_wrench.csv", Rig())
    with pytest.raises(InputError, match=r"unit = \"us\""):
        read(real_data / "med14-ft-imu" / "1-baseline_wrench.csv", Rig())


def test_tables_without_a_time_are_refused(real_data: Path) -> None:
    for path in ("silicone-indentation/two_cycles.csv", "panda-motion/exciting_traj_positions.txt"):
        with pytest.raises(InputError, match=r"no time in .* no header"):
            read(real_data / path, Rig())
    depth = rig(t={"column": 0, "unit": "ms"}, depth={"column": 2, "unit": "mm"}, normal_force={"column": 4})
    with pytest.raises(InputError, match=r"runs backwards|repeats"):  # z is no time either
        read(real_data / "silicone-indentation" / "two_cycles.csv", depth)


# -------------------------------------------------------------------------------------------------------------- bags


def test_all_topics_of_a_ur10e(bag: Path) -> None:
    log = read(bag / "all.bag", Rig(), joint_names=UR)
    assert (len(log), log.joint_count) == (1346, 6)
    facts = log.provenance.steps[0].facts
    assert facts["topics"] == {"joints": "/joint_states", "wrench": "/wrench"}
    assert facts["joints"] == list(UR)
    assert facts["joints_ignored"] == ["left_finger_joint", "right_finger_joint"]  # the second publisher
    assert facts["clocks"] == {"wrench": "header", "joints": "header"}
    wrench, joints = (step.facts for step in log.provenance.steps[1:])
    assert (wrench["samples"], joints["samples"]) == (1346, 1320)
    assert wrench["rate"] == pytest.approx(500, abs=1)
    assert joints["rate"] == pytest.approx(500, abs=1)
    assert joints["empty"] == (~log.valid).sum() == facts["invalid_rows"] < 30
    # elbow_joint comes first in the messages: without names the recorded order, with names the robot's
    recorded = read(bag / "all.bag", Rig())
    assert recorded.provenance.steps[0].facts["joints"][:3] == [
        "elbow_joint",
        "shoulder_lift_joint",
        "shoulder_pan_joint",
    ]
    assert log.q is not None
    assert recorded.q is not None
    np.testing.assert_array_equal(log.q[:, [2, 1, 0]], recorded.q[:, :3])
    np.testing.assert_allclose(log.q[log.valid].mean(axis=0)[2], -2.07, atol=0.01)
    # the arm rests: no joint moves by a mrad, and the wrench is that of rest
    assert np.ptp(log.q[log.valid], axis=0).max() < 1e-3
    assert log.wrench is not None
    np.testing.assert_allclose(log.wrench[:, :3].mean(axis=0), [0.354, 0.513, 0.637], atol=1e-3)
    assert log.wrench[:, :3].std(axis=0).max() < 0.4


@pytest.mark.parametrize(("name", "samples", "joints"), [("traj_real_100", 2188, 1786), ("traj_real_30", 4474, 4027)])
def test_headers_without_stamps(bag: Path, name: str, samples: int, joints: int) -> None:
    log = read(bag / f"{name}.bag", Rig(), joint_names=UR)
    facts = log.provenance.steps[0].facts
    assert facts["clocks"] == {"wrench": "reception", "joints": "header"}
    assert [step.facts["samples"] for step in log.provenance.steps[1:]] == [samples, joints]
    assert len(log) == samples
    assert 0.85 < log.valid.mean() < 1
    assert log.q is not None
    assert log.dq is not None
    moving = log.q[log.valid]
    assert np.ptp(moving, axis=0).max() > 0.05
    # on the joints' own clock, positions and rates agree
    own = read(bag / f"{name}.bag", Rig.parse({"streams": {"reference": "joints"}}), joint_names=UR)
    assert own.q is not None
    assert own.dq is not None
    assert len(own) == joints
    went = np.trapezoid(own.dq, own.t, axis=0)
    np.testing.assert_allclose(went, own.q[-1] - own.q[0], atol=5e-3)


@pytest.mark.parametrize(
    ("name", "samples", "seconds"),
    [
        ("wrench_pushes", 17424, 34.98),
        ("wrench_taps", 12628, 25.38),
        ("wrench_twist", 7339, 14.73),
    ],
)
def test_a_wrench_alone(bag: Path, name: str, samples: int, seconds: float) -> None:
    log = read(bag / f"{name}.bag", Rig())
    assert (len(log), log.q) == (samples, None)
    assert log.t[-1] - log.t[0] == pytest.approx(seconds, abs=0.02)
    assert 1 / log.period == pytest.approx(500, abs=1)
    assert log.valid.all()
    with pytest.raises(InputError, match="the bag holds none"):
        read(bag / f"{name}.bag", Rig.parse({"streams": {"joints": "/joint_states"}}))


def test_a_real_bag_that_was_cut_off(bag: Path, tmp_path: Path) -> None:
    whole = (bag / "all.bag").read_bytes()
    for share in (0.0001, 0.5, 0.99):
        (tmp_path / "a.bag").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=r"can't be read as a ROS bag.*rosbag reindex"):
            read(tmp_path / "a.bag", Rig())
