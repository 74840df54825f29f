"""`kinid fit`, `compare` and `diagnose` of many logs, and what they print."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from kinid.cli.show import console, say, shared_warnings, written
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.campaign import Campaign
    from kinid.campaign.compare import CampaignComparison
    from kinid.campaign.diagnosis import CampaignDiagnosis
    from kinid.identification.pooling.result import PooledFit
    from kinid.modeling.model import Model

Progress = Callable[[str], None]
#: logs that are printed one a row, and parameters of each
MOST_ROWS, MOST_NUMBERS = 40, 4


def is_many(logs: Sequence[Path]) -> bool:
    """Whether paths and addresses name many logs."""
    from kinid.batch.logs import is_many as several

    return several(logs)


@contextmanager
def _campaign(
    logs: Sequence[Path], rig: Path | None, out: Path | None, on: str | None, workers: int | None, model: Model
) -> Iterator[Campaign]:
    """The logs as one; by a runner where one is named, or they are far away."""
    from kinid.batch.store import is_remote

    if on is None and workers is None and not any(map(is_remote, logs)):
        from kinid.campaign import Campaign

        refuse_table(out)
        yield Campaign(list(logs), rig)
        return
    from kinid.cli.batch import campaign_on

    with campaign_on(logs, rig, out, on, workers, model) as campaign:
        yield campaign


@contextmanager
def watched() -> Iterator[Progress]:
    """What is being done, on the terminal's error stream."""
    from rich.console import Console

    out = Console(stderr=True)
    if not out.is_terminal:
        yield lambda _: None
        return
    with out.status("reading") as status:
        yield lambda words: status.update(escape(words))


def fit_campaign(
    logs: Sequence[Path],
    model: Model,
    rig: Path | None,
    json_file: Path | None,
    plot: Path | None,
    out: Path | None,
    on: str | None = None,
    workers: int | None = None,
) -> None:
    """`kinid fit` of many logs."""
    from kinid.writers import check_outputs, write_json, write_text

    check_outputs((plot, json_file), (*[log for log in logs if log.is_file()], rig))
    with _campaign(logs, rig, out, on, workers, model) as campaign, watched() as progress:
        result = campaign.fit(model, progress=progress)
    if json_file is not None:
        write_json(json_file, result.to_dict())
    if plot is not None:
        from kinid.reports.campaign_page import fit_page

        write_text(plot, fit_page(result, title=f"{len(result.logs)} logs: {model}"))
    show_pooled(result)
    if any("kinid diagnose" in warning for warning in result.warnings):
        from kinid.cli.advice import to_diagnose_all

        say(console(), f"next: {to_diagnose_all(logs, rig, model, on, workers)}")
    written([path for path in (plot, json_file) if path is not None])


def compare_campaign(
    logs: Sequence[Path],
    models: Sequence[Model],
    rig: Path | None,
    reference: str | None,
    json_file: Path | None,
    plot: Path | None,
) -> None:
    """`kinid compare` of many logs."""
    from kinid.campaign import Campaign
    from kinid.writers import check_outputs, write_json, write_text

    check_outputs((plot, json_file), (*[log for log in logs if log.is_file()], rig))
    with watched() as progress:
        result = Campaign(list(logs), rig).compare(models, reference=reference, progress=progress)
    if json_file is not None:
        write_json(json_file, result.to_dict())
    if plot is not None:
        from kinid.reports.campaign_page import comparison_page

        write_text(
            plot, comparison_page(result, title=f"{len(result.rows)} models, {len(result.rows[0].fit.logs)} logs")
        )
    show_compared(result)
    written([path for path in (plot, json_file) if path is not None])


def show_compared(result: CampaignComparison) -> None:
    """Models by rank, with their errors on blocks and on logs held out."""
    from kinid.reports.fit_plots import winner

    out = console()
    table = Table("rank", "model", box=None, pad_edge=False)
    for heading in (f"held out [{result.unit}]", "by log", "difference", "± standard error"):
        table.add_column(heading, justify="right")
    for row in result.rows:
        same = str(row.fit.model) == result.reference
        table.add_row(
            str(row.rank),
            str(row.fit.model),
            f"{row.fit.error.held_out:.4g}",
            _figure(row.fit.by_log),
            "reference" if same else f"{row.difference:+.3g}",
            "" if same else f"{row.standard_error:.2g}",
        )
    out.print(table)
    say(out, winner(result))
    out.print(
        f"the noise is {result.noise_floor:.4g} {result.unit}; differences are means over logs held out, to "
        f"{result.reference}",
        soft_wrap=True,
    )
    say(out, *shared_warnings([row.fit for row in result.rows]))


def diagnose_campaign(
    logs: Sequence[Path],
    model: Model,
    rig: Path | None,
    json_file: Path | None,
    report: Path | None,
    out: Path | None,
    max_effects: int,
    on: str | None = None,
    workers: int | None = None,
) -> None:
    """`kinid diagnose` of many logs."""
    from kinid.writers import check_outputs, write_json, write_text

    check_outputs((report, json_file), (*[log for log in logs if log.is_file()], rig))
    with _campaign(logs, rig, out, on, workers, model) as campaign, watched() as progress:
        result = campaign.diagnose(model, max_effects=max_effects, progress=progress)
    if json_file is not None:
        write_json(json_file, result.to_dict())
    if report is not None:
        from kinid.reports.campaign_page import diagnosis_page

        write_text(report, diagnosis_page(result, title=f"{len(result.before.logs)} logs: {model}"))
    show_diagnosed(result)
    written([path for path in (report, json_file) if path is not None])


def show_diagnosed(result: CampaignDiagnosis) -> None:
    """Verdict first, odd logs, the error falling, which log shows what, differences, the model now."""
    out = console()
    out.print(Text.assemble((result.verdict, "bold"), f": {result.says}"), soft_wrap=True)
    for name, why in result.odd.items():
        out.print(f"odd: {name}: {why}", soft_wrap=True)
    table = Table("model", box=None, pad_edge=False)
    for heading in (f"held out [{result.fit.error.unit}]", "by log", "explained"):
        table.add_column(heading, justify="right")
    for step, error in zip(result.steps, result.by_log):
        name = "as asked" if step.added is None else f"+ {step.added}"
        table.add_row(name, f"{step.held_out:.4g}", _figure(error), f"{100 * step.explained:.0f} %")
    table.add_row("noise alone", f"{result.fit.error.noise_floor:.4g}", "", "")
    out.print(table)
    for name in result.added:
        shown = result.shown.get(name, {})
        some = [log for log, verdict in shown.items() if verdict == "present"]
        none = [log for log, verdict in shown.items() if verdict == "absent"]
        words = f"{name} shows in {len(some)} of {len(shown)} logs by themselves"
        out.print(words + (f", not in {', '.join(none)}" if none else ""), soft_wrap=True)
    for one in result.differences:
        out.print(str(one), soft_wrap=True)
    out.print()
    show_pooled(result.fit)


def refuse_table(out: Path | None) -> None:
    """Refuse a table of readings, which is of one log."""
    if out is not None:
        raise InputError(
            f"-o {out} for many logs", "a table of one log's readings", "fit that log alone, use --json, or --on"
        )


def show_pooled(result: PooledFit) -> None:
    """What is shared, each log, errors, and doubts."""
    out = console()
    table = Table("shared parameter", box=None, pad_edge=False)
    for heading in ("estimate", "95 % from", "to"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    table.add_column("spread between logs", justify="right")
    for p in result.parameters.values():
        spread = result.spread.get(p.name)
        table.add_row(
            p.name,
            f"{p.value:.5g}",
            f"{p.low:.5g}",
            f"{p.high:.5g}",
            p.unit,
            "" if spread is None else f"{spread.value:.3g}",
        )
    if table.row_count:
        out.print(table)
    show_logs(result)
    error = result.error
    by_log = f", {result.by_log:.4g} on logs held out" if result.by_log == result.by_log else ""
    aside, total = len(result.put_aside), len(result.logs) + len(result.put_aside)
    out.print(
        f"error {error.train:.4g} {error.unit} rms on samples seen, {error.held_out:.4g} on blocks held out{by_log}; "
        f"the noise is {error.noise_floor:.4g}" + (f"; {aside} of {total} logs put aside" if aside else ""),
        soft_wrap=True,
    )
    for warning in result.warnings:
        out.print(f"doubt: {warning}", soft_wrap=True)


def _figure(error: float) -> str:
    """An error, or nothing where there is none, as of logs held out where there is one."""
    return f"{error:.4g}" if math.isfinite(error) else ""


def show_logs(result: PooledFit) -> None:
    """Logs as rows: errors and their own parameters."""
    out = console()
    unit = result.error.unit
    names = list(dict.fromkeys(name for log in result.logs for name in log.parameters))[:MOST_NUMBERS]
    table = Table("log", box=None, pad_edge=False)
    for heading in (f"held out [{unit}]", "by log", "alone", *names):
        table.add_column(heading, justify="right")
    table.add_column("")
    for log in result.logs[:MOST_ROWS]:
        own = [log.parameters.get(name) for name in names]
        table.add_row(
            log.name,
            f"{log.error.held_out:.4g}",
            _figure(log.by_log),
            _figure(log.alone_error),
            *("" if p is None else f"{p.value:.3g} ± {0.5 * (p.high - p.low):.1g}" for p in own),
            "odd" if log.name in result.odd else "",
        )
    out.print()
    out.print(table)
    if len(result.logs) > MOST_ROWS:
        out.print(f"and {len(result.logs) - MOST_ROWS} more logs in the JSON")
    if table.row_count:
        out.print(
            "held out: on blocks of time that the fit hasn't seen; by log: what is shared fitted to the other logs; "
            "alone: the fit of this log by itself, held out",
            soft_wrap=True,
        )
    out.print()
