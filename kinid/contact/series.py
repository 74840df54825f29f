"""Log and rig to contact-frame quantities: depth, slip and forces in the frame of the surface.

A `ContactSeries` is the proof that the kinematics ran: whoever holds one holds quantities in SI units, in the contact
frame, from which the tool's weight and inertia and the sensor's known faults have been removed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log, Provenance, frozen
from kinid.data.rig import CONTACT, Rig, ToolSpec
from kinid.errors import InputError
from kinid.kernels import chain as kernel
from kinid.kernels.hysteresis import contact_flag, steady_flag
from kinid.robotics.motion import STATIC_PERIOD, JointMotion, TipMotion, joint_motion, own_motion, warnings_of
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane, Surface
from kinid.robotics.surface import load as load_surface
from kinid.robotics.wrench import FEWEST_FREE, Bias, Reading, read_wrench, tool_load
from kinid.signal import Smoothed
from kinid.signal.derivative import Differentiator
from kinid.signal.white_noise import white_noise

Array = NDArray[np.float64]

#: further outside the material than this, and nobody says otherwise, the tool is in free motion [m]
CLEARANCE = 3e-3
#: contact is not sought further outside the material than this [m]: a force there is not the surface's
REACH = 5e-3
#: free motion is looked for in so many rows of a log; more would not change the bias by its noise
LOOKED_AT = 50_000
#: contact is where the force is above OFF times its noise and, somewhere on the way, above ON times
ON, OFF = 6.0, 3.0
#: the force is averaged over so many samples on each side, so that noise alone never crosses from ON to OFF
SETTLE = 4

_ROWS = dict(
    zip(
        CONTACT,
        (
            kernel.DEPTH,
            kernel.DEPTH_RATE,
            kernel.SLIP1,
            kernel.SLIP2,
            kernel.SLIP_RATE1,
            kernel.SLIP_RATE2,
            kernel.NORMAL,
            kernel.TANGENT1,
            kernel.TANGENT2,
        ),
    )
)


@dataclass(frozen=True, eq=False)
class ContactSeries:
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
            object.__setattr__(self, name, frozen(getattr(self, name), dtype=np.bool_))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the log's own quantities contradict each other, a sentence each."""
        return self.provenance.warnings

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of a contact table, by name."""
        out: dict[str, NDArray[Any]] = {"t": self.t}
        out |= {name: getattr(self, name) for name in CONTACT}
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
) -> ContactSeries:
    """Contact-frame quantities of a log.

    Args:
        log: raw samples; with joints, or with contact quantities of its own.
        rig: what was measured with what; needs a `[surface]` for a log with joints.
        robot: the rig's robot, where the caller has it already.
        bias: of the sensor: "auto" (the rig's, else the median of free motion), "none", or six numbers [N, N·m].
        differentiator: instead of the smoother, for the velocities and accelerations that the log lacks.
        moments: compute the moment about the tip as well.
        trust_wrench: don't ask whether gravity contradicts the wrench's sign and axes.

    Raises:
        InputError: no surface, no joints, or input that contradicts itself.
    """
    if log.q is None and log.contact:
        return _own_quantities(log, rig, differentiator)
    surface = load_surface(rig)
    if surface is None:
        raise InputError(
            "a rig without [surface]",
            "the surface that depth and slip are measured from",
            "add [surface] point and normal, or let touches find it (kinid contact --find-surface)",
        )
    robot = robot or Robot.load(rig)
    _need_tip(robot)
    table, reading, made = _measured(log, rig, robot, surface, bias, differentiator, moments, trust_wrench)
    valid = log.valid & np.isfinite(table[: len(CONTACT) if reading is not None else 6].sum(axis=0))
    if not valid.any():
        raise InputError(
            f"not one sample of {log.provenance.source} in which everything is a number",
            "finite joint positions, and wrench where there is one",
            "check its columns",
        )
    if not valid.all():
        table[:, ~valid] = np.nan
    flag, thresholds = _touching(table, log, rig, reading is not None, valid)
    provenance = log.provenance.then(
        "contact frame",
        robot=robot.name,
        samples=len(log),
        invalid_samples=int((~valid).sum()),
        gaps=max(0, len(log.pieces) - 1),
    )
    if surface.notes:
        provenance = provenance.then("surface", notes=list(surface.notes))
    if made:
        provenance = provenance.then("smooth" if "motion" in made else "differentiate", **made)
    if reading is not None:
        provenance = provenance.then("wrench", tool="removed" if rig.tool else "none in the rig", **reading.facts)
    return ContactSeries(
        t=log.t,
        in_contact=flag,
        valid=valid,
        phase=log.phase,
        bias=reading.bias if reading is not None else None,
        moment=table[kernel.MOMENT1 :] if moments and reading is not None else None,
        provenance=provenance.then("contact flag", **thresholds),
        source=(log, rig),
        **{name: table[row] for name, row in _ROWS.items()},
    )


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
    robot = robot or Robot.load(rig)
    tip = robot.tip_frame or robot.sensor_frame
    if tip is None:
        _need_tip(robot)
        raise AssertionError
    motion = joint_motion(log, robot, differentiator)
    kinematics = robot.kinematics(tip, motion.q, motion.dq, motion.ddq)
    force = None
    if log.wrench is not None and robot.sensor_frame is not None:
        if free is None:
            free = log.labelled_free
        reading = read_wrench(log, rig, robot, motion, free, bias, trust_wrench)
        sensor = robot.kinematics(robot.sensor_frame, motion.q, motion.dq, motion.ddq)
        load = tool_load(rig.tool or ToolSpec(mass=0.0), sensor, robot.gravity)
        force = np.einsum("nij,nj->ni", sensor.rotation, (reading.true() - load)[:, :3])
    if not np.isfinite(kinematics.position).all(axis=1).any():
        raise InputError(
            f"not one sample of {log.provenance.source} in which every joint position is a number",
            "finite joint positions",
            "check its columns",
        )
    return TipMotion(log.t, kinematics.position, kinematics.velocity, force, motion.facts)


def _measured(
    log: Log,
    rig: Rig,
    robot: Robot,
    surface: Surface,
    bias: Bias,
    differentiator: Differentiator | None,
    moments: bool,
    trust_wrench: bool,
) -> tuple[Array, Reading | None, dict[str, Any]]:
    """The quantities (9 or 12, n), how the wrench was read, and where the joints' derivatives came from.

    The derivatives are twice as large as the positions; that they end with this function keeps memory low.
    """
    motion = joint_motion(log, robot, differentiator)
    differentiator = differentiator or Differentiator()  # of forces, where the arm gives way
    work = _Work(log, rig, robot, motion, surface, differentiator)
    reading = None
    if log.wrench is not None:
        reading = read_wrench(log, rig, robot, motion, work.free(), bias, trust_wrench)
    if not isinstance(surface, Plane):
        return work.on_mesh(reading, moments), reading, motion.facts
    table = work.on_plane(surface, reading, moments)
    if reading is not None and robot.compliance.any():
        _add_elastic_rates(table, log, robot, surface, differentiator)
    return table, reading, motion.facts


def contact_motion(log: Log, rig: Rig, robot: Robot, surface: Surface, motion: JointMotion) -> Array:
    """Depth, its rate, slips and their rates of a motion that need not be the log's own, rows as in a contact table,
    (6, n).
    """
    work = _Work(log, rig, robot, motion, surface, Differentiator())
    return (work.on_plane(surface, None, False) if isinstance(surface, Plane) else work.on_mesh(None, False))[:6]


@dataclass(frozen=True, eq=False)
class _Work:
    """What the two kinds of surface share: the chain to the sensor, packed for the kernels."""

    log: Log
    rig: Rig
    robot: Robot
    motion: JointMotion
    surface: Surface
    differentiator: Differentiator

    def free(self) -> NDArray[np.int64]:
        """Rows in free motion, at most `LOOKED_AT` of them: those so labelled, else those clear of the surface."""
        labelled = self.log.labelled_free
        if len(labelled) >= FEWEST_FREE:
            return labelled[:: 1 + len(labelled) // LOOKED_AT]
        rows = np.arange(0, len(self.log), 1 + len(self.log) // LOOKED_AT)
        tip = self.robot.kinematics(self.robot.tip_frame or "", self.motion.q[rows]).position
        with np.errstate(invalid="ignore"):
            return rows[self.surface.locate(tip).depth < -CLEARANCE]

    def on_plane(self, plane: Plane, reading: Reading | None, moments: bool) -> Array:
        """All quantities in one pass over the samples, (9 or 12, n)."""
        robot = self.robot
        chain = robot.chain(robot.sensor_frame if reading is not None and robot.sensor_frame else robot.tip_frame or "")
        tip = robot.tip_in_sensor() if reading is not None else np.zeros(3)
        out = np.empty((kernel.CONTACT_COLUMNS if moments and reading is not None else len(CONTACT), len(self.log)))
        if reading is None:
            out[6:] = np.nan
        kernel.contacts(
            chain.select(self.motion.q),
            chain.select(self.motion.dq),
            chain.select(self.motion.ddq),
            np.ascontiguousarray(reading.wrench) if reading is not None else np.empty((0, 6)),
            chain.turns,
            chain.shifts,
            chain.prismatic,
            tip,
            reading.packed() if reading is not None else np.zeros(42),
            self._tool(),
            np.concatenate([plane.point, plane.axes.ravel()]),
            robot.compliance.ravel(),
            out.shape[0] if reading is not None else 6,
            out,
        )
        return out

    def on_mesh(self, reading: Reading | None, moments: bool) -> Array:
        """The same on a mesh: the surface's frame is another one at every sample."""
        robot = self.robot
        tip = robot.kinematics(robot.tip_frame or "", self.motion.q, self.motion.dq, self.motion.ddq)
        position, velocity = tip.position, tip.velocity
        out = np.full(
            (kernel.CONTACT_COLUMNS if moments and reading is not None else len(CONTACT), len(self.log)), np.nan
        )
        force = np.zeros((len(self.log), 3))
        if reading is not None:
            sensor = robot.kinematics(robot.sensor_frame or "", self.motion.q, self.motion.dq, self.motion.ddq)
            load = tool_load(self.rig.tool or ToolSpec(mass=0.0), sensor, robot.gravity)
            contact = np.einsum("nij,nkj->nki", sensor.rotation, (reading.true() - load).reshape(-1, 2, 3))
            force = contact[:, 0]
            if robot.compliance.any():
                position = position + force @ robot.compliance.T
                rate = self.differentiator(self.log.t, force, self.log.pieces).first
                velocity = velocity + rate @ robot.compliance.T
        where = self.surface.locate(position)
        rates = np.einsum("nij,nj->ni", where.axes, velocity)
        out[kernel.DEPTH] = where.depth
        out[kernel.DEPTH_RATE] = -np.einsum("ni,ni->n", where.gradient, velocity)
        out[kernel.SLIP_RATE1], out[kernel.SLIP_RATE2] = rates[:, 0], rates[:, 1]
        out[kernel.SLIP1], out[kernel.SLIP2] = _travel(position, where.axes[:, :2])
        if reading is not None:
            in_frame = np.einsum("nij,nj->ni", where.axes, force)
            out[kernel.NORMAL], out[kernel.TANGENT1], out[kernel.TANGENT2] = (
                in_frame[:, 2],
                in_frame[:, 0],
                in_frame[:, 1],
            )
            if moments:
                arm = np.einsum("nij,j->ni", sensor.rotation, robot.tip_in_sensor())
                moment = contact[:, 1] - np.cross(arm, force)
                out[kernel.MOMENT1 :] = np.einsum("nij,nj->in", where.axes, moment)
        return out

    def _tool(self) -> Array:
        tool = self.rig.tool or ToolSpec(mass=0.0)
        return np.concatenate([[tool.mass], tool.com, tool.inertia_matrix.ravel(), self.robot.gravity])


def _need_tip(robot: Robot) -> None:
    if robot.tip_frame is None:
        raise InputError(
            f"{robot.name} without a tip frame (it has no 'tool_tip')",
            "the contact point",
            "name a frame of the URDF in [robot] tip_frame",
        )


def _travel(position: Array, tangents: Array) -> Array:
    """Path along both tangents (n, 2, 3) of a curved surface, from the first sample, (2, n) [m].

    The sum of the tip's steps, each along the mean of the tangents at its ends: it needs no velocity, and goes on
    straight where samples are missing.
    """
    out = np.full((2, len(position)), np.nan)
    rows = np.flatnonzero(np.isfinite(position.sum(axis=1)))
    if len(rows):
        between = 0.5 * (tangents[rows[1:]] + tangents[rows[:-1]])
        steps = np.einsum("nij,nj->in", between, np.diff(position[rows], axis=0))
        out[:, rows] = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
    return out


def _add_elastic_rates(table: Array, log: Log, robot: Robot, plane: Plane, differentiator: Differentiator) -> None:
    """The tip moves with the force where the arm bends; the force's rate comes from the differentiator."""
    axes = plane.axes
    in_frame = axes @ robot.compliance @ axes.T  # contact frame, rows tangent1, tangent2, normal
    force = np.ascontiguousarray(table[[kernel.TANGENT1, kernel.TANGENT2, kernel.NORMAL]].T)
    rates = differentiator(log.t, force, log.pieces).first @ in_frame.T
    table[kernel.SLIP_RATE1] += rates[:, 0]
    table[kernel.SLIP_RATE2] += rates[:, 1]
    table[kernel.DEPTH_RATE] -= rates[:, 2]


def _touching(
    table: Array, log: Log, rig: Rig, forces: bool, valid: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], Mapping[str, Any]]:
    """The contact flag, from the normal force where there is one, else from the depth."""
    flag = np.zeros(len(log), dtype=np.bool_)
    depth = table[kernel.DEPTH]
    if not forces:
        contact_flag(depth, depth, 0.0, 0.0, REACH, flag)
        return flag, {"from": "depth", "on_m": 0.0}
    normal = table[kernel.NORMAL]
    poses = log.q is not None and log.dq is None and log.period >= STATIC_PERIOD  # neighbours have nothing in common
    noise = 1e-9 if poses else force_noise(normal[valid])
    with np.errstate(invalid="ignore"):
        quiet = normal[valid & (depth < -REACH)]
    if len(quiet) >= FEWEST_FREE:  # out of reach, a tool that is not quite known leaves more than white noise
        noise = max(noise, 1.4826 * float(np.median(np.abs(quiet))))
    if rig.sensor.noise is not None:
        noise = max(noise, float(max(rig.sensor.noise[:3])))
    steady_flag(normal, depth, ON * noise, OFF * noise, REACH, 0 if poses else SETTLE, flag)
    return flag, {"from": "normal force", "on_n": ON * noise, "off_n": OFF * noise, "within_m": REACH}


def force_noise(signal: Array) -> float:
    """Standard deviation of white noise on a slow force (n,) [N]; at least 1 nN."""
    return max(1e-9, white_noise(signal))


def _own_quantities(log: Log, rig: Rig, differentiator: Differentiator | None) -> ContactSeries:
    """Contact quantities that the log holds itself, depth and slips smoothed with their rates; what is unknown is
    NaN.
    """
    have, provenance = dict(log.contact), log.provenance
    if "depth" not in have:
        raise InputError(
            f"neither joints nor depth in {log.provenance.source}",
            "q1…qN, or depth [m]",
            "name the columns in [columns] of the rig",
        )
    for name, rate, smoothed in own_motion(log, differentiator):
        if isinstance(smoothed, Smoothed):
            have[name], have[rate] = smoothed.value[:, 0], smoothed.first[:, 0]
            warnings = warnings_of(smoothed, [name], log.period)
            facts = {"quantity": name, **smoothed.facts, **({"warnings": warnings} if warnings else {})}
            provenance = provenance.then("smooth", **facts)
        elif rate not in have:
            have[rate] = smoothed.first[:, 0]
            provenance = provenance.then(
                "differentiate", quantity=name, bandwidth_hz=smoothed.bandwidth, window_samples=smoothed.window
            )
    table = np.full((len(CONTACT), len(log)), np.nan)
    for name, row in _ROWS.items():
        if name in have:
            table[row] = have[name]
    valid = log.valid & np.isfinite(table[[_ROWS[name] for name in have]].sum(axis=0))
    table[:, ~valid] = np.nan
    flag, thresholds = _touching(table, log, rig, "normal_force" in have, valid)
    return ContactSeries(
        t=log.t,
        in_contact=flag,
        valid=valid,
        phase=log.phase,
        provenance=provenance.then("contact flag", **thresholds),
        source=(log, rig),
        **{name: table[row] for name, row in _ROWS.items()},
    )
