"""What a controller sees: an arm's dynamics and its tip's kinematics at one instant, and where the tip shall be."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import numbers
from kinid.errors import InputError
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: the tip's least mobility below which, as a share of its greatest, a pose is singular
DAMPED = 1e-7


@dataclass(frozen=True, eq=False)
class ArmState:
    """One state of an arm, joints in the log's order; make one with `ArmState.of`, or from a simulation's own arrays.

    Attributes:
        dq: (N,) [rad/s]. rotation, position: of the tip, (3, 3), (3,) [m].
        jacobian: of the tip, rows linear, angular, base axes, (6, N). drift: J̇ q̇, (6,) [m/s², rad/s²].
        mass: M, (N, N). bias: Coriolis, centrifugal and gravity torque, (N,) [N·m]. gravity: gravity's part, (N,).
        wrench: of the environment on the tip, at the tip, force then moment, base axes, (6,); 0 where not measured.

    Raises:
        InputError: an array of another shape, or with numbers that aren't finite: a torque made of them would be, too.
    """

    dq: Array
    rotation: Array
    position: Array
    jacobian: Array
    drift: Array
    mass: Array
    bias: Array
    gravity: Array
    wrench: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        n = np.size(self.dq)
        shapes = {
            "dq": (n,),
            "rotation": (3, 3),
            "position": (3,),
            "jacobian": (6, n),
            "drift": (6,),
            "mass": (n, n),
            "bias": (n,),
            "gravity": (n,),
            "wrench": (6,),
        }
        for name, shape in shapes.items():
            values = numbers(
                getattr(self, name), shape, f"a state's {name}", "check what the arm or its driver reports"
            )
            object.__setattr__(self, name, values)

    @classmethod
    def of(
        cls, robot: Robot, q: Array, dq: Array | None = None, wrench: Array | None = None, rotor: Array | None = None
    ) -> ArmState:
        """The state of a robot at joint positions (N,) and velocities (N,).

        Args:
            robot: with a tip frame. q, dq: in the log's order. wrench: of the environment, (6,).
            rotor: the drives' inertias, reflected to the joints, which a URDF leaves out, (N,) [kg·m²].

        Raises:
            InputError: no tip frame, or joints that aren't as many finite numbers as the robot has.
        """
        import pinocchio as pin

        if robot.tip_frame is None:
            raise InputError(f"{robot.name} without a tip frame", "the point to control", "name [robot] tip_frame")
        n = robot.joint_count
        q = numbers(q, (n,), f"joint positions of {robot.name}", "give one state at a time")
        dq = (
            np.zeros(n)
            if dq is None
            else numbers(dq, (n,), f"joint velocities of {robot.name}", "give one state at a time")
        )
        drives = np.zeros(n) if rotor is None else np.asarray(rotor, dtype=float)
        if drives.shape not in ((), (n,)) or not (np.isfinite(drives).all() and (drives >= 0).all()):
            raise InputError(f"rotor inertias {rotor}", f"one number that isn't negative, or {n}", "give them in kg·m²")
        model = robot.model
        data, frame = model.createData(), model.getFrameId(robot.tip_frame)
        configuration, speed, zero = robot.configuration(q)[0], robot.tangent(dq)[0], np.zeros(model.nv)
        pin.forwardKinematics(model, data, configuration, speed, zero)
        place = pin.updateFramePlacement(model, data, frame)
        rotation, position = place.rotation.copy(), place.translation.copy()
        drift = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector.copy()
        jacobian = pin.computeFrameJacobian(model, data, configuration, frame, pin.LOCAL_WORLD_ALIGNED)
        mass = pin.crba(model, data, configuration).copy()
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, data, configuration, speed).copy()
        gravity = pin.computeGeneralizedGravity(model, data, configuration).copy()
        in_order = robot.from_tangent
        mass = in_order(np.ascontiguousarray(in_order(mass).T))
        return cls(
            dq,
            rotation,
            position,
            in_order(jacobian),
            drift,
            mass + np.diag(np.broadcast_to(drives, n)),
            in_order(bias[None, :])[0],
            in_order(gravity[None, :])[0],
            np.zeros(6) if wrench is None else wrench,
        )

    @property
    def twist(self) -> Array:
        """Velocity and angular velocity of the tip, base axes, (6,)."""
        return np.asarray(self.jacobian @ self.dq)

    @property
    def singular(self) -> bool:
        """Whether the tip can hardly move along some direction, so that `task_inertia` is the damped one."""
        mobility = np.linalg.eigvalsh(self._mobility())
        return bool(mobility[0] < DAMPED * mobility[-1])

    def task_inertia(self) -> Array:
        """Λ = (J M⁻¹ Jᵀ)⁻¹, what the tip weighs, base axes, (6, 6) (O. Khatib, IEEE J. Robotics Automation 3, 1987).

        Near a singular pose Λ grows beyond bounds, and torques with it; there it is damped, (J M⁻¹ Jᵀ + λ)⁻¹ with a λ
        that sets in gently as the least mobility falls below ε, λ = ε (1 − least/ε)² (Y. Nakamura, H. Hanafusa, J.
        Dynamic Systems, Measurement and Control 108, 1986). Along what the tip can do this changes next to nothing;
        along what it can't, a controller asks for less than it would need. `singular` says so.
        """
        values, vectors = np.linalg.eigh(self._mobility())
        edge = DAMPED * values[-1]
        values = values + edge * max(0.0, 1.0 - values[0] / edge) ** 2
        inertia = (vectors / values) @ vectors.T
        return np.asarray(0.5 * (inertia + inertia.T))

    def _mobility(self) -> Array:
        """J M⁻¹ Jᵀ, (6, 6)."""
        mobility = self.jacobian @ np.linalg.solve(self.mass, self.jacobian.T)
        return np.asarray(0.5 * (mobility + mobility.T))


@dataclass(frozen=True, eq=False)
class Target:
    """Where the tip shall be: rotation (3, 3), position (3,) [m], twist (6,) [m/s, rad/s], base axes."""

    rotation: Array
    position: Array
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    acceleration: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        for name, shape in (("rotation", (3, 3)), ("position", (3,)), ("velocity", (6,)), ("acceleration", (6,))):
            object.__setattr__(self, name, numbers(getattr(self, name), shape, f"a target's {name}"))
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise InputError("a target's rotation that isn't one", "orthonormal columns, right-handed", "normalise it")
