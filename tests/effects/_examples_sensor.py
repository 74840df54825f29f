"""Examples of tool, sensor, acquisition and joint effects, of the shape that `_examples.py` describes.

The motions are made up, not those of an arm: sensor, contact and joints each move enough that every parameter is seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinid.data.rig import WRENCH
from kinid.effects import Effect, JointMotion, Layout, SensorMotion, Signals
from kinid.effects.joint_torque_ripple import JointTorqueRipple

Array = NDArray[np.float64]
G = np.array([0.0, 0.0, -9.81])
TIP, COM, MASS = np.array([0.02, -0.013, 0.11]), np.array([0.006, -0.009, 0.05]), 1.4
INERTIA = np.array([[9e-3, 1e-3, -5e-4], [1e-3, 7e-3, 8e-4], [-5e-4, 8e-4, 5e-3]])


@dataclass(frozen=True, eq=False)
class Example:
    """One effect at work; see `_examples.py`."""

    model: tuple[str | Effect, ...]
    values: Mapping[str, float]
    signals: Signals


def example(signals: Signals, *model: str | Effect, **values: float) -> Example:
    """Names of values have "__" for "." and "_" for "-"; brackets stand as they are."""
    return Example(model, {name.replace("__", ".").replace("_", "-"): value for name, value in values.items()}, signals)


def each(effect: str, parameter: str, names: tuple[str, ...], values: Array | list[float]) -> dict[str, float]:
    """Values of a parameter that there is for each of the names."""
    return {f"{effect}.{parameter}[{name}]": float(value) for name, value in zip(names, values)}


def uneven(n: int, length: float, seed: int) -> tuple[Array, Array]:
    """Times whose steps vary by half, with a gap of memory in the middle: t, dt."""
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, n) * length / n
    t = np.cumsum(steps) - steps[0]
    dt = np.diff(t, prepend=0.0)
    dt[n // 2] = 0.0
    return t, dt


def waves(
    t: Array, seed: int, size: float, slowest: float, fastest: float, count: int = 3
) -> tuple[Array, Array, Array]:
    """A sum of sines [rad/s] of about this size, with its first and second derivative."""
    rng = np.random.default_rng(seed)
    out = [np.zeros_like(t) for _ in range(3)]
    for speed in np.geomspace(slowest, fastest, count) * rng.uniform(0.9, 1.1, count):
        a, angle = size * rng.uniform(0.5, 1.0) / count, speed * t + rng.uniform(0, 2 * np.pi)
        out[0] += a * np.sin(angle)
        out[1] += a * speed * np.cos(angle)
        out[2] -= a * speed**2 * np.sin(angle)
    return out[0], out[1], out[2]


def frozen(*arrays: Array) -> tuple[Array, ...]:
    for array in arrays:
        array.setflags(write=False)
    return arrays


def turning(t: Array) -> Array:
    """Attitude of a sensor that points down and tilts about all its axes, sensor to base, (n, 3, 3)."""
    angles = np.stack([waves(t, seed, 1.2, 1.0, 9.0)[0] for seed in (21, 22, 23)], axis=1)
    return (Rotation.from_rotvec([0.0, np.pi, 0.0]) * Rotation.from_euler("xyz", angles)).as_matrix()


@cache
def wrench_motion(n: int = 2400) -> Signals:
    """A heavy tool turned and shaken in all directions, which pokes and slides now and then."""
    t, dt = uneven(n, 12.0, 5)
    h = 1e-4
    here, before, after = turning(t), turning(t - h), turning(t + h)
    # rotation vectors of small steps in the sensor's own axes: their half sum is the rate, their difference its change
    ahead = Rotation.from_matrix(np.swapaxes(here, 1, 2) @ after).as_rotvec().T
    behind = Rotation.from_matrix(np.swapaxes(here, 1, 2) @ before).as_rotvec().T
    omega, alpha = (ahead - behind) / (2 * h), (ahead + behind) / h**2
    shake = np.stack([waves(t, seed, 0.05, 2.0, 14.0)[2] for seed in (31, 32, 33)])
    specific = np.einsum("nji,jn->in", here, G[:, None] - shake)
    force = MASS * (
        specific
        - np.cross(alpha, COM[:, None], axis=0)
        - np.cross(omega, np.cross(omega, COM[:, None], axis=0), axis=0)
    )
    torque = np.cross(COM[:, None], force, axis=0) - INERTIA @ alpha - np.cross(omega, INERTIA @ omega, axis=0)
    depth, depth_rate, _ = waves(t, 41, 9e-3, 1.5, 8.0)
    slips = [waves(t, seed, 0.02, 1.0, 6.0) for seed in (42, 43)]
    frozen(t, dt, depth, depth_rate, here, omega, alpha, specific, force, torque)
    load = np.concatenate([force, torque])
    sensor = SensorMotion(np.ascontiguousarray(here), TIP, specific, omega, alpha, load, MASS, COM)
    slip, slip_rate = frozen(np.stack([s[0] for s in slips]), np.stack([s[1] for s in slips]))
    return Signals(Layout(WRENCH, "wrench"), t, dt, depth, depth_rate, slip, slip_rate, sensor=sensor)


@cache
def contact_motion(n: int = 1500) -> Signals:
    """The same pokes and slides in the contact frame."""
    channels = ("normal_force", "tangential_force1", "tangential_force2")
    t, dt = uneven(n, 10.0, 6)
    depth, depth_rate, _ = waves(t, 41, 9e-3, 1.5, 8.0)
    slips = [waves(t, seed, 0.02, 1.0, 6.0) for seed in (42, 43)]
    slip, slip_rate = frozen(np.stack([s[0] for s in slips]), np.stack([s[1] for s in slips]))
    return Signals(Layout(channels, "contact"), *frozen(t, dt, depth, depth_rate), slip, slip_rate)


@cache
def arm_motion(n: int = 2000) -> Signals:
    """Two links in a vertical plane that carry a payload (Spong, Hutchinson, Vidyasagar 2006, ex. 7.2, point
    masses).
    """
    t, dt = uneven(n, 10.0, 8)
    (q1, d1, a1), (q2, d2, a2) = waves(t, 51, 2.5, 0.7, 7.0, 4), waves(t, 52, 2.5, 0.8, 9.0, 4)
    m1, m2, l1, l2, g = 3.0, 2.0, 0.4, 0.3, 9.81
    h = -m2 * l1 * l2 * np.sin(q2)
    m11, m12 = m1 * l1**2 + m2 * (l1**2 + l2**2 + 2 * l1 * l2 * np.cos(q2)), m2 * (l2**2 + l1 * l2 * np.cos(q2))
    low = m2 * g * l2 * np.cos(q1 + q2)
    rigid = np.stack(
        [
            m11 * a1 + m12 * a2 + h * (2 * d1 * d2 + d2**2) + (m1 + m2) * g * l1 * np.cos(q1) + low,
            m12 * a1 + m2 * l2**2 * a2 - h * d1**2 + low,
        ]
    )
    payload = g * np.stack(
        [
            np.stack([l1 * np.cos(q1) + l2 * np.cos(q1 + q2), l2 * np.cos(q1 + q2)]),
            np.stack([np.cos(q1 + q2), np.cos(q1 + q2)]) * np.array([[1.0], [1.3]]),
            np.stack([-np.sin(q1 + q2), -np.sin(q1 + q2)]),
            np.stack([0.05 * a1 * np.sin(q2), 0.05 * d1 * d2]),
        ]
    )
    # per unit of gravity along x, y (upwards) and z of the base; the plane of the links leans a little, so that z
    # counts
    elbow, hand = m2 * l2 * np.cos(q1 + q2), m2 * l2 * np.sin(q1 + q2)
    upright = -np.stack([(m1 + m2) * l1 * np.cos(q1) + elbow, elbow])
    level = np.stack([(m1 + m2) * l1 * np.sin(q1) + hand, hand])
    gravity = np.stack([level, upright, 0.1 * upright * np.cos(q1)])
    frozen(payload, gravity)
    # per unit of first moment of each link in its own axes, the third across the plane, which leans a little as above
    far, near = np.stack([np.cos(q1 + q2), np.cos(q1 + q2)]), np.stack([np.cos(q1), np.zeros(n)])
    side = np.stack([-np.sin(q1), np.zeros(n)]), np.stack([-np.sin(q1 + q2), -np.sin(q1 + q2)])
    # an arm in a plane can't tell them from gravity: these change along the motion as those of an arm in space do
    spread = 1.0 + 0.5 * np.sin(np.arange(1.0, 7.0)[:, None, None] * q2 + np.arange(6.0)[:, None, None])
    moments = g * spread * np.stack([near, side[0], 0.1 * near, far, side[1], 0.1 * far * np.cos(q1)])
    turned = -g * np.stack(
        [
            np.stack([(m1 + m2) * l1 * np.sin(q1) + m2 * l2 * np.sin(q1 + q2), m2 * l2 * np.sin(q1 + q2)]),
            m2 * l2 * np.stack([np.sin(q1 + q2), np.sin(q1 + q2)]),
        ]
    )
    pushed = np.stack([np.stack([np.zeros(n), m12]), np.stack([m12, np.zeros(n)])])
    frozen(moments, turned, pushed)
    joints = JointMotion(
        *frozen(np.stack([q1, q2]), np.stack([d1, d2]), np.stack([a1, a2]), rigid),
        True,
        payload,
        gravity,
        moments=lambda _: moments,
        slopes=lambda *_: np.stack([turned, pushed]),
    )
    return _joint_signals(Layout(("tau1", "tau2"), "joints", ("shoulder", "elbow")), t, dt, joints)


@cache
def drive_motion(n: int = 2000) -> Signals:
    """One axis that slides, without a robot."""
    t, dt = uneven(n, 10.0, 9)
    q, dq, ddq = (row[None, :] for row in waves(t, 61, 0.4, 1.0, 8.0, 4))
    return _joint_signals(
        Layout(("force1",), "joints"), t, dt, JointMotion(*frozen(q, dq, ddq, np.zeros((1, n))), False)
    )


def _joint_signals(layout: Layout, t: Array, dt: Array, joints: JointMotion) -> Signals:
    none, pair = np.zeros(len(t)), np.zeros((2, len(t)))
    return Signals(layout, *frozen(t, dt), none, none, pair, pair, joints=joints)


def _crosstalk() -> Example:
    layout = wrench_motion().layout
    pairs = tuple(f"{i},{j}" for i in WRENCH for j in WRENCH if i != j)
    units = dict(zip(layout.channels, layout.units))
    size = {("N", "N"): 0.03, ("N·m", "N·m"): 0.03, ("N", "N·m"): 0.5, ("N·m", "N"): 2e-3}
    draws = np.random.default_rng(3).uniform(-1, 1, len(pairs))
    shares = [draw * size[units[a], units[b]] for draw, (a, b) in zip(draws, (pair.split(",") for pair in pairs))]
    return Example(
        ("hooke", "coulomb-friction", "sensor-crosstalk"),
        each("sensor-crosstalk", "crosstalk", pairs, shares),
        wrench_motion(),
    )


_AXES, _JOINTS = ("x", "y", "z"), ("shoulder", "elbow")
_HUM = tuple(f"{name},{h}" for name in WRENCH for h in (1, 2, 3))
_WRENCH_SIZES = np.array([1.0, -0.7, 1.4, 0.05, 0.03, -0.04])

EXAMPLES: dict[str, Example] = {
    "tool-mass": example(wrench_motion(), "hooke", "tool-mass", tool_mass__mass=0.043),
    "tool-com": Example(("hooke", "tool-com"), each("tool-com", "com", _AXES, [3e-3, -2e-3, 5e-3]), wrench_motion()),
    "tool-inertia": Example(
        ("hooke", "tool-inertia"),
        each("tool-inertia", "inertia", ("xx", "yy", "zz", "xy", "xz", "yz"), [4e-4, 3e-4, 2e-4, -5e-5, 4e-5, 6e-5]),
        wrench_motion(),
    ),
    "tip-offset": Example(
        ("hooke", "coulomb-friction", "tip-offset"),
        each("tip-offset", "offset", _AXES, [4e-4, -3e-4, 2e-4]),
        wrench_motion(),
    ),
    "structural-compliance": example(
        contact_motion(), "hertz", "structural-compliance", hertz__stiffness=3e4, structural_compliance__compliance=8e-5
    ),
    "sensor-bias": Example(
        ("hooke", "sensor-bias"), each("sensor-bias", "offset", WRENCH, _WRENCH_SIZES), wrench_motion()
    ),
    "sensor-drift": Example(
        ("hooke", "sensor-drift"), each("sensor-drift", "drift", WRENCH, _WRENCH_SIZES), wrench_motion()
    ),
    "sensor-crosstalk": _crosstalk(),
    "sensor-misalignment": Example(
        ("hooke", "sensor-misalignment"),
        each("sensor-misalignment", "rotation", _AXES, [0.02, -0.03, 0.05]),
        wrench_motion(),
    ),
    "sensor-gain": example(wrench_motion(), "hooke", "sensor-gain", sensor_gain__gain=0.035),
    "sensor-lag": example(contact_motion(), "kelvin-voigt", "sensor-lag", sensor_lag__time_constant=0.011),
    "time-offset": example(contact_motion(), "hooke", "coulomb-friction", "time-offset", time_offset__delay=-0.0043),
    "saturation": Example(
        ("hooke", "saturation"), each("saturation", "limit", WRENCH, [8.0, 9.0, 12.0, 0.5, 0.4, 0.1]), wrench_motion()
    ),
    "quantization": Example(
        ("hooke", "quantization"),
        each("quantization", "step", WRENCH, [0.2, 0.3, 0.5, 0.02, 0.03, 0.01]),
        wrench_motion(),
    ),
    "mains-hum": Example(
        ("hooke", "mains-hum"),
        each("mains-hum", "sine", _HUM, 0.1 * np.repeat(_WRENCH_SIZES, 3))
        | each("mains-hum", "cosine", _HUM, -0.04 * np.repeat(_WRENCH_SIZES, 3)),
        wrench_motion(),
    ),
    "rigid-body": example(drive_motion(), "rigid-body", rigid_body__inertia=94.0),
    "joint-coulomb-friction": Example(
        ("rigid-body", "joint-coulomb-friction"),
        each("joint-coulomb-friction", "coulomb", _JOINTS, [0.8, 0.5]),
        arm_motion(),
    ),
    "joint-stribeck-friction": Example(
        ("rigid-body", "joint-coulomb-friction", "joint-stribeck-friction"),
        {"joint-stribeck-friction.speed": 0.3, **each("joint-stribeck-friction", "excess", _JOINTS, [0.5, 0.3])},
        arm_motion(),
    ),
    "joint-load-friction": Example(
        ("rigid-body", "joint-load-friction"), each("joint-load-friction", "load", _JOINTS, [0.1, 0.04]), arm_motion()
    ),
    "joint-spring": Example(
        ("rigid-body", "joint-spring"), each("joint-spring", "rate", _JOINTS, [2.5, -0.7]), arm_motion()
    ),
    "joint-torque-ripple": Example(
        ("rigid-body", JointTorqueRipple((("[shoulder]", 7.9), ("[elbow]", 20.1)))),
        {
            **each("joint-torque-ripple", "order", _JOINTS, [8.0, 20.0]),
            **each(
                "joint-torque-ripple", "sine", tuple(f"{j},{h}" for j in _JOINTS for h in (1, 2)), [0.6, 0.2, -0.3, 0.1]
            ),
            **each(
                "joint-torque-ripple",
                "cosine",
                tuple(f"{j},{h}" for j in _JOINTS for h in (1, 2)),
                [-0.2, 0.1, 0.4, -0.2],
            ),
        },
        arm_motion(),
    ),
    "joint-viscous-friction": Example(
        ("rigid-body", "joint-viscous-friction"),
        each("joint-viscous-friction", "viscous", _JOINTS, [0.6, 0.2]),
        arm_motion(),
    ),
    "joint-friction-asymmetry": example(
        drive_motion(), "rigid-body", "joint-friction-asymmetry", joint_friction_asymmetry__asymmetry=-31.0
    ),
    "joint-torque-offset": Example(
        ("rigid-body", "joint-torque-offset"), each("joint-torque-offset", "offset", _JOINTS, [-0.6, 0.2]), arm_motion()
    ),
    "rotor-inertia": Example(
        ("rigid-body", "rotor-inertia"), each("rotor-inertia", "inertia", _JOINTS, [0.9, 0.3]), arm_motion()
    ),
    "joint-torque-gain": Example(
        ("rigid-body", "joint-torque-gain"), each("joint-torque-gain", "gain", _JOINTS, [0.06, -0.11]), arm_motion()
    ),
    "payload": Example(
        ("rigid-body", "payload"),
        {"payload.mass": 0.7, **each("payload", "moment", _AXES, [0.02, 0.05, -0.01])},
        arm_motion(),
    ),
    "gravity-error": Example(
        ("rigid-body", "gravity-error"), each("gravity-error", "error", _AXES, [0.8, -0.1, 0.3]), arm_motion()
    ),
    "joint-elasticity": Example(
        ("rigid-body", "joint-elasticity"), each("joint-elasticity", "elasticity", _JOINTS, [6e-4, 9e-4]), arm_motion()
    ),
}
