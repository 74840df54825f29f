"""Velocities and accelerations that a log lacks: a zero-phase differentiator whose bandwidth is stated and can be set.

A polynomial is fitted to the samples around each instant, by least squares over their actual times, and its derivatives
are taken there (Savitzky & Golay 1964). The fit is symmetric in time, so it delays nothing; where sampling is nearly
even it is a convolution, and the chain rule accounts for the actual times. The window follows from the bandwidth: the
widest for which the velocity of a sine at that frequency still comes through with at least 1/√2 of its amplitude
(−3 dB).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, expect
from kinid.signal.pieces import GAP_FACTOR, runs

Array = NDArray[np.float64]

#: sampling this uneven (relative to the median period) is fitted with the actual times
UNEVEN = 0.02


@dataclass(frozen=True)
class Derivatives:
    """First and second derivative, each of the shape of what was differentiated, and how they came about."""

    first: Array
    second: Array
    window: int  # samples
    bandwidth: float  # −3 dB of the first derivative [Hz]


@dataclass(frozen=True)
class Differentiator:
    """Local polynomials of degree `order` over a window that passes `bandwidth`.

    Attributes:
        bandwidth: frequency [Hz] at which the first derivative is down by 3 dB.
        order: degree of the polynomial.

    Raises:
        InputError: a bandwidth that is not positive, or a degree without a second derivative.
    """

    bandwidth: float = 25.0
    order: int = 4

    def __post_init__(self) -> None:
        expect(self.bandwidth, (int, float), "a differentiator's bandwidth", "a frequency in Hz", "give one, as 25")
        if not (np.isfinite(self.bandwidth) and self.bandwidth > 0):
            raise InputError(
                f"a differentiator bandwidth of {self.bandwidth} Hz",
                "a positive frequency in Hz",
                "give one well below half the sampling rate, e.g. 25",
            )
        if self.order < 2:
            raise InputError(f"a differentiator of order {self.order}", "2 or more", "leave it at 4")

    def half_window(self, period: float) -> int:
        """Samples on each side of the instant, for samples `period` [s] apart."""
        # Schafer 2011 gives the scale of the answer; the exact response decides
        guess = int((self.order + 1) / (3.2 * 2 * self.bandwidth * period) + 2)
        least = self.order // 2 + 1
        half = max(least, min(guess, 100_000))
        while half > least and self._gain(half, period, self.bandwidth) < np.sqrt(0.5):
            half -= max(1, half // 50)
        while self._gain(half + 1, period, self.bandwidth) >= np.sqrt(0.5) and half < 100_000:
            half += 1
        return max(half, least)

    def achieved_bandwidth(self, half: int, period: float) -> float:
        """Frequency [Hz] at which the first derivative of this window is down by 3 dB."""
        low, high = 0.0, 0.5 / period
        for _ in range(50):
            middle = 0.5 * (low + high)
            if self._gain(half, period, middle) >= np.sqrt(0.5):
                low = middle
            else:
                high = middle
        return low

    def __call__(self, t: Array, x: Array, pieces: Iterable[slice]) -> Derivatives:
        """Differentiate `x` (n, k) sampled at `t` [s] (n,), each of `pieces` by itself; NaN outside of them.

        Rows of `x` that hold a value that is not a finite number are left out, and stay NaN. What is shorter than the
        window is fitted as a whole, with a lower degree where it has to be; the derivative at a single sample on its
        own is unknown, NaN.
        """
        from kinid.kernels.local_polynomial import differentiate

        x = np.ascontiguousarray(x)  # the kernels walk through rows
        first, second = np.full_like(x, np.nan), np.full_like(x, np.nan)
        period = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        half = self.half_window(period)
        for rows in runs(t, x, pieces, GAP_FACTOR * period):
            length = len(rows)
            if length < 2:
                continue
            order = min(self.order, length - 1)
            reach = min(half, (length - 1) // 2)
            taps = self.taps(reach, period) if 2 * reach >= self.order else np.zeros((2, 0))
            one, two = np.full((2, length, x.shape[1]), np.nan)
            differentiate(t[rows], x[rows], reach, order, taps, UNEVEN * period, period, one, two)
            first[rows], second[rows] = one, two
        return Derivatives(first, second, 2 * half + 1, self.achieved_bandwidth(half, period))

    def taps(self, half: int, period: float) -> Array:
        """Convolution for even sampling: rows for the first and the second derivative, (2, 2·half + 1)."""
        scale = half * period  # the fit is solved in times of order one
        powers = np.vander(np.arange(-half, half + 1) / half, self.order + 1, increasing=True)
        fit = np.linalg.pinv(powers)
        taps: Array = np.stack([fit[1] / scale, 2.0 * fit[2] / scale**2])
        return taps

    def _gain(self, half: int, period: float, frequency: float) -> float:
        """First derivative of a sine of this frequency, relative to the true one."""
        if frequency == 0.0:
            return 1.0
        omega = 2 * np.pi * frequency
        # for odd derivatives, degree 2m and 2m − 1 give the same taps; moments give them without a matrix of samples
        k = np.arange(1, half + 1) / half
        odd = np.arange(1, self.order + 1, 2)
        basis = k[:, None] ** odd
        coefficients = np.linalg.solve(2 * basis.T @ basis, 2 * basis.T @ np.sin(omega * period * half * k))
        return float(coefficients[0] / (half * period) / omega)
