"""Joints as effects see them: names, units, and which way each one last moved."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from kinid.effects._derived import derived
from kinid.effects._signals import Array, Layout, Signals
from kinid.kernels.memory import JOINT_BRISTLES, joint_directions

#: length of the bristles of a joint's dry friction, by its unit
BRISTLE = dict(zip(("rad", "m"), JOINT_BRISTLES))


@dataclass(frozen=True)
class Axis:
    """One joint: `suffix` of its parameters' names, unit of its `torque`, unit of its `position`, size of a torque."""

    suffix: str
    torque: str
    position: str
    size: float

    def per(self, time: str = "") -> str:
        """Unit of a torque for each unit of a rate: "·s" of a velocity, "·s²" of an acceleration."""
        return f"{self.torque}{time}/{self.position}"


@functools.cache
def axes(layout: Layout) -> tuple[Axis, ...]:
    """The joints of a layout; none unless it is one of joint torques. A single axis without a robot needs no name."""
    if layout.kind != "joints":
        return ()
    names = layout.joints or layout.channels
    suffixes = [""] if len(names) == 1 and not layout.joints else [f"[{name}]" for name in names]
    slides = [unit == "N" for unit in layout.units]
    return tuple(
        Axis(suffix, "N", "m", 10.0) if slide else Axis(suffix, "N·m", "rad", 1.0)
        for suffix, slide in zip(suffixes, slides)
    )


def usual_offset(parameter: str) -> float:
    """What sensors of some 100 N·m in an arm's joints are off by [N·m]; 0 for a drive, whose range isn't known."""
    return 0.05 if "[" in parameter else 0.0


def directions(s: Signals) -> Array:
    """Which way each joint last moved, from −1 to 1, (N, n), in the form of `s.rest`: bristles, or speed."""
    motion, rest = s.joints, s.rest
    assert motion is not None

    def make() -> Array:
        if rest.joint_speed > 0.0:
            return np.asarray(motion.dq / np.hypot(motion.dq, rest.joint_speed))
        return joint_directions(motion.dq, s.dt, [rest.joint * BRISTLE[axis.position] for axis in axes(s.layout)])

    return derived("directions", make, motion.dq, s.dt, at=(rest.joint, rest.joint_speed))
