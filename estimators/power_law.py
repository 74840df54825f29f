"""Hunt-Crossley offline, in one pass over the samples a step: f = K xⁿ + B xⁿ ẋ.

For a given exponent the law is linear in K and B, so that only n is searched for (variable projection, Golub & Pereyra
1973, with Kaufman's 1975 step). All that a step needs are sums of x²ⁿ and xⁿ f times powers of ẋ and ln x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError

Array = NDArray[np.float64]

#: exponents outside these aren't sought
LOWEST, HIGHEST = 0.2, 5.0


@dataclass(frozen=True, eq=False)
class PowerLaw:
    """Stiffness K [N/mⁿ], damping B [N·s/mⁿ⁺¹], exponent n, with their covariance for white noise.

    Attributes:
        covariance: of K, B, n, (3, 3). rms: of the residual [N]. samples: that were inside. steps: of the search.
        converged: whether n settled within its bounds.
    """

    stiffness: float
    damping: float
    exponent: float
    covariance: Array
    rms: float
    samples: int
    steps: int
    converged: bool


def fit_power_law(depth: ArrayLike, depth_rate: ArrayLike, force: ArrayLike, start: float = 1.2) -> PowerLaw:
    """Fit the law of Hunt and Crossley to samples inside the material (depth > 0); others are passed over.

    Args:
        depth: x [m], (n,). depth_rate: ẋ [m/s], (n,). force: f [N], (n,).
        start: exponent to begin with.

    Raises:
        InputError: shapes that differ, or fewer than four samples inside.
    """
    x, v, f = (np.ascontiguousarray(values, dtype=np.float64) for values in (depth, depth_rate, force))
    if x.ndim != 1 or x.shape != v.shape or x.shape != f.shape:
        raise InputError(
            f"depth {x.shape}, depth rate {v.shape}, force {f.shape}", "three arrays of one length", "align them"
        )
    inside = (x > 0) & np.isfinite(v) & np.isfinite(f) & np.isfinite(x)
    if not inside.all():
        x, v, f = x[inside], v[inside], f[inside]
    if len(x) < 4:
        raise InputError(f"{len(x)} samples inside the material", "four at least", "poke deeper or for longer")
    # lengths in units of their geometric mean keep xⁿ near one and the sums well-conditioned
    log_x = np.log(x)
    unit = float(log_x.mean())
    log_x -= unit
    speed = float(np.sqrt(np.mean(v * v))) or 1.0
    n, stiffness, damping, information, rss, steps, converged = _search(log_x, v / speed, f, start)
    scale = np.exp(-n * unit)
    # K and B depend on n through the unit of length
    jacobian = np.array(
        [
            [scale, 0.0, -unit * scale * stiffness],
            [0.0, scale / speed, -unit * scale * damping / speed],
            [0.0, 0.0, 1.0],
        ]
    )
    variance = rss / max(1, len(x) - 3)
    try:
        covariance = jacobian @ np.linalg.inv(information) @ jacobian.T * variance
    except np.linalg.LinAlgError:
        covariance = np.full((3, 3), np.inf)
    return PowerLaw(
        float(stiffness * scale),
        float(damping * scale / speed),
        float(n),
        covariance,
        float(np.sqrt(rss / len(x))),
        len(x),
        int(steps),
        bool(converged),
    )


@njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _sums(log_x: Array, v: Array, f: Array, n: float, out: Array) -> None:
    """Sums of w² vᵃ Lᵇ (a, b = 0…2: entries 0–8) and w f vᵃ Lᵇ (a, b = 0, 1: entries 9–12), w = xⁿ, L = ln x."""
    a0 = a1 = a2 = b0 = b1 = b2 = c0 = c1 = c2 = 0.0
    d0 = d1 = d2 = d3 = 0.0
    for i in range(log_x.shape[0]):
        el = log_x[i]
        w = np.exp(n * el)
        q, wf, u = w * w, w * f[i], v[i]
        qu = q * u
        quu = qu * u
        a0 += q
        b0 += qu
        c0 += quu
        a1 += q * el
        b1 += qu * el
        c1 += quu * el
        a2 += q * el * el
        b2 += qu * el * el
        c2 += quu * el * el
        d0 += wf
        d1 += wf * u
        d2 += wf * el
        d3 += wf * u * el
    out[0], out[1], out[2] = a0, a1, a2
    out[3], out[4], out[5] = b0, b1, b2
    out[6], out[7], out[8] = c0, c1, c2
    out[9], out[10], out[11], out[12] = d0, d1, d2, d3


@njit(cache=True)
def _search(log_x: Array, v: Array, f: Array, start: float) -> tuple[float, float, float, Array, float, int, bool]:
    """Newton-like steps on n, halved until the residual falls."""
    s = np.zeros(13)
    information = np.zeros((3, 3))
    n, step, steps, converged = start, 0.0, 0, False
    best, k, b = np.inf, 0.0, 0.0
    power = 0.0
    for i in range(f.shape[0]):
        power += f[i] * f[i]
    trial = n
    for _ in range(60):
        steps += 1
        _sums(log_x, v, f, trial, s)
        det = s[0] * s[6] - s[3] * s[3]
        if det > 1e-12 * s[0] * s[6]:
            k1, b1 = (s[6] * s[9] - s[3] * s[10]) / det, (s[0] * s[10] - s[3] * s[9]) / det
        else:  # no speed to tell the damping from
            k1, b1 = s[9] / s[0], 0.0
        rss = power - k1 * s[9] - b1 * s[10]
        if rss > best * (1.0 + 1e-12) + 1e-13 * power:
            step *= 0.5
            trial = n + step
            if abs(step) < 1e-9:
                converged = True
                break
            continue
        best, n, k, b = rss, trial, k1, b1
        # the change of the fitted force with n is L m, m = w (k + b v); what K and B can re-fit is projected out
        m1 = k * s[1] + b * s[4]  # Σ w · w L (k + b v)
        m2 = k * s[4] + b * s[7]
        mm = k * k * s[2] + 2.0 * k * b * s[5] + b * b * s[8]
        gradient = k * s[11] + b * s[12] - k * m1 - b * m2  # Σ r L m
        if det > 1e-12 * s[0] * s[6]:
            p1, p2 = (s[6] * m1 - s[3] * m2) / det, (s[0] * m2 - s[3] * m1) / det
        else:
            p1, p2 = m1 / s[0], 0.0
        curvature = mm - p1 * m1 - p2 * m2
        information[0, 0], information[0, 1], information[1, 1] = s[0], s[3], s[6]
        information[0, 2], information[1, 2], information[2, 2] = m1, m2, mm
        if not curvature > 1e-14 * mm:
            break
        step = min(0.7, max(-0.7, gradient / curvature))
        trial = min(HIGHEST, max(LOWEST, n + step))
        step = trial - n
        if abs(step) < 1e-11 * max(1.0, n):
            converged = LOWEST < n < HIGHEST
            break
    information[1, 0], information[2, 0], information[2, 1] = information[0, 1], information[0, 2], information[1, 2]
    # the residual from the samples themselves: the difference of sums has lost it where the fit is good
    rss = 0.0
    for i in range(f.shape[0]):
        r = f[i] - np.exp(n * log_x[i]) * (k + b * v[i])
        rss += r * r
    return n, k, b, information, rss, steps, converged
