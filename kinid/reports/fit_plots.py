"""Pictures of fits: measured and predicted forces over depth and time, and models side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid import estimators
from kinid.contact.loops import Loop, loops
from kinid.estimators.estimate import Track
from kinid.estimators.forgetting import Constant
from kinid.identification.compare import Comparison
from kinid.identification.fit import Fit
from kinid.identification.warnings import listed
from kinid.modeling.experiment import Experiment
from kinid.reports.plots import BLUE, GREEN, GREY, INK, MOST_POINTS, ORANGE, VERMILION, Entry, finish, stacked
from kinid.reports.render import render

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from kinid.campaign.compare import CampaignComparison

Array = NDArray[np.float64]

#: memory of the recursive estimates that are drawn [s]
MEMORY = 2.0
#: panels of energy loops on a page, the measured one included
MOST_PANELS = 6
COLOURS = (VERMILION, BLUE, GREEN, ORANGE, "#CC79A7", "#000000")


def fit_page(fit: Fit, title: str) -> str:
    """One fit: equation and estimates, force over depth, readings over time."""
    tracks = recursive_tracks(fit)
    return render("fit.html", title, fit=fit, tracks=_track_figure(fit, tracks) if tracks else None, **_pictures([fit]))


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
    rows, titles, spans = [], [], []
    for law, track in tracks.items():
        for i, name in enumerate(track.names):
            value, half = track.theta[:, i], 1.96 * track.std[:, i]
            good = track.valid & (half < 10 * np.abs(value) + 1e-12)
            value, half = np.where(good, value, np.nan), np.where(good, half, np.nan)
            band = [("95 %", value + side * half, "#b9d3ea") for side in (-1, 1)]
            rows.append(("", [*band, ("estimate", value, BLUE)]))
            titles.append(f"{law}: {name}")
            # the first samples know next to nothing: they don't set the scale
            spans.append(np.nanquantile(value, [0.05, 0.95]) if good.any() else None)
    t = fit.experiment.signals.t
    figure = stacked(t, rows, (rows[0][1][-1][1],), titles=titles)
    for row, span in enumerate(spans, start=1):
        if span is not None:
            room = 0.5 * (span[1] - span[0]) + 1e-9
            figure.update_yaxes(range=[span[0] - room, span[1] + room], row=row, col=1)
    return figure


def comparison_page(result: Comparison, title: str) -> str:
    """Models side by side: which is best, their errors over the noise, force over depth, readings over time."""
    return render("compare.html", title, c=result, winner=winner(result), **_pictures([row.fit for row in result.rows]))


def winner(result: Comparison | CampaignComparison) -> str:
    """Which model has the least held-out error, and whether that is more than chance, in a sentence."""
    best, *others = result.rows
    name = str(best.fit.model)
    if not others:
        return f"{name} stands alone: there is no other model to hold it against."
    if name != result.reference:
        by = f"{abs(best.difference):.2g} ± {best.standard_error:.2g} {result.unit} below that of {result.reference}"
        return f"{name} has the least held-out error, {by}{'' if best.differs else ', which may be chance'}."
    if not np.isfinite([row.difference for row in others]).all():
        return f"{name} has the least held-out error; too little is held out to say whether that is chance."
    alike = [str(row.fit.model) for row in others if not row.differs]
    if alike:
        return (
            f"No winner: {name} has the least held-out error, and this is too little to tell it from {listed(alike)}."
        )
    return f"{name} wins: each other model's held-out error is larger by more than twice the standard error."


def _pictures(fits: Sequence[Fit]) -> dict[str, object]:
    """Force over depth with its loops where the log has them, and all readings over time."""
    named = {str(fit.model): fit for fit in fits}
    pushed = fits[0].experiment.normal_force is not None
    cycles, panels = _energies(named) if pushed else ([], [])
    return {
        "names": [("measured", INK, "solid"), *((name, colour, "solid") for name, colour in zip(named, COLOURS))],
        "over_depth": _loop_figure(named) if pushed else None,
        "cycles": cycles,
        "panels": panels,
        "over_time": time_figure(named),
    }


def _loop_figure(fits: dict[str, Fit]) -> Figure:
    """Normal force over depth: measured points, a line a model."""
    import plotly.graph_objects as go

    experiment = next(iter(fits.values())).experiment
    depth = experiment.signals.depth
    near = np.flatnonzero(experiment.valid & (depth > -1e-3))
    near = near[:: 1 + len(near) // (2 * MOST_POINTS)]
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


def _energies(fits: dict[str, Fit]) -> tuple[list[Entry], list[tuple[str, Figure]]]:
    """Loops of force over depth with the energy that each encloses, measured and by each model: which colour is which
    cycle, and a captioned picture each; none without a loop.
    """
    experiment = next(iter(fits.values())).experiment
    s = experiment.signals
    readings = {"measured": np.where(experiment.valid, normal_of(experiment, experiment.measured), np.nan)}
    readings |= {name: normal_of(experiment, fit.predict()) for name, fit in list(fits.items())[: MOST_PANELS - 1]}
    found = {name: loops(s.depth, force, s.dt) for name, force in readings.items()}
    cycles = found["measured"]
    if not cycles:
        return [], []
    drawn = np.unique(np.linspace(0, len(cycles) - 1, len(COLOURS)).round().astype(int)).tolist()
    inside = np.concatenate([np.arange(cycles[i].begin, cycles[i].end) for i in drawn])
    spans = [(float(np.nanmin(force[inside])), float(np.nanmax(force[inside]))) for force in readings.values()]
    low, high = min(span[0] for span in spans), max(span[1] for span in spans)
    room = 0.05 * (high - low) + 1e-12
    panels = [
        (f"{name}: {energy_line(found[name])}", _panel(s.depth, force, found[name], drawn, (low - room, high + room)))
        for name, force in readings.items()
    ]
    names = [(f"cycle {i + 1} ({s.t[cycles[i].begin]:.3g} s)", colour, "solid") for colour, i in zip(COLOURS, drawn)]
    return names, panels


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
    look = {"showarrow": False, "align": "left", "font": {"size": 12}, "bgcolor": "#ffffff"}
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
    experiment = next(iter(fits.values())).experiment
    predictions = [(name, fit.predict(), colour) for (name, fit), colour in zip(fits.items(), COLOURS)]
    rows = [
        (
            f"{channel.replace('_', ' ')} [{unit}]",
            [("measured", experiment.measured[i], INK), *((name, of[i], colour) for name, of, colour in predictions)],
        )
        for i, (channel, unit) in enumerate(zip(experiment.layout.channels, experiment.layout.units))
    ]
    return stacked(experiment.signals.t, rows, experiment.measured[:3], height=320 if len(rows) == 1 else 200)
