"""`kinid lab slides`: four slides over the mould, and the borders that are found along them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kinid.writers import Json


def slides(out: Path, seed: int) -> Json:
    """Slide four times, print the borders found beside the true ones, and write logs, table and page into a folder."""
    from rich.table import Table

    from kinid.cli.show import console, right, written
    from kinid.lab import slide_study
    from kinid.lab.folder import at_work, check_free

    check_free(out)
    with console().status("the mould is slid on …") as status:
        rides = slide_study.study(seed, lambda number: status.update(f"the mould is slid on, {number} of 4 …"))
    with at_work(out):
        check_free(out)
        table_file, page = slide_study.write(out, rides)
    table = Table(
        *right("slide", "leg", "border [mm]", "found [mm]", "95 % ± [mm]", "off [mm]"), box=None, pad_edge=False
    )
    for c in (c for ride in rides for c in ride.crossings):
        figures = (1e3 * value for value in (c.true, c.found, 1.96 * c.sd, c.error))
        table.add_row(str(c.slide), str(c.leg), *("–" if np.isnan(x) else f"{x:.2f}" for x in figures))
    console().print(table)
    console().print(slide_study.said(rides))
    written((table_file, page))
    return {
        "experiment": "slides",
        "seed": seed,
        "crossings": slide_study.facts(rides),
        "table": str(table_file),
        "page": str(page),
    }
