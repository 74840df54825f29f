"""What an effect that leaves its mark in the samples themselves is shown, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.effects._signals import Array, Layout
from kinid.signal.noise import white_noise

Mask = NDArray[np.bool_]

#: no channel is believed to be quieter [N, N·m]
QUIETEST = 1e-9
#: so many samples on two or three values are on a lattice, too
MANY = 1000


@dataclass(frozen=True, eq=False)
class Samples:
    """Readings as the converter gave them.

    Attributes:
        raw: (channels, n). expected: raw readings of the fitted model, (channels, n); None where nothing was fitted.
        noise: standard deviation of the white noise of each channel, (channels,).
        valid: samples whose reading counts, (n,). t: time [s], (n,). period: median time between samples [s].
        layout: of the channels.
    """

    raw: Array
    expected: Array | None
    noise: Array
    valid: Mask
    t: Array
    period: float
    layout: Layout

    def white(self, readings: Array, valid: Mask | None = None) -> Array:
        """White noise of each channel of readings (channels, n) in their differences, where they count, (channels,)."""
        count = self.valid if valid is None else valid
        return np.array([max(QUIETEST, white_noise(channel[count])) for channel in readings])

    def named(self, values: Array, hit: Mask, joined: str) -> str:
        """Channels that something was found in, (channels,), and the value of each, in words."""
        layout = self.layout
        return ", ".join(
            f"{channel} {joined} {value:.4g} {unit}"
            for channel, unit, value, is_hit in zip(layout.channels, layout.units, values, hit)
            if is_hit
        )


@dataclass(frozen=True, eq=False)
class Detection:
    """What was found in samples.

    Attributes:
        values: of the effect's parameters. says: in words.
        held: values with which other parameters are searched and readings are predicted; None: `values`.
        form: fields of the effect that the samples tell, such as the frequency of a line.
        keep: samples that still count, (n,); None: all. removed: what to take off raw readings, (channels, n); None:
            nothing.
        noise: standard deviation of the white noise of each channel from then on, (channels,); None: as before.
        relative: the samples don't tell it alone, but beside what the model expects.
        usual: every rig has as much: it counts as noise, and is no finding.
    """

    values: Array
    says: str
    held: Array | None = None
    form: Mapping[str, object] = field(default_factory=dict)
    keep: Mask | None = None
    removed: Array | None = None
    noise: Array | None = None
    relative: bool = False
    usual: bool = False


def lattice(values: Array) -> float:
    """Step of the lattice that all values (n,) lie on, but perhaps the ends of the range; 0 where there is none."""
    distinct = np.unique(values[np.isfinite(values)])
    return _step(distinct, len(values)) or _step(distinct[1:-1], len(values))


def _step(distinct: Array, count: int) -> float:
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * max(1e-12, float(np.abs(distinct).max(initial=0.0)))]
    if len(gaps) < 3 and not (len(gaps) and count >= MANY):
        return 0.0
    step = float(gaps.min())
    wholes = gaps / step
    # noise-free doubles have gaps of any size; readings of a converter only whole multiples of one
    return float(np.median(gaps[np.round(wholes) == 1])) if np.abs(wholes - np.round(wholes)).max() < 1e-3 else 0.0
