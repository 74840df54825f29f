"""Pictures of results: one HTML file each, self-contained, readable without a network.

Colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.contact.analysis import Analysis
from kinid.contact.series import ContactSeries
from kinid.contact.touching import touches
from kinid.reports.render import render
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

#: lines of a picture of joint torques
TORQUES = (("measured", INK), ("inverse dynamics", VERMILION), ("residual", BLUE))
#: more points than this in a line can't be told apart on a screen
MOST_POINTS = 3000
#: points of all lines of a picture: a page of more is slow to send and to open
MOST_DRAWN = 35 * MOST_POINTS
#: touches that are shaded, the longest ones
MOST_SHADED = 60
#: rows of a picture over time: the label of an axis, and its lines: name, values (n,), colour
Rows = Sequence[tuple[str, Sequence[tuple[str, Array, str]]]]


def analysis_page(result: Analysis, title: str) -> str:
    """The contact frame or the tip's motion, and joint torques, as one HTML page."""
    touch, torques = result.contact, result.torques
    return render(
        "contact.html",
        title,
        facts=result.summary(),
        over_time=None if touch is None else time_figure(touch),
        paired=touch is not None and any(np.isfinite(force).any() for force in (touch.slip2, touch.tangential_force2)),
        over_depth=None if touch is None else depth_figure(touch),
        tip=None if result.tip is None else tip_figure(result.tip),
        torques=None if torques is None else torque_figure(torques),
        pair=[(f"along tangent {i}", AXES[i - 1], "solid") for i in (1, 2)],
        lines=[(name, colour, "solid") for name, colour in TORQUES],
        provenance=result.provenance,
    )


def time_figure(touch: ContactSeries) -> Figure:
    """Contact-frame quantities over time, each in a row with the axis that names it."""
    pair = ("along tangent 1", "along tangent 2")
    each: list[tuple[str, tuple[str, ...], tuple[Array, ...]]] = [
        ("depth [mm]", ("depth",), (1e3 * touch.depth,)),
        ("depth rate [mm/s]", ("depth rate",), (1e3 * touch.depth_rate,)),
        ("slip [mm]", pair, (1e3 * touch.slip1, 1e3 * touch.slip2)),
        ("normal force [N]", ("normal",), (touch.normal_force,)),
        ("tangential force [N]", pair, (touch.tangential_force1, touch.tangential_force2)),
    ]
    rows = [
        (label, [one for one in zip(names, values, AXES) if np.isfinite(one[1]).any()]) for label, names, values in each
    ]
    rows = [row for row in rows if row[1]]
    figure = stacked(touch.t - touch.t[0], rows, (touch.depth, touch.normal_force), height=170)
    # one shape a touch over the whole height, added at once: adding them one by one takes seconds
    shade = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    shade |= {"fillcolor": ORANGE, "opacity": 0.1, "line": {"width": 0}}
    time = touch.t - touch.t[0]
    spans = [(float(time[a]), float(time[b - 1])) for a, b in touches(touch.t, touch.in_contact, touch.valid)]
    spans = sorted(spans, key=lambda span: span[0] - span[1])[:MOST_SHADED]
    figure.update_layout(shapes=[shade | {"x0": begin, "x1": end} for begin, end in spans])
    return figure


def depth_figure(touch: ContactSeries) -> Figure | None:
    """Normal force over depth in contact, by phase; None where nothing is touched."""
    inside = touch.in_contact & np.isfinite(touch.normal_force)
    if not inside.any():
        return None
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
    each = [("position [m]", tip.position), ("velocity [m/s]", tip.velocity)]
    if tip.force is not None:
        each.append(("force [N]", tip.force))
    rows = [(label, list(zip("xyz", values.T, AXES))) for label, values in each]
    return stacked(tip.t - tip.t[0], rows, (tip.position[:, 0], tip.velocity[:, 2]), height=230, legend=True)


def torque_figure(torques: JointTorques) -> Figure:
    """Measured and predicted torque of each joint, and what is left."""
    of = (torques.measured.T, torques.predicted.T, torques.residual.T)
    rows = [
        ("[N·m]", [(name, values[j], colour) for (name, colour), values in zip(TORQUES, of)])
        for j in range(len(torques.joint_names))
    ]
    titles = [f"{html.escape(name)}: residual {rms:.3f} N·m rms" for name, rms in zip(torques.joint_names, torques.rms)]
    return stacked(torques.t - torques.t[0], rows, torques.residual.T[:3], titles=titles)


def stacked(
    t: Array,
    rows: Rows,
    peaks: Iterable[Array],
    *,
    height: int = 190,
    legend: bool = False,
    titles: Sequence[str] | None = None,
) -> Figure:
    """Rows of lines over one time axis.

    Args:
        t: time [s], (n,). rows: label of each axis, with its lines. peaks: series whose extremes are drawn in any case,
            each (n,). height: of a row [px]. legend: whether the names of the lines stand above. titles: of the rows.
    """
    from plotly.subplots import make_subplots

    count = len(rows)
    gap = 0.3 / (count + 4) if titles else 0.12 / count
    figure = make_subplots(rows=count, cols=1, shared_xaxes=True, vertical_spacing=gap, subplot_titles=titles)
    keep = thin(len(t), *peaks, lines=sum(len(lines) for _, lines in rows))
    named: set[str] = set()
    for i, (label, lines) in enumerate(rows, start=1):
        for name, values, colour in lines:
            line(figure, t[keep], values[keep], name, colour, i, legend=legend and name not in named)
            named.add(name)
        figure.update_yaxes(title_text=label, row=i, col=1)
    figure.update_xaxes(title_text="time [s]", row=count, col=1)
    finish(figure, height * count + 60)
    return figure


def round_span(low: float, high: float) -> tuple[float, float]:
    """The ends of a scale at round numbers, no more than a tenth of the span beyond its values."""
    if not high > low:
        return low, high
    tenth = (high - low) / 10.0
    decade = 10.0 ** np.floor(np.log10(tenth))
    step = decade * (5.0 if tenth >= 5.0 * decade else 2.0 if tenth >= 2.0 * decade else 1.0)
    # by its exponent, so that 3 · 0.1 is 0.3
    digits = int(12 - np.floor(np.log10(max(abs(low), abs(high)))))
    return round(float(np.floor(low / step + 1e-9) * step), digits), round(
        float(np.ceil(high / step - 1e-9) * step), digits
    )


def thin(n: int, *shapes: Array, lines: int = 1) -> NDArray[np.int64]:
    """Rows to draw of n, in so many lines: all, or the extremes of each stretch of some series, so that no peak gets
    lost.
    """
    most = min(MOST_POINTS, MOST_DRAWN // lines)
    return decimate(most, *shapes) if n > most else np.arange(n)


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


def line(
    figure: Figure, x: Array, y: Array, name: str, colour: str, row: int, *, legend: bool = True, dash: str = "solid"
) -> None:
    """A line over time in one row of a figure."""
    look = {"mode": "lines", "line": {"color": colour, "width": 1.4, "dash": dash}}
    figure.add_scatter(x=x, y=y, name=name, legendgroup=name, showlegend=legend, row=row, col=1, **look)


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
