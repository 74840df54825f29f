"""The arm, from the text of its URDF as MuJoCo reads it: own kinematics, inverse kinematics, and MuJoCo's inverse
dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import kinid.urdf

Array = NDArray[np.float64]

#: [Hz] of the poses that inverse kinematics is solved for; between them joints follow a cubic spline
KNOTS = 100
#: iterations of the inverse kinematics from one start: positions are then right to a nanometre
ITERATIONS = 8
GRAVITY = 9.81


@dataclass(frozen=True)
class Body:
    """A rigid body at the sensor: mass [kg], centre [m] and inertia about it [kg·m²] (xx yy zz xy xz yz) in sensor
    axes.
    """

    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@cache
def scene(bodies: tuple[Body, ...], armature: tuple[float, ...] = ()) -> mujoco.MjModel:
    """The arm with bodies behind its sensor, which feels them all, and with the inertia of its motors."""
    spec = mujoco.MjSpec.from_file(str(kinid.urdf.path("lwr4plus", Path())))
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    tool = spec.body("ft_sensor").add_body(name="tool")
    tool.add_site(name="site")
    tool.mass, tool.inertia, tool.explicitinertial = 1e-12, [1e-15] * 3, True
    for i, body in enumerate(bodies):
        if body.mass == 0.0 and not any(body.inertia):
            continue
        # an inertia may be that of two thin bodies on one axis: MuJoCo's own test is for solid ones
        inertia = np.add(body.inertia, [1e-9, 1e-9, 1e-9, 0, 0, 0])
        part = tool.add_body(name=f"part{i}", mass=body.mass, ipos=body.com, fullinertia=inertia)
        part.explicitinertial = True
    for joint, value in zip(spec.joints, armature):
        joint.armature = value
    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="site")
    return spec.compile()


@dataclass(frozen=True, eq=False)
class Pose:
    """Tip and tool over time: position (n, 3), rotation from tool to base (n, 3, 3), Jacobian (n, 6, 7) at the tip."""

    position: Array
    rotation: Array
    jacobian: Array


def forward(q: Array) -> Pose:
    """Kinematics of the tip for joint positions (n, 7), in the base frame."""
    n = len(q)
    out = Pose(np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 6, 7)))
    _forward(np.ascontiguousarray(q), *_chain(), out.position, out.rotation, out.jacobian)
    return out


@cache
def _chain() -> tuple[Array, Array, Array]:
    """Offset, rotation and joint axis (zero without a joint) of each body from the base to the tip."""
    model = scene(())
    offsets, rotations, axes = [], [], []
    body = model.body("tool_tip").id
    while body > 0:
        offsets.append(model.body_pos[body])
        rotations.append(Rotation.from_quat(model.body_quat[body], scalar_first=True).as_matrix())
        axes.append(model.jnt_axis[model.body_jntadr[body]] if model.body_jntnum[body] else np.zeros(3))
        body = model.body_parentid[body]
    return np.array(offsets[::-1]), np.array(rotations[::-1]), np.array(axes[::-1])


@njit(cache=True)
def _forward(q, offsets, rotations, axes, position, rotation, jacobian):
    """From body to body: shift, turn, and turn about the joint's axis (Rodrigues)."""
    centre, spin = np.zeros((7, 3)), np.zeros((7, 3))
    turn, about, hat = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    place = np.zeros(3)
    for i in range(q.shape[0]):
        place[:] = 0.0
        turn[:] = 0.0
        turn[0, 0] = turn[1, 1] = turn[2, 2] = 1.0
        joint = 0
        for b in range(offsets.shape[0]):
            for r in range(3):
                place[r] += turn[r, 0] * offsets[b, 0] + turn[r, 1] * offsets[b, 1] + turn[r, 2] * offsets[b, 2]
            _turn_by(turn, rotations[b])
            x, y, z = axes[b, 0], axes[b, 1], axes[b, 2]
            if x != 0.0 or y != 0.0 or z != 0.0:
                for r in range(3):
                    centre[joint, r] = place[r]
                    spin[joint, r] = turn[r, 0] * x + turn[r, 1] * y + turn[r, 2] * z
                s, c = np.sin(q[i, joint]), 1.0 - np.cos(q[i, joint])
                hat[0, 1], hat[0, 2], hat[1, 2] = -z, y, -x
                hat[1, 0], hat[2, 0], hat[2, 1] = z, -y, x
                for r in range(3):
                    for k in range(3):
                        square = hat[r, 0] * hat[0, k] + hat[r, 1] * hat[1, k] + hat[r, 2] * hat[2, k]
                        about[r, k] = (1.0 if r == k else 0.0) + s * hat[r, k] + c * square
                _turn_by(turn, about)
                joint += 1
        position[i] = place
        rotation[i] = turn
        for j in range(7):
            x, y, z = place[0] - centre[j, 0], place[1] - centre[j, 1], place[2] - centre[j, 2]
            jacobian[i, 0, j] = spin[j, 1] * z - spin[j, 2] * y
            jacobian[i, 1, j] = spin[j, 2] * x - spin[j, 0] * z
            jacobian[i, 2, j] = spin[j, 0] * y - spin[j, 1] * x
            for r in range(3):
                jacobian[i, 3 + r, j] = spin[j, r]


@njit(cache=True)
def _turn_by(turn, more):
    """turn ← turn · more."""
    for r in range(3):
        a, b, c = turn[r, 0], turn[r, 1], turn[r, 2]
        for k in range(3):
            turn[r, k] = a * more[0, k] + b * more[1, k] + c * more[2, k]


def inverse(start: Array, position: Array, rotation: Array) -> Array:
    """Joint positions (n, 7) of poses of the tip, by damped least squares, each from the same start: smooth in the
    pose.

    Raises:
        ValueError: a pose that can't be reached.
    """
    q = np.broadcast_to(start, (len(position), len(start))).copy()
    for k in range(ITERATIONS):
        now = forward(q)
        turn = 0.5 * np.cross(now.rotation, rotation, axis=1).sum(axis=2)  # axes that are to meet, for small angles
        error = np.concatenate([position - now.position, turn], axis=1)
        j = now.jacobian
        damped = j @ j.transpose(0, 2, 1) + (1e-4 if k < 3 else 1e-10) * np.eye(6)
        q += (j.transpose(0, 2, 1) @ np.linalg.solve(damped, error[:, :, None]))[:, :, 0]
    if np.abs(error).max() > 1e-6:
        raise ValueError(f"a pose out of reach: {np.abs(error).max():.2g} m or rad are left")
    return q


def follow(start: Array, t: Array, position: Array, rotation: Array) -> CubicSpline:
    """Joint trajectory whose tip follows poses given at times t, of an even rate that `KNOTS` divides."""
    every = max(1, round(1.0 / (KNOTS * (t[1] - t[0]))))
    knots = np.unique(np.append(np.arange(0, len(t), every), len(t) - 1))
    return CubicSpline(t[knots], inverse(start, position[knots], rotation[knots]))


def felt(bodies: tuple[Body, ...], q: Array, dq: Array, ddq: Array) -> Array:
    """What a sensor reads of bodies behind it in motion, (n, 6), by MuJoCo; no contact."""
    return dynamics(bodies, q, dq, ddq)[0]


def dynamics(
    bodies: tuple[Body, ...],
    q: Array,
    dq: Array,
    ddq: Array,
    armature: tuple[float, ...] = (),
    push: Array | None = None,
) -> tuple[Array, Array]:
    """Sensor wrench (n, 6), as loads on the tool in sensor axes, and joint torques (n, 7), by MuJoCo's inverse
    dynamics.

    Args:
        bodies: behind the sensor. q, dq, ddq: of the joints, (n, 7). armature: inertia of the motors, (7,).
        push: force [N] on the tool at its tip, base axes, (n, 3).
    """
    model = scene(bodies, armature)
    data = mujoco.MjData(model)
    wrench, torque = np.empty((len(q), 6)), np.empty((len(q), 7))
    tool, tip = model.body("tool").id, model.body("tool_tip").id
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], dq[i], ddq[i]
        if push is not None:
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            arm = data.xpos[tip] - data.xipos[tool]
            data.xfrc_applied[tool] = np.concatenate([push[i], np.cross(arm, push[i])])
        mujoco.mj_inverse(model, data)
        # the sensor gives what the arm does to the tool; the log's sign is the load on the tool
        wrench[i], torque[i] = -data.sensordata, data.qfrc_inverse
        if push is not None:  # what it says is needed is the push and the motors' torque together
            given = np.zeros(7)
            mujoco.mj_applyFT(model, data, push[i], np.zeros(3), data.xpos[tip], tool, given)
            torque[i] -= given
    return wrench, torque
