"""`kinid diagnose`: where a model fails, which effect it lacks, and the error falling once it is added."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli import complete
from kinid.cli.batch import Each, On, Workers
from kinid.cli.options import LogFilesOrNone, ModelText, RigFile

if TYPE_CHECKING:
    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.diagnosis import Diagnosis
    from kinid.modeling.model import Model

EXAMPLES = """Examples:

kinid diagnose poke.parquet --model kelvin-voigt,coulomb-friction

kinid diagnose poke.parquet --model hunt-crossley --json found.json --report found.html

kinid diagnose poke.parquet --model hooke --add relaxation --max-effects 2

kinid diagnose --explain relaxation
"""


# as long as its options and their help
def diagnose(
    logs: LogFilesOrNone = None,
    model: ModelText = "",
    rig: RigFile = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="The diagnosis to write as JSON.")] = None,
    report: Annotated[Path | None, typer.Option(help="Report to write: one offline HTML file.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="Table of readings, measured and predicted; of many logs a folder that keeps fits."
        ),
    ] = None,
    add: Annotated[
        list[str] | None,
        typer.Option(
            help="An effect to add whatever the evidence says; once for each.",
            show_default=False,
            autocompletion=complete.effect,
        ),
    ] = None,
    max_effects: Annotated[int, typer.Option(help="Effects to add at most.")] = 8,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Error that may be left [N, or N·m]; default: 2 % of the readings, or the noise.", show_default=False
        ),
    ] = None,
    explain: Annotated[
        str | None,
        typer.Option(
            help="Say what an effect is and looks like, and nothing else; all lists the catalogue.",
            autocompletion=complete.effect,
        ),
    ] = None,
    each: Each = False,
    on: On = None,
    workers: Workers = None,
) -> None:
    """Compare a model with the measurement: where it fails, what is missing, the error with it, and what to measure
    next.
    """
    if explain is not None:
        explained(explain)
        return
    from kinid.cli.campaign import diagnose_campaign, is_many
    from kinid.cli.contact import load, rig_path
    from kinid.cli.fit import parse_model
    from kinid.errors import InputError
    from kinid.modeling.applicability import expand_names, refuse_names
    from kinid.writers import check_outputs, check_table_name, write_json, write_table, write_text

    if not logs:
        raise InputError(
            "no log", "a log to diagnose", "kinid diagnose LOG --model MODEL, or kinid diagnose --explain all"
        )
    if not model:
        raise InputError(
            "no --model", "the model to ask about", "kinid diagnose LOG --model kelvin-voigt,coulomb-friction"
        )
    chosen = parse_model(model)
    refuse_names(expand_names(add or [], chosen), chosen, max_effects)
    if each or on is not None or workers is not None or is_many(logs):
        if add or tolerance is not None:
            raise InputError(
                "--add or --tolerance for many logs", "neither", "put the effect into --model, or leave it"
            )
        if each:
            from kinid.batch.jobs import Job
            from kinid.cli.batch import each_log
            from kinid.cli.fit import refuse_page

            refuse_page(report)
            each_log(Job("diagnose", chosen.names, max_effects), logs, rig, out, on, workers, json_file)
        else:
            diagnose_campaign(logs, chosen, rig, json_file, report, out, max_effects, on, workers)
        return
    (log,) = logs
    if out is not None:
        check_table_name(out)
    check_outputs((out, report, json_file), (log, rig_path(log, rig)))
    the_rig, the_log, _ = load(log, rig)
    from kinid.cli.show import written
    from kinid.cli.show_diagnosis import show_diagnosis

    result = _watched(the_log, the_rig, chosen, add or [], max_effects, tolerance, rig_path(log, rig), json_file)
    if json_file is not None:
        write_json(json_file, result.to_dict())
    if out is not None:
        from kinid.cli.fit import prediction_columns

        write_table(out, prediction_columns(result.fit))
    if report is not None:
        from kinid.reports.diagnosis_page import diagnosis_page

        provenance = the_log.provenance.then("rig", file=str(rig_path(log, rig) or "none")).then(
            "diagnose", model=str(chosen), on=datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        )
        write_text(report, diagnosis_page(result, title=f"{log.name}: {chosen}", provenance=provenance))
    show_diagnosis(result)
    written((out, report, json_file))


def _watched(
    log: Log,
    rig: Rig,
    model: Model,
    add: list[str],
    max_effects: int,
    tolerance: float | None,
    rig_file: Path,
    json_file: Path | None,
) -> Diagnosis:
    """The diagnosis with what to plan next, and what it is doing on the terminal's error stream."""
    from kinid.cli.campaign import watched
    from kinid.diagnosis import diagnose as run
    from kinid.planning.advice import Advisor

    with watched() as progress:
        found = run(log, rig, model=model, add=add, max_effects=max_effects, tolerance=tolerance, progress=progress)
        return Advisor(found, rig, rig_file, json_file).advised(progress)


def explained(name: str) -> None:
    """What an effect is, what it looks like, what it is mistaken for, and what shows it; of "all", each in a line."""
    from kinid import effects
    from kinid.cli.show import console, say
    from kinid.effects import TOGETHER, Kind, Layout

    out = console()
    if name == "all":
        titles = {known: effects.get(known).title for known in effects.catalogue()}
        titles |= {known: " and ".join(parts) for known, parts in TOGETHER.items() if parts}
        say(out, *(f"{known:25s} {title}" for known, title in titles.items()))
        return
    if TOGETHER.get(name):
        say(out, f"{name}: stands for {' and '.join(TOGETHER[name])}; --explain one of them")
        return
    effect = effects.get(name)
    kind: Kind = "joints" if "joint" in {stage.value for stage in effect.stages()} else "wrench"
    channels = ("tau1",) if kind == "joints" else ("fx", "fy", "fz", "tx", "ty", "tz")
    layout = Layout(channels, kind, ("joint_1",) if kind == "joints" else ())
    lines = [
        f"{effect.id}: {effect.title}" + (", a base law" if effect.base else ""),
        f"  {effect.equation}",
        "",
        f"looks like   {effect.signature}",
        f"shown by     {effect.excited_by}",
        f"acts on      {', '.join(stage.value for stage in effect.stages())}",
    ]
    if effect.requires:
        lines.append(f"needs        {' or '.join(effect.requires)} in the model")
    lines += [f"mistaken for {other}: {how}" for other, how in effect.confusions.items()]
    shown: dict[str, str] = {}
    for p in effect.parameters(layout):
        shown.setdefault(p.name.split("[")[0], f"parameter    {p.name.split('[')[0]} ({p.symbol}) in {p.unit}")
    say(out, *lines, *shown.values(), f"source       {effect.source}")
