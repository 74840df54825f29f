"""Small multiples of a residual: one channel by phase, depth, speed, direction, frequency, place, pose and time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kinid.reports.diagnosis_figures import Shown, Titled, bars, phase_bars, profile, rms
from kinid.reports.plots import INK, finish
from kinid.residuals.localization import spectrum
from kinid.residuals.parts import LEAST_SPREAD, STANDING, moving

Array = NDArray[np.float64]

#: cells of the picture of the surface, along each tangent
GRID = 8
#: points of a spectrum
POINTS = 60


def multiples(shown: Shown, row: int) -> Iterator[Titled]:
    """Every way to divide the residual of one channel that this log has something to say about."""
    view = shown.before
    s = view.experiment.signals
    yield phase_bars(shown, row)
    everything = np.ones(len(view.t), dtype=np.bool_)
    found: list[Titled | None] = []
    if s.joints is not None:
        slides = view.channels[row].startswith("force")
        place, speed, push = ("m", "m/s", "m/s²") if slides else ("rad", "rad/s", "rad/s²")
        q, dq, ddq = (view.at(x[row]) for x in (s.joints.q, s.joints.dq, s.joints.ddq))
        for x, heading in ((q, f"position [{place}]"), (dq, f"speed [{speed}]"), (ddq, f"acceleration [{push}]")):
            found.append(profile(shown, row, x, everything, heading))
        still = STANDING * max(float(np.abs(dq).max(initial=0.0)), 1e-12)
        found.append(
            _directions(shown, row, {"forwards": dq > still, "standing": np.abs(dq) <= still, "backwards": dq < -still})
        )
    elif view.touching.any():
        inside, way = view.touching, moving(view)
        found += [
            profile(shown, row, 1e3 * view.at(s.depth), inside, "depth [mm]"),
            profile(shown, row, 1e3 * view.at(s.depth_rate), inside, "speed of pressing [mm/s]"),
        ]
        slides = (way.slip[0] != 0) | (way.slip[1] != 0)
        if (slides & inside).mean() > 0.02:
            speed_of = 1e3 * np.hypot(*view.at(s.slip_rate))
            found.append(profile(shown, row, speed_of, inside & slides, "speed of sliding [mm/s]"))
        ways = {
            "loading": inside & (way.normal > 0),
            "unloading": inside & (way.normal < 0),
            "depth held": inside & (way.normal == 0),
        }
        for i in range(2):
            ways |= {f"along {i + 1}": inside & (way.slip[i] > 0), f"against {i + 1}": inside & (way.slip[i] < 0)}
        found += [_directions(shown, row, ways), _places(shown, row)]
    found += [_spectra(shown, row), profile(shown, row, view.t, everything, "time [s]", 30)]
    yield from (one for one in found if one is not None)


def _directions(shown: Shown, row: int, ways: dict[str, NDArray[np.bool_]]) -> Titled | None:
    kept = {name: mask for name, mask in ways.items() if mask.mean() > 0.01}
    return bars(shown, row, kept, "direction") if kept else None


def _spectra(shown: Shown, row: int) -> Titled | None:
    """Amplitude density over frequency, in bands that are alike wide on a logarithmic axis."""
    import plotly.graph_objects as go

    figure = go.Figure()
    nyquist = 0.5 / shown.before.period
    for name, view, colour, dash in shown.lines:
        f, energy = spectrum(view, view.residual[row])
        if len(f) < 64:
            return None
        width = float(f[1])
        index = np.digitize(f[1:], np.geomspace(f[1] * 0.999, f[-1] * 1.001, POINTS)) - 1
        count = np.bincount(index, minlength=POINTS)
        some = count > 0
        middle = np.exp(np.bincount(index, np.log(f[1:]), minlength=POINTS)[some] / count[some])
        density = np.sqrt(
            np.bincount(index, energy[1:], minlength=POINTS)[some]
            / count[some]
            / (width * max(float(view.samples[row].sum()), 1.0))
        )
        figure.add_scatter(
            x=middle,
            y=density,
            name=name,
            mode="lines",
            line={"color": colour, "dash": dash, "width": 1.6},
        )
    level, lowest = (
        float(shown.before.sigma[row] / np.sqrt(nyquist)),
        min(float(np.nanmin(trace.y)) for trace in figure.data),
    )
    if level > 0.03 * lowest:  # a noise far below would squeeze the picture
        figure.add_hline(y=level, line={"color": INK, "width": 1, "dash": "dot"})
    finish(figure, 230, small=True)
    figure.update_xaxes(type="log", exponentformat="none", dtick=1)
    figure.update_yaxes(type="log", title_text=f"[{shown.before.units[row]}/√Hz]", exponentformat="power", dtick=1)
    figure.update_layout(showlegend=False, hovermode="closest")
    return "frequency [Hz]", figure


def _places(shown: Shown, row: int) -> Titled | None:
    """Rms on the surface, before and after side by side; None where the tip hardly moved along it."""
    from plotly.subplots import make_subplots

    view = shown.before
    slip = 1e3 * view.at(view.experiment.signals.slip)
    inside = view.touching
    spans = [np.quantile(x[inside], [0.005, 0.995]) for x in slip]
    if max(high - low for low, high in spans) < 1e3 * LEAST_SPREAD:
        return None
    edges = [
        np.linspace(low - 1e-9, high + 1e-9, (GRID if high - low > 1e3 * LEAST_SPREAD else 1) + 1)
        for low, high in spans
    ]
    index = [np.clip(np.searchsorted(cut, x, side="right") - 1, 0, len(cut) - 2) for cut, x in zip(edges, slip)]
    code = index[1] * (len(edges[0]) - 1) + index[0]
    figure = make_subplots(
        rows=1,
        cols=len(shown.lines),
        shared_yaxes=True,
        horizontal_spacing=0.06,
        subplot_titles=[name for name, *_ in shown.lines],
    )
    tables = []
    for _, each, _, _ in shown.lines:
        values = [rms(each, row, inside & (code == k)) for k in range((len(edges[0]) - 1) * (len(edges[1]) - 1))]
        tables.append(np.array(values).reshape(len(edges[1]) - 1, len(edges[0]) - 1))
    top = max(float(np.nanmax(table)) for table in tables)
    for k, table in enumerate(tables):
        figure.add_heatmap(
            x=edges[0],
            y=edges[1],
            z=table,
            zmin=0.0,
            zmax=top,
            colorscale="Cividis",
            row=1,
            col=k + 1,
            showscale=k == len(tables) - 1,
            colorbar={"thickness": 8, "title": {"text": f"[{view.units[row]}]"}},
            hovertemplate="%{x:.3g}, %{y:.3g} mm: %{z:.3g} " + view.units[row] + "<extra></extra>",
        )
    finish(figure, 230, small=True)
    figure.update_layout(hovermode="closest", margin={"t": 30, "r": 4})
    figure.update_annotations(font={"size": 12})
    figure.update_xaxes(title_text="slip 1 [mm]", nticks=6, tickangle=0)
    figure.update_yaxes(title_text="slip 2 [mm]", col=1)
    return "place on the surface", figure
