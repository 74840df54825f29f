"""Which other reading of the joints' columns, by unit, sign or order, gravity in free motion asks for."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kinid.robotics.motion import SLACK
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: another reading is named where it leaves this share of what the present one does, and this one of the force's
#: changes; with those that come within this factor of it
BETTER, LEFT, CLEARLY = 0.1, 0.3, 2.0
#: samples that tell; and rms of the weight's turning, as a share of gravity
ROWS, TURNING = 300, 0.05
#: factors of positions whose unit is another, and that unit
UNITS = ((2 * np.pi, "rev"), (np.pi / 180.0, "deg"), (180.0 / np.pi, "rad"), (1e-3, "mrad"))


def joints_meant(q: Array, force: Array, robot: Robot) -> tuple[str, float] | None:
    """What is to be said in the rig of the joints' columns, and what that leaves of the force a sample [N²]; None for
    nothing.

    Args:
        q: positions in free motion as they are read, (n, N). force: there, in sensor axes, of any bias [N], (n, 3).
        robot: with a sensor frame.
    """
    rows = slice(None, None, 1 + len(q) // ROWS)
    q, force = q[rows], force[rows] - force[rows].mean(axis=0)
    whole = float(np.sum(force**2))
    as_is = _left(q, force, robot)
    if as_is < LEFT * whole:  # as they are, they explain most of it
        return None
    limit = min(BETTER * as_is, LEFT * whole)
    tried = [(_left(other, force, robot), say) for other, say in _others(q) if _reachable(other, robot)]
    found = sorted(one for one in tried if one[0] < limit)
    if not found:
        return None
    least = found[0][0]
    alike = [say for left, say in found if left < CLEARLY * max(least, 1e-12 * whole)]
    return (" or ".join(alike[:2]) + (" or another order or sign" if len(alike) > 2 else "")), least / len(q)


def _left(q: Array, force: Array, robot: Robot) -> float:
    """What a multiple of the weight leaves of the force, both without means [N²]; infinity where nothing turns."""
    weight = np.einsum("nji,j->ni", robot.kinematics(robot.sensor_frame or "", q).rotation, robot.gravity)
    weight -= weight.mean(axis=0)
    size, length = float(np.sum(weight**2)), float(np.linalg.norm(robot.gravity))
    if size < len(q) * (TURNING * length) ** 2:
        return np.inf
    return float(np.sum(force**2)) - max(float(np.sum(force * weight)), 0.0) ** 2 / size


def _reachable(q: Array, robot: Robot) -> bool:
    return bool((q >= robot.lower - SLACK).all() and (q <= robot.upper + SLACK).all())


def _others(q: Array) -> Iterator[tuple[Array, str]]:
    """Other readings of positions (n, N), and what says so in [columns] or [robot]."""
    count = q.shape[1]
    for factor, unit in UNITS:
        yield q * factor, f'q = {{ unit = "{unit}" }}'
    yield -q, "q = { scale = -1 }"
    yield q[:, ::-1], "the columns of q in reversed order"
    for j in range(count):
        alone = np.arange(count) == j
        yield np.where(alone, -q, q), f"q{j + 1} = {{ scale = -1 }}"
        for factor, unit in UNITS[:3]:
            yield np.where(alone, q * factor, q), f'q{j + 1} = {{ unit = "{unit}" }}'
    for i, k in combinations(range(count), 2):
        order = np.arange(count)
        order[[i, k]] = k, i
        yield q[:, order], f"the columns of q{i + 1} and q{k + 1} exchanged"
