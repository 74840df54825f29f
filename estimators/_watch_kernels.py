"""Kernels that watch over the estimators of Hunt-Crossley: what their values scatter by, and a second opinion.

Least squares states how noise moves its values, if the law holds and nothing changes within its memory. Two things tell
where that isn't so: values of one law that come out differently from memory to memory, and a regression in which the
stiffness may grow. A `second` is its state, as in `_kernels`, with room for its rows; `watch`: see `watch_size`.
"""

from __future__ import annotations

import math

from kinid.estimators._factored_kernels import quadratic
from kinid.estimators._jit import inlined
from kinid.estimators._kernels import HUGE, learn, offset_place, parts, scaled, shared_variance, spread
from kinid.estimators._store import SHARED, TALLY
from kinid.kernels.types import Compiled

#: estimates are held against their own mean over so many memories of the forgetting: so many of them are independent
MEMORIES = 5.0

#: memories after which the start is forgotten: it counts for a twentieth
SETTLED = 3.0

#: least variance that an estimate is weighed by
SURE = 1e-200


@inlined
def exp(value: float) -> float:
    """Exponential that can't overflow, for the first wild estimates."""
    return math.exp(min(max(value, -200.0), 200.0))


@inlined
def write_law(
    p: int,
    u: Compiled,
    d: Compiled,
    theta: Compiled,
    log_r: float,
    factor: float,
    offset: Compiled,
    row: Compiled,
    values: Compiled,
    variances: Compiled,
) -> None:
    """K, B, n and their variances from ln(K rⁿ), B/K, n, to first order; `factor` scales the covariance P.

    Further values are those of theta.

    `row` is scratch, for the Jacobian's rows.
    """
    b = theta[1]
    k = exp(theta[0] - theta[2] * log_r)
    values[0], values[1] = k, b * k
    for i in range(p):
        for j in range(p):
            row[j] = 0.0
        if i == 0:
            row[0], row[2] = k, -k * log_r
        elif i == 1:
            row[0], row[1], row[2] = b * k, k, -b * k * log_r
        else:
            row[i] = 1.0
            values[i] = theta[i]
        variances[i] = scaled(quadratic(p, u, d, row), factor) + shared_variance(p, offset, row)


@inlined
def watch_size(p: int) -> int:
    """Numbers of the watch over p values.

    Means, weights and squares of what they scatter by, and by how much their variances are wider than least squares has
    it (p each); of how many samples; memories since the start; time of the last sample in use [s].
    """
    return 4 * p + 3


@inlined
def second_size() -> int:
    """Numbers of a second opinion: least squares of four parameters, and room for its rows."""
    return offset_place(4) + TALLY + 12


@inlined
def elapsed(watch: Compiled, now: float) -> float:
    """Time since the last sample that was used [s]; 1 ms where none is known."""
    last = watch[len(watch) - 1]
    watch[len(watch) - 1] = now
    if math.isnan(now):
        return 1e-3
    return 0.0 if math.isnan(last) else max(now - last, 0.0)


@inlined
def grow(p: int, theta: Compiled, u: Compiled, step: float) -> float:
    """The logarithm of the stiffness, the first value, grows for so long [s] at the rate that is the last one.

    θ ← F θ with F = I + step e₀ eₚᵀ, which is unit upper triangular, as U is: F U is the factor of F P Fᵀ.
    """
    moved = float(theta[p - 1] * step)
    theta[0] += moved
    u[0, p - 1] += step
    return moved


@inlined
def grow_shared(p: int, offset: Compiled, step: float) -> None:
    """The same of what a considered offset adds: C ← F C, Z ← F Z Fᵀ."""
    if len(offset) > 0:
        shared = offset[SHARED : SHARED + p]
        own = offset[SHARED + p :].reshape(p, p)
        shared[0] += step * shared[p - 1]
        for j in range(p):
            own[0, j] += step * own[p - 1, j]
        for j in range(p):
            own[j, 0] += step * own[j, p - 1]


@inlined
def second_opinion(
    second: Compiled,
    step: float,
    weight: float,
    v: float,
    position: float,
    y: float,
    factor: float,
    limit: Compiled,
) -> None:
    """Least squares of the same rows, in which ln K may grow; its regressor is the time until now, always 0."""
    end = offset_place(4) + TALLY
    theta, d, u, own, tally = parts(4, second[:end])
    phi, work, gain = second[end : end + 4], second[end + 4 : end + 8], second[end + 8 : end + 12]
    grow(4, theta, u, step)
    phi[0], phi[1], phi[2], phi[3] = weight, weight * v, weight * position, 0.0
    learn(4, theta, d, u, own, tally, phi, y, factor, limit, False, work, gain, second[:0], 0.0)


@inlined
def doubt(second: Compiled, log_r: float, own: bool, stated: Compiled, values: Compiled, variances: Compiled) -> None:
    """Variances from those of least squares, `stated`, and a second opinion.

    What values differ by from that opinion is their error, as far as its own noise doesn't say it: of least squares
    that takes K for constant the difference has the variance V₂ − V where K is (J. A. Hausman, Econometrica 46, 1978).
    Values that are not those of least squares have V₂ at least; `stated` is set to it.
    """
    end = offset_place(4) + TALLY
    theta, d, u, _, tally = parts(4, second[:end])
    row, other, opinion = second[end : end + 4], second[end + 4 : end + 8], second[end + 8 : end + 12]
    write_law(4, u, d, theta, log_r, spread(tally), second[:0], row, other, opinion)
    for j in range(3):
        if not own:
            stated[j] = opinion[j]
        apart = min(abs(values[j] - other[j]), HUGE)
        noise = opinion[j] - stated[j] if opinion[j] < math.inf else 0.0
        variances[j] = stated[j] + max(apart * apart - max(noise, 0.0), 0.0)


@inlined
def note(p: int, watch: Compiled, stated: Compiled, variances: Compiled) -> None:
    """By how much the variances have become wider than least squares has it."""
    for j in range(p):
        known = 0.0 < stated[j] < math.inf and variances[j] < math.inf
        watch[3 * p + j] = variances[j] / stated[j] if known else 1.0


@inlined
def scatter(p: int, watch: Compiled, factor: float, used: bool, values: Compiled, variances: Compiled) -> None:
    """Variances become no smaller than values scatter about their mean over the last `MEMORIES` of the forgetting.

    By the mean squared deviation in units of the stated variances (R. T. Birge, Phys. Rev. 40, 1932). Estimates that
    are a memory apart share no sample: where they contradict each other, the law is another one, or its parameters
    change within a memory, and the covariance of least squares knows of neither. Nothing is learnt while the start
    isn't forgotten, which is never where nothing is: estimates are of the same samples then.
    """
    count, age = 4 * p, 4 * p + 1
    keep = 1.0 - (1.0 - factor) / MEMORIES
    if used:
        watch[age] += 1.0 - factor
    learns = used and watch[age] > SETTLED
    if learns:
        watch[count] = keep * watch[count] + 1.0
    for j in range(p):
        if learns and SURE < variances[j] < HUGE:
            trusted = 1.0 / variances[j]
            watch[p + j] = keep * watch[p + j] + trusted
            apart = values[j] - watch[j]
            watch[j] += trusted / watch[p + j] * apart
            watch[2 * p + j] = min(keep * watch[2 * p + j] + trusted * apart * (values[j] - watch[j]), HUGE)
        if watch[count] > 0.0:
            variances[j] *= max(1.0, watch[2 * p + j] / watch[count])


@inlined
def judge_errors(
    p: int,
    second: Compiled,
    watch: Compiled,
    log_r: float,
    factor: float,
    used: bool,
    own: bool,
    stated: Compiled,
    values: Compiled,
    variances: Compiled,
) -> None:
    """Variances of least squares become those that the watch, and a second opinion where there is one, leave possible.

    Args: see `doubt` and `scatter`; `stated` is scratch.
    """
    for j in range(p):
        stated[j] = variances[j]
    if len(second) > 0:
        doubt(second, log_r, own, stated, values, variances)
    scatter(p, watch, factor, used, values, variances)
    note(p, watch, stated, variances)
