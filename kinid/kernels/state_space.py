"""A point one of whose derivatives is white noise: how its state moves, and what a measurement makes of it.

The state is x = (position, velocity, acceleration, jerk), in units of the position and of the median sample time, so
that numbers of any unit and rate are alike. Over a step τ it moves by F(τ) and gains a covariance s Q(τ), s the
intensity in the step (Särkkä, Bayesian Filtering and Smoothing, 2013, ch. 2 and 4; Bar-Shalom et al. 2001, 6.2.3).
Positions, velocities and accelerations are scalar measurements, each with its own variance, taken one after the other;
one whose variance is infinite is not there. A step of no time stands before a piece's first sample only.

States are four numbers, and covariances the ten of the upper triangle, row by row: as tuples they stay in registers,
and what follows each other takes a fifth of the time that it takes with small arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = tuple[float, ...]  # (d,)
Covariance = tuple[float, ...]  # (d (d + 1) / 2,)
F = TypeVar("F", bound=Callable[..., object])

#: the derivative that is white noise: the snap. White jerk is too rough for the accelerations of smooth motion
ORDER = 4
#: numbers of a state and its covariance
NUMBERS = 14
#: no variance is smaller
LEAST = 1e-250

#: a measurement leaves at least this share of a variance: less is not told from rounding
ROUNDING = 1e-15


def inlined(function: F) -> F:
    """A part of kernels, compiled into each of them."""
    return njit(error_model="numpy", forceinline=True)(function)  # type: ignore[no-any-return]


@inlined
def model(h: float) -> tuple[State, Covariance]:
    """F(h), of which the first row tells all, (d,), and Q(h)."""
    h2 = h * h
    h3, h4 = h2 * h, h2 * h2
    of_position = (h3 * h4 / 252.0, h3 * h3 / 72.0, h2 * h3 / 30.0, h4 / 24.0)
    return (1.0, h, h2 / 2.0, h3 / 6.0), (*of_position, h2 * h3 / 20.0, h4 / 8.0, h3 / 6.0, h3 / 3.0, h2 / 2.0, h)


@inlined
def given(x: Array, p: Array) -> tuple[State, Covariance]:
    """State and covariance of arrays (d,) and (d, d)."""
    first = (p[0, 0], p[0, 1], p[0, 2], p[0, 3], p[1, 1])
    return (x[0], x[1], x[2], x[3]), (*first, p[1, 2], p[1, 3], p[2, 2], p[2, 3], p[3, 3])


@inlined
def read(w: Array, i: int, s: int) -> tuple[State, Covariance]:
    """State and covariance, of the `NUMBERS` that begin with number i, one in s.

    No view of an array is made for them: to count who refers to it takes as long as a step of the filter.
    """
    x = (w[i], w[i + s], w[i + 2 * s], w[i + 3 * s])
    first = (w[i + 4 * s], w[i + 5 * s], w[i + 6 * s], w[i + 7 * s], w[i + 8 * s])
    return x, (*first, w[i + 9 * s], w[i + 10 * s], w[i + 11 * s], w[i + 12 * s], w[i + 13 * s])


@inlined
def write(x: State, p: Covariance, w: Array, i: int, s: int) -> None:
    """State and covariance into where `read` finds them."""
    w[i], w[i + s], w[i + 2 * s], w[i + 3 * s] = x
    w[i + 4 * s], w[i + 5 * s], w[i + 6 * s], w[i + 7 * s], w[i + 8 * s] = p[:5]
    w[i + 9 * s], w[i + 10 * s], w[i + 11 * s], w[i + 12 * s], w[i + 13 * s] = p[5:]


@inlined
def part(x: State, c: int) -> float:
    """Part c < 3 of a state."""
    return x[0] if c == 0 else x[1] if c == 1 else x[2]


@inlined
def raised(x: State, c: int, by: float) -> State:
    """A state whose part c < 3 is so much more."""
    return x[0] + (by if c == 0 else 0.0), x[1] + (by if c == 1 else 0.0), x[2] + (by if c == 2 else 0.0), x[3]


@inlined
def further(x: State, s: float, way: State) -> State:
    """A state s times a way further."""
    return x[0] + s * way[0], x[1] + s * way[1], x[2] + s * way[2], x[3] + s * way[3]


@inlined
def row(p: Covariance, c: int) -> State:
    """Row c of a symmetric matrix, (d,)."""
    if c == 0:
        return p[0], p[1], p[2], p[3]
    if c == 1:
        return p[1], p[4], p[5], p[6]
    if c == 2:
        return p[2], p[5], p[7], p[8]
    return p[3], p[6], p[8], p[9]


@inlined
def with_row(p: Covariance, c: int, new: State) -> Covariance:
    """A symmetric matrix with another row, and column, c < 3."""
    if c == 0:
        return new[0], new[1], new[2], new[3], p[4], p[5], p[6], p[7], p[8], p[9]
    if c == 1:
        return p[0], new[0], p[2], p[3], new[1], new[2], new[3], p[7], p[8], p[9]
    return p[0], p[1], new[0], p[3], p[4], new[1], p[6], new[2], new[3], p[9]


@inlined
def dot(x: State, y: State) -> float:
    """Product xᵀ y."""
    return (x[0] * y[0] + x[1] * y[1]) + (x[2] * y[2] + x[3] * y[3])


@inlined
def times(p: Covariance, x: State) -> State:
    """Product P x, P symmetric."""
    return dot(row(p, 0), x), dot(row(p, 1), x), dot(row(p, 2), x), dot(row(p, 3), x)


@inlined
def plus(p: Covariance, s: float, q: Covariance) -> Covariance:
    """Sum P + s Q."""
    first = (p[0] + s * q[0], p[1] + s * q[1], p[2] + s * q[2], p[3] + s * q[3], p[4] + s * q[4])
    return *first, p[5] + s * q[5], p[6] + s * q[6], p[7] + s * q[7], p[8] + s * q[8], p[9] + s * q[9]


@inlined
def outer(x: State, y: State) -> Covariance:
    """Product x yᵀ, symmetric."""
    first = (x[0] * y[0], x[0] * y[1], x[0] * y[2], x[0] * y[3], x[1] * y[1])
    return *first, x[1] * y[2], x[1] * y[3], x[2] * y[2], x[2] * y[3], x[3] * y[3]


@inlined
def moved(x: State, move: State) -> State:
    """F x: F is upper triangular, of one number along each diagonal."""
    _, a, b, c = move
    return (x[0] + a * x[1]) + (b * x[2] + c * x[3]), (x[1] + a * x[2]) + b * x[3], x[2] + a * x[3], x[3]


@inlined
def moved_back(x: State, move: State) -> State:
    """Fᵀ x, which is F of the parts in the other order."""
    return moved(x[::-1], move)[::-1]


@inlined
def around(p: Covariance, move: State) -> Covariance:
    """F P Fᵀ: F times columns, and then times rows of that."""
    a, b, c, d = moved(row(p, 0), move), moved(row(p, 1), move), moved(row(p, 2), move), moved(row(p, 3), move)
    first = moved((a[0], b[0], c[0], d[0]), move)
    second = moved((a[1], b[1], c[1], d[1]), move)
    third = moved((a[2], b[2], c[2], d[2]), move)
    return *first, second[1], second[2], second[3], third[2], third[3], d[3]


@inlined
def updated(x: State, p: Covariance, c: int, z: float, r: float) -> tuple[State, Covariance, float, float, State]:
    """State and covariance after a scalar measurement of part c; its innovation, one over the variance of that, and the
    gain.

    Joseph's form, (1 − K H) P (1 − K H)ᵀ + K r Kᵀ, written out: the row of what was measured is r K, and loses no
    digits.
    """
    h = row(p, c)
    f, e = 1.0 / (max(part(h, c), 0.0) + (r + LEAST)), z - part(x, c)
    gain = (h[0] * f, h[1] * f, h[2] * f, h[3] * f)
    a = plus(p, -1.0, outer(gain, h))
    a00, a11 = max(a[0], ROUNDING * p[0]), max(a[4], ROUNDING * p[4])
    a22, a33 = max(a[7], ROUNDING * p[7]), max(a[9], ROUNDING * p[9])
    own = (r * gain[0], r * gain[1], r * gain[2], r * gain[3])
    after = with_row((a00, a[1], a[2], a[3], a11, a[5], a[6], a22, a[8], a33), c, own)
    return further(x, e, gain), after, e, f, gain
