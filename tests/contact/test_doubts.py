"""What `contact` doubts of a log with joints, each named with the field that is really wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scripted import scripted_poke

from kinid.contact.analysis import analyse
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Rig, Robot]:
    """A poke whose free motion turns the wrist by half a radian about two axes, as a log of several poses does."""
    path = scripted_poke(seed=5).write(tmp_path_factory.mktemp("doubts"))
    rig = Rig.load(path.parent / "rig.toml")
    robot = Robot.load(rig)
    log = read(path, rig, robot=robot)
    assert log.q is not None
    assert log.wrench is not None
    turns = np.repeat(log.q[:1], 2000, axis=0)
    t = np.arange(2000) * log.period
    q = turns.copy()
    q[:, 5] += 0.5 * np.sin(2 * np.pi * t / 2.0) ** 3
    q[:, 4] += 0.5 * np.sin(2 * np.pi * t / 4.0) ** 3
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    assert rig.tool is not None
    assert robot.sensor_frame is not None
    load = tool_load(rig.tool, robot.kinematics(robot.sensor_frame, q, dq, ddq), robot.gravity)
    bias = np.median(log.wrench[:200], axis=0) - load[0]
    noise = np.random.default_rng(0).normal(scale=0.015, size=load.shape) * [1, 1, 2, 0.03, 0.04, 0.02]
    return (
        Log(
            t=np.concatenate([t, log.t - log.t[0] + t[-1] + log.period]),
            q=np.concatenate([q, log.q]),
            wrench=np.concatenate([load + bias + noise, log.wrench]),
        ),
        rig,
        robot,
    )


def doubts(log: Log, rig: Rig, robot: Robot, **options: object) -> str:
    return " | ".join(analyse(log, rig, robot=robot, trust_wrench=True, **options).provenance.warnings)  # type: ignore[arg-type]


def changed(rig: Rig, **tables: dict[str, object]) -> Rig:
    whole = rig.model_dump(exclude_none=True)
    for name, fields in tables.items():
        whole[name] = {**whole[name], **fields}
    return Rig.parse({k: v for k, v in whole.items() if k != "folder"}, folder=rig.folder)


def test_a_good_log_is_not_doubted(touched: tuple[Log, Rig, Robot]) -> None:
    assert doubts(*touched) == ""


def test_a_tool_of_another_mass(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    said = doubts(log, changed(rig, tool={"mass": 0.5}), robot)
    assert "correct [tool] mass" in said
    # the true one, 0.24 kg, within its error
    assert "reads a tool of 0.2" in said


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mN"), (1 / 9.80665, "kgf")])
def test_a_wrench_in_another_unit(touched: tuple[Log, Rig, Robot], factor: float, unit: str) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    rig = changed(rig, sensor={"range": (1e6,) * 6})
    said = doubts(dataclasses.replace(log, wrench=factor * np.asarray(log.wrench)), rig, robot)
    assert f'wrench = {{ unit = "{unit}" }}' in said


@pytest.mark.parametrize(
    ("axes", "signs", "words"), [((1, 0, 2), (1, 1, 1), "left-handed"), ((0, 1, 2), (-1, -1, 1), "fx is −fx")]
)
def test_axes_that_are_exchanged_or_turned(
    touched: tuple[Log, Rig, Robot], axes: tuple[int, ...], signs: tuple[int, ...], words: str
) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    wrench = np.array(log.wrench)
    wrench[:, :3] = wrench[:, axes] * signs
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert "gravity in free motion is explained" in said
    assert words in said


def test_a_reading_beyond_the_sensors_range(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert "fz reaches" in doubts(log, changed(rig, sensor={"range": (40, 40, 1.0, 2, 2, 2)}), robot)


def test_a_surface_metres_away(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert "check [surface] point" in doubts(log, changed(rig, surface={"point": (0.55, 0.0, 1.1)}), robot)


def test_joints_beyond_their_limits(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.q is not None
    q = np.array(log.q)
    q[:, 3] += 2.5
    assert "joint_4 from" in doubts(dataclasses.replace(log, q=q), rig, robot)


def test_time_in_milliseconds(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert 't = { unit = "ms" }' in doubts(dataclasses.replace(log, t=1e3 * np.asarray(log.t)), rig, robot)
