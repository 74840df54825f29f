"""The page of a watch: logs as they came, their values over time, and which of them is odd."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from kinid.reports.plots import BLUE, ORANGE, finish
from kinid.reports.render import render
from kinid.writers import Json

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

#: logs that are listed, the last ones first; and parameters that are drawn, of so many logs
MOST_LISTED, MOST_FIGURES, MOST_DRAWN = 200, 12, 2000


def watch_page(
    folder: str, model: Sequence[str], outcomes: Sequence[tuple[str, Json | str]], odd: Mapping[str, str]
) -> str:
    """One offline HTML page.

    Args:
        folder, model: that are watched, and fitted. outcomes: each log with facts of its fit, or why it is put aside,
            in order. odd: name → why.
    """
    fits = [(name, facts) for name, facts in outcomes if not isinstance(facts, str)]
    names = list(dict.fromkeys(name for _, facts in fits for name in facts["parameters"]))[:MOST_FIGURES]
    return render(
        "watch.html",
        f"{folder}: {' + '.join(model)}",
        folder=folder,
        fits=fits,
        aside=len(outcomes) - len(fits),
        odd=odd,
        names=names,
        figures=[(name, figure) for name in names for figure in _values(name, fits[-MOST_DRAWN:], odd)],
        listed=list(reversed(outcomes[-MOST_LISTED:])),
        estimate=_estimate,
    )


def _estimate(p: Json) -> str:
    if p["low"] is None or p["high"] is None:
        return f"{p['value']:.4g}, open"
    return f"{p['value']:.4g} ± {0.5 * (p['high'] - p['low']):.2g} {p['unit']}".removesuffix(" 1")


def _values(name: str, fits: Sequence[tuple[str, Json]], odd: Mapping[str, str]) -> Iterator[Figure]:
    """One parameter over the logs, odd ones in a colour of their own."""
    import plotly.graph_objects as go

    known = [(i, log, facts["parameters"].get(name)) for i, (log, facts) in enumerate(fits, start=1)]
    drawn = [(i, log, p) for i, log, p in known if p is not None and p["low"] is not None and p["high"] is not None]
    if not drawn:
        return
    figure = go.Figure()
    for colour, some in ((BLUE, [d for d in drawn if d[1] not in odd]), (ORANGE, [d for d in drawn if d[1] in odd])):
        figure.add_scatter(
            x=[i for i, _, _ in some],
            y=[p["value"] for _, _, p in some],
            error_y={"type": "data", "array": [0.5 * (p["high"] - p["low"]) for _, _, p in some], "width": 0},
            mode="markers",
            marker={"color": colour, "size": 7},
            text=[log for _, log, _ in some],
            hovertemplate="%{text}: %{y:.5g}<extra></extra>",
            showlegend=False,
        )
    figure.update_xaxes(title_text="log")
    figure.update_yaxes(title_text=drawn[0][2]["unit"])
    finish(figure, 300)
    figure.update_layout(hovermode="closest")
    yield figure
