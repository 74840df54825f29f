"""Covariances in factored form, P = U·diag(d)·Uᵀ, which rounding can't make negative (Bierman 1977)."""

from __future__ import annotations

from kinid.estimators._jit import inlined
from kinid.kernels.types import Compiled

#: keeps what fades from becoming denormal, which is fifty times slower
TINY = 1e-150


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

    It reads the present values, so the parameters stay; other directions go on forgetting.
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
