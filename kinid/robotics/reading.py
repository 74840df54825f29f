"""A log as users read it: with the joints in the order of the rig's robot."""

from __future__ import annotations

from pathlib import Path

from kinid.data import readers
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import expect
from kinid.robotics.robot import Robot


def read(path: str | Path, rig: Rig | None = None, *, robot: Robot | None = None) -> Log:
    """Read a log of any known format onto one clock, in SI units; joints follow the names of the rig's robot.

    Args:
        path: Parquet, CSV and other text tables, NPZ, MATLAB, MCAP, a ROS 1 bag, or a ROS 2 bag.
        rig: names columns, units, topics and the robot; default: `rig.toml` beside the log, else an empty rig.
        robot: the rig's robot, where the caller has it already.

    Raises:
        InputError: a file, a rig or a robot that can't be used.
    """
    expect(path, (str, Path), "a log", "the path of a log", "name the file")
    if rig is not None:
        expect(rig, Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")
    beside = Path(path).parent / "rig.toml"
    if rig is None and beside.is_file():
        rig = Rig.load(beside)
    if robot is None and rig is not None and rig.robot is not None:
        robot = Robot.load(rig)
    return readers.read(path, rig, joint_names=robot.joint_names if robot is not None else None)
