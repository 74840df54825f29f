"""Kernels of the recursive estimators: covariances as U·diag(d)·Uᵀ, one sample at a time, nothing allocated.

U is upper triangular with a unit diagonal and d ≥ 0, so the covariance stays symmetric and positive semi-definite
whatever rounding does (Bierman 1977, *Factorization Methods for Discrete Sequential Estimation*, ch. V). The number of
parameters `p` is a constant wherever it is the length of a tuple; LLVM then unrolls every loop, and a sample with four
parameters costs about 100 cycles. A single sample online is a batch of one: there is no second implementation. What
ends in `_once` is that batch of one, with all it needs in one array (see `_store`).

`state` of p parameters, one float64 array: theta (p) | d (p) | U (p·p) | diagonal of P (p) | offset, empty where none
is considered (see `consider`) | tally (4) = weighted sum of squared residuals, sum of weights, sum of squared weights,
number of updates. `window` of excitation: see `_excitation_kernels`.
"""

from __future__ import annotations

import math

import numpy as np

from kinid.estimators import _store
from kinid.estimators._excitation_kernels import excite
from kinid.estimators._factored_kernels import TINY, covariance, hold, quadratic, rank_one
from kinid.estimators._jit import inlined, jit
from kinid.estimators._store import CLOCK, GAIN, PERIOD, SHARED, TALLY, VARIANCE
from kinid.estimators.estimate import NORMAL_95
from kinid.kernels.types import Compiled

#: the numbers of `kinid.estimators.estimate.Status`
VALID, STARTING, NOT_EXCITED, NO_CONTACT, BELOW_NOISE, TOO_FAST, NOT_FINITE, NOT_SLIDING, MISFIT, DIVERGED = range(10)

#: an estimate is called one after p + EARLY samples: before, its noise is guessed from too few residuals
EARLY = 8

#: beyond this a number is a fault of the log, as inf is: its powers would soon overflow
HUGE = 1e50

carve = inlined(_store.carve)
offset_place = inlined(_store.offset_place)


# --- least squares ---------------------------------------------------------------------------------------------------


@inlined
def parts(p: int, state: Compiled) -> Compiled:
    """Views of theta, d, U, diagonal of P and tally."""
    m = 2 * p + p * p
    return state[:p], state[p : 2 * p], state[2 * p : m].reshape(p, p), state[m : m + p], state[len(state) - TALLY :]


@inlined
def wait(offset: Compiled, now: float) -> None:
    """Time goes on until `now` [s], or by a period where that is NaN: the offset wanders."""
    if len(offset) > 0:
        step = offset[PERIOD]
        if not math.isnan(now):
            step = max(now - offset[CLOCK], 0.0) if not math.isnan(offset[CLOCK]) else 0.0
            offset[CLOCK] = now
        offset[VARIANCE] += offset[GAIN] * step


@inlined
def consider(
    p: int, phi: Compiled, gain: Compiled, inverse: float, slope: float, offset: Compiled, w: Compiled
) -> None:
    """What an offset b of the output does to the error e of the estimates, which a gain K has just changed.

    e ← (I − Kφᵀ) e + K (h b + v), with h = `slope` and K = `gain`·`inverse`: the estimates stay those of least squares,
    and their covariance grows by Z = cov(e) of b alone, through C = cov(e, b) (a consider covariance: S. F. Schmidt,
    Advances in Control Systems 3, 1966). `w` is scratch.
    """
    shared = offset[SHARED : SHARED + p]
    own = offset[SHARED + p :].reshape(p, p)
    cross, twice = 0.0, 0.0
    for i in range(p):
        cross += phi[i] * shared[i]
        w[i] = slope * shared[i]
        for j in range(p):
            w[i] -= own[i, j] * phi[j]
            twice += phi[i] * own[i, j] * phi[j]
    both = slope * offset[VARIANCE] - cross
    power = slope * (both - cross) + twice
    for i in range(p):
        k = gain[i] * inverse
        shared[i] += k * both
        for j in range(i + 1):
            q = gain[j] * inverse
            own[i, j] += w[i] * q + k * w[j] + power * k * q
            own[j, i] = own[i, j]
    for i in range(p):  # where rows differ a trillion times in size, rounding makes of it what no covariance is
        if not 0.0 <= own[i, i] < HUGE:
            size = 0.0 if -HUGE < own[i, i] < HUGE else HUGE
            shared[i] = 0.0
            for j in range(p):
                own[i, j] = own[j, i] = 0.0
            own[i, i] = size


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
    offset: Compiled,
    slope: float,
) -> float:
    """One sample of recursive least squares; returns the innovation y − φᵀθ.

    The output is off by `slope` times the offset, if one is considered.

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
    if len(offset) > 0:
        consider(p, phi, gain, 1.0 / alpha, slope, offset, work)
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
def shared_variance(p: int, offset: Compiled, row: Compiled) -> float:
    """Variance of a linear combination of the errors that is the offset's; 0 where none is considered."""
    total = 0.0
    if len(offset) > 0:
        own = offset[SHARED + p :].reshape(p, p)
        for i in range(p):
            for j in range(p):
                total += row[i] * own[i, j] * row[j]
    return total


@inlined
def scaled(variance: float, factor: float) -> float:
    """Their product, where 0·inf is 0: what is known for sure stays so."""
    return variance * factor if variance > 0.0 else 0.0


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


@inlined
def trust(p: int, k: int, accuracy: Compiled, out: Compiled) -> None:
    """Estimate k isn't valid where half of a 95 % interval is beyond a share of its value, and beyond another of the
    first value: `accuracy` holds the shares (p), then the others (p).
    """
    values, variances, statuses = out[0][k], out[1][k], out[5]
    good = True
    for j in range(p):
        allowed = max(accuracy[j] * abs(values[j]), accuracy[p + j] * abs(values[0]))
        good &= accuracy[j] == math.inf or NORMAL_95 * NORMAL_95 * variances[j] <= allowed * allowed
    if statuses[k] == VALID and not good:
        statuses[k] = NOT_EXCITED


# --- linear regression -----------------------------------------------------------------------------------------------


@jit
def least_squares(
    shape: Compiled,
    state: Compiled,
    rows: Compiled,
    outputs: Compiled,
    factors: Compiled,
    times: Compiled,
    codes: Compiled,
    limit: Compiled,
    directional: bool,
    accuracy: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """All samples; `shape` is any tuple of p floats; `factors`, `times` and `codes` hold n values or one for all."""
    p = len(shape)
    theta, d, u, own, tally = parts(p, state)
    phi, work, gain = scratch[0], scratch[1], scratch[2]
    thetas, variances, innovations, noises, _, _, _ = out
    varying, coded = len(factors) > 1, len(codes) > 1
    offset = state[offset_place(p) : len(state) - TALLY]
    for k in range(rows.shape[0]):
        wait(offset, times[k if len(times) > 1 else 0])
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
            innovations[k] = learn(
                p, theta, d, u, own, tally, phi, y, factor, limit, directional, work, gain, offset, 1.0
            )
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
            if len(offset) > 0:
                variances[k, j] += offset[SHARED + p + j * (p + 1)]
        trust(p, k, accuracy, out)


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
def row_once(t: float, shape: Compiled, room: Compiled) -> None:
    """Least squares of the row, output and code that are the last inputs; settings: `directional`, accuracies."""
    p = len(shape)
    room.time[0] = t
    own = room.inputs[len(room.inputs) - p - 2 :]
    least_squares(
        shape,
        room.state,
        own[:p].reshape(1, p),
        own[p : p + 1],
        room.factor,
        room.time,
        own[p + 1 :],
        room.limit,
        room.settings[0] > 0.0,
        room.settings[1:],
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
    row_once(t, shape, carve(shape, store))


@jit
def kelvin_voigt_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One contact: depth, rate, force, flag; then room for a row."""
    room = carve(shape, store)
    x, own = room.inputs, room.inputs[4:]
    kelvin_voigt_rows(x[:1], x[1:2], x[2:3], x[3:4], own[:2].reshape(1, 2), own[2:3], own[3:])
    row_once(t, shape, room)
