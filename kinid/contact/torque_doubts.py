"""Whether joint torques are in the unit of those that the robot's model predicts."""

from __future__ import annotations

import numpy as np

from kinid.contact.tool_doubts import FEWEST, in_proportion, unit_meant
from kinid.data.plausible import ELECTRIC, TORQUE
from kinid.data.rig import Rig
from kinid.robotics.inverse_dynamics import JointTorques


def torque_doubts(torques: JointTorques | None, rig: Rig) -> list[str]:
    """At most one sentence; none of drives that log a current, whose factor nobody need know.

    Args:
        torques: measured and predicted, mostly by gravity; None without them. rig: what was measured with what.
    """
    said = rig.columns.get("tau")
    if torques is None or (said is not None and said.unit in ELECTRIC):
        return []
    rows = torques.valid & np.isfinite(torques.measured).all(axis=1) & np.isfinite(torques.predicted).all(axis=1)
    times = in_proportion(torques.measured[rows], torques.predicted[rows]) if int(rows.sum()) >= FEWEST else None
    meant = None if times is None else unit_meant(times, rig, ("tau", "tau1"), TORQUE)
    if meant is None:
        return []
    return [
        f"the joint torques are {times:.3g} times those that the robot's model predicts: are they in another unit? "
        f'Say so in [columns] of the rig: tau = {{ unit = "{meant}" }}'
    ]
