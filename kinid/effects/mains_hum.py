"""The power grid in the cables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: frequencies of power grids [Hz], how far they may be off, and the least step in which a line is looked for at first
GRIDS, OFF, COARSE = (50.0, 60.0), 0.3, 0.01


@final
@dataclass(frozen=True)
class MainsHum(Effect):
    """y = f + Σ_h a_h sin 2πh f₀t + b_h cos 2πh f₀t for each channel.

    Attributes:
        frequency: f₀ [Hz]; None is where the log's own readings have the sharpest line near 50 or 60 Hz (a grid drifts by
            part of a turn in half a minute), and 50 where there are none.
        harmonics: which h.
    """

    frequency: float | None = None
    harmonics: tuple[int, ...] = (1, 2, 3)

    id = "mains-hum"
    title = "hum of the mains"
    equation = "y = f + Σ_h a_h sin 2πh f₀t + b_h cos 2πh f₀t"
    source = "IEC 60038 (grid frequencies)"
    signature = "lines in the spectrum at the grid's frequency and its harmonics, in every phase"
    excited_by = "any log sampled faster than twice the grid's frequency"
    needs = ()
    detector = True
    null = {"sine": 0.0, "cosine": 0.0}
    turn = 2

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Sine and cosine amplitude of each harmonic, channel by channel."""
        return tuple(
            Parameter(f"{wave}[{name},{h}]", symbol, unit, 0.0, scale=0.05 if unit == "N" else 0.002, linear=True)
            for name, unit in zip(layout.channels, layout.units)
            for h in self.harmonics
            for wave, symbol in (("sine", "a"), ("cosine", "b"))
        )

    def acquisition(self, s: Signals, p: Array) -> None:
        """Add the hum."""
        frequency = self.frequency or _line_of(s)
        angles = [2.0 * np.pi * h * frequency * s.t for h in self.harmonics]
        waves = np.stack([wave(angle) for angle in angles for wave in (np.sin, np.cos)])
        s.reading = s.reading + p.reshape(len(s.layout.channels), -1) @ waves


def _line_of(s: Signals) -> float:
    """Frequency of the sharpest line near a grid's in the readings of a log [Hz]."""
    if s.measured is None or len(s) < 3:
        return GRIDS[0]
    readings = s.measured
    return float(derived("line of the mains", lambda: np.array([_sharpest(readings, s.t)]), readings, s.t)[0])


def _sharpest(readings: Array, t: Array) -> float:
    """Of readings (channels, n), the frequency at which the windowed transform of their differences is largest [Hz]."""
    # differences of neighbours leave lines and noise; a window keeps the rest of the motion away from them
    rough = np.nan_to_num(np.diff(readings, axis=1)) * np.hanning(readings.shape[1] - 1)
    rough /= np.maximum(np.sqrt(np.mean(rough**2, axis=1, keepdims=True)), 1e-300)

    def loudest(trials: Array) -> float:
        power = [float(np.max(np.abs(rough @ np.exp(-2j * np.pi * f * t[1:])))) for f in trials]
        return float(trials[int(np.argmax(power))])

    step = max(0.4 / max(float(t[-1] - t[0]), 1.0), COARSE)
    near = loudest(np.concatenate([np.arange(grid - OFF, grid + OFF + step / 2, step) for grid in GRIDS]))
    return loudest(near + step * np.linspace(-1.0, 1.0, 21))
