"""Kernels of the recursive estimators: covariances as U·diag(d)·Uᵀ, one sample at a time, nothing allocated.

U is upper triangular with a unit diagonal and d ≥ 0, so the covariance stays symmetric and positive semi-definite
whatever rounding does (Bierman 1977, *Factorization Methods for Discrete Sequential Estimation*, ch. V). The number of
parameters `p` is a constant wherever it is the length of a tuple; LLVM then unrolls every loop, and a sample with four
parameters costs about 100 cycles. A single sample online is a batch of one: there is no second implementation. What
ends in `_once` is that batch of one, with all it needs in one array (see `_store`).

`state` of p parameters, one float64 array: theta (p) | d (p) | U (p·p) | diagonal of P (p) | tally (4) = weighted sum
of squared residuals, sum of weights, sum of squared weights, number of updates.
`window` of excitation: gram (blocks, p, p), scale (p), cursor (5) = block, samples in it, full blocks, value, fixed
scale.
"""

from __future__ import annotations

import math

import numpy as np

from kinid.estimators import _store
from kinid.estimators._jit import inlined, jit
from kinid.kernels.types import Compiled

#: the numbers of `kinid.estimators.estimate.Status`
VALID, STARTING, NOT_EXCITED, NO_CONTACT, BELOW_NOISE, TOO_FAST, NOT_FINITE, NOT_SLIDING, MISFIT, DIVERGED = range(10)

#: an estimate is called one after p + EARLY samples: before, its noise is guessed from too few residuals
EARLY = 8

#: keeps what fades from becoming denormal, which is fifty times slower
TINY = 1e-150

#: beyond this a number is a fault of the log, as inf is: its powers would soon overflow
HUGE = 1e50

carve = inlined(_store.carve)


# --- covariance in factored form -------------------------------------------------------------------------------------


@inlined
def rank_one(p: int, u: Compiled, d: Compiled, phi: Compiled, eps: float, gain: Compiled) -> float:
    """P ← P − ε Pφφᵀ P / (1 + ε φᵀPφ); `gain` becomes Pφ of the old P; returns 1 + ε φᵀPφ, which must be > 0.

    Bierman's measurement update, scaled by ε so that ε ≤ 0 (information taken away) works too.
    """
    alpha, inverse = 1.0, 1.0
    for j in range(p):
        f = phi[j]
        for i in range(j):
            f += u[i, j] * phi[i]
        v = d[j] * f
        slope = -eps * f * inverse
        before = alpha
        alpha += eps * f * v
        inverse = 1.0 / alpha
        d[j] *= before * inverse
        for i in range(j):
            old = u[i, j]
            u[i, j] = old + gain[i] * slope
            gain[i] += old * v
        gain[j] = v
    return alpha


@inlined
def add_noise(p: int, u: Compiled, d: Compiled, i: int, q: float, work: Compiled) -> None:
    """P ← P + q e_i e_iᵀ with q ≥ 0 (Agee & Turner 1972)."""
    for j in range(p):
        work[j] = 0.0
    work[i] = 1.0
    c = q
    for j in range(i, -1, -1):
        s = work[j]
        fresh = d[j] + c * s * s
        if fresh > 0.0:
            beta = c * s / fresh
            c *= d[j] / fresh
            d[j] = fresh
            for k in range(j):
                work[k] -= s * u[k, j]
                u[k, j] += beta * work[k]


@inlined
def covariance(p: int, u: Compiled, d: Compiled, i: int, j: int) -> float:
    """Element (i, j) of U·diag(d)·Uᵀ."""
    total = 0.0
    for k in range(max(i, j), p):
        total += u[i, k] * d[k] * u[j, k]
    return total


@inlined
def quadratic(p: int, u: Compiled, d: Compiled, phi: Compiled) -> float:
    """φᵀPφ."""
    total = 0.0
    for j in range(p):
        f = phi[j]
        for i in range(j):
            f += u[i, j] * phi[i]
        total += d[j] * f * f
    return total


@inlined
def hold(p: int, u: Compiled, d: Compiled, limit: Compiled, work: Compiled, gain: Compiled) -> None:
    """A virtual measurement along each axis whose variance passed its limit, so that it equals the limit.

    It reads what is believed already, so the parameters stay; other directions go on forgetting.
    """
    for i in range(p):
        variance = covariance(p, u, d, i, i)
        if variance > limit[i]:
            for j in range(p):
                work[j] = 0.0
            work[i] = 1.0
            rank_one(p, u, d, work, 1.0 / limit[i] - 1.0 / variance, gain)
    for j in range(p):
        for i in range(j):
            if abs(u[i, j]) < TINY:  # correlations that fade
                u[i, j] = 0.0


# --- least squares ---------------------------------------------------------------------------------------------------


@inlined
def parts(p: int, state: Compiled) -> Compiled:
    """Views of theta, d, U, diagonal of P and tally."""
    m = 2 * p + p * p
    return state[:p], state[p : 2 * p], state[2 * p : m].reshape(p, p), state[m : m + p], state[m + p :]


@inlined
def learn(
    p: int,
    theta: Compiled,
    d: Compiled,
    u: Compiled,
    own: Compiled,
    tally: Compiled,
    phi: Compiled,
    y: float,
    factor: float,
    limit: Compiled,
    directional: bool,
    work: Compiled,
    gain: Compiled,
) -> float:
    """One sample of recursive least squares; returns the innovation y − φᵀθ.

    Exponential: P⁻¹ ← β P⁻¹ + φφᵀ. Directional (Kulhavý 1987, Automatica 23(5):589-600): P⁻¹ ← P⁻¹ + ε φφᵀ with
    ε = β − (1 − β)/(φᵀPφ): only what φ informs is forgotten.
    """
    innovation = y
    for j in range(p):
        innovation -= phi[j] * theta[j]
    if directional:
        s = quadratic(p, u, d, phi)
        alpha = 1.0 + s
        for j in range(p):
            gain[j] = 0.0
        if s > TINY:
            rank_one(p, u, d, phi, factor - (1.0 - factor) / s, gain)
    else:
        inverse = 1.0 / factor
        beyond = False
        for j in range(p):
            d[j] *= inverse
            beyond |= own[j] * inverse > limit[j]
        if beyond:
            hold(p, u, d, limit, work, gain)
        alpha = rank_one(p, u, d, phi, 1.0, gain)
    step = innovation / alpha
    for j in range(p):
        theta[j] += gain[j] * step
    if directional:
        hold(p, u, d, limit, work, gain)
    for j in range(p):
        own[j] = covariance(p, u, d, j, j)
    if tally[3] >= p:  # the first p innovations speak of the prior, not of the noise
        tally[0] = factor * tally[0] + innovation * step + TINY * TINY
        tally[1] = factor * tally[1] + 1.0
        # directional weights are no powers of β: there P alone, an upper bound, stands for the covariance
        tally[2] = (factor if directional else factor * factor) * tally[2] + 1.0
    tally[3] += 1.0
    return innovation


@inlined
def noise_variance(tally: Compiled) -> float:
    """Weighted mean of squared residuals; inf before there is one."""
    return float(tally[0] / tally[1]) if tally[1] > 0.0 else math.inf


@inlined
def spread(tally: Compiled) -> float:
    """What turns P into a covariance: noise variance times Σw²/Σw, exact for white noise and steady excitation."""
    return tally[0] * tally[2] / (tally[1] * tally[1]) if tally[1] > 0.0 else np.inf


@inlined
def scaled(variance: float, factor: float) -> float:
    """Their product, where 0·inf is 0: what is known for sure stays so."""
    return variance * factor if variance > 0.0 else 0.0


# --- excitation ------------------------------------------------------------------------------------------------------


@inlined
def rotate(p: int, a: Compiled, i: int, j: int) -> None:
    """The Jacobi rotation that zeroes a[i, j] of a symmetric matrix."""
    theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(p):
        aki, akj = a[k, i], a[k, j]
        a[k, i], a[k, j] = c * aki - s * akj, s * aki + c * akj
    for k in range(p):
        aik, ajk = a[i, k], a[j, k]
        a[i, k], a[j, k] = c * aik - s * ajk, s * aik + c * ajk


@jit
def smallest_eigenvalue(shape: Compiled, a: Compiled) -> float:
    """Smallest eigenvalue of a symmetric matrix (p, p), which is overwritten: cyclic Jacobi rotations."""
    p = len(shape)
    for _ in range(30):
        settled = True
        for i in range(p):
            for j in range(i + 1, p):
                if a[i, j] * a[i, j] > 1e-20 * abs(a[i, i] * a[j, j]) + 1e-40:  # converges quadratically: 1e-20 left
                    settled = False
                    rotate(p, a, i, j)
        if settled:
            break
    least = math.inf
    for i in range(p):
        least = min(least, float(a[i, i]))
    return least


@jit
def window_value(
    shape: Compiled,
    gram: Compiled,
    scale: Compiled,
    fixed: bool,
    full: bool,
    samples: float,
    size: Compiled,
    a: Compiled,
) -> float:
    """Smallest singular value of the window's rows, each column over its scale, divided by √samples."""
    blocks, p = gram.shape[0], len(shape)
    for i in range(p):
        for j in range(i, p):
            total = 0.0
            for b in range(blocks):
                total += gram[b, i, j]
            a[i, j] = a[j, i] = total / samples
    for i in range(p):
        size[i] = scale[i] if fixed else max(scale[i], math.sqrt(a[i, i]))
        if full:
            scale[i] = size[i]
    for i in range(p):
        for j in range(p):
            both = size[i] * size[j]
            a[i, j] = a[i, j] / both if both > 0.0 else 0.0
    return math.sqrt(max(smallest_eigenvalue(shape, a), 0.0))


@inlined
def excite(
    p: int,
    shape: Compiled,
    gram: Compiled,
    scale: Compiled,
    cursor: Compiled,
    length: int,
    phi: Compiled,
    size: Compiled,
    a: Compiled,
) -> None:
    """One row more in the window. The value is renewed when a block is full, and at 2, 4, 8 … samples of the first."""
    block = int(cursor[0])
    for i in range(p):
        for j in range(i, p):
            gram[block, i, j] += phi[i] * phi[j]
    cursor[1] += 1.0
    count = int(cursor[1])
    if count == length:
        blocks = gram.shape[0]
        cursor[2] = min(cursor[2] + 1.0, float(blocks))
        full = cursor[2] == blocks
        cursor[3] = window_value(shape, gram, scale, cursor[4] > 0.0, full, cursor[2] * length, size, a)
        block = (block + 1) % blocks
        cursor[0], cursor[1] = float(block), 0.0
        for i in range(p):
            for j in range(i, p):
                gram[block, i, j] = 0.0
    elif cursor[2] == 0.0 and count >= p and count & (count - 1) == 0:
        cursor[3] = window_value(shape, gram, scale, cursor[4] > 0.0, False, float(count), size, a)


@jit
def excitation(
    shape: Compiled, rows: Compiled, window: Compiled, length: int, scratch: Compiled, values: Compiled
) -> None:
    """The window's value after each row."""
    gram, scale, cursor = window
    for k in range(rows.shape[0]):
        excite(len(shape), shape, gram, scale, cursor, length, rows[k], scratch[0], scratch[1:])
        values[k] = cursor[3]


# --- what every kernel says of a sample
# --------------------------------------------------------------------------------


@inlined
def judge(updates: float, least: int, excitation: float, threshold: float, slow: bool, loud: bool) -> int:
    """Status of an estimate whose sample was used."""
    if updates <= least:
        return STARTING
    if excitation < threshold:
        return NOT_EXCITED
    if not slow:
        return TOO_FAST
    return VALID if loud else BELOW_NOISE


@inlined
def conclude(
    shape: Compiled,
    k: int,
    code: int,
    tally: Compiled,
    slow: bool,
    loud: bool,
    phi: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """Excitation with the row φ of sample k, which is 0 where it was not used, and the status that follows."""
    p = len(shape)
    gram, scale, cursor = window
    _, _, _, _, excitations, statuses, _ = out
    if length > 0:
        excite(p, shape, gram, scale, cursor, length, phi, scratch[1], scratch[3:])
    statuses[k] = judge(tally[3], p + EARLY, cursor[3], threshold, slow, loud) if code == VALID else code
    excitations[k] = cursor[3]


@inlined
def close(record: Compiled, updates: float) -> None:
    """Count the one sample that a store took in."""
    record[_store.UPDATES] = updates
    if record[_store.STATUS] == NOT_FINITE:
        record[_store.SKIPPED] += 1.0


# --- linear regression -----------------------------------------------------------------------------------------------


@jit
def least_squares(
    shape: Compiled,
    state: Compiled,
    rows: Compiled,
    outputs: Compiled,
    factors: Compiled,
    codes: Compiled,
    limit: Compiled,
    directional: bool,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """All samples; `shape` is any tuple of p floats; `factors` and `codes` hold n values or one for all."""
    p = len(shape)
    theta, d, u, own, tally = parts(p, state)
    phi, work, gain = scratch[0], scratch[1], scratch[2]
    thetas, variances, innovations, noises, _, _, _ = out
    varying, coded = len(factors) > 1, len(codes) > 1
    for k in range(rows.shape[0]):
        y, code = outputs[k], codes[k if coded else 0]
        fine = abs(y) < HUGE
        for j in range(p):
            phi[j] = rows[k, j]
            fine &= abs(phi[j]) < HUGE
        if not fine:
            code = NOT_FINITE
        innovations[k] = 0.0
        if code == VALID:
            factor = factors[k if varying else 0]
            innovations[k] = learn(p, theta, d, u, own, tally, phi, y, factor, limit, directional, work, gain)
        else:
            for j in range(p):
                phi[j] = 0.0
        conclude(shape, k, code, tally, True, True, phi, window, length, threshold, scratch, out)
        noise, factor = np.inf, np.inf
        if tally[1] > 0.0:
            inverse = 1.0 / tally[1]
            noise = tally[0] * inverse
            factor = noise * tally[2] * inverse
        noises[k] = noise
        for j in range(p):
            thetas[k, j] = theta[j]
            variances[k, j] = scaled(own[j], factor)


@jit
def kelvin_voigt_rows(
    depth: Compiled,
    rate: Compiled,
    force: Compiled,
    contact: Compiled,
    rows: Compiled,
    outputs: Compiled,
    codes: Compiled,
) -> None:
    """Regressors [x, ẋ] of f = K x + B ẋ."""
    for k in range(len(depth)):
        rows[k, 0], rows[k, 1], outputs[k] = depth[k], rate[k], force[k]
        codes[k] = NO_CONTACT if depth[k] <= 0.0 or not contact[k] else VALID


@inlined
def row_once(shape: Compiled, room: Compiled) -> None:
    """Least squares of the row, output and code that are the last inputs; settings begin with `directional`."""
    p = len(shape)
    own = room.inputs[len(room.inputs) - p - 2 :]
    least_squares(
        shape,
        room.state,
        own[:p].reshape(1, p),
        own[p : p + 1],
        room.factor,
        own[p + 1 :],
        room.limit,
        room.settings[0] > 0.0,
        room.window,
        room.length,
        room.threshold,
        room.scratch,
        room.out,
    )
    close(room.record, room.state[-1])


@jit
def least_squares_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One row and its output."""
    row_once(shape, carve(shape, store))


@jit
def kelvin_voigt_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One contact: depth, rate, force, flag; then room for a row."""
    room = carve(shape, store)
    x, own = room.inputs, room.inputs[4:]
    kelvin_voigt_rows(x[:1], x[1:2], x[2:3], x[3:4], own[:2].reshape(1, 2), own[2:3], own[3:])
    row_once(shape, room)
