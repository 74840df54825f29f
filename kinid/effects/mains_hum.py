"""The power grid in the cables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
@dataclass(frozen=True)
class MainsHum(Effect):
    """y = f + Σ_h a_h sin 2πh f₀t + b_h cos 2πh f₀t for each channel.

    Attributes:
        frequency: f₀ [Hz], 50 or 60, or what the line in the spectrum shows; a grid drifts by part of a
            turn in half a minute.
        harmonics: which h.
    """

    frequency: float = 50.0
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
        angles = [2.0 * np.pi * h * self.frequency * s.t for h in self.harmonics]
        waves = np.stack([wave(angle) for angle in angles for wave in (np.sin, np.cos)])
        s.reading = s.reading + p.reshape(len(s.layout.channels), -1) @ waves
