"""Experiments of logs: contact quantities, the wrench of a force/torque sensor, joint torques."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from kinid.contact.doubts import contact_doubts
from kinid.contact.series import ContactSeries, contact_series
from kinid.contact.torque_contact import FORCES
from kinid.contact.touching import force_noise
from kinid.data.log import Log, Mask
from kinid.data.rig import CONTACT, WRENCH, Rig
from kinid.effects import AsRead, Layout, Signals
from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.motion_draws import JointDraws, SeriesDraws
from kinid.modeling.sample_times import clock, forgotten
from kinid.modeling.tool_load import joint_signals, sensor_motion
from kinid.robotics.external_force import PRIOR, UNKNOWN
from kinid.robotics.inverse_dynamics import refuse_external
from kinid.robotics.motion import JointMotion, axes_motion, joint_motion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load as load_surface
from kinid.robotics.wrench import Bias, Reading, given_bias, read_wrench
from kinid.signal.derivative import Differentiator
from kinid.signal.noise import ROBUST

Array = NDArray[np.float64]

#: samples in the air that tell the noise
FREE_ENOUGH = 200
#: readings swing where their correlation with themselves falls below this within an eighth of their time in the air
SWING, MIN_SWINGS = -0.3, 8
#: share of the greatest depth outside the material from which on a force is no contact, whatever it is
CLEAR = 0.1
#: depth that stands for "nowhere near a surface" where the rig has none [m]
FAR = -1.0


def from_contact(touch: ContactSeries, channels: tuple[str, ...]) -> Experiment:
    """Contact-frame quantities as they are: normal force, and tangential forces where asked for."""
    rows = np.flatnonzero(np.isfinite(touch.depth) & np.isfinite(touch.depth_rate))
    t, dt = clock(touch.t, rows, "depth", touch.provenance.source)
    depth, depth_rate, slip, slip_rate = _motion(touch, rows)
    measured = np.stack([getattr(touch, name)[rows] for name in channels])
    in_contact = _touching(touch, rows)
    valid = np.isfinite(measured).all(axis=0) & ~forgotten(t, in_contact)
    layout = Layout(channels, "contact")
    rig = Rig() if touch.source is None else touch.source[1]
    signals = Signals(
        layout,
        t,
        dt,
        depth,
        depth_rate,
        np.nan_to_num(slip),
        np.nan_to_num(slip_rate),
        measured=measured,
        surface_sd=rig.surface_sd,
        gain_sd=rig.sensor.gain_sd or 0.0,
    )
    noise = _noise(measured[:, valid])
    free = valid & ~in_contact & (depth < 0)
    if free.sum() >= FREE_ENOUGH:
        noise = np.maximum(noise, _slow_noise(measured[:, free]))
    made = Experiment(
        signals,
        measured,
        valid,
        noise,
        _named(touch.phase, rows),
        in_contact,
        rows,
        touch=touch,
        drawn=SeriesDraws(*touch.source) if touch.source is not None and touch.smoothed else None,
        warnings=_doubts(touch),
    )
    return made if touch.force_sd is None else _of_torques(touch, rows, made)


def _of_torques(touch: ContactSeries, rows: NDArray[np.int64], made: Experiment) -> Experiment:
    """Forces from joint torques as an experiment: noise of their typical standard deviation, most of which lasts.

    Samples whose force the joints barely feel, as in a singular pose, don't count.
    """
    assert touch.force_sd is not None
    order = [CONTACT[row] for row in FORCES]
    sd = touch.force_sd[[order.index(name) for name in made.layout.channels]][:, rows]
    valid = made.valid & (sd < UNKNOWN * PRIOR).all(axis=0)
    if not valid.any():
        return dataclasses.replace(made, valid=valid)
    typical = np.median(sd[:, valid & made.in_contact] if (valid & made.in_contact).any() else sd[:, valid], axis=1)
    slow = np.sqrt(np.maximum(typical**2 - _noise(made.measured[:, valid]) ** 2, 0.0))
    return dataclasses.replace(made, valid=valid, noise=np.maximum(made.noise, typical), slow=slow)


#: a bias that a rig needn't state [N, N·m]: twice what zeroing in the air leaves
MOST_UNSTATED = np.repeat([0.04, 2e-3], 3)


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
    moving, reading = _read(log, rig, robot, motion, touch, trust_wrench)
    rows = np.flatnonzero(moving)
    t, dt = clock(log.t, rows, "joint motion", log.provenance.source)
    sensor = sensor_motion(robot, rig, motion, rows, surface)
    warnings = (*motion.warnings, *contact_doubts(log, rig, robot, touch))
    del motion  # the largest of all
    stated = _removed(bias, rig, reading.bias)
    as_read = AsRead.stated(reading.inverse_crosstalk, stated)
    measured = _rows(dataclasses.replace(reading, bias=stated).true()[rows])
    found, layout = _rows(reading.true()[rows]), Layout(WRENCH, "wrench")
    signals = Signals(
        layout,
        t,
        dt,
        *_motion(touch, rows),
        measured=found,
        sensor=sensor,
        as_read=as_read,
        surface_sd=rig.surface_sd,
        gain_sd=rig.sensor.gain_sd or 0.0,
    )
    touching = np.zeros(len(rows), dtype=np.bool_) if touch is None else _touching(touch, rows)
    counts = np.asarray(np.isfinite(measured).all(axis=0))
    noise = np.maximum(_noise(measured[:, counts]), rig.sensor.noise or 0.0)
    valid, phase = counts & ~forgotten(t, touching), _named(log.phase, rows)
    drawn = SeriesDraws(log, rig) if differentiator is None else None
    unstated = _unstated(rig, reading) if isinstance(bias, str) and bias == "none" else ""
    return Experiment(
        signals, measured, valid, noise, phase, touching, rows, drawn=drawn, warnings=warnings, unstated=unstated
    )


def _unstated(rig: Rig, reading: Reading) -> str:
    """A sentence on a bias that free motion shows and the rig doesn't state, as the rig would state it; or ""."""
    if rig.sensor.bias is not None or not (np.abs(reading.bias) > MOST_UNSTATED).any():
        return ""
    line = ", ".join(f"{value:.4g}" for value in reading.bias)
    return (
        f"in free motion the sensor reads a bias that the rig doesn't state, and that counts as error here: paste "
        f"bias = [{line}] below [sensor] in the rig"
    )


def _doubts(touch: ContactSeries) -> tuple[str, ...]:
    """Where contact quantities contradict each other, and the log that they come from its rig."""
    if touch.source is None or touch.source[0].q is None:
        return touch.warnings
    log, rig = touch.source
    return (*touch.warnings, *contact_doubts(log, rig, Robot.load(rig), touch))


def _read(
    log: Log, rig: Rig, robot: Robot, motion: JointMotion, touch: ContactSeries | None, trust: bool
) -> tuple[Mask, Reading]:
    """Samples whose motion is known, (n,), and the wrench, its bias that of free motion."""
    if touch is not None and touch.bias is not None:
        known, none = touch.bias.tolist(), np.empty(0, dtype=np.int64)
        moving = np.isfinite(touch.depth + touch.depth_rate)
        return moving, read_wrench(log, rig, robot, motion, none, known, trust=True)
    moving = np.isfinite(motion.ddq.sum(axis=1)) & np.isfinite(motion.dq.sum(axis=1)) & log.valid
    return moving, read_wrench(log, rig, robot, motion, log.labelled_free, "auto", trust)


def _removed(bias: Bias, rig: Rig, found: Array) -> Array:
    """The bias that is taken out of readings, (6,): given, that of free motion, or what the rig states."""
    if isinstance(bias, str) and bias in ("auto", "none"):
        return found if bias == "auto" else rig.sensor.stated_bias
    return given_bias(bias, rig)[0]


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
    refuse_external(rig)
    if robot is None and rig.robot is not None:
        robot = Robot.load(rig)
    motion = axes_motion(log, differentiator) if robot is None else joint_motion(log, robot, differentiator)
    rows = np.flatnonzero(np.isfinite(motion.q.sum(axis=1) + motion.dq.sum(axis=1) + motion.ddq.sum(axis=1)))
    t, dt = clock(log.t, rows, "joint motion", log.provenance.source)
    valid = np.asarray(np.isfinite(log.tau[rows].sum(axis=1)))
    arm, carried = robot, None if robot is None else _beyond_sensor(log, rig, robot, motion, bias)
    if carried is not None:
        valid = valid & np.isfinite(carried[rows].sum(axis=1))
        carried = np.nan_to_num(carried)
    elif robot is not None and rig.tool is not None:
        arm = robot.with_tool(rig.tool)
    joints = joint_signals(motion, rows, arm, robot, carried)
    if arm is not robot and rig.tool is not None:
        joints = dataclasses.replace(joints, tool=(rig.tool.mass, rig.tool.mass * float(np.linalg.norm(rig.tool.com))))
    layout = joint_layout(rig, robot, log.tau.shape[1])
    measured = _rows(log.tau[rows])
    none, pair = np.zeros(len(rows)), np.zeros((2, len(rows)))
    signals = Signals(layout, t, dt, none, none, pair, pair, measured=measured, joints=joints)
    drawn = JointDraws(log, arm, robot, carried) if differentiator is None else None
    noise, phase, touching = _noise(measured[:, valid]), _named(log.phase, rows), np.zeros(len(rows), dtype=np.bool_)
    band = _band(log, differentiator)
    return Experiment(
        signals, measured, valid, noise, phase, touching, rows, band, drawn=drawn, warnings=motion.warnings
    )


def _band(log: Log, differentiator: Differentiator | None) -> float | None:
    """Frequency above which accelerations that a differentiator made hold nothing [Hz]; None for no such limit."""
    if log.ddq is not None or differentiator is None:
        return None
    below = 4 * differentiator.bandwidth * log.period <= 1.0  # else the log's own rate is the limit
    return differentiator.bandwidth if below else None


def _beyond_sensor(log: Log, rig: Rig, robot: Robot, motion: JointMotion, bias: Bias) -> Array | None:
    """Load on what lies beyond the sensor, as the sensor has it [N, N·m], (n, 6); None where none was logged."""
    if log.wrench is None or robot.sensor_frame is None:
        return None
    return read_wrench(log, rig, robot, motion, log.labelled_free, bias, trust=True).true()


def joint_layout(rig: Rig, robot: Robot | None, count: int) -> Layout:
    """Channels of joint torques."""
    names = () if robot is None else robot.joint_names
    slides = [_slides(rig, j) for j in range(count)] if robot is None else [robot.is_prismatic(name) for name in names]
    return Layout(tuple(f"{'force' if slide else 'tau'}{j + 1}" for j, slide in enumerate(slides)), "joints", names)


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


def _slow_noise(air: Array) -> Array:
    """Spread of readings in the air, (channels, n) → (channels,).

    Slow noise hides from differences of neighbours; where no force is, it shows.

    What swings to and fro there is a disturbance, no noise, and counts as nothing.
    """
    rest = air - np.median(air, axis=1, keepdims=True)
    n = rest.shape[1]
    power = np.abs(np.fft.rfft(rest - rest.mean(axis=1, keepdims=True), 2 * n, axis=1)) ** 2
    correlation = np.fft.irfft(power, axis=1)[:, : max(2, n // MIN_SWINGS)]
    swings = correlation.min(axis=1) < SWING * correlation[:, 0]
    return np.asarray(np.where(swings, 0.0, ROBUST * np.median(np.abs(rest), axis=1)))


def _step(channel: Array) -> float:
    """Smallest difference between neighbours that differ; for a reading that isn't quantised next to nothing."""
    steps = np.abs(np.diff(channel))
    steps = steps[steps > 0]
    return float(steps.min()) if len(steps) else 0.0


def _touching(touch: ContactSeries, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Samples in contact, (n,): a force far outside the material is a bias, not contact."""
    depth, flag = touch.depth[rows], touch.in_contact[rows]
    deepest = float(depth.max(initial=0.0))
    return flag & ~(depth < -CLEAR * deepest) if deepest > 0.0 else flag


def _motion(touch: ContactSeries | None, rows: NDArray[np.int64]) -> tuple[Array, Array, Array, Array]:
    """Depth and its rate, (n,), slips and their rates, (2, n); of free motion far away without a surface."""
    if touch is None:
        none, pair = np.zeros(len(rows)), np.zeros((2, len(rows)))
        return none + FAR, none, pair, pair
    slip = np.stack([touch.slip1[rows], touch.slip2[rows]])
    slip_rate = np.stack([touch.slip_rate1[rows], touch.slip_rate2[rows]])
    return touch.depth[rows], touch.depth_rate[rows], slip, slip_rate


def _named(phase: NDArray[np.str_] | None, rows: NDArray[np.int64]) -> NDArray[np.str_] | None:
    return None if phase is None else phase[rows]


def _rows(values: Array) -> Array:
    """(n, k) as the rows (k, n) that signals have."""
    return np.ascontiguousarray(values.T)
