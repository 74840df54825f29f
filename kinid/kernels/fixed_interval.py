"""The fixed-interval smoother of a point one of whose derivatives is white noise, and draws of its error.

The state, its motion and its measurements are those of `state_space`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.kernels.state_space import LEAST, ORDER, model, moved, updated

Array = NDArray[np.float64]

#: samples whose covariances are kept at a time; the others are filtered again from where they begin
CHUNK = 2048


@njit(cache=True, nogil=True, error_model="numpy")
def _filter(
    tau: Array,
    z: Array,
    noise: Array,
    drive: Array,
    first: int,
    end: int,
    x: Array,
    p: Array,
    gain: Array,
    move: Array,
    added: Array,
    state: Array,
    filtered: Array,
) -> None:
    """Filter samples `first` to `end`, x and p in place; their states and covariances are kept, the latter from 0
    on.
    """
    last = -1.0
    for k in range(first, end):
        if tau[k] != last:
            last = tau[k]
            model(last, move, added)
        if last > 0.0:
            moved(x, p, move, added, drive[k])
        for c in range(z.shape[1]):
            if noise[k, c] < np.inf:
                updated(x, p, c, z[k, c], noise[k, c], gain)
        state[k] = x
        filtered[k - first] = p


@njit(cache=True, nogil=True, error_model="numpy")
def smooth(
    tau: Array,
    z: Array,
    noise: Array,
    drive: Array,
    start: Array,
    spread: Array,
    state: Array,
    sd: Array,
    random: np.random.Generator,
    drawn: NDArray[np.float32],
) -> None:
    """Fixed-interval smoother (Rauch, Tung & Striebel 1965), and draws of its error through the same gains.

    Backwards the covariance is (1 − G F) P (1 − G F)ᵀ + G s Q Gᵀ + G P₊ Gᵀ, sums alone; an error is e = G e₊ + c, c
    with the covariance of the first two (Carter & Kohn 1994; as the simulation smoother of Durbin & Koopman 2002).

    Args:
        tau, z, noise, drive, start, spread: as for `score`.
        state, sd: get the state and the standard deviations of its parts, (n, d).
        random: where normal numbers come from. drawn: gets errors of position, velocity, acceleration, (m, n, 3).
    """
    n, many_chunks = tau.shape[0], -(-tau.shape[0] // CHUNK)
    x, p, gain, move = start.copy(), spread.copy(), np.empty(ORDER), np.empty(ORDER)
    begin, begins = np.empty((many_chunks, ORDER)), np.empty((many_chunks, ORDER, ORDER))
    added, filtered = np.empty((ORDER, ORDER)), np.empty((min(n, CHUNK), ORDER, ORDER))
    for chunk in range(many_chunks):
        begin[chunk], begins[chunk] = x, p
        a, b = chunk * CHUNK, min(n, (chunk + 1) * CHUNK)
        _filter(tau, z, noise, drive, a, b, x, p, gain, move, added, state, filtered)
    after, own, back, left, lower = p.copy(), np.empty_like(p), np.zeros_like(p), np.empty_like(p), np.empty_like(p)
    errors, new = np.zeros((drawn.shape[0], ORDER)), np.empty(ORDER)
    _deviations(after, sd[n - 1])
    _draw(after, back, random, errors, lower, new, drawn[:, n - 1])
    first, last, ahead, row, predicted = (
        (many_chunks - 1) * CHUNK,
        -1.0,
        np.empty(ORDER),
        np.empty(ORDER),
        np.empty_like(p),
    )
    for k in range(n - 2, -1, -1):
        if k < first:
            first -= CHUNK
            x[:], p[:] = begin[first // CHUNK], begins[first // CHUNK]
            _filter(tau, z, noise, drive, first, first + CHUNK, x, p, gain, move, added, state, filtered)
            last = -1.0
        if tau[k + 1] != last:
            last = tau[k + 1]
            model(last, move, added)
        s, now = drive[k + 1], filtered[k - first]
        ahead[:], predicted[:] = state[k], now
        moved(ahead, predicted, move, added, s)
        _back(now, move, predicted, lower, row, back)
        _towards(back, state[k + 1], ahead, state[k])
        _left(back, move, left)
        own[:] = 0.0
        _around(left, now, 1.0, row, own)
        if len(errors) > 0:  # what an error is made of, before what comes after it
            _around(back, added, s, row, own)
            _draw(own, back, random, errors, lower, new, drawn[:, k])
        else:
            after += s * added
        _around(back, after, 1.0, row, own)
        after[:] = own
        _deviations(own, sd[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _deviations(covariance: Array, out: Array) -> None:
    """Standard deviations of the parts of a state, (d,)."""
    for i in range(ORDER):
        out[i] = np.sqrt(max(covariance[i, i], 0.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _towards(back: Array, after: Array, predicted: Array, state: Array) -> None:
    """Add G (x₊ − F x) to a state."""
    for i in range(ORDER):
        step = 0.0
        for j in range(ORDER):
            step += back[i, j] * (after[j] - predicted[j])
        state[i] += step


@njit(cache=True, nogil=True, error_model="numpy")
def _left(back: Array, move: Array, out: Array) -> None:
    """1 − G F."""
    for i in range(ORDER):
        for j in range(ORDER):
            out[i, j] = 1.0 if i == j else 0.0
            for b in range(j + 1):
                out[i, j] -= back[i, b] * move[j - b]


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(
    covariance: Array,
    back: Array,
    random: np.random.Generator,
    errors: Array,
    lower: Array,
    new: Array,
    out: NDArray[np.float32],
) -> None:
    """Errors e = G e₊ + c, c with a covariance; their first three parts are drawn.

    Args:
        random: of normal numbers. errors: e₊, and then e, (m, d). lower, new: scratch. out: (m, 3).
    """
    _root(covariance, lower)
    for b in range(errors.shape[0]):
        new[:] = 0.0
        for j in range(ORDER):
            normal = random.standard_normal()
            for i in range(j, ORDER):
                new[i] += lower[i, j] * normal
            for i in range(ORDER):
                new[i] += back[i, j] * errors[b, j]
        errors[b] = new
        for i in range(3):
            out[b, i] = new[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _around(a: Array, middle: Array, s: float, row: Array, out: Array) -> None:
    """Add s A M Aᵀ, M symmetric; `row` is scratch, (d,)."""
    for i in range(ORDER):
        for j in range(ORDER):
            row[j] = 0.0
            for k in range(ORDER):
                row[j] += a[i, k] * middle[k, j]
        for j in range(i, ORDER):
            v = 0.0
            for k in range(ORDER):
                v += row[k] * a[j, k]
            out[i, j] += s * v
            out[j, i] = out[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _back(now: Array, move: Array, predicted: Array, lower: Array, d: Array, out: Array) -> None:
    """G = P Fᵀ (F P Fᵀ + s Q)⁻¹ by an L D Lᵀ decomposition; `lower` and `d` are scratch."""
    for j in range(ORDER):
        d[j] = predicted[j, j]
        for k in range(j):
            d[j] -= lower[j, k] * lower[j, k] * d[k]
        d[j] = max(d[j], 1e-15 * abs(predicted[j, j]) + LEAST)
        for i in range(j + 1, ORDER):
            v = predicted[i, j]
            for k in range(j):
                v -= lower[i, k] * lower[j, k] * d[k]
            lower[i, j] = v / d[j]
    for i in range(ORDER):
        for j in range(ORDER):
            v = 0.0
            for k in range(j, ORDER):
                v += now[i, k] * move[k - j]
            for k in range(j):
                v -= lower[j, k] * out[i, k]
            out[i, j] = v
        for j in range(ORDER):
            out[i, j] /= d[j]
        for j in range(ORDER - 2, -1, -1):
            for k in range(j + 1, ORDER):
                out[i, j] -= lower[k, j] * out[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _root(a: Array, out: Array) -> None:
    """A lower triangular root of a covariance, which may be singular."""
    out[:] = 0.0
    for j in range(ORDER):
        d = a[j, j]
        for k in range(j):
            d -= out[j, k] * out[j, k]
        if d > max(1e-13 * a[j, j], LEAST):
            out[j, j] = np.sqrt(d)
            for i in range(j + 1, ORDER):
                v = a[i, j]
                for k in range(j):
                    v -= out[i, k] * out[j, k]
                out[i, j] = v / out[j, j]
