"""Whether force and moment are what gravity and touches put on the rig's tool, or what else they would be.

The force in free motion is asked against the tool's load s = Rᵀ (g − a) per unit of mass, which turns with the wrist:
f = m P s + b, with a constant bias b. Its slope m is the mass that the sensor reads, and P, a permutation of the axes
with signs, says which of them are exchanged, turned or left-handed; a gravity g of another direction does so by itself.
One posture tells none of these from a bias. The moment is asked against that of the forces at their levers,
τ = com × f_tool + r_tip × f_contact, whose scale and axes a touch shows as well.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from kinid.contact.late_doubts import late_wrench
from kinid.contact.lever_doubts import BETTER, com_doubt, tip_doubt
from kinid.contact.series import ContactSeries
from kinid.contact.turned_doubts import CLEARLY, solved_gravity, turned_doubt
from kinid.contact.unit_doubts import (
    FORCES,
    LEFT,
    MASS_SHARE,
    MOMENTS,
    unit_meant,
    unit_of_forces,
    unit_of_moments,
)
from kinid.data.log import Log
from kinid.data.plausible import FORCE
from kinid.data.rig import Rig, ToolSpec
from kinid.robotics.joint_readings import joints_meant
from kinid.robotics.motion import joint_motion
from kinid.robotics.robot import Kinematics, Robot
from kinid.robotics.wrench import tool_load

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: samples of free motion, at least; more than the second number change nothing
FEWEST, MOST = 100, 2000
#: directions of the tool's weight that tell: rms of its turning, as a share of gravity
TURNING = 0.05
#: a mass is doubted beyond this share of it (`MASS_SHARE`), this much [kg], and this many standard errors
MASS_LEAST, ERRORS = 0.03, 5.0
#: no clock is slow or fast by this factor: its times are of another unit or rate
PACE = 1.25
#: masses of tools [kg]: beside one in it, another beyond it is the one that is wrong
TOOLS = (0.01, 50.0)
#: gravity is found where its standard error is below this share of it
KNOWN = 0.1
#: in one posture: a reading so many times the tool's weight, and beyond this [N], is of another unit
TIMES, LARGE = 30.0, 100.0
#: moments are on other axes where another order fits with its scale within this factor: levers are known so well
SCALE = 2.0
#: drift of a bias since it was stated, as a share of the sensor's range; which is this [N] where it isn't stated
DRIFT, STRONG = 0.01, 100.0
#: permutations of three axes with signs: index and sign of the axis that each is, (48, 3); the first changes nothing
AXES, SIGNS = (
    np.array(part) for part in zip(*product(permutations(range(3)), product((1.0, -1.0), repeat=3)), strict=True)
)


def tool_doubts(log: Log, rig: Rig, robot: Robot, touch: ContactSeries | None) -> list[str]:
    """At most one sentence: of the force in free motion, else of the moment.

    Args:
        log: with joints. rig: what was measured with what. robot: of the rig. touch: the log's contact quantities;
            None where only what is labelled free motion is known.
    """
    if log.wrench is None or log.q is None or robot.sensor_frame is None or log.q.shape[1] != robot.joint_count:
        return []
    usable = (log.valid if touch is None else touch.valid) & np.isfinite(log.wrench).all(axis=1)
    clear = log.labelled_free[usable[log.labelled_free]]
    if touch is not None and len(clear) < FEWEST:
        clear = np.flatnonzero(usable & ~touch.in_contact & (touch.depth < 0))
    free = np.zeros(len(log), np.bool_)
    free[clear] = True
    every, clear = (part[:: 1 + len(part) // MOST] for part in (np.flatnonzero(usable), clear))
    if len(every) < FEWEST:
        return []
    rows = np.union1d(every, clear)
    wrench, kinematics = _wrench(log, rig, robot, rows)
    load = tool_load(rig.carried, kinematics, robot.gravity)
    if not np.isfinite(load).all():  # joints that were not smoothed over a gap
        return []
    found, turned, tip, air = None, None, None, np.isin(rows, clear)
    if touch is not None and touch.bias is not None:
        contact = wrench[:, :3] - touch.bias[:3] - load[:, :3]
        expected = load[:, 3:] + np.cross(robot.tip_in_sensor(), contact)
        beside = wrench[:, 3:] - wrench[:, 3:].mean(axis=0), expected - expected.mean(axis=0)
        found = unit_of_moments(*beside, wrench[air, :3], load[air, :3], rig)
        turned = _turned_moments(*beside)
        pressed = touch.in_contact[rows]
        if int(pressed.sum()) >= FEWEST and wrench[:, 3:].any():  # else a sensor of forces alone
            tip = tip_doubt(contact[pressed], (wrench[:, 3:] - expected)[pressed], robot.tip_in_sensor())
    if found is None and len(clear) >= FEWEST:
        pull = tool_load(ToolSpec(mass=1.0, com=rig.carried.com), kinematics, robot.gravity)[air, :3]
        left = wrench[air, :3] - load[air, :3] - rig.sensor.stated_bias[:3]
        meant = partial(joints_meant, log.q[rows[air]], wrench[air, :3], robot)
        late = partial(late_wrench, log, free, rows[air], pull) if rig.sensor.wrench_frame != "base" else lambda: None
        found = _doubt_in_air(wrench[air], pull, kinematics.rotation[air], rig, robot.gravity, meant, late, turned)
        used = rig.sensor.bias if touch is None or touch.bias is None else tuple(touch.bias)
        stated = rig.sensor.bias is not None and used == rig.sensor.bias
        found = _of_bias(left, pull, rig) if found is None and stated else found
    found = found or turned or tip
    return [] if found is None else [found]


def _wrench(log: Log, rig: Rig, robot: Robot, rows: Rows) -> tuple[Array, Kinematics]:
    """Force and moment in sensor axes, (n, 6), and the sensor's motion, at these rows.

    Cross-talk stays in: it is too small to matter here, and takes a wrong unit of the moments into the forces.
    """
    motion = joint_motion(log, robot)
    kinematics = robot.kinematics(robot.sensor_frame or "", motion.q[rows], motion.dq[rows], motion.ddq[rows])
    wrench = np.asarray(log.wrench)[rows]
    if rig.sensor.wrench_frame == "base":
        wrench = np.einsum("nji,nkj->nki", kinematics.rotation, wrench.reshape(-1, 2, 3)).reshape(-1, 6)
    return wrench, kinematics


def _doubt_in_air(
    wrench: Array,
    load: Array,
    rotation: Array,
    rig: Rig,
    gravity: Array,
    meant: Callable[[], tuple[str, float] | None],
    late: Callable[[], tuple[str, float] | None],
    turned_moments: str | None,
) -> str | None:
    """Whether force and moment in free motion are the load of the rig's tool; of a rig without one, whether the force
    is the weight of one, for a controller may have taken that off.

    Args:
        wrench: measured, in sensor axes, (n, 6). load: of 1 kg at the tool's com, there [N], (n, 3). rotation: sensor
            to base, (n, 3, 3). rig: with a tool. gravity: in base axes [m/s²], (3,). meant: another reading of the
            joints, and what it leaves a sample [N²]; None where none is better. late: another time of the wrench,
            alike. turned_moments: another order of the moments that touches show, too.
    """
    mass, force, moment = rig.carried.mass, wrench[:, :3], wrench[:, 3:]
    turning, still = load - load.mean(axis=0), np.einsum("nji,j->ni", rotation, gravity)
    still -= still.mean(axis=0)
    if np.sqrt(np.mean(np.sum(still**2, axis=1))) < TURNING * np.linalg.norm(gravity):
        return _of_level(force, gravity, rig)
    force = force - force.mean(axis=0)
    if rig.tool is None:
        return _of_mass(force, turning, still, rig)
    order, order_left = _order(force, turning, FORCES)
    found, gravity_left = _gravity(force, load, rotation, gravity, mass)
    if order is not None and found is not None:
        order = None if gravity_left * CLEARLY < order_left else order
        found = None if order_left * CLEARLY < gravity_left else found
    turned = turned_doubt(force, load, rotation, gravity)
    turned_left = np.inf if turned is None else turned[1]
    others = min(order_left, gravity_left, turned_left)
    asks = "gravity in free motion asks for other joints: say so in [columns] of the rig, "
    for words, other in ((asks, meant()), ("", late())):
        if other is not None and other[1] * len(force) < CLEARLY * others:
            return words + other[0]
    if order is not None:
        also = ", or [robot] gravity" if found is not None else ""
        return f"gravity in free motion is explained {order}, or correct [robot] sensor_frame{also}"
    if found is not None:
        measured, stated = (", ".join(f"{x:.2g}" for x in vector) for vector in (found, gravity))
        return (
            f"gravity in free motion points along [{measured}] m/s² in the base frame, not along [{stated}]: correct "
            "[robot] gravity"
        )
    return (
        (None if turned is None else turned[0])
        or unit_of_forces(force, moment - moment.mean(axis=0), turning, rig)
        or turned_moments
        or com_doubt(force, moment - moment.mean(axis=0), turning, still, rig)
        or _of_pace(force, turning, still, mass)
        or _of_mass(force, turning, still, rig)
    )


def _of_level(force: Array, gravity: Array, rig: Rig) -> str | None:
    """Whether the force in one posture, (n, 3), is far beyond the weight of the rig's tool."""
    level = float(np.linalg.norm(np.median(force, axis=0)))
    weight = rig.carried.mass * float(np.linalg.norm(gravity))
    if rig.tool is None or rig.sensor.bias is not None or level <= max(TIMES * weight, LARGE):
        return None
    return (
        f"{level:.3g} N in free motion, where the tool weighs {weight:.3g} N: is the wrench in another unit? "
        'Say so in [columns] of the rig: wrench = { unit = "mN" }; or correct [tool] mass'
    )


def _turned_moments(moment: Array, expected: Array) -> str | None:
    """Whether moments are those of the forces in another order or with other signs, (n, 3) both without their means."""
    order, _ = _order(moment, expected, MOMENTS, SCALE)
    of = "the moments of the forces at the tool's com and tip"
    return None if order is None else f"{of} are explained {order}, or correct [robot] tip_frame"


def _order(readings: Array, expected: Array, names: tuple[str, ...], scale: float = np.inf) -> tuple[str | None, float]:
    """Another order or sign of the axes that explains readings far better, in words, and what it leaves of them.

    Only one that nothing else equals is named as it is; of a tool that turns about one axis several may be as good.

    Args:
        readings, expected: both without their means, (n, 3); the first are a multiple of the second.
        names: of the axes. scale: factor within which that multiple is to be near 1.

    Returns:
        None and infinity where there is none.
    """
    whole, size = float(np.sum(readings**2)), float(np.sum(expected**2))
    products = readings.T @ expected
    slopes = np.sum(products[range(3), AXES] * SIGNS, axis=1) / max(size, 1e-300)
    left = whole - np.maximum(slopes, 0.0) ** 2 * size
    best, least = int(np.argmin(left)), max(float(left.min()), 1e-12 * whole)
    axes, signs, as_is = AXES[best], SIGNS[best], float(left[0])  # the first is the one as it stands
    if best == 0 or least > min(BETTER * as_is, LEFT * whole) or not 1.0 / scale <= slopes[best] <= scale:
        return None, np.inf
    alone = int(np.sum(left < CLEARLY * least)) == 1
    handed = np.linalg.det(np.eye(3)[axes] * signs) < 0
    shown = ", ".join(
        f"{names[i]} is {'−' if sign < 0 else ''}{names[k]}" for i, (k, sign) in enumerate(zip(axes, signs))
    )
    return (
        f"{as_is / least:.3g} times better where "
        + (shown if alone else f"axes are exchanged or turned, as {shown}")
        + (", which is left-handed" if handed and alone else "")
        + ": name forces and torques in their order in [columns] of the rig, with scale = -1 where one is turned"
    ), least


def _gravity(force: Array, load: Array, rotation: Array, gravity: Array, mass: float) -> tuple[Array | None, float]:
    """Gravity in base axes that explains the force in free motion far better than the rig's, and what it leaves.

    Args:
        force: without its mean, (n, 3). load: of 1 kg under the rig's gravity, (n, 3). rotation: sensor to base,
            (n, 3, 3). gravity: of the rig. mass: of the tool.

    Returns:
        Gravity [m/s²], (3,), and a sum of squares; None and infinity where there is none.
    """
    solved = solved_gravity(force, load, rotation, gravity, mass)
    if solved is None:
        return None, np.inf
    found, left, covariance = solved
    turning = load - load.mean(axis=0)
    slope = max(float(np.sum(force * turning)) / float(np.sum(turning**2)), 0.0)
    as_is = float(np.sum((force - slope * turning) ** 2))
    # samples of a slow motion hang together: they count as a few independent ones
    error = float(np.sqrt(left / (3.0 * FEWEST) * covariance.diagonal().max()))
    known = error < KNOWN * float(np.linalg.norm(gravity))
    return (found, left) if known and left < BETTER * as_is else (None, np.inf)


def _of_pace(force: Array, load: Array, still: Array, mass: float) -> str | None:
    """Whether the tool's weight is as the rig says, and its inertia that of accelerations by another clock.

    Noise of the accelerations makes the inertia seem smaller, too, but leaves most of what it does unexplained.

    Args:
        force, load, still: as of `_of_mass`. mass: of the rig [kg].
    """
    parts = np.stack([still.ravel(), (load - still).ravel()], axis=1)
    weighed, moved = np.linalg.lstsq(parts, force.ravel(), rcond=None)[0]
    inertial = force.ravel() - weighed * parts[:, 0]
    rest = inertial - moved * parts[:, 1]
    if (
        abs(weighed - mass) > max(MASS_SHARE * mass, MASS_LEAST)
        or min(weighed, moved) <= 0.0
        or abs(np.log(moved / weighed)) < 2.0 * np.log(PACE)
        or rest @ rest > BETTER * (inertial @ inertial)
    ):
        return None
    return (
        f"in free motion the tool weighs what the rig says, and its inertia is {moved / weighed:.3g} times that of the "
        f"joints' accelerations, as if all times were {np.sqrt(weighed / moved):.3g} times as long: correct unit or "
        "scale of t in [columns], or [tool] com"
    )


def _of_mass(force: Array, load: Array, still: Array, rig: Rig) -> str | None:
    """What the change of the force says, (n, 3), beside that of the load of 1 kg, (n, 3).

    The weight alone, `still`, is the instrument: noise of the accelerations would make the load larger and the mass
    smaller than they are (W. A. Fuller, Measurement Error Models, 1987, 1.4).
    """
    shared = float(np.sum(load * still))
    mass, size = rig.carried.mass, shared**2 / float(np.sum(still**2))
    read = float(np.sum(force * still)) / shared
    left = force - read * load
    # samples of a slow motion hang together: the error of each axis is taken for one of a few independent ones
    error = float(np.sqrt(np.mean(left**2) * 3.0 / size * max(len(load) / FEWEST, 1.0)))
    if abs(read - mass) <= max(MASS_SHARE * mass, MASS_LEAST, ERRORS * error):
        return None
    unexplained = float(np.sum(left**2)) / float(np.sum(force**2))
    reads = f"in free motion the sensor reads a tool of {read:.3g} ± {2 * error:.2g} kg, the rig"
    if rig.tool is None:
        # what a controller has left of a weight that it took off is small, and of any direction
        return None if unexplained > LEFT or read < 0.0 else f"{reads} has no [tool]: state its mass and com"
    correct = f"{reads} says {mass:g} kg: correct [tool] mass"
    unit = unit_meant(read / mass, rig, ("wrench", "fx"), FORCE) if mass > 0.0 else None
    if unexplained > LEFT:
        return (
            f"{correct}; this leaves {100 * unexplained:.2g} % of its changes: or the joints are of another unit, "
            "order or sign, or of another time than the wrench"
        )
    if unit is None or not TOOLS[0] <= mass <= TOOLS[1]:
        return f"{correct}; or the tool's parts beyond the sensor are others, or the sensor's gain is"
    if TOOLS[0] <= read <= TOOLS[1]:
        return f'{correct}; or, if the wrench is in {unit}, say so in [columns]: wrench = {{ unit = "{unit}" }}'
    return (
        f"in free motion the sensor reads {read / mass:.3g} times the tool's weight: the wrench is in {unit}? "
        f'Say so in [columns] of the rig: wrench = {{ unit = "{unit}" }}'
    )


def _of_bias(left: Array, load: Array, rig: Rig) -> str | None:
    """Whether a steady force is left in free motion, (n, 3), beside the tool's load and the bias that the rig states.

    Sensors drift by some of their range, and a tool's mass isn't known to the last gram.

    Args:
        load: of 1 kg, (n, 3).
    """
    assert rig.sensor.bias is not None
    level, pull, mass = np.median(left, axis=0), np.median(load, axis=0), rig.carried.mass
    full = np.asarray(rig.sensor.range or 6 * (STRONG,))[:3]
    slack = (MASS_SHARE * mass + MASS_LEAST) * np.linalg.norm(pull) + DRIFT * full
    size = float(np.linalg.norm(level))
    if (np.abs(level) <= slack).all() or np.sqrt(np.mean((left - level) ** 2)) > LEFT * size:
        return None
    bias = ", ".join(f"{b:.3g}" for b in level + rig.sensor.bias[:3])
    more = float(level @ pull / (pull @ pull))
    heavier = np.linalg.norm(level - more * pull) < LEFT * size and TOOLS[0] <= mass + more <= TOOLS[1]
    return (
        f"{size:.3g} N is left in free motion beside the tool's load and the stated bias: correct [sensor] bias, as "
        f"[{bias}, …], or take it out and it is learnt from free motion"
        + (f"; or [tool] mass, as {mass + more:.3g} kg would explain it" if heavier else "")
    )
