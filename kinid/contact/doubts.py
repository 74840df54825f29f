"""What speaks against a log and its rig together, before any model of the material: sentences with their remedies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.channel_doubts import channel_doubts
from kinid.contact.joint_doubts import frozen_joints, without_spikes
from kinid.contact.normal_doubts import tilted_normal
from kinid.contact.one_unit_doubts import one_unit
from kinid.contact.rig_doubts import rig_doubts, too_quiet
from kinid.contact.series import ContactSeries
from kinid.contact.surface_doubts import misplaced, turned_normal
from kinid.contact.time_doubts import time_doubts
from kinid.contact.tool_doubts import FEWEST, tool_doubts
from kinid.contact.torque_contact import by_torques
from kinid.contact.touch_doubts import unfelt
from kinid.contact.touching import REACH
from kinid.contact.unit_doubts import FORCES, MOMENTS
from kinid.data.log import Log, Step
from kinid.data.rig import WRENCH, Rig
from kinid.robotics.motion import SLACK, whole_turns
from kinid.robotics.robot import Robot
from kinid.signal.noise import white_noise
from kinid.signal.stuck import constant, frozen, noisy

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: no tool pokes deeper than this [m]
DEEPEST = 0.3
#: no touch lies further from the surface's point than this [m]
FARTHEST = 2.5
#: share of the sensor's range beyond which a reading is cut off or of another unit
FULL = 0.99
#: length of gravity on Earth, with room for who rounds it [m/s²]
EARTH = (9.7, 9.9)
#: joints stood still through touches whose force changed by so many times its noise
TOUCHED = 30.0


def contact_doubts(log: Log, rig: Rig, robot: Robot | None, touch: ContactSeries | None) -> list[str]:
    """Sentences about units, axes, limits and the tool of a log with joints; none for one that states contact itself.

    Args:
        log: raw samples. rig: what was measured with what. robot: of the rig. touch: contact quantities, if any.
    """
    if log.q is None or robot is None:
        return []
    stuck = _stuck(log)
    single = [] if stuck else channel_doubts(log)
    stuck = stuck or single or (frozen_joints(log) if log.wrench is not None else [])
    alone = [] if stuck else one_unit(log, rig, robot, touch)
    out = [*_without_wrench(log, rig), *stuck, *alone, *_beyond_joints(log, robot)]
    out += [] if alone else _beyond_range(log, rig)
    out += rig_doubts(log, rig, robot)
    if touch is not None:
        deepest = float(np.nanmax(touch.depth)) if np.isfinite(touch.depth).any() else 0.0
        if deepest > DEEPEST:
            out.append(
                f"the tip is {deepest:.3g} m inside the surface: check [surface] point and normal, which points out of "
                "the material, and [robot] tip_frame"
            )
        places = np.hypot(touch.slip1, touch.slip2)[touch.in_contact & touch.valid]
        away = float(np.median(places)) if len(places) else 0.0
        if away > FARTHEST:
            out.append(
                f"touches lie {away:.3g} m beside [surface] point, further than the arm reaches from "
                "its base: correct it, in m and in the base's axes"
            )
    if stuck or alone:  # shows as any of those behind it
        return out + _not_read(log)
    # each of these would show as one of those behind it; where no label says what free motion is, touches of a surface
    # that is too low pass for it
    off, place = misplaced(log, rig, robot, touch)
    hidden = place if off < -REACH and len(log.labelled_free) < FEWEST else []
    out += (
        time_doubts(log, touch is not None and bool(touch.in_contact.any()))
        or _elsewhere(robot)
        or turned_normal(rig, touch)
        or tilted_normal(log, rig, robot, touch)
        or hidden
        or tool_doubts(log, rig, robot, touch)
        or place
        or _too_loud(log, rig)
        or unfelt(rig, touch)
        or too_quiet(log, rig)
    )
    return out + _not_read(log)


def _without_wrench(log: Log, rig: Rig) -> list[str]:
    """A log without a wrench, of a rig with a sensor, where joint torques would tell the forces."""
    if log.wrench is not None or log.tau is None or rig.surface is None or by_torques(log, rig):
        return []
    return [
        "the log has no wrench, though the rig states a [sensor]: forces are unknown; name its columns in [columns], "
        "or take [sensor] out of the rig, and forces come from the joint torques"
    ]


def _elsewhere(robot: Robot) -> list[str]:
    """Gravity of a length that no place on Earth has."""
    length = float(np.linalg.norm(robot.gravity))
    if EARTH[0] <= length <= EARTH[1]:
        return []
    return [
        f"[robot] gravity is {length:.4g} m/s² long, which it is nowhere on Earth (9.76 to 9.83): correct it, "
        "unless the robot stands elsewhere"
    ]


def _too_loud(log: Log, rig: Rig) -> list[str]:
    """A noise of the sensor that is larger than all that its forces ever change by."""
    if log.wrench is None or rig.sensor.noise is None or not log.valid.any():
        return []
    noise, most = max(rig.sensor.noise[:3]), float(np.ptp(np.asarray(log.wrench)[log.valid, :3], axis=0).max())
    if not 0.0 < most < noise:
        return []
    return [
        f"[sensor] noise of {noise:.3g} N, where no force of the log changes by more than {most:.3g} N, so that "
        "nothing counts as a touch: correct it, to the standard deviation at rest in N, or take it out"
    ]


def _beyond_joints(log: Log, robot: Robot) -> list[str]:
    """Joints that leave what the robot's model allows, by more than a degree."""
    assert log.q is not None
    out = []
    if log.q.shape[1] != robot.joint_count:
        return []
    turns = whole_turns(log.q, robot)
    with np.errstate(invalid="ignore"):
        low, high = np.nanmin(log.q, axis=0), np.nanmax(log.q, axis=0)
    for j, name in enumerate(robot.joint_names):
        if low[j] < robot.lower[j] - SLACK or high[j] > robot.upper[j] + SLACK:
            mend = (
                f"check the joints' order in [robot] joints, and unit, scale (sign) and offset of q{j + 1} in [columns]"
            )
            if turns[j]:
                off = -2.0 * np.pi * turns[j]
                mend = f"whole turns bring it there, [columns] q{j + 1} = {{ offset = {off:.6g} }}"
            out.append(
                f"{name} from {low[j]:.3g} to {high[j]:.3g}, beyond its limits of {robot.lower[j]:.3g} to "
                f"{robot.upper[j]:.3g} in the robot's model: {mend}"
            )
    return out[:3]


def _beyond_range(log: Log, rig: Rig) -> list[str]:
    """Readings at or beyond the sensor's range."""
    if log.wrench is None or rig.sensor.range is None:
        return []
    size = np.abs(np.where(np.isfinite(log.wrench), log.wrench, 0.0))
    out = []
    for name, unit, most, column in zip(WRENCH, 3 * ["N"] + 3 * ["N·m"], rig.sensor.range, size.T):
        share = float(np.mean(column >= FULL * most))
        if share > 0.0:
            out.append(
                f"{name} reaches {column.max():.4g} {unit}, its range is {most:g} ({100 * share:.3g} % of samples): "
                "what is cut off is wrong; or [sensor] range is another's, or the wrench is in another unit, as "
                f"{'mN' if unit == 'N' else 'Nmm'}"
            )
    return out[:2]


def _stuck(log: Log) -> list[str]:
    """The sensor, one of its channels, or all joints stand still while others show that they were not at rest."""
    if log.wrench is None or log.q is None or len(log) < FEWEST or not log.valid.any():
        return []
    dead = constant(log.wrench)
    if dead.all():
        return [
            "the wrench never changes: was the sensor on? Name its columns in [columns] of the rig, or leave them out "
            "of the log"
        ]
    return _dead_channels(log.wrench, dead) or _frozen(log, log.q, log.wrench)


def _dead_channels(wrench: Array, dead: Mask) -> list[str]:
    """Channels that never change, (6,), beside others of their kind that show noise."""
    for names, part in ((FORCES, slice(0, 3)), (MOMENTS, slice(3, 6))):
        still = [name for name, one in zip(names, dead[part]) if one]
        # moments that are all zero stand for a sensor of forces alone
        if not still or (len(still) == 3 and not np.nan_to_num(wrench[:, part]).any()):
            continue
        live = wrench[:, part][:, ~dead[part]] if len(still) < 3 else wrench[:, ~dead]
        if all(noisy(channel) for channel in live.T):
            return [
                f"{' and '.join(still)} never change{'s' * (len(still) == 1)}, where the sensor's other channels show "
                "noise: a dead channel, or another column; name it in [columns] of the rig"
            ]
    return []


def _frozen(log: Log, q: Array, wrench: Array) -> list[str]:
    """Joints that never move while the force changes, or a wrench that repeats itself while they do."""
    largest = int(np.argmax(np.ptp(wrench[log.valid, :3], axis=0)))
    force = wrench[log.valid, largest]
    change = np.ptp(without_spikes(force[:, None]))
    if constant(q).all() and change > TOUCHED * white_noise(force) > 0.0:
        return [
            f"the joints never change, where {FORCES[largest]} does by {change:.3g} N: the robot's state was "
            "not read; record it anew, or name its columns in [columns] of the rig"
        ]
    moved = np.r_[False, (np.diff(q, axis=0) != 0.0).any(axis=1)]
    held = frozen(log.t, wrench, moved)
    if held is None or not noisy(np.asarray(wrench)[(log.t < held[0]) | (log.t > held[0] + held[1]), largest]):
        return []
    return [
        f"the wrench repeats one reading for {held[1]:.2g} s from {held[0]:.4g} s on, while the joints move: the "
        "sensor's stream stood still; leave the wrench of these rows empty, or record anew"
    ]


def left_out(log: Log, rig: Rig, robot: Robot | None) -> Step | None:
    """What isn't computed of a log with joints, because its rig has no [surface] and its robot not all frames."""
    if log.q is None or robot is None or rig.surface is not None:
        return None
    frames, name = ", ".join(robot.end_frames), robot.name
    if robot.tip_frame is None and robot.sensor_frame is None:
        what, named = "tip motion and force", "'tool_tip' and no 'ft_sensor'; name [robot] tip_frame and sensor_frame"
    elif log.wrench is not None and robot.sensor_frame is None:
        what, named = "force", "'ft_sensor'; name [robot] sensor_frame"
    elif robot.tip_frame is None:
        what, named = "tip motion (that of the sensor stands for it)", "'tool_tip'; name [robot] tip_frame"
    else:
        return None
    return Step("left out", {"quantities": what, "because": f"{name} has no {named}, of {frames}"})


def unused_offset(log: Log, rig: Rig) -> Step | None:
    """The rig's clock offset, where it is more than rounding and the log is a table, which has one clock for all."""
    offset = rig.streams.wrench_clock_offset or 0.0
    if abs(offset) < 0.5 * log.period or any("clock_offset" in step.facts for step in log.provenance.steps):
        return None
    why = "the log is a table, whose rows are of one time"
    return Step("left out", {"quantities": f"[streams] wrench_clock_offset of {offset:.4g} s", "because": why})


def _not_read(log: Log) -> list[str]:
    """Columns that nothing was read from, where the log lacks the wrench that they may be."""
    facts = [step.facts.get("ignored") for step in log.provenance.steps]
    ignored = [str(name) for names in facts if isinstance(names, list | tuple) for name in names]
    if not ignored or log.wrench is not None:
        return []
    shown = ", ".join(f"'{name}'" for name in ignored[:6]) + (", …" if len(ignored) > 6 else "")
    return [f"no wrench, and columns that nothing was read from: {shown}; if they are it, name them in [columns]"]
