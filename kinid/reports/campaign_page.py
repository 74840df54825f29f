"""Pages of a campaign: logs as rows, what they share, what each has for itself, errors on logs held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinid.campaign.compare import CampaignComparison
from kinid.campaign.diagnosis import CampaignDiagnosis
from kinid.diagnosis.result import EffectStatus
from kinid.identification.fitted import FittedParameter
from kinid.identification.pooling.result import LogResult, PooledFit
from kinid.reports.fit_plots import winner
from kinid.reports.plots import AXES, BLUE, GREY, INK, ORANGE, finish
from kinid.reports.render import digits, render

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

#: values of a column that have a colour of their own, and parameters of logs that are drawn
COLOURS = (*AXES, ORANGE, "#CC79A7", "#56B4E9", GREY)
MOST_DRAWN = 12
MARKS = {EffectStatus.PRESENT: "●", EffectStatus.ABSENT: "○", EffectStatus.NOT_EXCITED: "·"}


def fit_page(result: PooledFit, title: str) -> str:
    """A pooled fit as one HTML page."""
    return render("campaign_fit.html", title, fit=result, names=_names, figures=list(values_figures(result)))


def comparison_page(result: CampaignComparison, title: str) -> str:
    """Models side by side on logs held out, and the best of them as a fit, as one HTML page."""
    errors = [{log.name: log.by_log for log in row.fit.logs} for row in result.rows]
    return render(
        "campaign_compare.html",
        title,
        c=result,
        winner=winner(result),
        models=[f"#{row.fit.model}" for row in result.rows],
        by_log=[(name, [digits(of.get(name, np.nan)) for of in errors]) for name in errors[0]],
        names=_names,
        figures=list(values_figures(result.rows[0].fit)),
    )


def diagnosis_page(result: CampaignDiagnosis, title: str) -> str:
    """A diagnosis of a campaign as one HTML page."""
    return render(
        "campaign_diagnosis.html",
        title,
        d=result,
        marks=MARKS,
        heads=[f"{name} (added)" if name in result.added else name for name in result.shown],
        names=_names,
        figures=list(values_figures(result.fit)),
    )


def _names(logs: Sequence[LogResult], what: str) -> list[str]:
    """Names of the columns, or of the own parameters, of all logs."""
    return list(dict.fromkeys(name for log in logs for name in getattr(log, what)))


def values_figures(result: PooledFit) -> list[tuple[str, Figure]]:
    """A picture of each parameter over the logs, coloured by the column that divides them."""
    column = dividing_column(result.logs)
    own = _names(result.logs, "parameters")
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
    for column in _names(logs, "groups"):
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
