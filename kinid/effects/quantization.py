"""Readings on a lattice."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: so many samples on two or three values are on a lattice, too
MANY = 1000


@final
class Quantization(Effect):
    """y = h round(f/h) for each channel: whole numbers of a step h; none leaves a channel as it is."""

    id = "quantization"
    title = "steps of the converter"
    equation = "y = h round(f / h)"
    source = "W. R. Bennett, Bell System Technical Journal 27(3), 1948"
    signature = "a lattice of values, and steps where the reading changes slowly"
    excited_by = "noise below half a step, or slow changes"
    needs = ()
    detector = True
    null = {"step": 0.0}
    affine = False
    turn = 4

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One step a channel."""
        sizes = {"N": 0.01, "N·m": 2.5e-4}
        return tuple(
            Parameter(f"step[{name}]", "h", unit, sizes[unit], 0.0, 1e3, scale=sizes[unit])
            for name, unit in zip(layout.channels, layout.units)
        )

    def marks(self, measured: Array) -> tuple[Array, Array]:
        """The step between neighbouring values of each channel, where all values lie on its lattice; else none.

        The search for other parameters goes without steps: rounding moves a reading up as often as down, and a staircase
        has no slope to follow.
        """
        steps = np.array([_lattice(channel[np.isfinite(channel)]) for channel in measured])
        return steps, np.zeros_like(steps)

    def acquisition(self, s: Signals, p: Array) -> None:
        """Round the readings."""
        step = np.where(p > 0.0, p, 1.0)[:, None]
        s.reading = np.where(p[:, None] > 0.0, step * np.round(s.reading / step), s.reading)


def _lattice(values: Array) -> float:
    """Step of the lattice that all values lie on, 0 where there is none."""
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * max(1e-12, float(np.abs(distinct).max(initial=0.0)))]
    if len(gaps) < 3 and not (len(gaps) and len(values) >= MANY):
        return 0.0
    step = float(gaps.min())
    wholes = gaps / step
    # noise-free doubles have gaps of any size; readings of a converter only whole multiples of one
    return float(np.median(gaps[np.round(wholes) == 1])) if np.abs(wholes - np.round(wholes)).max() < 1e-3 else 0.0
