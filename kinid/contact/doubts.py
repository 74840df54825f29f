"""What speaks against a log and its rig together, before any model of the material: a sentence each, with its remedy.

The force in free motion is asked against the tool's load s = Rᵀ (g − a) per unit of mass, which turns with the wrist:
f = m P s + b, with a constant bias b. Its slope m is the mass that the sensor reads, and P, a permutation of the axes
with signs, says which of them are exchanged, turned or left-handed. One posture tells none of these from a bias.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig, ToolSpec
from kinid.robotics.motion import joint_motion
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load

Array = NDArray[np.float64]

#: no tool pokes deeper than this [m]
DEEPEST = 0.3
#: share of the sensor's range beyond which a reading is cut off or of another unit
FULL = 0.99
#: time between samples of a log of touches [s] beyond which its unit is doubted
SLOWEST = 0.2
#: samples of free motion, at least; more than the second number change nothing
FEWEST, MOST = 100, 5000
#: directions of the tool's weight that tell: rms of its turning, as a share of gravity
TURNING = 0.05
#: a mass is doubted beyond this share of it, this much [kg], and this many standard errors
MASS_SHARE, MASS_LEAST, ERRORS = 0.1, 0.03, 5.0
#: another order of the axes explains free motion so many times better (ratio of residual sums of squares)
BETTER = 0.1
#: in one posture: a reading so many times the tool's weight, and beyond this [N], is of another unit
TIMES, LARGE = 30.0, 100.0
#: factors of units of force, and how [columns] states them
UNITS = {1e3: "mN", 1e-3: "kN", 1 / 9.80665: "kgf", 1e3 / 9.80665: "gf", 1 / 4.4482216: "lbf"}
AXES = ("fx", "fy", "fz")


def contact_doubts(log: Log, rig: Rig, robot: Robot | None, touch: ContactSeries | None) -> list[str]:
    """Sentences about units, axes, limits and the tool of a log with joints; none for one that states contact itself.

    Args:
        log: raw samples. rig: what was measured with what. robot: of the rig. touch: contact quantities, if any.
    """
    if log.q is None or robot is None:
        return []
    out = [*_beyond_joints(log, robot), *_beyond_range(log, rig)]
    if touch is not None:
        deepest = float(np.nanmax(touch.depth)) if np.isfinite(touch.depth).any() else 0.0
        if deepest > DEEPEST:
            out.append(
                f"the tip is {deepest:.3g} m inside the surface: check [surface] point and normal, which points out of "
                "the material, and [robot] tip_frame"
            )
        if log.period > SLOWEST and len(log) > FEWEST and touch.in_contact.any():
            out.append(
                f"{log.period:.3g} s between samples of a touch: is the time in another unit? Say so in [columns] of "
                'the rig: t = { unit = "ms" }'
            )
        out += _free_motion(log, rig, robot, touch)
    return out + _not_read(log)


def _beyond_joints(log: Log, robot: Robot) -> list[str]:
    """Joints that leave what the robot's model allows, by more than a degree."""
    assert log.q is not None
    out, slack = [], np.deg2rad(1.0)
    if log.q.shape[1] != robot.joint_count:
        return []
    with np.errstate(invalid="ignore"):
        low, high = np.nanmin(log.q, axis=0), np.nanmax(log.q, axis=0)
    for j, name in enumerate(robot.joint_names):
        if low[j] < robot.lower[j] - slack or high[j] > robot.upper[j] + slack:
            out.append(
                f"{name} from {low[j]:.3g} to {high[j]:.3g}, beyond its limits of {robot.lower[j]:.3g} to "
                f"{robot.upper[j]:.3g} in the robot's model: check the joints' order in [robot] joints, and unit, "
                f"scale (sign) and offset of q{j + 1} in [columns]"
            )
    return out[:3]


def _beyond_range(log: Log, rig: Rig) -> list[str]:
    """Readings at or beyond the sensor's range."""
    if log.wrench is None or rig.sensor.range is None:
        return []
    size = np.abs(np.where(np.isfinite(log.wrench), log.wrench, 0.0))
    out = []
    for name, unit, most, column in zip((*AXES, "tx", "ty", "tz"), 3 * ["N"] + 3 * ["N·m"], rig.sensor.range, size.T):
        share = float(np.mean(column >= FULL * most))
        if share > 0.0:
            out.append(
                f"{name} reaches {column.max():.4g} {unit}, its range is {most:g} ({100 * share:.2g} % of samples): "
                "what is cut off is wrong; or [sensor] range is another's, or the wrench is in another unit, as "
                f"{'mN' if unit == 'N' else 'Nmm'}"
            )
    return out[:2]


def _free_motion(log: Log, rig: Rig, robot: Robot, touch: ContactSeries) -> list[str]:
    """Whether the force in free motion is the load of the rig's tool."""
    tool = rig.tool
    if log.wrench is None or robot.sensor_frame is None or tool is None or tool.mass <= 0:
        return []
    clear = ~touch.in_contact & touch.valid & (touch.depth < 0) & np.isfinite(log.wrench).all(axis=1)
    rows = np.flatnonzero(clear)
    if len(rows) < FEWEST:
        return []
    rows = rows[:: 1 + len(rows) // MOST]
    motion = joint_motion(log, robot)
    kinematics = robot.kinematics(robot.sensor_frame, motion.q[rows], motion.dq[rows], motion.ddq[rows])
    load = tool_load(ToolSpec(mass=1.0, com=tool.com), kinematics, robot.gravity)[:, :3]
    force = np.asarray(log.wrench)[rows, :3]
    if rig.sensor.wrench_frame == "base":
        force = np.einsum("nji,nj->ni", kinematics.rotation, force)
    weight = tool.mass * float(np.linalg.norm(robot.gravity))
    turning = load - load.mean(axis=0)
    if np.sqrt(np.mean(np.sum(turning**2, axis=1))) < TURNING * np.linalg.norm(robot.gravity):
        level = float(np.linalg.norm(np.median(force, axis=0)))
        if rig.sensor.bias is None and level > max(TIMES * weight, LARGE):
            return [
                f"{level:.3g} N in free motion, where the tool weighs {weight:.3g} N: is the wrench in another unit? "
                'Say so in [columns] of the rig: wrench = { unit = "mN" }'
            ]
        return []
    return _of_turning(force - force.mean(axis=0), turning, tool.mass)


def _of_turning(force: Array, load: Array, mass: float) -> list[str]:
    """What the change of the force says, (n, 3), beside that of the load of 1 kg, (n, 3)."""
    order = _order(force, load, mass)
    if order is not None:
        return [order]
    size = float(np.sum(load**2))
    read = float(np.sum(force * load)) / size
    left = force - read * load
    # samples of a slow motion hang together: the error of each axis is taken for one of a few independent ones
    error = float(np.sqrt(np.mean(left**2) * 3.0 / size * max(len(load) / FEWEST, 1.0)))
    if abs(read - mass) <= max(MASS_SHARE * mass, MASS_LEAST, ERRORS * error):
        return []
    for times, unit in UNITS.items():
        if abs(read / (times * mass) - 1.0) < MASS_SHARE:
            return [
                f"in free motion the sensor reads {read / mass:.3g} times the tool's weight: the wrench is in {unit}? "
                f'Say so in [columns] of the rig: wrench = {{ unit = "{unit}" }}'
            ]
    return [
        f"in free motion the sensor reads a tool of {read:.3g} ± {2 * error:.2g} kg, the rig says {mass:g} kg: correct "
        "[tool] mass; or the tool's parts beyond the sensor are others, or the sensor's gain is"
    ]


def _order(force: Array, load: Array, mass: float) -> str | None:
    """Another order or sign of the axes that explains free motion far better, in words; None where there is none.

    Only one that nothing else equals is named; of a tool that turns about one axis several may be as good.
    """
    as_is = float(np.sum((force - mass * load) ** 2))
    errors = {}
    for axes in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            errors[axes, signs] = float(np.sum((force - mass * load[:, axes] * signs) ** 2))
    (axes, signs), least = min(errors.items(), key=lambda pair: pair[1])
    if least > BETTER * as_is or (axes == (0, 1, 2) and min(signs) > 0):
        return None
    names = ", ".join(
        f"{AXES[i]} is {'−' if sign < 0 else ''}{AXES[k]}" for i, (k, sign) in enumerate(zip(axes, signs))
    )
    alone = sum(error < 2.0 * least + 1e-12 for error in errors.values()) == 1
    handed = np.linalg.det(np.eye(3)[list(axes)] * np.array(signs)) < 0
    return (
        f"gravity in free motion is explained {as_is / max(least, 1e-12):.3g} times better where "
        + (names if alone else f"axes are exchanged or turned, as {names}")
        + (", which is left-handed" if handed and alone else "")
        + ": name forces and torques in their order in [columns] of the rig, with scale = -1 where one is turned, or "
        "correct [robot] sensor_frame"
    )


def _not_read(log: Log) -> list[str]:
    """Columns that nothing was read from, where the log lacks the wrench that they may be."""
    facts = [step.facts.get("ignored") for step in log.provenance.steps]
    ignored = [str(name) for names in facts if isinstance(names, list | tuple) for name in names]
    if not ignored or log.wrench is not None:
        return []
    shown = ", ".join(f"'{name}'" for name in ignored[:6]) + (", …" if len(ignored) > 6 else "")
    return [f"no wrench, and columns that nothing was read from: {shown}; if they are it, name them in [columns]"]
