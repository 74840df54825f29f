"""Whether moments are those of the forces at the rig's com, in free motion, and at its tip, in touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.unit_doubts import LEFT
from kinid.data.rig import Rig

Array = NDArray[np.float64]

#: a com is doubted that is further than this from where the moments of the tool's weight put it [m], and directions
#: that these tell less than this share of the best are left as stated
FAR_COM, UNTOLD = 0.02, 0.1
#: the same of a tip [m], which may be longer by a share of it besides
FAR_TIP, TOO_LONG = 0.004, 0.1
#: what explains readings otherwise leaves this share of their squares at most
BETTER = 0.1


def com_doubt(force: Array, moment: Array, load: Array, still: Array, rig: Rig) -> str | None:
    """Whether the moment in free motion is that of the tool's weight and inertia at the stated com.

    The force is taken as its weight and inertia explain it, each with a factor of its own, so that neither a wrong mass
    nor a wrong com counts in it.

    Args:
        force, moment, load, still: without their means, (n, 3): measured, and of 1 kg, its weight and inertia, and its
            weight alone.
    """
    if rig.tool is None or "com" not in rig.tool.model_fields_set or rig.tool.mass == 0.0 or not moment.any():
        return None
    parts = np.stack([still, load - still], axis=2)
    own = parts @ np.linalg.lstsq(parts.reshape(-1, 2), force.ravel(), rcond=None)[0]
    if np.sum((force - own) ** 2) > LEFT * np.sum(force**2):
        return None
    off = _lever(own, moment - np.cross(rig.carried.com, own))
    if off is None or np.linalg.norm(off) <= FAR_COM:
        return None
    found, stated = _shown(rig.carried.com + off), _shown(np.array(rig.carried.com))
    return f"the moments in free motion put the tool's com at [{found}] m, not at [{stated}]: correct [tool] com"


def tip_doubt(contact: Array, unexplained: Array, tip: Array) -> str | None:
    """Whether the moments of touches are those of their forces, (n, 3), at the tip, (3,) in the sensor's frame.

    A moment that is some per cent too large makes the tip seem longer, not one aside.

    Args:
        unexplained: what is left of the moments, (n, 3), beside those of the forces at the tool's com and tip.
    """
    off = _lever(contact - contact.mean(axis=0), unexplained - unexplained.mean(axis=0))
    if off is None:
        return None
    length = float(np.linalg.norm(tip))
    along = float(off @ tip) / length if length > 0.0 else 0.0
    if float(off @ off) - along**2 <= FAR_TIP**2 and abs(along) <= FAR_TIP + TOO_LONG * length:
        return None
    found, stated = _shown(tip + off), _shown(tip)
    return (
        f"the moments of touches put the tip at [{found}] m in the sensor's frame, not at [{stated}]: correct [robot] "
        "tip_frame or sensor_frame, or their place in the URDF"
    )


def _lever(force: Array, moment: Array) -> Array | None:
    """The lever, (3,), that makes moments out of forces, (n, 3) both without their means; None where none explains
    them.
    """
    levers = np.stack([np.cross(axis, force) for axis in np.eye(3)], axis=2).reshape(-1, 3)
    found = np.asarray(np.linalg.lstsq(levers, moment.ravel(), rcond=UNTOLD)[0], dtype=np.float64)
    left = float(np.sum((moment.ravel() - levers @ found) ** 2))
    return found if left < BETTER * float(np.sum(moment**2)) else None


def _shown(place: Array) -> str:
    """A place in figures that are known."""
    return ", ".join(f"{x:.3g}" for x in np.round(place, 4) + 0.0)
