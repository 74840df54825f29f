"""`kinid lab teleoperation`: schemes against delay, jitter, loss and a wrong map."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from kinid.lab.teleoperation import Comparison
    from kinid.lab.teleoperation_study import Outcome
    from kinid.writers import Json


def teleoperation(out: Path, material: str, seed: int, measured_map: Path | None, place: tuple[float, float]) -> Json:
    """Compare schemes at a place [m] of a material, run the study of all, print both, write them into a folder."""
    from kinid.cli.lab_runs import progress_bar
    from kinid.cli.show import console, written
    from kinid.lab import teleoperation as lab
    from kinid.lab import teleoperation_study
    from kinid.lab.folder import at_work, check_free

    check_free(out)
    with console().status("a poke, its fit, and reflection of both …"):
        compared = lab.compare(material, seed, measured_map=measured_map, place=place)
    with progress_bar() as progress:
        bar = progress.add_task("all schemes in six degrees of freedom", total=1.0)
        found = teleoperation_study.study(progress=lambda share: progress.update(bar, completed=share))
    with at_work(out):
        check_free(out)
        page = lab.write(out, compared, found)
    _show(compared, found)
    facts = out / "teleoperation.json"
    written((facts, page))
    known = json.loads(facts.read_text(encoding="utf-8"))
    return {"experiment": "teleoperation", "seed": seed, "page": str(page), **known}


def _show(compared: Comparison, found: Outcome) -> None:
    from rich.table import Table

    from kinid.cli.show import console, right
    from kinid.lab.teleoperation_study import NETWORKS, bound_cells, cells, yielded

    out, (x, y) = console(), compared.place
    stiffnesses = dict.fromkeys(c.stiffness for c in found.cases)
    out.print(
        f"{compared.material} at ({1e3 * x:g}, {1e3 * y:g}) mm: true {compared.truth.stiffness:.4g} N/m and "
        f"{compared.truth.damping:.3g} N·s/m; {compared.map_source} says {compared.believed.stiffness:.4g} N/m and "
        f"{compared.believed.damping:.3g} N·s/m",
    )
    out.print(compared.study.table())
    for line in NETWORKS:
        heads, rows = cells(found, line)
        table = Table(*right(heads[0]), heads[1], *right(*heads[2:]), title=f"{line}; six degrees of freedom")
        for row in rows:
            table.add_row(*row)
        out.print(table)
    out.print(
        "transparency error, error of the stiffness felt at rest, rms way of the slave's tip from the master's [mm]; "
        f"the slave's own coupling takes {', '.join(f'{100 * yielded(k):.0f} %' for k in stiffnesses)} off what is felt"
    )
    heads, rows = bound_cells(found)
    table = Table(
        heads[0], *right(*heads[1:]), title="hardest material that a delay bears, simulated and by theory [N/m]"
    )
    for row in rows:
        table.add_row(*row)
    out.print(table)
