"""A scripted experiment: the LWR4+ follows a tip path exactly, and the sensors see it with their faults.

No controller and no joint elasticity act here; the material is a Kelvin-Voigt half-space with Coulomb friction.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import KinidError
from kinid.lab.protocol import minimum_jerk
from kinid.lab.sensors import RESOLUTION
from kinid.robotics.inverse_dynamics import inverse_dynamics
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load
from kinid.writers import write_table, write_text

Array = NDArray[np.float64]

RATE = 500.0  # [Hz]
RIG = """\
[robot]
model = "lwr4plus"

[tool]                        # everything beyond the sensor's measuring plane
mass = 0.24
com = [0.0, 0.0, 0.049]

[surface]
point = [0.55, 0.0, 0.10]
normal = [0, 0, 1]
tangent = [1, 0, 0]

[sensor]                      # ATI Mini40, SI-40-2
range = [40, 40, 120, 2, 2, 2]
noise = [0.015, 0.015, 0.029, 0.0005, 0.0006, 0.0003]
"""
#: steps of the joint encoders on the link side [rad]
ENCODER = 2e-6
#: shear stiffness of the contact until it slides [N/m]
SHEAR = 8000.0
#: a posture with the elbow up and the tool pointing down, near the surface [rad]
START = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])


@dataclass(frozen=True)
class Material:
    """Kelvin-Voigt half-space with Coulomb friction: stiffness [N/m], damping [N·s/m], friction coefficient [1]."""

    stiffness: float = 732.0
    damping: float = 9.9
    friction: float = 0.45


@dataclass(frozen=True, eq=False)
class Scripted:
    """A log with its rig, and the truth that no estimator may see."""

    log: Log
    contact_force: Array  # (n, 3) on the tool, contact frame: tangent1, tangent2, normal [N]
    depth: Array  # (n,) [m]
    bias: Array  # (6,)
    material: Material

    def write(self, folder: Path) -> Path:
        """Write `log.parquet` and `rig.toml` into the folder, the truth into a folder of its own; the log's path."""
        (folder / "truth").mkdir(parents=True, exist_ok=True)
        log = self.log
        columns = {"t": log.t}
        for name, values in (("q", log.q), ("tau", log.tau)):
            if values is not None:
                columns |= {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}
        if log.wrench is not None:
            columns |= {name: log.wrench[:, i] for i, name in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))}
        write_table(folder / "log.parquet", {**columns, "phase": np.asarray(log.phase)}, log.provenance.to_dict())
        write_text(folder / "rig.toml", RIG)
        write_text(
            folder / "truth" / "truth.json",
            json.dumps(
                {"material": vars(self.material), "bias": self.bias.tolist(), "deepest": float(self.depth.max())}
            )
            + "\n",
        )
        return folder / "log.parquet"


def scripted_poke(seed: int = 0, material: Material | None = None) -> Scripted:
    """Turn in the air, approach, hold, poke, slide and retract: 15 s at 500 Hz, by seed.

    Args:
        seed: of noise, bias and joint friction.
        material: what is touched.
    """
    material, rng = material or Material(), np.random.default_rng(seed)
    rig = Rig.parse_text(RIG)
    robot = Robot.load(rig)
    if rig.tool is None or rig.axes is None or rig.surface is None or rig.surface.point is None:
        raise KinidError("the experiment's own rig lacks a table")
    t, phase, offset, tilt = _script()
    axes = rig.axes  # rows tangent1, tangent2, normal
    targets = np.asarray(rig.surface.point) + offset @ axes
    q = follow(robot, targets, tilt)
    dq = np.gradient(q, t, axis=0, edge_order=2)
    ddq = np.gradient(dq, t, axis=0, edge_order=2)

    tip = robot.kinematics("tool_tip", q, dq, ddq)
    inside = (tip.position - np.asarray(rig.surface.point)) @ axes.T
    speed = tip.velocity @ axes.T
    depth = -inside[:, 2]
    touching = depth > 0
    normal = np.where(touching, np.maximum(0.0, material.stiffness * depth - material.damping * speed[:, 2]), 0.0)
    contact = np.column_stack([_stick_and_slip(speed[:, :2], normal, material.friction), normal])

    sensor = robot.kinematics("ft_sensor", q, dq, ddq)
    force = np.einsum("nji,nj->ni", sensor.rotation, contact @ axes)
    clean = tool_load(rig.tool, sensor, robot.gravity)
    clean[:, :3] += force
    clean[:, 3:] += np.cross(robot.tip_in_sensor(), force)
    bias = rng.normal(scale=[0.5, 0.5, 1.0, 0.02, 0.02, 0.01])
    noise = rng.normal(scale=np.asarray(rig.sensor.noise), size=clean.shape)
    wrench = np.round((clean + bias + noise) / RESOLUTION) * RESOLUTION
    # link-side joint friction and torque offsets, of the size that free motion of a real LWR4+ shows
    friction = rng.uniform(0.2, 0.8, 7) * np.tanh(dq / 0.01)
    tau = inverse_dynamics(robot, q, dq, ddq, clean) + friction + rng.normal(scale=0.4, size=7)
    tau += rng.normal(scale=0.05, size=tau.shape)
    log = Log(t, q=np.round(q / ENCODER) * ENCODER, tau=tau, wrench=wrench, phase=phase)
    return Scripted(log.replace("scripted experiment", {"seed": seed}), contact, depth, bias, material)


def _script() -> tuple[Array, NDArray[np.str_], Array, Array]:
    """Time, phase, tip position from the surface's point in contact-frame axes (n, 3) [m], and tilt (n, 2) [rad]."""
    parts = (
        ("free", 3.0),
        ("approach", 1.5),
        ("hold", 1.0),
        ("poke", 4.0),
        ("slide", 3.0),
        ("retract", 1.5),
        ("rest", 1.0),
    )
    n = int(sum(length for _, length in parts) * RATE)
    t = np.arange(n) / RATE
    offset, tilt, phase = np.zeros((n, 3)), np.zeros((n, 2)), np.empty(n, dtype="<U8")
    start, height, along = 0.0, 0.03, 0.0
    for name, length in parts:
        rows = (t >= start - 1e-9) & (t < start + length - 1e-9)
        u = t[rows] - start
        s = minimum_jerk(u / length)
        phase[rows] = name
        z, x = np.full(u.shape, height), np.full(u.shape, along)
        if name == "free":  # turns the tool, so that gravity shows weight and bias apart
            fade = np.sin(np.pi * u / length) ** 2
            tilt[rows, 0], tilt[rows, 1] = 0.35 * fade * np.sin(4.2 * u), 0.35 * fade * np.cos(4.2 * u)
        elif name == "approach":
            z = height + s * (-0.004 - height)
        elif name == "poke":
            fade = np.minimum(1.0, np.minimum(u, length - u) / 0.3)
            z = height - fade * (0.0015 * np.sin(2 * np.pi * 0.9 * u) + 0.0008 * np.sin(2 * np.pi * 4.0 * u))
        elif name == "slide":
            x = 0.02 * np.sin(np.pi * s) + 0.01 * np.sin(2 * np.pi * s)
        elif name == "retract":
            z = height + s * (0.03 - height)
        offset[rows, 2], offset[rows, 0] = z, x
        height, along, start = z[-1], x[-1], start + length
    return t, phase, offset, tilt


def _stick_and_slip(speed: Array, normal: Array, coefficient: float) -> Array:
    """Friction of a tangential spring that slides where it would pull more than μ N (Hayward & Armstrong 2000), (n,
    2).
    """
    out, stretch = np.zeros_like(speed), np.zeros(2)
    for i in range(1, len(speed)):
        stretch = stretch + speed[i] / RATE
        most = coefficient * normal[i] / SHEAR
        size = float(np.hypot(*stretch))
        if size > most:
            stretch = stretch * (most / size)
        out[i] = -SHEAR * stretch
    return out


def follow(robot: Robot, targets: Array, tilt: Array) -> Array:
    """Joints that put the tip at each target with the tool pointing down, tilted about x and y; Newton's method."""
    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId(robot.tip_frame)
    q, out = START.copy(), np.empty((len(targets), model.nv))
    down = np.diag([-1.0, 1.0, -1.0])
    for i, target in enumerate(targets):
        goal = pin.SE3(pin.rpy.rpyToMatrix(tilt[i, 0], tilt[i, 1], 0.0) @ down, target)
        for _ in range(60):
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacement(model, data, frame)
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            error = pin.log6(data.oMf[frame].actInv(goal)).vector
            if np.abs(error).max() < 1e-12:
                break
            q = q + np.linalg.lstsq(jacobian, error, rcond=None)[0]
        else:
            raise KinidError("the script leaves the arm's reach")
        out[i] = q
    return out
