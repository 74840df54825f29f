"""The closed loop, compiled: arm, drives, impedance controller and contact, integrated by Runge-Kutta steps of 4th
order.

The controller runs once a period and holds its torque; in between the state of arm, drives and contact advances in
finer steps. The contact's memory advances with each step; within a step every stage looks ahead from where it began.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers import impedance
from kinid.errors import KinidError
from kinid.kernels import dynamics as kernel
from kinid.kernels.cached import cached
from kinid.lab import _law as law
from kinid.lab.arm import Arm, Gains, Joints, design_damping
from kinid.lab.materials import Material

Array = NDArray[np.float64]

_dynamics, _factorise, _substitute = kernel.dynamics, kernel.factorise, kernel.substitute
_impedance_torque = impedance.impedance_torque
_WORK = kernel.WORK_COLUMNS
_contact = law.contact
_FORCE, _MEMORY, _FIELDS = law.FORCE, law.MEMORY, law.FIELDS
# rows of `joints`
_ROTOR, _SPRING, _DASHPOT, _COULOMB, _VISCOUS, _LINK_COULOMB, _LINK_VISCOUS, _LIMIT = range(8)
#: periods after which the loop says how far it is
PART = 2000


@njit(cache=True)
def _bristle(before: float, step: float, length: float) -> float:
    """Dahl's bristle after a step of its joint: −1…1."""
    sign = 1.0 if step > 0.0 else -1.0
    return float(sign + (before - sign) * np.exp(-abs(step) / length))


@njit(cache=True)
def _place(position: Array, jacobian: Array, dq: Array, axes: Array, point: Array, x: Array, v: Array) -> None:
    """Tip in the surface's axes: place along the tangents and depth, and their rates."""
    n = dq.shape[0]
    for i in range(3):
        s, r = 0.0, 0.0
        for k in range(3):
            s += axes[i, k] * (position[k] - point[k])
            speed = 0.0
            for j in range(n):
                speed += jacobian[k, j] * dq[j]
            r += axes[i, k] * speed
        x[i], v[i] = s, r
    x[2], v[2] = -x[2], -v[2]


@cached(kernel, law, impedance)
def run(
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
    joints: Array,
    elastic: bool,
    presliding: float,
    positions: Array,
    velocities: Array,
    rotations: Array,
    stiffness: Array,
    damping: Array,
    null_damping: float,
    controlled: bool,
    axes: Array,
    point: Array,
    table: Array,
    patches: NDArray[np.int64],
    fields: Array,
    grid: Array,
    period: float,
    substeps: int,
    t0: float,
    first: int,
    state: Array,
    memory: Array,
    out: Array,
) -> None:
    """Run the loop for as many periods as there are set-points.

    Args:
        turns … gravity: the arm. joints: the drives, see `Joints.packed`. elastic: whether joints bend. presliding:
        [rad]. positions, velocities, rotations: set-points, (n, 3), (n, 6), (n, 3, 3).
        stiffness, damping, null_damping: of the impedance. controlled: False switches all torques off.
        axes: rows tangent1, tangent2, normal. point: of the surface. table, patches, fields, grid: of the contact.
        period [s], substeps: of the controller, and steps within it. t0: the material's time at the beginning [s].
        first: number of the first of these periods; 0 puts drives and contact into what belongs to q and dq.
        state: joints, their speeds, those of the motors, bristles of links and motors, (6, N). memory: of the contact,
            and the work done so far [J], (MEMORY + 1,). Both are where the loop begins, and then where it ends.
        out: (n, 4 N + 10): q, dq, ddq, tau (link side); contact force, place and depth, tip
            position, work done by the contact so far.
    """
    n, steps, h = state.shape[1], positions.shape[0], period / substeps
    work, matrix, bias, hold = np.empty((n, _WORK)), np.empty((n, n)), np.empty(n), np.empty(n)
    rotation, position, jacobian = np.empty((3, 3)), np.empty(3), np.empty((6, n))
    seen_matrix, seen_bias, seen_hold = np.empty((n, n)), np.empty(n), np.empty(n)
    seen_rotation, seen_position, seen_jacobian = np.empty((3, 3)), np.empty(3), np.empty((6, n))
    q, dq, m, dm, link_z, motor_z = state[0], state[1], state[2], state[3], state[4], state[5]
    ql, vl, ml, wl = np.empty(n), np.empty(n), np.empty(n), np.empty(n)  # state of a stage
    qa, va, ma, wa = np.empty(n), np.empty(n), np.empty(n), np.empty(n)  # weighted sums of the stages' slopes
    accel, motor, torque = np.empty(n), np.empty(n), np.zeros(n)
    kept, done = memory, memory[_MEMORY]
    memory, ahead, at = kept[:_MEMORY].copy(), np.zeros(_MEMORY), np.empty(_FIELDS)
    x, v, tip, before = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    limit = joints[_LIMIT]
    _dynamics(
        q,
        dq,
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
    _place(position, jacobian, dq, axes, point, x, v)
    if first == 0:
        for j in range(n):
            m[j], dm[j] = q[j], dq[j]
            if elastic and controlled:
                m[j] += hold[j] / joints[_SPRING, j]
        memory[7] = -1.0  # no bond yet
        _contact(x, v, t0, 1e-9, memory, ahead, table, patches, fields, grid, at)
        memory, ahead = ahead, memory
    for i in range(steps):
        if controlled and elastic:
            # from the motors' side, less what gravity bends: a spring between drive and measurement would destabilise
            # (C. Ott et al., IEEE Trans. Robotics 24, 2008)
            for j in range(n):
                ql[j] = m[j] - hold[j] / joints[_SPRING, j]
            _dynamics(
                ql,
                dm,
                turns,
                shifts,
                prismatic,
                mass,
                com,
                inertia,
                gravity,
                work,
                seen_matrix,
                seen_bias,
                seen_hold,
                seen_rotation,
                seen_position,
                seen_jacobian,
            )
            _impedance_torque(
                seen_rotation,
                seen_position,
                seen_jacobian,
                dm,
                seen_hold,
                rotations[i],
                positions[i],
                velocities[i],
                stiffness,
                damping,
                null_damping,
                limit,
                torque,
            )
        elif controlled:
            _impedance_torque(
                rotation,
                position,
                jacobian,
                dq,
                hold,
                rotations[i],
                positions[i],
                velocities[i],
                stiffness,
                damping,
                null_damping,
                limit,
                torque,
            )
        row = out[i]
        for k in range(3):
            row[4 * n + k], row[4 * n + 3 + k], row[4 * n + 6 + k] = memory[_FORCE + k], x[k], position[k]
        row[4 * n + 9] = done
        for s in range(substeps):
            for j in range(n):
                qa[j] = va[j] = ma[j] = wa[j] = 0.0
                ql[j], vl[j], ml[j], wl[j] = q[j], dq[j], m[j], dm[j]
            for k in range(3):
                before[k] = position[k]
                tip[k] = memory[_FORCE + k]
            for stage in range(4):
                c = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                if stage > 0:
                    _dynamics(
                        ql,
                        vl,
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
                    _place(position, jacobian, vl, axes, point, x, v)
                    _contact(
                        x, v, t0 + (first + i) * period + s * h + c, c, memory, ahead, table, patches, fields, grid, at
                    )
                    source = ahead
                else:
                    source = memory
                f1, f2, f3 = source[_FORCE], source[_FORCE + 1], source[_FORCE + 2]
                fx = axes[0, 0] * f1 + axes[1, 0] * f2 + axes[2, 0] * f3
                fy = axes[0, 1] * f1 + axes[1, 1] * f2 + axes[2, 1] * f3
                fz = axes[0, 2] * f1 + axes[1, 2] * f2 + axes[2, 2] * f3
                for j in range(n):
                    load = jacobian[0, j] * fx + jacobian[1, j] * fy + jacobian[2, j] * fz - bias[j]
                    rub = joints[_LINK_VISCOUS, j] * vl[j]
                    if joints[_LINK_COULOMB, j] > 0.0:
                        rub += joints[_LINK_COULOMB, j] * _bristle(link_z[j], ql[j] - q[j], presliding)
                    drag = joints[_VISCOUS, j] * wl[j]
                    if joints[_COULOMB, j] > 0.0:
                        drag += joints[_COULOMB, j] * _bristle(motor_z[j], ml[j] - m[j], presliding)
                    if elastic:
                        spring = joints[_SPRING, j] * (ml[j] - ql[j]) + joints[_DASHPOT, j] * (wl[j] - vl[j])
                        accel[j] = spring + load - rub
                        motor[j] = (torque[j] - spring - drag) / joints[_ROTOR, j]
                        if stage == 0 and s == 0:
                            row[3 * n + j] = spring
                    else:
                        accel[j] = torque[j] + load - rub - drag
                        matrix[j, j] += joints[_ROTOR, j]
                        if stage == 0 and s == 0:
                            row[3 * n + j] = torque[j] - drag
                _factorise(matrix, n)
                _substitute(matrix, accel, n)
                weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
                ahead_by = h if stage == 2 else 0.5 * h
                for j in range(n):
                    if not elastic:
                        motor[j] = accel[j]
                    if stage == 0 and s == 0:
                        row[j], row[n + j], row[2 * n + j] = q[j], dq[j], accel[j]
                        if not elastic:
                            row[3 * n + j] -= joints[_ROTOR, j] * accel[j]
                    qa[j] += weight * vl[j]
                    va[j] += weight * accel[j]
                    ma[j] += weight * wl[j]
                    wa[j] += weight * motor[j]
                    if stage < 3:
                        speed, turn = vl[j], wl[j]
                        ql[j], vl[j] = q[j] + ahead_by * speed, dq[j] + ahead_by * accel[j]
                        ml[j], wl[j] = m[j] + ahead_by * turn, dm[j] + ahead_by * motor[j]
            for j in range(n):
                link_z[j] = _bristle(link_z[j], h * qa[j], presliding)
                motor_z[j] = _bristle(motor_z[j], h * ma[j], presliding)
                q[j], dq[j] = q[j] + h * qa[j], dq[j] + h * va[j]
                m[j], dm[j] = m[j] + h * ma[j], dm[j] + h * wa[j]
            _dynamics(
                q,
                dq,
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
            _place(position, jacobian, dq, axes, point, x, v)
            _contact(x, v, t0 + (first + i) * period + (s + 1) * h, h, memory, ahead, table, patches, fields, grid, at)
            for k in range(3):
                f = 0.0
                for r in range(3):
                    f += 0.5 * axes[r, k] * (tip[r] + ahead[_FORCE + r])
                done += f * (position[k] - before[k])
            memory, ahead = ahead, memory
    kept[:_MEMORY] = memory
    kept[_MEMORY] = done


@dataclass(frozen=True, eq=False)
class Motion:
    """What the loop did, one row a control period; joints in the chain's order.

    Attributes:
        t: [s], (n,). q, dq, ddq, tau: (n, N), tau on the link side of the drive.
        force: of the material on the tool, along tangent1, tangent2, normal [N], (n, 3).
        place: along both tangents, and depth [m], (n, 3). tip: base frame [m], (n, 3).
        work: that the material has done on the tool so far [J], (n,).
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array
    force: Array
    place: Array
    tip: Array
    work: Array


@dataclass(frozen=True, eq=False)
class Loop:
    """Arm, drives, controller and surface; `run` makes the experiment.

    Attributes:
        arm, joints, gains: see their classes. damping: (6, 6) of the impedance; default: designed where the motion
        begins.
        axes: rows tangent1, tangent2, normal of the surface. point: of it [m].
        substeps: integration steps a control period; 4 are stable for the elastic joints of the LWR4+.
    """

    arm: Arm
    joints: Joints
    gains: Gains = Gains()
    axes: Array = field(default_factory=lambda: np.eye(3))
    point: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1e3]))
    damping: Array | None = None
    substeps: int = 4

    def run(
        self,
        q0: Array,
        positions: Array,
        rotations: Array,
        material: Material,
        *,
        dq0: Array | None = None,
        controlled: bool = True,
        t0: float = 0.0,
        progress: Callable[[float], None] | None = None,
    ) -> Motion:
        """Follow set-points, one a control period.

        Args:
            q0: joints to begin with, (N,). positions: (n, 3) [m]. rotations: (n, 3, 3). material: touched.
            dq0: speeds to begin with; default: rest. controlled: False lets the arm go.
            t0: the material's time at the beginning [s]. progress: called with the share that is done, 0…1, now and
                then.

        Raises:
            KinidError: the loop diverged.
        """
        n, dt = self.arm.joints, self.gains.period
        damping = self.damping if self.damping is not None else design_damping(self.gains, self.arm, self.joints, q0)
        fields, patches, grid = material.raster()
        positions, rotations, velocities = (
            np.ascontiguousarray(part) for part in (positions, rotations, twists(positions, rotations, dt))
        )
        out, state, memory = np.empty((len(positions), 4 * n + 10)), np.zeros((6, n)), np.zeros(_MEMORY + 1)
        state[0], state[1] = q0, 0.0 if dq0 is None else dq0
        for first in range(0, len(out), PART):
            part = slice(first, first + PART)
            run(
                *self.arm.packed,
                self.joints.packed,
                not self.joints.rigid,
                self.joints.presliding,
                positions[part],
                velocities[part],
                rotations[part],
                self.gains.stiffness,
                np.ascontiguousarray(damping),
                self.gains.null,
                controlled,
                np.ascontiguousarray(self.axes),
                np.asarray(self.point, dtype=float),
                material.packed(),
                patches,
                fields,
                grid,
                dt,
                self.substeps,
                t0,
                first,
                state,
                memory,
                out[part],
            )
            if progress is not None:
                progress(min(1.0, (first + PART) / len(out)))
        if not np.isfinite(out).all() or np.abs(out[:, n : 2 * n]).max() > 1e3:
            raise KinidError("the virtual experiment diverged: the gains don't suit arm and material")
        q, dq, ddq, tau, rest = np.split(out, [n, 2 * n, 3 * n, 4 * n], axis=1)
        t = np.asarray(np.arange(len(out)) * dt, dtype=np.float64)
        return Motion(t, q, dq, ddq, tau, rest[:, :3], rest[:, 3:6], rest[:, 6:9], rest[:, 9])


def twists(positions: Array, rotations: Array, dt: float) -> Array:
    """Linear and angular velocity of set-points, base axes, (n, 6); central differences."""
    out = np.zeros((len(positions), 6))
    if len(positions) < 3:
        return out
    out[:, :3] = np.gradient(positions, dt, axis=0)
    spin = np.einsum("nij,nkj->nik", np.gradient(rotations, dt, axis=0), rotations)
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        out[:, 3 + k] = 0.5 * (spin[:, i, j] - spin[:, j, i])
    return out
