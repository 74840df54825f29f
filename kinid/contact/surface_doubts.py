"""Whether the surface is where the touches say: its side, by the force on both sides of it, and its place, by where
touches begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.contact.registration import onsets
from kinid.contact.series import ContactSeries
from kinid.contact.tool_doubts import FEWEST
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load as load_surface

Array = NDArray[np.float64]

#: a normal is turned where forces outside the surface are so many times those inside, and where this share of what is
#: far from the surface is inside, …
OUTSIDE, FAR = 3.0, 0.9
#: … and nothing is felt inside just below it, within this share of the greatest depth, in so many samples
BELOW, FEWEST_BELOW = 0.1, 10
#: a touch pushes out of the surface: cosine between its force and the normal, at least
OUTWARD = 0.7
#: a surface is doubted that is further than this from where touches begin [m], beyond so many standard deviations of
#: where it and they are
NEAR, SURE = 2e-3, 3.0


def misplaced(log: Log, rig: Rig, robot: Robot, touch: ContactSeries | None) -> tuple[float, list[str]]:
    """Whether even the touch that begins nearest to the surface begins away from it.

    Where a touch begins follows from the force alone, so that a surface that is off can't hide it.

    Args:
        log: with joints. rig: with a surface. robot: of the rig. touch: the log's contact quantities, if any.

    Returns:
        Depth where that touch begins [m], and the doubt; 0 and none where that is at the surface.
    """
    surface = load_surface(rig)
    if touch is None or touch.bias is None or surface is None:
        return 0.0, []
    try:
        found = onsets(log, rig, robot)
    except InputError:  # a wrench that gravity contradicts, and that is trusted by the user's word
        return 0.0, []
    if not found:
        return 0.0, []
    where = surface.locate(np.array([onset.position for onset in found]))
    out = np.einsum("ni,ni->n", where.axes[:, 2], [onset.direction for onset in found]) > OUTWARD
    outward = out & np.isfinite(where.depth)
    depth, known = np.asarray(where.depth)[outward], np.array([onset.sigma for onset in found])[outward]
    if not len(depth) and not touch.in_contact.any() and np.isfinite(where.depth).any():
        return 0.0, [
            f"the force rises {len(found)} time{'s' * (len(found) > 1)} as in a touch, and nothing counts as one: the "
            f"tip is then {1e3 * float(np.nanmin(np.abs(where.depth))):.3g} mm or more from the surface, or the force "
            "points elsewhere; check unit, sign and order of q in [columns], [robot] model and joints, and [surface]"
        ]
    nearest = int(np.argmin(np.abs(depth))) if len(depth) else 0
    off = float(depth[nearest]) if len(depth) else 0.0
    if not len(depth) or abs(off) <= NEAR + SURE * float(np.hypot(rig.surface_sd[0], known[nearest])):
        return 0.0, []
    begins = "the touch begins" if len(depth) == 1 else f"all {len(depth)} touches begin"
    side = "inside" if off > 0.0 else "outside"
    return off, [
        f"{begins} {1e3 * abs(off):.3g} mm or more {side} the surface: correct [surface] "
        "point, or let touches find it: kinid contact LOG --find-surface"
    ]


def turned_normal(rig: Rig, touch: ContactSeries | None) -> list[str]:
    """Whether the normal points into the material: the tool is inside where it is far away and feels nothing, and
    outside where it is pushed, along the normal turned round.
    """
    if touch is None:
        return []
    rows = touch.valid & np.isfinite(touch.normal_force)
    depth, force = touch.depth[rows], touch.normal_force[rows]
    inside = depth > 0.0
    if rig.surface is None or min(int(inside.sum()), int((~inside).sum())) < FEWEST:
        return []
    far = np.abs(depth) > 0.5 * np.abs(depth).max()
    rest = force - np.median(force[inside])
    still, pushed = float(np.sqrt(np.mean(rest[inside] ** 2))), rest[~inside]
    loaded, below = pushed[np.abs(pushed) > OUTSIDE * still], rest[inside & (depth < BELOW * depth.max())]
    if (
        np.mean(inside[far]) < FAR
        or np.sqrt(np.mean(pushed**2)) < OUTSIDE * still
        or np.mean(loaded < 0.0) < FAR
        or len(below) < FEWEST_BELOW
        or abs(np.median(below)) > OUTSIDE * still
    ):
        return []
    normal = rig.surface.normal
    mend = (
        "turn the mesh's faces outward"
        if normal is None
        else f"turn it in the rig: normal = [{', '.join(f'{0.0 - x:g}' for x in normal)}]"
    )
    return [
        f"{-pushed.min():.3g} N against the normal at negative depths, and none up to {1e3 * depth.max():.3g} mm "
        f"inside: [surface] normal points into the material, not out of it; {mend}"
    ]
