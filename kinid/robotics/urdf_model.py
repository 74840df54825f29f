"""Pinocchio models: read from a URDF, with joints locked, and what their joints and frames are."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from kinid.errors import InputError, near

Array = NDArray[np.float64]

#: no joint of an arm is further from the one before it [m]: a URDF that says so is in millimetres
LONGEST_LINK = 20.0


def parsed(path: Path) -> pin.Model:
    """Pinocchio's model of a URDF; what its parser writes to the process's error stream goes into the message."""
    with off_screen() as said:
        try:
            return pin.buildModelFromUrdf(str(path))
        except (ValueError, RuntimeError) as error:
            said.seek(0)
            lines = [line.split("]")[-1].strip() for line in said.read().decode(errors="replace").splitlines()]
            cause = "; ".join(dict.fromkeys(line for line in (*lines, str(error)) if line))[:300]
            raise InputError(
                f"{path}, which Pinocchio can't read ({cause})", "a URDF of one arm", "correct it there"
            ) from None


def refuse_millimetres(model: pin.Model, path: Path) -> None:
    """Refuse links longer than any arm's; where the first joint stands in the world is another matter."""
    for j in range(2, model.njoints):
        length = float(np.linalg.norm(model.jointPlacements[j].translation))
        if model.parents[j] > 0 and length > LONGEST_LINK:
            raise InputError(
                f"{length:.4g} m from joint '{model.names[model.parents[j]]}' to '{model.names[j]}' in {path}",
                f"links in metres, of {LONGEST_LINK:g} m at most",
                "divide the xyz of its origins by 1000, if it is in millimetres",
            )


@contextmanager
def off_screen() -> Iterator[IO[bytes]]:
    """What the process, its C++ libraries too, writes to its error stream meanwhile, in a file instead."""
    with _scratch() as said:
        sys.stderr.flush()
        kept = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _scratch() -> IO[bytes]:
    """A file without a name, in memory where the system has such: a full disk must not keep a robot from being read."""
    return os.fdopen(os.memfd_create("parser"), "w+b") if hasattr(os, "memfd_create") else tempfile.TemporaryFile()


def lock(model: pin.Model, joints: list[int]) -> pin.Model:
    """The model with joints locked at neutral.

    Pinocchio looks frames up by their names alone there, so a joint that shares its name with a link has another one
    for the time.
    """
    suffix = " (joint)"
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type != pin.FrameType.BODY and frame.name in links:
            frame.name += suffix
    for j in range(1, model.njoints):
        if model.names[j] in links:
            model.names[j] += suffix
    reduced = pin.buildReducedModel(model, joints, pin.neutral(model))
    for j in range(1, reduced.njoints):
        reduced.names[j] = reduced.names[j].removesuffix(suffix)
    return reduced


def find_frame(model: pin.Model, name: str, robot: str) -> pin.Frame:
    """Frame of that name; where a link and a joint share it, the link's."""
    same = [frame for frame in model.frames if frame.name == name]
    if not same:
        raise InputError(f"frame '{name}'", f"a frame of {robot}", near(name, [f.name for f in model.frames]))
    return next((frame for frame in same if frame.type == pin.FrameType.BODY), same[0])


def names_to(model: pin.Model, joint: int) -> list[str]:
    """Names of the joints from the base to one of them."""
    return [model.names[j] for j in model.supports[joint] if j > 0]


def joint_axis(model: pin.Model, j: int) -> tuple[Array, bool]:
    """Axis of a one-axis joint in its own frame, and whether it slides; read off the joint's motion at one unit."""
    joint = model.joints[j]
    data = joint.createData()
    unit = np.array([np.cos(1.0), np.sin(1.0)]) if joint.nq == 2 else np.array([1.0])
    # calc reads the joint's slice of a whole configuration
    configuration = pin.neutral(model)
    configuration[joint.idx_q : joint.idx_q + joint.nq] = unit
    joint.calc(data, configuration)
    motion = data.M
    slides = bool(np.linalg.norm(motion.translation) > 0.5)
    axis = np.asarray(motion.translation if slides else pin.log3(motion.rotation))
    nearest = np.round(axis)
    # axes along a coordinate are made exact, so that the chain holds no rounding of the logarithm
    return (nearest if np.abs(axis - nearest).max() < 1e-12 else axis / np.linalg.norm(axis)), slides


def z_onto(axis: Array) -> Array:
    """A rotation whose third column is the axis, (3, 3), read-only."""
    return _z_onto(*axis.tolist())


@cache  # an arm has few axes, and asks for them at each log
def _z_onto(*along: float) -> Array:
    axis = np.array(along)
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = helper - (helper @ axis) * axis
    x /= np.linalg.norm(x)
    out = np.stack([x, np.cross(axis, x), axis], axis=1)
    out.flags.writeable = False
    return out
