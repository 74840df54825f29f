"""Joint motion that is complete (positions, velocities, accelerations) and the tip's motion that follows from it."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.signal import Smoothed, contradictions, smooth_motion
from kinid.signal.derivative import Derivatives, Differentiator

Array = NDArray[np.float64]

#: a log slower than this holds single poses: the arm stood still at each of them [s]
STATIC_PERIOD = 0.1
#: positions within this are no degrees, or too few to tell [rad]
MORE_THAN_A_TURN = 2 * np.pi + 0.1
#: the motion of the latest log is kept while the log is, where it holds no more positions than this: contact frame,
#: inertial loads and draws ask for the same one
MANY_KEPT = 1_000_000


_LATEST: weakref.WeakKeyDictionary[Log, JointMotion] = weakref.WeakKeyDictionary()
_LATEST_OWN: weakref.WeakKeyDictionary[Log, dict[str, Smoothed]] = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint positions with both derivatives, (n, N) each, in the log's order; `facts` says where they came from.

    `smoothed` is the estimate that they are, with its standard deviations; None where they are as logged or
    differentiated.
    """

    q: Array
    dq: Array
    ddq: Array
    facts: dict[str, Any]
    smoothed: Smoothed | None = field(default=None, repr=False)

    @property
    def sd(self) -> tuple[Array, Array, Array]:
        """Standard deviations of q, dq and ddq, (n, N) each; 0 where nothing is known of them."""
        if self.smoothed is not None:
            q, dq, ddq = (np.asarray(sd, dtype=np.float64) for sd in self.smoothed.sd)
            return q, dq, ddq
        none = np.zeros_like(self.q)
        return none, none, none

    def draw(self, number: int) -> JointMotion:
        """The motion with a sample of its own error, the same for the same number."""
        if self.smoothed is None:
            return self
        made = self.smoothed.draw(number)
        return JointMotion(made.value, made.first, made.second, self.facts, made)


def joint_motion(log: Log, robot: Robot, differentiator: Differentiator | None = None) -> JointMotion:
    """The joints' motion, smoothed from the log's positions and what it holds of velocities and accelerations.

    A log with a row only every 0.1 s or more, and no velocities of its own, is taken as a set of poses at rest.

    Args:
        log: with joints. robot: whose they are.
        differentiator: instead of the smoother; logged positions and derivatives are then left as they are.

    Raises:
        InputError: no joints, a count that isn't the robot's, or positions that look like degrees.
    """
    where = log.provenance.source
    if log.q is None:
        raise InputError(f"no joint positions in {where}", "q1…qN [rad]", "name their columns in [columns] of the rig")
    if log.q.shape[1] != robot.joint_count:
        raise InputError(
            f"{log.q.shape[1]} joints in {where}",
            f"{robot.joint_count} for {robot.name} ({', '.join(robot.joint_names)})",
            "list the log's joints in [robot] joints, or name the columns in [columns]",
        )
    _refuse_degrees(log.q, robot, where)
    return axes_motion(log, differentiator)


def axes_motion(log: Log, differentiator: Differentiator | None = None) -> JointMotion:
    """The same of axes without a robot."""
    if log.q is None:
        raise InputError(
            f"no joint positions in {log.provenance.source}", "q1…qN", "name their columns in [columns] of the rig"
        )
    if log.period >= STATIC_PERIOD and log.dq is None:
        still = np.zeros_like(log.q)
        return JointMotion(
            log.q, still, still if log.ddq is None else log.ddq, {"velocities": "zero: the log holds poses at rest"}
        )
    if differentiator is None:
        kept = _LATEST.get(log)
        if kept is not None:
            return kept
        made = smooth_motion(log.t, log.q, log.pieces, log.dq, log.ddq, _slower(log))
        facts = {
            "motion": "smoothed from "
            + " and ".join(
                name
                for name, there in (
                    ("positions", True),
                    ("velocities", log.dq is not None),
                    ("accelerations", log.ddq is not None),
                )
                if there
            ),
            **made.facts,
        }
        warnings = warnings_of(made, [f"q{j + 1}" for j in range(log.q.shape[1])], log.period)
        if warnings:
            facts["warnings"] = warnings
        out = JointMotion(made.value, made.first, made.second, facts, made)
        _LATEST.clear()
        if log.q.size <= MANY_KEPT:
            _LATEST[log] = out
        return out
    return _differentiated(log, log.q, differentiator)


def _slower(log: Log) -> int:
    """How many samples there are for one that the joints' own stream had, where they were interpolated."""
    for step in log.provenance.steps:
        if (
            step.name == "merge"
            and step.facts.get("stream") == "joints"
            and "interpolation" in str(step.facts.get("method"))
        ):
            return max(1, round(1.0 / (float(step.facts["rate"]) * log.period)))
    return 1


def warnings_of(made: Smoothed, names: list[str], period: float) -> list[str]:
    """Where logged rates contradict the positions, a sentence each."""
    out = []
    for what, rate in (("velocities", made.first), ("accelerations", made.second)):
        if what in made.facts:
            largest = np.nan_to_num(np.fmax.reduce(np.abs(rate), axis=0))
            out += contradictions(made.facts[what], what, names, largest, period)
    return out


def own_motion(log: Log, differentiator: Differentiator | None) -> Iterator[tuple[str, str, Smoothed | Derivatives]]:
    """Depth and slips that a log holds, each with the name of its rate, smoothed by themselves or differentiated."""
    kept = _LATEST_OWN.get(log)
    if kept is None:
        kept = {}
        _LATEST_OWN.clear()
        if log.t.size <= MANY_KEPT:
            _LATEST_OWN[log] = kept
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
    facts: dict[str, Any] = {}
    if log.dq is not None:
        if log.ddq is not None:
            return JointMotion(q, log.dq, log.ddq, facts)
        made = differentiator(log.t, log.dq, log.pieces)
        facts = {
            "accelerations": "derivative of the logged velocities",
            "bandwidth_hz": made.bandwidth,
            "window_samples": made.window,
        }
        return JointMotion(q, log.dq, made.first, facts)
    made = differentiator(log.t, q, log.pieces)
    facts = {
        "velocities": "derivative of the logged positions",
        "accelerations": "second derivative",
        "bandwidth_hz": made.bandwidth,
        "window_samples": made.window,
    }
    ddq = made.second
    if log.ddq is not None:
        ddq, facts["accelerations"] = log.ddq, "logged"
    return JointMotion(q, made.first, ddq, facts)


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
    if beyond.any() and (np.deg2rad(largest[limited]) <= 1.1 * reach[limited]).all():
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
        facts: where the motion came from.
    """

    t: Array
    position: Array
    velocity: Array
    force: Array | None
    facts: Mapping[str, Any] = field(default_factory=dict)

    def columns(self) -> dict[str, Array]:
        """Columns for a table."""
        out = {"t": self.t}
        for name, values in (("tip", self.position), ("tip_v", self.velocity), ("force_", self.force)):
            if values is not None:
                out |= {f"{name}{'_' if name == 'tip' else ''}{axis}": values[:, i] for i, axis in enumerate("xyz")}
        return out
