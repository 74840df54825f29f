"""How laws with memory change when their path does, to first order; what it takes to solve for a force behind a
compliance.

A memory z of S parts goes z = K z₋ + a dv₋ + b dv + d dx, where x is depth and v its rate; the force changes by the sum
of A z. Arrays are (n, S, S) for K, (n, S) for a, b, d and A; `dt` as in `kinid.kernels.memory`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel
from kinid.kernels.memory import _touching, _turn

Array = NDArray[np.float64]


@kernel
def recalled_bristles(
    rate: Array, dt: Array, depth: Array, length: float, elastic: float, keep: Array, before: Array, now: Array
) -> None:
    """Of `kinid.kernels.memory.bristles` along one axis: parts u, which slips, and w, which is elastic.

    Args:
        rate: v [m/s], (n,). dt, depth, length, elastic: as there. keep, before, now: K, a, b of (u, w).
    """
    u, w = 0.0, 0.0
    of_u, of_w = np.empty(4), np.empty(4)  # derivatives over u₋, w₋, v₋, v
    for i in range(rate.shape[0]):
        for k in range(4):
            of_u[k], of_w[k] = 0.0, 0.0
        if i == 0 or dt[i] <= 0.0 or not depth[i] > 0:
            u, w = 0.0, 0.0
        else:
            of_u[0], of_w[1] = 1.0, 1.0
            step = dt[i] * _touching(depth[i - 1], depth[i])
            turn = _turn(rate[i - 1], 0.0, rate[i], 0.0)
            for begin, end in ((0.0, turn), (turn, 1.0)):
                if begin < end:
                    # v runs straight over the step, and where it turns it is 0: that place may move
                    later = 0.5 * (end * end - begin * begin) * step
                    earlier = (end - begin) * step - later
                    w += earlier * rate[i - 1] + later * rate[i]
                    of_w[2] += earlier
                    of_w[3] += later
                    moved = abs(w) - elastic * length
                    if moved > 0.0:
                        side = 1.0 if w > 0.0 else -1.0
                        e = np.exp(-moved / length)
                        for k in range(4):
                            of_u[k] = e * of_u[k] + e * (1.0 - side * u) / length * of_w[k]
                            of_w[k] = 0.0
                        u, w = e * u + (1.0 - e) * side, elastic * length * side
        keep[i, 0, 0], keep[i, 0, 1], before[i, 0], now[i, 0] = of_u
        keep[i, 1, 0], keep[i, 1, 1], before[i, 1], now[i, 1] = of_w


@kernel
def recalled_deepest(depth: Array, dt: Array, forgotten: float, keep: Array, reach: Array, most: Array) -> None:
    """Of how deep the tip has been; where it is the deepest itself there is nothing to remember.

    Args:
        depth: [m], (n,). dt: see above. forgotten: a depth at which everything begins anew [m]. keep, reach: K, d.
        most: the deepest before each sample that is less deep, else 0 [m], (n,).
    """
    last = 0.0
    for i in range(depth.shape[0]):
        if i == 0 or dt[i] <= 0.0 or depth[i] <= forgotten:
            last = 0.0
        deeper = depth[i] > 0.0 and depth[i] >= last
        reach[i, 0] = 1.0 if deeper else 0.0
        keep[i, 0, 0] = 0.0 if deeper or last == 0.0 else 1.0
        most[i] = 0.0 if deeper else last
        if deeper:
            last = depth[i]


@kernel
def remembered(
    dx: Array, dv: Array, dt: Array, keep: Array, before: Array, now: Array, reach: Array, size: Array, out: Array
) -> None:
    """Σ A z of a path that is off by dx and dv.

    Args:
        dx [m], dv [m/s]: (n,). dt: see above. keep, before, now, reach, size: K, a, b, d, A. out: (n,).
    """
    parts = size.shape[1]
    z, last = np.zeros(parts), np.zeros(parts)
    for i in range(dx.shape[0]):
        goes_on = i > 0 and dt[i] > 0.0
        for k in range(parts):
            last[k] = z[k]
        out[i] = 0.0
        for k in range(parts):
            z[k] = reach[i, k] * dx[i]
            if goes_on:
                z[k] += before[i, k] * dv[i - 1] + now[i, k] * dv[i]
                for j in range(parts):
                    z[k] += keep[i, k, j] * last[j]
            out[i] += size[i, k] * z[k]


@kernel
def forwards(
    rest: Array,
    dt: Array,
    compliance: float,
    stiff: Array,
    lossy: Array,
    keep: Array,
    before: Array,
    now: Array,
    reach: Array,
    size: Array,
    out: Array,
) -> None:
    """Solve y + C (k y + l ẏ) − Σ A z = rest in time; the path moves by dx = −C y, and ẏ is the difference to the
    sample before.

    Args:
        rest: (n,). dt: see above. compliance: C [m/N]. stiff, lossy: k ≥ 0 [N/m] and l ≥ 0 [N·s/m], (n,).
        keep, before, now, reach, size: K, a, b, d, A of what is remembered. out: y, (n,).
    """
    parts = size.shape[1]
    z, last = np.zeros(parts), np.zeros(parts)
    earlier = 0.0  # dv of the sample before
    for i in range(rest.shape[0]):
        if i == 0 or dt[i] <= 0.0:
            earlier = 0.0
            out[i] = rest[i] / (1.0 + compliance * stiff[i])
            for k in range(parts):
                z[k] = -compliance * reach[i, k] * out[i]
            continue
        per = compliance / dt[i]  # dv = −per (y − y₋)
        weight = per * lossy[i]
        known, own = rest[i] + weight * out[i - 1], 1.0 + compliance * stiff[i] + weight
        for k in range(parts):
            last[k] = z[k]
        for k in range(parts):
            z[k] = before[i, k] * earlier + now[i, k] * per * out[i - 1]
            for j in range(parts):
                z[k] += keep[i, k, j] * last[j]
            known += size[i, k] * z[k]
            own += size[i, k] * (now[i, k] * per + reach[i, k] * compliance)
        out[i] = known / own
        earlier = -per * (out[i] - out[i - 1])
        for k in range(parts):
            z[k] -= (now[i, k] * per + reach[i, k] * compliance) * out[i]
