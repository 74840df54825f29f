"""`kinid compare`: models side by side against the measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinid.cli import complete
from kinid.cli.options import LogFiles, PlotFile, RigFile

EXAMPLES = """Examples:

kinid compare poke.parquet --model hooke --model kelvin-voigt --model hunt-crossley

kinid compare poke.csv --model kelvin-voigt,coulomb-friction --model hunt-crossley,coulomb-friction --plot models.html
"""


def compare(
    logs: LogFiles,
    model: Annotated[
        list[str],
        typer.Option(
            help="A model: effects separated by commas; once for each.",
            show_default=False,
            autocompletion=complete.model,
        ),
    ],
    rig: RigFile = None,
    reference: Annotated[
        str | None,
        typer.Option(help="The model that differences are taken to; default: the best.", autocompletion=complete.model),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="The table to write as JSON.")] = None,
    plot: PlotFile = None,
) -> None:
    """Models by their error on samples that their fits have not seen, with paired differences."""
    from kinid.campaign.files import is_campaign
    from kinid.cli.campaign import compare_campaign
    from kinid.cli.contact import rig_path
    from kinid.cli.fit import data_for, parse_model
    from kinid.writers import check_outputs, write_json, write_text

    models = [parse_model(text) for text in model]
    named = None if reference is None else str(parse_model(reference))
    if is_campaign(logs):
        compare_campaign(logs, models, rig, named, json_file, plot)
        return
    (log,) = logs
    check_outputs((plot, json_file), (log, rig_path(log, rig)))
    the_rig, data = data_for(log, rig)
    from kinid.identification.compare import compare as run

    result = run(models, data, the_rig, reference=named)
    if json_file is not None:
        write_json(json_file, result.to_dict())
    if plot is not None:
        from kinid.reports.fit_plots import comparison_page

        write_text(plot, comparison_page(result, title=log.name))
    from kinid.cli.show import show_comparison, written

    show_comparison(result)
    written((plot, json_file))
