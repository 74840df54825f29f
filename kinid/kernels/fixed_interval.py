"""The fixed-interval smoother of a point one of whose derivatives is white noise, and draws of its error.

The state, its motion and its measurements are those of `state_space`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel
from kinid.kernels.state_space import (
    LEAST,
    NUMBERS,
    ORDER,
    Covariance,
    State,
    around,
    dot,
    further,
    given,
    inlined,
    model,
    moved,
    moved_back,
    outer,
    plus,
    read,
    row,
    times,
    updated,
    write,
)

Array = NDArray[np.float64]
Rows = tuple[State, ...]  # of a matrix (d, d)

#: samples whose covariances are kept at a time; the others are filtered again from where they begin
CHUNK = 2048


@kernel
def _filter(
    tau: Array,
    z: Array,
    noise: Array,
    drive: Array,
    first: int,
    x: State,
    p: Covariance,
    kept: Array,
) -> tuple[State, Covariance]:
    """State and covariance after a chunk of samples that begins with `first`, from those before it; those after each
    sample are kept, one behind the other.
    """
    last = 0.0
    move, added = model(last)
    for k in range(first, min(first + CHUNK, tau.shape[0])):
        if tau[k] != last:
            last = tau[k]
            move, added = model(last)
        if last > 0.0:
            x, p = moved(x, move), plus(around(p, move), drive[k], added)
        for c in range(z.shape[1]):
            if noise[k, c] < np.inf:
                x, p, _, _, _ = updated(x, p, c, z[k, c], noise[k, c])
        write(x, p, kept, (k - first) * NUMBERS, 1)
    return x, p


@kernel
def smooth(
    tau: Array,
    z: Array,
    noise: Array,
    drive: Array,
    start: Array,
    spread: Array,
    states: Array,
    sd: Array,
    random: np.random.Generator,
    drawn: NDArray[np.float32],
) -> None:
    """Fixed-interval smoother (Rauch, Tung & Striebel 1965), and draws of its error through the same gains.

    Backwards the covariance is (1 − G F) P (1 − G F)ᵀ + G s Q Gᵀ + G P₊ Gᵀ, sums alone; an error is e = G e₊ + c, c
    with the covariance of the first two (Carter & Kohn 1994; as the simulation smoother of Durbin & Koopman 2002).

    Args:
        tau, z, noise, drive, start, spread: as for `score`.
        states, sd: get the state and the standard deviations of its parts, (n, d).
        random: where normal numbers come from. drawn: gets errors of position, velocity, acceleration, (m, n, 3).
    """
    n, chunks = tau.shape[0], -(-tau.shape[0] // CHUNK)
    begins, filtered = np.empty(chunks * NUMBERS), np.empty(min(n, CHUNK) * NUMBERS)
    x, after = given(start, spread)
    for chunk in range(chunks):
        write(x, after, begins, chunk * NUMBERS, 1)
        x, after = _filter(tau, z, noise, drive, chunk * CHUNK, x, after, filtered)
    errors, nothing = np.zeros((drawn.shape[0], ORDER)), (0.0, 0.0, 0.0, 0.0)
    _draw(after, (nothing, nothing, nothing, nothing), random, errors, drawn[:, n - 1])
    first, last = (chunks - 1) * CHUNK, 0.0
    move, added = model(last)
    for k in range(n - 1, -1, -1):
        if k < first:
            first -= CHUNK
            before, now = read(begins, first // CHUNK * NUMBERS, 1)
            _filter(tau, z, noise, drive, first, before, now, filtered)
        if k < n - 1:
            if tau[k + 1] != last:
                last = tau[k + 1]
                move, added = model(last)
            (before, now), s = read(filtered, (k - first) * NUMBERS, 1), drive[k + 1]
            back = _back(now, move, plus(around(now, move), s, added))
            off = further(x, -1.0, moved(before, move))
            x = further(before, 1.0, (dot(back[0], off), dot(back[1], off), dot(back[2], off), dot(back[3], off)))
            own = _around(_left(back, move), now)
            if len(errors) > 0:  # what an error is made of, before what comes after it
                own = plus(own, s, _around(back, added))
                _draw(own, back, random, errors, drawn[:, k])
                after = plus(own, 1.0, _around(back, after))
            else:
                after = plus(own, 1.0, _around(back, plus(after, s, added)))
        states[k, 0], states[k, 1], states[k, 2], states[k, 3] = x
        sd[k, 0], sd[k, 1] = np.sqrt(max(after[0], 0.0)), np.sqrt(max(after[4], 0.0))
        sd[k, 2], sd[k, 3] = np.sqrt(max(after[7], 0.0)), np.sqrt(max(after[9], 0.0))


@inlined
def _left(back: Rows, move: State) -> Rows:
    """1 − G F."""
    a, b, c, d = back
    return (
        further((1.0, 0.0, 0.0, 0.0), -1.0, moved_back(a, move)),
        further((0.0, 1.0, 0.0, 0.0), -1.0, moved_back(b, move)),
        further((0.0, 0.0, 1.0, 0.0), -1.0, moved_back(c, move)),
        further((0.0, 0.0, 0.0, 1.0), -1.0, moved_back(d, move)),
    )


@inlined
def _draw(p: Covariance, back: Rows, random: np.random.Generator, errors: Array, out: NDArray[np.float32]) -> None:
    """Errors e = G e₊ + c, c with a covariance; their first three parts are drawn.

    Args:
        random: of normal numbers. errors: e₊, and then e, (m, d). out: (m, 3).
    """
    a, b, c, d = _root(p)
    for i in range(errors.shape[0]):
        e = (errors[i, 0], errors[i, 1], errors[i, 2], errors[i, 3])
        n0, n1 = random.standard_normal(), random.standard_normal()
        n2, n3 = random.standard_normal(), random.standard_normal()
        errors[i, 0] = dot(back[0], e) + a[0] * n0
        errors[i, 1] = dot(back[1], e) + a[1] * n0 + b[1] * n1
        errors[i, 2] = dot(back[2], e) + a[2] * n0 + b[2] * n1 + c[2] * n2
        errors[i, 3] = dot(back[3], e) + a[3] * n0 + b[3] * n1 + c[3] * n2 + d[3] * n3
        out[i, 0], out[i, 1], out[i, 2] = errors[i, 0], errors[i, 1], errors[i, 2]


@inlined
def _around(a: Rows, p: Covariance) -> Covariance:
    """A P Aᵀ."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = times(p, a0), times(p, a1), times(p, a2), times(p, a3)
    first = (dot(a0, b0), dot(a0, b1), dot(a0, b2), dot(a0, b3), dot(a1, b1), dot(a1, b2), dot(a1, b3))
    return *first, dot(a2, b2), dot(a2, b3), dot(a3, b3)


@inlined
def _back(now: Covariance, move: State, ahead: Covariance) -> Rows:
    """G = P Fᵀ (F P Fᵀ + s Q)⁻¹ by an L D Lᵀ decomposition of what is ahead, F P Fᵀ + s Q."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = ahead
    f0 = _one_over(p00, p00)
    l10, l20, l30 = p01 * f0, p02 * f0, p03 * f0
    q12, q13 = p12 - l20 * p01, p13 - l30 * p01
    f1 = _one_over(p11 - l10 * p01, p11)
    l21, l31 = q12 * f1, q13 * f1
    q23 = p23 - l30 * p02 - l31 * q12
    f2 = _one_over(p22 - l20 * p02 - l21 * q12, p22)
    l32 = q23 * f2
    f3 = _one_over(p33 - l30 * p03 - l31 * q13 - l32 * q23, p33)
    lower, f = (l10, l20, l30, l21, l31, l32), (f0, f1, f2, f3)
    return (
        _solved(lower, f, moved(row(now, 0), move)),
        _solved(lower, f, moved(row(now, 1), move)),
        _solved(lower, f, moved(row(now, 2), move)),
        _solved(lower, f, moved(row(now, 3), move)),
    )


@inlined
def _one_over(left: float, variance: float) -> float:
    """One over what is left of a variance, as far as that is above rounding."""
    return 1.0 / max(left, 1e-15 * abs(variance) + LEAST)


@inlined
def _solved(lower: State, f: State, x: State) -> State:
    """The y of L D Lᵀ y = x: f is one over D; L has ones on its diagonal, and `lower` below, column by column, (6,)."""
    l10, l20, l30, l21, l31, l32 = lower
    x1 = x[1] - l10 * x[0]
    x2 = x[2] - l20 * x[0] - l21 * x1
    y3 = (x[3] - l30 * x[0] - l31 * x1 - l32 * x2) * f[3]
    y2 = x2 * f[2] - l32 * y3
    y1 = x1 * f[1] - l21 * y2 - l31 * y3
    return x[0] * f[0] - l10 * y1 - l20 * y2 - l30 * y3, y1, y2, y3


@inlined
def _root(p: Covariance) -> Rows:
    """Columns of a lower triangular root of a covariance, which may be singular."""
    a = _column(row(p, 0), p[0], p[0])
    left = plus(p, -1.0, outer(a, a))
    b = _column(row(left, 1), left[4], p[4])
    left = plus(left, -1.0, outer(b, b))
    c = _column(row(left, 2), left[7], p[7])
    left = plus(left, -1.0, outer(c, c))
    return a, b, c, _column(row(left, 3), left[9], p[9])


@inlined
def _column(left: State, own: float, variance: float) -> State:
    """A row that is left of a covariance over the root of its own part of it, 0 where that is lost in rounding."""
    one_over = 1.0 / np.sqrt(own) if own > max(1e-13 * variance, LEAST) else 0.0
    return further((0.0, 0.0, 0.0, 0.0), one_over, left)
