"""The closed loop, compiled: arm, drives, impedance controller and contact, integrated by Runge-Kutta steps of 4th
order.

The controller runs once a period and holds its torque; in between the state of arm, drives and contact advances in
finer steps. The contact's memory advances with each step; within a step every stage looks ahead from where it began.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers import impedance
from kinid.kernels import dynamics as kernel
from kinid.kernels.cached import cached
from kinid.lab import _law as law
from kinid.lab.arm import Arm, State

Array = NDArray[np.float64]

_dynamics, _factorise, _substitute = kernel.dynamics, kernel.factorise, kernel.substitute
_impedance_torque = impedance.impedance_torque
_contact = law.contact
_FORCE, _MEMORY, _BOND = law.FORCE, law.MEMORY, law.BOND
# rows of `joints`
_ROTOR, _SPRING, _DASHPOT, _COULOMB, _VISCOUS, _LINK_COULOMB, _LINK_VISCOUS, LIMIT = range(8)
# rows of the state: joints [rad], their speeds, motors, their speeds; bristles of links and motors
Q, DQ, _MOTOR, _DMOTOR, _LINK_BRISTLE, _MOTOR_BRISTLE = range(6)


class SetPoints(NamedTuple):
    """Of the tip, one a control period: [m], (n, 3); linear and angular velocity, (n, 6); and (n, 3, 3)."""

    positions: Array
    velocities: Array
    rotations: Array


class Body(NamedTuple):
    """An arm's state, and all that `dynamics` takes after q and dq to fill it."""

    state: State
    arguments: tuple[NDArray[np.generic], ...]

    @classmethod
    def of(cls, arm: Arm) -> Body:
        """With room of its own."""
        state = State.empty(arm.joints)
        return cls(state, (*arm.packed, *state))


class Controller(NamedTuple):
    """Its torque, and what `impedance_torque` takes at its end: stiffness, damping (two), limit, and that torque."""

    torque: Array
    values: tuple[Array, Array, float, Array, Array]


class Drives(NamedTuple):
    """See `Joints`: its table, (8, N), whether joints bend, and the angle of presliding [rad]."""

    joints: Array
    elastic: bool
    presliding: float


class Surface(NamedTuple):
    """Rows tangent1, tangent2, normal; a point of it [m]; and its material, as `law.contact` takes it at the end."""

    axes: Array
    point: Array
    material: tuple[Array, NDArray[np.int64], Array, Array, Array]


class Steps(NamedTuple):
    """Scratch of a step of the integration: the state of a stage, its slope, the slopes' weighted sum, each (4, N).

    And torques of the drives, (N,), place on the surface and its rate, (3,), tip and contact force before a step, (3,).
    """

    stage: Array
    slope: Array
    total: Array
    drive: Array
    x: Array
    v: Array
    tip: Array
    force: Array

    @classmethod
    def empty(cls, n: int) -> Steps:
        """Room for n joints."""
        shapes = ((4, n), (4, n), (4, n), (n,), (3,), (3,), (3,), (3,))
        return cls(*(np.empty(shape) for shape in shapes))


# What calls compiled functions of other files isn't kept on disk by itself: it would not notice an edit there. It is
# compiled into `run`, whose cache is named after all sources.


@njit(error_model="numpy")
def _bristle(before: float, step: float, length: float) -> float:
    """Dahl's bristle after a step of its joint: −1…1."""
    sign = 1.0 if step > 0.0 else -1.0
    return float(sign + (before - sign) * np.exp(-abs(step) / length))


@njit(error_model="numpy")
def _move(q: Array, dq: Array, body: Body, surface: Surface, x: Array, v: Array) -> None:
    """Dynamics at a state; tip in the surface's axes, x: place along the tangents and depth, v: their rates."""
    _dynamics(q, dq, *body.arguments)
    axes, position, jacobian = surface.axes, body.state.position, body.state.jacobian
    for i in range(3):
        s, r = 0.0, 0.0
        for k in range(3):
            s += axes[i, k] * (position[k] - surface.point[k])
            speed = 0.0
            for j in range(len(dq)):
                speed += jacobian[k, j] * dq[j]
            r += axes[i, k] * speed
        x[i], v[i] = s, r
    x[2], v[2] = -x[2], -v[2]


@njit(error_model="numpy")
def _command(state: State, dq: Array, targets: SetPoints, i: int, controller: Controller) -> None:
    """The controller's torque at a state and a set-point, into its room for it."""
    rotation, position, jacobian = state.rotation, state.position, state.jacobian
    target = targets.rotations[i], targets.positions[i], targets.velocities[i]
    _impedance_torque(rotation, position, jacobian, dq, state.gravity, *(target + controller.values))


@njit(error_model="numpy")
def _slopes(rows: Array, force: Array, torque: Array, drives: Drives, state: State, axes: Array, work: Steps) -> None:
    """Accelerations of joints and motors at a stage, into its slope; torques on the link side, into `drive`.

    Args:
        rows: where the step began, (6, N). force: of the contact, along the surface's axes. torque: of the motors.
    """
    n, joints, elastic, stage = len(torque), drives.joints, drives.elastic, work.stage
    matrix, jacobian, accel, motor, drive = state.mass, state.jacobian, work.slope[1], work.slope[3], work.drive
    f1, f2, f3 = force[0], force[1], force[2]
    fx = axes[0, 0] * f1 + axes[1, 0] * f2 + axes[2, 0] * f3
    fy = axes[0, 1] * f1 + axes[1, 1] * f2 + axes[2, 1] * f3
    fz = axes[0, 2] * f1 + axes[1, 2] * f2 + axes[2, 2] * f3
    for j in range(n):
        q, dq, m, dm = stage[0, j], stage[1, j], stage[2, j], stage[3, j]
        load = jacobian[0, j] * fx + jacobian[1, j] * fy + jacobian[2, j] * fz - state.bias[j]
        rub = joints[_LINK_VISCOUS, j] * dq
        if joints[_LINK_COULOMB, j] > 0.0:
            bristle = _bristle(rows[_LINK_BRISTLE, j], q - rows[Q, j], drives.presliding)
            rub += joints[_LINK_COULOMB, j] * bristle
        drag = joints[_VISCOUS, j] * dm
        if joints[_COULOMB, j] > 0.0:
            bristle = _bristle(rows[_MOTOR_BRISTLE, j], m - rows[_MOTOR, j], drives.presliding)
            drag += joints[_COULOMB, j] * bristle
        if elastic:
            drive[j] = joints[_SPRING, j] * (m - q) + joints[_DASHPOT, j] * (dm - dq)
            accel[j] = drive[j] + load - rub
            motor[j] = (torque[j] - drive[j] - drag) / joints[_ROTOR, j]
        else:
            drive[j] = torque[j] - drag
            accel[j] = torque[j] + load - rub - drag
            matrix[j, j] += joints[_ROTOR, j]
    _factorise(matrix, n)
    _substitute(matrix, accel, n)
    for j in range(n):
        work.slope[0, j], work.slope[2, j] = stage[1, j], stage[3, j]
        if not elastic:
            motor[j] = accel[j]
            drive[j] -= joints[_ROTOR, j] * accel[j]


@njit(error_model="numpy")
def _begin(rows: Array, memory: Array, state: State, work: Steps) -> None:
    """Where a step begins: tip and contact force, the first stage, and no slopes yet."""
    for k in range(3):
        work.tip[k], work.force[k] = state.position[k], memory[_FORCE + k]
    for k in range(4):
        for j in range(rows.shape[1]):
            work.total[k, j], work.stage[k, j] = 0.0, rows[k, j]


@njit(error_model="numpy")
def _record(rows: Array, work: Steps, row: Array) -> None:
    """q, dq, ddq and tau of a step's beginning, into a row of what is logged."""
    n = rows.shape[1]
    for j in range(n):
        row[j], row[n + j], row[2 * n + j], row[3 * n + j] = rows[Q, j], rows[DQ, j], work.slope[1, j], work.drive[j]


@njit(error_model="numpy")
def _step(
    rows: Array,
    torque: Array,
    t: float,
    h: float,
    drives: Drives,
    body: Body,
    surface: Surface,
    memory: Array,
    ahead: Array,
    work: Steps,
    row: Array,
) -> float:
    """One step of the integration, h [s] from t [s]; the work that the contact did meanwhile [J].

    Args:
        rows: state of the loop, (6, N), moved on. torque: of the motors. body: there, and then where the step ends.
        memory: of the contact, unchanged. ahead: at the step's end.
        row: gets q, dq, ddq and tau of the step's beginning; without room for them nothing.
    """
    n, state, force, tip = len(torque), body.state, work.force, work.tip
    _begin(rows, memory, state, work)
    for stage in range(4):
        pushed = force
        if stage > 0:
            after = h if stage == 3 else 0.5 * h
            _move(work.stage[0], work.stage[1], body, surface, work.x, work.v)
            _contact(work.x, work.v, t + after, after, memory, ahead, *surface.material)
            pushed = ahead[_FORCE : _FORCE + 3]
        _slopes(rows, pushed, torque, drives, state, surface.axes, work)
        if stage == 0 and len(row) > 0:
            _record(rows, work, row)
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        by = h if stage == 2 else 0.5 * h
        for k in range(4):
            for j in range(n):
                work.total[k, j] += weight * work.slope[k, j]
                work.stage[k, j] = rows[k, j] + by * work.slope[k, j]
    for j in range(n):
        rows[_LINK_BRISTLE, j] = _bristle(rows[_LINK_BRISTLE, j], h * work.total[0, j], drives.presliding)
        rows[_MOTOR_BRISTLE, j] = _bristle(rows[_MOTOR_BRISTLE, j], h * work.total[2, j], drives.presliding)
        for k in range(4):
            rows[k, j] += h * work.total[k, j]
    _move(rows[Q], rows[DQ], body, surface, work.x, work.v)
    _contact(work.x, work.v, t + h, h, memory, ahead, *surface.material)
    done = 0.0
    for k in range(3):
        f = 0.0
        for r in range(3):
            f += 0.5 * surface.axes[r, k] * (force[r] + ahead[_FORCE + r])
        done += f * (state.position[k] - tip[k])
    return done


@cached(kernel, law, impedance)
def run(
    body: Body,
    seen: Body,
    drives: Drives,
    controller: Controller,
    controlled: bool,
    surface: Surface,
    period: float,
    substeps: int,
    t0: float,
    rows: Array,
    memory: Array,
    work: Steps,
    first: int,
    targets: SetPoints,
    out: Array,
) -> None:
    """Run the loop for as many periods as there are set-points.

    Args:
        body: the arm. seen: the arm as the motors see it. controlled: False switches all torques off.
        period [s], substeps: of the controller, and steps within it. t0: the material's time at the beginning [s].
        rows: see `Q` and its like, (6, N). memory: of the contact, and the work done so far [J], (MEMORY + 1,). Both
            are where the loop begins, and then where it ends. work: scratch of a step.
        first: number of the first of these periods; 0 puts drives and contact into what belongs to q and dq.
        out: (n, 4 N + 10): q, dq, ddq, tau (link side); contact force, place and depth, tip position, work done by the
            contact so far.
    """
    n, h, joints, elastic = rows.shape[1], period / substeps, drives.joints, drives.elastic
    state, kept, done, x = body.state, memory, memory[_MEMORY], work.x
    memory, ahead, nothing = kept[:_MEMORY].copy(), np.zeros(_MEMORY), np.empty(0)
    _move(rows[Q], rows[DQ], body, surface, x, work.v)
    if first == 0:
        for j in range(n):
            bent = state.gravity[j] / joints[_SPRING, j] if elastic and controlled else 0.0
            rows[_MOTOR, j], rows[_DMOTOR, j] = rows[Q, j] + bent, rows[DQ, j]
        memory[_BOND] = -1.0  # no bond yet
        _contact(x, work.v, t0, 1e-9, memory, ahead, *surface.material)
        memory, ahead = ahead, memory
    for i in range(targets.positions.shape[0]):
        if controlled and elastic:
            # from the motors' side, less what gravity bends: a spring between drive and measurement would destabilise
            # (C. Ott et al., IEEE Trans. Robotics 24, 2008)
            for j in range(n):
                work.stage[0, j] = rows[_MOTOR, j] - state.gravity[j] / joints[_SPRING, j]
            _dynamics(work.stage[0], rows[_DMOTOR], *seen.arguments)
            _command(seen.state, rows[_DMOTOR], targets, i, controller)
        elif controlled:
            _command(state, rows[DQ], targets, i, controller)
        rest = out[i, 4 * n :]
        for k in range(3):
            rest[k], rest[3 + k], rest[6 + k] = memory[_FORCE + k], x[k], state.position[k]
        rest[9] = done
        for s in range(substeps):
            t = t0 + (first + i) * period + s * h
            row = out[i] if s == 0 else nothing
            done += _step(rows, controller.torque, t, h, drives, body, surface, memory, ahead, work, row)
            memory, ahead = ahead, memory
    for k in range(_MEMORY):
        kept[k] = memory[k]
    kept[_MEMORY] = done
