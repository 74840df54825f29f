"""What a rig states that its own parts, or the log's readings, contradict."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot
from kinid.signal.noise import is_noise, white_noise
from kinid.signal.stuck import jumps

Array = NDArray[np.float64]

#: a tangent may stand out of the plane by so much [rad]
OUT_OF_PLANE = np.deg2rad(10.0)
#: the readings' noise is that which is stated, or less where they are filtered, up to this factor
NOISIER = 4.0
#: no joint turns further than this [rad]
FARTHEST_TURN = 8.0 * np.pi
#: a velocity is taken over so long [s]; it is beyond the limit by this factor, in more than one sample in a hundred
WINDOW, BEYOND, USUAL = 0.04, 1.5, 0.99
#: a position that jumps and returns at once does so by more than this [rad or m]; fewer samples say nothing
JUMP, FEWEST = 0.02, 10


def rig_doubts(log: Log, rig: Rig, robot: Robot) -> list[str]:
    """Sentences about the plane's tangent, the sensor's figures, the joints' limits, and jumps of the joints.

    Args:
        log: with joints. rig: what was measured with what. robot: of the rig.
    """
    return [
        *_tangent(rig),
        *_halves(rig),
        *_limits(robot),
        *_too_fast(log, robot),
        *_too_strong(log, robot),
        *_jumps(log),
    ]


def _tangent(rig: Rig) -> list[str]:
    """A first tangent that doesn't lie in the plane."""
    surface = rig.surface
    if surface is None or surface.normal is None or surface.tangent is None:
        return []
    n, t = (np.asarray(v) / np.linalg.norm(v) for v in (surface.normal, surface.tangent))
    out = float(np.arcsin(min(1.0, abs(float(n @ t)))))
    if out <= OUT_OF_PLANE:
        return []
    return [
        f"[surface] tangent stands {np.rad2deg(out):.3g}° out of the plane, and its part within is taken: correct it, "
        "or the normal"
    ]


def _halves(rig: Rig) -> list[str]:
    """Figures of forces [N] that are smaller than those of moments [N·m]: a wrist's levers are far below a metre."""
    for name, figures in (("range", rig.sensor.range), ("noise", rig.sensor.noise)):
        if figures is not None and 0.0 < max(figures[:3]) < max(figures[3:]):
            return [
                f"[sensor] {name} of up to {max(figures[:3]):.3g} N and {max(figures[3:]):.3g} N·m: forces come first, "
                "and have the larger figures; exchange them, or check the units"
            ]
    return []


def too_quiet(log: Log, rig: Rig) -> list[str]:
    """A stated noise of the forces that is far below what the readings show from sample to sample."""
    if log.wrench is None or rig.sensor.noise is None or _halves(rig):
        return []
    forces = np.asarray(log.wrench)[log.valid, :3].T
    shown = np.array([white_noise(force) if is_noise(force) else 0.0 for force in forces])
    stated = np.asarray(rig.sensor.noise[:3])
    if not (shown > NOISIER * stated).all():
        return []
    k = int(np.argmax(shown / np.maximum(stated, 1e-300)))
    return [
        f"[sensor] noise of {stated[k]:.3g} N for f{'xyz'[k]}, whose readings show {shown[k]:.3g} N from sample to "
        "sample: state the standard deviation at the log's rate, or take it out"
    ]


def _limits(robot: Robot) -> list[str]:
    """Limits of a joint that turns which are written in degrees."""
    for name, low, high in zip(robot.joint_names, robot.lower, robot.upper):
        travel = 0.5 * high - 0.5 * low  # halves: no sum of two numbers is beyond what a number can be
        if not robot.is_prismatic(name) and 0.5 * FARTHEST_TURN < travel < np.inf:
            return [
                f"{name} may turn from {low:.4g} to {high:.4g} rad by its URDF: limits there are in radians, or the "
                "joint is continuous"
            ]
    return []


def _too_fast(log: Log, robot: Robot) -> list[str]:
    """Joints that moved faster than their URDF allows."""
    q, half = np.asarray(log.q), max(1, round(0.5 * WINDOW / log.period))
    limits = robot.velocity_limit
    if q.shape[1] != len(limits) or len(q) < 8 * half:
        return []
    speed = np.abs(q[2 * half :] - q[: -2 * half]) / (log.t[2 * half :] - log.t[: -2 * half])[:, None]
    with np.errstate(invalid="ignore"):
        fast = np.nanquantile(speed, USUAL, axis=0)
    for name, limit, most in zip(robot.joint_names, limits, fast):
        if 0.0 < limit < most / BEYOND:  # a URDF without a figure reads as zero
            return [
                f"{name} moves at {most:.3g} rad/s, its URDF allows {limit:.3g}: the limit there, the unit of q or "
                "that of t is another"
            ]
    return []


def _too_strong(log: Log, robot: Robot) -> list[str]:
    """Joints whose measured torque is beyond what their URDF allows."""
    if log.tau is None:
        return []
    limits = robot.effort_limit
    tau = np.abs(np.asarray(log.tau))[log.valid]
    if tau.shape[1:] != limits.shape or not len(tau):
        return []
    for name, limit, most in zip(robot.joint_names, limits, np.quantile(tau, USUAL, axis=0)):
        if 0.0 < limit < most / BEYOND:  # a URDF without a figure reads as zero
            return [
                f"{name} bears {most:.3g} N·m, its URDF allows an effort of {limit:.3g}: the limit there, or the "
                "unit of tau, is another"
            ]
    return []


def _jumps(log: Log) -> list[str]:
    """Positions that jump and return at once, which no joint does."""
    t, q = log.t[log.valid], np.asarray(log.q)[log.valid]
    if len(q) < FEWEST:
        return []
    for j, one in enumerate(q.T):
        found = jumps(one, JUMP)
        if found is not None:
            many, row, size = found
            return [
                f"q{j + 1} jumps by {size:.3g} and returns at once ({many} sample{'s' * (many > 1)}, the largest at "
                f"{t[row]:.4g} s), which no joint does: those readings count for nothing; leave them empty, or check "
                "the line"
            ]
    return []
