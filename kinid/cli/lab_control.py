"""`kinid lab control`: force control with constant gains, an online estimate and a measured map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinid.lab.control_study import Outcome
    from kinid.writers import Json


def control(out: Path, seed: int, measured_map: Path | None) -> Json:
    """Map the mould or take a map of it, run the study, print its margins and errors, and write it into a folder."""
    from kinid.cli.show import console, written
    from kinid.lab import control_page, control_study
    from kinid.lab.folder import at_work, check_free
    from kinid.mapping.property_map import PropertyMap

    check_free(out)
    grown = None if measured_map is None else PropertyMap.read(measured_map)
    poked = "" if grown is not None else "the mould is poked a hundred times, and then "
    with console().status(f"{poked}pushed, slid on and polished with six controllers …"):
        if measured_map is None:
            found = control_study.study(seed)
        else:
            found = control_study.study(seed, grown, measured_map.name)
    with at_work(out):
        check_free(out)
        table, grown_file, page = control_page.write(out, found)
    _show(found)
    written((table, grown_file, page))
    known = control_page.facts(found)
    return {"experiment": "control", "seed": seed, "page": str(page), "map": str(grown_file), **known}


def _show(found: Outcome) -> None:
    from rich.table import Table

    from kinid.cli.show import console, right
    from kinid.lab.control_page import design_cells, falls
    from kinid.lab.control_study import MARGINS

    out = console()
    title = f"bandwidths at equal margins, {MARGINS} on all that a controller may meet"
    table = Table("controller", *right("ω [rad/s]"), "designed", "met in fact", title=title)
    for design in found.designs:
        table.add_row(*design_cells(design))
    out.print(table)
    title = f"force errors; map by {found.map_source}"
    table = Table("task", "controller", *right("rms [N]", "rms [%]", "beyond [%]", "overshoot [%]"), title=title)
    for s in found.scores:
        shares = (f"{100 * value:.2f}" for value in (s.share, s.beyond))
        table.add_row(s.task, s.controller, f"{s.error:.3f}", *shares, f"{100 * s.overshoot:.1f}")
    out.print(table)
    heads = right("rms", "beyond", "rms, model holds", "beyond, model holds")
    table = Table("task", *heads, title="how many times less error with the map than with constant gains")
    for task, *values in falls(found):
        table.add_row(task, *("–" if value is None else f"{value:.2f}" for value in values))
    out.print(table)
    out.print(
        "beyond: against the wanted force behind the filter that an arm can follow; model holds: where the map's own "
        "residuals don't exceed its noise twice"
    )
