"""Contact forces of a log without a wrist sensor, from its joint torques, in the frame of the surface."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.surface_frame import SurfaceFrame
from kinid.data.log import Log, Step
from kinid.data.rig import Rig, SensorSpec
from kinid.kernels import chain as kernel
from kinid.robotics.external_force import PRIOR, UNKNOWN, directions, tip_force, tip_jacobian, torque_error
from kinid.robotics.inverse_dynamics import JointTorques, joint_torques
from kinid.robotics.wrench import Reading

Array = NDArray[np.float64]

#: rows of a contact table that hold forces, in the order tangent1, tangent2, normal
FORCES = [kernel.TANGENT1, kernel.TANGENT2, kernel.NORMAL]
#: names of their directions, in this order
DIRECTIONS = ("the first tangent", "the second tangent", "the normal")
#: torques that no force at the tip makes are doubted from so many times their expected mean square on
ELSEWHERE = 4.0


@dataclass(frozen=True, eq=False)
class Felt:
    """Contact quantities whose forces come from joint torques.

    Attributes:
        table: rows as in `CONTACT`, (9, n); NaN in the row of a force that the joints don't feel at all.
        sd: standard deviations of the forces along tangent1, tangent2, normal [N], (3, n).
        step: how they were found, with what to doubt.
    """

    table: Array
    sd: Array
    step: Step


def by_torques(log: Log, rig: Rig) -> bool:
    """Whether forces come from joint torques: where those are all there is, and the rig states no wrist sensor."""
    return log.wrench is None and log.tau is not None and log.q is not None and rig.sensor == SensorSpec()


def felt_by_torques(frame: SurfaceFrame, torques: JointTorques | None = None) -> Felt:
    """Contact quantities of a log whose forces its joint torques tell.

    Args:
        frame: of a log with torques and no wrench. torques: measured and predicted ones, where the caller has better
            ones than the rig's rigid bodies give.

    Raises:
        InputError: torques that can't be predicted.
    """
    log, robot, motion = frame.log, frame.robot, frame.motion
    residual, measured = _residual(frame, torques)
    free = frame.free()
    slides = [robot.is_prismatic(name) for name in robot.joint_names]
    moved = directions(log.t, motion.dq, log.period, slides)
    error = torque_error(log.t, residual, motion.dq, moved, free, measured)
    tip = robot.kinematics(robot.tip_frame or "", motion.q)
    jacobian = tip_jacobian(robot, motion.q)
    force, sd, beside = (np.full(shape, np.nan) for shape in ((len(log), 3), (3, len(log)), len(log)))
    where = frame.surface.locate(tip.position)
    for rows in np.array_split(np.flatnonzero(_finite(residual, jacobian, error.mean)), 1 + len(log) // 20_000):
        found = tip_force(jacobian[rows], residual[rows], error.rows(rows))
        force[rows], beside[rows] = found.force, found.reduced_chi_square
        axes = where.axes[rows]
        sd[:, rows] = np.sqrt(np.einsum("nij,njk,nik->in", axes, found.covariance, axes))
    # a frame without a tool, whose weight the torques' model carries, and with the tip as its sensor
    bare = dataclasses.replace(
        frame,
        rig=frame.rig.model_copy(update={"tool": None}),
        robot=dataclasses.replace(robot, sensor_frame=robot.tip_frame),
    )
    wrench = np.zeros((len(log), 6))
    wrench[:, :3] = np.einsum("nji,nj->ni", tip.rotation, force)
    table = bare.table(Reading(wrench, np.eye(6), np.zeros(6), {}), moments=False)
    inside = np.isfinite(beside) & (where.depth > 0.0)
    excess = float(np.mean(beside[inside])) if inside.any() else 1.0
    sd *= np.sqrt(max(1.0, excess))  # Birge's ratio: what the covariance lacks in contact, it lacks along J, too
    unknown = [k for k in range(3) if not np.nanmin(sd[k], initial=PRIOR) < UNKNOWN * PRIOR]
    table[[FORCES[k] for k in unknown]] = np.nan
    return Felt(table, sd, _step(frame, sd, inside, excess, unknown, error.learnt))


def _residual(frame: SurfaceFrame, torques: JointTorques | None) -> tuple[Array, Array]:
    """Measured torques less those of the motion, and the measured ones, (n, N) each."""
    log, rig = frame.log, frame.rig
    assert log.tau is not None
    if rig.external_torques:
        return np.asarray(log.tau), np.asarray(log.tau)
    if torques is None:
        torques = joint_torques(log, rig, robot=frame.robot, motion=frame.motion)
    return torques.residual, torques.measured


def _finite(*arrays: Array) -> NDArray[np.bool_]:
    """Rows in which everything is a number, (n,)."""
    rows = [np.isfinite(array.reshape(len(array), -1).sum(axis=1)) for array in arrays]
    return np.asarray(np.logical_and.reduce(rows), dtype=np.bool_)


def _step(
    frame: SurfaceFrame, sd: Array, inside: NDArray[np.bool_], excess: float, unknown: list[int], learnt: int
) -> Step:
    """What a reader wants to know of the forces."""
    rows = inside if inside.any() else np.isfinite(sd).all(axis=0)
    typical = [float(np.median(sd[k, rows])) if rows.any() else PRIOR for k in range(3)]
    facts = {
        "from": "joint torques",
        "free_samples_used": learnt,
        "normal_force_sd_n": typical[2],
        "tangential_force_sd_n": typical[:2],
        "torques_no_tip_force_makes": excess,
    }
    tangents = " and ".join(f"{value:.2g}" for value in typical[:2])
    warnings = [
        f"forces come from joint torques, not from a sensor: the standard deviation is {typical[2]:.2g} N along the "
        f"normal, {tangents} N along the tangents, of a force at the tip without a moment"
    ]
    if unknown:
        names = " and ".join(DIRECTIONS[k] for k in unknown)
        warnings.append(f"the joints don't feel a force along {names} in any pose of the log: it is left unknown")
    if not learnt:
        warnings.append(
            "no free motion to learn the joints' friction and offsets from: 5 % of the largest joint torque are "
            'assumed of each; label rows of free motion "free" in a column phase, or let the log begin in the air'
        )
    if excess > ELSEWHERE:
        warnings.append(
            f"in contact the joint torques hold {np.sqrt(excess):.2g} times the error of free motion that no force at "
            "the tip makes: the arm touches elsewhere, or the tip takes a moment, or friction is another in contact; "
            "the standard deviations are larger by that"
        )
    return Step("forces from joint torques", facts, tuple(warnings))
