"""The bodies of an arm, packed for compiled inverse dynamics of many states at once.

Pinocchio is asked state by state, and handing over a state takes twenty times what its torques take.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.robotics.robot import Robot
from kinid.robotics.urdf_model import joint_axis, z_onto

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyTree:
    """Joints and what they carry, in Pinocchio's order; each joint acts along its third axis.

    Attributes:
        robot: that it is made of.
        axes: from the axes of `kinid.kernels.dynamics.newton_euler` to Pinocchio's, the base's first, (N + 1, 3, 3).
        parents … inertia: arguments of `kinid.kernels.dynamics.newton_euler`.
    """

    robot: Robot
    axes: Array
    parents: NDArray[np.int64]
    turns: Array
    shifts: Array
    prismatic: NDArray[np.bool_]
    mass: Array
    com: Array
    inertia: Array

    @classmethod
    def of(cls, robot: Robot) -> BodyTree:
        """The bodies of a robot's model."""
        model = robot.model
        joints = range(1, model.njoints)
        kinds = [joint_axis(model, j) for j in joints]
        axes = np.array([np.eye(3), *(z_onto(axis) for axis, _ in kinds)])
        before = [axes[model.parents[j]].T for j in joints]
        places, bodies = [model.jointPlacements[j] for j in joints], [model.inertias[j] for j in joints]
        return cls(
            robot,
            axes,
            np.array([model.parents[j] - 1 for j in joints], dtype=np.int64),
            np.array([back @ place.rotation @ axis for back, place, axis in zip(before, places, axes[1:])]),
            np.array([back @ place.translation for back, place in zip(before, places)]),
            np.array([slides for _, slides in kinds], dtype=np.bool_),
            np.array([body.mass for body in bodies]),
            np.array([axis.T @ body.lever for axis, body in zip(axes[1:], bodies)]),
            np.array([axis.T @ body.inertia @ axis for axis, body in zip(axes[1:], bodies)]),
        )

    def torques(self, q: Array, dq: Array, ddq: Array, load: Array | None = None, frame: str = "") -> Array:
        """Joint torques of motions, and of a load, by recursive Newton-Euler, (n, N) in the log's order.

        Args:
            q, dq, ddq: (n, N), in the log's order.
            load: that a frame carries, in its axes about its origin [N, N·m], (n, 6). frame: its name.
        """
        return self._torques(q, dq, ddq, self.mass, self.robot.gravity, load, frame)

    def torques_of_gravity(self, q: Array, gravity: Array) -> Array:
        """Joint torques that hold the arm at rest under a gravity in base axes [m/s²], (n, N) in the log's order."""
        still = np.zeros_like(q)
        return self._torques(q, still, still, self.mass, gravity)

    def torques_of_load(self, q: Array, load: Array, frame: str) -> Array:
        """−Jᵀ w of loads that a frame carries, (n, N) in the log's order; arguments as in `torques`."""
        still = np.zeros_like(q)
        return self._torques(q, still, still, np.zeros_like(self.mass), np.zeros(3), load, frame)

    def _torques(
        self, q: Array, dq: Array, ddq: Array, mass: Array, gravity: Array, load: Array | None = None, frame: str = ""
    ) -> Array:
        from kinid.kernels.dynamics import newton_euler

        robot, at, carried = self.robot, 1, np.empty((0, 6))
        where = None if load is None else robot.frame(frame)
        if where is not None and load is not None and where.parentJoint > 0:  # no joint carries what the base does
            at = where.parentJoint
            # from the frame's axes and origin to those of the body that carries it
            turn, arm = self.axes[at].T @ where.placement.rotation, self.axes[at].T @ where.placement.translation
            force, moment = load[:, :3] @ turn.T, load[:, 3:] @ turn.T
            carried = np.hstack([force, moment + np.cross(arm, force)])
        out = np.empty(np.atleast_2d(q).shape)
        newton_euler(
            *(robot.tangent(values) for values in (q, dq, ddq)),
            self.parents,
            self.turns,
            self.shifts,
            self.prismatic,
            mass,
            self.com,
            self.inertia,
            np.asarray(gravity, dtype=float),
            at - 1,
            carried,
            out,
        )
        return robot.from_tangent(out)
