"""The sensor's reading turned into the load on the tool: axes, bias, cross-talk; and the tool's own load, predicted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import Rig, ToolSpec
from kinid.errors import InputError
from kinid.robotics.joint_readings import CLEARLY, joints_meant
from kinid.robotics.motion import JointMotion
from kinid.robotics.robot import Kinematics, Robot

Array = NDArray[np.float64]
Bias = Literal["auto", "none"] | Sequence[float]

#: samples of free motion that make a bias, at least and at most: more change the median by less than the noise
FEWEST_FREE, MOST_FREE = 20, 20_000
#: how much better a wrong reading must explain gravity before it is called one (ratio of residual sums of squares),
#: and what share of the force it may leave: a tool of another mass, or a dead sensor, is no question of axes
SUSPICION, LEFT = 0.1, 0.5
#: a touch shows which way it pushes where its force is so many times what is left in free motion
PUSHES = 10.0
#: a force of no more than this share of the tool's weight is of another unit, and says nothing of axes
FAINT = 0.1
#: rows in which a touch is looked for
LOOKED_AT = 5000


@dataclass(frozen=True, eq=False)
class Reading:
    """How a raw wrench is read: true = inverse_crosstalk · (raw − bias), in sensor axes."""

    wrench: Array  # (n, 6) sensor axes; only the axes are settled, bias and cross-talk are not removed yet
    inverse_crosstalk: Array  # (6, 6)
    bias: Array  # (6,)
    facts: dict[str, object]

    def packed(self) -> Array:
        """For the kernel: inverse cross-talk row-major, then the bias, (42,)."""
        return np.concatenate([self.inverse_crosstalk.ravel(), self.bias])

    def true(self) -> Array:
        """The load on the tool as the sensor would read it without faults, (n, 6)."""
        with np.errstate(invalid="ignore"):  # an infinite sample becomes NaN; it is marked invalid already
            out: Array = (self.wrench - self.bias) @ self.inverse_crosstalk.T
        return out


def tool_load(tool: ToolSpec, motion: Kinematics, gravity: Array) -> Array:
    """What gravity and inertia put on the sensor, in sensor axes about its origin, (n, 6) [N, N·m].

    Newton-Euler of one rigid body: f = m (g − a_com), τ = com × f − (I α + ω × I ω), with a_com = a + α × c + ω × (ω ×
    c).
    """
    turn = np.swapaxes(motion.rotation, 1, 2)  # base to sensor
    com, inertia = np.asarray(tool.com), tool.inertia_matrix
    omega = np.einsum("nij,nj->ni", turn, motion.angular_velocity)
    alpha = np.einsum("nij,nj->ni", turn, motion.angular_acceleration)
    a = np.einsum("nij,nj->ni", turn, motion.acceleration - gravity)
    a_com = a + np.cross(alpha, com) + np.cross(omega, np.cross(omega, com))
    force = -tool.mass * a_com
    torque = np.cross(com, force) - alpha @ inertia.T - np.cross(omega, omega @ inertia.T)
    return np.concatenate([force, torque], axis=1)


def packed_tool(rig: Rig, robot: Robot) -> Array:
    """What the kernels want to know of the tool: mass, com, inertia about the com, gravity in base axes, (16,)."""
    tool = rig.carried
    return np.concatenate([[tool.mass], tool.com, tool.inertia_matrix.ravel(), robot.gravity])


def read_wrench(
    log: Log, rig: Rig, robot: Robot, motion: JointMotion, free: NDArray[np.int64], bias: Bias, trust: bool
) -> Reading:
    """Settle axes, sign, cross-talk and bias of a log's wrench.

    Args:
        log: with a wrench.
        rig: says what is known of the sensor and the tool.
        robot: with a sensor frame.
        motion: of the joints.
        free: rows in free motion.
        bias: "auto" takes the rig's, else the median of free motion; "none" leaves it; or six numbers [N, N·m].
        trust: don't ask whether gravity contradicts the wrench's axes and sign.

    Raises:
        InputError: no sensor frame, or a wrench that gravity in free motion contradicts.
    """
    if log.wrench is None or robot.sensor_frame is None:
        raise InputError(
            f"a wrench without the frame it is measured in ({robot.name} has no 'ft_sensor')",
            "the sensor's frame",
            f"name it in [robot] sensor_frame, at the end of the arm: {', '.join(robot.end_frames)}",
        )
    wrench = np.asarray(log.wrench)
    if rig.sensor.wrench_frame == "base":
        rotation = robot.kinematics(robot.sensor_frame, motion.q).rotation
        wrench = np.concatenate([np.einsum("nji,nj->ni", rotation, wrench[:, i : i + 3]) for i in (0, 3)], axis=1)
    crosstalk = rig.sensor.crosstalk_matrix
    inverse = np.asarray(np.linalg.inv(crosstalk), dtype=np.float64)
    offset, origin = given_bias(bias, rig)
    usable = free[log.valid[free] & np.isfinite(motion.ddq[free].sum(axis=1))]
    usable = usable[:: 1 + len(usable) // MOST_FREE]
    facts: dict[str, object] = {"free_samples_used": len(usable)}
    if len(usable) >= FEWEST_FREE:
        kinematics = robot.kinematics(robot.sensor_frame, motion.q[usable], motion.dq[usable], motion.ddq[usable])
        load = tool_load(rig.carried, kinematics, robot.gravity)
        weight = rig.carried.mass * float(np.linalg.norm(robot.gravity))
        asked = rig.tool is not None and rig.tool.mass > 0 and not trust
        if asked and float(np.sqrt(np.mean(np.sum(wrench[usable, :3] ** 2, axis=1)))) >= FAINT * weight:
            force = ((wrench[usable] - offset) @ inverse.T)[:, :3]
            refuse_contradicted(
                force,
                load[:, :3],
                kinematics.rotation,
                weight,
                rig.sensor.wrench_frame,
                log.provenance.source,
                lambda: _gravity_is_turned(Reading(wrench, inverse, offset, {}), rig, robot, motion, usable),
                lambda: joints_meant(motion.q[usable], force, robot),
            )
        if not origin:
            offset, origin = np.median(wrench[usable] - load @ crosstalk.T, axis=0), "median of free motion"
    origin = origin or "none: no free motion to learn it from"
    facts |= {
        "bias_from": origin,
        "bias": [float(b) for b in offset],
        "wrench_frame": rig.sensor.wrench_frame,
        "crosstalk": "rig" if rig.sensor.crosstalk is not None else "none",
    }
    return Reading(wrench, inverse, offset, facts)


def given_bias(bias: Bias, rig: Rig) -> tuple[Array, str]:
    """The bias that the caller or the rig names, and which of them; zeros and no name where it is to be learned."""
    if not isinstance(bias, str):
        offset = np.asarray(bias, dtype=float)
        if offset.shape != (6,) or not np.isfinite(offset).all():
            raise InputError(
                f"a bias of {list(np.ravel(offset))}", "six finite numbers fx fy fz tx ty tz", "correct it"
            )
        return offset, "given"
    if bias not in ("auto", "none"):
        raise InputError(f"bias '{bias}'", "'auto', 'none' or six numbers", "choose one of them")
    if bias == "auto" and rig.sensor.bias is not None:
        return np.asarray(rig.sensor.bias), "rig"
    return np.zeros(6), "none" if bias == "none" else ""


def refuse_contradicted(
    force: Array,
    weight: Array,
    rotation: Array,
    scale: float,
    frame: str,
    where: str,
    gravity_is_turned: Callable[[], bool | None] = lambda: None,
    meant: Callable[[], tuple[str, float] | None] = lambda: None,
) -> None:
    """Ask gravity whether the wrench has the sign and the axes of the log format.

    Four readings are tried on free motion: as it is, with the opposite sign, in the other axes, and both. With turning
    in the data each may have a bias of its own; without, gravity alone must tell, so that more contrast is asked for.

    Args:
        force: measured, sensor axes [N], (n, 3). weight: the tool's load predicted there, (n, 3).
        rotation: sensor to base, (n, 3, 3). scale: weight of the tool [N].
        frame: the axes the rig says the log has. where: the log's name.
        gravity_is_turned: asked where the sign is wrong, whether it is gravity's; None where nothing tells.
        meant: another reading of the joints, and what it leaves a sample [N²].

    Raises:
        InputError: another reading explains free motion more than ten times better.
    """
    # the rig's word on the axes has been followed: a wrench in others has been turned once too little or too often
    other, way = ("sensor", "nji,nj->ni") if frame == "base" else ("base", "nij,nj->ni")
    turned = np.einsum(way, rotation, weight)
    readings = {
        "with the opposite sign": -weight,
        f"as axes of the {other}": turned,
        f"as axes of the {other} with the opposite sign": -turned,
    }
    found = _contradicting(force, weight, readings, scale)
    if found is None:
        return
    present, errors = found
    best = min(errors, key=lambda name: errors[name])
    same = [name for name, error in errors.items() if _as_good(error, errors[best])]
    turned_sign = any("sign" in name for name in same)
    opposite = best == "with the opposite sign"
    half = _half_turn(force, weight, errors[best]) if opposite else ""
    upward = gravity_is_turned() if opposite and not half else None
    remedies = [half] if half else []
    remedies += ["turn the sign with [columns] wrench = { scale = -1 }"] if turned_sign and not (upward or half) else []
    remedies += ["correct [robot] gravity: by the way that touches push it is its sign"] if upward else []
    remedies += [f'say [sensor] wrench_frame = "{other}"'] if any("axes" in name for name in same) else []
    joints = meant()
    if joints is not None and joints[1] < min(SUSPICION * present, CLEARLY * errors[best]):
        raise InputError(
            f"joints in {where} that gravity in free motion contradicts, and explains {present / joints[1]:.3g} times "
            f"better with {joints[0]}",
            "joints whose turning is that of the tool's weight",
            f"say so in [columns] of the rig; or else {' or '.join(remedies)}; --trust-wrench passes it as it is",
        )
    raise InputError(
        f"a wrench in {where} that gravity in free motion explains {present / max(errors[best], 1e-12):.3g} times "
        f"better {' or '.join(same)}",
        f"loads on the tool in {frame} axes: at rest in the air a tool reads m·Rᵀ·g",
        f"{' or '.join(remedies)}; "
        + (
            ""
            if upward is not None
            else "a base that is tilted or hung needs [robot] gravity, touches taken for free motion "
            "a [surface] normal out of the material, joints in another unit or order [columns] q or [robot] joints; "
        )
        + "--trust-wrench passes it as it is",
    )


def _half_turn(force: Array, weight: Array, least: float) -> str:
    """What to do where a sensor that is turned by 180° leaves no more of changes than the opposite sign, and far less
    of the mean; "" elsewhere.
    """
    opposite = float(np.sum((force + weight).mean(axis=0) ** 2))
    for axis, others, signs in (("x", "yz", (1, -1, -1)), ("y", "xz", (-1, 1, -1)), ("z", "xy", (-1, -1, 1))):
        left = force - weight * signs
        if _as_good(_spread(left), least) and float(np.sum(left.mean(axis=0) ** 2)) < LEFT * opposite:
            turned = ", ".join(f"{kind}{other}" for kind in "ft" for other in others)
            return (
                f"turn the sensor by 180° about its {axis}, with [robot] sensor_frame or its rpy in the URDF, or the "
                f"signs of {turned} in [columns]"
            )
    return ""


def _contradicting(
    force: Array, weight: Array, readings: Mapping[str, Array], scale: float
) -> tuple[float, dict[str, float]] | None:
    """Mean squares that the loads of other readings leave of the force where one is far better; before, what `weight`
    leaves [N²]. None where none is.
    """
    spread, turning = _spread(weight), _spread(force)
    own = float(np.sum((force - force.mean(axis=0)) * (weight - weight.mean(axis=0)))) / len(force)
    turned_alike = own > 0.0 and turning * spread - own**2 < SUSPICION * turning * spread  # a spread may be zero
    dead = turning <= 1e-18 * float(np.mean(force**2))
    if dead or turned_alike:  # a dead sensor, or a tool of another mass: no question of axes and sign
        return None
    # turning tells, whatever the bias: it is a constant
    errors = {name: _spread(force - load) for name, load in readings.items()}
    present = _spread(force - weight)
    if spread >= (0.02 * scale) ** 2 and min(errors.values()) < SUSPICION * present:
        return present, errors
    if spread > (0.2 * scale) ** 2:
        return None
    # the little turning that there may be must not speak against a reading
    level, left = (float(np.sum(mean.mean(axis=0) ** 2)) for mean in (force, force - weight))
    means = {
        name: float(np.sum((force - load).mean(axis=0) ** 2))
        for name, load in readings.items()
        if errors[name] <= 1.1 * present
    }
    far = left >= (1.5 * scale) ** 2 and min(means.values(), default=np.inf) < min(SUSPICION * left, LEFT * level)
    return (left, means) if far else None


def _gravity_is_turned(
    reading: Reading, rig: Rig, robot: Robot, motion: JointMotion, free: NDArray[np.int64]
) -> bool | None:
    """Whether it is gravity's sign that is wrong and not the wrench's, where one of them is; None where nothing tells.

    Either way the force in free motion is the tool's predicted load turned round; but a touch then pushes out of the
    material in the one case, and into it in the other.

    Args:
        reading: of the sensor. rig: whose plane is touched. robot, motion: of the log. free: rows in free motion.
    """
    if rig.axes is None:
        return None
    rows = np.union1d(np.arange(0, len(motion.q), 1 + len(motion.q) // LOOKED_AT), free)
    kinematics = robot.kinematics(robot.sensor_frame or "", motion.q[rows], motion.dq[rows], motion.ddq[rows])
    unexplained = (reading.true()[rows] + tool_load(rig.carried, kinematics, robot.gravity))[:, :3]
    push = np.einsum("nij,nj,i->n", kinematics.rotation, unexplained, rig.axes[2])
    in_air = push[np.isin(rows, free)]
    push = push[np.isfinite(push)] - np.nanmedian(in_air)
    strongest = float(push[np.argmax(np.abs(push))])
    if abs(strongest) < PUSHES * float(np.nanstd(in_air)):
        return None
    return strongest > 0.0


def _as_good(error: float, least: float) -> bool:
    """Whether a reading leaves hardly more than the best one."""
    return error < 1.2 * least + 1e-12


def _spread(residual: Array) -> float:
    return float(np.mean(np.sum((residual - residual.mean(axis=0)) ** 2, axis=1)))
