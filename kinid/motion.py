"""Joint motion that is complete (positions, velocities, accelerations) and the tip's motion that follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.derivative import Differentiator
from kinid.errors import InputError
from kinid.log import Log
from kinid.robot import Robot

Array = NDArray[np.float64]

#: a log slower than this holds single poses: the arm stood still at each of them [s]
STATIC_PERIOD = 0.1
#: positions within this are no degrees, or too few to tell [rad]
MORE_THAN_A_TURN = 2 * np.pi + 0.1


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint positions with both derivatives, (n, N) each, in the log's order; `facts` says where they came from."""

    q: Array
    dq: Array
    ddq: Array
    facts: dict[str, Any]


def joint_motion(log: Log, robot: Robot, differentiator: Differentiator | None = None) -> JointMotion:
    """Positions of a log with the derivatives that it holds, and those it lacks from the differentiator.

    A log with a row only every 0.1 s or more, and no velocities of its own, is taken as a set of poses at rest.

    Raises:
        InputError: no joints, a count that isn't the robot's, or positions that look like degrees.
    """
    where = log.provenance.source
    if log.q is None:
        raise InputError(f"no joint positions in {where}", "q1…qN [rad]", "name their columns in [columns] of the rig")
    if log.q.shape[1] != robot.joint_count:
        raise InputError(
            f"{log.q.shape[1]} joints in {where}",
            f"{robot.joint_count} for {robot.name} ({', '.join(robot.joint_names)})",
            "list the log's joints in [robot] joints, or name the columns in [columns]")  # fmt: skip
    _refuse_degrees(log.q, robot, where)
    differentiator = differentiator or Differentiator()
    facts: dict[str, Any] = {}
    if log.dq is not None:
        dq, ddq = log.dq, log.ddq
        if ddq is None:
            made = differentiator(log.t, dq, log.pieces)
            ddq = made.first
            facts = {"accelerations": "derivative of the logged velocities", "bandwidth_hz": made.bandwidth,
                     "window_samples": made.window}  # fmt: skip
        return JointMotion(log.q, dq, ddq, facts)
    if log.period >= STATIC_PERIOD:
        still = np.zeros_like(log.q)
        return JointMotion(log.q, still, still, {"velocities": "zero: the log holds poses at rest"})
    made = differentiator(log.t, log.q, log.pieces)
    facts = {"velocities": "derivative of the logged positions", "accelerations": "second derivative",
             "bandwidth_hz": made.bandwidth, "window_samples": made.window}  # fmt: skip
    ddq = made.second
    if log.ddq is not None:
        ddq, facts["accelerations"] = log.ddq, "logged"
    return JointMotion(log.q, made.first, ddq, facts)


def _refuse_degrees(q: Array, robot: Robot, where: str) -> None:
    """Positions far beyond the limits of a joint that would fit them as degrees are degrees; only limits can tell."""
    if max(np.fmax.reduce(q, axis=None), -np.fmin.reduce(q, axis=None)) <= MORE_THAN_A_TURN:
        return
    largest = np.maximum(np.fmax.reduce(q, axis=0), -np.fmin.reduce(q, axis=0))  # these two pass over NaN
    if not np.isfinite(largest).all():
        largest = np.nanmax(np.where(np.isfinite(q), np.abs(q), np.nan), axis=0, initial=0.0)
    reach = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    limited = np.isfinite(reach) & ~np.array([robot.is_prismatic(name) for name in robot.joint_names])
    beyond = limited & (largest > np.maximum(1.5 * reach, MORE_THAN_A_TURN))
    if beyond.any() and (np.deg2rad(largest[limited]) <= 1.1 * reach[limited]).all():
        j = int(np.flatnonzero(beyond)[0])
        raise InputError(
            f"q{j + 1} up to {largest[j]:.4g} in {where}, beyond {reach[j]:.4g} rad and plausible in degrees",
            "joint positions in radians",
            'say so in the rig: [columns] q = {unit = "deg"} (for each of q1…qN where they differ)')  # fmt: skip


@dataclass(frozen=True, eq=False)
class TipMotion:
    """What there is without a surface: where the tip went, and with which force it was pushed, in base axes.

    Attributes:
        t: [s], (n,). position [m], velocity [m/s]: (n, 3).
        force: what pushes the tool at the tip once the tool's own load is taken away [N], (n, 3); None without a wrench.
    """

    t: Array
    position: Array
    velocity: Array
    force: Array | None

    def columns(self) -> dict[str, Array]:
        """Columns for a table."""
        out = {"t": self.t}
        for name, values in (("tip", self.position), ("tip_v", self.velocity), ("force_", self.force)):
            if values is not None:
                out |= {f"{name}{'_' if name == 'tip' else ''}{axis}": values[:, i] for i, axis in enumerate("xyz")}
        return out
