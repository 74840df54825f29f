"""Log and rig to contact-frame quantities: depth, slip and forces in the frame of the surface.

A `ContactSeries` is the proof that the kinematics ran: whoever holds one holds quantities in SI units, in the contact
frame, from which the tool's weight and inertia and the sensor's known faults have been removed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinid.contact.surface_frame import SurfaceFrame
from kinid.contact.torque_contact import FORCES, by_torques, felt_by_torques
from kinid.contact.touching import touching
from kinid.data.log import Log, Mask, Provenance, Step, frozen, frozen_as
from kinid.data.rig import CONTACT, Rig
from kinid.errors import InputError, expect
from kinid.kernels import chain as kernel
from kinid.robotics.inverse_dynamics import JointTorques
from kinid.robotics.motion import TipMotion, joint_motion, own_motion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load as load_surface
from kinid.robotics.wrench import Bias, read_wrench, tool_load
from kinid.shown import Shown
from kinid.signal import Smoothed, contradictions
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactSeries(Shown):
    """Contact-frame quantities, read-only arrays of one length.

    Attributes:
        t: time [s].
        depth: [m], > 0 inside the material, along −normal; `depth_rate` [m/s].
        slip1, slip2: [m], along tangent and normal × tangent, from the surface's point; `slip_rate1`, `slip_rate2`
        [m/s].
        normal_force: [N], ≥ 0 when the material pushes the tool out.
        tangential_force1, tangential_force2: [N], force of the material on the tool along the tangents.
        in_contact: whether the tool touches (with hysteresis).
        phase: names of the protocol's phases, or None.
        valid: False where the log's sample could not be used; the quantities there are NaN.
        moment: moment of the material on the tool about the tip [N·m], rows tangent1, tangent2, normal, (3, n); or
            None.
        force_sd: standard deviations of tangential_force1, tangential_force2 and normal_force [N], (3, n), where they
            come from joint torques; None where they were measured at the wrist.
        smoothed: whether the motion is an estimate, whose error is known.
        bias: of the sensor, as it was removed [N, N·m], (6,); None without a wrench.
        provenance: source and processing steps.
        source: the log and the rig that they were worked out from, for who needs the whole wrench; or None.

    What a log can't tell (slip of a material tester, forces without a sensor) is NaN throughout.
    """

    t: Array
    depth: Array
    depth_rate: Array
    slip1: Array
    slip2: Array
    slip_rate1: Array
    slip_rate2: Array
    normal_force: Array
    tangential_force1: Array
    tangential_force2: Array
    in_contact: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    phase: NDArray[np.str_] | None = None
    moment: Array | None = None
    force_sd: Array | None = None
    smoothed: bool = False
    bias: Array | None = None
    provenance: Provenance = Provenance("memory")
    source: tuple[Log, Rig] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("t", *CONTACT):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if getattr(self, name).shape != self.t.shape:
                raise InputError(
                    f"{name} of shape {getattr(self, name).shape}", f"{self.t.shape}, like t", "align them"
                )
        for name in ("in_contact", "valid"):
            object.__setattr__(self, name, frozen_as(np.bool_, getattr(self, name)))

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return (
            f"<ContactSeries of {len(self)} samples over {self.t[-1] - self.t[0]:.4g} s, "
            f"{100 * np.mean(self.in_contact):.3g} % of them in contact; {self.provenance.source}>"
        )

    def notes(self) -> tuple[str, ...]:
        """What to doubt."""
        return tuple(f"doubt: {warning}" for warning in self.warnings)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the log's own quantities contradict each other, a sentence each."""
        return self.provenance.warnings

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """The columns of a contact table, by name."""
        out: dict[str, NDArray[np.generic]] = {"t": self.t}
        out |= {name: getattr(self, name) for name in CONTACT}
        if self.force_sd is not None:
            out |= {f"{CONTACT[row]}_sd": sd for row, sd in zip(FORCES, self.force_sd)}
        out["in_contact"] = self.in_contact
        if self.phase is not None:
            out["phase"] = self.phase
        return out


def contact_series(
    log: Log,
    rig: Rig,
    *,
    robot: Robot | None = None,
    bias: Bias = "auto",
    differentiator: Differentiator | None = None,
    moments: bool = False,
    trust_wrench: bool = False,
    torques: JointTorques | None = None,
) -> ContactSeries:
    """Contact-frame quantities of a log.

    Where the log has no wrench, and the rig no [sensor], forces come from joint torques, if there are any.

    Args:
        log: raw samples; with joints, or with contact quantities of its own.
        rig: what was measured with what; needs a `[surface]` for a log with joints.
        robot: the rig's robot, where the caller has it already.
        bias: of the sensor: "auto" (the rig's, else the median of free motion), "none", or six numbers [N, N·m].
        differentiator: instead of the smoother, for the velocities and accelerations that the log lacks.
        moments: compute the moment about the tip as well.
        trust_wrench: don't ask whether gravity contradicts the wrench's sign and axes.
        torques: measured and predicted joint torques for forces from them, where the caller has better predictions than
            the rig's rigid bodies.

    Raises:
        InputError: no surface, no joints, or input that contradicts itself.
    """
    _expect(log, rig)
    if log.q is None and log.contact:
        return _own_quantities(log, rig, differentiator)
    surface = load_surface(rig)
    if surface is None:
        raise InputError(
            "a rig without [surface]",
            "the surface that depth and slip are measured from",
            "add [surface] point and normal, or let touches find it: kinid contact LOG --find-surface",
        )
    robot = robot or Robot.load(rig)
    _need_tip(robot)
    motion = joint_motion(log, robot, differentiator)
    frame = SurfaceFrame(log, rig, robot, motion, surface, differentiator or Differentiator())
    reading, felt = None, felt_by_torques(frame, torques) if by_torques(log, rig) else None
    if log.wrench is not None:
        reading = read_wrench(log, rig, robot, motion, frame.free(), bias, trust_wrench)
    table = frame.table(reading, moments) if felt is None else felt.table
    steps, smoothed = motion.steps, motion.smoothed is not None
    del motion, frame  # the derivatives are twice as large as the positions
    known = [k for k in range(len(CONTACT)) if k < 6 or np.isfinite(table[k]).any()]  # of forces, those that there are
    valid = log.valid & np.isfinite(table[known].sum(axis=0))
    if not valid.any():
        raise InputError(
            f"not one sample of {log.provenance.source} in which everything is a number",
            "finite joint positions, and wrench where there is one",
            "check its columns",
        )
    facts = {"samples": len(log), "invalid_samples": int((~valid).sum()), "gaps": max(0, len(log.pieces) - 1)}
    provenance = log.provenance.then("contact frame", robot=robot.name, **facts)
    if surface.notes:
        provenance = provenance.then("surface", notes=list(surface.notes))
    provenance = provenance.after(*steps)
    if reading is not None:
        provenance = provenance.then("wrench", tool=_removed(rig), **reading.facts)
    if felt is not None:
        made = _series(log, rig, table, valid, provenance.after(felt.step), smoothed, forces=kernel.NORMAL in known)
        return replace(made, force_sd=felt.sd)
    made = _series(log, rig, table, valid, provenance, smoothed, forces=reading is not None)
    if reading is None:
        return made
    return replace(made, bias=reading.bias, moment=table[kernel.MOMENT1 :] if moments else None)


def _removed(rig: Rig) -> str:
    """What was taken off for the tool, in words: a mass without a com says nothing of moments."""
    if rig.tool is None:
        return "none in the rig"
    unknown = rig.tool.mass > 0.0 and "com" not in rig.tool.model_fields_set
    return "removed, its com taken for the sensor's origin ([tool] states none)" if unknown else "removed"


def _series(
    log: Log, rig: Rig, table: Array, valid: Mask, provenance: Provenance, smoothed: bool, forces: bool
) -> ContactSeries:
    """A contact table with its flag; what isn't valid becomes NaN in it."""
    table[:, ~valid] = np.nan
    flag, step = touching(table, log, rig, forces, valid)
    return ContactSeries(
        t=log.t,
        in_contact=flag,
        valid=valid,
        phase=log.phase,
        smoothed=smoothed,
        provenance=provenance.after(step),
        source=(log, rig),
        **dict(zip(CONTACT, table)),
    )


def _expect(log: object, rig: object) -> None:
    expect(log, Log, "a log", "a log that was read", "read it with kinid.read(path, rig)")
    expect(rig, Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")


def tip_motion(
    log: Log,
    rig: Rig,
    *,
    robot: Robot | None = None,
    bias: Bias = "auto",
    differentiator: Differentiator | None = None,
    trust_wrench: bool = False,
    free: NDArray[np.int64] | None = None,
) -> TipMotion:
    """Where the tip went and what pushed it, in base axes: all there is without a surface.

    Args:
        free: rows in free motion, that the bias is learnt from; default: those of the phase "free".
        log, rig, robot, bias, differentiator, trust_wrench: as for `contact_series`.

    Raises:
        InputError: no joints, no tip frame, or input that contradicts itself.
    """
    made = tip_motions(log, rig, robot=robot, bias=bias, differentiator=differentiator, trust_wrench=trust_wrench)
    return made(log.labelled_free if free is None else free)


def tip_motions(
    log: Log,
    rig: Rig,
    *,
    robot: Robot | None = None,
    bias: Bias = "auto",
    differentiator: Differentiator | None = None,
    trust_wrench: bool = False,
) -> Callable[[NDArray[np.int64]], TipMotion]:
    """`tip_motion` of whatever rows are taken for free motion, with its kinematics worked out once."""
    _expect(log, rig)
    robot = robot or Robot.load(rig)
    tip = robot.tip_frame or robot.sensor_frame
    if tip is None:
        _need_tip(robot)
        raise AssertionError
    motion = joint_motion(log, robot, differentiator)
    kinematics = robot.kinematics(tip, motion.q, motion.dq, motion.ddq)
    rotation, load = None, np.zeros(0)
    if log.wrench is not None and robot.sensor_frame is not None:
        sensor = robot.kinematics(robot.sensor_frame, motion.q, motion.dq, motion.ddq)
        rotation, load = sensor.rotation, tool_load(rig.carried, sensor, robot.gravity)
    if not np.isfinite(kinematics.position).all(axis=1).any():
        raise InputError(
            f"not one sample of {log.provenance.source} in which every joint position is a number",
            "finite joint positions",
            "check its columns",
        )

    def made(free: NDArray[np.int64]) -> TipMotion:
        force = None
        if rotation is not None:
            reading = read_wrench(log, rig, robot, motion, free, bias, trust_wrench)
            force = np.einsum("nij,nj->ni", rotation, (reading.true() - load)[:, :3])
        return TipMotion(log.t, kinematics.position, kinematics.velocity, force, motion.steps)

    return made


def _need_tip(robot: Robot) -> None:
    if robot.tip_frame is None:
        raise InputError(
            f"{robot.name} without a tip frame (it has no 'tool_tip')",
            "the contact point",
            f"name one of its frames in [robot] tip_frame, at the end of the arm: {', '.join(robot.end_frames)}",
        )


def _own_quantities(log: Log, rig: Rig, differentiator: Differentiator | None) -> ContactSeries:
    """Contact quantities that the log holds itself, smoothed with their rates; what is unknown is NaN."""
    have, provenance = dict(log.contact), log.provenance
    if "depth" not in have:
        raise InputError(
            f"neither joints nor depth in {log.provenance.source}",
            "q1…qN, or depth [m]",
            "name the columns in [columns] of the rig",
        )
    for name, rate, made in own_motion(log, differentiator):
        if isinstance(made, Smoothed):
            have[name], have[rate] = made.value[:, 0], made.first[:, 0]
            warnings = tuple(contradictions(made, [name], log.period))
            provenance = provenance.after(Step("smooth", {"quantity": name, **made.facts}, warnings))
        elif rate not in have:
            have[rate] = made.first[:, 0]
            facts = {"quantity": name, "bandwidth_hz": made.bandwidth, "window_samples": made.window}
            provenance = provenance.then("differentiate", **facts)
    table = np.array([have.get(name, np.full(len(log), np.nan)) for name in CONTACT])
    valid = log.valid & np.isfinite(sum(have.values()))
    return _series(log, rig, table, valid, provenance, differentiator is None, forces="normal_force" in have)
