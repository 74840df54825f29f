"""The arm: a Pinocchio model, its frames, and batch kinematics that agree with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import kinid.urdf
from kinid.data.plausible import TURNS_OR_SLIDES
from kinid.data.rig import Rig, RobotSpec, ToolSpec
from kinid.errors import InputError, expect, near
from kinid.robotics.urdf_model import find_frame, joint_axis, lock, names_to, parsed, refuse_millimetres, z_onto

Array = NDArray[np.float64]

#: frames that are taken where the rig names none and the robot has them
DEFAULT_SENSOR_FRAME, DEFAULT_TIP_FRAME = "ft_sensor", "tool_tip"


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain from the base to one frame, packed for the kernels: every joint acts along its local z axis.

    Attributes:
        turns: constant rotations before each joint and after the last, (N + 1, 9) row-major.
        shifts: constant translations, each in the axes before its rotation [m], (N + 1, 3).
        prismatic: whether each joint slides, (N,).
        columns: for each joint of the chain its column in the log's joint arrays, (N,).
    """

    turns: Array
    shifts: Array
    prismatic: NDArray[np.bool_]
    columns: NDArray[np.int64]

    def select(self, values: Array) -> Array:
        """The chain's columns of a log's joint array, (n, N); the same array where nothing is to be reordered."""
        if np.array_equal(self.columns, np.arange(values.shape[1])):
            return np.ascontiguousarray(values)
        return np.ascontiguousarray(values[:, self.columns])


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Motion of one frame in base axes; the linear quantities are those of its origin.

    Attributes:
        rotation: (n, 3, 3). position [m], velocity [m/s], acceleration [m/s²], angular_velocity [rad/s],
            angular_acceleration [rad/s²]: (n, 3).
    """

    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A Pinocchio model whose joints are the log's, in the model's order, and where its frames are.

    Build one with `Robot.load` (from a rig) or `Robot.from_urdf`; the model is never patched afterwards.

    Attributes:
        name: as the rig names it.
        model: Pinocchio model; joints that the log doesn't hold are locked at their neutral position.
        joint_names: the log's joints, in the order of q1…qN.
        sensor_frame: frame of the wrench, None where there is none.
        tip_frame: the contact point, None where there is none.
        gravity: in the base frame [m/s²], (3,).
    """

    name: str
    model: pin.Model
    joint_names: tuple[str, ...]
    sensor_frame: str | None
    tip_frame: str | None
    gravity: Array
    compliance: Array  # (3, 3) [m/N], base frame

    def __repr__(self) -> str:
        frames = {"wrench": self.sensor_frame, "tip": self.tip_frame}
        named = "".join(f", {what} in {frame}" for what, frame in frames.items() if frame is not None)
        return f"<Robot {self.name}: {self.joint_count} joints{named}>"

    @classmethod
    def load(cls, rig: Rig | str | Path) -> Robot:
        """The robot of a rig; or of a name ("lwr4plus", "ur5" …) or the path of a URDF.

        Raises:
            InputError: no `[robot]`, no such model, frame or joint, or a URDF that can't be trusted or read.
        """
        expect(rig, (Rig, str, Path), "a robot", "a rig, the name of a robot or a URDF's path", "name one, as 'ur5'")
        if not isinstance(rig, Rig):
            return cls.from_urdf(kinid.urdf.path(str(rig), Path()), name=str(rig))
        if rig.robot is None:
            raise InputError(
                "a rig without [robot]",
                "a robot to turn joints into motion",
                'add [robot] with model = "lwr4plus" or your URDF',
            )
        robot = cls.from_spec(rig.robot, rig.folder)
        _refuse_other_units(rig, robot)
        return robot

    @classmethod
    def from_spec(cls, spec: RobotSpec, folder: Path = Path()) -> Robot:
        """The robot of a rig's `[robot]` table; a URDF path is relative to `folder`."""
        path = kinid.urdf.path(spec.model, folder)
        return cls.from_urdf(
            path,
            name=spec.model,
            joints=spec.joints,
            sensor_frame=spec.sensor_frame,
            tip_frame=spec.tip_frame,
            gravity=spec.gravity,
            compliance=spec.compliance,
        )

    @classmethod
    def from_urdf(
        cls,
        path: Path,
        name: str | None = None,
        joints: Sequence[str] | None = None,
        sensor_frame: str | None = None,
        tip_frame: str | None = None,
        gravity: Sequence[float] = (0.0, 0.0, -9.81),
        compliance: Sequence[Sequence[float]] | None = None,
    ) -> Robot:
        """The robot of a URDF file; without `joints` those between the base and the tip, in their order."""
        path = Path(path)
        found = path.stat() if path.is_file() else None
        which = (found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size) if found else (0, 0, 0, 0)
        still = np.zeros((3, 3)) if compliance is None else np.asarray(compliance, dtype=float)
        known = _of_urdf(
            path,
            which,
            name or path.stem,
            None if joints is None else tuple(joints),
            sensor_frame,
            tip_frame,
            tuple(np.asarray(gravity, dtype=float).tolist()),
            tuple(map(tuple, still.tolist())),
        )
        # each with a model of its own: whoever changes one changes no other
        return replace(
            known, model=known.model.copy(), gravity=known.gravity.copy(), compliance=known.compliance.copy()
        )

    @property
    def end_frames(self) -> tuple[str, ...]:
        """The last links of its URDF, the last of them first; eight at most."""
        return tuple([f.name for f in self.model.frames if f.type == pin.FrameType.BODY][:-9:-1])

    @property
    def joint_count(self) -> int:
        """Number of joints, N."""
        return len(self.joint_names)

    @property
    def lower(self) -> Array:
        """Lower position limits in the log's order [rad or m], (N,)."""
        return self._limit(self.model.lowerPositionLimit, -np.inf)

    @property
    def upper(self) -> Array:
        """Upper position limits in the log's order [rad or m], (N,)."""
        return self._limit(self.model.upperPositionLimit, np.inf)

    @property
    def velocity_limit(self) -> Array:
        """Greatest speeds in the log's order [rad/s or m/s], (N,); 0 where the URDF states none."""
        out: Array = self.from_tangent(np.array(self.model.velocityLimit, dtype=float)[None, :])[0]
        return out

    @property
    def effort_limit(self) -> Array:
        """Greatest torques or forces in the log's order [N·m or N], (N,); 0 where the URDF states none."""
        out: Array = self.from_tangent(np.array(self.model.effortLimit, dtype=float)[None, :])[0]
        return out

    def chain(self, frame: str) -> Chain:
        """The chain from the base to a frame."""
        model = self.model
        target = self.frame(frame)
        ids = [j for j in model.supports[target.parentJoint] if j > 0]
        turns, shifts, prismatic = [], [], []
        before = np.eye(3)  # from the axes in which the last joint acts along z, back to its own
        for j in ids:
            axis, slides = joint_axis(model, j)
            placement = model.jointPlacements[j]
            align = z_onto(axis)
            shifts.append(before.T @ placement.translation)
            turns.append(before.T @ placement.rotation @ align)
            prismatic.append(slides)
            before = align
        shifts.append(before.T @ target.placement.translation)
        turns.append(before.T @ target.placement.rotation)
        return Chain(
            np.ascontiguousarray([turn.ravel() for turn in turns]),
            np.ascontiguousarray(shifts),
            np.array(prismatic, dtype=np.bool_),
            np.array([self.joint_names.index(model.names[j]) for j in ids], dtype=np.int64),
        )

    def bodies(self, frame: str) -> tuple[Array, Array, Array]:
        """What each joint on the way to a frame carries, in the axes of `chain`: mass [kg], com [m], inertia about it
        [kg·m²].

        Returns:
            Arrays (N,), (N, 3), (N, 9) row-major.

        Raises:
            InputError: joints that don't lie between the base and the frame.
        """
        model = self.model
        ids = [j for j in model.supports[self.frame(frame).parentJoint] if j > 0]
        if len(ids) != model.njoints - 1:
            raise InputError(
                f"{model.njoints - 1} joints of {self.name}, {len(ids)} of them up to '{frame}'",
                "one serial arm",
                "name its joints in [robot] joints; the others are locked",
            )
        turned = [(z_onto(joint_axis(model, j)[0]), model.inertias[j]) for j in ids]
        return (
            np.array([body.mass for _, body in turned]),
            np.array([align.T @ body.lever for align, body in turned]),
            np.array([(align.T @ body.inertia @ align).ravel() for align, body in turned]),
        )

    def frame(self, name: str) -> pin.Frame:
        """Pinocchio's frame of that name; where a link and a joint share it, the link's."""
        return find_frame(self.model, name, self.name)

    def tip_in_sensor(self) -> Array:
        """Position of the tip in the sensor frame [m], (3,); both frames must be there."""
        sensor, tip = self.frame(self.sensor_frame or "").placement, self.frame(self.tip_frame or "").placement
        return np.asarray((sensor.inverse() * tip).translation)

    def kinematics(self, frame: str, q: Array, dq: Array | None = None, ddq: Array | None = None) -> Kinematics:
        """Motion of a frame for joint positions and derivatives (n, N) in the log's order; what is absent is zero."""
        from kinid.kernels import chain as kernel

        chain = self.chain(frame)
        q = chain.select(np.atleast_2d(np.asarray(q, dtype=float)))
        still = np.zeros_like(q)
        out = np.empty((len(q), kernel.POSE_COLUMNS))
        kernel.poses(
            q,
            still if dq is None else chain.select(np.atleast_2d(np.asarray(dq, dtype=float))),
            still if ddq is None else chain.select(np.atleast_2d(np.asarray(ddq, dtype=float))),
            chain.turns,
            chain.shifts,
            chain.prismatic,
            out,
        )
        return Kinematics(
            rotation=out[:, 0:9].reshape(-1, 3, 3),
            position=out[:, 9:12],
            angular_velocity=out[:, 12:15],
            velocity=out[:, 15:18],
            angular_acceleration=out[:, 18:21],
            acceleration=out[:, 21:24],
        )

    def with_tool(self, tool: ToolSpec) -> Robot:
        """The same arm carrying the tool, whose weight and inertia hang on the sensor frame's link."""
        if self.sensor_frame is None:
            raise InputError(
                f"[tool] on {self.name} without a sensor frame",
                "the frame that [tool] com is in",
                f"name [robot] sensor_frame, at the end of the arm: {', '.join(self.end_frames)}",
            )
        model = self.model.copy()
        frame = self.frame(self.sensor_frame)
        inertia = pin.Inertia(tool.mass, np.asarray(tool.com), tool.inertia_matrix)
        model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
        return Robot(
            self.name, model, self.joint_names, self.sensor_frame, self.tip_frame, self.gravity, self.compliance
        )

    def is_prismatic(self, joint: str) -> bool:
        """Whether a joint slides."""
        return joint_axis(self.model, self.model.getJointId(joint))[1]

    def configuration(self, q: Array) -> Array:
        """Pinocchio's configuration vectors for joint positions in the log's order, (n, nq)."""
        q = np.atleast_2d(q)
        out = np.empty((len(q), self.model.nq))
        for j in range(1, self.model.njoints):
            column, at = self.joint_names.index(self.model.names[j]), self.model.joints[j].idx_q
            if self.model.joints[j].nq == 2:  # a continuous joint stands as cosine and sine
                out[:, at], out[:, at + 1] = np.cos(q[:, column]), np.sin(q[:, column])
            else:
                out[:, at] = q[:, column]
        return out

    def tangent(self, values: Array) -> Array:
        """Joint velocities, accelerations or torques from the log's order to Pinocchio's, (n, nv)."""
        return np.ascontiguousarray(np.atleast_2d(values)[:, self.order])

    def from_tangent(self, values: Array) -> Array:
        """From Pinocchio's order to the log's, (n, N)."""
        out = np.empty_like(values)
        out[:, self.order] = values
        return out

    @property
    def order(self) -> list[int]:
        """Column in a log of each of Pinocchio's joints, N."""
        return [self.joint_names.index(self.model.names[j]) for j in range(1, self.model.njoints)]

    def _limit(self, values: Array, unbounded: float) -> Array:
        out = np.full(self.joint_count, unbounded)
        for j in range(1, self.model.njoints):
            joint = self.model.joints[j]
            if joint.nq == 1:
                out[self.joint_names.index(self.model.names[j])] = values[joint.idx_q]
        return out

    def _parent(self, frame: str) -> int:
        return int(self.frame(frame).parentJoint)


def _refuse_other_units(rig: Rig, robot: Robot) -> None:
    """Refuse a length of a joint that turns, and an angle of one that slides; of a block, where all joints are so."""
    for name, spec in rig.columns.items():
        stem = name.rstrip("0123456789")
        joints = robot.joint_names if stem == name else robot.joint_names[int(name[len(stem) :]) - 1 :][:1]
        slides = {robot.is_prismatic(joint) for joint in joints} if stem in TURNS_OR_SLIDES else set()
        if len(slides) == 1 and spec.unit in TURNS_OR_SLIDES[stem][0 if slides == {True} else 1]:
            known, does = (1, "slide") if slides == {True} else (0, "turn")
            which = f"{joints[0]} {does}s" if stem != name else f"all joints {does}"
            raise InputError(
                f"{name} in {spec.unit} in [columns], where {which}",
                f"a unit as {', '.join(unit for unit in TURNS_OR_SLIDES[stem][known] if '·' not in unit)}",
                "correct that line of the rig",
            )


@lru_cache(maxsize=8)
def _of_urdf(
    path: Path,
    _which: tuple[int, int, int, int],
    name: str,
    joints: tuple[str, ...] | None,
    sensor_frame: str | None,
    tip_frame: str | None,
    gravity: tuple[float, ...],
    compliance: tuple[tuple[float, ...], ...],
) -> Robot:
    """The robot of a URDF, read once while the file stays as it is: each log of a folder asks for it several times."""
    kinid.urdf.check(path)
    full = parsed(path)
    frames = [frame.name for frame in full.frames]
    sensor_frame = _frame(sensor_frame, DEFAULT_SENSOR_FRAME, frames, "sensor_frame", name)
    tip_frame = _frame(tip_frame, DEFAULT_TIP_FRAME, frames, "tip_frame", name)
    refuse_millimetres(full, path)
    movable = [full.names[j] for j in range(1, full.njoints) if full.joints[j].nv == 1]
    if joints is None:
        end = tip_frame or sensor_frame
        on_path = names_to(full, find_frame(full, end, name).parentJoint) if end else movable
        joints = tuple([joint for joint in on_path if joint in movable] or movable)
    for joint in joints:
        if joint not in movable:
            raise InputError(f"joint '{joint}' in [robot] joints", f"a one-axis joint of {name}", near(joint, movable))
    if len(set(joints)) != len(joints):
        raise InputError(f"[robot] joints {list(joints)}", "each joint once", "remove the doubled name")
    locked = [j for j in range(1, full.njoints) if full.names[j] not in set(joints)]
    model = lock(full, locked) if locked else full
    model.gravity = pin.Motion(np.asarray(gravity), np.zeros(3))
    robot = Robot(name, model, joints, sensor_frame, tip_frame, np.asarray(gravity), np.asarray(compliance))
    if sensor_frame and tip_frame and robot._parent(sensor_frame) != robot._parent(tip_frame):
        raise InputError(
            f"a joint between '{sensor_frame}' and '{tip_frame}' of {name}",
            "a tip that is fixed to the sensor",
            "choose frames on the same link",
        )
    return robot


def _frame(name: str | None, default: str, frames: Sequence[str], key: str, robot: str) -> str | None:
    if name is None:
        return default if default in frames else None
    if name not in frames:
        raise InputError(f"[robot] {key} = '{name}'", f"a frame of {robot}", near(name, frames))
    return name
