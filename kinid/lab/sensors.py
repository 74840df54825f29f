"""What sensors make of the truth: the force/torque sensor, the joints, and the streams that they are logged in."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from kinid.data.rig import ToolSpec
from kinid.lab.loop_experiment import Motion
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load

Array = NDArray[np.float64]

#: standard deviation and resolution of an ATI Mini40 SI-40-2 at 1 kHz [N, N·m]
NOISE = np.array([0.015, 0.015, 0.029, 5e-4, 6e-4, 3e-4])
RESOLUTION = np.array([1 / 100, 1 / 100, 1 / 50, 1 / 4000, 1 / 4000, 1 / 4000])
RANGE = np.array([40.0, 40.0, 120.0, 2.0, 2.0, 2.0])


def _zeros(n: int = 6) -> Array:
    return np.zeros(n)


@dataclass(frozen=True, eq=False)
class Sensor:
    """A force/torque sensor with its faults, in the order in which they act.

    Attributes:
        rotation: vector by which it is turned in its mount [rad]. crosstalk: share of other channels, empty diagonal
            (6, 6).
        gain: error g, y = (1 + g) f. bias: (6,). drift: a minute, (6,). walk: standard deviation of a random walk after
            a minute, (6,). lag: time constant [s]. delay: [s]. hum: amplitude of each channel (6,) at hum_frequency
            [Hz].
        noise: standard deviation, (6,). limit, step: of range and converter, (6,).
    """

    rotation: Array = field(default_factory=lambda: _zeros(3))
    crosstalk: Array = field(default_factory=lambda: np.zeros((6, 6)))
    gain: float = 0.0
    bias: Array = field(default_factory=_zeros)
    drift: Array = field(default_factory=_zeros)
    walk: Array = field(default_factory=_zeros)
    lag: float = 0.0
    delay: float = 0.0
    hum: Array = field(default_factory=_zeros)
    hum_frequency: float = 50.0
    noise: Array = field(default_factory=NOISE.copy)
    limit: Array = field(default_factory=RANGE.copy)
    step: Array = field(default_factory=RESOLUTION.copy)

    @classmethod
    def mini40(cls, rng: np.random.Generator) -> Sensor:
        """A Mini40 as one might be delivered: offsets, cross-talk, slow drift (of assumed sizes)."""
        crosstalk = rng.normal(scale=8e-3, size=(6, 6)) * np.where(np.arange(6) < 3, 1.0, 10.0)
        crosstalk[3:, :3] *= 0.05
        crosstalk[3:, 3:] *= 0.1
        np.fill_diagonal(crosstalk, 0.0)
        # the calibration sheet, and the reading without load, have so many digits
        return cls(
            crosstalk=np.round(crosstalk, 5),
            bias=np.round(rng.normal(scale=[0.5, 0.5, 1.0, 0.02, 0.02, 0.01]), 5),
            walk=np.array([4e-3, 4e-3, 6e-3, 2e-4, 2e-4, 1e-4]),
        )

    def replace(self, **changes: object) -> Sensor:
        """The same with other faults."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def read(self, load: Array, t: Array, rng: np.random.Generator) -> Array:
        """The reading for loads on the tool in sensor axes, at even times, (n, 6)."""
        dt = float(t[1] - t[0]) if len(t) > 1 else 1e-3
        turn = Rotation.from_rotvec(self.rotation).as_matrix().T
        y = np.concatenate([load[:, :3] @ turn.T, load[:, 3:] @ turn.T], axis=1)
        y = (1.0 + self.gain) * (y @ (np.eye(6) + self.crosstalk).T) + self.bias + np.outer(t / 60.0, self.drift)
        steps = rng.normal(size=y.shape) * np.sqrt(dt / 60.0)
        y = y + self.walk * np.cumsum(steps, axis=0)
        if self.lag > 0.0:
            # exact for an input that runs straight between samples
            h = dt / self.lag
            e = np.exp(-h)
            b0, b1 = 1.0 - (1.0 - e) / h, (1.0 - e) / h - e
            y = y[0] + lfilter([b0, b1], [1.0, -e], y - y[0], axis=0)
        if self.delay != 0.0:
            y = np.stack([np.interp(t - self.delay, t, channel) for channel in y.T], axis=1)
        y = y + np.outer(np.sin(2 * np.pi * self.hum_frequency * t + 0.7), self.hum)
        y = y + rng.normal(size=y.shape) * self.noise
        y = np.clip(y, -self.limit, self.limit)
        safe = np.where(self.step > 0, self.step, 1.0)
        out: Array = np.where(self.step > 0, safe * np.round(y / safe), y)
        return out

    def truth(self) -> dict[str, object]:
        """Its numbers."""
        return {f.name: np.asarray(getattr(self, f.name)).tolist() for f in dataclasses.fields(self)}


@dataclass(frozen=True, eq=False)
class JointSensors:
    """Encoders and joint-torque sensors with their faults, per joint (N,) or one for all.

    Attributes:
        step: of the encoders on the link side [rad]. noise: of the torques [N·m]. offset: of the torques [N·m].
        gain: error of the torques. coulomb [N·m], viscous, asymmetry [N·m·s/rad]: what the torque sensor takes from
            friction.
        stribeck: what dry friction is more at rest [N·m], fading over stribeck_speed [rad/s]. load: friction for each
            torque.
        spring: of a balancer or a cable [N·m/rad]. ripple: amplitude [N·m] of a wave that comes ripple_order times a
            turn.
        rotor: inertia that it takes from the motor [kg·m²]. bend: 1/K of the joints whose encoders sit on the motors
            [rad/(N·m)].
    """

    step: float = 2e-6
    noise: Array | float = 0.05
    offset: Array | float = 0.0
    gain: Array | float = 0.0
    coulomb: Array | float = 0.0
    viscous: Array | float = 0.0
    asymmetry: Array | float = 0.0
    stribeck: Array | float = 0.0
    stribeck_speed: Array | float = 0.05
    load: Array | float = 0.0
    spring: Array | float = 0.0
    ripple: Array | float = 0.0
    ripple_order: Array | float = 1.0
    rotor: Array | float = 0.0
    bend: Array | float = 0.0

    def read(self, q: Array, dq: Array, ddq: Array, tau: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Positions and torques as they are logged."""
        seen = q + self.bend * tau
        seen = np.asarray(np.round(seen / self.step) * self.step if self.step > 0 else seen)
        dry = any(np.any(part) for part in (self.coulomb, self.stribeck, self.load))
        turned = _directions(q) if dry else np.zeros_like(q)
        dry_friction = (
            self.coulomb + self.stribeck * np.exp(-((dq / self.stribeck_speed) ** 2)) + self.load * np.abs(tau)
        )
        rub = self.viscous * dq + dry_friction * turned + self.asymmetry * np.abs(dq) + self.rotor * ddq
        beside = self.spring * q + self.ripple * np.sin(self.ripple_order * q)
        torque = (tau + rub + beside) * (1.0 + self.gain) + self.offset
        return seen, np.asarray(torque + rng.normal(size=tau.shape) * self.noise)

    def replace(self, **changes: object) -> JointSensors:
        """The same with other faults."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class StreamSpec:
    """How a stream is logged: every how many control periods, its clock (offset [s], skew), delay [s], jitter [s],
    losses.
    """

    every: int = 1
    offset: float = 0.0
    skew: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    losses: float = 0.0

    def stamps(self, t: Array, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
        """Rows that are kept of a timeline, and their time stamps [s], increasing."""
        rows = np.arange(0, len(t), self.every)
        if self.losses > 0.0:  # messages are lost in bursts, of four in the mean
            gone, n = np.zeros(len(rows), dtype=bool), len(rows)
            for start in np.flatnonzero(rng.random(n) < self.losses / 4):
                gone[start : start + int(rng.geometric(0.25))] = True
            gone[[0, -1]] = False
            rows = rows[~gone]
        stamps = t[rows] * (1.0 + self.skew) + self.offset + self.delay
        if self.jitter > 0.0:
            spacing = 0.45 * self.every * float(t[1] - t[0])
            stamps = stamps + np.clip(rng.normal(scale=self.jitter, size=len(rows)), -spacing, spacing)
        return rows, stamps


def load_on_sensor(
    motion: Motion, robot: Robot, columns: NDArray[np.int64], tool: ToolSpec, axes: Array, tip: Array, gravity: Array
) -> Array:
    """What tool and contact put on the sensor, in its axes about its origin, (n, 6).

    Args:
        motion: of the loop. robot: with a sensor frame. columns: of the loop's joints in a log.
        tool: as it is. axes: rows tangent1, tangent2, normal. tip: as it is, in the sensor frame [m].
        gravity: base frame [m/s²], (3,).
    """
    order = np.argsort(columns)
    q, dq, ddq = (np.ascontiguousarray(part[:, order]) for part in (motion.q, motion.dq, motion.ddq))
    sensor = robot.kinematics(robot.sensor_frame or "", q, dq, ddq)
    force = np.einsum("nji,nj->ni", sensor.rotation, motion.force @ axes)
    out = tool_load(tool, sensor, gravity)
    out[:, :3] += force
    out[:, 3:] += np.cross(tip, force)
    return out


def _directions(q: Array) -> Array:
    """Direction in which each joint last moved, −1…1, turning within 0.1 mrad (Dahl's bristle), (n, N)."""
    out, steps = np.zeros_like(q), np.diff(q, axis=0)
    gone, sign = np.exp(-np.abs(steps) / 1e-4), np.sign(steps)
    for i in range(len(steps)):
        out[i + 1] = sign[i] + (out[i] - sign[i]) * gone[i]
    return out
