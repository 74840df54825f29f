"""Pages of a campaign: logs as rows, what they share, what each has for itself, errors on logs held out."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinid.campaign.compare import CampaignComparison
from kinid.campaign.diagnosis import CampaignDiagnosis
from kinid.diagnosis.result import EffectStatus
from kinid.identification.fitted import FittedParameter
from kinid.identification.pooling.result import LogResult, PooledFit
from kinid.reports.plots import AXES, BLUE, GREY, INK, ORANGE, finish, grid, page

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

#: values of a column that have a colour of their own, and parameters of logs that are drawn
COLOURS = (*AXES, ORANGE, "#CC79A7", "#56B4E9", GREY)
MOST_DRAWN = 12
MARKS = {EffectStatus.PRESENT: "●", EffectStatus.ABSENT: "○", EffectStatus.NOT_EXCITED: "·"}


def fit_page(result: PooledFit, title: str) -> str:
    """A pooled fit as one HTML page."""
    return page(title, facts(result), [], sections(result))


def comparison_page(result: CampaignComparison, title: str) -> str:
    """Models side by side on logs held out, and the best of them as a fit, as one HTML page."""
    unit = html.escape(result.unit)
    rows = []
    for row in result.rows:
        same = str(row.fit.model) == result.reference
        gap = "reference" if same else f"{row.difference:+.3g} ± {row.standard_error:.2g}"
        rows.append([str(row.fit.model), number(row.fit.error.held_out), number(row.fit.by_log), gap])
    head = table(["model", f"held out by block [{unit}]", f"held out by log [{unit}]", "difference"], rows)
    names = [log.name for log in result.rows[0].fit.logs]
    errors = []
    for name in names:
        found = [next((log.by_log for log in row.fit.logs if log.name == name), float("nan")) for row in result.rows]
        errors.append([name, *map(number, found)])
    tail = f"<h2>Error of each log, from the others [{unit}]</h2>"
    tail += table(["log", *(str(row.fit.model) for row in result.rows)], errors)
    best = result.rows[0].fit
    return page(title, head, [], f"{tail}<h2>The best: {html.escape(str(best.model))}</h2>{sections(best)}")


def diagnosis_page(result: CampaignDiagnosis, title: str) -> str:
    """A diagnosis of a campaign as one HTML page."""
    unit = result.fit.error.unit
    head = f"<p><b>{html.escape(result.verdict)}</b>: {html.escape(result.says)}</p>"
    head += "".join(f"<p><b>odd</b>: {html.escape(f'{name}: {why}')}</p>" for name, why in result.odd.items())
    head += "".join(f"<p>{html.escape(str(one))}</p>" for one in result.differences)
    rows = []
    for step, error in zip(result.steps, result.by_log):
        name = "as asked" if step.added is None else f"+ {step.added}"
        rows.append([name, number(step.held_out), number(error), f"{100 * step.explained:.0f} %"])
    rows.append(["noise alone", number(result.fit.error.noise_floor), "", ""])
    tail = "<h2>The error falling</h2>"
    tail += table(["model", f"held out by block [{unit}]", f"held out by log [{unit}]", "explained"], rows)
    tail += "<h2>Effects by log</h2>" + _matrix(result)
    if result.where:
        cells = "".join(f"<li>{html.escape(cell.says)}</li>" for cell in result.where)
        tail += f"<h2>Where the model fails</h2><ul>{cells}</ul>"
    verdicts = [[e.id, e.verdict, number(e.evidence), e.says, e.separate_by] for e in result.effects]
    tail += "<h2>Every effect</h2>" + table(["effect", "verdict", "evidence", "in words", "told apart by"], verdicts)
    tail += f"<h2>The model now: {html.escape(str(result.best))}</h2>{sections(result.fit)}"
    return page(title, head, [], tail)


def _mark(status: EffectStatus | None) -> str:
    return "" if status is None else MARKS.get(status, "")


def _matrix(result: CampaignDiagnosis) -> str:
    """Effects that were added or tried against logs."""
    names = list(result.shown)
    if not names:
        return "<p class=facts>No effect was worth a fit.</p>"
    logs = [log.name for log in result.fit.logs]
    rows = [[log, *(_mark(result.shown[name].get(log)) for name in names)] for log in logs]
    heads = [f"{name} (added)" if name in result.added else name for name in names]
    words = "● the log shows it by itself, ○ it shows that it isn't there, · it can't tell"
    return f"<p class=facts>{words}</p>" + table(["log", *heads], rows)


def facts(result: PooledFit) -> str:
    """What stands first: errors, odd logs, doubts."""
    unit, error = html.escape(result.error.unit), result.error
    by_log = f", {number(result.by_log)} on logs held out" if np.isfinite(result.by_log) else ""
    lines = [
        f"{html.escape(str(result.model))} fitted to {len(result.logs)} logs: {number(error.train)} {unit} on samples "
        f"seen, {number(error.held_out)} on blocks held out{by_log}; the noise is {number(error.noise_floor)}."
    ]
    lines += [html.escape(warning) for warning in result.warnings]
    return "".join(f"<p class=facts>{line}</p>" for line in lines)


def sections(result: PooledFit) -> str:
    """What is shared, logs as rows, and values over logs."""
    out = "<h2>What the logs share</h2>"
    rows = []
    for p in result.parameters.values():
        spread = result.spread.get(p.name)
        rows.append(
            [p.name, number(p.value), number(p.low), number(p.high), p.unit, "" if spread is None else interval(spread)]
        )
    out += table(["parameter", "estimate", "95 % from", "to", "unit", "spread between logs"], rows)
    out += "<h2>Logs</h2>" + logs_table(result)
    figures = list(values_figures(result))
    if figures:
        out += "<h2>Values of each log</h2><p class=facts>In the order of the logs. Filled: the log's own value in the "
        out += (
            "common fit; of what is shared, hollow: what a fit of that log alone says, over the common value and its "
        )
        out += "interval.</p>" + grid(figures)
    return out


def logs_table(result: PooledFit) -> str:
    """Logs as rows: columns, readings, errors, own values, and whether one is odd."""
    unit = result.error.unit
    columns = list(dict.fromkeys(column for log in result.logs for column in log.groups))
    own = list(dict.fromkeys(name for log in result.logs for name in log.parameters))
    head = ["log", *columns, "readings", f"held out by block [{unit}]", "by log", "alone", "noise", "left", *own, ""]
    rows = []
    for log in result.logs:
        values = [log.parameters.get(name) for name in own]
        rows.append(
            [
                log.name,
                *(log.groups.get(column, "") for column in columns),
                str(log.samples),
                number(log.error.held_out),
                number(log.by_log),
                number(log.alone_error),
                number(log.error.noise_floor),
                number(log.left.excess),
                *("" if p is None else interval(p) for p in values),
                f"odd: {result.odd[log.name]}" if log.name in result.odd else "",
            ]
        )
    rows += [[name, *[""] * (len(head) - 2), f"put aside: {why}"] for name, why in result.put_aside.items()]
    return table(head, rows)


def values_figures(result: PooledFit) -> list[tuple[str, Figure]]:
    """A picture of each parameter over the logs, coloured by the column that divides them."""
    column = dividing_column(result.logs)
    own = list(dict.fromkeys(name for log in result.logs for name in log.parameters))
    shared = [name for name in result.sharing if name not in own and any(name in log.alone for log in result.logs)]
    out = []
    for name in [*shared, *own][:MOST_DRAWN]:
        found = [
            (i, log, (log.parameters if name in own else log.alone).get(name)) for i, log in enumerate(result.logs)
        ]
        drawn = [(i, log, p) for i, log, p in found if p is not None and np.isfinite(p.high)]
        if drawn:
            out.append(
                (f"{name} [{drawn[0][2].unit}]", _values(drawn, result.parameters.get(name), column, name in own))
            )
    return out


def dividing_column(logs: Sequence[LogResult]) -> str:
    """The first column that has several values and not one for each log; "" for none."""
    for column in dict.fromkeys(column for log in logs for column in log.groups):
        values = {log.groups.get(column, "") for log in logs}
        if 1 < len(values) < len(logs):
            return column
    return ""


def _values(
    drawn: Sequence[tuple[int, LogResult, FittedParameter]], common: FittedParameter | None, column: str, filled: bool
) -> Figure:
    import plotly.graph_objects as go

    figure = go.Figure()
    if common is not None:
        figure.add_hrect(y0=common.low, y1=common.high, fillcolor=BLUE, opacity=0.2, line_width=0)
        figure.add_hline(y=common.value, line_color=BLUE, line_width=1.5)
    groups = list(dict.fromkeys(log.groups.get(column, "") for _, log, _ in drawn))
    for group, colour in zip(groups, (COLOURS if column else (INK,)) * (1 + len(groups) // len(COLOURS))):
        some = [(i, log, p) for i, log, p in drawn if log.groups.get(column, "") == group]
        figure.add_scatter(
            x=[i + 1 for i, _, _ in some],
            y=[p.value for _, _, p in some],
            error_y={"type": "data", "array": [0.5 * (p.high - p.low) for _, _, p in some], "width": 0},
            mode="markers",
            marker={"color": colour, "symbol": "circle" if filled else "circle-open", "size": 8},
            name=f"{column} {group}" if column else "",
            showlegend=bool(column),
            text=[log.name for _, log, _ in some],
            hovertemplate="%{text}: %{y:.5g}<extra></extra>",
        )
    figure.update_xaxes(title_text="log")
    finish(figure, 300)
    figure.update_layout(hovermode="closest")
    return figure


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """An HTML table of texts."""
    top = "".join(f"<th>{html.escape(word)}</th>" for word in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<div class=scroll><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"


def number(value: float) -> str:
    """A figure of four digits; a dash for none."""
    return f"{value:.4g}" if np.isfinite(value) else "–"


def interval(p: FittedParameter) -> str:
    """An estimate with half its interval."""
    half = 0.5 * (p.high - p.low)
    return f"{p.value:.4g} ± {half:.2g}" if np.isfinite(half) else f"{p.value:.4g}, open"
