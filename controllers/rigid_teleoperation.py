"""Simulated teleoperation in six degrees of freedom: a push that turns and moves along, held, by any method.

The line of `kinid.controllers.teleoperator` along and about all axes (see `kinid.controllers._rigid_line`): poses and
wrenches cross it as packets, or waves of all twists. An observer keeps an account an axis, a tank is one for all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import is_number, is_positive, numbers
from kinid.controllers.teleoperation import REST, compiled_line, push
from kinid.controllers.teleoperator import METHODS, Environment, Teleoperator, checked_method
from kinid.errors import InputError

Array = NDArray[np.float64]

#: how far the push goes along the surface [m], and turns about both tangents and the normal [rad]
ALONG, TURNED = 0.01, (0.0, 0.1, 0.05)


@dataclass(frozen=True)
class Tool:
    """What master and slave hold alike.

    Args:
        tip: from the point that is held, in the tool's axes [m]. lever: ℓ by which a mass m, a stiffness and a damping
            along an axis are m ℓ², … about it [m]. friction: coefficient of the material, and of its map.

    Raises:
        InputError: a tip that isn't three numbers, a lever that isn't positive, or a negative coefficient.
    """

    tip: tuple[float, float, float] = (0.0, 0.0, -0.1)
    lever: float = 0.1
    friction: float = 0.8

    def __post_init__(self) -> None:
        numbers(self.tip, (3,), "a tip", "give x, y, z from the point that is held [m]")
        if not is_positive(self.lever):
            raise InputError(
                f"a lever of {self.lever!r} m", "a positive one", "the tool's radius of gyration is a good one"
            )
        if not (is_number(self.friction) and self.friction >= 0):
            raise InputError(f"friction {self.friction!r}", "a coefficient, 0 or more", "see the map, or a data sheet")


class RigidMotion(NamedTuple):
    """A simulated push; arrays (n,) or (n, 6): t [s], poses of master and slave (position [m], rotation vector [rad]),
    tips (n, 3) [m], wrench felt [N, N·m].

    depth: of the master's tip [m]. normal_force: of the material [N]. port_energy: that the rendered wrench took up at
    the master's port so far, all axes [J]. stable: whether the master comes to rest about all axes.
    """

    t: Array
    master: Array
    slave: Array
    master_tip: Array
    slave_tip: Array
    wrench: Array
    depth: Array
    normal_force: Array
    port_energy: Array
    stable: bool

    @property
    def stiffness(self) -> float:
        """That the operator feels at rest, normal force over depth in the last quarter [N/m]; NaN out of contact."""
        rows = slice(3 * len(self.t) // 4, None)
        depth = float(self.depth[rows].mean())
        return float(self.wrench[rows, 2].mean()) / depth if depth > 0.0 else float("nan")

    def tracking(self, delay: float) -> float:
        """How far the slave's tip is from where the master's was a delay [s] before, rms [m]."""
        late = round(delay / (self.t[1] - self.t[0]))
        way = self.slave_tip[late:] - self.master_tip[: len(self.t) - late]
        return float(np.sqrt(np.mean(np.sum(way**2, axis=1))))


def simulate_rigid(
    teleoperator: Teleoperator,
    environment: Environment,
    method: str = "direct",
    believed: Environment | None = None,
    tool: Tool | None = None,
    depth: float = 0.01,
    duration: float = 12.0,
) -> RigidMotion:
    """The operator pushes as in `kinid.controllers.simulate`, and moves along and turns the tool by `ALONG`, `TURNED`.

    Raises:
        InputError: see `kinid.controllers.simulate`.
    """
    from scipy.spatial.transform import Rotation

    from kinid.controllers import _rigid_line

    tool, number = tool or Tool(), METHODS.index(checked_method(method))
    t, inwards = push(teleoperator, depth, duration)
    path = _path(tool, inwards, depth, teleoperator.period)
    out = np.empty((len(t), 22))
    forth, back = (
        teleoperator.network.schedule(len(t), teleoperator.delay, teleoperator.period, way) for way in (0, 1)
    )
    body = _rigid_line.Body(tool.lever, np.array(tool.tip, dtype=float), tool.friction)
    line = compiled_line(teleoperator, environment, believed or environment)
    _rigid_line.run(line, body, forth, back, number, path, out)
    master, slave = out[:, :6], out[:, 6:12]
    at_rest = np.ptp(master[3 * len(t) // 4 :] * np.repeat([1.0, tool.lever], 3), axis=0) < REST * (depth + 0.005)
    finite = np.asarray(np.isfinite(out).all(axis=1))
    turned = [
        pose[:, :3] + Rotation.from_rotvec(np.where(finite[:, None], pose[:, 3:], 0.0)).apply(tool.tip)
        for pose in (master, slave)
    ]
    stable = bool(finite.all() and at_rest.all())
    return RigidMotion(
        t, master, slave, turned[0], turned[1], out[:, 12:18], out[:, 18], out[:, 21], out[:, 20], stable
    )


def _path(tool: Tool, inwards: Array, depth: float, period: float) -> Array:
    """Where the hand wants the tool, states (n, 13): position, quaternion (w, x, y, z), twist."""
    from scipy.spatial.transform import Rotation

    share = (inwards - inwards[0]) / (depth - inwards[0])
    turn = Rotation.from_rotvec(share[:, None] * np.array(TURNED))
    tip = np.stack([share * ALONG, 0.0 * share, -inwards], axis=1)
    position = tip - turn.apply(tool.tip)
    twist = np.gradient(np.hstack([position, share[:, None] * np.array(TURNED)]), period, axis=0)
    return np.ascontiguousarray(np.hstack([position, np.roll(turn.as_quat(), 1, axis=1), twist]))
