"""Joint motion that is complete (positions, velocities, accelerations) and the tip's motion that follows from it."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log, Step
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.signal import Smoothed, contradictions, smooth_motion
from kinid.signal.derivative import Derivatives, Differentiator

Array = NDArray[np.float64]
T = TypeVar("T")

#: a log slower than this holds single poses: the arm stood still at each of them [s]
STATIC_PERIOD = 0.1
#: positions within this are no degrees, or too few to tell [rad]
MORE_THAN_A_TURN = 2 * np.pi + 0.1
#: an encoder counts this number of turns too many, at most; limits are kept to this [rad]
FEW_TURNS, SLACK = 2, np.deg2rad(1.0)
#: accelerations along a direction count where their mean square is so many times their error's, which is known
#: within that
MORE_THAN_NOISE = 2.0


class _Latest(Generic[T]):
    """What was made of the latest log, while that lives: contact frame, inertial loads and draws ask for the same."""

    def __init__(self) -> None:
        self._made: weakref.WeakKeyDictionary[Log, T] = weakref.WeakKeyDictionary()

    def of(self, log: Log, make: Callable[[], T]) -> T:
        """What was made of this log, or is made now."""
        made = self._made.get(log)
        if made is None:
            made = make()
            self._made.clear()
            self._made[log] = made
        return made


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint positions with both derivatives, (n, N) each, in the log's order.

    Attributes:
        facts: where they came from. warnings: where what was logged contradicts itself, a sentence each.
        smoothed: the estimate that they are, with its standard deviations; None where they are as logged or
            differentiated.
        shrinkage: what of the smoothed accelerations was kept, to be multiplied from the right, (N, N).
    """

    q: Array
    dq: Array
    ddq: Array
    facts: Mapping[str, object]
    smoothed: Smoothed | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    shrinkage: Array = field(default_factory=lambda: np.eye(0), repr=False)

    @property
    def steps(self) -> tuple[Step, ...]:
        """What was done to the log's positions, for the provenance."""
        name = "differentiate" if self.smoothed is None else "smooth"
        return (Step(name, self.facts, self.warnings),) if self.facts else ()

    @property
    def sd(self) -> tuple[Array, Array, Array]:
        """Standard deviations of q, dq and ddq, (n, N) each; 0 where nothing is known of them."""
        if self.smoothed is not None:
            q, dq, ddq = (np.asarray(sd, dtype=np.float64) for sd in self.smoothed.sd)
            return q, dq, ddq
        none = np.zeros_like(self.q)
        return none, none, none

    def draws(self, number: int) -> Iterator[JointMotion]:
        """The motion with so many samples of its own error, the same at each call; none where the error isn't known."""
        if self.smoothed is not None:
            for made in self.smoothed.draws(number):
                ddq = self.ddq + (made.second - self.smoothed.second) @ self.shrinkage
                yield replace(self, q=made.value, dq=made.first, ddq=ddq, smoothed=made)


_MOTIONS = _Latest[JointMotion]()
_OWN_MOTIONS = _Latest[dict[str, Smoothed]]()


def joint_motion(log: Log, robot: Robot, differentiator: Differentiator | None = None) -> JointMotion:
    """The joints' motion, smoothed from the log's positions and what it holds of velocities and accelerations.

    A log with a row only every 0.1 s or more, and no velocities of its own, is taken as a set of poses at rest.

    Args:
        log: with joints. robot: whose they are.
        differentiator: instead of the smoother; logged positions and derivatives are then left as they are.

    Raises:
        InputError: no joints, a count that isn't the robot's, or positions that look like degrees.
    """
    where, q = log.provenance.source, _positions(log)
    if q.shape[1] != robot.joint_count:
        raise InputError(
            f"{q.shape[1]} joints in {where}",
            f"{robot.joint_count} for {robot.name} ({', '.join(robot.joint_names)})",
            "list the log's joints in [robot] joints, or name the columns in [columns]",
        )
    _refuse_degrees(q, robot, where)
    return axes_motion(log, differentiator)


def axes_motion(log: Log, differentiator: Differentiator | None = None) -> JointMotion:
    """The same of axes without a robot."""
    q = _positions(log)
    if log.period >= STATIC_PERIOD and log.dq is None:
        still = np.zeros_like(q)
        facts = {"velocities": "zero: the log holds poses at rest"}
        return JointMotion(q, still, still if log.ddq is None else log.ddq, facts)
    if differentiator is None:
        return _MOTIONS.of(log, lambda: _smoothed(log, q))
    return _differentiated(log, q, differentiator)


def _positions(log: Log) -> Array:
    if log.q is None:
        found = f"no joint positions in {log.provenance.source}"
        raise InputError(found, "q1…qN [rad] or [m]", "name their columns in [columns] of the rig")
    return log.q


def _smoothed(log: Log, q: Array) -> JointMotion:
    """From a smoother."""
    every = max(1, round(log.joint_period / log.period))
    made = smooth_motion(log.t, q, log.pieces, log.dq, log.ddq, every)
    logged = (("positions", q), ("velocities", log.dq), ("accelerations", log.ddq))
    sources = " and ".join(name for name, values in logged if values is not None)
    warnings = contradictions(made, [f"q{j + 1}" for j in range(q.shape[1])], log.period)
    facts = {"motion": f"smoothed from {sources}", **made.facts}
    shrinkage = _beyond_noise(made.second, made.sd[2])
    return JointMotion(made.value, made.first, made.second @ shrinkage, facts, made, tuple(warnings), shrinkage)


def _beyond_noise(x: Array, sd: NDArray[np.float32]) -> Array:
    """What of smoothed accelerations (n, N) is more than their error: (N, N), to be multiplied from the right.

    Joints are smoothed one by one. Where an arm moves along few directions, its joints' accelerations along all others
    are noise alone, and a tool that weighs less would take it off readings. Each direction counts by the share 1 − 1/λ
    of its mean square that is not the error's, with λ their ratio (the positive part of W. James, C. Stein, Proc. 4th
    Berkeley Symp. 1961, axis by axis of what both are diagonal in).
    """
    variance = np.square(sd, dtype=np.float64)
    known = np.isfinite(x).all(axis=1) & np.isfinite(variance).all(axis=1) & (variance > 0.0).all(axis=1)
    if not known.any():
        return np.eye(x.shape[1])
    # samples count by their own precision: beside gaps errors are many times the usual ones
    usual = np.median(variance[known], axis=0)
    weight = 1.0 / np.max(variance[known] / usual, axis=1)
    noise = np.sqrt(np.average(variance[known], axis=0, weights=weight))
    scaled = x[known] / noise * np.sqrt(weight / np.mean(weight))[:, None]
    ratio, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
    share = np.where(ratio > MORE_THAN_NOISE, 1.0 - 1.0 / np.maximum(ratio, 1.0), 0.0)
    out: Array = (axes * share) @ axes.T * (noise / noise[:, None])
    return out


def own_motion(log: Log, differentiator: Differentiator | None) -> Iterator[tuple[str, str, Smoothed | Derivatives]]:
    """Depth and slips that a log holds, each with the name of its rate, smoothed by themselves or differentiated."""
    kept: dict[str, Smoothed] = _OWN_MOTIONS.of(log, dict)
    for name, rate in (("depth", "depth_rate"), ("slip1", "slip_rate1"), ("slip2", "slip_rate2")):
        if name not in log.contact:
            continue
        column = np.ascontiguousarray(log.contact[name][:, None])
        if differentiator is not None:
            yield name, rate, differentiator(log.t, column, log.pieces)
            continue
        if name not in kept:
            logged = log.contact.get(rate)
            kept[name] = smooth_motion(log.t, column, log.pieces, None if logged is None else logged[:, None])
        yield name, rate, kept[name]


def _differentiated(log: Log, q: Array, differentiator: Differentiator) -> JointMotion:
    """Positions and derivatives as logged, and those that the log lacks from a differentiator."""
    if log.dq is not None and log.ddq is not None:
        return JointMotion(q, log.dq, log.ddq, {})
    made = differentiator(log.t, q if log.dq is None else log.dq, log.pieces)
    facts = {"bandwidth_hz": made.bandwidth, "window_samples": made.window}
    if log.dq is not None:
        return JointMotion(q, log.dq, made.first, {"accelerations": "derivative of the logged velocities", **facts})
    ddq, source = (made.second, "second derivative") if log.ddq is None else (log.ddq, "logged")
    return JointMotion(
        q, made.first, ddq, {"velocities": "derivative of the logged positions", "accelerations": source, **facts}
    )


def whole_turns(q: Array, robot: Robot) -> Array:
    """Turns that bring each joint from beyond its limits into them, (N,); 0 where none do, or more than a few.

    Args:
        q: positions in the robot's order, (n, N).
    """
    low, high = np.fmin.reduce(q, axis=0), np.fmax.reduce(q, axis=0)
    with np.errstate(invalid="ignore"):
        turns = np.round((0.5 * (low + high) - 0.5 * (robot.lower + robot.upper)) / (2.0 * np.pi))
        back = 2.0 * np.pi * turns
        fits = (low - back >= robot.lower - SLACK) & (high - back <= robot.upper + SLACK) & (np.abs(turns) <= FEW_TURNS)
    return np.where(fits & np.array([not robot.is_prismatic(name) for name in robot.joint_names]), turns, 0.0)


def _refuse_degrees(q: Array, robot: Robot, where: str) -> None:
    """Positions far beyond the limits of a joint that would fit them as degrees are degrees; only limits can tell."""
    if max(np.fmax.reduce(q, axis=None), -np.fmin.reduce(q, axis=None)) <= MORE_THAN_A_TURN:
        return
    largest = np.maximum(np.fmax.reduce(q, axis=0), -np.fmin.reduce(q, axis=0))  # these two pass over NaN
    if not np.isfinite(largest).all():
        largest = np.nanmax(np.where(np.isfinite(q), np.abs(q), np.nan), axis=0, initial=0.0)
    reach = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    limited = np.isfinite(reach) & ~np.array([robot.is_prismatic(name) for name in robot.joint_names])
    beyond = limited & (largest > np.maximum(1.5 * reach, MORE_THAN_A_TURN))
    if not beyond.any() or whole_turns(q, robot)[beyond].all():  # what is a turn off is where it should be
        return
    if (np.deg2rad(largest[limited]) <= 1.1 * reach[limited]).all():
        j = int(np.flatnonzero(beyond)[0])
        raise InputError(
            f"q{j + 1} up to {largest[j]:.4g} in {where}, beyond {reach[j]:.4g} rad and plausible in degrees",
            "joint positions in radians",
            'say so in the rig: [columns] q = {unit = "deg"} (for each of q1…qN where they differ)',
        )


@dataclass(frozen=True, eq=False)
class TipMotion:
    """What there is without a surface: where the tip went, and with which force it was pushed, in base axes.

    Attributes:
        t: [s], (n,). position [m], velocity [m/s]: (n, 3).
        force: what pushes the tool at the tip once the tool's own load is taken away [N], (n, 3); None without a
            wrench.
        steps: where the motion came from.
    """

    t: Array
    position: Array
    velocity: Array
    force: Array | None
    steps: tuple[Step, ...] = ()

    def columns(self) -> dict[str, Array]:
        """Columns for a table."""
        out = {"t": self.t}
        for name, values in (("tip", self.position), ("tip_v", self.velocity), ("force_", self.force)):
            if values is not None:
                out |= {f"{name}{'_' if name == 'tip' else ''}{axis}": values[:, i] for i, axis in enumerate("xyz")}
        return out
