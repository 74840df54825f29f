"""Whether one channel of the wrench is in another unit than its fellows, as fz in mN beside fx and fy in N.

Three things tell it, and each says which channel is the one: the weight of the tool, which turns with the wrist, axis
by axis; in touches the moments of the forces at their levers, τ = com × f_tool + r_tip × f_contact; and the noise from
reading to reading beside the one that the rig states. What all channels have in common, `tool_doubts` asks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.contact.touching import REACH
from kinid.contact.unit_doubts import FORCES, LEFT, MOMENTS, OWN, in_proportion, say_units, unit_meant
from kinid.data.log import Log
from kinid.data.plausible import FORCE, TORQUE
from kinid.data.rig import WRENCH, Rig
from kinid.robotics.motion import joint_motion
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load
from kinid.signal.noise import LOOKED_AT, is_noise, white_noise

Array = NDArray[np.float64]

#: samples of free motion, or of touches, at least; more than the second number change nothing
FEWEST, MOST = 100, 2000
#: an axis tells the tool's weight where that turns about it by this share of itself, as a standard deviation
TURNING = 0.02
#: an axis of the moment counts that is more than this share of the largest
LARGE_AXIS = 0.2
#: noise is that which is stated within this factor, as it is of filtered readings, and times a unit where it is not
NOISIER = 4.0
#: units that the noise of a channel alone tells
USUAL = {**dict.fromkeys(FORCES, ("N", "mN", "kN")), **dict.fromkeys(MOMENTS, ("Nm", "Nmm", "kNm"))}


class _Apart(NamedTuple):
    """Channels that are so many times what is expected of them, in words what that is, and their units."""

    times: dict[str, float]
    what: str
    units: dict[str, str]


def one_unit(log: Log, rig: Rig, robot: Robot, touch: ContactSeries | None) -> list[str]:
    """At most one sentence.

    Args:
        log: with joints. rig: what was measured with what. robot: of the rig. touch: the log's contact quantities; None
            where only what is labelled free motion is known.
    """
    if log.wrench is None or log.q is None or log.q.shape[1] != robot.joint_count or not log.valid.any():
        return []
    some = np.asarray(log.wrench)[np.flatnonzero(log.valid)[:LOOKED_AT]]
    found = _by_weight_and_levers(log, rig, robot, touch) or _by_noise(some, rig)
    if found is None:
        return []
    times = " and ".join(f"{name} is {factor:.3g}" for name, factor in found.times.items())
    return [f"{times} times {found.what}, the others aren't: another unit? {say_units(found.units)}"]


def _by_weight_and_levers(log: Log, rig: Rig, robot: Robot, touch: ContactSeries | None) -> _Apart | None:
    """What the tool's weight says in free motion; else what the levers of the forces do in touches."""
    if robot.sensor_frame is None or rig.sensor.wrench_frame == "base":
        return None
    valid = log.valid if touch is None else touch.valid
    air = log.labelled_free[valid[log.labelled_free]]
    if len(air) < FEWEST and touch is not None:
        air = np.flatnonzero(valid & (touch.depth < -REACH))
    if len(air) < FEWEST:
        return None
    wrench, load = _loads(log, rig, robot, air)
    if not np.isfinite(load).all():  # joints that were not smoothed over a gap
        return None
    slopes = _slopes(wrench[:, :3], load[:, :3])
    found = _of_weight(slopes, FORCES, FORCE, rig)
    found = found or _of_weight(_slopes(wrench[:, 3:], load[:, 3:]), MOMENTS, TORQUE, rig)
    if found is not None or touch is None or not wrench[:, 3:].any():  # else a sensor of forces alone
        return found
    bias = np.median(wrench[:, :3] - load[:, :3], axis=0)
    inside = np.flatnonzero(valid & (touch.depth > 0.0))
    if len(inside) < FEWEST:
        return None
    wrench, load = _loads(log, rig, robot, inside)
    contact = wrench[:, :3] - bias - load[:, :3]
    return _of_levers(contact, wrench[:, 3:], load[:, 3:], robot.tip_in_sensor(), slopes, rig)


def _loads(log: Log, rig: Rig, robot: Robot, rows: NDArray[np.int64]) -> tuple[Array, Array]:
    """The wrench, and the load of the rig's tool, at some of these rows, both (m, 6)."""
    rows = rows[:: 1 + len(rows) // MOST]
    motion = joint_motion(log, robot)
    kinematics = robot.kinematics(robot.sensor_frame or "", motion.q[rows], motion.dq[rows], motion.ddq[rows])
    return np.asarray(log.wrench)[rows], tool_load(rig.carried, kinematics, robot.gravity)


def _slopes(measured: Array, load: Array) -> dict[int, float]:
    """How many times the tool's load each axis reads whose changes are in proportion to it, both (n, 3)."""
    out = {}
    for k in range(3):
        readings, expected = measured[:, k] - measured[:, k].mean(), load[:, k] - load[:, k].mean()
        size, whole = float(expected @ expected), float(readings @ readings)
        least = len(load) * (TURNING * float(np.sqrt(np.mean(np.sum(load**2, axis=1))))) ** 2
        slope = float(readings @ expected) / size if size > least > 0.0 else 0.0
        if slope > 0.0 and whole - slope**2 * size <= LEFT * whole:
            out[k] = slope
    return out


def _own(times: float) -> bool:
    """Whether so many times what is expected is what is expected."""
    return 1.0 / OWN < times < OWN


def _of_weight(slopes: dict[int, float], names: tuple[str, ...], every: tuple[str, ...], rig: Rig) -> _Apart | None:
    """Axes that read a multiple of the tool's weight, or of its moment at the com, that one of the units gives, where
    others read it as it is, or nearly so: these tell how well it is known.
    """
    own = [slope for slope in slopes.values() if _own(slope)]
    apart = {names[k]: slope / float(np.median(own)) for k, slope in slopes.items() if own and not _own(slope)}
    units = {name: unit_meant(slope, rig, (name, "wrench"), every) for name, slope in apart.items()}
    known = {name: unit for name, unit in units.items() if unit is not None}
    if not known or len(known) < len(apart) or len(apart) == len(slopes):
        return None
    return _Apart(apart, "the tool's weight in free motion", known)


def _of_levers(
    contact: Array, moment: Array, own: Array, tip: Array, slopes: dict[int, float], rig: Rig
) -> _Apart | None:
    """One axis of the moments of touches that is a multiple of what the forces do at the tip, or the force behind it.

    Args:
        contact, moment, own: of touches, (n, 3): forces at the tip, moments, and those of the tool's own load.
        tip: from the sensor [m], (3,). slopes: of the axes of the force by the tool's weight. rig: says what units were
            stated.
    """
    parts = np.stack([np.cross(tip, axis) * contact[:, [k]] for k, axis in enumerate(np.eye(3))])
    parts -= parts.mean(axis=1, keepdims=True)  # of each force, (3, n, 3)
    expected = parts.sum(axis=0) + own - own.mean(axis=0)
    moment = moment - moment.mean(axis=0)
    sizes = np.sqrt(np.mean(expected**2, axis=0))
    read = np.sqrt(np.mean(moment**2, axis=0))
    # an axis counts by what is expected or by what is read: a force of a small unit hides all others in the first
    large = [k for k in range(3) if sizes[k] > LARGE_AXIS * sizes.max() or read[k] > LARGE_AXIS * read.max()]
    times = {k: in_proportion(moment[:, k], expected[:, k]) for k in large}
    good = [k for k in large if times[k] is None and _explains(moment[:, k], expected[:, k])]
    apart = {k: slope for k, slope in times.items() if slope is not None}
    if len(apart) != 1 or not good:
        return None
    ((axis, slope),) = apart.items()
    behind = int(np.argmax(np.sum(parts[:, :, axis] ** 2, axis=1)))
    weighed = slopes.get(behind)
    # one force makes one moment, so that either may be wrong: its weight tells, else the smaller unit was forgotten
    of_force = weighed is None and slope < 1.0
    name, factor = (FORCES[behind], 1.0 / slope) if of_force else (MOMENTS[axis], slope)
    unit = unit_meant(factor, rig, (name, "wrench"), FORCE if of_force else TORQUE, USUAL[name])
    what = "what the moments of touches say" if of_force else "the moment of the forces at the tool's com and tip"
    return None if unit is None else _Apart({name: factor}, what, {name: unit})


def _explains(readings: Array, expected: Array) -> bool:
    """Whether readings are what is expected, both (n,) without their means, within a factor."""
    size, whole = float(expected @ expected), float(readings @ readings)
    slope = float(readings @ expected) / size if size > 0.0 else 0.0
    return 1.0 / OWN**2 < slope < OWN**2 and whole - slope**2 * size <= LEFT * whole


def _by_noise(wrench: Array, rig: Rig) -> _Apart | None:
    """One channel whose noise is as far from the stated one as a unit, where that of the others is the stated one.

    Where none is stated, the fellows of a channel, three forces or three moments, have a noise of one size.
    """
    shown = {name: white_noise(channel) for name, channel in zip(WRENCH, wrench.T) if is_noise(channel)}
    shown = {name: size for name, size in shown.items() if size > 0.0}
    what = "the noise that [sensor] states for it"
    stated: dict[str, float] = {} if rig.sensor.noise is None else dict(zip(WRENCH, rig.sensor.noise))
    for kind in (FORCES, MOMENTS):
        if rig.sensor.noise is None and all(name in shown for name in kind):
            what = "the noise of its fellows"
            stated |= dict.fromkeys(kind, float(np.median([shown[name] for name in kind])))
    times = {name: size / stated[name] for name, size in shown.items() if stated.get(name, 0.0) > 0.0}
    apart = {name: factor for name, factor in times.items() if not 1.0 / NOISIER < factor < NOISIER}
    if len(apart) != 1 or len(times) < 3:
        return None
    ((name, factor),) = apart.items()
    unit = unit_meant(factor, rig, (name, "wrench"), (), USUAL[name], NOISIER)
    return None if unit is None else _Apart({name: factor}, what, {name: unit})
