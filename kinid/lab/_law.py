"""The laboratory's own contact law, one instant at a time: written apart from the effects that are later fitted to
it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

# parameters of a contact that hold throughout a patch
EXPONENT, LOSS, RATIO1, TIME1, RATIO2, TIME2, LOOP, LOOP_LENGTH = range(8)
SOFT, SOFT_LENGTH, PULL, PULL_LENGTH, DRIFT = range(8, 13)
STRIBECK, STRIBECK_SPEED, VISCOUS, BRISTLE, LOAD, ANISOTROPY, COMPLIANCE, ROUNDING = range(13, 21)
COUPLED_K, COUPLED_C, PARAMETERS = 21, 30, 39
# property fields over the surface
STIFFNESS, DAMPING, FRICTION, LAYER, LAYER_DEPTH = range(5)
FIELDS = 5
# memory
_Y1, _Y2, _FE, _Z, _ZW, _DEPTH, _MOST, BOND = range(8)
_U1, _U2, _W1, _W2, _S1, _S2, _X1, _X2 = range(8, 16)
_TOUCH, _EFFECTIVE, _PULL, FORCE = range(16, 20)
MEMORY = FORCE + 3

_AHEAD = 0.02  # share of a bristle's length that is purely elastic (Dupont et al. 2002)


@kernel
def _field(fields: Array, grid: Array, x: float, y: float, out: Array) -> None:
    """Bilinear interpolation of all fields (FIELDS, nx, ny); grid: x0, y0, dx, dy. Beyond the grid its edge
    continues.
    """
    nx, ny = fields.shape[1], fields.shape[2]
    a = min(max((x - grid[0]) / grid[2], 0.0), nx - 1.0)
    b = min(max((y - grid[1]) / grid[3], 0.0), ny - 1.0)
    i, j = min(int(a), nx - 2), min(int(b), ny - 2)
    a, b = a - i, b - j
    for k in range(FIELDS):
        out[k] = (1 - a) * ((1 - b) * fields[k, i, j] + b * fields[k, i, j + 1]) + a * (
            (1 - b) * fields[k, i + 1, j] + b * fields[k, i + 1, j + 1]
        )


@kernel
def _branch(y: float, before: float, now: float, dt: float, tau: float) -> float:
    """τ ẏ = F − y over dt, F running straight."""
    h = dt / tau
    e = np.exp(-h)
    slope = now - before
    return now - slope / h * (1.0 - e) + (y - before) * e if h > 1e-6 else y + h * (0.5 * (before + now) - y)


@kernel
def _play(w: float, u: float, step: float, length: float) -> tuple[float, float]:
    """A play of ± 0.02 ℓ, then Dahl's bristle, in one dimension."""
    w += step
    over = abs(w) - _AHEAD * length
    if over > 0.0:
        sign = 1.0 if w > 0.0 else -1.0
        w = sign * _AHEAD * length
        u = sign + (u - sign) * np.exp(-over / length)
    return w, u


@kernel
def _normal(depth: float, rate: float, t: float, dt: float, m: Array, new: Array, p: Array, at: Array) -> float:
    """Normal force at a depth; fills the normal part of the new memory."""
    new[_DEPTH] = depth
    new[_MOST] = max(m[_MOST], depth)
    pull = 0.0
    if p[PULL] > 0.0:
        bond = m[BOND]
        if depth <= -p[PULL_LENGTH]:
            bond = -1.0
        elif depth > 0.0:
            bond = max(bond, depth)
        new[BOND] = bond
        if bond > 0.0:
            pull = p[PULL] * (1.0 - np.exp((depth - bond) / p[PULL_LENGTH]))
            if depth < 0.0:
                gone = depth / p[PULL_LENGTH]
                pull *= 1.0 - gone * gone
    new[_PULL] = pull
    elastic = 0.0
    if depth > 0.0:
        elastic = at[STIFFNESS] * (depth if p[EXPONENT] == 1.0 else depth ** p[EXPONENT])
        elastic += at[LAYER] * max(0.0, depth - at[LAYER_DEPTH])
        if p[SOFT] != 0.0:
            elastic *= 1.0 - p[SOFT] * (1.0 - np.exp((depth - new[_MOST]) / p[SOFT_LENGTH]))
        elastic *= 1.0 + p[DRIFT] * t / 60.0
    new[_FE] = elastic
    force = elastic
    if p[RATIO1] > 0.0:
        new[_Y1] = _branch(m[_Y1], m[_FE], elastic, dt, p[TIME1])
        force += p[RATIO1] * (elastic - new[_Y1])
    if p[RATIO2] > 0.0:
        new[_Y2] = _branch(m[_Y2], m[_FE], elastic, dt, p[TIME2])
        force += p[RATIO2] * (elastic - new[_Y2])
    if depth <= 0.0:
        new[_Z] = new[_ZW] = 0.0
        return -pull
    if p[LOOP] > 0.0:
        new[_ZW], new[_Z] = _play(m[_ZW], m[_Z], depth - max(m[_DEPTH], 0.0), p[LOOP_LENGTH])
        force += p[LOOP] * elastic * ((1.0 - _AHEAD) * new[_Z] + new[_ZW] / p[LOOP_LENGTH])
    force += (at[DAMPING] + p[LOSS] * elastic) * rate
    return float(max(force, 0.0) - pull)


@kernel
def _patch(patches: NDArray[np.int64], grid: Array, x: float, y: float) -> int:
    """Number of the patch at a place: that of the nearest point of the grid."""
    i = int(min(max((x - grid[0]) / grid[2] + 0.5, 0.0), patches.shape[0] - 1.0))
    j = int(min(max((y - grid[1]) / grid[3] + 0.5, 0.0), patches.shape[1] - 1.0))
    return int(patches[i, j])


@kernel
def _effective(
    depth: float, rate: float, t: float, dt: float, m: Array, new: Array, p: Array, at: Array
) -> tuple[float, float]:
    """Depth and rate of the material behind a spring, e + C N(e, ė) = δ, by secants from where it was."""
    c, e0 = p[COMPLIANCE], m[_EFFECTIVE] if m[_TOUCH] > 0.0 else depth
    a = e0 + rate * dt
    fa = a + c * _normal(a, (a - e0) / dt, t, dt, m, new, p, at) - depth
    b = a - fa
    for _ in range(12):
        fb = b + c * _normal(b, (b - e0) / dt, t, dt, m, new, p, at) - depth
        if abs(fb) < 1e-13 or fb == fa:
            break
        a, fa, b = b, fb, b - fb * (b - a) / (fb - fa)
    return b, (b - e0) / dt


@kernel
def _friction(x: Array, v: Array, normal: float, m: Array, new: Array, p: Array, at: Array) -> tuple[float, float]:
    """Tangential forces of a bristle, or of a film; fills the tangential part of the new memory."""
    if m[_TOUCH] == 0.0:
        new[_X1], new[_X2], new[_TOUCH] = x[0], x[1], 1.0
        step1 = step2 = 0.0
    else:
        step1, step2 = x[0] - m[_S1], x[1] - m[_S2]
    length = p[BRISTLE]
    w1, w2 = m[_W1] + step1, m[_W2] + step2
    u1, u2 = m[_U1], m[_U2]
    far = np.sqrt(w1 * w1 + w2 * w2)
    over = far - _AHEAD * length
    if over > 0.0:
        d1, d2, e = w1 / far, w2 / far, np.exp(-over / length)
        w1, w2 = _AHEAD * length * d1, _AHEAD * length * d2
        u1, u2 = d1 + (u1 - d1) * e, d2 + (u2 - d2) * e
    new[_W1], new[_W2], new[_U1], new[_U2] = w1, w2, u1, u2
    load = max(normal + new[_PULL], 0.0)  # a bond doesn't take off what presses the surfaces together
    mu = at[FRICTION]
    if p[STRIBECK] != 0.0:
        mu += p[STRIBECK] * np.exp(-(v[0] * v[0] + v[1] * v[1]) / p[STRIBECK_SPEED] ** 2)
    if p[LOAD] != 0.0:
        mu *= max(load, 1e-3) ** p[LOAD]
    d1, d2 = (1.0 - _AHEAD) * u1 + w1 / length, (1.0 - _AHEAD) * u2 + w2 / length
    if p[ROUNDING] > 0.0:  # a film instead of bristles
        fast = np.sqrt(v[0] * v[0] + v[1] * v[1] + p[ROUNDING] ** 2)
        d1, d2 = v[0] / fast, v[1] / fast
    t1 = -mu * (1.0 + p[ANISOTROPY]) * load * d1 - p[VISCOUS] * v[0]
    t2 = -mu * (1.0 - p[ANISOTROPY]) * load * d2 - p[VISCOUS] * v[1]
    return t1, t2


@kernel
def contact(
    x: Array,
    v: Array,
    t: float,
    dt: float,
    m: Array,
    new: Array,
    table: Array,
    patches: NDArray[np.int64],
    fields: Array,
    grid: Array,
    at: Array,
) -> None:
    """One step of the contact: force of the material on the tool at the step's end, in new[FORCE:FORCE + 3].

    Args:
        x: place along both tangents, and depth [m], (3,). v: their rates [m/s], (3,). t: [s]. dt: since `m` [s], > 0.
        m: memory at the step's beginning, (MEMORY,), unchanged. new: at its end.
        table: parameters of each patch, (patches, PARAMETERS). patches: which of them is where, (nx, ny) over `grid`.
        fields: (FIELDS, nx, ny) over `grid`. at: scratch, (FIELDS,).
    """
    for k in range(MEMORY):
        new[k] = m[k]
    p = table[_patch(patches, grid, x[0], x[1])]
    _field(fields, grid, x[0], x[1], at)
    depth, rate = x[2], v[2]
    if p[COMPLIANCE] > 0.0 and depth > -1e-3:
        depth, rate = _effective(depth, rate, t, dt, m, new, p, at)
    normal = _normal(depth, rate, t, dt, m, new, p, at)
    new[_EFFECTIVE] = depth
    new[_S1], new[_S2] = x[0], x[1]
    if depth <= 0.0:
        new[_U1] = new[_U2] = new[_W1] = new[_W2] = new[_TOUCH] = 0.0
        new[FORCE] = new[FORCE + 1] = 0.0
        new[FORCE + 2] = normal
        return
    new[FORCE], new[FORCE + 1] = _friction(x, v, normal, m, new, p, at)
    new[FORCE + 2] = normal
    y1, y2 = x[0] - new[_X1], x[1] - new[_X2]
    for i in range(3):
        k, q = COUPLED_K + 3 * i, COUPLED_C + 3 * i
        extra = p[k] * y1 + p[k + 1] * y2 + p[k + 2] * depth + p[q] * v[0] + p[q + 1] * v[1] + p[q + 2] * rate
        new[FORCE + i] += extra
