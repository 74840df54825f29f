"""`kinid changes`: where the material changes along the slides of a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinid.errors import InputError

EXAMPLES = """Examples:

kinid changes slide.parquet

kinid changes slide.parquet --rig rig.toml --json borders.json --false-alarms 0.01
"""


def changes(
    log: Annotated[Path, typer.Argument(help="A log with slides, of any format that kinid reads.", show_default=False)],
    rig: Annotated[
        Path | None, typer.Option(help="What was measured with what; default: rig.toml beside the log.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Borders to write as JSON.")] = None,
    false_alarms: Annotated[float, typer.Option(help="Probability that a leg on one material gives any alarm.")] = 1e-3,
) -> None:
    """Borders and jumps along slides: where and when force over depth and friction change, and how sure that is.

    Each straight leg in one direction is looked at by itself; a border that is crossed to and fro is there twice,
    and one that a single way shows is doubted.
    """
    from kinid.cli.contact import load, rig_path
    from kinid.cli.show import console, say, written
    from kinid.contact.doubts import contact_doubts
    from kinid.contact.series import contact_series
    from kinid.mapping.changes import find_changes
    from kinid.writers import check_outputs, write_json

    check_outputs((json_file,), (log, rig_path(log, rig)))
    the_rig, the_log, robot = load(log, rig)
    touch = contact_series(the_log, the_rig, robot=robot)
    doubts = contact_doubts(the_log, the_rig, robot, touch)
    try:
        found = find_changes(touch, false_alarms)
    except InputError as error:  # no slide, it may be, where units or axes hide it
        if not doubts:
            raise
        raise InputError(error.found, error.expected, f"first see to what is to be doubted: {doubts[0]}") from None
    if json_file is not None:
        write_json(json_file, [change.to_dict() for change in found])
    out = console()
    say(out, *(f"doubt: {doubt}" for doubt in doubts))
    if not found:
        out.print("no border: along every leg the material is the same")
    else:
        from rich.table import Table

        table = Table(box=None, pad_edge=False)
        for title in ("t [s]", "slip1 [mm]", "slip2 [mm]", "95 % ± [mm]", "stiffness [N/m]", "friction"):
            table.add_column(title, justify="right")
        for c in found:
            table.add_row(
                f"{c.t:.2f}",
                f"{1e3 * c.slip1:.2f}",
                f"{1e3 * c.slip2:.2f}",
                f"{1e3 * 1.96 * c.sd:.2f}",
                f"{c.before.stiffness:.4g} → {c.after.stiffness:.4g}",
                f"{c.before.friction:.3g} → {c.after.friction:.3g}",
            )
        out.print(table)
        say(
            out,
            *(
                f"doubt: the border at {c.t:.2f} s may be none: {c.doubt}; steps that go with time and not with place "
                "come of what a law lacks, as relaxation: slide both ways across it, and kinid diagnose the log"
                for c in found
                if c.doubt
            ),
        )
    written([path for path in (json_file,) if path is not None])
