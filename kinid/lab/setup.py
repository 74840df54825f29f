"""A virtual experiment: what stands where, what is true, what the rig says; and what a run leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log, Provenance
from kinid.data.rig import Rig, ToolSpec, surface_axes
from kinid.lab import sensors
from kinid.lab.arm import Arm, Gains, Joints, lwr4plus_joints
from kinid.lab.feasible import check
from kinid.lab.loop_experiment import Loop, Motion
from kinid.lab.materials import Material
from kinid.lab.protocol import Script
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: a posture of the LWR4+ with the elbow up and the tool pointing down [rad]
ELBOW_UP = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])
#: rows of a log are every so many control periods apart
LOG_EVERY = 2


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that a run needs.

    Attributes:
        script: set-points. material: touched. gains: of the impedance. joints: drives.
        point, normal, tangent: of the surface as the rig states it, base frame. tool: as the rig states it.
        true_tool, true_tip, surface_offset, surface_slope, payload: what is true beyond the rig: the tool; displacement
            of the tip in its axes [m]; how far the surface lies further out [m] and how it rises along the tangents; a
            load between arm and sensor.
        gravity_error: true gravity less the rig's, base frame [m/s²]; the arm's own gravity compensation knows it.
        sensor, joint_sensors: with their faults. known_crosstalk, known_bias: what the sensor's calibration sheet and
            the reading without load, and so the rig, say.
        wrench_stream, joint_stream: how they are logged in a bag. known_clock_offset: what the rig adds to the wrench's
            stamps [s].
        extra_force: beside the material's own law, of a motion, along tangent1, tangent2, normal [N], (n, 3); sensor
            and truth have it, the arm doesn't feel it.
        seed: of all noise.
    """

    script: Script
    material: Material
    gains: Gains = Gains()
    joints: Joints = field(default_factory=lwr4plus_joints)
    point: tuple[float, float, float] = (0.55, 0.0, 0.10)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    tangent: tuple[float, float, float] = (1.0, 0.0, 0.0)
    tool: ToolSpec = ToolSpec(mass=0.24, com=(0.0, 0.0, 0.049))
    true_tool: ToolSpec | None = None
    true_tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
    surface_offset: float = 0.0
    surface_slope: tuple[float, float] = (0.0, 0.0)
    payload: ToolSpec | None = None
    gravity_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sensor: sensors.Sensor = field(default_factory=sensors.Sensor)
    known_crosstalk: Array = field(default_factory=lambda: np.zeros((6, 6)))
    known_bias: Array = field(default_factory=lambda: np.zeros(6))
    joint_sensors: sensors.JointSensors = sensors.JointSensors()
    wrench_stream: sensors.StreamSpec = sensors.StreamSpec()
    joint_stream: sensors.StreamSpec = sensors.StreamSpec(every=LOG_EVERY)
    known_clock_offset: float = 0.0
    model: str = "lwr4plus"
    extra_force: Callable[[Motion], Array] | None = None
    seed: int = 0

    def replace(self, **changes: object) -> Setup:
        """The same with other parts."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    @cached_property
    def rig(self) -> Rig:
        """What the experimenter believes."""
        surface = {"point": self.point, "normal": self.normal, "tangent": self.tangent}
        sensor = {
            "range": tuple(sensors.RANGE),
            "noise": tuple(sensors.NOISE),
            "bias": tuple(self.known_bias),
            "crosstalk": tuple(map(tuple, np.eye(6) + self.known_crosstalk)),
        }
        return Rig.parse(
            {
                "robot": {"model": self.model},
                "tool": self.tool,
                "surface": surface,
                "sensor": sensor,
                "streams": {"wrench_clock_offset": self.known_clock_offset},
            }
        )

    @cached_property
    def robot(self) -> Robot:
        """Of the rig."""
        return Robot.load(self.rig)

    @cached_property
    def axes(self) -> Array:
        """Rows tangent1, tangent2, normal of the rig's surface."""
        return surface_axes(self.normal, self.tangent)

    @cached_property
    def true_axes(self) -> Array:
        """Those of the surface as it is."""
        t1, t2, n = self.axes
        a, b = self.surface_slope
        return surface_axes(n - a * t1 - b * t2, t1 + a * n)

    @cached_property
    def arm(self) -> Arm:
        """The arm as it is, to the tip as it is."""
        load = self.true_tool or self.tool
        load = load if self.payload is None else together(load, self.payload)
        arm = Arm.pack(self.robot, load).moved_tip(np.asarray(self.true_tip))
        return dataclasses.replace(arm, gravity=arm.gravity + np.asarray(self.gravity_error))

    @cached_property
    def start(self) -> Array:
        """Joints from which the search for a path begins: the elbow up, turned towards the surface."""
        q = ELBOW_UP.copy() if self.robot.joint_count == len(ELBOW_UP) else 0.5 * (self.robot.lower + self.robot.upper)
        q[0] = np.arctan2(self.point[1], self.point[0])
        return q

    def check(self) -> Array:
        """Refuse what can't work; the joints at the first set-point, (N,). See `kinid.lab.feasible.check`."""
        return check(self)

    def run(self, progress: Callable[[float], None] | None = None) -> Result:
        """Check, run the loop, and read the sensors.

        Args:
            progress: called with the share of the loop that is done, 0…1, now and then.

        Raises:
            InputError: see `check`.
        """
        q0 = self.check()
        positions, rotations = self.script.poses(self.axes, np.asarray(self.point))
        true_point = np.asarray(self.point) + self.surface_offset * self.axes[2]
        loop = Loop(self.arm, self.joints, self.gains, self.true_axes, true_point)
        motion = loop.run(q0, positions, rotations, self.material, progress=progress)
        return self.observe(motion)

    def observe(self, motion: Motion) -> Result:
        """What the sensors make of a motion; by the seed."""
        if self.extra_force is not None:
            motion = dataclasses.replace(motion, force=motion.force + self.extra_force(motion))
        streams = np.random.default_rng(np.random.SeedSequence([self.seed, 1])).spawn(3)
        tip = self.robot.tip_in_sensor() + self.arm_tip_offset
        clean = sensors.load_on_sensor(
            motion, self.robot, self.arm.columns, self.true_tool or self.tool, self.true_axes, tip, self.arm.gravity
        )
        wrench = self.sensor.read(clean, motion.t, streams[0])
        order = np.argsort(self.arm.columns)
        q, dq, ddq, tau = (
            np.ascontiguousarray(part[:, order]) for part in (motion.q, motion.dq, motion.ddq, motion.tau)
        )
        q, tau = self.joint_sensors.read(q, dq, ddq, tau, streams[1])
        return Result(self, motion, clean, wrench, q, tau)

    @property
    def arm_tip_offset(self) -> Array:
        """Displacement of the tip in the sensor's axes [m]."""
        sensor, tip = (
            self.robot.frame(name or "").placement for name in (self.robot.sensor_frame, self.robot.tip_frame)
        )
        out: Array = (sensor.inverse() * tip).rotation @ np.asarray(self.true_tip)
        return out


@dataclass(frozen=True, eq=False)
class Result:
    """What a run has left: the truth, and what the sensors saw of it at every control period.

    Attributes:
        motion: the truth. clean: load on the sensor, (n, 6). wrench, q, tau: as read, joints in the log's order.
    """

    setup: Setup
    motion: Motion
    clean: Array
    wrench: Array
    q: Array
    tau: Array

    @cached_property
    def targets(self) -> tuple[Array, Array]:
        """Where the controller was told to put the tip: positions (n, 3) [m] and rotations (n, 3, 3), base frame."""
        return self.setup.script.poses(self.setup.axes, np.asarray(self.setup.point))

    @cached_property
    def log(self) -> Log:
        """On one clock, every second control period."""
        t, q, tau, wrench = (
            np.ascontiguousarray(part[::LOG_EVERY]) for part in (self.motion.t, self.q, self.tau, self.wrench)
        )
        return Log(
            t,
            q=q,
            tau=tau,
            wrench=wrench,
            phase=self.setup.script.phase[::LOG_EVERY],
            provenance=Provenance("virtual laboratory").then(
                "experiment", seed=self.setup.seed, robot=self.setup.model
            ),
        )


def together(a: ToolSpec, b: ToolSpec) -> ToolSpec:
    """Two bodies as one."""
    mass = a.mass + b.mass
    ca, cb = np.asarray(a.com), np.asarray(b.com)
    com = (a.mass * ca + b.mass * cb) / mass if mass > 0 else np.zeros(3)
    total = np.zeros((3, 3))
    for body, centre in ((a, ca), (b, cb)):
        d = centre - com
        total += body.inertia_matrix + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    i = total
    return ToolSpec(mass=mass, com=tuple(com.tolist()), inertia=(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]))
