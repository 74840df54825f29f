"""What came of a run, as the experimenter sees it: by the joints and the rig alone, without the truth."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.lab.setup import Result, Setup

Array = NDArray[np.float64]

#: parts of a set-up that show in contact alone
IN_CONTACT = ("material", "surface_offset", "surface_slope")
#: a depth that falls short of its set-point by this share is said
SHORT = 0.3


class Outcome(NamedTuple):
    """Of one phase: its name, duration [s], greatest depth that was asked and reached [m] (negative: above the
    surface), rms distance of the tip from its set-point [m], and greatest measured force, less that at the beginning
    [N].
    """

    phase: str
    duration: float
    asked: float
    reached: float
    apart: float
    force: float


def outcomes(result: Result) -> tuple[Outcome, ...]:
    """Each phase of a run, in the order in which they first come."""
    setup = result.setup
    tip = setup.robot.kinematics(setup.robot.tip_frame or "", np.ascontiguousarray(result.q)).position
    asked, normal = result.targets[0], setup.axes[2]
    apart = np.linalg.norm(tip - asked, axis=1)
    wanted, depth = ((np.asarray(setup.point) - place) @ normal for place in (asked, tip))
    force = np.linalg.norm(result.wrench[:, :3] - result.wrench[:50, :3].mean(axis=0), axis=1)
    phase, out = setup.script.phase, []
    for name in dict.fromkeys(phase.tolist()):
        rows = phase == name
        out.append(
            Outcome(
                name,
                float(rows.sum() * setup.gains.period),
                float(wanted[rows].max()),
                float(depth[rows].max()),
                float(np.sqrt(np.mean(apart[rows] ** 2))),
                float(force[rows].max()),
            )
        )
    return tuple(out)


def remarks(found: tuple[Outcome, ...], setup: Setup, nominal: Setup | None = None) -> list[str]:
    """What wasn't reached, one line each.

    Args:
        found: of a run. setup: that ran. nominal: without what was hidden.
    """
    lines = []
    for o in found:
        if o.asked > 0.0 >= o.reached:
            lines.append(
                f"no contact in {o.phase}: asked for {1e3 * o.asked:.1f} mm below the surface, and stayed "
                f"{-1e3 * o.reached:.1f} mm above it"
            )
        elif o.asked > 0.0 and o.reached < (1.0 - SHORT) * o.asked:
            lines.append(
                f"deepest {1e3 * o.reached:.1f} of {1e3 * o.asked:.1f} mm in {o.phase}: soft gains, friction of the "
                "joints, or more than the arm follows"
            )
        elif o.asked <= 0.0 < o.reached:
            lines.append(f"{o.phase}, meant to be in the air, was {1e3 * o.reached:.1f} mm below the surface")
    if max(o.asked for o in found) <= 0.0 and max(o.reached for o in found) <= 0.0:
        near = -1e3 * max(o.reached for o in found)
        lines.append(f"nothing was touched: the tip stayed {near:.1f} mm above the surface at least")
    if nominal is not None and unseen(setup, nominal) and max(o.reached for o in found) <= 0.0:
        lines.append("what is hidden shows in contact alone, and nothing was touched: this log can't tell it")
    return lines


def unseen(setup: Setup, nominal: Setup) -> bool:
    """Whether all that differs between two set-ups shows in contact alone."""
    differ = {f.name for f in dataclasses.fields(Setup) if getattr(setup, f.name) is not getattr(nominal, f.name)}
    return bool(differ) and differ <= set(IN_CONTACT)
