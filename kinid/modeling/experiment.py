"""What a model is fitted to: the signals that drive it and the readings it is held against, from a log and its rig."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries, contact_series, force_noise
from kinid.data.log import Log
from kinid.data.rig import WRENCH, Rig
from kinid.effects import AsRead, JointMotion, Layout, Signals
from kinid.errors import InputError
from kinid.kernels.zero_phase import zero_phase
from kinid.modeling.motion_draws import JointDraws, SeriesDraws
from kinid.modeling.sample_times import clock, forgotten
from kinid.modeling.tool_load import gravity_torques, moment_torques, payload_torques, sensor_motion, torque_slopes
from kinid.robotics.motion import axes_motion, joint_motion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load as load_surface
from kinid.robotics.wrench import Bias, read_wrench
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

#: samples in the air that tell the noise
FREE_ENOUGH = 200
#: a material has let go where its force is below so many times the noise
LET_GO = 3.0
#: share of the greatest depth outside the material from which on a force is no contact, whatever it is
CLEAR = 0.1
#: depth that stands for "nowhere near a surface" where the rig has none [m]
FAR = -1.0


@dataclass(frozen=True, eq=False)
class Experiment:
    """Signals and readings on the same samples.

    Attributes:
        signals: what drives a prediction.
        measured: readings, (channels, n).
        valid: samples whose reading counts, (n,).
        noise: standard deviation of each channel's white noise, (channels,).
        phase: names, or None. in_contact: the flag, (n,).
        rows: of the log or the contact series that the samples are: those whose motion is known, (n,).
        touch: the contact quantities that it was made of, or None.
        band: readings and predictions are compared below this frequency [Hz]: velocities and accelerations that a
            differentiator made, where one was asked for, hold nothing above it. None: at all frequencies.
        drawn: makes the signals of these rows anew, driven by samples of the motion; None where the motion's error
            isn't known.
        warnings: where what was logged contradicts itself, a sentence each.
    """

    signals: Signals
    measured: Array
    valid: NDArray[np.bool_]
    noise: Array
    phase: NDArray[np.str_] | None
    in_contact: NDArray[np.bool_]
    rows: NDArray[np.int64]
    band: float | None = None
    touch: ContactSeries | None = field(default=None, repr=False)
    drawn: Callable[[Signals, NDArray[np.int64]], Iterator[Signals]] | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()

    @cached_property
    def motion_draws(self) -> tuple[Signals, ...]:
        """The signals driven by samples of the motion as it may have been, given the noise it was measured with; or
        none.
        """
        return () if self.drawn is None else tuple(self.drawn(self.signals, self.rows))

    @property
    def raw(self) -> Array:
        """Readings as the sensor's converter gave them, (channels, n)."""
        return self.as_read(self.measured)

    def as_read(self, readings: Array) -> Array:
        """Readings (channels, n) with what the rig states of the sensor's faults, as its converter would give them."""
        return readings if self.signals.as_read is None else self.signals.as_read.raw(readings)

    def as_true(self, raw: Array) -> Array:
        """Raw readings (channels, n) without what the rig states of the sensor's faults."""
        return raw if self.signals.as_read is None else self.signals.as_read.true(raw)

    @cached_property
    def normal_force(self) -> Array | None:
        """As measured, bias of free motion removed (n,); None where nobody measured it."""
        s = self.signals
        if s.layout.kind == "contact":
            channels = s.layout.channels
            return self.measured[channels.index("normal_force")] if "normal_force" in channels else None
        if s.sensor is None or s.measured is None:
            return None
        force: Array = np.einsum("ni,in->n", s.sensor.to_contact[:, 2], s.measured[:3] - s.sensor.load[:3])
        return force

    @cached_property
    def let_go(self) -> NDArray[np.bool_]:
        """Samples in which a tool retracts inside a material that has let it go: no more force is left than outside,
        (n,).
        """
        force = self.normal_force
        if force is None:
            return np.zeros(len(self.signals), np.bool_)
        quiet, outside = float(np.hypot.reduce(self.noise[:3])), self.valid & (self.signals.depth < 0)
        bias = float(np.median(force[outside])) if outside.any() else 0.0
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (self.signals.depth > 0) & (self.signals.depth_rate < 0) & (np.abs(force - bias) < LET_GO * quiet)
            )

    def in_band(self, readings: Array) -> Array:
        """Readings (channels, n) without what lies above the band; zero-phase, piece by piece (Gustafsson 1996)."""
        if self.band is None:
            return readings
        out = readings.copy()
        sections, settled, pieces = self._low_pass
        for piece in pieces:
            zero_phase(sections, settled, out[:, piece])
        return out

    @cached_property
    def _low_pass(self) -> tuple[Array, Array, list[slice]]:
        """Sections of the filter of the band, (2, 6), what they remember of a step, (2, 2), and pieces of the log to
        filter.
        """
        from scipy.signal import butter, sosfilt_zi

        assert self.band is not None
        dt = self.signals.dt
        pieces = [piece for piece in self.signals.runs if piece.stop - piece.start > 100]
        sections = butter(4, self.band * 2 * float(np.median(dt[dt > 0])), output="sos")
        return sections, sosfilt_zi(sections), pieces

    def thinned(self, step: int) -> Experiment:
        """Every so manieth sample, with the steps of time between them; memory begins anew where it did in between."""
        if step == 1:
            return self
        s = self.signals
        at = np.arange(0, len(s), step)
        restarts = np.cumsum(s.dt == 0.0)
        dt = np.diff(s.t[at], prepend=s.t[0])
        dt[np.diff(restarts[at], prepend=-1) > 0] = 0.0

        def rows(thing: object, whole: tuple[str, ...] = (), first: tuple[str, ...] = ()) -> dict[str, Array]:
            return {
                field.name: np.ascontiguousarray(value[::step] if field.name in first else value[..., ::step])
                for field in dataclasses.fields(thing)  # type: ignore[arg-type]
                if isinstance(value := getattr(thing, field.name), np.ndarray)
                and value.size
                and field.name not in whole
            }

        parts: dict[str, Any] = {**rows(s), "dt": dt}
        if s.sensor is not None:
            parts["sensor"] = dataclasses.replace(s.sensor, **rows(s.sensor, ("tip", "com"), ("to_contact",)))  # type: ignore[arg-type]
        if s.joints is not None:
            parts["joints"] = dataclasses.replace(s.joints, **rows(s.joints))  # type: ignore[arg-type]
        return dataclasses.replace(
            self,
            signals=dataclasses.replace(s, **parts),
            measured=self.measured[:, ::step],
            valid=self.valid[::step],
            phase=None if self.phase is None else self.phase[::step],
            in_contact=self.in_contact[::step],
            rows=self.rows[::step],
            band=None,
            touch=None,
        )

    @property
    def layout(self) -> Layout:
        """Its channels."""
        return self.signals.layout


def _touching(touch: ContactSeries, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Samples in contact, (n,): a force far outside the material is a bias, not contact."""
    depth, flag = touch.depth[rows], touch.in_contact[rows]
    deepest = float(depth.max(initial=0.0))
    return flag & ~(depth < -CLEAR * deepest) if deepest > 0.0 else flag


def from_contact(touch: ContactSeries, channels: tuple[str, ...]) -> Experiment:
    """Contact-frame quantities as they are: normal force, and tangential forces where asked for."""
    rows = np.flatnonzero(np.isfinite(touch.depth) & np.isfinite(touch.depth_rate))
    t, dt = clock(touch.t, rows, "depth", touch.provenance.source)
    slip = np.nan_to_num(np.stack([touch.slip1[rows], touch.slip2[rows]]))
    slip_rate = np.nan_to_num(np.stack([touch.slip_rate1[rows], touch.slip_rate2[rows]]))
    measured = np.stack([getattr(touch, name)[rows] for name in channels])
    in_contact = _touching(touch, rows)
    valid = np.isfinite(measured).all(axis=0) & ~forgotten(t, in_contact)
    signals = Signals(
        Layout(channels, "contact"),
        t,
        dt,
        touch.depth[rows],
        touch.depth_rate[rows],
        slip,
        slip_rate,
        measured=measured,
    )
    noise = _noise(measured[:, valid])
    free = valid & ~in_contact & (touch.depth[rows] < 0)
    if free.sum() >= FREE_ENOUGH:
        # slow noise hides from differences of neighbours; in the air, where no force is, it shows
        air = measured[:, free]
        noise = np.maximum(noise, 1.4826 * np.median(np.abs(air - np.median(air, axis=1, keepdims=True)), axis=1))
    drawn = None
    if touch.source is not None and any(step.name == "smooth" for step in touch.provenance.steps):
        drawn = SeriesDraws(*touch.source)
    return Experiment(
        signals,
        measured,
        valid,
        noise,
        _named(touch.phase, rows),
        in_contact,
        rows,
        touch=touch,
        drawn=drawn,
        warnings=touch.warnings,
    )


def from_wrench(
    log: Log,
    rig: Rig,
    *,
    bias: Bias = "none",
    robot: Robot | None = None,
    differentiator: Differentiator | None = None,
    trust_wrench: bool = False,
) -> Experiment:
    """The six channels of the sensor, in its axes, with what the rig states of its faults removed.

    `signals.measured`, which drives no law, always has the bias of free motion removed.
    Without a `[surface]` in the rig the whole log is free motion: depth −1 m, contact axes those of the base.

    Args:
        log: with joints and a wrench.
        rig: with the robot; surface, tool and sensor where known.
        bias: "none" leaves in the readings what the rig doesn't state, for the effect `sensor-bias` to find; "auto"
            removes the median of free motion as well; or six numbers [N, N·m].
        robot: the rig's robot, where the caller has it already.
        differentiator: instead of the smoother, for the velocities and accelerations that the log lacks.
        trust_wrench: don't ask whether gravity contradicts the wrench's sign and axes.

    Raises:
        InputError: no wrench, no joints, no sensor frame, or input that contradicts itself.
    """
    if log.wrench is None:
        raise InputError(
            f"no wrench in {log.provenance.source}",
            "fx fy fz tx ty tz [N, N·m]",
            "record the force/torque sensor, or name its columns in [columns]",
        )
    robot = robot or Robot.load(rig)
    surface, touch = load_surface(rig), None
    if surface is not None:  # first, so that its own motion has gone when the motion here is worked out
        touch = contact_series(log, rig, robot=robot, differentiator=differentiator, trust_wrench=trust_wrench)
    motion = joint_motion(log, robot, differentiator)
    if touch is not None:
        moving = np.isfinite(touch.depth + touch.depth_rate)
        found = next(step.facts["bias"] for step in touch.provenance.steps if step.name == "wrench")
        reading = read_wrench(log, rig, robot, motion, np.empty(0, dtype=np.int64), found, trust=True)
    else:
        moving = np.isfinite(motion.ddq.sum(axis=1)) & np.isfinite(motion.dq.sum(axis=1)) & log.valid
        free = log.labelled_free
        reading = read_wrench(log, rig, robot, motion, free, "auto", trust_wrench)
    stated = np.zeros(6) if rig.sensor.bias is None else np.asarray(rig.sensor.bias)
    if not isinstance(bias, str) or bias not in ("auto", "none"):
        stated = read_wrench(log, rig, robot, motion, np.empty(0, dtype=np.int64), bias, trust=True).bias
    elif bias == "auto":
        stated = reading.bias
    rows = np.flatnonzero(moving)
    t, dt = clock(log.t, rows, "joint motion", log.provenance.source)
    sensor = sensor_motion(robot, rig, motion, rows, surface)
    warnings = tuple(motion.facts.get("warnings", ()))
    del motion  # the largest of all
    measured = _rows(dataclasses.replace(reading, bias=stated).true()[rows])
    valid = np.asarray(np.isfinite(measured).all(axis=0))
    slip = slip_rate = np.zeros((2, len(rows)))
    if touch is not None:
        slip = np.stack([touch.slip1[rows], touch.slip2[rows]])
        slip_rate = np.stack([touch.slip_rate1[rows], touch.slip_rate2[rows]])
    signals = Signals(
        Layout(WRENCH, "wrench"),
        t,
        dt,
        np.full(len(rows), FAR) if touch is None else touch.depth[rows],
        np.zeros(len(rows)) if touch is None else touch.depth_rate[rows],
        slip,
        slip_rate,
        measured=_rows(reading.true()[rows]),
        sensor=sensor,
        as_read=AsRead.stated(reading.inverse_crosstalk, stated),
    )
    noise = _noise(measured[:, valid])
    if rig.sensor.noise is not None:
        noise = np.maximum(noise, rig.sensor.noise)
    touching = np.zeros(len(rows), dtype=np.bool_)
    if touch is not None:
        touching = _touching(touch, rows)
        valid = valid & ~forgotten(t, touching)
    drawn = SeriesDraws(log, rig) if differentiator is None else None
    return Experiment(
        signals, measured, valid, noise, _named(log.phase, rows), touching, rows, drawn=drawn, warnings=warnings
    )


def from_joint_torques(
    log: Log,
    rig: Rig,
    *,
    bias: Bias = "auto",
    robot: Robot | None = None,
    differentiator: Differentiator | None = None,
) -> Experiment:
    """The torque of each joint, beside the rigid-body torque of its motion.

    With a wrench in the log, everything beyond the sensor is what the sensor says; without one, the rig's tool is added
    to the arm, as in `kinid.joint_torques`. Without a `[robot]` in the rig nothing is known of the axes, neither
    inertia nor names. A joint that slides has the channel "force1" [N] instead of "tau1" [N·m]; without a robot the
    units of [columns] tell.

    Args:
        log: with joint positions and torques.
        rig: what it was measured with.
        bias: of the wrench, as for `kinid.contact_series`.
        robot: the rig's robot, where the caller has it already.
        differentiator: instead of the smoother, for the velocities and accelerations that the log lacks.

    Raises:
        InputError: no torques, no positions, or not a sample with both.
    """
    if log.tau is None:
        raise InputError(
            f"no joint torques in {log.provenance.source}",
            "tau1…tauN [N·m], link side",
            "name their columns in [columns] of the rig",
        )
    if robot is None and rig.robot is not None:
        robot = Robot.load(rig)
    motion = axes_motion(log, differentiator) if robot is None else joint_motion(log, robot, differentiator)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    rows = np.flatnonzero(np.isfinite(q.sum(axis=1) + dq.sum(axis=1) + ddq.sum(axis=1)))
    t, dt = clock(log.t, rows, "joint motion", log.provenance.source)
    joints = JointMotion(
        _rows(q[rows]), _rows(dq[rows]), _rows(ddq[rows]), np.zeros((q.shape[1], len(rows))), known=False
    )
    slides = [_slides(rig, j) for j in range(q.shape[1])]
    valid: NDArray[np.bool_] = np.isfinite(log.tau[rows].sum(axis=1))
    arm = carried = None
    if robot is not None:
        from kinid.robotics.inverse_dynamics import inverse_dynamics

        if log.wrench is not None and robot.sensor_frame is not None:
            free = log.labelled_free
            reading = read_wrench(log, rig, robot, motion, free, bias, trust=True)
            carried = reading.true()
            valid = np.asarray(valid & np.isfinite(carried[rows].sum(axis=1)))
            carried = np.nan_to_num(carried)
        arm = robot if carried is not None or rig.tool is None else robot.with_tool(rig.tool)
        rigid = inverse_dynamics(arm, q[rows], dq[rows], ddq[rows], None if carried is None else carried[rows])
        joints = dataclasses.replace(
            joints,
            rigid=_rows(rigid),
            known=True,
            payload=payload_torques(robot, q[rows], dq[rows], ddq[rows]),
            gravity=gravity_torques(arm, q[rows]),
            moments=functools.partial(moment_torques, arm),
            slopes=functools.partial(torque_slopes, arm),
        )
        if carried is None and rig.tool is not None:
            joints = dataclasses.replace(
                joints, tool=(rig.tool.mass, rig.tool.mass * float(np.linalg.norm(rig.tool.com)))
            )
        slides = [robot.is_prismatic(name) for name in robot.joint_names]
    channels = tuple(f"{'force' if slide else 'tau'}{j + 1}" for j, slide in enumerate(slides))
    layout = Layout(channels, "joints", () if robot is None else robot.joint_names)
    measured = _rows(log.tau[rows])
    none, pair = np.zeros(len(rows)), np.zeros((2, len(rows)))
    signals = Signals(layout, t, dt, none, none, pair, pair, measured=measured, joints=joints)
    band = None if log.ddq is not None or differentiator is None else differentiator.bandwidth
    if band is not None and 4 * band * log.period > 1.0:  # the log's own rate is the limit
        band = None
    drawn = JointDraws(log, arm, robot, carried) if differentiator is None else None
    return Experiment(
        signals,
        measured,
        valid,
        _noise(measured[:, valid]),
        _named(log.phase, rows),
        np.zeros(len(rows), dtype=np.bool_),
        rows,
        band,
        drawn=drawn,
        warnings=tuple(motion.facts.get("warnings", ())),
    )


def _slides(rig: Rig, joint: int) -> bool:
    """Whether the units of [columns] say that an axis without a robot slides: a length, or a force."""
    named = {"q": ("m", "dm", "cm", "mm", "um", "µm", "in"), "tau": ("N", "mN", "kN", "kgf", "gf", "lbf")}
    for group, units in named.items():
        for name in (f"{group}{joint + 1}", group):
            if name in rig.columns and rig.columns[name].unit in units:
                return True
    return False


def _noise(measured: Array) -> Array:
    """White noise of each channel, at least that of its steps where it is quantised, (channels,)."""
    return np.array([max(force_noise(channel), _step(channel) / np.sqrt(12.0)) for channel in measured])


def _step(channel: Array) -> float:
    """Smallest difference between neighbours that differ; for a reading that isn't quantised next to nothing."""
    steps = np.abs(np.diff(channel))
    steps = steps[steps > 0]
    return float(steps.min()) if len(steps) else 0.0


def _named(phase: NDArray[np.str_] | None, rows: NDArray[np.int64]) -> NDArray[np.str_] | None:
    return None if phase is None else phase[rows]


def _rows(values: Array) -> Array:
    """(n, k) as the rows (k, n) that signals have."""
    return np.ascontiguousarray(values.T)
