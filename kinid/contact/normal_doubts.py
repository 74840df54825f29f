"""Whether a plane's normal is the direction that touches go in along, push back along, and that the tool points along.

A poke without slip pushes back along the material's own normal, so that a stated normal that is off by an angle shows a
tangential force in proportion to the normal force, and a path inside the material, off by that angle both. A poke that
goes in obliquely and sticks looks nearly alike (R. D. Mindlin, J. Appl. Mech. 16, 1949: the force is then off by two
thirds of it or more); that the tool's axis is off as well tells them apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.contact.touching import touches
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: a normal is doubted from this angle on [rad], beyond so many standard deviations of a surface known to them
LEAST, SURE = np.deg2rad(9.0), 3.0
#: force and path, and the tool's axis and the path, are alike within this share of that angle, or this [rad]
SHARE, WITHIN = 0.2, np.deg2rad(2.0)
#: … and touches of one surface within this [rad]; this share of all touches has to show it
ALIKE, MOST = np.deg2rad(5.0), 0.5
#: a touch begins until its force has this share of its greatest; it needs so many samples, and so long a way [m]
BEGINS, FEWEST, SHORTEST = 0.7, 10, 3e-4


def tilted_normal(log: Log, rig: Rig, robot: Robot, touch: ContactSeries | None) -> list[str]:
    """At most one sentence.

    Args:
        log: with joints. rig: with a plane. robot: of the rig, whose tip's z axis points out of the tool. touch: the
            log's contact quantities, if any.
    """
    if touch is None or touch.bias is None or log.q is None or rig.axes is None or robot.tip_frame is None:
        return []
    spans = touches(touch.t, touch.in_contact, touch.valid)
    begun = [one for rows in spans if (one := _beginning(touch, *rows)) is not None]
    if not begun:
        return []
    first = np.array([row for row, _, _ in begun])
    paths, forces = (np.array([one[k] for one in begun]) for k in (1, 2))
    tool = -robot.kinematics(robot.tip_frame, log.q[first]).rotation[:, :, 2] @ rig.axes.T
    off = _angle(paths, np.array([0.0, 0.0, 1.0]))
    slack = np.maximum(SHARE * off, WITHIN)
    shows = (off > LEAST + SURE * rig.surface_sd[1]) & (_angle(forces, paths) < slack) & (_angle(tool, paths) < slack)
    if np.mean(shows) < MOST:
        return []
    found = paths[shows].mean(axis=0)
    found /= np.linalg.norm(found)
    if (_angle(paths[shows], found) > ALIKE).any():
        return []
    angle = float(np.rad2deg(_angle(found[None], np.array([0.0, 0.0, 1.0]))[0]))
    normal = ", ".join(f"{x:.3g}" for x in np.round(found @ rig.axes, 3) + 0.0)
    return [
        f"{int(shows.sum())} of {len(begun)} touches go in, push back, and have the tool along one direction, about "
        f"{angle:.2g}° off [surface] normal: correct it, as normal = [{normal}], or let touches find it: kinid contact "
        "LOG --find-surface"
    ]


def _beginning(touch: ContactSeries, begin: int, end: int) -> tuple[int, Array, Array] | None:
    """First row of a touch, and the unit vectors of its way out and of its force while that grows, in contact axes.

    Args:
        begin, end: rows of the touch. Axes are tangent, normal × tangent, normal.
    """
    rows = np.arange(begin, end)
    rows = rows[touch.valid[rows]]
    place = np.stack([touch.slip1[rows], touch.slip2[rows], -touch.depth[rows]], axis=1)
    forces = (touch.tangential_force1, touch.tangential_force2, touch.normal_force)
    force = np.stack([component[rows] for component in forces], axis=1)
    size = np.linalg.norm(force, axis=1)
    if len(rows) < FEWEST:
        return None
    grown = int(np.argmax(size >= BEGINS * np.quantile(size, 0.95)))
    way, push = place[0] - place[grown], force[: grown + 1].sum(axis=0)
    if grown < FEWEST or np.linalg.norm(way) < SHORTEST:
        return None
    return int(rows[0]), way / np.linalg.norm(way), push / np.linalg.norm(push)


def _angle(vectors: Array, other: Array) -> Array:
    """Between unit vectors (n, 3) and others (n, 3) or one (3,) [rad]."""
    cosine = np.sum(vectors * other, axis=-1)
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(vectors, other), axis=-1), cosine))
