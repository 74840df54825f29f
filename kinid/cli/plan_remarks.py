"""What `kinid plan` says beside a plan: what it assumed, what speaks against that, and speeds that aren't reached."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from kinid.cli.plan_arguments import Options
from kinid.inputs import read_json

if TYPE_CHECKING:
    from kinid.planning import Trajectory

#: a speed is reached from this share of it
REACHED = 0.95


def remarks(o: Options, motion: Trajectory, values: Iterable[str]) -> list[str]:
    """One line each.

    Args:
        o: what was asked for. motion: that was planned. values: names of parameters that were given, with their effect
            or not.
    """
    return [*_assumed(motion, set(values)), *_doubted(o), *_unreached(o, motion)]


def _assumed(motion: Trajectory, given: set[str]) -> list[str]:
    """Parameters of the expected force that nobody gave."""
    law = motion.provenance.get("law")
    if law is None:
        return []
    from kinid.modeling.model import Model
    from kinid.planning import Law

    expected = Law(Model(*law["model"]))
    units = {name: p.unit for name, p in expected.model.parameters(expected.layout()).items()}
    short = [name.split(".", 1)[-1] for name in law["values"]]
    shown = []
    for name, value in law["values"].items():
        own = name.split(".", 1)[-1]
        if name not in given and own not in given:
            shown.append(f"{own if short.count(own) == 1 else name} {value:.6g} {units[name]}".removesuffix(" 1"))
    return (
        [f"assumed: {', '.join(shown)} (name {'it' if len(shown) == 1 else 'them'} with --value or --fit)"]
        if shown
        else []
    )


def _doubted(o: Options) -> list[str]:
    """What a fit says of itself that its intervals don't hold."""
    if o.fit is None:
        return []
    warnings = read_json(o.fit, "fit", "what kinid fit --json wrote", "fit anew with --json").get("warnings") or ()
    return [
        f"the fit says: {warning}; its intervals promise too much" for warning in warnings if "rejected" in str(warning)
    ]


def _unreached(o: Options, motion: Trajectory) -> list[str]:
    """Speeds that were asked for, and that joints or too short a way don't allow."""
    import numpy as np

    if motion.place is None or len(motion) < 2:
        return []
    speed = np.linalg.norm(np.gradient(motion.tip, motion.t, axis=0), axis=1)
    slow = (motion.phase == "approach") & (motion.place[:, 2] > -0.001)
    rows = {"travel": motion.place[:, 2] < 0, "contact": slow, "speed": motion.phase == "slide"}
    lines = []
    for parameter, where in rows.items():
        if parameter not in o.given or not where.any():
            continue
        (option, asked), reached = o.given[parameter], float(speed[where].max())
        if reached < REACHED * asked:
            lines.append(
                f"{option} {asked:g}: reached at most {reached:.3g} m/s; the way is too short for more, "
                "or limits forbid it"
            )
    return lines
