"""Formulas of what is done to joint torques, from measured positions and rates; weights of bodies by Pinocchio's
RNEA.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from measured.changes import Draw, Shape, bias, by_channel, clip, drift, gain, hum, lag, late, lattice
from measured.scene import Scene

Array = NDArray[np.float64]


def viscous(scene: Scene, rng: np.random.Generator) -> Shape:
    """Torque in proportion to the speed."""
    return by_channel(scene, scene.dq, rng, signed=False)


def dry(scene: Scene, rng: np.random.Generator) -> Shape:
    """Torque of the direction alone."""
    return by_channel(scene, scene.turn, rng, signed=False)


def one_sided(scene: Scene, rng: np.random.Generator) -> Shape:
    """Viscous friction in one direction alone: half of it is the same both ways."""
    way = rng.choice([-1.0, 1.0], scene.dq.shape[1])
    return by_channel(scene, scene.dq + way * np.abs(scene.dq), rng, signed=False)


def slow(scene: Scene, rng: np.random.Generator) -> Shape:
    """Friction that falls with the speed (Stribeck), within some percents of the greatest."""
    share = float(rng.uniform(0.05, 0.25))
    fast = np.abs(scene.dq).max(axis=0)
    note = f"within {share:.2g} of the top speed"
    return by_channel(scene, scene.turn * np.exp(-((scene.dq / (share * fast)) ** 2)), rng, signed=False, note=note)


def loaded_friction(scene: Scene, rng: np.random.Generator) -> Shape:
    """Friction that grows with the torque that is transmitted."""
    return by_channel(scene, scene.turn * np.abs(scene.smooth(scene.readings, 10.0)), rng, signed=False)


def rotor(scene: Scene, rng: np.random.Generator) -> Shape:
    """Torque in proportion to the acceleration."""
    return by_channel(scene, scene.ddq, rng, signed=False)


def spring(scene: Scene, rng: np.random.Generator) -> Shape:
    """Torque in proportion to the angle: a balancer, a bundle of cables. Where it is at rest is the offset's."""
    q = np.asarray(scene.log.q)
    return by_channel(scene, q - q.mean(axis=0), rng, signed=False)


def ripple(scene: Scene, rng: np.random.Generator) -> Shape:
    """A sine of some turns a turn of the joint, and a third of it at twice as many."""
    q, k = np.asarray(scene.log.q), int(rng.integers(4, 25))
    if scene.source.name.startswith("drive"):
        k = int(rng.integers(300, 3000))  # a screw's turns: 20 to 2 mm a period
    phase = rng.uniform(0, 2 * np.pi, q.shape[1])
    return by_channel(
        scene, np.sin(k * q + phase) + 0.3 * np.sin(2 * k * q - phase), rng, signed=False, note=f"{k} a turn"
    )


def elastic(scene: Scene, rng: np.random.Generator) -> Shape:
    """Joints that wind up: the second derivative of the rigid torque (of an axis alone, of its acceleration)."""
    slow = min(25.0, scene.band)
    torque = rigid(scene) if scene.source.family == "arm" else scene.smooth(scene.ddq, slow)
    return by_channel(scene, -scene.rate(scene.rate(torque, slow), slow), rng, signed=False)


def payload(scene: Scene, rng: np.random.Generator) -> Shape:
    """A body behind the last link: columns per kg and per kg·m."""
    end = _end(scene)
    still = (0.0, 0.0, 0.0)
    columns = [rigid(scene, (end, 1.0, still)) - rigid(scene)]
    # linear in mass and first moment: a body of 1 kg whose centre is moved, without the inertia that it then has
    # (Steiner)
    columns += [rigid(scene, (end, 1.0, tuple(0.1 * np.eye(3)[i]))) - rigid(scene, (end, 1.0, still)) for i in range(3)]
    return Shape(
        np.array(columns), np.array([1.0, *rng.uniform(-1.0, 1.0, 3)]), signed=False, note="a body behind the last link"
    )


def gravity(scene: Scene, rng: np.random.Generator) -> Shape:
    """A base that stands askew: gravity's torques of a unit across the vertical."""
    columns = np.array([rigid(scene, gravity=np.eye(3)[i]) for i in range(3)])
    turn = rng.uniform(0, 2 * np.pi)
    return Shape(columns, np.array([np.cos(turn), np.sin(turn), 0.0]), note=f"tilted about {np.rad2deg(turn):.0f}°")


def _end(scene: Scene) -> int:
    """The last joint that the log holds."""
    return int(scene.robot.model.njoints - 1)


def rigid(
    scene: Scene, body: tuple[int, float, tuple[float, ...]] | None = None, gravity: Array | None = None
) -> Array:
    """Rigid-body torques of the measured motion (n, N); with a point mass on a joint, or of a gravity alone, at
    rest.
    """
    import pinocchio as pin

    robot, model = scene.robot, scene.robot.model
    if body is not None:
        model = model.copy()
        model.appendBodyToJoint(body[0], pin.Inertia(body[1], np.array(body[2]), np.zeros((3, 3))), pin.SE3.Identity())
    if gravity is not None:
        model = model.copy()
        model.gravity = pin.Motion(np.asarray(gravity), np.zeros(3))
    data = model.createData()
    q, v, a = (np.asarray(x) for x in (scene.log.q, scene.dq, scene.smooth(scene.ddq)))
    if gravity is not None:
        v, a = np.zeros_like(v), np.zeros_like(a)
    rows = zip(robot.configuration(q), robot.tangent(v), robot.tangent(a))
    torque = np.array([pin.rnea(model, data, *row) for row in rows])
    # robot.tangent puts the log's joints where the model has them; back by the same way
    order = np.argmax(robot.tangent(np.eye(q.shape[1])), axis=1)
    return np.asarray(torque[:, order])


_SENSOR: dict[str, Draw] = {
    "time-offset": late,
    "sensor-lag": lag,
    "quantization": lattice,
    "saturation": clip,
    "sensor-drift": drift,
    "mains-hum": hum,
}
_FRICTION: dict[str, Draw] = {
    "joint-viscous-friction": viscous,
    "joint-coulomb-friction": dry,
    "joint-friction-asymmetry": one_sided,
    "joint-torque-offset": bias,
    "joint-stribeck-friction": slow,
    "joint-load-friction": loaded_friction,
    "joint-spring": spring,
    "joint-torque-ripple": ripple,
}
LEG: dict[str, Draw] = {**_FRICTION, "joint-torque-gain": gain, **_SENSOR}
AXIS: dict[str, Draw] = {**_FRICTION, "joint-elasticity": elastic, **_SENSOR}
ARM: dict[str, Draw] = {
    **_FRICTION,
    "joint-elasticity": elastic,
    "rotor-inertia": rotor,
    "joint-torque-gain": gain,
    "payload": payload,
    "gravity-error": gravity,
    **_SENSOR,
}
