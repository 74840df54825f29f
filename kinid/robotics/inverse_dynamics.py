"""Inverse dynamics of the rig's robot against its measured joint torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log, Provenance, frozen
from kinid.data.rig import Rig
from kinid.errors import InputError, expect
from kinid.robotics.body_tree import BodyTree
from kinid.robotics.motion import JointMotion, joint_motion
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import Bias, read_wrench
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JointTorques:
    """Measured and predicted joint torques, link side [N·m, or N for a joint that slides], in the log's order.

    Attributes:
        t: [s], (n,). measured, predicted: (n, N). joint_names: (N,).
        valid: samples that both could be had for, (n,).
    """

    t: Array
    measured: Array
    predicted: Array
    joint_names: tuple[str, ...]
    valid: NDArray[np.bool_]
    provenance: Provenance

    def __post_init__(self) -> None:
        for name in ("measured", "predicted"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def residual(self) -> Array:
        """Measured less predicted, (n, N)."""
        out: Array = self.measured - self.predicted
        return out

    @property
    def rms(self) -> Array:
        """Root mean square of the residual per joint, (N,)."""
        return _rms(self.residual[self.valid])

    @property
    def measured_rms(self) -> Array:
        """Root mean square of the measured torque per joint, (N,)."""
        return _rms(self.measured[self.valid])


def joint_torques(
    log: Log,
    rig: Rig,
    *,
    robot: Robot | None = None,
    bias: Bias = "auto",
    differentiator: Differentiator | None = None,
    motion: JointMotion | None = None,
) -> JointTorques:
    """Predict joint torques by inverse dynamics and set them beside the measured ones.

    With a wrench in the log, everything beyond the sensor is what the sensor says: τ = ID(arm) − Jᵀ w, with w the load
    on the tool at the sensor's origin. Without one, the rig's tool is added to the arm, and there is no contact.

    `motion` is the log's, where the caller has it already.

    Raises:
        InputError: no torques or positions in the log, external torques, or no valid sample.
    """
    expect(log, Log, "a log", "a log that was read", "read it with kinid.read(path, rig)")
    expect(rig, Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")
    if log.tau is None:
        raise InputError(
            f"no joint torques in {log.provenance.source}",
            "tau1…tauN [N·m], link side",
            "name their columns in [columns] of the rig",
        )
    refuse_external(rig)
    robot = robot or Robot.load(rig)
    motion = motion or joint_motion(log, robot, differentiator)
    provenance = log.provenance.then("inverse dynamics", robot=robot.name).after(*motion.steps)
    carried = None
    if log.wrench is not None and robot.sensor_frame is not None:
        free = log.labelled_free
        reading = read_wrench(log, rig, robot, motion, free, bias, trust=True)
        carried = reading.true()
        provenance = provenance.then("wrench", **reading.facts)
    elif rig.tool is not None:
        robot = robot.with_tool(rig.tool)
    usable = log.valid & np.isfinite(motion.dq.sum(axis=1)) & np.isfinite(motion.ddq.sum(axis=1))
    if not usable.any():
        raise InputError(f"no valid sample in {log.provenance.source}", "finite positions and torques", "check the log")
    predicted = np.full(log.tau.shape, np.nan)
    rows = np.flatnonzero(usable)
    predicted[rows] = inverse_dynamics(
        robot, motion.q[rows], motion.dq[rows], motion.ddq[rows], None if carried is None else carried[rows]
    )
    return JointTorques(log.t, log.tau, predicted, robot.joint_names, usable, provenance)


def refuse_external(rig: Rig) -> None:
    """Refuse torques that the arm's own model is taken off already, where a model is to be held against them."""
    if rig.external_torques:
        raise InputError(
            '[robot] torques = "external" for inverse dynamics',
            "measured joint torques, with the arm's own weight and inertia in them",
            "record them, or ask for the contact alone: kinid contact LOG",
        )


def inverse_dynamics(robot: Robot, q: Array, dq: Array, ddq: Array, carried: Array | None = None) -> Array:
    """Joint torques of rigid-body inverse dynamics (recursive Newton-Euler), (n, N) in the log's order.

    Args:
        robot: the arm.
        q: joint positions, with `dq`, `ddq`: (n, N).
        carried: load on what lies beyond the sensor frame, in its axes about its origin [N, N·m], (n, 6).
    """
    return BodyTree.of(robot).torques(q, dq, ddq, carried, robot.sensor_frame or "")


def _rms(values: Array) -> Array:
    out: Array = np.sqrt(np.mean(values**2, axis=0))
    return out
