"""What can't work is said before anything runs: places out of reach, limits of joints and torques, gains that ring."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import is_number, is_positive
from kinid.errors import InputError
from kinid.kernels.kernel import kernel
from kinid.lab.arm import Gains, design_damping, spectral_radius

if TYPE_CHECKING:
    from kinid.lab.setup import Setup

Array = NDArray[np.float64]

#: how many set-points a second are tried
CHECKS = 10
#: the arm's controller takes translational stiffness up to this [N/m]
GREATEST_STIFFNESS = 5200.0
#: rounding moves eigenvalues of motions without stiffness off the unit circle by so little
STEADY = 1.0 + 1e-6


def check(setup: Setup) -> Array:
    """Refuse what can't work; the joints at the first set-point, chain's order, (N,).

    Raises:
        InputError: a surface that faces away or lies behind the robot, targets out of reach or beside the piece, limits
            of joints, speeds, torques or the sensor, gains that are no numbers or with which arm and controller are
            unstable.
    """
    gains, script = setup.gains, setup.script
    check_gains(gains)
    _check_numbers(script.place, script.tilt)
    _check_surface(setup)
    touched = script.place[script.touching, :2]
    if not np.abs(touched).max(initial=0.0) <= setup.material.side / 2:
        x, y = touched[int(np.abs(touched).max(axis=1).argmax())]
        raise InputError(
            f"a path through ({1e3 * x:.0f}, {1e3 * y:.0f}) mm, beside the {setup.material.name}",
            f"places within ±{500 * setup.material.side:.0f} mm",
            "make the motion or the grid smaller",
        )
    stride = max(1, int(1 / (CHECKS * gains.period)))
    rows = np.unique(np.append(np.arange(0, len(script.t), stride), len(script.t) - 1))
    in_log = script.joints(rows, setup.robot, setup.axes, np.asarray(setup.point), setup.start)
    _check_speeds(setup, in_log, rows)
    q = in_log[:, setup.arm.columns]
    deepest = q[int(np.argmax(script.place[rows, 2]))]
    _check_stability(setup, q[0], deepest)
    _check_friction(setup, deepest)
    _check_torques(setup, q, rows)
    q0: Array = q[0]
    return q0


def check_gains(gains: Gains) -> None:
    """Refuse gains that are no numbers.

    Raises:
        InputError: which.
    """
    for name, value in (
        ("translational stiffness", gains.translation),
        ("rotational stiffness", gains.rotation),
        ("damping ratio", gains.ratio),
        ("control period", gains.period),
    ):
        if not is_positive(value):
            raise InputError(f"a {name} of {value}", "a positive number", "correct it")
    if not (is_number(gains.null) and gains.null >= 0):
        raise InputError(f"a null-space damping of {gains.null}", "a number that isn't negative", "correct it")


def _check_numbers(place: Array, tilt: Array) -> None:
    if not (np.isfinite(place).all() and np.isfinite(tilt).all()):
        raise InputError("set-points that are no numbers", "finite places and tilts", "correct the script")
    if len(place) < 2:
        raise InputError(f"{len(place)} set-points", "a motion", "give at least two")


def _check_surface(setup: Setup) -> None:
    robot, point = setup.robot, np.asarray(setup.point)
    stretched = robot.kinematics(robot.tip_frame or "", np.zeros((1, robot.joint_count))).position[0]
    shoulder = np.array([0.0, 0.0, 0.3 * stretched[2]])  # about a third up the stretched arm
    if setup.axes[2] @ (shoulder - point) <= 0.0:
        raise InputError(
            f"a surface at {_shown(setup.point)} with its normal {_shown(setup.normal)} turned away from the arm",
            "a surface that the arm stands in front of",
            "turn the normal, or move the surface",
        )
    limit = robot.upper[0]
    if abs(setup.start[0]) > limit:
        raise InputError(
            f"a surface at {_shown(setup.point)}, behind the robot ({np.degrees(setup.start[0]):.0f}°)",
            f"one within ±{np.degrees(limit):.0f}° of the front",
            "move the surface",
        )


def _check_speeds(setup: Setup, q: Array, rows: NDArray[np.int64]) -> None:
    """Mean speeds between the set-points that are tried."""
    robot = setup.robot
    most = robot.velocity_limit
    if len(rows) < 2 or not np.isfinite(most).all() or not (most > 0).all():
        return
    speed = np.abs(np.diff(q, axis=0)) / (np.diff(rows) * setup.gains.period)[:, None]
    worst = np.unravel_index(int((speed / most).argmax()), speed.shape)
    if speed[worst] > most[worst[1]]:
        raise InputError(
            f"a motion that turns {robot.joint_names[worst[1]]} by {speed[worst]:.2f} rad/s (limit "
            f"{most[worst[1]]:.2f} rad/s)",
            "speeds within the joints' limits",
            "move more slowly",
        )


def _check_stability(setup: Setup, *poses: Array) -> None:
    """In the air: a passive contact adds no instability to a loop closed on the motors' side."""
    gains = setup.gains
    damping = design_damping(gains, setup.arm, setup.joints, poses[0])
    for pose in poses:
        radius = spectral_radius(gains, damping, setup.arm, setup.joints, pose)
        if radius > STEADY:
            cause, mend = _blame(setup, pose, poses[0])
            raise InputError(
                f"{cause}, unstable at {1 / gains.period:g} Hz ({_growth(radius)})",
                "gains at which the loop is stable",
                mend,
            )
    if gains.translation > GREATEST_STIFFNESS:
        raise InputError(
            f"a translational stiffness of {gains.translation:g} N/m",
            f"at most {GREATEST_STIFFNESS:g} N/m",
            "the arm's controller takes no more; lower it",
        )


def _growth(radius: float) -> str:
    """How errors grow, from one period's factor."""
    return (
        f"errors grow by {100 * (radius - 1):.2g} % a period"
        if radius < 1.1
        else f"errors grow {radius:.3g} times a period"
    )


def _check_friction(setup: Setup, pose: Array) -> None:
    """A spring so soft that the joints' friction holds the tip back from the surface, or on it.

    The tip stays where it is until one joint moves: K d |n J_j| = τ_j, d behind its set-point along the normal n.
    """
    script, drives = setup.script, setup.joints.packed
    if not script.touching.any():
        return
    lever = np.abs(setup.axes[2] @ setup.arm.state(pose).jacobian[:3])
    held = float(((drives[3] + drives[5]) / np.maximum(lever, 1e-6)).min()) / setup.gains.translation
    for way, does in (
        (float(script.place[:, 2].max()), "press below the surface"),
        (-float(script.place[:, 2].min()), "lie above it in the air"),
    ):
        if 0.0 < way <= held:
            raise InputError(
                f"a translational stiffness of {setup.gains.translation:g} N/m, at which the joints' friction holds "
                f"the tip up "
                f"to {1e3 * held:.1f} mm behind its set-points",
                f"less than the {1e3 * way:.1f} mm that they {does}",
                f"a stiffness well above {setup.gains.translation * held / way:.0f} N/m",
            )


def _blame(setup: Setup, pose: Array, designed_at: Array) -> tuple[str, str]:
    """The gain without which the loop would be stable, and what to do about it."""
    gains, arm, joints = setup.gains, setup.arm, setup.joints

    def steady(**changes: float) -> bool:
        other = dataclasses.replace(gains, **changes)
        return spectral_radius(other, design_damping(other, arm, joints, designed_at), arm, joints, pose) <= STEADY

    if gains.null > 0.0 and steady(null=0.0):
        return f"a null-space damping of {gains.null:g} N·m·s/rad, too strong for arm and drives", "lower it"
    if steady(ratio=0.7):
        high = gains.ratio > 0.7
        return (
            f"a damping ratio of {gains.ratio:g}, too {'high' if high else 'low'}",
            f"{'lower' if high else 'raise'} it towards 0.7",
        )
    return (
        f"stiffness {gains.translation:g} N/m and {gains.rotation:g} N·m/rad with damping ratio {gains.ratio:g}",
        "lower stiffness or damping ratio",
    )


def _check_torques(setup: Setup, q: Array, rows: NDArray[np.int64]) -> None:
    """What gravity, contact and the acceleration of the tip ask of the joints, all along the path."""
    arm, limit = setup.arm, setup.joints.torque_limit
    force, pressed = asked_forces(setup, q[0])
    reach = float(setup.rig.sensor.range[2]) if setup.rig.sensor.range is not None else np.inf
    if pressed.max() > reach:
        raise InputError(
            f"a motion that presses with {pressed.max():.0f} N",
            f"at most the {reach:g} N of the sensor's range",
            "touch less deep or a softer material",
        )
    begin = 0
    for i, pose in enumerate(q):
        end = len(force) if i == len(q) - 1 else (rows[i] + rows[i + 1]) // 2
        state = arm.state(pose)
        torque = state.gravity + (force[begin:end] @ setup.axes) @ state.jacobian[:3]
        over = np.abs(torque).max(axis=0) - limit
        if (over > 0).any():
            j = int(over.argmax())
            raise InputError(
                f"a motion that asks {np.abs(torque[:, j]).max():.0f} N·m of {setup.robot.joint_names[arm.columns[j]]} "
                f"(limit {limit[j]:g} N·m)",
                "torques within the joints' limits",
                "touch less deep or a softer material, or move more slowly",
            )
        begin = end


def asked_forces(setup: Setup, q: Array) -> tuple[Array, Array]:
    """Forces at each set-point [N]: of the controller along tangent1, tangent2, normal, (n, 3); of the material, (n,).

    Along each axis on its own, the tip is a mass (that of the task space at a pose), drawn by the controller's spring
    and damper, in front of the material: good to some tenths, without friction and coupling.

    Args:
        setup: of the experiment. q: a pose, chain's order, (N,).
    """
    gains, script = setup.gains, setup.script
    state = setup.arm.state(q)
    inertia = state.mass + np.diag(setup.joints.packed[0])
    damping = design_damping(gains, setup.arm, setup.joints, q)[:3, :3]
    properties = setup.material.at(script.place[:, 0], script.place[:, 1])
    deepest = max(float(script.place[:, 2].max()), 1e-6)
    # its secant at the greatest depth stands for the material
    secant = setup.material.press(script.place[:, 0], script.place[:, 1], np.full(len(script.t), deepest)) / deepest
    wanted = script.place * np.array([1.0, 1.0, -1.0])
    out, pressed = np.empty((len(script.t), 3)), np.empty(len(script.t))
    for axis, direction in enumerate(setup.axes):
        row = direction @ state.jacobian[:3]
        mass = 1.0 / float(row @ np.linalg.solve(inertia, row))
        touched = secant if axis == 2 else np.zeros_like(secant)
        _follow(
            np.ascontiguousarray(wanted[:, axis]),
            mass,
            gains.translation,
            float(direction @ damping @ direction),
            np.ascontiguousarray(touched),
            np.ascontiguousarray(properties["damping"]),
            gains.period,
            out[:, axis],
            pressed,
        )
    return out, pressed


@kernel
def _follow(
    wanted: Array,
    mass: float,
    stiffness: float,
    damping: float,
    touched: Array,
    loss: Array,
    period: float,
    out: Array,
    pressed: Array,
) -> None:
    """A mass behind a spring and a damper that follow a path; below 0 it touches. Semi-implicit steps."""
    x, v, fine = wanted[0], 0.0, 4
    h = period / fine
    for i in range(wanted.shape[0]):
        rate = (wanted[min(i + 1, wanted.shape[0] - 1)] - wanted[max(i - 1, 0)]) / (2.0 * period)
        pull = stiffness * (wanted[i] - x) + damping * (rate - v)
        out[i] = pull
        push = 0.0
        for _ in range(fine):
            push = max(0.0, -touched[i] * x - loss[i] * v) if x < 0.0 and touched[i] > 0.0 else 0.0
            v += h * (pull + push) / mass
            x += h * v
        pressed[i] = push


def _shown(vector: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{v:g}" for v in vector) + ")"
