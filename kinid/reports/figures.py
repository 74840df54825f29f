"""What `.plot()` of a result shows: one figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.diagnosis import Diagnosis
from kinid.errors import InputError
from kinid.identification.compare import Comparison
from kinid.identification.fit import Fit
from kinid.reports.fit_plots import time_figure
from kinid.reports.plots import AXES, BLUE, GREY, VERMILION, finish, line, thin
from kinid.reports.plots import time_figure as touch_figure
from kinid.shown import Shown

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def figure_of(result: Shown) -> Figure:
    """The figure of a log, contact-frame quantities, a fit, a comparison or a diagnosis.

    Raises:
        InputError: a result without a figure, such as a fit that was loaded without its log.
    """
    if isinstance(result, Log):
        return _log_figure(result)
    if isinstance(result, ContactSeries):
        return touch_figure(result)
    if isinstance(result, Fit):
        return time_figure({str(result.model): result})
    if isinstance(result, Comparison):
        names = [str(row.fit.model) for row in result.rows]
        spread = [2.0 * row.standard_error if np.isfinite(row.standard_error) else 0.0 for row in result.rows]
        return _bars(names, [row.held_out for row in result.rows], spread, result.noise_floor, result.unit)
    if isinstance(result, Diagnosis):
        names = ["as asked" if step.added is None else f"+ {step.added}" for step in result.steps]
        return _bars(names, [step.held_out for step in result.steps], None, result.noise_floor, result.unit)
    raise InputError(
        f"a {type(result).__name__} to plot", "a result with its log", "fit or diagnose again, and plot that"
    )


def _bars(names: list[str], errors: list[float], spread: list[float] | None, noise: float, unit: str) -> Figure:
    """Held-out errors, with two standard errors of their difference to the reference where they are known, beside the
    noise.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    figure.add_bar(x=names, y=errors, marker_color=BLUE, error_y=None if spread is None else {"array": spread})
    figure.add_hline(y=noise, line={"color": GREY, "dash": "dash"}, annotation_text="noise")
    figure.update_yaxes(title_text=f"held-out error [{unit} rms]", rangemode="tozero")
    finish(figure, 380)
    return figure


def _log_figure(log: Log) -> Figure:
    """What was logged, over time: one row a kind of quantity."""
    from plotly.subplots import make_subplots

    rows = [
        (f"{label}", [(f"{name}{j + 1}", column) for j, column in enumerate(values.T)])
        for name, label, values in (
            ("q", "joints [rad, m]", log.q),
            ("tau", "torque [N·m, N]", log.tau),
            ("f", "force [N]", None if log.wrench is None else log.wrench[:, :3]),
            ("t", "torque at the wrist [N·m]", None if log.wrench is None else log.wrench[:, 3:]),
        )
        if values is not None
    ]
    rows += [(name, [(name, values)]) for name, values in log.contact.items()]
    if not rows:
        raise InputError(f"{log!r} to plot", "joints, a wrench or contact quantities", "check its columns")
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    palette = (*AXES, "#E69F00", "#CC79A7", "#000000", GREY)
    for i, (label, lines) in enumerate(rows, start=1):
        keep = thin(len(log), *(values for _, values in lines))
        for j, (name, values) in enumerate(lines):
            colour = VERMILION if len(lines) == 1 else palette[j % len(palette)]
            line(figure, log.t[keep] - log.t[0], values[keep], name, colour, i, legend=False)
        figure.update_yaxes(title_text=label, row=i, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(rows), col=1)
    finish(figure, 190 * len(rows) + 60)
    return figure
