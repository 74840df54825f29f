"""Formulas of what is done to a wrench: bodies on the sensor in its measured attitude, and faults of the sensor's
axes.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from measured.changes import Draw, Shape, bias, clip, drift, hum, lag, late, lattice, one_gain
from measured.scene import Scene

Array = NDArray[np.float64]


def specific(scene: Scene) -> Array:
    """Gravity less acceleration of the sensor's origin, in its axes, by Pinocchio [m/s²], (n, 3)."""
    import pinocchio as pin

    robot = scene.robot
    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId(robot.sensor_frame)
    q = np.asarray(scene.log.q)
    still = float(np.median(np.diff(scene.log.t))) > 1.0
    v = np.zeros_like(q) if still else scene.dq
    a = np.zeros_like(q) if still else scene.smooth(scene.ddq, 5.0)
    out = np.empty((len(q), 3))
    for i, row in enumerate(zip(robot.configuration(q), robot.tangent(v), robot.tangent(a))):
        pin.forwardKinematics(model, data, *row)
        turn = pin.updateFramePlacement(model, data, frame).rotation
        moved = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
        out[i] = turn.T @ np.asarray(robot.gravity) - moved
    return out


def mass(scene: Scene, rng: np.random.Generator) -> Shape:
    """More mass at the tool's centre, as far as the rig knows it."""
    tool = scene.rig.tool
    f = specific(scene)
    return Shape(
        np.hstack([f, np.cross(np.zeros(3) if tool is None else tool.com, f)])[None], rng.choice([-1.0, 1.0], 1)
    )


def centre(scene: Scene, rng: np.random.Generator) -> Shape:
    """A centre of the tool's weight that is elsewhere."""
    f = specific(scene)
    columns = np.array([np.hstack([np.zeros_like(f), np.cross(np.eye(3)[i], f)]) for i in range(3)])
    return Shape(columns, rng.uniform(0.4, 1.0, 3) * rng.choice([-1.0, 1.0], 3))


def turned(scene: Scene, rng: np.random.Generator) -> Shape:
    """A sensor that sits turned in its mount, to first order."""
    y = scene.readings
    columns = np.array([np.hstack([np.cross(y[:, :3], e), np.cross(y[:, 3:], e)]) for e in np.eye(3)])
    return Shape(columns, rng.uniform(0.4, 1.0, 3) * rng.choice([-1.0, 1.0], 3))


def coupled(scene: Scene, rng: np.random.Generator) -> Shape:
    """Some channels that copy others, in units of what is left in them."""
    y, pairs = scene.readings, list(itertools.permutations(range(6), 2))
    columns = np.zeros((len(pairs), *y.shape))
    for row, (to, of) in zip(columns, pairs):
        row[:, to] = y[:, of] * scene.left[to] / max(float(np.sqrt(np.mean(y[:, of] ** 2))), 1e-12)
    weights = np.zeros(len(pairs))
    few = rng.choice(len(pairs), 4, replace=False)
    weights[few] = rng.uniform(0.5, 1.0, 4) * rng.choice([-1.0, 1.0], 4)
    return Shape(columns, weights, note=f"(to, of) {[pairs[i] for i in few]}")


_BODY: dict[str, Draw] = {"tool-mass": mass, "tool-com": centre, "sensor-bias": bias}
POSES: dict[str, Draw] = {**_BODY, "sensor-gain": one_gain, "sensor-misalignment": turned, "sensor-crosstalk": coupled}
TURNING: dict[str, Draw] = {
    **POSES,
    "sensor-drift": drift,
    "time-offset": late,
    "sensor-lag": lag,
    "quantization": lattice,
    "saturation": clip,
    "mains-hum": hum,
}
#: the controller takes off what it knows of the tool: nothing is left that gains, clocks or axes could act on
BAG: dict[str, Draw] = {**_BODY, "sensor-drift": drift, "quantization": lattice, "mains-hum": hum}
