"""Depths over time that no few sines make: strokes that change their speed, and stairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.planning.signals import Sampled

Array = NDArray[np.float64]

#: samples a second of these signals
RATE = 100.0
#: where strokes turn, as shares of the depth
SHALLOW, DEEP = 0.02, 0.98
#: rests of stairs, and the way between two of them [s]
REST, WAY = 0.45, 0.3
#: from one speed of strokes to the other [s]
SHIFT = 0.4


def by_turns(slow: float, fast: float, depth: float, duration: float) -> Sampled:
    """In and out between `SHALLOW` and `DEEP` of a depth [m], one stroke at `slow`, then about as long at `fast`
    [Hz].
    """
    t = np.arange(int(duration * RATE) + 1) / RATE
    turn = 1.0 / slow
    # 0 … 1 … 0, smoothly: which of the two speeds it is
    share = _smooth((t % (2 * turn)) / SHIFT) - _smooth((t % (2 * turn) - turn) / SHIFT)
    frequency = fast + (slow - fast) * share
    angle = 2 * np.pi * np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]))]) / RATE
    return Sampled(t, depth * (0.5 * (SHALLOW + DEEP) + 0.5 * (DEEP - SHALLOW) * np.sin(angle)))


def stairs(depth: float, duration: float, levels: int = 5) -> Sampled:
    """Rests at evenly spaced depths between `SHALLOW` and `DEEP` of a depth [m], up and down again and again."""
    t = np.arange(int(duration * RATE) + 1) / RATE
    order = np.r_[np.arange(levels), np.arange(levels - 2, 0, -1)]
    heights = np.linspace(SHALLOW, DEEP, levels)[order]
    step, within = np.divmod(t, REST + WAY)
    at = step.astype(int)
    here, there = heights[at % len(order)], heights[(at + 1) % len(order)]
    return Sampled(t, depth * (here + (there - here) * _smooth((within - REST) / WAY)))


def _smooth(u: Array) -> Array:
    """0 → 1 over 0 … 1 with three continuous derivatives."""
    x = np.clip(u, 0.0, 1.0)
    out: Array = x**4 * (35 + x * (-84 + x * (70 - 20 * x)))
    return out
