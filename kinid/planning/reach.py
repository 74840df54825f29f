"""The arm as the planner uses it: joints for poses of its tip, and torques along a motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.data.rig import ToolSpec
from kinid.errors import InputError
from kinid.planning.limits import Limits
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: weight of singularities against joint limits in the choice among redundant postures
SINGULARITY = 0.5
#: starting postures, and turns of the tool about its axis, from which a first posture is searched
SEEDS, TURNS = 12, 4
#: steps a pose may take: from afar, and along a path
FAR, NEAR = 150, 60


@dataclass(frozen=True, eq=False)
class Reach:
    """Poses to joints, motions to torques. Arrays of joints are in the log's order.

    Attributes:
        robot: with a tip frame. limits: of its joints. tool: on its sensor frame, or None.
    """

    robot: Robot
    limits: Limits
    tool: ToolSpec | None = None

    def __post_init__(self) -> None:
        if self.robot.tip_frame is None:
            raise InputError(
                f"{self.robot.name} without a tip frame", "the point that touches", "name [robot] tip_frame"
            )
        if self.robot.joint_count < 6:
            raise InputError(
                f"{self.robot.name} with {self.robot.joint_count} joints between base and tip",
                "six or more, to place and turn the tool freely",
                "plan for another arm",
            )

    @cached_property
    def packed(self) -> tuple[NDArray[np.generic], ...]:
        """Chain and inertias as the kernels take them; every joint acts along its own z axis there."""
        robot, tool, tip = self.robot, self.tool, self.robot.tip_frame or ""
        chain = robot.chain(tip)
        bodies = (robot if tool is None or tool.mass == 0.0 else robot.with_tool(tool)).bodies(tip)
        return (chain.turns, chain.shifts, chain.prismatic, *bodies, np.ascontiguousarray(robot.gravity, dtype=float))

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """For each joint of the chain its column."""
        return self.robot.chain(self.robot.tip_frame or "").columns

    def along(self, positions: Array, rotations: Array, start: Array, what: str = "the path") -> Array:
        """Joints that put the tip at each pose in turn, (n, N).

        Args:
            positions: base frame [m], (n, 3). rotations: (n, 3, 3). start: joints near the first pose, (N,).
            what: is asked for, for the message.

        Raises:
            InputError: a pose out of reach, or one that needs a joint beyond its limits, which is named.
        """
        q, status, row, _ = self._solve(start, positions, rotations, NEAR)
        if status:
            raise self._refusal(status, row, q, positions[row], what)
        jumps = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
        if len(jumps) and jumps.max() > 0.5:
            raise InputError(
                f"{what}, where {self.robot.name} has to jump from one posture to another at "
                f"({_shown(positions[int(jumps.argmax())])}) m",
                "a path clear of singularities",
                "move the surface, or turn the tool with --yaw",
            )
        return q

    def postures(self, position: Array, rotations: Array, what: str = "the place") -> Iterator[tuple[Array, int]]:
        """Postures (N,) that reach a position with one of the rotations (k, 3, 3), and which; the most comfortable
        first.

        The same poses give the same postures: starting points are drawn by a fixed seed.

        Raises:
            InputError: none, and why the nearest one fails.
        """
        lower, upper = (
            np.where(np.isfinite(v), v, s * np.pi) for v, s in ((self.limits.lower, -1.0), (self.limits.upper, 1.0))
        )
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        seeds = middle + 0.6 * half * np.random.default_rng(12).uniform(-1, 1, (SEEDS, len(middle)))
        found: list[tuple[float, Array, int]] = []
        beyond: tuple[Array, Array] | None = None
        for k, rotation in enumerate(rotations):
            for seed in seeds:
                q, status, _, cost = self._solve(seed, position[None, :], rotation[None, :, :], FAR)
                if status == 2 and beyond is None:
                    beyond = q[0], position
                if status == 0 and not any(np.abs(q[0] - other).max() < 1e-6 for _, other, _ in found):
                    found.append((float(cost[0]), q[0], k))
        if not found:
            if beyond is not None:
                raise self._refusal(2, 0, beyond[0][None, :], position, what)
            raise self._refusal(1, 0, seeds, position, what)
        yield from ((q, k) for _, q, k in sorted(found, key=lambda each: each[0]))

    def torques(self, q: Array, dq: Array, ddq: Array, force: Array) -> Array:
        """Joint torques of a motion with a force on the tip [N·m], (n, N).

        Args:
            q, dq, ddq: (n, N). force: of the material on the tip, base axes [N], (n, 3).
        """
        from kinid.planning import _kinematics as kernel

        out, c = np.empty_like(q), self.columns
        motion = (np.ascontiguousarray(part[:, c]) for part in (q, dq, ddq))
        kernel.torques(*motion, np.ascontiguousarray(force), *self.packed, out)
        back = np.empty_like(out)
        back[:, c] = out
        return back

    def _solve(self, start: Array, positions: Array, rotations: Array, patience: int) -> tuple[Array, int, int, Array]:
        from kinid.planning import _kinematics as kernel

        c = self.columns
        out, cost = np.empty((len(positions), len(c))), np.full(len(positions), np.inf)
        status, row = kernel.solve_poses(
            np.ascontiguousarray(start[c]),
            np.ascontiguousarray(positions, dtype=float),
            np.ascontiguousarray(rotations, dtype=float),
            *self.packed,
            self.limits.lower[c],
            self.limits.upper[c],
            SINGULARITY,
            patience,
            out,
            cost,
        )
        q = np.empty_like(out)
        q[:, c] = out
        return q, int(status), int(row), cost

    def _refusal(self, status: int, row: int, q: Array, position: Array, what: str) -> InputError:
        limits = self.limits
        if status == 2:
            excess = np.maximum(q[row] - limits.upper, limits.lower - q[row])
            j = int(np.argmax(excess))
            return InputError(
                f"{what} at ({_shown(position)}) m, which needs {limits.names[j]} at {q[row, j]:.3f} rad "
                f"(position limits {limits.lower[j]:.3f}, {limits.upper[j]:.3f})",
                "joints within their position limits",
                "move the surface, or turn the tool with --yaw",
            )
        return InputError(
            f"{what} at ({_shown(position)}) m, which {self.robot.name} can't reach with the tool upright on it",
            "poses within the arm's reach",
            "move the surface nearer, or make the motion smaller",
        )


def _shown(position: Array) -> str:
    return ", ".join(f"{v:.3f}" for v in position)
