"""Formulas of what is done to readings: of any sensor, of its clock and of its converter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from measured.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shape:
    """A change that grows in proportion to its size: Σ weight · column.

    Attributes:
        columns: all that an effect of this name could do to the readings, (m, n, k). weights: of the one that is
            injected, (m,).
        signed: whether each column may come with either sign. note: what was drawn, in words.
        most: that any machine does to a channel, (k,); None for no limit.
    """

    columns: Array
    weights: Array
    signed: bool = True
    note: str = ""
    most: Array | None = None


@dataclass(frozen=True, eq=False)
class Grown:
    """A change that does not: readings (n, k) for a size, which does more the larger it is, between two bounds."""

    readings: Callable[[float], Array]
    low: float
    high: float
    note: str = ""


Draw = Callable[[Scene, np.random.Generator], Shape | Grown]


def by_channel(scene: Scene, shapes: Array, rng: np.random.Generator, *, signed: bool, note: str = "") -> Shape:
    """One column a channel, of shapes (n, k); all channels alike strong in units of what is left in them, to within a
    draw.

    Half of the time one channel alone, or two, have it: one worn joint, one cable.
    """
    k = shapes.shape[1]
    size = np.sqrt(np.mean(shapes**2, axis=0))
    columns: Array = np.zeros((k, *shapes.shape))
    for c in range(k):
        columns[c, :, c] = shapes[:, c] * (scene.left[c] / size[c] if size[c] > 0 else 0.0)
    weights: Array = np.asarray(rng.uniform(0.6, 1.0, k) * (rng.choice([-1.0, 1.0], k) if signed else 1.0))
    if k > 2 and rng.uniform() < 0.5:
        few = rng.choice(k, rng.integers(1, 3), replace=False)
        weights[np.setdiff1d(np.arange(k), few)] = 0.0
    return Shape(columns, weights, signed, f"channels {np.flatnonzero(weights).tolist()}{f', {note}' if note else ''}")


def bias(scene: Scene, rng: np.random.Generator) -> Shape:
    """A constant on each channel."""
    return by_channel(scene, np.ones_like(scene.readings), rng, signed=True)


def drift(scene: Scene, rng: np.random.Generator) -> Shape:
    """A ramp on each channel, of 10 N or 1 N·m a minute at most."""
    t, k = scene.log.t, scene.readings.shape[1]
    ramps = by_channel(scene, np.outer((t - t[0]) / (t[-1] - t[0]), np.ones(k)), rng, signed=True)
    torques = np.arange(k) >= (0 if scene.source.family in ("arm", "leg") else 3)
    return replace(ramps, most=np.where(torques, 1.0, 10.0) * (t[-1] - t[0]) / 60.0)


def gain(scene: Scene, rng: np.random.Generator) -> Shape:
    """A scale of each channel: all that it reads, noise as well."""
    return by_channel(scene, scene.readings, rng, signed=True)


def one_gain(scene: Scene, rng: np.random.Generator) -> Shape:
    """One scale for all channels."""
    return Shape(scene.readings[None], rng.choice([-1.0, 1.0], 1))


def hum(scene: Scene, rng: np.random.Generator) -> Shape:
    """The mains on the cable, a grid that wanders a little, with a third of it at the third harmonic.

    Logs of less than 110 Hz show none: it comes back as noise of another frequency.
    """
    turn = 2 * np.pi * (50.0 * scene.log.t + 0.02 * np.sin(0.07 * scene.log.t) + rng.uniform())
    wave = np.sin(turn) * (scene.log.period < 1 / 110) + 0.3 * np.sin(3 * turn) * (scene.log.period < 1 / 400)
    return by_channel(scene, np.outer(wave, np.ones(scene.readings.shape[1])), rng, signed=True)


def late(scene: Scene, rng: np.random.Generator) -> Grown:
    """Readings that come late or early."""
    t, sign = scene.log.t, float(rng.choice([-1.0, 1.0]))
    stream = CubicSpline(t, scene.readings, axis=0)
    return Grown(lambda by: stream(np.clip(t - sign * by, t[0], t[-1])), 1e-6, 0.3, "late" if sign > 0 else "early")


def lag(scene: Scene, rng: np.random.Generator) -> Grown:
    """Readings behind an amplifier of one pole, integrated in steps of an eighth of the log's (trapezoidal)."""
    t = scene.log.t
    fine = np.arange(t[0], t[-1] + scene.log.period / 8, scene.log.period / 8)
    stream = CubicSpline(t, scene.readings, axis=0)(np.minimum(fine, t[-1]))

    def behind(tau: float) -> Array:
        a = (fine[1] - fine[0]) / (2 * tau)
        slow = lfilter([a / (1 + a)] * 2, [1, -(1 - a) / (1 + a)], stream - stream[0], axis=0) + stream[0]
        return np.stack([np.interp(t, fine, column) for column in slow.T], axis=1)

    return Grown(behind, scene.log.period / 4, 0.5)


def lattice(scene: Scene, rng: np.random.Generator) -> Grown:
    """A coarse converter: each channel in steps in proportion to what is left in it."""
    values, steps = scene.readings, scene.left * rng.uniform(0.7, 1.3, scene.readings.shape[1])
    return Grown(lambda size: size * steps * np.round(values / (size * steps)), 1e-2, 60.0)


def clip(scene: Scene, rng: np.random.Generator) -> Grown:
    """A converter at the end of its range; half of the time its own noise is behind the clip."""
    values, top = scene.readings, np.abs(scene.readings).max(axis=0)
    noise = 0.1 * scene.left * rng.standard_normal(values.shape) * float(rng.uniform() < 0.5)
    behind = bool(noise.any())

    def clipped(share: float) -> Array:
        limit = (1.0 - share) * top
        cut = np.abs(values) > limit
        return np.asarray(np.clip(values, -limit, limit) + noise * cut)

    return Grown(clipped, 1e-3, 0.9, "noise behind the clip" if behind else "flat tops")
