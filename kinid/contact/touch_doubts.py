"""Whether a log whose tip goes into the material holds a touch at all, and what hides it where it doesn't."""

from __future__ import annotations

import numpy as np

from kinid.contact.series import ContactSeries
from kinid.contact.tool_doubts import FEWEST
from kinid.contact.touching import OFF, ON, REACH, force_noise
from kinid.data.rig import Rig
from kinid.signal.noise import ROBUST

#: the tip is inside the material from this depth on, in so many samples at least (`FEWEST`) [m]; …
INSIDE = 1e-3
#: … which is told of a surface whose place is known to a standard deviation from so many of it on
SURE = 3.0


def unfelt(rig: Rig, touch: ContactSeries | None) -> list[str]:
    """At most one sentence: the tip is inside the material, and no force counts as a touch.

    Args:
        rig: with a surface. touch: the log's contact quantities; None without.
    """
    if touch is None or touch.bias is None or touch.in_contact.any():
        return []
    depth, force = touch.depth[touch.valid], touch.normal_force[touch.valid]
    inside = depth > INSIDE + SURE * rig.surface_sd[0]
    if int(inside.sum()) < FEWEST:
        return []
    white, quiet = force_noise(force), np.abs(force[depth < -REACH])
    stated = 0.0 if rig.sensor.noise is None else max(rig.sensor.noise[:3])
    left = ROBUST * float(np.median(quiet)) if len(quiet) else 0.0
    if left > OFF * max(white, stated):
        why = f"far from the surface {left:.3g} N are left beside the tool's load and the bias"
        mend = (
            "check scale and order of the wrench's columns, [sensor] bias, the joints' order, and that wrench and "
            "joints are of one time"
        )
    elif white > OFF * stated > 0.0:
        why = f"the force has a noise of {white:.3g} N, the rig says {stated:.3g} N"
        mend = "check the wrench's columns"
    else:
        why, mend = (
            f"no force is above {force[inside].max():.3g} N there",
            "check [surface] point, or the wrench's columns",
        )
    return [
        f"the tip is up to {1e3 * depth.max():.3g} mm inside the surface, and nothing counts as a touch, which begins "
        f"at {ON * max(white, left, stated):.3g} N: {why}; {mend}"
    ]
