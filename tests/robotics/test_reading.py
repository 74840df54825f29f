"""`kinid.read` in Python: joints in the robot's order, whatever order a bag lists them in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinid


@pytest.mark.real
def test_joints_of_a_bag_follow_the_robot_and_not_the_message(real_data: Path) -> None:
    rig = kinid.Rig.parse({"robot": {"model": "ur10", "sensor_frame": "tool0", "tip_frame": "tool0"}})
    log = kinid.read(real_data / "ur10e-bags" / "all.bag", rig)
    named = kinid.Robot.load(rig).joint_names
    assert named[0].endswith("shoulder_pan_joint")
    # the message lists the elbow first; asked for in that order, the columns are the same ones turned round
    elbow_first = ("elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint", *named[3:])
    as_listed = kinid.read(
        real_data / "ur10e-bags" / "all.bag",
        kinid.Rig.parse(
            {"robot": {"model": "ur10", "sensor_frame": "tool0", "tip_frame": "tool0", "joints": list(elbow_first)}}
        ),
    )
    assert log.q is not None
    assert as_listed.q is not None
    np.testing.assert_array_equal(log.q[:, [2, 1, 0]], as_listed.q[:, :3])
    assert not np.array_equal(log.q[:, 0], log.q[:, 2])
