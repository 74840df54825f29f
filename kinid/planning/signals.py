"""Depths over time for the motion phase: multisines and users' own samples, with derivatives, faded in and out.

Depths in m, > 0 inside the material. Every signal begins and ends at rest at its own base depth.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.writers import Json

Array = NDArray[np.float64]

#: fading in, and out [s]
FADE = 0.3
#: samples that a user's signal needs: those of a spline of fifth degree
FEWEST = 6


class Signal(ABC):
    """A depth over time. `Multisine` and `Sampled` are the two there are."""

    duration: float
    fade: float

    @property
    @abstractmethod
    def base(self) -> float:
        """Where it begins and ends, at rest [m]."""

    @abstractmethod
    def raw(self, t: Array) -> Array:
        """The unfaded deviation from the base and its first three derivatives, (4, n)."""

    def __call__(self, t: Array) -> Array:
        """Depth [m] and its first three derivatives at times from the beginning, (4, n)."""
        t = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        u, w = self.raw(t), fading(t, self.duration, self.fade)
        out = np.empty((4, len(t)))
        # Leibniz's rule
        out[0] = self.base + w[0] * u[0]
        out[1] = w[1] * u[0] + w[0] * u[1]
        out[2] = w[2] * u[0] + 2 * w[1] * u[1] + w[0] * u[2]
        out[3] = w[3] * u[0] + 3 * w[2] * u[1] + 3 * w[1] * u[2] + w[0] * u[3]
        return out


@final
@dataclass(frozen=True)
class Multisine(Signal):
    """depth + w(t) Σ aᵢ sin(2π fᵢ t + φᵢ), with w the fade.

    Attributes:
        depth: about which [m]. sines: (amplitude [m], frequency [Hz]) or (amplitude, frequency, phase [rad]) each.
        duration [s]. fade: in and out [s].
    """

    depth: float
    sines: tuple[tuple[float, ...], ...] = ()
    duration: float = 4.0
    fade: float = FADE

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise InputError(f"a motion of {self.duration} s", "a positive duration", "correct it")
        if not (np.isfinite(self.fade) and 0 < self.fade <= self.duration / 2):
            raise InputError(
                f"a motion of {self.duration} s that is faded in and out over {self.fade} s each",
                "one at least twice as long as its fade",
                f"make it longer: --duration {2 * FADE:g} or more",
            )
        for sine in self.sines:
            if len(sine) not in (2, 3) or not np.isfinite(sine).all() or sine[1] <= 0:
                raise InputError(
                    f"a sine {sine}", "amplitude [m], frequency [Hz] and perhaps phase [rad]", "correct it"
                )
        if not np.isfinite(self.depth):
            raise InputError(f"a depth of {self.depth} m", "a number", "correct it")

    @property
    def base(self) -> float:
        """The depth about which it swings."""
        return self.depth

    def raw(self, t: Array) -> Array:
        """The sum of sines."""
        out = np.zeros((4, len(t)))
        for amplitude, frequency, *rest in self.sines:
            w = 2 * np.pi * frequency
            angle = w * t + (rest[0] if rest else 0.0)
            sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
            out += sine * np.array([[1.0], [0.0], [-(w**2)], [0.0]]) + cosine * np.array([[0.0], [w], [0.0], [-(w**3)]])
        return out

    def to_dict(self) -> Json:
        """For provenance."""
        return {
            "kind": "multisine",
            "depth": self.depth,
            "sines": [list(s) for s in self.sines],
            "duration": self.duration,
            "fade": self.fade,
        }


@final
@dataclass(frozen=True, eq=False)
class Sampled(Signal):
    """A user's depths, joined by a spline of fifth degree.

    Attributes:
        t: rising times [s], (n,). depths: [m], (n,). fade: in and out [s].
    """

    t: Array
    depths: Array
    fade: float = FADE

    def __post_init__(self) -> None:
        t, depths = np.asarray(self.t, dtype=float), np.asarray(self.depths, dtype=float)
        if t.ndim != 1 or t.shape != depths.shape or len(t) < FEWEST:
            raise InputError(
                f"a signal of {t.shape} times and {depths.shape} depths",
                f"at least {FEWEST} of each",
                "write columns t [s] and depth [m]",
            )
        if not (np.isfinite(t).all() and np.isfinite(depths).all() and (np.diff(t) > 0).all()):
            raise InputError(
                "a signal with times that don't rise, or values that are no numbers",
                "t that rises, finite depth",
                "repair its table",
            )
        if not 0 < self.fade <= (t[-1] - t[0]) / 2:
            raise InputError(
                f"a signal of {t[-1] - t[0]:.3g} s that is faded in and out over {self.fade} s each",
                "one at least twice as long as its fade",
                "give a longer one",
            )
        from scipy.interpolate import make_interp_spline

        object.__setattr__(self, "_spline", make_interp_spline(t - t[0], depths, k=5))

    @property
    def duration(self) -> float:  # type: ignore[override]
        """[s]"""
        return float(self.t[-1] - self.t[0])

    @property
    def base(self) -> float:
        """The mean depth."""
        return float(np.mean(self.depths))

    def raw(self, t: Array) -> Array:
        """The spline, less the mean."""
        spline = self.__dict__["_spline"]
        out = np.stack([spline(t, nu) for nu in range(4)])
        out[0] -= self.base
        return out

    def to_dict(self) -> Json:
        """For provenance."""
        return {"kind": "samples", "count": len(self.t), "duration": self.duration, "fade": self.fade}


def fading(t: Array, duration: float, fade: float) -> Array:
    """0 → 1 → 0 with three continuous derivatives, and those, (4, n): 35 u⁴ − 84 u⁵ + 70 u⁶ − 20 u⁷ at both ends."""
    out = np.zeros((4, len(t)))
    out[0] = 1.0
    for u, sign, rows in ((t / fade, 1.0, t < fade), ((duration - t) / fade, -1.0, t > duration - fade)):
        x = np.clip(u[rows], 0.0, 1.0)
        k = sign / fade
        out[0, rows] = x**4 * (35 + x * (-84 + x * (70 - 20 * x)))
        out[1, rows] = k * 140 * x**3 * (1 - x) ** 3
        out[2, rows] = k**2 * 420 * x**2 * (1 - x) ** 2 * (1 - 2 * x)
        out[3, rows] = k**3 * 840 * x * (1 - x) * (1 - 5 * x + 5 * x**2)
    return out
