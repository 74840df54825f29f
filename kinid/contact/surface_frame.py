"""The motion of a tip and the wrench at its sensor in the frame of the surface that it touches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import CONTACT, Rig
from kinid.kernels import chain as kernel
from kinid.robotics.motion import JointMotion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane, Surface
from kinid.robotics.wrench import FEWEST_FREE, Reading, packed_tool, tool_load
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

#: further outside the material than this, and nobody says otherwise, the tool is in free motion [m]
CLEARANCE = 3e-3
#: free motion is looked for in so many rows of a log; more would not change the bias by its noise
LOOKED_AT = 50_000


def contact_motion(log: Log, rig: Rig, robot: Robot, surface: Surface, motion: JointMotion) -> Array:
    """Depth, slips and their rates of a motion that need not be the log's own, rows as in `CONTACT`, (6, n)."""
    return SurfaceFrame(log, rig, robot, motion, surface, Differentiator()).table(None, False)[:6]


@dataclass(frozen=True, eq=False)
class SurfaceFrame:
    """A log seen from its surface.

    Attributes:
        motion: of the joints. differentiator: of forces, where the arm gives way.
    """

    log: Log
    rig: Rig
    robot: Robot
    motion: JointMotion
    surface: Surface
    differentiator: Differentiator

    def free(self) -> NDArray[np.int64]:
        """Rows in free motion, at most `LOOKED_AT` of them: those so labelled, else those clear of the surface."""
        labelled = self.log.labelled_free
        if len(labelled) >= FEWEST_FREE:
            return labelled[:: 1 + len(labelled) // LOOKED_AT]
        rows = np.arange(0, len(self.log), 1 + len(self.log) // LOOKED_AT)
        tip = self.robot.kinematics(self.robot.tip_frame or "", self.motion.q[rows]).position
        with np.errstate(invalid="ignore"):
            return rows[self.surface.locate(tip).depth < -CLEARANCE]

    def table(self, reading: Reading | None, moments: bool) -> Array:
        """The quantities of `CONTACT` and, with `moments`, those about the tip, (9 or 12, n); NaN where not measured.

        Args:
            reading: of the sensor, None without one. moments: whether they are asked for.
        """
        rows = kernel.CONTACT_COLUMNS if moments and reading is not None else len(CONTACT)
        out = np.full((rows, len(self.log)), np.nan)
        if isinstance(self.surface, Plane):
            self._on_plane(self.surface, reading, out)
        else:
            self._on_mesh(reading, out)
        return out

    def _on_plane(self, plane: Plane, reading: Reading | None, out: Array) -> None:
        """All quantities in one pass over the samples."""
        robot, motion = self.robot, self.motion
        chain = robot.chain(robot.sensor_frame if reading is not None and robot.sensor_frame else robot.tip_frame or "")
        kernel.contacts(
            _unwritten(chain.select(motion.q)),
            _unwritten(chain.select(motion.dq)),
            _unwritten(chain.select(motion.ddq)),
            _unwritten(np.ascontiguousarray(reading.wrench) if reading is not None else np.empty((0, 6))),
            chain.turns,
            chain.shifts,
            chain.prismatic,
            robot.tip_in_sensor() if reading is not None else np.zeros(3),
            reading.packed() if reading is not None else np.zeros(42),
            packed_tool(self.rig, robot),
            plane.packed(),
            robot.compliance.ravel(),
            len(out) if reading is not None else 6,
            out,
        )
        if reading is not None and robot.compliance.any():
            self._add_elastic_rates(plane, out)

    def _add_elastic_rates(self, plane: Plane, out: Array) -> None:
        """The tip moves with the force where the arm bends; the force's rate comes from the differentiator."""
        in_frame = plane.axes @ self.robot.compliance @ plane.axes.T  # rows tangent1, tangent2, normal
        force = np.ascontiguousarray(out[[kernel.TANGENT1, kernel.TANGENT2, kernel.NORMAL]].T)
        rates = self.differentiator(self.log.t, force, self.log.pieces).first @ in_frame.T
        out[kernel.SLIP_RATE1] += rates[:, 0]
        out[kernel.SLIP_RATE2] += rates[:, 1]
        out[kernel.DEPTH_RATE] -= rates[:, 2]

    def _on_mesh(self, reading: Reading | None, out: Array) -> None:
        """The same on a mesh: the surface's frame is another one at every sample."""
        robot, motion = self.robot, self.motion
        tip = robot.kinematics(robot.tip_frame or "", motion.q, motion.dq, motion.ddq)
        position, velocity = tip.position, tip.velocity
        if reading is not None:
            sensor = robot.kinematics(robot.sensor_frame or "", motion.q, motion.dq, motion.ddq)
            load = tool_load(self.rig.carried, sensor, robot.gravity)
            contact = np.einsum("nij,nkj->nki", sensor.rotation, (reading.true() - load).reshape(-1, 2, 3))
            force = contact[:, 0]
            if robot.compliance.any():
                position = position + force @ robot.compliance.T
                rate = self.differentiator(self.log.t, force, self.log.pieces).first
                velocity = velocity + rate @ robot.compliance.T
        where = self.surface.locate(position)
        rates = np.einsum("nij,nj->ni", where.axes, velocity)
        out[kernel.DEPTH] = where.depth
        out[kernel.DEPTH_RATE] = -np.einsum("ni,ni->n", where.gradient, velocity)
        out[kernel.SLIP_RATE1], out[kernel.SLIP_RATE2] = rates[:, 0], rates[:, 1]
        out[kernel.SLIP1], out[kernel.SLIP2] = _travel(position, where.axes[:, :2])
        if reading is None:
            return
        in_frame = np.einsum("nij,nj->in", where.axes, force)
        out[kernel.TANGENT1], out[kernel.TANGENT2], out[kernel.NORMAL] = in_frame
        if len(out) > len(CONTACT):
            arm = np.einsum("nij,j->ni", sensor.rotation, robot.tip_in_sensor())
            moment = contact[:, 1] - np.cross(arm, force)
            out[kernel.MOMENT1 :] = np.einsum("nij,nj->in", where.axes, moment)


def _travel(position: Array, tangents: Array) -> Array:
    """Path along both tangents (n, 2, 3) of a curved surface, from the first sample, (2, n) [m].

    The sum of the tip's steps, each along the mean of the tangents at its ends: it needs no velocity, and goes on
    straight where samples are missing.
    """
    out = np.full((2, len(position)), np.nan)
    rows = np.flatnonzero(np.isfinite(position.sum(axis=1)))
    if len(rows):
        between = 0.5 * (tangents[rows[1:]] + tangents[rows[:-1]])
        steps = np.einsum("nij,nj->in", between, np.diff(position[rows], axis=0))
        out[:, rows] = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
    return out


def _unwritten(rows: Array) -> Array:
    """The same rows, not to be written to: the kernel is compiled once for what may be written and what may not."""
    view = rows.view()
    view.flags.writeable = False
    return view
