"""An arm that presses, slides, tilts and turns a tool behind a wrist sensor: joint positions and six channels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hidden.world.arm import Body, felt, follow, forward
from hidden.world.path import FINE, LOGGED, Path, Script
from hidden.world.protocol import Protocol, perform
from hidden.world.sensing import read
from hidden.world.strange import reading_of
from hidden.world.tester import Setup, forces

Array = NDArray[np.float64]

#: tip of the tool in the sensor frame [m], as the URDF has it
TIP = np.array([0.0, 0.0, 0.1])
#: noise of a six-axis sensor [N, N·m]
NOISE = np.array([0.015, 0.015, 0.025, 5e-4, 5e-4, 3e-4])
#: [Hz] at which the arm's dynamics are computed
DYNAMICS = 250
#: steps [rad] and noise of the joints' encoders
ENCODER, JITTER = 3e-6, 1.5e-6


@dataclass(frozen=True, eq=False)
class Wrist(Setup):
    """What is at the wrist: a tool, its tip less where the kinematics has it [m], and bodies that nobody told of."""

    bodies: tuple[Body, ...] = ()
    tip_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: Array = field(default_factory=lambda: NOISE.copy())


@dataclass(frozen=True, eq=False)
class Swing:
    """A motion of the arm, and the surface it was made for.

    Attributes:
        path: as asked for, at the fine rate. joints: over time. point (3,), axes: rows tangents, normal of the surface.
        q (n, 7), rotation (n, 3, 3), position (n, 3): of the tip, at the log's rate.
    """

    path: Path
    joints: CubicSpline
    point: Array
    axes: Array
    q: Array
    rotation: Array
    position: Array

    @cached_property
    def t(self) -> Array:
        """Times of the log [s]."""
        return self.path.t[self.path.logged]

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Tip along tangents and into the material (n, 3), rotation from sensor to tangents and normal, at the fine
        rate.
        """
        place = (self.position - self.point) @ (self.axes * [[1.0], [1.0], [-1.0]]).T
        turn = CubicSpline(self.t, (self.axes @ self.rotation).reshape(-1, 9))(self.path.t)
        return CubicSpline(self.t, place)(self.path.t), turn.reshape(-1, 3, 3)

    def tip(self, error: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
        """Place of a point of the tool near its tip along tangents and into the material at the fine rate, (n, 3)."""
        place, turn = self.fine
        if not any(error):
            return place
        away = turn.reshape(-1, 3) @ np.asarray(error)
        out: Array = place + away.reshape(-1, 3) * [1.0, 1.0, -1.0]
        return out

    def into_sensor(self, contact: Array, tip: Array) -> Array:
        """Wrench in the sensor frame (n, 6) of forces along tangents and normal (n, 3), at either rate."""
        turn = self.fine[1] if len(contact) == len(self.path) else self.fine[1][self.path.logged]
        out = np.empty((len(contact), 6))
        _wrench(turn, np.ascontiguousarray(contact), tip, out)
        return out


@njit(cache=True)
def _wrench(turn, contact, tip, out):
    for i in range(len(out)):
        for k in range(3):
            out[i, k] = turn[i, 0, k] * contact[i, 0] + turn[i, 1, k] * contact[i, 1] + turn[i, 2, k] * contact[i, 2]
        out[i, 3] = tip[1] * out[i, 2] - tip[2] * out[i, 1]
        out[i, 4] = tip[2] * out[i, 0] - tip[0] * out[i, 2]
        out[i, 5] = tip[0] * out[i, 1] - tip[1] * out[i, 0]


def swing_of(rng: np.random.Generator, protocol: Protocol, act: Callable[[Script, Protocol], None] = perform) -> Swing:
    """A motion over a surface that the tool meets upright in some pose that the arm is nimble in."""
    script = Script(("x", "y", "z", "rx", "ry", "rz"), rng, z=-protocol.clear)
    act(script, protocol)
    path = script.path(np.array([3e-7, 3e-7, 2e-6, 3e-6, 3e-6, 3e-6]))
    while True:
        start = np.deg2rad([rng.uniform(-120, 120), 30, 0, -90, 0, 60, 0]) + rng.uniform(-0.25, 0.25, 7)
        pose = forward(start[None])
        if np.linalg.svd(pose.jacobian[0])[1][-1] > 0.12:
            break
    tool, point = pose.rotation[0], pose.position[0]
    normal = -tool[:, 2]
    turn = rng.uniform(0, 2 * np.pi)
    tangent = np.cos(turn) * tool[:, 0] + np.sin(turn) * tool[:, 1]
    axes = np.stack([tangent, np.cross(normal, tangent), normal])
    coarse = slice(0, None, FINE // LOGGED)
    t, x = path.t[coarse], path.x[coarse]
    position = point + x[:, :2] @ axes[:2] - x[:, 2:3] * normal
    joints = follow(start, t, position, tool @ Rotation.from_rotvec(x[:, 3:]).as_matrix())
    q = joints(t)
    now = forward(q)
    return Swing(path, joints, point, axes, q, now.rotation, now.position)


def carried(bodies: tuple[Body, ...], swing: Swing) -> Array:
    """Load of bodies on the sensor at the fine rate, (n, 6)."""
    knots = swing.t[:: LOGGED // DYNAMICS]
    knots = knots if knots[-1] == swing.t[-1] else np.append(knots, swing.t[-1])
    load = felt(bodies, swing.joints(knots), swing.joints(knots, 1), swing.joints(knots, 2))
    out: Array = CubicSpline(knots, load)(swing.path.t)
    return out


def touched(setup: Wrist, swing: Swing) -> tuple[Array, Array]:
    """Contact forces at the fine rate along tangents and normal, (n, 3), and where the tip truly was, (n, 3)."""
    place = swing.tip(setup.tip_error)
    return forces(setup, swing.path.t, place), place


def readings(setup: Wrist, swing: Swing, rng: np.random.Generator, load: Array, quiet: bool = False) -> Array:
    """What the sensor logs, (samples, 6), with the load of what it carries at the fine rate (n, 6)."""
    contact, _ = touched(setup, swing)
    stream = load + swing.into_sensor(contact, TIP + setup.tip_error)
    chain = dataclasses.replace(
        setup.chain,
        late=setup.chain.late + setup.clock_error,
        bias=setup.bias_error + (0.0 if setup.chain.bias is None else setup.chain.bias),
    )
    out = read(chain, stream, swing.t, np.zeros(6) if quiet else setup.noise, rng, triples=(0, 3))
    return out if setup.strange is None else reading_of(setup.strange, swing.t, out)


def encoded(swing: Swing, rng: np.random.Generator) -> Array:
    """Joint positions as encoders read them, (n, 7)."""
    noisy = swing.q + JITTER * rng.standard_normal(swing.q.shape)
    return ENCODER * np.round(noisy / ENCODER)
