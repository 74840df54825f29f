"""A property map as one offline HTML page: each property between its probes, how sure it is, and where the model
fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.estimators.estimate import NORMAL_95
from kinid.mapping.interpolation import METHOD_WORDS
from kinid.mapping.property_map import PropertyMap
from kinid.mapping.slide_borders import SlideBorder, across
from kinid.reports.plots import round_span
from kinid.reports.render import render
from kinid.robotics.surface import Plane

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter, Scatter3d

Array = NDArray[np.float64]

SCALE = "Viridis"
#: what is unknown has no colour of the scale
UNKNOWN = "#e5e7eb"
#: colours of a uniform property span this share of its value to either side, or so many times its probes' scatter
UNIFORM_SHARE, UNIFORM_SCATTERS = 0.1, 5.0
#: cells along the longer side of a plane
CELLS = 120
#: half length of the stroke at a border [m]
STROKE = 1.5e-3
MARGIN = {"l": 50, "r": 10, "t": 20, "b": 45}


def map_page(grown: PropertyMap, title: str, method: str = "gp", borders: Sequence[SlideBorder] = ()) -> str:
    """All properties of a map: each between the probes, with its standard deviation and borders that slides crossed."""
    properties = []
    for item in grown.properties:
        if not np.isfinite(grown.values(item.name)).any():
            continue
        uniform = grown.uniform(item.name)
        properties.append(
            {
                "name": f"{item.name} [{item.unit}]",
                "uniform": "" if uniform is None else uniform.words(item.unit),
                "errors": [] if grown.predicted else list(grown.held_out(item.name).values()),
                "figures": _figures(grown, item.name, method, borders),
            }
        )
    flat = isinstance(grown.surface, Plane)
    return render(
        "map.html",
        title,
        grown=grown,
        properties=properties,
        flat=flat,
        method=METHOD_WORDS[method],
        methods=[f"#{METHOD_WORDS[one]}" for one in grown.methods],
        residual_over_noise=residual_figure(grown) if flat and np.isfinite(grown.residual_over_noise).any() else None,
    )


def _figures(grown: PropertyMap, name: str, method: str, borders: Sequence[SlideBorder]) -> list[tuple[str, Figure]]:
    """A property, and over a plane its standard deviation where the method knows one."""
    if not isinstance(grown.surface, Plane):
        return [("map", mesh_figure(grown, name, method))]
    spread = spread_figure(grown, name, method)
    return [("map", plane_figure(grown, name, method, borders)), *([("standard deviation", spread)] if spread else [])]


def plane_figure(grown: PropertyMap, name: str, method: str = "gp", borders: Sequence[SlideBorder] = ()) -> Figure:
    """A property over a plane, its probes, and a stroke across the slip at each border that slides crossed."""
    ticks = grown.grid(CELLS)
    figure = _field(grown, name, ticks, grown.over_grid(name, ticks, method).mean, colour_range(grown, name), SCALE)
    figure.add_trace(_probes(grown, name))
    if borders:
        figure.add_trace(_strokes(borders))
    return figure


def _strokes(borders: Sequence[SlideBorder]) -> Scatter:
    """Borders as strokes across the slip; where is said at the mouse."""
    from plotly.graph_objects import Scatter as NewScatter

    gap = np.full((1, 2), np.nan)
    ends = 1e3 * np.concatenate([np.concatenate([across(border.change, STROKE), gap]) for border in borders])
    words = [
        f"border of {Path(log).name} ± {1e3 * NORMAL_95 * c.sd:.2g} mm (95 %){': ' + c.doubt if c.doubt else ''}"
        for log, c in borders
        for _ in range(3)
    ]
    line = {"color": "#dc2626", "width": 2}
    return NewScatter(
        x=ends[:, 0], y=ends[:, 1], mode="lines", text=words, hoverinfo="text", showlegend=False, line=line
    )


def spread_figure(grown: PropertyMap, name: str, method: str = "gp") -> Figure | None:
    """The standard deviation of a property over a plane; None where the method knows none."""
    ticks = grown.grid(CELLS)
    spread = grown.over_grid(name, ticks, method).sd
    if not np.isfinite(spread).any():
        return None
    return _field(grown, name, ticks, spread, (0.0, round_span(0.0, float(np.nanmax(spread)))[1]), "Greys")


def _field(
    grown: PropertyMap, name: str, ticks: tuple[Array, Array], field: Array, span: tuple[float, float], scale: str
) -> Figure:
    """Values over the grid of a plane, (x, y); what is unknown is grey."""
    from plotly.graph_objects import Figure as NewFigure
    from plotly.graph_objects import Heatmap

    unit = grown.properties[grown.index(name)].unit
    heat = Heatmap(
        x=1e3 * ticks[0],
        y=1e3 * ticks[1],
        z=field.T,
        zmin=span[0],
        zmax=span[1],
        colorscale=scale,
        colorbar={"title": {"text": unit}, "thickness": 12},
        hoverongaps=False,
        hovertemplate="%{x:.1f}, %{y:.1f} mm: %{z:.4g} " + unit + "<extra></extra>",
    )
    figure = NewFigure(heat)
    _lay_axes(figure)
    figure.update_layout(height=380, margin=MARGIN, plot_bgcolor=UNKNOWN)
    return figure


def colour_range(grown: PropertyMap, name: str) -> tuple[float, float]:
    """Values of the first and the last colour; of a uniform property they lie far beyond what is chance."""
    uniform = grown.uniform(name)
    if uniform is None:
        values = grown.values(name)
        return round_span(float(np.nanmin(values)), float(np.nanmax(values)))
    half = max(UNIFORM_SHARE * abs(uniform.value), UNIFORM_SCATTERS * uniform.scatter, 1e-12)
    return round_span(uniform.value - half, uniform.value + half)


def _lay_axes(figure: Figure) -> None:
    """Millimetres along both tangents, of one scale."""
    figure.update_xaxes(title_text="along tangent 1 [mm]", constrain="domain", showgrid=False, zeroline=False)
    figure.update_yaxes(
        title_text="along tangent 2 [mm]", scaleanchor="x", constrain="domain", showgrid=False, zeroline=False
    )


def _probes(grown: PropertyMap, name: str) -> Scatter:
    """The probes of a plane, each with its value at the mouse."""
    from plotly.graph_objects import Scatter as NewScatter

    flat, unit = 1e3 * grown.flat(grown.places), grown.properties[grown.index(name)].unit
    return NewScatter(
        x=flat[:, 0],
        y=flat[:, 1],
        mode="markers",
        text=[
            f"{v:.4g} ± {NORMAL_95 * e:.2g} {unit} (95 %)" for v, e in zip(grown.values(name), grown.deviations(name))
        ],
        hoverinfo="text",
        showlegend=False,
        marker={"size": 4, "color": "white", "line": {"width": 1, "color": "black"}},
    )


def residual_figure(grown: PropertyMap) -> Figure:
    """Residual over noise at each probe of a plane."""
    from plotly.graph_objects import Figure as NewFigure
    from plotly.graph_objects import Scatter

    flat = 1e3 * grown.flat(grown.places)
    residual_over_noise = grown.residual_over_noise
    bar = {
        "title": {"text": "residual / noise", "side": "right"},
        "thickness": 12,
        "tickvals": [0, 0.5, 1, 1.5],
        "ticktext": ["1", "3", "10", "30"],
    }
    figure = NewFigure(
        Scatter(
            x=flat[:, 0],
            y=flat[:, 1],
            mode="markers",
            text=[f"{v:.2f} times the noise" for v in residual_over_noise],
            hoverinfo="text",
            marker={
                "size": 13,
                "line": {"width": 1, "color": "#9ca3af"},
                "color": np.log10(np.maximum(residual_over_noise, 0.1)),
                "colorscale": "Inferno",
                "cmin": 0.0,
                "cmax": 1.5,
                "colorbar": bar,
            },
        )
    )
    _lay_axes(figure)
    figure.update_layout(height=420, margin=MARGIN)
    return figure


def mesh_figure(grown: PropertyMap, name: str, method: str = "gp") -> Figure:
    """A property over a mesh; faces with an unknown corner are grey."""
    assert not isinstance(grown.surface, Plane)
    vertices, faces = grown.surface.vertices, grown.surface.faces
    guess = grown.interpolator(name, method).at(np.arange(len(vertices)))
    unit = grown.properties[grown.index(name)].unit
    figure = coloured_mesh(vertices, faces, guess.mean, colour_range(grown, name), SCALE, unit)
    figure.add_trace(marks(grown.places))
    return figure


def coloured_mesh(
    vertices: Array, faces: NDArray[np.int64], values: Array, span: tuple[float, float], scale: str, unit: str
) -> Figure:
    """A mesh coloured by values at its vertices; faces with a corner without one are grey."""
    from plotly.graph_objects import Figure as NewFigure
    from plotly.graph_objects import Mesh3d

    known = np.isfinite(values)[faces].all(axis=1)
    x, y, z = vertices.T
    figure, (low, high) = NewFigure(), span
    bar = {"colorscale": scale, "cmin": low, "cmax": high, "colorbar": {"title": {"text": unit}}}
    for part, options in (
        (faces[~known], {"color": UNKNOWN}),
        (faces[known], {"intensity": np.nan_to_num(values), **bar}),
    ):
        if len(part):
            figure.add_trace(Mesh3d(x=x, y=y, z=z, i=part[:, 0], j=part[:, 1], k=part[:, 2], **options))
    figure.update_layout(height=520, margin={"l": 0, "r": 0, "t": 20, "b": 0}, scene={"aspectmode": "data"})
    return figure


def marks(places: Array, colour: str = "#000000", size: int = 2) -> Scatter3d:
    """Points in space, (n, 3) [m]."""
    from plotly.graph_objects import Scatter3d as NewScatter3d

    x, y, z = places.T
    return NewScatter3d(x=x, y=y, z=z, mode="markers", showlegend=False, marker={"size": size, "color": colour})
