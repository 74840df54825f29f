"""Campaigns of a material tester's short logs, on equations written here."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import kinid

Array = NDArray[np.float64]

RATE, SPAN, NOISE = 200.0, 8.0, 0.02
#: N/m, N·s/m
STIFFNESS, DAMPING = 800.0, 6.0


def swing(seed: int, t: Array) -> tuple[Array, Array]:
    """Depth [m] and its rate [m/s] of a slow swing with a fast one on it, in and out of the material, (n,) each."""
    rng = np.random.default_rng([seed, 2])
    slow, fast, when = rng.uniform(0.4, 0.8), rng.uniform(2.0, 2.6), rng.uniform(0.0, 6.0)
    a, b = 2 * np.pi * slow, 2 * np.pi * fast
    depth = 2e-3 * np.sin(a * t + when) + 0.7e-3 * np.sin(b * t)
    return depth, 2e-3 * a * np.cos(a * t + when) + 0.7e-3 * b * np.cos(b * t)


def poked(
    seed: int,
    *,
    stiffness: float = STIFFNESS,
    damping: float = DAMPING,
    offset: float = 0.0,
    bias: float = 0.0,
    stiffening: float = 0.0,
    motion: int | None = None,
    noise: float = NOISE,
    gain: float = 1.0,
) -> kinid.Log:
    """A tester that swings in and out of a spring with a dashpot, which lets go and doesn't pull.

    Args:
        seed: of noise, and of the motion where `motion` doesn't say it. offset: by which the surface lies further out
            than recorded [m]. bias: of the force [N]. stiffening: force that grows with the square of depth [N/m²].
            noise: of the force [N]. gain: of the sensor, another's calibration in the file [1].
    """
    drawn = np.random.default_rng([seed, 1])
    t = np.arange(int(SPAN * RATE)) / RATE
    recorded, rate = swing(seed if motion is None else motion, t)
    depth = recorded + offset
    force = np.where(depth > 0, stiffness * depth + damping * rate + stiffening * depth**2, 0.0)
    force = gain * np.maximum(force, 0.0) + bias + noise * drawn.standard_normal(len(t))
    return kinid.Log(t=t, contact={"depth": recorded, "depth_rate": rate, "normal_force": force})


def several(count: int, seed: int = 0, **truth: float) -> list[kinid.Log]:
    """So many logs, each with a surface offset and a bias of its own."""
    rng = np.random.default_rng([seed, 3])
    offsets, biases = 1e-4 * rng.standard_normal(count), 0.05 * rng.standard_normal(count)
    return [
        poked(1000 * seed + i, offset=float(z), bias=float(b), **truth)  # type: ignore[arg-type]
        for i, (z, b) in enumerate(zip(offsets, biases))
    ]
