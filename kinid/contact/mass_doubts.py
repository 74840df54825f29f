"""Whether joint torques in several poses are those of an arm one of whose bodies has another mass than its URDF says.

Gravity's torques are linear in each body's mass at its centre (C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Rob.
Res. 5, 1986). Beside a constant and the friction of each joint, one mass that is wrong leaves a residual in proportion
to its own pull; a bad model elsewhere, or a pose that hardly changes, leaves others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinid.robotics.body_tree import BodyTree
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: share of what is left beside friction that one mass explains; it is so many times the stated one, or the inverse
EXPLAINED, FACTOR = 0.9, 2.0
#: bodies are named together that leave no more than so many times what the best leaves
CLEARLY = 3.0
#: samples that change nothing beyond this number
MOST = 1000


def mass_doubt(residual: Array, q: Array, rates: Array, robot: Robot) -> list[str]:
    """At most one sentence.

    Args:
        residual: torques measured less those predicted, (n, N). q: joint positions, (n, N). rates: which way each joint
            moves, (n, N). robot: whose bodies.
    """
    rows = slice(None, None, 1 + len(q) // MOST)
    residual, q, rates = residual[rows], q[rows], rates[rows]
    tree = BodyTree.of(robot)
    left = _beside_friction(residual, rates)
    pulls = np.array([_beside_friction(_pull(tree, k, q), rates) for k in range(len(tree.mass))])
    whole, sizes = float(np.sum(left**2)), np.sum(pulls**2, axis=(1, 2))
    if not whole > 0.0:
        return []
    more = np.sum(pulls * left, axis=(1, 2)) / np.maximum(sizes, 1e-12)
    rest = (whole - more**2 * sizes) / whole
    best = int(np.argmin(rest))
    found = tree.mass + more
    changed = (found > FACTOR * tree.mass) | (found < tree.mass / FACTOR)
    if rest[best] > 1.0 - EXPLAINED or not changed[best] or found[best] < 0.0:
        return []
    alike = [k for k in np.argsort(rest).tolist() if rest[k] <= CLEARLY * rest[best] and changed[k] and found[k] >= 0.0]
    said = " or ".join(f"{found[k]:.2g} kg behind {robot.model.names[k + 1]}, not {tree.mass[k]:.2g}" for k in alike)
    return [
        f"the joint torques in these poses ask for {said}, which explains {100.0 * (1.0 - rest[best]):.2g} % of what "
        "the robot's model leaves beside friction: correct that link's mass or com in the URDF, or [tool]"
    ]


def _pull(tree: BodyTree, k: int, q: Array) -> Array:
    """Torques that gravity needs of the joints for 1 kg at the centre of body k alone, (n, N)."""
    alone = np.arange(len(tree.mass)) == k
    still = np.zeros_like(q)
    return replace(tree, mass=alone.astype(np.float64), inertia=0.0 * tree.inertia).torques(q, still, still)


def _beside_friction(torques: Array, rates: Array) -> Array:
    """What is left of torques (n, N) beside a constant and dry and viscous friction of each joint."""
    out = np.empty_like(torques)
    for j, (torque, rate) in enumerate(zip(torques.T, rates.T)):
        parts = np.stack([np.ones_like(rate), np.sign(rate), rate], axis=1)
        out[:, j] = torque - parts @ np.linalg.lstsq(parts, torque)[0]
    return out
