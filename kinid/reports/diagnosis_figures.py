"""Pictures of a diagnosis: errors as effects are added, readings beside predictions, where the residual sits, loops.

Before is vermilion, after is blue, measured is dark grey (Okabe and Ito, 2008): pairs that colour-blind readers tell
apart; where both are bars or lines, hatching or dashes tell them as well.
"""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.result import Diagnosis
from kinid.reports.plots import BLUE, INK, MOST_POINTS, VERMILION, finish, line, thin
from kinid.residuals.parts import phase_words, phases
from kinid.residuals.view import View
from kinid.residuals.words import channel_words, sentence

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Titled = tuple[str, "Figure"]

NOISE = "#9ca3af"
#: lines of more samples are drawn solid: dashes of a dense line are mud
DENSE = 400


@dataclass(frozen=True, eq=False)
class Shown:
    """What the pictures show, in the channels that people read.

    Attributes:
        result: the diagnosis. before: view of its residual. after: of what is left with what was added; None where
            nothing was.
        measured: readings in the view's channels, (channels, n), NaN where they don't count.
    """

    result: Diagnosis
    before: View
    after: View | None
    measured: Array

    @classmethod
    def of(cls, result: Diagnosis) -> Shown:
        """Both residuals in the same channels."""
        experiment = result.experiment
        before = View.of(experiment, result.residual, experiment.noise)
        after = None
        if result.best.names != result.model.names:
            after = View.of(experiment, result.residual_after, experiment.noise, before.turned)
        readings = np.where(
            experiment.valid, experiment.in_band(np.where(experiment.valid, experiment.measured, 0.0)), np.nan
        )
        return cls(result, before, after, before.readings(readings))

    @property
    def lines(self) -> list[tuple[str, View, str, str]]:
        """Each model: its name in legends, its view, colour and dash."""
        if self.after is None:
            return [("the model", self.before, BLUE, "solid")]
        return [("before", self.before, VERMILION, "dash"), ("after", self.after, BLUE, "solid")]

    @property
    def dense(self) -> bool:
        """Whether lines over time are drawn without dashes."""
        return len(self.before.experiment.signals) > DENSE

    def worst(self, most: int) -> list[int]:
        """Rows of the channels that hold most of the error, the worst first; the first channel where none does."""
        error = np.maximum(self.before.excess.sum(axis=1), 0.0)
        rows = [int(i) for i in np.argsort(-error, kind="stable")[:most] if error[i] >= 0.01 * max(error.sum(), 1e-300)]
        return rows or [0]

    def label(self, row: int) -> str:
        """A channel with its unit, for an axis."""
        return f"{self.before.channels[row].replace('_', ' ')} [{self.before.units[row]}]"


def ladder(result: Diagnosis) -> Figure:
    """Held-out error after each addition, with what noise alone explains and what the tolerance allows beside it."""
    import plotly.graph_objects as go

    names = [_added(step.added, str(result.model)) for step in result.steps]
    errors = [step.held_out for step in result.steps]
    figure = go.Figure()
    figure.add_bar(
        y=names,
        x=errors,
        orientation="h",
        name="held out",
        width=0.55,
        text=[f"{e:.3g}" for e in errors],
        textposition="outside",
        cliponaxis=False,
        marker={"color": [VERMILION, *[BLUE] * (len(errors) - 1)]},
        hovertemplate="%{y}: %{x:.4g} " + result.unit + " held out<extra></extra>",
    )
    figure.add_scatter(
        y=names,
        x=[step.train for step in result.steps],
        mode="markers",
        name="on samples seen",
        marker={"symbol": "line-ns-open", "size": 14, "color": INK, "line": {"width": 2}},
        hovertemplate="%{x:.4g} " + result.unit + " on samples seen<extra></extra>",
    )
    allowed = float(np.hypot(result.left.noise, result.left.tolerance))
    top = 1.18 * max([*errors, result.noise_floor, 1e-12])
    top = float(np.clip(1.05 * allowed, top, 1.5 * top))
    if np.isfinite(result.noise_floor):
        figure.add_vline(
            x=result.noise_floor,
            line={"color": INK, "width": 1.5, "dash": "dot"},
            annotation={
                "text": f"noise {result.noise_floor:.3g}",
                "yref": "paper",
                "y": 1.0,
                "yanchor": "bottom",
                "xanchor": "left",
                "font": {"size": 12, "color": INK},
            },
        )
        figure.add_vrect(
            x0=result.noise_floor, x1=min(allowed, top), fillcolor=NOISE, opacity=0.25, line_width=0, layer="below"
        )
    finish(figure, 110 + 46 * len(names), small=True)
    figure.update_xaxes(title_text=f"error [{result.unit} rms]", range=[0, top])
    figure.update_yaxes(autorange="reversed", automargin=True, showgrid=False)
    figure.update_layout(showlegend=False, hovermode="closest", margin={"t": 34})
    return figure


def _added(added: str | None, model: str) -> str:
    """A rung's name, short enough for a phone."""
    if added is not None:
        return f"+ {html.escape(added)}"
    return "as asked" if len(model) > 24 else html.escape(model)


def readings(shown: Shown) -> Iterator[Titled]:
    """Each channel over time: measured and predicted above, what is left below."""
    from plotly.subplots import make_subplots

    t = shown.before.experiment.signals.t
    lines = (1 + 2 * len(shown.lines)) * len(shown.before.channels)
    for row in range(len(shown.before.channels)):
        rows = thin(len(t), shown.measured[row], *(view.residual[row] for _, view, _, _ in shown.lines), lines=lines)
        figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.62, 0.38])
        line(figure, t[rows], shown.measured[row][rows], "measured", INK, 1)
        for name, view, colour, dash in shown.lines:
            predicted = shown.measured[row][rows] - view.residual[row][rows]
            line(figure, t[rows], predicted, name, colour, 1, dash="solid" if shown.dense else dash)
            line(figure, t[rows], view.residual[row][rows], name, colour, 2, legend=False)
        for sign in (-2, 2):
            figure.add_hline(
                y=sign * shown.before.sigma[row], line={"color": INK, "width": 1, "dash": "dot"}, row=2, col=1
            )
        figure.update_yaxes(title_text=f"[{shown.before.units[row]}]", row=1, col=1)
        figure.update_yaxes(title_text=f"left [{shown.before.units[row]}]", row=2, col=1)
        figure.update_xaxes(title_text="time [s]", row=2, col=1)
        finish(figure, 330, small=True)
        yield sentence(channel_words(shown.before, row)), figure


def loops(shown: Shown) -> Iterator[Titled]:
    """Force over depth and over speed; torque of joints over speed."""
    s, view = shown.before.experiment.signals, shown.before
    channels = view.channels
    if s.joints is not None:
        for row in shown.worst(4):
            slides = channels[row].startswith("force")
            x = s.joints.dq[row]
            yield from _loop(shown, row, x, np.isfinite(x), f"speed [{'m/s' if slides else 'rad/s'}]", "speed")
        return
    inside = view.experiment.in_contact | (s.depth > 0)
    if not inside.any():
        return
    if "normal_force" in channels:
        row = channels.index("normal_force")
        yield from _loop(shown, row, 1e3 * s.depth, inside, "depth [mm]", "depth")
        yield from _loop(shown, row, 1e3 * s.depth_rate, inside, "speed of pressing [mm/s]", "speed of pressing")
    for i in (1, 2):
        if f"tangential_force{i}" in channels and np.ptp(s.slip_rate[i - 1]) > 0:
            row = channels.index(f"tangential_force{i}")
            yield from _loop(
                shown, row, 1e3 * s.slip_rate[i - 1], inside, f"speed along tangent {i} [mm/s]", "speed of sliding"
            )


def _loop(shown: Shown, row: int, x: Array, inside: Mask, label: str, over: str) -> Iterator[Titled]:
    """A reading over a quantity, measured as points and predicted as a line: a picture for each model, on the same
    axes.
    """
    import plotly.graph_objects as go

    use = np.flatnonzero(inside & np.isfinite(shown.measured[row]) & np.isfinite(x))
    if len(use) < 2:
        return
    use = use[:: 1 + len(use) // MOST_POINTS]
    step = int(np.median(np.diff(use))) if len(use) > 1 else 1
    pieces = np.flatnonzero(np.diff(use) > 2 * step) + 1  # a line between two touches was no motion
    values = [
        shown.measured[row][use],
        *(shown.measured[row][use] - view.residual[row][use] for _, view, _, _ in shown.lines),
    ]
    low, high = min(np.nanmin(v) for v in values), max(np.nanmax(v) for v in values)
    room = 0.05 * (high - low) + 1e-12
    for (name, view, colour, _), predicted in zip(shown.lines, values[1:]):
        figure = go.Figure()
        figure.add_scatter(x=x[use], y=values[0], mode="markers", name="measured", marker={"size": 3, "color": NOISE})
        figure.add_scatter(
            x=np.insert(x[use], pieces, np.nan),
            y=np.insert(predicted, pieces, np.nan),
            mode="lines",
            name=name,
            line={"color": colour, "width": 1.2},
        )
        figure.update_xaxes(title_text=label)
        figure.update_yaxes(title_text=f"[{view.units[row]}]", range=[low - room, high + room])
        finish(figure, 290, small=True)
        figure.update_layout(showlegend=False, hovermode="closest")
        yield f"{sentence(channel_words(view, row))} over {over}: {name}", figure


def phase_bars(shown: Shown, row: int) -> Titled:
    """Rms of a channel in each phase."""
    names = phases(shown.before)
    order = list(dict.fromkeys(names.tolist()))
    short = [
        phase_words(n).removeprefix("the ").replace("(by their motion)", "").replace("(by its motion)", "")
        for n in order
    ]
    heading = "phase (by its motion)" if shown.before.experiment.phase is None else "phase"
    masks = {html.escape(s.strip().strip("'")): names == n for s, n in zip(short, order)}
    return bars(
        shown, row, {name: mask for name, mask in masks.items() if shown.before.samples[row][mask].any()}, heading
    )


def bars(shown: Shown, row: int, masks: dict[str, Mask], heading: str) -> Titled:
    """Rms of a channel in some parts of the log."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for name, view, colour, _ in shown.lines:
        figure.add_bar(
            x=list(masks),
            y=[rms(view, row, m) for m in masks.values()],
            name=name,
            marker={"color": colour, "pattern": {"shape": "/" if name == "before" else "", "solidity": 0.35}},
            hovertemplate=f"%{{x}}: %{{y:.3g}} {view.units[row]} rms<extra>{name}</extra>",
        )
    _noise(figure, shown, row)
    figure.update_xaxes(tickangle=-35, automargin=True)
    return _multiple(figure, shown, row, heading)


def profile(shown: Shown, row: int, x: Array, within: Mask, heading: str, count: int = 12) -> Titled | None:
    """Rms of a channel over a quantity, in bins; None where it hardly varies."""
    import plotly.graph_objects as go

    if within.sum() < 4 * count:
        return None
    share = np.linspace(0.0, 1.0, count + 1)
    held = np.quantile(x[within], share)
    low, high = np.quantile(x[within], [0.005, 0.995])
    cuts = np.unique(0.5 * (held + low + share * (high - low)))  # halfway between alike many samples and alike wide
    cuts[0], cuts[-1] = x[within].min(), x[within].max()
    if len(cuts) < 4:
        return None
    index = np.clip(np.searchsorted(cuts, x, side="right") - 1, 0, len(cuts) - 2)
    masks = [within & (index == k) for k in range(len(cuts) - 1)]
    at = np.array([float(np.median(x[m])) if m.any() else np.nan for m in masks])
    figure = go.Figure()
    for name, view, colour, dash in shown.lines:
        figure.add_scatter(
            x=at,
            y=[rms(view, row, m) for m in masks],
            mode="lines+markers",
            name=name,
            line={"color": colour, "dash": dash, "width": 1.6},
            marker={"size": 5},
        )
    _noise(figure, shown, row)
    return _multiple(figure, shown, row, heading)


def rms(view: View, row: int, mask: Mask) -> float:
    """Root mean square of a channel's residual in some groups; NaN without samples."""
    count = float(view.samples[row][mask].sum())
    return float(np.sqrt(view.squares[row][mask].sum() / count)) if count else float("nan")


def _noise(figure: Figure, shown: Shown, row: int) -> None:
    figure.add_hline(y=float(shown.before.sigma[row]), line={"color": INK, "width": 1, "dash": "dot"})


def _multiple(figure: Figure, shown: Shown, row: int, heading: str) -> Titled:
    finish(figure, 230, small=True)
    figure.update_layout(showlegend=False, barmode="group", hovermode="closest")
    figure.update_yaxes(title_text=f"rms [{shown.before.units[row]}]", rangemode="tozero")
    return heading, figure
