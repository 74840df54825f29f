"""`kinid fit`: the parameters of a model, from one log or from many."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli.batch import Each, On, Workers
from kinid.cli.options import LogFiles, ModelText, PlotFile, RigFile, names
from kinid.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.identification.fit import Fit
    from kinid.modeling.model import Model

EXAMPLES = """Examples:

kinid fit poke.parquet --model kelvin-voigt,coulomb-friction

kinid fit poke.csv --rig rig.toml --model hunt-crossley --json fit.json --plot fit.html

kinid fit motion.npz --model rigid-body,joint-torque-offset,joint-coulomb-friction

kinid fit tester.csv --model hunt-crossley          (t, depth, normal_force: needs no rig)

kinid fit tuesday/*.parquet --model kelvin-voigt,surface-offset --json shared.json

kinid fit s3://lab/tuesday --model kelvin-voigt --each -o fits --on dask
"""


def fit(
    logs: LogFiles,
    model: ModelText,
    rig: RigFile = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Estimates to write as JSON.")] = None,
    plot: PlotFile = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="Table of measured and predicted readings; of many logs a folder that keeps fits."
        ),
    ] = None,
    each: Each = False,
    on: On = None,
    workers: Workers = None,
) -> None:
    """Estimates with 95 % intervals, the error on samples seen and unseen, and what to doubt."""
    from kinid.cli.campaign import fit_campaign, is_many
    from kinid.cli.contact import rig_path
    from kinid.writers import check_outputs, check_table_name, write_json, write_table, write_text

    chosen = parse_model(model)
    if each:
        from kinid.batch.jobs import Job
        from kinid.cli.batch import each_log

        refuse_page(plot)
        each_log(Job("fit", chosen.names), logs, rig, out, on, workers, json_file)
        return
    if on is not None or workers is not None or is_many(logs):
        fit_campaign(logs, chosen, rig, json_file, plot, out, on, workers)
        return
    (log,) = logs
    if out is not None:
        check_table_name(out)
    check_outputs((out, plot, json_file), (log, rig_path(log, rig)))
    the_rig, data = data_for(log, rig)
    from kinid.identification.fit import fit_model

    result = fit_model(chosen, data, the_rig)
    if json_file is not None:
        write_json(json_file, result.to_save())
    if out is not None:
        write_table(out, prediction_columns(result))
    if plot is not None:
        from kinid.reports.fit_plots import fit_page

        write_text(plot, fit_page(result, title=f"{log.name}: {chosen}"))
    from kinid.calibration.coupling import alike
    from kinid.cli.show import show_fit, written

    show_fit(result)
    for line in alike(result):  # what is open stands among the fit's own doubts
        typer.echo(f"doubt: {line}")
    if any("kinid diagnose" in warning for warning in result.warnings):
        from kinid.cli.advice import to_diagnose

        typer.echo(f"next: {to_diagnose(log, rig, chosen, data, the_rig)}")
    written((out, plot, json_file))


def refuse_page(page: Path | None) -> None:
    """Refuse a page, which is of one log or of one model."""
    if page is not None:
        raise InputError(f"{page} with --each", "no page: there is one model for each log", "leave it out")


def parse_model(text: str) -> Model:
    """A model from names separated by commas."""
    from kinid.modeling.model import Model

    effects = names(text)
    if not effects:
        raise InputError(f"--model '{text}'", "names of effects, separated by commas", "see kinid fit --help")
    return Model(*effects)


def data_for(log: Path, rig: Path | None) -> tuple[Rig, Log]:
    """The rig, and the log with all that it holds: a fit, a comparison and a diagnosis are of the same channels."""
    from kinid.cli.contact import load

    the_rig, the_log, _ = load(log, rig)
    return the_rig, the_log


def prediction_columns(result: Fit) -> dict[str, NDArray[np.generic]]:
    """Time, and each channel measured and predicted."""
    columns: dict[str, NDArray[np.generic]] = {"t": result.experiment.signals.t}
    predicted = result.predict()
    for i, name in enumerate(result.experiment.layout.channels):
        columns[name] = result.experiment.measured[i]
        columns[f"{name}_model"] = predicted[i]
    force = result.experiment.normal_force
    if force is not None and "normal_force" not in columns:
        from kinid.reports.fit_plots import normal_of

        # the contact's own force is without the sensor's bias
        columns |= {
            "normal_force": force,
            "normal_force_model": normal_of(result.experiment, result.predict(calibrated=False)),
        }
    return columns
