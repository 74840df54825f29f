"""Whether joint torques are those that the robot's model predicts: their unit, their sign, their order."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.lever_doubts import BETTER
from kinid.contact.tool_doubts import FEWEST
from kinid.contact.unit_doubts import LEFT, in_proportion, unit_meant
from kinid.data.plausible import ELECTRIC, TORQUE
from kinid.data.rig import Rig
from kinid.robotics.inverse_dynamics import JointTorques
from kinid.signal.stuck import constant, noisy

Array = NDArray[np.float64]


def torque_doubts(torques: JointTorques | None, rig: Rig) -> list[str]:
    """At most one sentence; of drives that log a current, whose factor nobody need know, only of dead channels.

    Args:
        torques: measured and predicted, mostly by gravity; None without them. rig: what was measured with what.
    """
    if torques is None:
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
    return _turned(measured, predicted) or _exchanged(measured, predicted)


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
