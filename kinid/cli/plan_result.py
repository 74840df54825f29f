"""What `kinid plan` writes and says: the plan, what it assumed, what speaks against that, what isn't reached."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

from kinid.cli.plan_arguments import Options, model_of
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.data.rig import Rig
    from kinid.planning import Trajectory
    from kinid.planning.information import Interval

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
    which = "it" if len(shown) == 1 else "them"
    return [f"assumed: {', '.join(shown)} (name {which} with --value or --fit)"] if shown else []


def _doubted(o: Options) -> list[str]:
    """What a fit says of itself that its intervals don't hold."""
    if o.fit is None:
        return []
    from kinid.identification.saved import MEND, fit_facts

    warnings = fit_facts(o.fit).get("warnings") or []
    if not isinstance(warnings, list):
        raise InputError(f"warnings = {str(warnings)[:40]} in {o.fit}", "a list of texts", MEND)
    return [
        f"the fit says: {said}; its intervals promise too much" for said in map(str, warnings) if "rejected" in said
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


def finish(o: Options, motion: Trajectory, rig: Rig, facts: dict[str, object]) -> None:
    """Write what was asked for, and show what the motion uses of each limit."""
    from rich.table import Table

    from kinid.cli.show import console, right, written
    from kinid.writers import write_json, write_text

    lines = remarks(o, motion, model_of(o)[1] if o.model is not None or o.fit is not None else ())
    motion.write(o.out)
    if o.json is not None:
        summary = {**facts, "motion": _summary(motion), "remarks": lines}
        write_json(o.json, summary)
    if o.plot is not None:
        from kinid.planning.figures import plan_page

        write_text(o.plot, plan_page(motion, title=o.out.name))
    if o.preview is not None:
        from kinid.planning.preview import preview_page

        write_text(o.preview, preview_page(motion, rig, title=o.out.name))
    if o.mcap is not None:
        from kinid.planning.ros import write_joint_trajectory

        write_joint_trajectory(motion, o.mcap)
    title = f"{len(motion)} samples over {motion.duration:.2f} s"
    table = Table("quantity", "nearest to its limit", *right("used", "value", "limit"), title=title)
    for use in motion.provenance.get("used", ()):
        table.add_row(
            use["quantity"], use["joint"], f"{100 * use['share']:.0f} %", f"{use['value']:.4g}", f"{use['limit']:.4g}"
        )
    console().print(table)
    if table.row_count:
        typer.echo("values and limits in rad, N·m and s; of a joint that slides in m, N and s")
    for note in motion.provenance.get("notes", ()):
        typer.echo(f"note: {note}")
    for line in lines:
        typer.echo(line)
    written(o.written)


def _summary(motion: Trajectory) -> dict[str, object]:
    """For JSON: how long, how deep, what force to expect, and how much of each limit is used."""
    import numpy as np

    force = np.nan if motion.normal_force is None else motion.normal_force
    known = bool(np.isfinite(force).all())
    return {
        "robot": motion.provenance.get("robot"),
        "samples": len(motion),
        "duration": motion.duration,
        "phases": {str(name): int(count) for name, count in zip(*np.unique(motion.phase, return_counts=True))},
        "deepest": None if motion.place is None else float(motion.place[:, 2].max()),
        "largest_normal_force": float(np.max(force)) if known else None,
        "used": list(motion.provenance.get("used", ())),
        "notes": list(motion.provenance.get("notes", ())),
    }


def show_intervals(intervals: Iterable[Interval]) -> None:
    """That a plan is expected to give."""
    from rich.table import Table

    from kinid.cli.show import console, right

    table = Table("parameter", *right("assumed", "±"), "unit", title="95 % intervals to expect")
    for each in intervals:
        half = f"{each.half:.2g}" if each.half < float("inf") else "open"
        table.add_row(each.name, f"{each.value:.5g}", half, each.unit)
    console().print(table)


def bound_words(name: str, motion: Trajectory) -> str:
    """A bound that the optimum reaches; of the joints, which limit and whose."""
    if name != "joints":
        return {
            "deepest": "the greatest depth",
            "speed": "the speed",
            "force": "the force",
            "bandwidth": "the bandwidth",
        }.get(name, name)
    nearest = max(
        (use for use in motion.provenance["used"] if use["quantity"] in ("velocity", "acceleration", "jerk")),
        key=lambda use: use["share"],
    )
    return f"the {nearest['quantity']} of {nearest['joint']}"
