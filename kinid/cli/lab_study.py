"""`kinid lab study`: what was published, found again in the laboratory and in simulation."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinid.writers import Json

#: closed-loop logs of a minute
MINUTES = 2


def study(out: Path, seed: int) -> Json:
    """Find the published materials again, follow a drifting contact, print both, and write them into a folder."""
    from rich.table import Table

    from kinid.cli.show import console, written
    from kinid.lab import minute_study, simulation_study
    from kinid.lab import study as published
    from kinid.lab.folder import at_work, check_free

    check_free(out)
    with console().status("three materials, poked and slid on, and drifting contacts followed for a minute …"):
        rows = published.study(seed)
        runs, errors = simulation_study.simulate(seed=seed)
        flags = minute_study.study(range(seed, seed + MINUTES))
    with at_work(out):
        check_free(out)
        paths = [published.write(out, rows), *simulation_study.write(out, runs, errors), minute_study.write(out, flags)]
    table = Table()
    for title in ("material", "parameter", "published", "true", "estimated", "95 % from", "to", "unit"):
        table.add_column(title, justify="left" if title in ("material", "parameter", "unit") else "right")
    for row in rows:
        table.add_row(row.material, row.parameter, *(f"{value:.4g}" for value in row[2:7]), row.unit)
    console().print(table)
    table = Table(
        title="a contact that stiffens by 10 N/m a second: errors in % of force (largest), K, B, n (rms); samples "
        f"called valid where {100 * minute_study.ASKED:.0f} % is asked, and those of them that are so [%]"
    )
    table.add_column("method")
    for title in ("from [s]", "to [s]", "force", "K", "B", "n", "valid", "right"):
        table.add_column(title, justify="right")
    for error in errors:
        table.add_row(error.method, f"{error.start:g}", f"{error.end:.3g}", *map(_percent, error[3:]))
    console().print(table)
    table = Table(
        title=f"{MINUTES} closed-loop logs of a minute on materials that drift: samples called valid, and those of "
        f"them within {100 * minute_study.ASKED:.0f} % [%]"
    )
    table.add_column("method")
    for title in ("valid", "K", "B", "n", "all"):
        table.add_column(title, justify="right")
    for flag in flags:
        table.add_row(flag.method, *map(_percent, flag[2:]))
    console().print(table)
    written(paths)
    return {
        "experiment": "study",
        "seed": seed,
        "parameters": [row._asdict() for row in rows],
        "table": str(paths[0]),
        "simulation": str(paths[1]),
        "page": str(paths[2]),
        "minutes": str(paths[3]),
    }


def _percent(share: float) -> str:
    return "–" if isnan(share) else f"{100 * share:.2f}"
