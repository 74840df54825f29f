"""Compiled parts of the planner: inverse kinematics with redundancy resolved, and joint torques along a motion.

A redundant arm reaches a pose with a whole curve of joint positions. Taken is the one where a cost H(q) is least:

    H(q) = −½ Σ log(1 − u²) − w log √det(J Jᵀ),   u = (q − middle)/half range,

the first part grows towards the joints' limits, the second towards singularities (Yoshikawa 1985). Where H is least,
its gradient along the null space of J is zero (extended Jacobian: Baillieul 1985); so joints are a smooth function of
the pose, and a path that comes back brings every joint back, unlike the velocity-level null-space gradient (Liégeois
1977), whose limit for an infinitely quick descent this is. An arm without redundancy has nothing to choose, and H is
not asked.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels import dynamics
from kinid.kernels.cached import cached
from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

_dynamics, _factorise, _substitute = dynamics.dynamics, dynamics.factorise, dynamics.substitute
_WORK = dynamics.WORK_COLUMNS

#: how a pose ended: reached, not reached, reached beyond a joint's limits
REACHED, MISSED, BEYOND = 0, 1, 2


@kernel
def _inverse(jacobian: Array, out: Array) -> float:
    """Damped right inverse of J (6, N) into `out` (N, 6); the product of the pivots √det(J Jᵀ) comes back."""
    n = jacobian.shape[1]
    gram = np.empty((6, 6))
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += jacobian[i, k] * jacobian[j, k]
            gram[i, j] = total
            gram[j, i] = total
        gram[i, i] += 1e-14
    _factorise(gram, 6)
    volume = 1.0
    for i in range(6):
        volume *= gram[i, i]
    x = np.empty(6)
    for k in range(n):
        for i in range(6):
            x[i] = jacobian[i, k]
        _substitute(gram, x, 6)
        for i in range(6):
            out[k, i] = x[i]
    return volume


@kernel
def _slope(q: Array, jacobian: Array, inverse: Array, middle: Array, half: Array, weight: float, out: Array) -> None:
    """Gradient of H by the joints, brought into the null space of J, into `out` (N,).

    ∂J of joint i by q_j in base axes: ω_j × J_i for the part of a joint j before i, ω_i × v_j where j comes after.
    """
    n = q.shape[0]
    raw = np.empty(n)
    for j in range(n):
        u = (q[j] - middle[j]) / half[j]
        raw[j] = u / max(1e-6, 1.0 - u * u) / half[j]
        total = 0.0
        for i in range(n):
            if j <= i:
                a0, a1, a2 = jacobian[3, j], jacobian[4, j], jacobian[5, j]
                b0, b1, b2 = jacobian[0, i], jacobian[1, i], jacobian[2, i]
            else:
                a0, a1, a2 = jacobian[3, i], jacobian[4, i], jacobian[5, i]
                b0, b1, b2 = jacobian[0, j], jacobian[1, j], jacobian[2, j]
            total += (
                inverse[i, 0] * (a1 * b2 - a2 * b1)
                + inverse[i, 1] * (a2 * b0 - a0 * b2)
                + inverse[i, 2] * (a0 * b1 - a1 * b0)
            )
            if j < i:
                b0, b1, b2 = jacobian[3, i], jacobian[4, i], jacobian[5, i]
                total += (
                    inverse[i, 3] * (a1 * b2 - a2 * b1)
                    + inverse[i, 4] * (a2 * b0 - a0 * b2)
                    + inverse[i, 5] * (a0 * b1 - a1 * b0)
                )
        raw[j] -= weight * total
    task = jacobian @ raw
    for j in range(n):
        out[j] = raw[j]
        for i in range(6):
            out[j] -= inverse[j, i] * task[i]


# one long function: its scratch arrays are shared by all that it does with a pose
@cached(dynamics)
def solve_poses(
    q: Array,
    positions: Array,
    rotations: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
    lower: Array,
    upper: Array,
    weight: float,
    patience: int,
    out: Array,
    cost: Array,
) -> tuple[int, int]:
    """Joints for each pose in turn, each search begun at the one before; how it ended, and the row where it did.

    Args:
        q: where the first search begins, chain order, (N,). positions: base frame [m], (n, 3). rotations: (n, 3, 3).
        turns … gravity: the arm, see `kinid.kernels.dynamics.dynamics`. lower, upper: limits of the joints, (N,).
        weight: of the singularity against the limits. patience: most steps a pose.
        out: joints, (n, N). cost: H at each pose, (n,).
    """
    n, joints = positions.shape[0], q.shape[0]
    still, work = np.zeros(joints), np.empty((joints, _WORK))
    matrix, bias, hold = np.empty((joints, joints)), np.empty(joints), np.empty(joints)
    rotation, position, jacobian = np.empty((3, 3)), np.empty(3), np.empty((6, joints))
    inverse, other, error = np.empty((joints, 6)), np.empty((joints, 6)), np.empty(6)
    slope, ahead, behind, step = np.empty(joints), np.empty(joints), np.empty(joints), np.empty(joints)
    middle, half = np.zeros(joints), np.full(joints, 1e6)
    for j in range(joints):
        if np.isfinite(lower[j]) and np.isfinite(upper[j]):
            middle[j], half[j] = 0.5 * (lower[j] + upper[j]), 0.5 * (upper[j] - lower[j])
    x = q.copy()
    for row in range(n):
        reached = False
        if row > 1:  # the path goes on as it came
            for j in range(joints):
                x[j] = 2.0 * out[row - 1, j] - out[row - 2, j]
        for _ in range(patience):
            _dynamics(
                x,
                still,
                turns,
                shifts,
                prismatic,
                mass,
                com,
                inertia,
                gravity,
                work,
                matrix,
                bias,
                hold,
                rotation,
                position,
                jacobian,
            )
            volume = _inverse(jacobian, inverse)
            for i in range(3):
                error[i] = positions[row, i] - position[i]
            # rotation still to go, base axes: half the skew part gives its sine, the trace its cosine
            trace, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                trace += (
                    rotations[row, 0, k] * rotation[0, k]
                    + rotations[row, 1, k] * rotation[1, k]
                    + rotations[row, 2, k] * rotation[2, k]
                )
                s0 += rotations[row, 2, k] * rotation[1, k] - rotations[row, 1, k] * rotation[2, k]
                s1 += rotations[row, 0, k] * rotation[2, k] - rotations[row, 2, k] * rotation[0, k]
                s2 += rotations[row, 1, k] * rotation[0, k] - rotations[row, 0, k] * rotation[1, k]
            sine = 0.5 * np.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
            angle = np.arctan2(sine, 0.5 * (trace - 1.0))
            factor = 0.5 if sine < 1e-9 else 0.5 * angle / sine
            if sine < 1e-9 and angle > 3.0:  # half a turn has no direction of its own
                s0, s1, s2, factor = 1.0, 0.0, 0.0, 1.0
            error[3], error[4], error[5] = factor * s0, factor * s1, factor * s2
            far = 0.0
            for i in range(6):
                far = max(far, abs(error[i]))
            size = 0.0
            along = 0.0
            if joints > 6:
                _slope(x, jacobian, inverse, middle, half, weight, slope)
                for j in range(joints):
                    size += slope[j] * slope[j]
                size = np.sqrt(size)
            # a slope this small is a step below 1e-10 rad, as curvatures of H are of order one
            if size > 1e-11 and far < 0.05:
                h = 1e-5
                curvature = 0.0
                for side in range(2):
                    for j in range(joints):
                        step[j] = x[j] + (h if side == 0 else -h) * slope[j] / size
                    _dynamics(
                        step,
                        still,
                        turns,
                        shifts,
                        prismatic,
                        mass,
                        com,
                        inertia,
                        gravity,
                        work,
                        matrix,
                        bias,
                        hold,
                        rotation,
                        position,
                        jacobian,
                    )
                    _inverse(jacobian, other)
                    _slope(step, jacobian, other, middle, half, weight, ahead if side == 0 else behind)
                for j in range(joints):
                    curvature += slope[j] / size * (ahead[j] - behind[j]) / (2.0 * h)
                along = size / curvature if curvature > 0.05 else min(0.1, 2.0 * size)
                along = min(along, 0.15)
            if far < 1e-11 and along < 1e-9:
                reached = True
                break
            largest = 0.0
            for j in range(joints):
                step[j] = 0.0
                for i in range(6):
                    step[j] += inverse[j, i] * error[i]
                if along > 0.0:
                    step[j] -= along * slope[j] / size
                largest = max(largest, abs(step[j]))
            short = min(1.0, 0.3 / max(largest, 1e-12))
            for j in range(joints):
                x[j] += short * step[j]
                if half[j] < 1e5 and row == 0:  # a search from afar stays where H is finite
                    x[j] = min(max(x[j], middle[j] - 0.999 * half[j]), middle[j] + 0.999 * half[j])
        if not reached:
            return MISSED, row
        cost[row] = -weight * np.log(max(volume, 1e-300))
        for j in range(joints):
            out[row, j] = x[j]
            u = (x[j] - middle[j]) / half[j]
            if u <= -1.0 or u >= 1.0:
                return BEYOND, row
            cost[row] -= 0.5 * np.log(1.0 - u * u)
    return REACHED, n


@cached(dynamics)
def torques(
    q: Array,
    dq: Array,
    ddq: Array,
    force: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
    out: Array,
) -> None:
    """τ = M q̈ + bias − Jᵀ f for each row, chain order, into `out` (n, N); f acts on the tip, base axes [N], (n, 3)."""
    n, joints = q.shape
    work, matrix = np.empty((joints, _WORK)), np.empty((joints, joints))
    bias, hold = np.empty(joints), np.empty(joints)
    rotation, position, jacobian = np.empty((3, 3)), np.empty(3), np.empty((6, joints))
    for row in range(n):
        _dynamics(
            q[row],
            dq[row],
            turns,
            shifts,
            prismatic,
            mass,
            com,
            inertia,
            gravity,
            work,
            matrix,
            bias,
            hold,
            rotation,
            position,
            jacobian,
        )
        for j in range(joints):
            total = bias[j]
            for k in range(joints):
                total += matrix[j, k] * ddq[row, k]
            for k in range(3):
                total -= jacobian[k, j] * force[row, k]
            out[row, j] = total
