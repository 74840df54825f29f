"""What calibration leaves open: where the surface is, the clock, and the bias of each channel, each inside its tolerance.

A search leaves them free, with a normal prior of one tolerance. The surface acts through the law, wherever a search goes: where
contact begins decides what memory and bristles hold. Clock and bias only add to predictions.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout, Signals
from kinid.kernels.acquisition import slopes

Array = NDArray[np.float64]

#: what calibration is trusted to, as a standard deviation: surface [m], clocks [s], bias [N] and [N·m], of joint torques [N·m]
SURFACE, CLOCK, BIAS_FORCE, BIAS_TORQUE, BIAS_JOINT = 1.5e-5, 1.25e-4, 0.01, 5e-4, 2.5e-3
#: shifted motions that are kept, the latest: what follows from them is worked out once for all parameters that act elsewhere
LATEST = 4
#: it moves no further than so many times that
MOST_SHIFT = 2.0


class Calibration:
    """The open quantities of a log; a shift (k,) counts each in its tolerance: surface, where there is one, clock, biases."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self._shifted: dict[float, Signals] = {}
        self.surface = signals.layout.kind != "joints" and bool((signals.depth > 0).any())
        self._bias = bias_of(signals.layout)

    def __len__(self) -> int:
        return int(self.surface) + 1 + len(self._bias)

    def signals(self, shift: Array) -> Signals:
        """The motion with its surface shifted."""
        if not self.surface or not len(shift) or shift[0] == 0.0:
            return self._signals
        place = float(shift[0])
        found = self._shifted.get(place)
        if found is None:
            found = self._shifted[place] = dataclasses.replace(self._signals, depth=self._signals.depth + place * SURFACE)
            for earlier in list(self._shifted)[:-LATEST]:
                self._shifted.pop(earlier, None)  # another thread may have been first
        return found

    def late(self, predicted: Array) -> Array:
        """What a tolerance of the clock adds to predictions (channels, n), the same shape; nothing where memory begins anew."""
        out = np.empty_like(predicted)
        slopes(predicted, self._signals.dt, CLOCK, out)
        return out

    def added(self, shift: Array, late: Array) -> Array:
        """What clock and biases at a shift add to predictions, (channels, n), for what a tolerance of the clock adds."""
        out: Array = shift[-len(self._bias) - 1] * late + (shift[-len(self._bias) :] * self._bias)[:, None]
        return out

    def most(self, shift: Array) -> str:
        """Which quantity a shift (k,) moves by most of its tolerances, and how far, in words."""
        layout = self._signals.layout
        named = ([("the surface", SURFACE, "m")] if self.surface else []) + [("the clock", CLOCK, "s")]
        named += [(f"bias of {name}", size, unit) for name, size, unit in zip(layout.channels, self._bias, layout.units)]
        i = int(np.argmax(np.abs(shift)))
        what, size, unit = named[i]
        return f"{what}, by about {shift[i] * size:.2g} {unit}"

    def constant(self, channel: int, like: Array) -> Array:
        """What a tolerance of one channel's bias adds, (channels, n)."""
        out = np.zeros_like(like)
        out[channel] = self._bias[channel]
        return out


def bias_of(layout: Layout) -> Array:
    """Tolerance of each channel's bias, (channels,)."""
    if layout.kind == "joints":
        return np.full(len(layout.units), BIAS_JOINT)
    return np.array([BIAS_FORCE if unit == "N" else BIAS_TORQUE for unit in layout.units])
