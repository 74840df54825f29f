"""Physics that no effect of the catalogue holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hidden.world.path import FINE

Array = NDArray[np.float64]

#: what there is, and the size to begin with
STARTS = {
    "squeeze-film": 100.0,  # N += b v |v|, b [N·s²/m²], in contact
    "resonance": 0.3,  # a mode of the tool that impacts ring: its swing after a touch at 0.1 m/s [N]
    "cable": 10.0,  # a cable between tool and room that is dragged along: stiffness [N/m]
    "texture": 0.1,  # a tangential force periodic in the place: share of the load
    "stick-slip": 0.2,  # friction that builds up and breaks loose at random: share of the load
    "gain-swing": 0.02,  # a gain that swings with a period of 7 s: amplitude
    "person": 1.0,  # half-sine pushes at some instants [N]
}
KINDS = tuple(STARTS)
#: sizes beyond which they would be another thing altogether
MOST = {"texture": 0.5, "stick-slip": 0.5, "gain-swing": 0.5}


@dataclass(frozen=True)
class Strange:
    """One of `KINDS` with its size as `STARTS` explains it, and figures of its shape from a seed."""

    kind: str
    size: float
    seed: int


def force_of(s: Strange, t: Array, motion: Array, inside: Array, load: Array) -> Array:
    """Load on the tool with it, (n, 3); `motion` x, y, depth (n, 3), `inside` depth of the tool (n,)."""
    rng = np.random.default_rng(s.seed)
    rate = np.gradient(motion, 1.0 / FINE, axis=0)
    touching = (inside > 0.0).astype(float)
    more = np.zeros_like(load)
    if s.kind == "squeeze-film":
        more[:, 2] = s.size * rate[:, 2] * np.abs(rate[:, 2]) * touching
        more[:, 2] = np.maximum(more[:, 2], -load[:, 2])
    elif s.kind == "resonance":
        frequency, damping = rng.uniform(22.0, 45.0), rng.uniform(0.01, 0.03)
        kick = np.zeros(len(t))
        # at touches and separations, in proportion to the speed
        hits = np.flatnonzero(np.diff(touching))
        kick[hits] = np.abs(rate[hits, 2]) / 0.1
        swing = np.empty(len(t))
        _mode(kick, 2 * np.pi * frequency, damping, swing)
        more += s.size * swing[:, None] * rng.uniform(0.3, 1.0, 3)
    elif s.kind == "cable":
        away = motion - motion[0]
        pull = np.empty_like(load)
        _loose(away, np.array([8e-3, 8e-3, 4e-3]), pull)
        more = -s.size * (rng.uniform(0.4, 1.0, 3) * pull + rng.uniform(-0.4, 0.4, 3) * away[:, [1, 2, 0]])
    elif s.kind == "texture":
        pitch = rng.uniform(0.8e-3, 2e-3)
        bumps = np.sin(2 * np.pi * motion[:, :2] / pitch + rng.uniform(0, 6, 2))
        more[:, :2] = s.size * load[:, 2:] * bumps
    elif s.kind == "stick-slip":
        stick = np.empty((len(t), 2))
        _jerks(motion[:, :2], touching, rng.exponential(1.0, 20000), 0.6e-3, stick)
        more[:, :2] = -s.size * load[:, 2:] * stick
    elif s.kind == "person":
        for _ in range(9):
            start, length = rng.uniform(0.05, 0.95) * t[-1], rng.uniform(0.15, 0.6)
            push = np.sin(np.pi * np.clip((t - start) / length, 0, 1))
            way = rng.standard_normal(3)
            more += s.size * rng.uniform(0.5, 1.0) * push[:, None] * way / np.linalg.norm(way)
    elif s.kind == "gain-swing":
        pass
    else:
        raise ValueError(s.kind)
    out: Array = load + more
    return out


def reading_of(s: Strange, t: Array, reading: Array) -> Array:
    """Reading of the sensor with it, (n, k)."""
    if s.kind != "gain-swing":
        return reading
    turn = np.random.default_rng(s.seed).uniform(0, 2 * np.pi)
    out: Array = reading * (1.0 + s.size * np.sin(2 * np.pi * t / 7.0 + turn))[:, None]
    return out


@njit(cache=True)
def _mode(kick, omega, damping, out):
    """Swing of a mode, of amplitude 1 after a kick of 1; half-implicit Euler, which keeps its energy."""
    h = 1.0 / FINE
    x, v = 0.0, 0.0
    for i in range(kick.shape[0]):
        v += kick[i] * omega - h * (2 * damping * omega * v + omega * omega * x)
        x += h * v
        out[i] = x


@njit(cache=True)
def _loose(x, play, out):
    """A cable's end that is dragged: follows once it is taut."""
    end = x[0].copy()
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            end[k] = min(max(end[k], x[i, k] - play[k]), x[i, k] + play[k])
            out[i, k] = end[k] + 0.3 * (x[i, k] - end[k])


@njit(cache=True)
def _jerks(x, touching, draws, length, out):
    """Friction that rises with the way and breaks loose at a random one, along each tangent, between 0 and some."""
    way, limit, at = np.zeros(2), np.full(2, length), 0
    for i in range(x.shape[0]):
        for k in range(2):
            if i == 0 or touching[i] == 0.0:
                way[k] = 0.0
                out[i, k] = 0.0
                continue
            way[k] += x[i, k] - x[i - 1, k]
            if abs(way[k]) > limit[k]:
                way[k] = 0.0
                limit[k] = length * (0.3 + draws[at % draws.shape[0]])
                at += 1
            out[i, k] = way[k] / length
