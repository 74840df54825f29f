"""The laboratory's arm: inertias packed for the compiled loop, joints with friction and elasticity, poses along a
path.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import expm

from kinid.controllers import gains as cartesian_gains
from kinid.data.rig import ToolSpec
from kinid.errors import InputError
from kinid.kernels import dynamics as kernel
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm with its tool, packed for `kinid.kernels.dynamics.dynamics`; N joints in the chain's order.

    Attributes:
        turns, shifts, prismatic: the chain to the tip, see `kinid.robotics.robot.Chain`.
        mass [kg], com [m], inertia [kg·m²]: of each link, (N,), (N, 3), (N, 9). gravity: base axes [m/s²], (3,).
        columns: for each joint its column in a log, (N,).
    """

    turns: Array
    shifts: Array
    prismatic: NDArray[np.bool_]
    mass: Array
    com: Array
    inertia: Array
    gravity: Array
    columns: NDArray[np.int64]

    @classmethod
    def pack(cls, robot: Robot, tool: ToolSpec | None = None, frame: str | None = None) -> Arm:
        """The arm of a robot, carrying a tool at its sensor frame.

        Args:
            robot: a serial arm. tool: everything beyond the sensor. frame: the tip; default: the robot's.

        Raises:
            InputError: no tip frame, or joints that don't lie between base and tip.
        """
        frame = frame or robot.tip_frame
        if frame is None:
            raise InputError(f"{robot.name} without a tip frame", "the point that touches", "name [robot] tip_frame")
        carrying = robot if tool is None or tool.mass == 0.0 else robot.with_tool(tool)
        chain = robot.chain(frame)
        return cls(
            chain.turns,
            chain.shifts,
            chain.prismatic,
            *carrying.bodies(frame),
            np.asarray(robot.gravity, dtype=float).copy(),
            chain.columns,
        )

    @property
    def joints(self) -> int:
        """N."""
        return len(self.mass)

    @property
    def packed(self) -> tuple[NDArray[np.generic], ...]:
        """The arguments that every kernel takes after the state."""
        return (self.turns, self.shifts, self.prismatic, self.mass, self.com, self.inertia, self.gravity)

    def moved_tip(self, offset: Array) -> Arm:
        """The same arm whose tip is displaced by an offset in the tip's axes [m]."""
        shifts = self.shifts.copy()
        shifts[-1] += self.turns[-1].reshape(3, 3) @ offset
        return dataclasses.replace(self, shifts=shifts)

    def state(self, q: Array, dq: Array | None = None) -> State:
        """Dynamics and tip kinematics at one state."""
        out = State.empty(self.joints)
        speed = np.zeros(self.joints) if dq is None else np.ascontiguousarray(dq, dtype=float)
        kernel.dynamics(np.ascontiguousarray(q, dtype=float), speed, *self.packed, *out)
        return out

    def energy(self, q: Array, dq: Array) -> float:
        """Kinetic and potential energy [J]."""
        return float(kernel.energy(np.ascontiguousarray(q), np.ascontiguousarray(dq), *self.packed))


class State(NamedTuple):
    """M (N, N), bias and gravity torque (N,), tip rotation (3, 3), position (3,) and Jacobian (6, N), base axes.

    In the order of `kinid.kernels.dynamics.dynamics`, after the scratch in which it works.
    """

    work: Array
    mass: Array
    bias: Array
    gravity: Array
    rotation: Array
    position: Array
    jacobian: Array

    @classmethod
    def empty(cls, n: int) -> State:
        """Room for the state of an arm of n joints."""
        shapes = ((n, kernel.WORK_COLUMNS), (n, n), (n,), (n,), (3, 3), (3,), (6, n))
        return cls(*(np.empty(shape) for shape in shapes))


@dataclass(frozen=True, eq=False)
class Joints:
    """Drives: per joint (N,), seen at the link. The torque loop inside the drive makes the rotor look lighter.

    That loop feeds the measured joint torque back (A. Albu-Schäffer, C. Ott, G. Hirzinger, Int. J. Robotics Research
    26, 2007): inertia and friction of the motor both shrink to 1/shaping.

    Attributes:
        rotor_inertia: reflected [kg·m²]. shaping: ≥ 1.
        stiffness: of the gear and torque sensor [N·m/rad]; 0 is a rigid joint. damping: beside it [N·m·s/rad].
        motor_coulomb [N·m], motor_viscous [N·m·s/rad]: before the torque sensor. link_coulomb, link_viscous: behind it.
        compensation: share of the motor's friction that the drive's friction observer takes away (L. Le Tien, A.
            Albu-Schäffer, A. De Luca, G. Hirzinger, IROS 2008).
        presliding: angle over which Coulomb friction turns around [rad].
        torque_limit: of the motor [N·m].
    """

    rotor_inertia: Array
    stiffness: Array
    damping: Array
    motor_coulomb: Array
    motor_viscous: Array
    link_coulomb: Array
    link_viscous: Array
    torque_limit: Array
    shaping: float = 6.0
    compensation: float = 0.8
    presliding: float = 2e-4

    @classmethod
    def ideal(cls, n: int, torque_limit: float = 1e6) -> Joints:
        """Rigid, without friction and rotors."""
        zero = np.zeros(n)
        return cls(zero, zero, zero, zero, zero, zero, zero, np.full(n, torque_limit), 1.0)

    @property
    def packed(self) -> Array:
        """For the loop, (8, N): inertia, stiffness, damping, friction of motor and link as they act, torque limit."""
        s, left = self.shaping, (1.0 - self.compensation) / self.shaping
        return np.ascontiguousarray(
            [
                self.rotor_inertia / s,
                self.stiffness,
                self.damping,
                left * self.motor_coulomb,
                left * self.motor_viscous,
                self.link_coulomb,
                self.link_viscous,
                self.torque_limit,
            ]
        )

    @property
    def rigid(self) -> bool:
        """Whether no joint bends."""
        return not self.stiffness.any()


def lwr4plus_joints(elastic: bool = True, friction: bool = True) -> Joints:
    """Drives of the LWR4+: Jubien, Gautier & Janot (IFAC WC 2014) as quoted in public models; link side of that order.

    Args:
        elastic: joints bend. friction: joints rub.
    """
    one, f = np.ones(7), 1.0 if friction else 0.0
    return Joints(
        rotor_inertia=2.25 * one,
        stiffness=np.array([1e4, 1e4, 1e4, 1e4, 1e4, 7.5e3, 7.5e3]) * (1.0 if elastic else 0.0),
        damping=np.array([8.0, 8.0, 4.0, 4.0, 2.0, 1.0, 0.5]) * (1.0 if elastic else 0.0),
        motor_coulomb=f * np.array([11.9, 11.5, 8.98, 8.35, 8.31, 4.72, 6.04]),
        motor_viscous=f * np.array([14.4, 15.3, 6.55, 11.0, 4.29, 2.26, 1.60]),
        link_coulomb=f * np.array([0.5, 0.5, 0.4, 0.4, 0.2, 0.1, 0.05]),
        link_viscous=f * np.array([0.5, 0.5, 0.4, 0.4, 0.3, 0.2, 0.1]),
        torque_limit=np.array([176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0]),
    )


@dataclass(frozen=True, eq=False)
class Gains:
    """Cartesian impedance of the controller, base axes.

    Attributes:
        translation [N/m], rotation [N·m/rad]: the same along all axes. ratio: of damping. null: damping of joint
            motions that leave the tip where it is [N·m·s/rad].
        period: of the controller [s].
    """

    translation: float = 5200.0
    rotation: float = 300.0
    ratio: float = 0.7
    null: float = 6.0
    period: float = field(default=1e-3)

    @property
    def stiffness(self) -> Array:
        """(6, 6)."""
        return np.diag([self.translation] * 3 + [self.rotation] * 3)


def design_damping(gains: Gains, arm: Arm, joints: Joints, q: Array) -> Array:
    """Damping (6, 6) that gives every mode of stiffness and task-space inertia the ratio of the gains, at a pose."""
    state = arm.state(q)
    inertia = state.mass + np.diag(joints.packed[0])
    mobility = state.jacobian @ np.linalg.solve(inertia, state.jacobian.T) + 1e-9 * np.eye(6)
    task = np.asarray(np.linalg.inv(mobility), dtype=np.float64)
    return cartesian_gains.design_damping(gains.stiffness, task, gains.ratio)


class Sampled(NamedTuple):
    """Arm and sampled impedance over one period, linearised at a pose: x⁺ = closed x + driven τ.

    x holds angles and speeds of the links, and of the motors where joints are elastic; τ is what the drives do beside
    the impedance [N·m].
    """

    closed: Array
    driven: Array


def sampled(
    gains: Gains,
    damping: Array,
    arm: Arm,
    joints: Joints,
    q: Array,
    *,
    push: Array | float = 0.0,
    drag: Array | float = 0.0,
    motor_drag: Array | float = 0.0,
) -> Sampled:
    """Linearise arm and controller.

    Args:
        gains, damping: of the impedance, (6, 6). q: the pose, in the chain's order.
        push, drag: torques on the links per radian and per rad/s beside the arm's own, (N, N); motor_drag: on the
            motors of elastic joints per rad/s.
    """
    state = arm.state(q)
    n, rotor, stiffness, d = arm.joints, *joints.packed[:3]
    jt = state.jacobian.T
    position = -jt @ gains.stiffness @ state.jacobian
    pinv = np.linalg.pinv(state.jacobian)
    null = np.eye(n) - pinv @ state.jacobian
    speed = -jt @ damping @ state.jacobian - gains.null * null.T @ null
    zero, eye = np.zeros((n, n)), np.eye(n)
    if joints.rigid:
        inverse = np.linalg.inv(state.mass + np.diag(rotor))
        a = np.block([[zero, eye], [-inverse @ (zero + push), -inverse @ (zero + drag)]])
        b = np.vstack([zero, inverse])
        feedback = np.hstack([position, speed])
    else:
        link, motor, k, c = np.linalg.inv(state.mass), np.diag(1.0 / rotor), np.diag(stiffness), np.diag(d)
        a = np.block(
            [
                [zero, eye, zero, zero],
                [-link @ (k + push), -link @ (c + drag), link @ k, link @ c],
                [zero, zero, zero, eye],
                [motor @ k, motor @ c, -motor @ k, -motor @ (c + motor_drag)],
            ]
        )
        b = np.vstack([zero, zero, zero, motor])
        feedback = np.hstack([zero, zero, position, speed])  # measured on the motors' side
    size = a.shape[0]
    held = expm(np.block([[a, b], [np.zeros((n, size + n))]]) * gains.period)
    return Sampled(held[:size, :size] + held[:size, size:] @ feedback, held[:size, size:])


def spectral_radius(gains: Gains, damping: Array, arm: Arm, joints: Joints, q: Array) -> float:
    """Largest eigenvalue, in size, of arm and sampled controller over one period, linearised at a pose; > 1 is
    unstable.
    """
    return float(np.abs(np.linalg.eigvals(sampled(gains, damping, arm, joints, q).closed)).max())


def joints_along(robot: Robot, positions: Array, rotations: Array, start: Array, what: str = "the path") -> Array:
    """Joints that put the tip at each pose in turn; damped Newton's method, each from the one before, (n, N) in log
    order.

    Args:
        robot: with a tip frame. positions: base frame [m], (n, 3). rotations: (n, 3, 3). start: a pose nearby, (N,).
        what: is asked for, for the message.

    Raises:
        InputError: a pose out of reach, or one that needs a joint beyond its limits.
    """
    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId(robot.tip_frame)
    q, out = np.asarray(start, dtype=float).copy(), np.empty((len(positions), robot.joint_count))
    for i, (position, rotation) in enumerate(zip(positions, rotations)):
        goal = pin.SE3(rotation, position)
        for _ in range(100):
            pin.computeJointJacobians(model, data, robot.configuration(q)[0])
            pin.updateFramePlacement(model, data, frame)
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            error = pin.log6(data.oMf[frame].actInv(goal)).vector
            if np.abs(error).max() < 1e-11:
                break
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-9 * np.eye(6), error)
            step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
            q = q + robot.from_tangent(step[None, :])[0]
        else:
            raise InputError(
                f"{what} through ({', '.join(f'{v:.3f}' for v in position)}) m, which {robot.name} can't reach",
                "poses within the arm's reach",
                "move the surface nearer, or make the motion smaller",
            )
        outside = np.flatnonzero((q < robot.lower) | (q > robot.upper))
        if len(outside):
            j = int(outside[0])
            raise InputError(
                f"{what}, which needs {robot.joint_names[j]} at {q[j]:.3f} (limits {robot.lower[j]:.3f}, "
                f"{robot.upper[j]:.3f})",
                "joints within their limits",
                "move the surface, or make the motion smaller",
            )
        out[i] = q
    return out
