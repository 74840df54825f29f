"""A point one of whose derivatives is white noise: how its state moves, and what a measurement makes of it.

The state is x = (position, velocity, acceleration, …) of `ORDER` parts, in units of the position and of the median
sample time, so that numbers of any unit and rate are alike. Over a step τ it moves by F(τ) and gains a covariance s
Q(τ), s the intensity in the step (Särkkä, Bayesian Filtering and Smoothing, 2013, ch. 2 and 4; Bar-Shalom et al. 2001,
6.2.3). Positions, velocities and accelerations are scalar measurements, each with its own variance, taken one after the
other; one whose variance is infinite is not there. A step of no time stands before a piece's first sample only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: the derivative that is white noise: the snap. White jerk is too rough for the accelerations of smooth motion
ORDER = 4
#: no variance is smaller
LEAST = 1e-250

#: a measurement leaves at least this share of a variance: less is not told from rounding
ROUNDING = 1e-15

_TAYLOR = np.array([1.0 / math.factorial(k) for k in range(ORDER)])
_NOISE = np.array(
    [
        [
            1.0 / (math.factorial(ORDER - 1 - i) * math.factorial(ORDER - 1 - j) * (2 * ORDER - 1 - i - j))
            for j in range(ORDER)
        ]
        for i in range(ORDER)
    ]
)


@njit(cache=True, nogil=True, error_model="numpy")
def model(h: float, move: Array, added: Array) -> None:
    """F(h), of which the first row tells all, (d,), and Q(h), (d, d)."""
    power = 1.0
    for k in range(ORDER):
        move[k] = power * _TAYLOR[k]
        power *= h
    for i in range(ORDER):
        for j in range(ORDER):
            added[i, j] = _NOISE[i, j] * h ** (2 * ORDER - 1 - i - j)


@njit(cache=True, nogil=True, error_model="numpy")
def moved(x: Array, p: Array, move: Array, added: Array, s: float) -> None:
    """X ← F x and P ← F P Fᵀ + s Q, in place: F is upper triangular, so rows follow from those below."""
    for i in range(ORDER):
        for k in range(i + 1, ORDER):
            x[i] += move[k - i] * x[k]
            for j in range(ORDER):
                p[i, j] += move[k - i] * p[k, j]
    for i in range(ORDER):
        for j in range(ORDER):
            for k in range(j + 1, ORDER):
                p[i, j] += move[k - j] * p[i, k]
    for i in range(ORDER):
        for j in range(i, ORDER):
            p[i, j] = 0.5 * (p[i, j] + p[j, i]) + s * added[i, j]
            p[j, i] = p[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def updated(x: Array, p: Array, c: int, z: float, r: float, gain: Array) -> tuple[float, float]:
    """State and covariance after a scalar measurement of part c, in place; its innovation, and one over the variance of
    that.

    Joseph's form, (1 − K H) P (1 − K H)ᵀ + K r Kᵀ, written out: the row of what was measured is r K, and loses no
    digits.
    """
    f, e = 1.0 / (max(p[c, c], 0.0) + r + LEAST), z - x[c]
    for i in range(ORDER):
        gain[i] = p[i, c] * f
    for i in range(ORDER):
        x[i] += gain[i] * e
        if i != c:
            was = p[i, i]
            for j in range(i, ORDER):
                if j != c:
                    p[i, j] -= gain[i] * p[c, j]
                    p[j, i] = p[i, j]
            p[i, i] = max(p[i, i], ROUNDING * was)
    for i in range(ORDER):
        p[i, c] = p[c, i] = r * gain[i]
    return e, f
