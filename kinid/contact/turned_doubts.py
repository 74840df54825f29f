"""Whether gravity, or the sensor on its flange, is turned by an angle that is no exchange of axes.

In free motion f = m P Rᵀ (G g − a) + b: a base that stands askew turns gravity by G, a sensor that is mounted askew the
axes by P (G. Wahba, SIAM Rev. 7, 1965; W. Kabsch, Acta Cryst. A32, 1976). The bias b is a constant, so that only a
wrist that turns tells either.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.unit_doubts import LEFT

Array = NDArray[np.float64]

#: an angle is doubted from here on [rad]; smaller ones are what a diagnosis asks about, as gravity-error and
#: sensor-misalignment
LEAST = np.deg2rad(8.5)
#: … where turning leaves less than this share of what is left without
GAIN = 0.4
#: of two explanations, one is named alone that leaves so many times less
CLEARLY = 2.0
#: gravity is found where its length comes out within this share; axes where the tool's weight turns about two of them,
#: the second by this share of the first
LENGTH, SECOND = 0.2, 0.05
#: … and where its three components can be told apart
WORST_CONDITION = 1e8


def turned_doubt(force: Array, load: Array, rotation: Array, gravity: Array) -> tuple[str, float] | None:
    """At most one sentence, and what it leaves of the force [N²].

    Args:
        force: in free motion, without its mean, sensor axes [N], (n, 3). load: of 1 kg at the tool's com, (n, 3).
        rotation: sensor to base, (n, 3, 3). gravity: of the rig, base axes [m/s²], (3,).
    """
    still = np.einsum("nji,j->ni", rotation, gravity)
    still -= still.mean(axis=0)
    turning, whole = load - load.mean(axis=0), float(np.sum(force**2))
    shared = float(np.sum(turning * still))
    mass = float(np.sum(force * still)) / shared if shared > 0.0 else 0.0
    as_is = float(np.sum((force - mass * turning) ** 2))
    found = [
        one
        for one in (_base(force, load, rotation, gravity, mass), _sensor(force, turning))
        if one is not None and one[0] < min(GAIN * as_is, LEFT * whole)
    ]
    if not found:
        return None
    least = min(left for left, _ in found)
    said = " or ".join(words for left, words in sorted(found) if left <= CLEARLY * least)
    times = as_is / max(least, 1e-12 * whole)
    return f"the tool's weight in free motion is explained {times:.3g} times better where {said}", least


def solved_gravity(
    force: Array, load: Array, rotation: Array, gravity: Array, mass: float
) -> tuple[Array, float, Array] | None:
    """Gravity in base axes by least squares, what it leaves of the force, and the covariance of its entries over the
    variance of what is left; None where the wrist doesn't turn enough, or its length is another.

    Args:
        force: without its mean, (n, 3). load, rotation, gravity: as of `turned_doubt`. mass: of the tool [kg].

    Returns:
        [m/s²], (3,), a sum of squares [N²], and (3, 3).
    """
    turn = np.swapaxes(rotation, 1, 2)
    inertial = mass * (load - turn @ gravity)
    columns = mass * (turn - turn.mean(axis=0)).reshape(-1, 3)
    normal, wanted = columns.T @ columns, (force - inertial + inertial.mean(axis=0)).ravel()
    if np.linalg.cond(normal) > WORST_CONDITION:
        return None
    found = np.linalg.solve(normal, columns.T @ wanted)
    if not abs(np.linalg.norm(found) / np.linalg.norm(gravity) - 1.0) < LENGTH:
        return None
    return found, float(np.sum((wanted - columns @ found) ** 2)), np.linalg.inv(normal)


def _base(force: Array, load: Array, rotation: Array, gravity: Array, mass: float) -> tuple[float, str] | None:
    """What another direction of gravity leaves [N²], and that in words; None where there is none."""
    solved = solved_gravity(force, load, rotation, gravity, mass) if mass > 0.0 else None
    if solved is None:
        return None
    found, left, _ = solved
    length, stated = float(np.linalg.norm(found)), float(np.linalg.norm(gravity))
    angle = float(np.arccos(np.clip(found @ gravity / (length * stated), -1.0, 1.0)))
    if angle < LEAST:
        return None
    along = ", ".join(f"{x:.3g}" for x in np.round(found * stated / length, 2) + 0.0)
    return left, f"gravity points {np.rad2deg(angle):.2g}° off [robot] gravity, along [{along}] m/s²: correct it"


def _sensor(force: Array, turning: Array) -> tuple[float, str] | None:
    """What axes of the sensor that are turned leave [N²], and that in words; None where there are none."""
    left, sizes, right = np.linalg.svd(force.T @ turning)
    if sizes[1] < SECOND * sizes[0]:
        return None
    turned = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    angle = float(np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0)))
    if angle < LEAST:
        return None
    expected = turning @ turned.T
    expected *= float(np.sum(force * expected)) / float(np.sum(expected**2))
    # the axes of the reading seen in those of the frame: the inverse turn
    axis = np.array([turned[1, 2] - turned[2, 1], turned[2, 0] - turned[0, 2], turned[0, 1] - turned[1, 0]])
    about = ", ".join(f"{x:.2g}" for x in np.round(axis / max(float(np.linalg.norm(axis)), 1e-12), 2) + 0.0)
    words = (
        f"the sensor is turned by {np.rad2deg(angle):.2g}° about [{about}] of its frame: correct [robot] sensor_frame, "
        "its rpy in the URDF, or an offset of the last joint; or wrench and joints are of two times"
    )
    return float(np.sum((force - expected) ** 2)), words
