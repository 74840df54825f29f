"""The reference motions of examples: several pokes and slides, a tool that is shaken, an arm and a drive.

The motions are made up, not those of an arm: contact, sensor and joints each move enough that every parameter of every
law is seen. Times are uneven, each has a gap, and all arrays are closed for writing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinid.data.rig import WRENCH
from kinid.effects import JointMotion, Layout, Motion, SensorMotion, Signals

Array = NDArray[np.float64]

CHANNELS = ("normal_force", "tangential_force1", "tangential_force2")
#: gravity [m/s²], the tool's tip and centre of mass in the sensor's axes [m], its mass [kg] and inertia [kg·m²]
G = np.array([0.0, 0.0, -9.81])
TIP, COM, MASS = np.array([0.02, -0.013, 0.11]), np.array([0.006, -0.009, 0.05]), 1.4
INERTIA = np.array([[9e-3, 1e-3, -5e-4], [1e-3, 7e-3, 8e-4], [-5e-4, 8e-4, 5e-3]])


def reference_motion(motion: Motion) -> Signals:
    """A reference motion; always the same object, whose arrays are closed for writing."""
    return closed(MOTIONS[motion]())


#: times [s] and values [mm] between which the pokes run: depth, and slip along both tangents
DEPTH = (
    (0, 0.3, 0.8, 0.9, 1, 1.6, 1.8, 2.6, 2.7, 3, 3.4, 4, 4.3, 6, 6.2, 8, 8.1, 8.6, 9, 9.5, 9.7, 10.2, 11.5, 12),
    (-1, 1.5, 1.5, 0.6, 1.8, -1.2, 4, 4, 1, 3, -1, -1, 2, 2.1, 3.2, 3, 5.2, 4.8, -1.5, 5.5, -0.4, 4.5, 3.5, -1),
)
SLIP1 = (
    (0, 1.2, 1.7, 2.4, 4.2, 5, 5.1, 5.2, 5.9, 7, 7.4, 8.3, 8.8, 9.6, 9.8, 10.6, 10.7, 12),
    (-9, -8.8, -8, -7.4, -9, 9, 8.7, 9, -5, 6, 6.5, -8, -9, 2, 2, -4, -3.9, 9),
)
SLIP2 = (
    (0, 1.5, 3.1, 4.4, 5.3, 6.4, 6.5, 7.5, 8.2, 9.4, 10, 10.8, 12),
    (4, 5, -2, -6, -6, 6, 5.8, 5, -5, -5, 5, -6, 3),
)


def glide(t: Array, times: Sequence[float], values: Sequence[float]) -> tuple[Array, Array]:
    """Value [m] and rate of a motion that rests at each time [s], value [mm], and runs smoothly between them."""
    at, value = np.array(times, dtype=float), 1e-3 * np.array(values)
    k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
    span, rise = at[k + 1] - at[k], value[k + 1] - value[k]
    s = np.clip((t - at[k]) / span, 0.0, 1.0)
    return value[k] + rise * s**3 * (10 - 15 * s + 6 * s**2), rise / span * 30 * s**2 * (1 - s) ** 2


@cache
def pokes(n: int = 2400) -> Signals:
    """Pokes of several depths and speeds with holds, partial unloading, and slides both ways; uneven time, a gap."""
    steps = np.random.default_rng(7).uniform(0.3, 1.7, n)
    t = 12.0 * (np.cumsum(steps) - steps[0]) / steps.sum()
    (depth, rate), (slip1, rate1), (slip2, rate2) = (glide(t, *knots) for knots in (DEPTH, SLIP1, SLIP2))
    dt = np.diff(t, prepend=0.0)
    dt[np.searchsorted(t, 5.5)] = 0.0  # memory begins anew in the middle of a slide
    slip, slip_rate = np.stack([slip1, slip2]), np.stack([rate1, rate2])
    return Signals(Layout(CHANNELS, "contact"), t, dt, depth, rate, slip, slip_rate)


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


def closed(signals: Signals) -> Signals:
    """The same signals, their arrays closed for writing."""
    for array in arrays(signals):
        array.setflags(write=False)
    return signals


def arrays(thing: object) -> list[Array]:
    """All arrays of signals, those of its parts included."""
    out: list[Array] = []
    for field in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            out.append(value)
        elif is_dataclass(value):
            out += arrays(value)
    return out


def turning(t: Array) -> Array:
    """Attitude of a sensor that points down and tilts about all its axes, sensor to base, (n, 3, 3)."""
    angles = np.stack([waves(t, seed, 1.2, 1.0, 9.0)[0] for seed in (21, 22, 23)], axis=1)
    down = Rotation.from_rotvec([0.0, np.pi, 0.0])
    return np.asarray((down * Rotation.from_euler("xyz", angles)).as_matrix())


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
    load = np.concatenate([force, torque])
    sensor = SensorMotion(np.ascontiguousarray(here), TIP, specific, omega, alpha, load, MASS, COM)
    slip, slip_rate = np.stack([s[0] for s in slips]), np.stack([s[1] for s in slips])
    return Signals(Layout(WRENCH, "wrench"), t, dt, depth, depth_rate, slip, slip_rate, sensor=sensor)


@cache
def waved(n: int = 1500) -> Signals:
    """The same pokes and slides in the contact frame."""
    t, dt = uneven(n, 10.0, 6)
    depth, depth_rate, _ = waves(t, 41, 9e-3, 1.5, 8.0)
    slips = [waves(t, seed, 0.02, 1.0, 6.0) for seed in (42, 43)]
    slip, slip_rate = np.stack([s[0] for s in slips]), np.stack([s[1] for s in slips])
    return Signals(Layout(CHANNELS, "contact"), t, dt, depth, depth_rate, slip, slip_rate)


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
    swayed = 2.0 * h * np.stack([np.stack([d2, -d1]), np.stack([d1 + d2, np.zeros(n)])])
    pushed = np.stack([np.stack([m11, m12]), np.stack([m12, np.full(n, m2 * l2**2)])])
    joints = JointMotion(
        *(np.stack([q1, q2]), np.stack([d1, d2]), np.stack([a1, a2]), rigid),
        True,
        payload,
        gravity,
        moments=lambda _: moments,
        slopes=lambda *_: np.stack([turned, swayed, pushed]),
    )
    return _joint_signals(Layout(("tau1", "tau2"), "joints", ("shoulder", "elbow")), t, dt, joints)


@cache
def drive_motion(n: int = 2000) -> Signals:
    """One axis that slides, without a robot."""
    t, dt = uneven(n, 10.0, 9)
    q, dq, ddq = (row[None, :] for row in waves(t, 61, 0.4, 1.0, 8.0, 4))
    joints = JointMotion(q, dq, ddq, np.zeros((1, n)), False)
    return _joint_signals(Layout(("force1",), "joints"), t, dt, joints)


def _joint_signals(layout: Layout, t: Array, dt: Array, joints: JointMotion) -> Signals:
    none, pair = np.zeros(len(t)), np.zeros((2, len(t)))
    return Signals(layout, t, dt, none, none, pair, pair, joints=joints)


#: what makes each of them
MOTIONS: dict[Motion, Callable[[], Signals]] = {
    Motion.POKES: pokes,
    Motion.WAVES: waved,
    Motion.WRENCH: wrench_motion,
    Motion.ARM: arm_motion,
    Motion.DRIVE: drive_motion,
}
