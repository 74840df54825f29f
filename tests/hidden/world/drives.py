"""The arm in free motion: joint positions and torques, with friction, motors, gears, a load and sensors of the
joints.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hidden.world.arm import Body, dynamics
from hidden.world.path import FINE, LOGGED
from hidden.world.rubbing import Rub, brush
from hidden.world.sensing import Chain, read

Array = NDArray[np.float64]

JOINTS = 7
#: how large torques are in each joint, relative to the first [1], and noise of the torque sensors [N·m]
SCALE = np.array([1.0, 1.0, 0.7, 0.7, 0.5, 0.3, 0.25])
NOISE = np.array([0.07, 0.07, 0.05, 0.05, 0.04, 0.02, 0.02])
#: travel in which friction of a joint turns around [rad], as dry friction has it in the catalogue
TURN = 1e-4
#: speed limits that motions keep well below [rad/s]
SPEEDS = np.array([1.9, 1.9, 2.2, 2.2, 3.5, 3.2, 3.2])


def none() -> Array:
    """Nothing in any joint."""
    return np.zeros(JOINTS)


@dataclass(frozen=True, eq=False)
class Drives:
    """What is in the joints; what is 0, or None, is not there.

    Attributes:
        dry [N·m], viscous, one_sided [N·m·s/rad]: friction; viscosity is viscous + one_sided forwards, − backwards.
        offset [N·m]. gain: relative error of each torque sensor. motors [kg·m²]: inertia as the joint sees it.
        softness [rad/(N·m)]: between encoder and link.
        bodies: behind the flange, the one that the rig tells of first.
        chain: of the torque sensors. strange: kind, size and seed of what no catalogue holds.
        clock_error [s], offset_error [N·m]: what a calibration leaves. noise (7,). peak: of each channel.
    """

    dry: Array = field(default_factory=none)
    viscous: Array = field(default_factory=none)
    one_sided: Array = field(default_factory=none)
    offset: Array = field(default_factory=none)
    gain: Array = field(default_factory=none)
    motors: Array = field(default_factory=none)
    softness: Array = field(default_factory=none)
    bodies: tuple[Body, ...] = ()
    chain: Chain = field(default_factory=Chain)
    strange: tuple[str, float, int] | None = None
    clock_error: float = 0.0
    offset_error: Array = field(default_factory=none)
    noise: Array = field(default_factory=lambda: NOISE.copy())
    peak: Array = field(default_factory=lambda: np.full(JOINTS, np.inf))


@dataclass(frozen=True, eq=False)
class Excitation:
    """A sum of sines in each joint around a pose, (lines, 7) each; it begins and ends at rest."""

    pose: Array
    size: Array
    omega: Array
    turn: Array
    seconds: float

    @cached_property
    def t(self) -> Array:
        """Times of the log [s]."""
        return np.arange(round(self.seconds * LOGGED)) / LOGGED

    @cached_property
    def fine(self) -> Array:
        """Times at the fine rate [s]."""
        return np.arange(len(self.t) * (FINE // LOGGED)) / FINE

    @cached_property
    def logged(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at the times of the log, (n, 7) each."""
        return self(self.t)

    @cached_property
    def directions(self) -> Array:
        """Which way each joint last moved, −1…1, (n, 7): a brush of bristles that bend, at the fine rate."""
        q = CubicSpline(self.t, self.logged[0])(np.minimum(self.fine, self.t[-1]))
        still, always = np.zeros(len(q)), np.ones(len(q), dtype=np.bool_)
        rub = Rub(turn=TURN, uneven=0.2)
        every = FINE // LOGGED
        return np.stack([brush(rub, np.stack([q[:, j], still]), always)[0, ::every] for j in range(JOINTS)], axis=1)

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations, (n, 7) each."""
        angle = t[:, None, None] * self.omega + self.turn
        sine, cosine = np.sin(angle), np.cos(angle)
        q, dq, ddq = ((self.size * wave).sum(axis=1) for wave in (sine, self.omega * cosine, -(self.omega**2) * sine))
        w, dw, ddw = self._window(t)
        return self.pose + w * q, dw * q + w * dq, ddw * q + 2 * dw * dq + w * ddq

    def _window(self, t: Array) -> tuple[Array, Array, Array]:
        """Rises and falls within 2 s, smooth to the fourth derivative, which gears feel, (n, 1) each with its
        derivatives.
        """
        edge = 2.0
        s = np.clip(np.minimum(t, self.t[-1] - t) / edge, 0, 1)[:, None]
        way = np.where(t < self.t[-1] / 2, 1.0, -1.0)[:, None] / edge
        r = s * (1 - s)
        value = s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)
        return value, 630 * r**4 * way, 2520 * r**3 * (1 - 2 * s) * way**2


def excite(rng: np.random.Generator, seconds: float, fast: bool, still: tuple[int, ...] = ()) -> Excitation:
    """An excitation of all joints but some: slow lines below 1 Hz, and where it is fast others up to 4 Hz."""
    pose = np.deg2rad([0, 20, 0, -80, 0, 50, 0]) + rng.uniform(-0.4, 0.4, JOINTS)
    omega = (
        2
        * np.pi
        * np.concatenate(
            [
                rng.uniform(0.04, 0.12, (1, JOINTS)),
                rng.uniform(0.1, 0.35, (3, JOINTS)),
                rng.uniform(0.3, 1.0, (2, JOINTS)),
                rng.uniform(2.0, 4.0, (2, JOINTS)),
            ]
        )
    )
    share = np.array([0.5, 0.3, 0.25, 0.2, 0.1, 0.05, 0.03, 0.02])[:, None] * rng.uniform(0.6, 1.2, omega.shape)
    if not fast:
        share[6:] = 0.0
    share[:, list(still)] = 0.0
    speed = (share * omega).sum(axis=0)
    size = share * np.minimum(1.0, 0.6 * SPEEDS / np.maximum(speed, 1e-9))
    return Excitation(pose, size, omega, rng.uniform(0, 2 * np.pi, omega.shape), seconds)


def torques(d: Drives, motion: Excitation) -> Array:
    """Torque that each joint's motor gives, (n, 7), at the log's rate; the motion is the encoders'."""
    # smooth as the motion is, dynamics are computed at a quarter of the rate
    knots = np.append(motion.t[::4], motion.t[-1]) if (len(motion.t) - 1) % 4 else motion.t[::4]
    at = motion(knots)
    soft = d.softness.any()
    rigid = dynamics(d.bodies, *at, armature=() if soft else tuple(d.motors))[1]
    if soft:
        # the link is behind the encoder by what the gear gives way: each round is nearer by the square of ω/ω₀
        for _ in range(2):
            bend = CubicSpline(knots, rigid * d.softness)
            rigid = dynamics(d.bodies, *(wave - bend(knots, k) for k, wave in enumerate(at)))[1]
        rigid = rigid + d.motors * at[2]
    out: Array = CubicSpline(knots, rigid)(motion.t) + friction(d, motion) + d.offset
    return out


def friction(d: Drives, motion: Excitation) -> Array:
    """Torque that friction takes, (n, 7)."""
    dq = motion.logged[1]
    out: Array = dq * (d.viscous + d.one_sided * np.sign(dq))
    return out + d.dry * motion.directions if d.dry.any() else out


def readings(d: Drives, motion: Excitation, torque: Array, rng: np.random.Generator, quiet: bool = False) -> Array:
    """What the torque sensors log, (n, 7)."""
    if d.strange is not None:
        torque = torque + strange(d, motion, torque)
    stream = CubicSpline(motion.t, torque * (1.0 + d.gain))(np.minimum(motion.fine, motion.t[-1]))
    chain = dataclasses.replace(
        d.chain,
        late=d.chain.late + d.clock_error,
        bias=d.offset_error + (0.0 if d.chain.bias is None else d.chain.bias),
    )
    return read(chain, stream, motion.t, none() if quiet else d.noise, rng, triples=())


#: what no catalogue holds, with the size to begin with
STRANGE = {
    "cogging": 0.3,  # torque periodic in the joint's position [N·m]
    "load-friction": 0.05,  # dry friction in proportion to the torque
    "stribeck": 0.5,  # dry friction that is more when slow [N·m]
    "hose": 3.0,  # a hose that bends with the joints and lags behind [N·m/rad²]
    "gain-swing": 0.02,  # gain that swings with a period of 7 s
    "person": 3.0,  # half-sine pushes at some instants [N·m]
}


def strange(d: Drives, motion: Excitation, torque: Array) -> Array:
    """Torque that comes along, (n, 7)."""
    assert d.strange is not None
    kind, size, seed = d.strange
    rng = np.random.default_rng(seed)
    t, (q, dq, _) = motion.t, motion.logged
    if kind == "cogging":
        return size * SCALE * np.sin(q * rng.integers(18, 60, JOINTS) + rng.uniform(0, 6, JOINTS))
    if kind == "load-friction":
        return size * np.abs(torque) * motion.directions
    if kind == "stribeck":
        return size * SCALE * motion.directions / (1.0 + (dq / rng.uniform(0.03, 0.1)) ** 2)
    if kind == "hose":
        lag = np.empty_like(q)
        lag[0] = q[0]
        play = 0.15
        for i in range(1, len(q)):
            lag[i] = np.clip(lag[i - 1], q[i] - play, q[i] + play)
        away = lag - motion.pose
        return size * SCALE * (away * np.abs(away) + 0.4 * away[:, ::-1] ** 2)
    if kind == "gain-swing":
        return torque * size * np.sin(2 * np.pi * t / 7.0 + rng.uniform(0, 6))[:, None]
    if kind == "person":
        out = np.zeros_like(torque)
        for _ in range(10):
            start, length = rng.uniform(0.05, 0.95) * t[-1], rng.uniform(0.2, 0.7)
            push = np.sin(np.pi * np.clip((t - start) / length, 0, 1))
            out += size * rng.uniform(0.5, 1.0) * push[:, None] * SCALE * rng.uniform(-1, 1, JOINTS)
        return out
    raise ValueError(kind)
