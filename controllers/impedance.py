"""Geometric Cartesian impedance: a spring on SE(3), a damper on the twist's error, gravity held, null space damped.

The spring is a potential of the tip's pose, written without coordinates of the rotation. With Δ = p_d − p and
E = R_d Rᵀ, the rotation that is left to do, in base axes, and with K = [[K_t, K_c], [K_cᵀ, K_r]] in base axes at the
tip,

    V = ½ Δᵀ K_t Δ + tr(G (I − E)) + Δᵀ K_c a,    G = ½ tr(K_r) I − K_r,    a = ½ (E − Eᵀ)^∨

(E. D. Fasse, J. F. Broenink, IEEE Trans. Robotics and Automation 13, 1997: translational, rotational and coupling
potential). V is smooth on all of SE(3): there is no jump at half a turn as with the logarithm, and no sign of a
quaternion to keep. Near the set-point V = ½ eᵀ K e with e = (Δ, rotation vector). The wrench is V's exact gradient (the
moment is 2 (η − ε×) K_r ε in the quaternion (η, ε) of E), so that a set-point at rest never gives energy.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: regularises the null-space projector where the Jacobian loses rank, relative to the trace of J Jᵀ
RANK = 1e-10


Six = tuple[float, float, float, float, float, float]


@njit(cache=True, error_model="numpy")
def _spring(rotation: Array, position: Array, rotation_d: Array, position_d: Array, stiffness: Array) -> Six:
    """The wrench −∂V, see the module: force [N], then moment [N·m]; arguments as in `impedance_torque`."""
    r, d = rotation, rotation_d
    # E = R_d Rᵀ
    e00 = d[0, 0] * r[0, 0] + d[0, 1] * r[0, 1] + d[0, 2] * r[0, 2]
    e01 = d[0, 0] * r[1, 0] + d[0, 1] * r[1, 1] + d[0, 2] * r[1, 2]
    e02 = d[0, 0] * r[2, 0] + d[0, 1] * r[2, 1] + d[0, 2] * r[2, 2]
    e10 = d[1, 0] * r[0, 0] + d[1, 1] * r[0, 1] + d[1, 2] * r[0, 2]
    e11 = d[1, 0] * r[1, 0] + d[1, 1] * r[1, 1] + d[1, 2] * r[1, 2]
    e12 = d[1, 0] * r[2, 0] + d[1, 1] * r[2, 1] + d[1, 2] * r[2, 2]
    e20 = d[2, 0] * r[0, 0] + d[2, 1] * r[0, 1] + d[2, 2] * r[0, 2]
    e21 = d[2, 0] * r[1, 0] + d[2, 1] * r[1, 1] + d[2, 2] * r[1, 2]
    e22 = d[2, 0] * r[2, 0] + d[2, 1] * r[2, 1] + d[2, 2] * r[2, 2]
    x, y, z = position_d[0] - position[0], position_d[1] - position[1], position_d[2] - position[2]
    a0, a1, a2 = 0.5 * (e21 - e12), 0.5 * (e02 - e20), 0.5 * (e10 - e01)
    k = stiffness
    f0 = k[0, 0] * x + k[0, 1] * y + k[0, 2] * z + k[0, 3] * a0 + k[0, 4] * a1 + k[0, 5] * a2
    f1 = k[1, 0] * x + k[1, 1] * y + k[1, 2] * z + k[1, 3] * a0 + k[1, 4] * a1 + k[1, 5] * a2
    f2 = k[2, 0] * x + k[2, 1] * y + k[2, 2] * z + k[2, 3] * a0 + k[2, 4] * a1 + k[2, 5] * a2
    # rotational part: (G E − Eᵀ G)^∨
    half = 0.5 * (k[3, 3] + k[4, 4] + k[5, 5])
    g00, g11, g22, g01, g02, g12 = half - k[3, 3], half - k[4, 4], half - k[5, 5], -k[3, 4], -k[3, 5], -k[4, 5]
    m0 = (g02 * e01 + g12 * e11 + g22 * e21) - (g01 * e02 + g11 * e12 + g12 * e22)
    m1 = (g00 * e02 + g01 * e12 + g02 * e22) - (g02 * e00 + g12 * e10 + g22 * e20)
    m2 = (g01 * e00 + g11 * e10 + g12 * e20) - (g00 * e01 + g01 * e11 + g02 * e21)
    # coupling: ½ (tr(E) I − E) K_cᵀ Δ
    c0 = k[3, 0] * x + k[3, 1] * y + k[3, 2] * z
    c1 = k[4, 0] * x + k[4, 1] * y + k[4, 2] * z
    c2 = k[5, 0] * x + k[5, 1] * y + k[5, 2] * z
    trace = e00 + e11 + e22
    m0 += 0.5 * (trace * c0 - e00 * c0 - e01 * c1 - e02 * c2)
    m1 += 0.5 * (trace * c1 - e10 * c0 - e11 * c1 - e12 * c2)
    m2 += 0.5 * (trace * c2 - e20 * c0 - e21 * c1 - e22 * c2)
    return f0, f1, f2, m0, m1, m2


@njit(cache=True, error_model="numpy")
def _twist(jacobian: Array, dq: Array) -> Six:
    """J q̇."""
    v0, v1, v2, v3, v4, v5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(dq.shape[0]):
        speed = dq[j]
        v0 += jacobian[0, j] * speed
        v1 += jacobian[1, j] * speed
        v2 += jacobian[2, j] * speed
        v3 += jacobian[3, j] * speed
        v4 += jacobian[4, j] * speed
        v5 += jacobian[5, j] * speed
    return v0, v1, v2, v3, v4, v5


@njit(cache=True, error_model="numpy")
def impedance_torque(
    rotation: Array,
    position: Array,
    jacobian: Array,
    dq: Array,
    gravity_torque: Array,
    rotation_d: Array,
    position_d: Array,
    velocity_d: Array,
    stiffness: Array,
    damping: Array,
    null_damping: float,
    torque_limit: Array,
    out: Array,
) -> None:
    """τ = clip(g + Jᵀ (−∂V + D (ẋ_d − J q̇)) − d P q̇); nothing is allocated.

    P = I − Jᵀ (J Jᵀ + λ)⁻¹ J is symmetric and positive semi-definite, whatever λ: null-space damping never gives
    energy. It is not the dynamically consistent projector: it may accelerate the tip a little, against which the spring
    works. Saturation clips each joint on its own; a clipped torque is no gradient any more.

    Args:
        rotation, position: of the tip, (3, 3), (3,) [m]. jacobian: rows linear, angular, base axes, at the tip, (6, N).
        dq: (N,). gravity_torque: what holds the arm against gravity [N·m], (N,).
        rotation_d, position_d, velocity_d: set-point, (3, 3), (3,), (6,) [m/s, rad/s].
        stiffness, damping: base axes, linear then angular, symmetric, (6, 6) [N/m, N, N·m/rad; N·s/m, N·s, N·m·s/rad].
        null_damping: d [N·m·s/rad]. torque_limit: [N·m], (N,). out: τ, (N,).
    """
    f0, f1, f2, m0, m1, m2 = _spring(rotation, position, rotation_d, position_d, stiffness)
    # damper, on the error of the twist
    v0, v1, v2, v3, v4, v5 = _twist(jacobian, dq)
    w, b = velocity_d, damping
    u0, u1, u2, u3, u4, u5 = w[0] - v0, w[1] - v1, w[2] - v2, w[3] - v3, w[4] - v4, w[5] - v5
    f0 += b[0, 0] * u0 + b[0, 1] * u1 + b[0, 2] * u2 + b[0, 3] * u3 + b[0, 4] * u4 + b[0, 5] * u5
    f1 += b[1, 0] * u0 + b[1, 1] * u1 + b[1, 2] * u2 + b[1, 3] * u3 + b[1, 4] * u4 + b[1, 5] * u5
    f2 += b[2, 0] * u0 + b[2, 1] * u1 + b[2, 2] * u2 + b[2, 3] * u3 + b[2, 4] * u4 + b[2, 5] * u5
    m0 += b[3, 0] * u0 + b[3, 1] * u1 + b[3, 2] * u2 + b[3, 3] * u3 + b[3, 4] * u4 + b[3, 5] * u5
    m1 += b[4, 0] * u0 + b[4, 1] * u1 + b[4, 2] * u2 + b[4, 3] * u3 + b[4, 4] * u4 + b[4, 5] * u5
    m2 += b[5, 0] * u0 + b[5, 1] * u1 + b[5, 2] * u2 + b[5, 3] * u3 + b[5, 4] * u4 + b[5, 5] * u5
    if null_damping > 0.0:
        # −d P q̇ = −d q̇ + Jᵀ d (J Jᵀ + λ)⁻¹ J q̇: the second part joins the wrench
        s0, s1, s2, s3, s4, s5 = _task_part(jacobian, v0, v1, v2, v3, v4, v5)
        f0, f1, f2 = f0 + null_damping * s0, f1 + null_damping * s1, f2 + null_damping * s2
        m0, m1, m2 = m0 + null_damping * s3, m1 + null_damping * s4, m2 + null_damping * s5
    for j in range(dq.shape[0]):
        torque = (
            gravity_torque[j]
            - null_damping * dq[j]
            + jacobian[0, j] * f0
            + jacobian[1, j] * f1
            + jacobian[2, j] * f2
            + jacobian[3, j] * m0
            + jacobian[4, j] * m1
            + jacobian[5, j] * m2
        )
        out[j] = min(max(torque, -torque_limit[j]), torque_limit[j])


@njit(cache=True, error_model="numpy")
def _task_part(jacobian: Array, v0: float, v1: float, v2: float, v3: float, v4: float, v5: float) -> Six:
    """(J Jᵀ + λ)⁻¹ v by an L D Lᵀ factorisation in scalars."""
    a00 = 0.0
    a10 = a11 = 0.0
    a20 = a21 = a22 = 0.0
    a30 = a31 = a32 = a33 = 0.0
    a40 = a41 = a42 = a43 = a44 = 0.0
    a50 = a51 = a52 = a53 = a54 = a55 = 0.0
    # one loop for all sums: a loop each takes the compiler many times as long
    for k in range(jacobian.shape[1]):
        j0, j1, j2, j3, j4, j5 = (
            jacobian[0, k],
            jacobian[1, k],
            jacobian[2, k],
            jacobian[3, k],
            jacobian[4, k],
            jacobian[5, k],
        )
        a00 = a00 + j0 * j0
        a10, a11 = a10 + j1 * j0, a11 + j1 * j1
        a20, a21, a22 = a20 + j2 * j0, a21 + j2 * j1, a22 + j2 * j2
        a30, a31, a32, a33 = a30 + j3 * j0, a31 + j3 * j1, a32 + j3 * j2, a33 + j3 * j3
        a40, a41, a42, a43, a44 = a40 + j4 * j0, a41 + j4 * j1, a42 + j4 * j2, a43 + j4 * j3, a44 + j4 * j4
        a50, a51, a52, a53, a54, a55 = (
            a50 + j5 * j0,
            a51 + j5 * j1,
            a52 + j5 * j2,
            a53 + j5 * j3,
            a54 + j5 * j4,
            a55 + j5 * j5,
        )
    small = RANK * (a00 + a11 + a22 + a33 + a44 + a55) + 1e-300
    d0 = a00 + small
    l10, l20, l30, l40, l50 = a10 / d0, a20 / d0, a30 / d0, a40 / d0, a50 / d0
    d1 = a11 + small - l10 * l10 * d0
    l21 = (a21 - l20 * l10 * d0) / d1
    l31 = (a31 - l30 * l10 * d0) / d1
    l41 = (a41 - l40 * l10 * d0) / d1
    l51 = (a51 - l50 * l10 * d0) / d1
    d2 = a22 + small - l20 * l20 * d0 - l21 * l21 * d1
    l32 = (a32 - l30 * l20 * d0 - l31 * l21 * d1) / d2
    l42 = (a42 - l40 * l20 * d0 - l41 * l21 * d1) / d2
    l52 = (a52 - l50 * l20 * d0 - l51 * l21 * d1) / d2
    d3 = a33 + small - l30 * l30 * d0 - l31 * l31 * d1 - l32 * l32 * d2
    l43 = (a43 - l40 * l30 * d0 - l41 * l31 * d1 - l42 * l32 * d2) / d3
    l53 = (a53 - l50 * l30 * d0 - l51 * l31 * d1 - l52 * l32 * d2) / d3
    d4 = a44 + small - l40 * l40 * d0 - l41 * l41 * d1 - l42 * l42 * d2 - l43 * l43 * d3
    l54 = (a54 - l50 * l40 * d0 - l51 * l41 * d1 - l52 * l42 * d2 - l53 * l43 * d3) / d4
    d5 = a55 + small - l50 * l50 * d0 - l51 * l51 * d1 - l52 * l52 * d2 - l53 * l53 * d3 - l54 * l54 * d4
    y1 = v1 - l10 * v0
    y2 = v2 - l20 * v0 - l21 * y1
    y3 = v3 - l30 * v0 - l31 * y1 - l32 * y2
    y4 = v4 - l40 * v0 - l41 * y1 - l42 * y2 - l43 * y3
    y5 = (v5 - l50 * v0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4) / d5
    x4 = y4 / d4 - l54 * y5
    x3 = y3 / d3 - l43 * x4 - l53 * y5
    x2 = y2 / d2 - l32 * x3 - l42 * x4 - l52 * y5
    x1 = y1 / d1 - l21 * x2 - l31 * x3 - l41 * x4 - l51 * y5
    return v0 / d0 - l10 * x1 - l20 * x2 - l30 * x3 - l40 * x4 - l50 * y5, x1, x2, x3, x4, y5


def potential(rotation: Array, position: Array, rotation_d: Array, position_d: Array, stiffness: Array) -> float:
    """The spring's energy V [J], see the module; arguments as in `impedance_torque`."""
    delta, left = position_d - position, rotation_d @ rotation.T
    k_r = stiffness[3:, 3:]
    g = 0.5 * np.trace(k_r) * np.eye(3) - k_r
    a = 0.5 * np.array([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]])
    return float(
        0.5 * delta @ stiffness[:3, :3] @ delta + np.trace(g @ (np.eye(3) - left)) + delta @ stiffness[:3, 3:] @ a
    )
