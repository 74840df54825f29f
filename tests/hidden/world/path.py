"""Where a tool goes: pieces of smooth motion one after another, each with the name of its phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: [Hz] at which worlds are simulated, and at which they are logged
FINE, LOGGED = 5000, 500
#: [s] over which a motion of constant speed begins and ends
BLEND = 0.1


@dataclass(frozen=True, eq=False)
class Path:
    """Time [s] (n,), coordinates (n, k) and phase (n,), at the fine rate."""

    t: Array
    x: Array
    phase: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.t)

    @property
    def rate(self) -> Array:
        """Velocity of the coordinates, (n, k)."""
        out: Array = np.gradient(self.x, 1.0 / FINE, axis=0)
        return out

    @property
    def logged(self) -> slice:
        """Every so many fine samples is one of the log."""
        return slice(0, None, FINE // LOGGED)


class Script:
    """Builds a path piece by piece; coordinates that a piece doesn't name stay."""

    def __init__(self, names: tuple[str, ...], rng: np.random.Generator, **start: float) -> None:
        self.names = names
        self.rng = rng
        self._now = np.array([start.get(name, 0.0) for name in names])
        self._pieces: list[Array] = []
        self._phases: list[tuple[str, int]] = []

    def __getitem__(self, name: str) -> float:
        return float(self._now[self.names.index(name)])

    @property
    def duration(self) -> float:
        """So far [s]."""
        return sum(n for _, n in self._phases) / FINE

    def move(self, phase: str, seconds: float, **to: float) -> None:
        """At rest at both ends, with continuous acceleration."""
        s = self._grid(seconds)
        self._add(phase, self._now + (s**3 * (10 - 15 * s + 6 * s**2))[:, None] * self._way(to))

    def cruise(self, phase: str, speed: float, **to: float) -> None:
        """At a constant speed between a smooth start and a smooth end."""
        way = self._way(to)
        length = float(np.linalg.norm(way))
        blend = min(BLEND, length / speed)
        total = length / speed + blend
        tau = self._grid(total) * total
        up, down = np.clip(tau / blend, 0, 1), np.clip((total - tau) / blend, 0, 1)
        way_so_far = np.cumsum((1 - np.cos(np.pi * up)) * (1 - np.cos(np.pi * down)))
        self._add(phase, self._now + (way_so_far / way_so_far[-1])[:, None] * way)

    def rest(self, phase: str, seconds: float) -> None:
        """Stand still."""
        self.move(phase, seconds)

    def sway(self, phase: str, seconds: float, lines: int, low: float, high: float, **amplitude: float) -> None:
        """A sum of sines between two frequencies [Hz] of random phase, windowed, with this largest excursion."""
        s = self._grid(seconds)
        window = np.clip(np.minimum(s, 1 - s) * seconds / min(0.4, seconds / 3), 0, 1)
        window = window**3 * (10 - 15 * window + 6 * window**2)
        way = np.zeros((len(s), len(self.names)))
        for name, size in amplitude.items():
            tones = np.geomspace(low, high, lines) * self.rng.uniform(0.93, 1.07, lines)
            turns = self.rng.uniform(0, 2 * np.pi, lines)
            wave = window * np.sin(2 * np.pi * np.outer(s * seconds, tones) + turns).sum(axis=1)
            way[:, self.names.index(name)] = size * wave / np.abs(wave).max()
        self._add(phase, self._now + way)

    def path(self, tremor: Array | None = None) -> Path:
        """All pieces; `tremor` [coordinate units, rms] shakes each coordinate a little below 8 Hz, as machines do."""
        x = np.concatenate(self._pieces)
        if tremor is not None:
            x = x + shake(self.rng, len(x), np.asarray(tremor))
        phase = np.concatenate([np.full(n, name) for name, n in self._phases])
        return Path(np.arange(len(x)) / FINE, x, phase)

    def _grid(self, seconds: float) -> Array:
        return np.arange(1, max(2, round(seconds * FINE)) + 1) / max(2, round(seconds * FINE))

    def _way(self, to: dict[str, float]) -> Array:
        way = np.zeros(len(self.names))
        for name, value in to.items():
            way[self.names.index(name)] = value - self[name]
        return way

    def _add(self, phase: str, x: Array) -> None:
        self._pieces.append(x)
        self._phases.append((phase, len(x)))
        self._now = x[-1].copy()


def shake(rng: np.random.Generator, n: int, rms: Array) -> Array:
    """Random motion between 1 and 8 Hz, (n, k), smooth to the second derivative."""
    seconds = n / FINE
    tones = rng.uniform(1.0, 8.0, (24, len(rms)))
    turns = rng.uniform(0, 2 * np.pi, (24, len(rms)))
    knots = np.arange(0, seconds + 0.02, 0.01)
    coarse = np.sqrt(2 / 24) * np.sin(2 * np.pi * knots[:, None, None] * tones + turns).sum(axis=1) * rms
    from scipy.interpolate import CubicSpline

    out: Array = CubicSpline(knots, coarse)(np.arange(n) / FINE)
    return out
