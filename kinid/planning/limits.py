"""What the robot's joints may do: positions, velocities, accelerations, jerks and torques."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: kept from the URDF's position limits [rad or m]: controllers stop the arm a degree before them
MARGIN = float(np.radians(1.0))
#: where a URDF states none, which is usual: the LWR4's own acceleration [rad/s²]; and a jerk [rad/s³] that reaches it
#: in 4 ms
ACCELERATION, JERK = 4.0, 1000.0
#: slower than this no motion comes to an end [rad/s², rad/s³]
SLOWEST = {"acceleration": 1e-3, "jerk": 1e-2}


@dataclass(frozen=True, eq=False)
class Limits:
    """Per joint in the log's order, (N,); infinite where there is none.

    Attributes:
        names: of the joints. lower, upper: positions, the margin taken off [rad or m].
        velocity [rad/s], acceleration [rad/s²], jerk [rad/s³], torque [N·m]: sizes.
        stated: which of acceleration and jerk the URDF states; the others are defaults.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array
    stated: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "jerk", "torque"):
            values = getattr(self, name)
            if not (values > 0).all():
                raise InputError(f"limits of {name} with {values.min():g} among them", "positive limits", "correct it")
            if values.min() < SLOWEST.get(name, 0.0):
                raise InputError(
                    f"limits of {name} with {values.min():g} among them",
                    f"{SLOWEST[name]:g} {'rad/s²' if name == 'acceleration' else 'rad/s³'} or more",
                    "correct it: no motion would come to an end",
                )
        if not (self.lower < self.upper).all():
            j = int(np.flatnonzero(self.lower >= self.upper)[0])
            raise InputError(
                f"{self.names[j]} with limits {self.lower[j]:g} … {self.upper[j]:g} after the margin",
                "a range to move in",
                "choose a smaller margin",
            )

    @classmethod
    def of(
        cls,
        robot: Robot,
        urdf: Path | None = None,
        *,
        margin: float = MARGIN,
        acceleration: float | None = None,
        jerk: float | None = None,
    ) -> Limits:
        """Those of a robot's URDF.

        Args:
            robot: whose. urdf: its file, which may state `acceleration` and `jerk` in its `<limit>` elements.
            margin: kept from position limits [rad or m]. acceleration, jerk: for all joints instead of stated or
                default ones.
        """
        n, velocity, torque = robot.joint_count, robot.velocity_limit, robot.effort_limit
        stated = _stated(urdf, robot.joint_names) if urdf is not None else {}
        rates = {}
        for name, given, default in (("acceleration", acceleration, ACCELERATION), ("jerk", jerk, JERK)):
            rates[name] = np.array(
                [given if given is not None else stated.get((joint, name), default) for joint in robot.joint_names]
            )
        names = tuple(
            name
            for name, given in (("acceleration", acceleration), ("jerk", jerk))
            if given is None and any(key[1] == name for key in stated)
        )
        return cls(
            robot.joint_names,
            robot.lower + margin,
            robot.upper - margin,
            # a URDF without a figure reads as zero or infinity
            np.where(velocity > 0, velocity, np.inf),
            rates["acceleration"],
            rates["jerk"],
            np.where(torque > 0, torque, np.inf) if n else torque,
            names,
        )

    def replace(self, **changes: Array) -> Limits:
        """The same with others."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def _stated(urdf: Path, joints: tuple[str, ...]) -> dict[tuple[str, str], float]:
    """Accelerations and jerks in a URDF's `<limit>` elements, by joint and name."""
    import kinid.urdf

    kinid.urdf.check(urdf)
    found = {}
    for joint in ElementTree.parse(urdf).iter("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("name") not in joints:
            continue
        for name in ("acceleration", "jerk"):
            try:
                value = float(limit.get(name, ""))
            except ValueError:
                continue
            if value > 0:
                found[str(joint.get("name")), name] = value
    return found
