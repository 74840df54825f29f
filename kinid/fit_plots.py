"""Pictures of fits: measured and predicted forces over depth and time, and models side by side."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.compare import Comparison
from kinid.fit import Fit
from kinid.plots import BLUE, GREEN, GREY, MOST_POINTS, ORANGE, VERMILION, finish, line, page, thin

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

COLOURS = (VERMILION, GREEN, ORANGE, "#CC79A7", "#56B4E9", "#F0E442")


def fit_page(fit: Fit, title: str) -> str:
    """One fit: equation and estimates, force over depth, readings over time."""
    rows = "".join(
        f"<tr><td>{html.escape(p.name)}</td><td>{p.value:.5g}</td><td>{p.low:.5g}</td><td>{p.high:.5g}</td>"
        f"<td>{html.escape(p.unit)}</td></tr>"
        for p in fit.parameters.values()
    )
    error = fit.error
    head = (
        f"<pre>{html.escape(fit.equation())}</pre>"
        f"<div class=scroll><table><tr><th>parameter</th><th>estimate</th><th>95 % from</th><th>to</th><th>unit</th></tr>{rows}"
        f"</table></div><p class=facts>error {error.train:.4g} {error.unit} rms on samples seen, {error.held_out:.4g} on "
        f"samples held out; the noise is {error.noise_floor:.4g}.</p>"
        + "".join(f"<p class=facts>doubt: {html.escape(warning)}</p>" for warning in fit.warnings)
    )
    fits = {str(fit.model): fit}
    figures = [("Readings over time", _time_figure(fits))]
    if "normal_force" in fit.experiment.layout.channels:
        figures.insert(0, ("Force over depth", _loop_figure(fits)))
    return page(title, head, figures)


def comparison_page(result: Comparison, title: str) -> str:
    """Models side by side: the table, force over depth, readings over time."""
    rows = "".join(
        f"<tr><td>{row.rank}. {html.escape(str(row.fit.model))}</td><td>{row.held_out:.4g}</td>"
        f"<td>{row.difference:+.3g}</td><td>{row.standard_error:.2g}</td></tr>"
        for row in result.rows
    )
    head = (
        f"<div class=scroll><table><tr><th>model</th><th>held-out error [{result.unit}]</th><th>difference</th>"
        f"<th>± standard error</th></tr>{rows}</table></div>"
        f"<p class=facts>differences are to {html.escape(result.reference)}; "
        f"the noise is {result.noise_floor:.4g} {result.unit}.</p>"
    )
    fits = {str(row.fit.model): row.fit for row in result.rows}
    figures = [("Readings over time", _time_figure(fits))]
    if "normal_force" in result.rows[0].fit.experiment.layout.channels:
        figures.insert(0, ("Force over depth", _loop_figure(fits)))
    return page(title, head, figures)


def _loop_figure(fits: dict[str, Fit]) -> Figure:
    """Normal force over depth: measured points, a line a model."""
    import plotly.graph_objects as go

    experiment = next(iter(fits.values())).experiment
    row = experiment.layout.channels.index("normal_force")
    depth = experiment.signals.depth
    near = np.flatnonzero(experiment.valid & (depth > -1e-3))
    near = near[:: 1 + len(near) // MOST_POINTS]
    figure = go.Figure()
    figure.add_scatter(x=1e3 * depth[near], y=experiment.measured[row][near], mode="markers", name="measured",
                       marker={"size": 3, "color": GREY})  # fmt: skip
    for (name, fit), colour in zip(fits.items(), COLOURS):
        figure.add_scatter(x=1e3 * depth[near], y=fit.predict()[row][near], mode="lines", name=name,
                           line={"color": colour, "width": 1.2})  # fmt: skip
    figure.update_xaxes(title_text="depth [mm]")
    figure.update_yaxes(title_text="normal force [N]")
    finish(figure, 460)
    return figure


def _time_figure(fits: dict[str, Fit]) -> Figure:
    """Each channel over time: measured, and what each model expects."""
    from plotly.subplots import make_subplots

    experiment = next(iter(fits.values())).experiment
    layout = experiment.layout
    figure = make_subplots(
        rows=len(layout.channels), cols=1, shared_xaxes=True, vertical_spacing=0.15 / len(layout.channels)
    )
    keep = thin(len(experiment.signals), *experiment.measured[:3])
    t = experiment.signals.t[keep]
    predictions = {name: fit.predict() for name, fit in fits.items()}
    for i, (channel, unit) in enumerate(zip(layout.channels, layout.units)):
        line(figure, t, experiment.measured[i][keep], "measured", BLUE, i + 1, legend=i == 0)
        for (name, predicted), colour in zip(predictions.items(), COLOURS):
            line(figure, t, predicted[i][keep], name, colour, i + 1, legend=i == 0)
        figure.update_yaxes(title_text=f"{channel.replace('_', ' ')} [{unit}]", row=i + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(layout.channels), col=1)
    finish(figure, max(320, 200 * len(layout.channels)) + 60)
    return figure
