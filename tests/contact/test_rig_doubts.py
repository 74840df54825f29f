"""What `contact` doubts of a rig whose parts, or whose readings, contradict each other."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from contact.doubting import changed, doubts

import kinid.urdf
from kinid.contact.rig_doubts import rig_doubts
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot

NOISE, RANGE = [0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003], [40, 40, 120, 2, 2, 2]


@pytest.mark.parametrize(("tangent", "says"), [([1.0, 0.0, 1.0], "45° out of the plane"), ([1.0, 0.0, 0.1], "")])
def test_a_tangent_out_of_the_plane(touched: tuple[Log, Rig, Robot], tangent: list[float], says: str) -> None:
    log, rig, robot = touched
    said = doubts(log, changed(rig, surface={"tangent": tangent}), robot)
    assert says in said
    assert bool(says) == bool(said)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"noise": NOISE}, ""),
        ({"noise": [10 * x for x in NOISE]}, ""),  # readings may be filtered
        ({"noise": [0.1 * x for x in NOISE]}, "from sample to sample"),
        ({"noise": [0.0] * 6}, "from sample to sample"),
        ({"noise": NOISE[3:] + NOISE[:3]}, "forces come first"),
        ({"range": RANGE[3:] + RANGE[:3]}, "forces come first"),
    ],
)
def test_noise_and_range_that_the_readings_or_each_other_contradict(
    touched: tuple[Log, Rig, Robot], fields: dict[str, object], says: str
) -> None:
    log, rig, robot = touched
    said = doubts(log, changed(rig, sensor=fields), robot)
    assert says in said
    assert bool(says) == bool(said)


def test_a_joint_that_jumps_and_returns_at_once(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    q = np.array(log.q)
    q[[500, 2600], 1] += 0.3
    assert "q2 jumps by 0.3 and returns at once (2 samples" in doubts(dataclasses.replace(log, q=q), rig, robot)


@pytest.mark.parametrize(("effort", "says"), [(5.0, "its URDF allows an effort of 5"), (0.0, ""), (200.0, "")])
def test_torques_beyond_what_the_urdf_allows(
    touched: tuple[Log, Rig, Robot], tmp_path: Path, effort: float, says: str
) -> None:
    log, rig, _ = touched
    text = (Path(kinid.urdf.__file__).parent / "lwr4plus.urdf").read_text()
    name = tmp_path / "arm.urdf"
    name.write_text(re.sub(r'effort="[0-9.]+"', f'effort="{effort}"', text))
    own = changed(rig, robot={"model": str(name), "sensor_frame": "ft_sensor", "tip_frame": "tool_tip"})
    torque = np.zeros_like(np.asarray(log.q))
    torque[:, 1] = 30.0 + np.sin(log.t)
    said = " | ".join(rig_doubts(dataclasses.replace(log, tau=torque), own, Robot.load(own)))
    assert says in said
    assert bool(says) == bool(said)


def test_limits_in_degrees(touched: tuple[Log, Rig, Robot], tmp_path: Path) -> None:
    log, rig, _ = touched
    text = (Path(kinid.urdf.__file__).parent / "lwr4plus.urdf").read_text()
    found = next(line for line in text.splitlines() if "<limit" in line)
    for limit in ('lower="-170" upper="170"', 'lower="-1e308" upper="1e308"'):
        wide = found[: found.index("<limit")] + f'<limit {limit} effort="200" velocity="2"/>'
        (tmp_path / "wide.urdf").write_text(text.replace(found, wide, 1))
        wrong = changed(rig, robot={"model": str(tmp_path / "wide.urdf")})
        assert "limits there are in radians" in doubts(log, wrong, Robot.load(wrong))
