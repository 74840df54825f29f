"""Pictures of fits: measured and predicted forces over depth and time, and models side by side."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid import estimators
from kinid.contact.loops import Loop, loops
from kinid.estimators.estimate import Track
from kinid.estimators.forgetting import Constant
from kinid.identification.compare import Comparison
from kinid.identification.fit import Fit
from kinid.modeling.experiment import Experiment
from kinid.reports.plots import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MOST_POINTS,
    ORANGE,
    VERMILION,
    drawing,
    finish,
    grid,
    key,
    line,
    note,
    page,
    table,
    thin,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

#: memory of the recursive estimates that are drawn [s]
MEMORY = 2.0
#: panels of energy loops on a page, the measured one included
MOST_PANELS = 6
COLOURS = (VERMILION, BLUE, GREEN, ORANGE, "#CC79A7", "#000000")


def fit_page(fit: Fit, title: str) -> str:
    """One fit: equation and estimates, force over depth, readings over time."""
    rows = [(p.name, f"{p.value:.5g}", f"{p.low:.5g}", f"{p.high:.5g}", p.unit) for p in fit.parameters.values()]
    error = fit.error
    head = (
        f"<pre>{html.escape(fit.equation())}</pre>",
        table(("parameter", "estimate", "95 % from", "to", "unit"), rows),
        note(
            f"error {error.train:.4g} {error.unit} rms on samples seen, {error.held_out:.4g} on samples held out; "
            f"the noise is {error.noise_floor:.4g}."
        ),
        *(note(f"doubt: {warning}") for warning in fit.warnings),
    )
    figures = _pictures({str(fit.model): fit})
    tracks = recursive_tracks(fit)
    if tracks:
        figures.append(
            ("Estimates over time, recursively (band: 95 %; where the log excites them)", _track_figure(fit, tracks))
        )
    return page(title, "".join(head), figures)


def recursive_tracks(fit: Fit) -> dict[str, Track]:
    """What the recursive estimators say sample by sample, for the laws that have one: base law and dry friction."""
    experiment = fit.experiment
    signals, channels = experiment.signals, experiment.layout.channels
    out: dict[str, Track] = {}
    if "normal_force" not in channels:
        return out
    force = experiment.measured[channels.index("normal_force")]
    touching = experiment.in_contact & (signals.depth > 0)
    forgetting = Constant(1.0 - min(0.02, float(np.median(np.diff(signals.t))) / MEMORY))
    for effect in fit.model.effects:
        if not effect.recursive or not (effect.base or "tangential_force2" in channels):
            continue
        estimator = getattr(estimators, effect.recursive)
        if effect.base:
            run = estimator(forgetting=forgetting).run
            out[effect.id] = run(signals.depth, signals.depth_rate, force, in_contact=touching)
        else:
            tangential = experiment.measured[-2:].T
            out["friction"] = estimator().run(force, signals.slip_rate.T, tangential, signals.t, touching)
    return out


def _track_figure(fit: Fit, tracks: dict[str, Track]) -> Figure:
    """One row a parameter: value and 95 % band, where the estimate is valid."""
    from plotly.subplots import make_subplots

    rows = [(track, i, f"{law}: {name}") for law, track in tracks.items() for i, name in enumerate(track.names)]
    figure = make_subplots(
        rows=len(rows),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.3 / len(rows),
        subplot_titles=[title for _, _, title in rows],
    )
    t = fit.experiment.signals.t
    keep = np.arange(0, len(t), 1 + len(t) // MOST_POINTS)
    for row, (track, i, _) in enumerate(rows, start=1):
        value, half = track.theta[:, i], 1.96 * track.std[:, i]
        good = track.valid & (half < 10 * np.abs(value) + 1e-12)
        value, half = np.where(good, value, np.nan)[keep], np.where(good, half, np.nan)[keep]
        line(figure, t[keep], value - half, "95 %", "#b9d3ea", row, legend=False)
        line(figure, t[keep], value + half, "95 %", "#b9d3ea", row, legend=False)
        line(figure, t[keep], value, "estimate", BLUE, row, legend=False)
        held = value[np.isfinite(value)]
        if len(held):  # the first samples know next to nothing: they don't set the scale
            low, high = np.quantile(held, [0.05, 0.95])
            figure.update_yaxes(
                range=[low - 0.5 * (high - low) - 1e-9, high + 0.5 * (high - low) + 1e-9], row=row, col=1
            )
    figure.update_xaxes(title_text="time [s]", row=len(rows), col=1)
    finish(figure, 190 * len(rows) + 60)
    return figure


def comparison_page(result: Comparison, title: str) -> str:
    """Models side by side: the table, force over depth, readings over time."""
    rows = []
    for row in result.rows:
        same = str(row.fit.model) == result.reference
        apart = ("reference", "") if same else (f"{row.difference:+.3g}", f"{row.standard_error:.2g}")
        rows.append((f"{row.rank}. {row.fit.model}", f"{row.held_out:.4g}", *apart))
    head = (
        table(("model", f"held-out error [{result.unit}]", "difference", "± standard error"), rows),
        note(f"differences are to {result.reference}; the noise is {result.noise_floor:.4g} {result.unit}."),
        *(note(f"doubt: {row.fit.model}: {warning}") for row in result.rows for warning in row.fit.warnings),
    )
    return page(title, "".join(head), _pictures({str(row.fit.model): row.fit for row in result.rows}))


def _pictures(fits: dict[str, Fit]) -> list[tuple[str, Figure | str]]:
    """Force over depth with its loops where the log has them, and all readings over time."""
    names = key([("measured", INK, "solid"), *((name, colour, "solid") for name, colour in zip(fits, COLOURS))])
    figures: list[tuple[str, Figure | str]] = [("Readings over time", names + drawing(time_figure(fits)))]
    if next(iter(fits.values())).experiment.normal_force is None:
        return figures
    return [("Force over depth", names + drawing(_loop_figure(fits))), *_energies(fits), *figures]


def _loop_figure(fits: dict[str, Fit]) -> Figure:
    """Normal force over depth: measured points, a line a model."""
    import plotly.graph_objects as go

    experiment = next(iter(fits.values())).experiment
    depth = experiment.signals.depth
    near = np.flatnonzero(experiment.valid & (depth > -1e-3))
    near = near[:: 1 + len(near) // MOST_POINTS]
    figure = go.Figure()
    figure.add_scatter(
        x=1e3 * depth[near],
        y=normal_of(experiment, experiment.measured)[near],
        mode="markers",
        name="measured",
        marker={"size": 3, "color": GREY},
        showlegend=False,
    )
    for (name, fit), colour in zip(fits.items(), COLOURS):
        figure.add_scatter(
            x=1e3 * depth[near],
            y=normal_of(experiment, fit.predict())[near],
            mode="lines",
            name=name,
            line={"color": colour, "width": 1.2},
            showlegend=False,
        )
    figure.update_xaxes(title_text="depth [mm]")
    figure.update_yaxes(title_text="normal force [N]")
    finish(figure, 460)
    figure.update_layout(hovermode="closest")
    return figure


def normal_of(experiment: Experiment, readings: Array) -> Array:
    """Normal force in readings (channels, n), of a wrench without the tool's load, (n,)."""
    channels, sensor = experiment.layout.channels, experiment.signals.sensor
    if "normal_force" in channels or sensor is None:
        return np.asarray(readings[channels.index("normal_force")])
    return np.asarray(np.einsum("ni,in->n", sensor.to_contact[:, 2], readings[:3] - sensor.load[:3]))


def _energies(fits: dict[str, Fit]) -> list[tuple[str, Figure | str]]:
    """Loops of force over depth with the energy that each encloses, measured and by each model; none without a loop."""
    experiment = next(iter(fits.values())).experiment
    s = experiment.signals
    readings = {"measured": np.where(experiment.valid, normal_of(experiment, experiment.measured), np.nan)}
    readings |= {name: normal_of(experiment, fit.predict()) for name, fit in list(fits.items())[: MOST_PANELS - 1]}
    found = {name: loops(s.depth, force, s.dt) for name, force in readings.items()}
    cycles = found["measured"]
    if not cycles:
        return []
    drawn = np.unique(np.linspace(0, len(cycles) - 1, len(COLOURS)).round().astype(int)).tolist()
    inside = np.concatenate([np.arange(cycles[i].begin, cycles[i].end) for i in drawn])
    spans = [(float(np.nanmin(force[inside])), float(np.nanmax(force[inside]))) for force in readings.values()]
    low, high = min(span[0] for span in spans), max(span[1] for span in spans)
    room = 0.05 * (high - low) + 1e-12
    panels = [
        (f"{name}: {energy_line(found[name])}", _panel(s.depth, force, found[name], drawn, (low - room, high + room)))
        for name, force in readings.items()
    ]
    names = key((f"cycle {i + 1} ({s.t[cycles[i].begin]:.3g} s)", colour, "solid") for colour, i in zip(COLOURS, drawn))
    return [("Energy lost in each way in and out (the area of its loop)", names + grid(panels))]


def _panel(depth: Array, force: Array, found: list[Loop], drawn: list[int], span: tuple[float, float]) -> Figure:
    """Some loops of one model, with what each loses."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for colour, i in zip(COLOURS, drawn):
        if i >= len(found):
            continue
        loop = found[i]
        rows = np.arange(loop.begin, loop.end)
        rows = rows[np.isfinite(force[rows])]
        rows = rows[:: 1 + len(rows) // 600]
        figure.add_scatter(
            x=1e3 * depth[rows],
            y=force[rows],
            mode="lines",
            fill="toself",
            opacity=0.7,
            showlegend=False,
            line={"color": colour, "width": 1.2},
            name=f"cycle {i + 1}",
            hovertemplate=f"{1e3 * loop.lost:.4g} mJ lost of {1e3 * loop.put_in:.4g}<extra>cycle {i + 1}</extra>",
        )
    energies = [f"{i + 1}: {_millijoules(found[i].lost, found[i].put_in)} mJ" for i in drawn if i < len(found)]
    corner = {"x": 0.03, "y": 0.97, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "top"}
    look = {"showarrow": False, "align": "left", "font": {"size": 12}, "bgcolor": "rgba(255,255,255,0.7)"}
    figure.add_annotation(text="<br>".join(energies), **corner, **look)
    figure.update_xaxes(title_text="depth [mm]")
    figure.update_yaxes(title_text="normal force [N]", range=span)
    finish(figure, 330)
    figure.update_layout(hovermode="closest", margin={"l": 58, "r": 12, "t": 12, "b": 44})
    return figure


def _millijoules(energy: float, put_in: float) -> str:
    """An energy [J] in mJ, to a thousandth of what was put in: finer digits of a loop are rounding."""
    digits = 3 - int(np.floor(np.log10(1e3 * put_in))) - 1 if put_in > 0 else 3
    return f"{round(1e3 * energy, digits) + 0.0:.{max(0, digits)}f}".replace("-", "−")


def energy_line(found: list[Loop]) -> str:
    """Energy lost in a cycle, its share, and its spread between cycles."""
    if not found:
        return "no loop"
    lost = np.array([loop.lost for loop in found])
    put_in = float(np.mean([loop.put_in for loop in found]))
    spread = f" ± {_millijoules(float(lost.std(ddof=1)), put_in)}" if len(found) > 1 else ""
    times = f" a cycle, {len(found)} cycles" if len(found) > 1 else ""
    return f"{_millijoules(float(lost.mean()), put_in)}{spread} mJ lost of {1e3 * put_in:.3g}{times}"


def time_figure(fits: dict[str, Fit]) -> Figure:
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
        line(figure, t, experiment.measured[i][keep], "measured", INK, i + 1, legend=False)
        for (name, predicted), colour in zip(predictions.items(), COLOURS):
            line(figure, t, predicted[i][keep], name, colour, i + 1, legend=False)
        figure.update_yaxes(title_text=f"{channel.replace('_', ' ')} [{unit}]", row=i + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(layout.channels), col=1)
    finish(figure, max(320, 200 * len(layout.channels)) + 60)
    return figure
