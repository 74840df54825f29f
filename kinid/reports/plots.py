"""Pictures of results: one HTML file each, self-contained, readable without a network.

Colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart.
"""

from __future__ import annotations

import hashlib
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.contact.analysis import Analysis
from kinid.contact.series import ContactSeries
from kinid.robotics.inverse_dynamics import JointTorques
from kinid.robotics.motion import TipMotion

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

BLUE, VERMILION, GREEN, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#6b7280"
AXES = (BLUE, VERMILION, GREEN)
#: what was measured, in every picture that holds it against a model
INK = "#4b5563"
#: name, colour and dash ("solid" or "dashed") of a line, for a key
Entry = tuple[str, str, str]

#: more points than this in a line can't be told apart on a screen
MOST_POINTS = 6000


def analysis_page(result: Analysis, title: str) -> str:
    """The contact frame or the tip's motion, and joint torques, as one HTML page."""
    figures: list[tuple[str, Figure | str]] = []
    if result.contact is not None:
        figures += contact_figures(result.contact)
    if result.tip is not None:
        figures.append(("Motion of the tip, base frame", tip_figure(result.tip)))
    if result.torques is not None:
        names = key((("measured", INK, "solid"), ("inverse dynamics", VERMILION, "solid"), ("residual", BLUE, "solid")))
        figures.append(
            ("Joint torques: measured, and inverse dynamics", names + drawing(torque_figure(result.torques)))
        )
    facts = result.summary()
    body = []
    if result.contact is not None:
        body.append(
            note(
                f"{facts['samples']} samples, {facts['invalid_samples']} invalid; in contact "
                f"{100 * facts['in_contact']:.1f} % of the time, {facts['touches']} touches."
            )
        )
    if result.torques is not None:
        rows = [
            (name, f"{row['measured_rms']:.3f}", f"{row['residual_rms']:.3f}")
            for name, row in facts["joint_torques"].items()
        ]
        body.append(table(("joint", "measured rms [N·m]", "residual rms [N·m]"), rows))
    steps = "".join(f"<li><code>{html.escape(str(step))}</code></li>" for step in result.provenance.steps)
    tail = (
        f"<details><summary>Provenance of {html.escape(result.provenance.source)}</summary><ol>{steps}</ol></details>"
    )
    return page(title, "".join(body), figures, tail)


def asset(name: str) -> str:
    """Text of a stylesheet or script that lies beside this file."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of texts; on a narrow screen it scrolls sideways, and only it."""
    top = "".join(f"<th>{html.escape(head)}</th>" for head in heads)
    cells = ("".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<div class=scroll><table><tr>{top}</tr>{body}</table></div>"


def note(text: str) -> str:
    """A paragraph in small print."""
    return f"<p class=facts>{html.escape(text)}</p>"


def page(title: str, head: str, figures: Sequence[tuple[str, Figure | str]], tail: str = "", style: str = "") -> str:
    """One self-contained HTML page of titled figures, or of HTML with figures in it; `style` is added to the
    house's.
    """
    from plotly.offline import get_plotlyjs

    parts = [
        f"<section><h2>{html.escape(name)}</h2>{figure if isinstance(figure, str) else drawing(figure)}</section>"
        for name, figure in figures
    ]
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        '<meta name=viewport content="width=device-width,initial-scale=1">'
        # an empty icon: the page asks nobody for one
        f'<link rel=icon href="data:,"><title>{html.escape(title)} – kinid</title>'
        f"<style>{asset('page.css')}{style}</style>"
        f"<script>{get_plotlyjs()}</script></head><body><h1>{html.escape(title)}</h1>{head}{''.join(parts)}{tail}"
        f"<script>{asset('page.js')}</script></body></html>\n"
    )


def drawing(figure: Figure, caption: str = "") -> str:
    """A figure as part of a page, as wide as its place."""
    # named by what it shows: the same page each time
    name = hashlib.sha256(f"{caption}{figure.to_json()}".encode()).hexdigest()[:12]
    drawn = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        div_id=f"figure-{name}",
        config={"displaylogo": False, "responsive": True, "displayModeBar": False},
    )
    return f"<figure>{f'<figcaption>{html.escape(caption)}</figcaption>' if caption else ''}{drawn}</figure>"


def grid(figures: Iterable[tuple[str, Figure]], *, wide: bool = False) -> str:
    """Captioned figures side by side, as many as the page is wide."""
    inside = "".join(drawing(figure, caption) for caption, figure in figures)
    return f'<div class="grid{" wide" if wide else ""}">{inside}</div>' if inside else ""


def key(entries: Iterable[Entry]) -> str:
    """Which colour is which, as text that wraps on a narrow screen; once for many pictures."""
    spans = (
        f'<span><i style="border-color:{colour};border-top-style:{dash}"></i>{html.escape(name)}</span>'
        for name, colour, dash in entries
    )
    return f"<p class=key>{''.join(spans)}</p>"


def contact_figures(touch: ContactSeries) -> list[tuple[str, Figure | str]]:
    """Contact-frame quantities over time, and force over depth."""
    pairs = any(np.isfinite(v).any() for v in (touch.slip2, touch.tangential_force2))
    names = key((f"along tangent {i}", AXES[i - 1], "solid") for i in (1, 2)) if pairs else ""
    figures: list[tuple[str, Figure | str]] = [
        ("Contact frame over time (shaded: in contact)", names + drawing(touch_figure(touch)))
    ]
    inside = touch.in_contact & np.isfinite(touch.normal_force)
    if inside.any():
        figures.append(("Force over depth, in contact", _loop(touch, inside)))
    return figures


def touch_figure(touch: ContactSeries) -> Figure:
    """Contact-frame quantities over time, each in a row with the axis that names it; shaded where it touches."""
    from plotly.subplots import make_subplots

    keep = thin(len(touch.t), touch.depth, touch.normal_force)
    t = touch.t[keep] - touch.t[0]
    rows: list[tuple[str, list[tuple[str, Array]]]] = [
        ("depth [mm]", [("depth", 1e3 * touch.depth[keep])]),
        ("depth rate [mm/s]", [("depth rate", 1e3 * touch.depth_rate[keep])]),
        ("slip [mm]", [("along tangent 1", 1e3 * touch.slip1[keep]), ("along tangent 2", 1e3 * touch.slip2[keep])]),
        ("normal force [N]", [("normal", touch.normal_force[keep])]),
        (
            "tangential force [N]",
            [("tangent 1", touch.tangential_force1[keep]), ("tangent 2", touch.tangential_force2[keep])],
        ),
    ]
    rows = [(label, [line for line in lines if np.isfinite(line[1]).any()]) for label, lines in rows]
    rows = [row for row in rows if row[1]]
    time = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.025)
    for i, (label, lines) in enumerate(rows, start=1):
        for (name, values), colour in zip(lines, AXES):
            line(time, t, values, name, colour, i, legend=False)
        time.update_yaxes(title_text=label, row=i, col=1)
    # one shape a touch over the whole height, added at once: adding them one by one takes seconds
    shade = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    shade |= {"fillcolor": ORANGE, "opacity": 0.1, "line": {"width": 0}}
    spans = _runs(touch.in_contact, touch.t - touch.t[0])
    time.update_layout(shapes=[shade | {"x0": begin, "x1": end} for begin, end in spans])
    time.update_xaxes(title_text="time [s]", row=len(rows), col=1)
    finish(time, 170 * len(rows) + 60)
    return time


def _loop(touch: ContactSeries, inside: NDArray[np.bool_]) -> Figure:
    import plotly.graph_objects as go

    names = np.full(len(touch), "contact") if touch.phase is None else touch.phase
    figure = go.Figure()
    palette = (BLUE, VERMILION, GREEN, ORANGE, "#CC79A7", "#000000", GREY)
    order = list(dict.fromkeys(names[inside].tolist()))
    for i, name in enumerate(order):
        rows = np.flatnonzero(inside & (names == name))
        rows = rows[:: 1 + len(rows) // MOST_POINTS]
        figure.add_scatter(
            x=1e3 * touch.depth[rows],
            y=touch.normal_force[rows],
            mode="markers",
            name=str(name),
            marker={"size": 3, "color": palette[i % len(palette)]},
        )
    figure.update_xaxes(title_text="depth [mm]")
    figure.update_yaxes(title_text="normal force [N]")
    finish(figure, 420)
    figure.update_layout(hovermode="closest", legend={"itemsizing": "constant"})  # marks in the legend that can be seen
    return figure


def tip_figure(tip: TipMotion) -> Figure:
    """Position, velocity and force of the tip in base axes."""
    from plotly.subplots import make_subplots

    rows = [("position [m]", tip.position), ("velocity [m/s]", tip.velocity)]
    if tip.force is not None:
        rows.append(("force [N]", tip.force))
    keep = thin(len(tip.t), tip.position[:, 0], tip.velocity[:, 2])
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for i, (label, values) in enumerate(rows, start=1):
        for axis in range(3):
            line(figure, tip.t[keep] - tip.t[0], values[keep, axis], "xyz"[axis], AXES[axis], i, legend=i == 1)
        figure.update_yaxes(title_text=label, row=i, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(rows), col=1)
    finish(figure, 230 * len(rows) + 60)
    return figure


def torque_figure(torques: JointTorques) -> Figure:
    """Measured and predicted torque of each joint, and what is left."""
    from plotly.subplots import make_subplots

    count = torques.measured.shape[1]
    titles = [f"{html.escape(name)}: residual rms {rms:.2f} N·m" for name, rms in zip(torques.joint_names, torques.rms)]
    figure = make_subplots(
        rows=count, cols=1, shared_xaxes=True, vertical_spacing=0.3 / (count + 4), subplot_titles=titles
    )
    keep = thin(len(torques.t), *torques.residual.T[:3])
    t = torques.t[keep] - torques.t[0]
    for j in range(count):
        for values, name, colour in (
            (torques.measured, "measured", INK),
            (torques.predicted, "inverse dynamics", VERMILION),
            (torques.residual, "residual", BLUE),
        ):
            line(figure, t, values[keep, j], name, colour, j + 1, legend=False)
        figure.update_yaxes(title_text="[N·m]", row=j + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=count, col=1)
    finish(figure, 190 * count + 60)
    return figure


def thin(n: int, *shapes: Array) -> NDArray[np.int64]:
    """Rows to draw of n: all, or the extremes of each stretch of some series, so that no peak gets lost."""
    return decimate(MOST_POINTS, *shapes) if n > MOST_POINTS else np.arange(n)


def decimate(most: int, *series: Array) -> NDArray[np.int64]:
    """So many rows to draw of series of one length, at most: all of them, or the extremes of each stretch."""
    n = len(series[0])
    if n <= most:
        return np.arange(n)
    wide = -(-n // max(1, (most - 2) // (2 * len(series))))
    kept = [np.array([0, n - 1])]
    for x in series:
        padded = np.full(-(-n // wide) * wide, np.nan)
        padded[:n] = x
        stretches = padded.reshape(-1, wide)
        some = np.isfinite(stretches).any(axis=1)
        start = np.flatnonzero(some) * wide
        kept += [start + np.nanargmin(stretches[some], axis=1), start + np.nanargmax(stretches[some], axis=1)]
    return np.unique(np.concatenate(kept))


def line(figure: Figure, x: Array, y: Array, name: str, colour: str, row: int, legend: bool = True) -> None:
    """A line over time in one row of a figure."""
    look = {"mode": "lines", "line": {"color": colour, "width": 1.4}}
    figure.add_scatter(x=x, y=y, name=name, legendgroup=name, showlegend=legend, row=row, col=1, **look)


def _runs(flag: NDArray[np.bool_], t: Array, most: int = 60) -> list[tuple[float, float]]:
    """Spans of time in which a flag is up; the longest ones where there are too many to shade."""
    edges = np.diff(flag.astype(np.int8), prepend=0, append=0)
    spans = list(zip(t[np.flatnonzero(edges == 1)].tolist(), t[np.flatnonzero(edges == -1) - 1].tolist()))
    return sorted(spans, key=lambda span: span[0] - span[1])[:most]


def finish(figure: Figure, height: int, *, small: bool = False) -> None:
    """House style of a figure, of this height [px]; small ones share a page with text, down to a phone's width."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
        hovermode="x unified",
    )
    if small:
        font, margin = {"size": 12, "color": "#1f2937"}, {"l": 58, "r": 12, "t": 24, "b": 44}
        figure.update_layout(margin=margin, autosize=True, font=font)
        figure.update_xaxes(title_standoff=6)
        figure.update_yaxes(title_standoff=4)
