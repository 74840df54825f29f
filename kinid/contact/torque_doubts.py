"""Whether joint torques are those that the robot's model predicts: their unit, their sign, their order."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.lever_doubts import BETTER
from kinid.contact.mass_doubts import mass_doubt
from kinid.contact.tool_doubts import FEWEST
from kinid.contact.unit_doubts import LEFT, in_proportion, unit_meant
from kinid.data.log import Log
from kinid.data.plausible import ELECTRIC, TORQUE
from kinid.data.rig import Rig
from kinid.robotics.inverse_dynamics import JointTorques
from kinid.robotics.robot import Robot
from kinid.signal.stuck import constant, noisy, one_frozen

Array = NDArray[np.float64]

#: torques are unlike those predicted where more than this share of the squares, of the larger of both, is left
UNEXPLAINED = 0.25
#: where the model explains more than this share of a joint's changes, they are so many times those predicted at least,
#: or at most the inverse, for a doubt
EXPLAINED, FACTOR = 0.5, 5.0
#: the way that a joint moves is its change over so long [s]
WINDOW = 0.04


def torque_doubts(torques: JointTorques | None, rig: Rig, log: Log, robot: Robot | None = None) -> list[str]:
    """At most one sentence; of drives that log a current, whose factor nobody need know, only of dead channels.

    Args:
        torques: measured and predicted, mostly by gravity; None without them. rig: what was measured with what. log:
            that they are of. robot: of the rig; None where its bodies aren't asked about.
    """
    if torques is None or log.q is None:
        return []
    rows = torques.valid & np.isfinite(torques.measured).all(axis=1) & np.isfinite(torques.predicted).all(axis=1)
    if int(rows.sum()) < FEWEST:
        return []
    measured, predicted = torques.measured[rows], torques.predicted[rows]
    said, dead = rig.columns.get("tau"), _dead(measured)
    if dead or (said is not None and said.unit in ELECTRIC):
        return dead
    times = in_proportion(measured, predicted)
    if times is not None:
        meant = unit_meant(times, rig, ("tau", "tau1"), TORQUE)
        scale = 1.0 if said is None else said.scale
        asked, say = ("in another unit", f'unit = "{meant}"')
        if meant is None:
            asked, say = "of the motors, before their gears, or in another unit", f"scale = {scale / times:.3g}"
        return [
            f"the joint torques are {times:.3g} times those that the robot's model predicts: are they {asked}? "
            f"Say so in [columns] of the rig: tau = {{ {say} }}"
        ]
    return (
        _turned(measured, predicted)
        or _exchanged(measured, predicted)
        or ([] if robot is None else mass_doubt(measured - predicted, log.q[rows], _rates(log)[rows], robot))
        or _unlike(torques.joint_names, measured, predicted, _rates(log)[rows])
        or _frozen(torques.t[rows], measured, predicted)
    )


def _dead(measured: Array) -> list[str]:
    """Channels that never change, all of them or beside others that show noise."""
    dead = constant(measured)
    if not dead.any() or not (dead.all() or all(noisy(channel) for channel in measured[:, ~dead].T)):
        return []
    names = "the joint torques" if dead.all() else " and ".join(f"tau{j + 1}" for j in np.flatnonzero(dead))
    verb = "change" if int(dead.sum()) > 1 else "changes"
    return [
        f"{names} never {verb}: a dead channel, or another column; name it in [columns] of the rig, or leave tau out"
    ]


def _turned(measured: Array, predicted: Array) -> list[str]:
    """Torques of the opposite sign, all together."""
    slope = float(np.sum(measured * predicted)) / max(float(np.sum(predicted**2)), 1e-300)
    if slope >= 0.0 or float(np.sum((measured - slope * predicted) ** 2)) > LEFT * float(np.sum(measured**2)):
        return []
    return [
        "the joint torques have the opposite sign of those that the robot's model predicts: turn it in [columns] of "
        "the rig, tau = { scale = -1 }, or correct [robot] gravity"
    ]


def _exchanged(measured: Array, predicted: Array) -> list[str]:
    """Two joints each of whose torques is that of the other."""
    left = np.sum((measured[:, :, None] - predicted[:, None, :]) ** 2, axis=0)  # of joint i as joint k, (N, N)
    whole = np.sum(measured**2, axis=0)
    for i, k in combinations(range(len(left)), 2):
        swapped = left[i, k] + left[k, i]
        if swapped < min(BETTER * (left[i, i] + left[k, k]), LEFT * (whole[i] + whole[k])):
            return [
                f"tau{i + 1} is what the robot's model predicts of tau{k + 1}, and tau{k + 1} what it predicts of "
                f"tau{i + 1}: name them in their order in [columns] of the rig"
            ]
    return []


def _rates(log: Log) -> Array:
    """Which way each joint moves, roughly: its change over `WINDOW` around each sample [rad], (n, N)."""
    q, half = np.nan_to_num(np.asarray(log.q)), max(1, round(0.5 * WINDOW / log.period))
    after = np.minimum(np.arange(len(q)) + half, len(q) - 1)
    return np.asarray(q[after] - q[np.maximum(np.arange(len(q)) - half, 0)])


def _unlike(names: Sequence[str], measured: Array, predicted: Array, rates: Array) -> list[str]:
    """Torques that model and friction don't explain, or those of one joint of another sign or scale."""
    square = np.mean(measured**2, axis=0), np.mean(predicted**2, axis=0)
    left = np.array([_beside_friction(*one) for one in zip((measured - predicted).T, rates.T)])
    factors = np.array([_factor(own, model) for own, model in zip(measured.T, predicted.T)])
    off = np.flatnonzero((factors > FACTOR) | (factors < 1.0 / FACTOR))
    whole = left.sum() > UNEXPLAINED * max(square[0].sum(), square[1].sum())
    if len(off) == 1 and (not whole or left[off[0]] > 0.5 * left.sum()):
        j, factor = int(off[0]), float(factors[off[0]])
        what = "the opposite sign of what" if abs(factor + 1.0) < 0.5 else f"{factor:.3g} times what"
        return [
            f"tau{j + 1} has {what} the robot's model predicts of {names[j]}, unlike the others: correct its unit or "
            f"sign in [columns] of the rig, or the URDF's masses: tau{j + 1} = {{ scale = {1.0 / factor:.3g} }}"
        ]
    if not whole and len(off) < 2:
        return []
    j = int(np.argmax(left))
    sizes = [float(np.sqrt(values[j])) for values in square]
    return [
        f"the joint torques are not those that the robot's model predicts ({names[j]}: {sizes[0]:.3g} N·m measured, "
        f"{sizes[1]:.3g} predicted, root mean squares): check masses and coms in the URDF, unit and order of tau in "
        '[columns]; or state [robot] torques = "external" if gravity is taken out of them'
    ]


def _beside_friction(residual: Array, rate: Array) -> float:
    """Mean square of a torque (n,) beside friction that is dry and viscous."""
    parts = np.stack([np.sign(rate), rate], axis=1)
    friction = parts @ np.linalg.lstsq(parts, residual)[0]
    return float(np.mean((residual - friction) ** 2))


def _factor(measured: Array, predicted: Array) -> float:
    """Times that a torque's changes are those predicted; 1 where less than half of them is explained so."""
    own, model = measured - measured.mean(), predicted - predicted.mean()
    along, size = float(own @ model), float(model @ model)
    return along / size if along * along > EXPLAINED * size * float(own @ own) > 0.0 else 1.0


def _frozen(t: Array, measured: Array, predicted: Array) -> list[str]:
    """One channel that repeats a reading while the joints go on."""
    moved = np.r_[False, (np.diff(predicted, axis=0) != 0.0).any(axis=1)]
    held = one_frozen(t, measured, lambda _: moved)
    if held is None:
        return []
    joint, since, duration = held
    return [
        f"tau{joint + 1} repeats one reading for {duration:.2g} s from {since:.4g} s on, while the joints move: the "
        "channel stood still; leave it empty in these rows, or record anew"
    ]
