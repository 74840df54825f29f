"""What an arm carries: its sensor's motion, the tool's load there, and the torques that hold a payload."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from kinid.data.rig import Rig
from kinid.effects import JointMotion, SensorMotion
from kinid.robotics.body_tree import BodyTree
from kinid.robotics.inverse_dynamics import inverse_dynamics
from kinid.robotics.motion import JointMotion as Motion
from kinid.robotics.robot import Kinematics, Robot
from kinid.robotics.surface import Plane, Surface
from kinid.robotics.wrench import tool_load

Array = NDArray[np.float64]

#: samples whose poses are held at a time: all of a long log would need as much memory as everything else together
AT_ONCE = 32_768


def sensor_motion(
    robot: Robot, rig: Rig, motion: Motion, rows: NDArray[np.int64], surface: Surface | None
) -> SensorMotion:
    """Motion of the sensor at these rows, and the load of the rig's tool there.

    Contact axes are the surface's where the tip is; without a surface, the base's.
    """
    tool, n = rig.carried, len(rows)
    out = SensorMotion(
        to_contact=np.empty((n, 3, 3)),
        tip=robot.tip_in_sensor() if robot.tip_frame is not None else np.zeros(3),
        specific=np.empty((3, n)),
        omega=np.empty((3, n)),
        alpha=np.empty((3, n)),
        load=np.empty((6, n)),
        mass=tool.mass,
        com=np.asarray(tool.com),
        moments=np.asarray(tool.inertia[:3]),
    )
    for begin in range(0, n, AT_ONCE):
        at, part = slice(begin, begin + AT_ONCE), rows[begin : begin + AT_ONCE]
        sensor = robot.kinematics(robot.sensor_frame or "", motion.q[part], motion.dq[part], motion.ddq[part])
        axes: Array = np.eye(3)
        if isinstance(surface, Plane):
            axes = surface.axes
        elif surface is not None:
            axes = surface.locate(robot.kinematics(robot.tip_frame or "", motion.q[part]).position).axes
        out.to_contact[at] = axes @ sensor.rotation
        out.specific[:, at], out.omega[:, at], out.alpha[:, at] = _in_sensor(sensor, robot.gravity)
        out.load[:, at] = tool_load(tool, sensor, robot.gravity).T
    return out


def joint_signals(
    motion: Motion, rows: NDArray[np.int64], arm: Robot | None, bare: Robot | None, carried: Array | None
) -> JointMotion:
    """Motion of the joints at these rows, and the rigid-body torques that go with it.

    Args:
        motion: of all rows. arm: that carries everything whose torques are predicted, None for axes alone.
        bare: without the tool. carried: load on what lies beyond the sensor frame at all rows [N, N·m], (n, 6).
    """
    q, dq, ddq = motion.q[rows], motion.dq[rows], motion.ddq[rows]
    rows_first = [np.ascontiguousarray(values.T) for values in (q, dq, ddq, np.zeros_like(q))]
    out = JointMotion(rows_first[0], rows_first[1], rows_first[2], rows_first[3], known=False)
    if arm is None or bare is None:
        return out
    rigid = inverse_dynamics(arm, q, dq, ddq, None if carried is None else carried[rows])
    return dataclasses.replace(
        out,
        rigid=np.ascontiguousarray(rigid.T),
        known=True,
        payload=payload_torques(bare, q, dq, ddq),
        gravity=gravity_torques(arm, q),
        moments=functools.partial(moment_torques, arm),
        slopes=functools.partial(torque_slopes, arm),
    )


def payload_torques(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Joint torques per unit of a payload's m [kg] and m·com [kg·m], (4, N, n), in the log's order of joints.

    The payload is fixed to the sensor frame (without one, to the tip's, else to the last frame of the model), and its
    com is given there; its inertia about the origin of that frame is zero. By Newton-Euler its wrench is linear in
    these four, and so are the torques −Jᵀ w that hold it.
    """
    model = robot.model
    name = robot.sensor_frame or robot.tip_frame or model.frames[model.nframes - 1].name
    motion = robot.kinematics(name, q, dq, ddq)
    wrench = payload_wrenches(*_in_sensor(motion, robot.gravity))
    tree = BodyTree.of(robot)
    return np.ascontiguousarray([tree.torques_of_load(q, each.T, name).T for each in wrench])


def gravity_torques(robot: Robot, q: Array) -> Array:
    """Joint torques that hold the arm per unit of gravity along each base axis, (3, N, n), in the log's order."""
    tree = BodyTree.of(robot)
    return np.ascontiguousarray([tree.torques_of_gravity(q, axis).T for axis in np.eye(3)])


def moment_torques(robot: Robot, q: Array) -> Array:
    """Joint torques that hold the arm at rest per unit of each link's first moment m·c [kg·m] in its joint's frame.

    Returns:
        (3 N, N, n): of the first link along x, y and z, of the second, …; joints in the log's order.
    """
    model, data, configuration = robot.model, robot.model.createData(), robot.configuration(q)
    still, links = np.zeros(model.nv), model.njoints - 1
    moments = np.array([10 * link + k for link in range(links) for k in (1, 2, 3)])
    out = np.empty((len(moments), len(q), model.nv))
    for i, row in enumerate(configuration):
        out[:, i] = pin.computeJointTorqueRegressor(model, data, row, still, still)[:, moments].T
    return np.ascontiguousarray(np.stack([robot.from_tangent(rows) for rows in out]).transpose(0, 2, 1))


def torque_slopes(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Change of the torques of a motion where each joint is elsewhere, per radian, per rad/s and per rad/s².

    Returns:
        (3, N, N, n): of the first joint's angle on all torques, …; then of its velocity, and of its acceleration.
    """
    model, data = robot.model, robot.model.createData()
    configuration, v, a = robot.configuration(q), robot.tangent(dq), robot.tangent(ddq)
    out = np.empty((3, robot.joint_count, robot.joint_count, len(q)))
    order = robot.order
    at = np.ix_(order, order)
    for i, row in enumerate(configuration):
        slopes, damping, masses = pin.computeRNEADerivatives(model, data, row, v[i], a[i])
        out[0][..., i][at], out[1][..., i][at], out[2][..., i][at] = slopes.T, damping.T, masses
    return out


def payload_wrenches(specific: Array, omega: Array, alpha: Array) -> Array:
    """Wrench at the origin of the sensor per unit of m and m·com, its inertia about that origin zero, (4, 6, n).

    f = m (g − a) − α × h − ω × (ω × h), τ = h × (g − a); arguments as in `SensorMotion`, (3, n).
    """
    out = np.zeros((4, 6, specific.shape[1]))
    out[0, :3] = specific
    for k, h in enumerate(np.eye(3)[:, :, None]):
        turned = np.cross(omega, np.broadcast_to(h, omega.shape), axis=0)
        out[k + 1, :3] = -np.cross(alpha, np.broadcast_to(h, alpha.shape), axis=0) - np.cross(omega, turned, axis=0)
        out[k + 1, 3:] = np.cross(np.broadcast_to(h, specific.shape), specific, axis=0)
    return out


def _in_sensor(motion: Kinematics, gravity: Array) -> tuple[Array, Array, Array]:
    """Specific force g − a, angular velocity and acceleration in the frame's own axes, each (3, n)."""
    into = [
        np.einsum("nji,nj->in", motion.rotation, vector)
        for vector in (gravity - motion.acceleration, motion.angular_velocity, motion.angular_acceleration)
    ]
    return into[0], into[1], into[2]
