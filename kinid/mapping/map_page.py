"""A property map as one offline HTML page: each property between its probes, how sure it is, and where the model
fails.
"""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.mapping.property_map import PropertyMap
from kinid.reports.plots import page
from kinid.robotics.surface import Plane
from kinid.writers import Json

if TYPE_CHECKING:
    from collections.abc import Callable

    from plotly.graph_objects import Figure, Scatter

Array = NDArray[np.float64]

SCALE = "Viridis"
#: what is unknown has no colour of the scale
UNKNOWN = "#e5e7eb"
#: colours of a uniform property span this share of its value to either side, or so many times its probes' scatter
UNIFORM_SHARE, UNIFORM_SCATTERS = 0.1, 5.0
#: title of the panel of standard deviations
SPREAD = "standard deviation"


def map_page(grown: PropertyMap, title: str, method: str = "gp", truth: Json | None = None) -> str:
    """All properties of a map; `truth` gives, by property, a function of places along both tangents (m,) [m]."""
    figures, rows = [], ""
    for item in grown.properties:
        if not np.isfinite(grown.values(item.name)).any():
            continue
        if isinstance(grown.surface, Plane):
            figure = plane_figure(grown, item.name, method, (truth or {}).get(item.name))
        else:
            figure = mesh_figure(grown, item.name, method)
        name, uniform = f"{item.name} [{item.unit}]", grown.uniform(item.name)
        figures.append((name + (f": {uniform.words(item.unit)}" if uniform is not None else ""), figure))
        errors = "".join(f"<td>{error:.4g}</td>" for error in grown.held_out(item.name).values())
        rows += f"<tr><td>{html.escape(name)}</td>{errors}</tr>"
    if np.isfinite(grown.misfit).any() and isinstance(grown.surface, Plane):
        figures.append(("Where the model fails: residual over noise", misfit_figure(grown)))
    head = (
        f"<p class=facts>{len(grown)} probes with {html.escape(grown.model)}. Grey is unknown. Error where each probe "
        "is left out in turn:</p><div class=scroll><table><tr><th>property</th>"
        + "".join(f"<th>{m}</th>" for m in grown.methods)
        + f"</tr>{rows}</table></div>"
    )
    return page(title, head, figures)


def plane_figure(
    grown: PropertyMap, name: str, method: str = "gp", truth: Callable[[Array, Array], Array] | None = None
) -> Figure:
    """A property over a plane, its standard deviation (or, where it is given, the truth) beside it."""
    from plotly.graph_objects import Heatmap
    from plotly.subplots import make_subplots

    ticks = grown.grid(140)
    guess = grown.over_grid(name, ticks, method)
    unit = grown.properties[grown.index(name)].unit
    low, high = _colour_range(grown, name)
    panels: list[tuple[str, Array, float, float]] = [(f"map ({len(grown)} probes)", guess.mean, low, high)]
    if truth is not None:
        x, y = np.meshgrid(*ticks, indexing="ij")
        panels.append(("truth", np.asarray(truth(x.ravel(), y.ravel())).reshape(x.shape), low, high))
    if np.isfinite(guess.sd).any():
        panels.append((SPREAD, guess.sd, 0.0, float(np.nanmax(guess.sd))))
    figure = make_subplots(1, len(panels), subplot_titles=[p[0] for p in panels], horizontal_spacing=0.13)
    for k, (title, field, bottom, top) in enumerate(panels, start=1):
        bar = {
            "title": {"text": unit, "side": "right"},
            "x": figure.layout["xaxis" if k == 1 else f"xaxis{k}"].domain[1] + 0.01,
            "thickness": 12,
            "len": 0.9,
        }
        heat = Heatmap(
            x=1e3 * ticks[0],
            y=1e3 * ticks[1],
            z=field.T,
            zmin=bottom,
            zmax=top,
            colorscale="Greys" if title == SPREAD else SCALE,
            colorbar=bar,
            showscale=title == SPREAD or k == (1 if truth is None else 2),
            hoverongaps=False,
            name=title,
            hovertemplate="%{x:.1f}, %{y:.1f} mm: %{z:.4g} " + unit + "<extra></extra>",
        )
        figure.add_trace(heat, 1, k)
        _lay_axes(figure, row=1, col=k, anchor="x" if k == 1 else f"x{k}")
    figure.add_trace(_probes(grown, name), 1, 1)
    figure.update_layout(height=380, margin={"l": 60, "r": 20, "t": 40, "b": 50}, plot_bgcolor=UNKNOWN)
    return figure


def _colour_range(grown: PropertyMap, name: str) -> tuple[float, float]:
    """Values of the first and the last colour; of a uniform property they lie far beyond what is chance."""
    uniform = grown.uniform(name)
    if uniform is None:
        values = grown.values(name)
        return float(np.nanmin(values)), float(np.nanmax(values))
    half = max(UNIFORM_SHARE * abs(uniform.value), UNIFORM_SCATTERS * uniform.scatter, 1e-12)
    return uniform.value - half, uniform.value + half


def _lay_axes(figure: Figure, anchor: str = "x", **place: int) -> None:
    """Millimetres along both tangents, of one scale."""
    figure.update_xaxes(title_text="along tangent 1 [mm]", constrain="domain", **place)
    title = "along tangent 2 [mm]" if place.get("col", 1) == 1 else None
    figure.update_yaxes(title_text=title, scaleanchor=anchor, constrain="domain", **place)


def _probes(grown: PropertyMap, name: str) -> Scatter:
    """The probes of a plane, each with its value at the mouse."""
    from plotly.graph_objects import Scatter as NewScatter

    flat, unit = 1e3 * grown.flat(grown.places), grown.properties[grown.index(name)].unit
    return NewScatter(
        x=flat[:, 0],
        y=flat[:, 1],
        mode="markers",
        text=[f"{v:.4g} ± {e:.2g} {unit}" for v, e in zip(grown.values(name), grown.deviations(name))],
        hoverinfo="text",
        showlegend=False,
        marker={"size": 4, "color": "white", "line": {"width": 1, "color": "black"}},
    )


def misfit_figure(grown: PropertyMap) -> Figure:
    """Residual over noise at each probe of a plane."""
    from plotly.graph_objects import Figure as NewFigure
    from plotly.graph_objects import Scatter

    flat = 1e3 * grown.flat(grown.places)
    misfit = grown.misfit
    bar = {
        "title": {"text": "residual / noise"},
        "tickvals": [0, 0.5, 1, 1.5],
        "ticktext": ["1", "3", "10", "30"],
    }
    figure = NewFigure(
        Scatter(
            x=flat[:, 0],
            y=flat[:, 1],
            mode="markers",
            text=[f"{v:.2f} times the noise" for v in misfit],
            hoverinfo="text",
            marker={
                "size": 13,
                "color": np.log10(np.maximum(misfit, 0.1)),
                "colorscale": "Inferno",
                "cmin": 0.0,
                "cmax": 1.5,
                "colorbar": bar,
            },
        )
    )
    _lay_axes(figure)
    figure.update_layout(height=420, margin={"l": 60, "r": 20, "t": 20, "b": 50})
    return figure


def mesh_figure(grown: PropertyMap, name: str, method: str = "gp") -> Figure:
    """A property over a mesh; faces with an unknown corner are grey."""
    from plotly.graph_objects import Figure as NewFigure
    from plotly.graph_objects import Mesh3d, Scatter3d

    assert not isinstance(grown.surface, Plane)
    vertices, faces = grown.surface.vertices, grown.surface.faces
    guess = grown.interpolator(name, method).at(np.arange(len(vertices)))
    told = guess.known[faces].all(axis=1)
    unit = grown.properties[grown.index(name)].unit
    x, y, z = vertices.T
    figure = NewFigure()
    for part, options in (
        (faces[~told], {"color": UNKNOWN}),
        (
            faces[told],
            {"intensity": np.nan_to_num(guess.mean), "colorscale": SCALE, "colorbar": {"title": {"text": unit}}},
        ),
    ):
        if len(part):
            figure.add_trace(Mesh3d(x=x, y=y, z=z, i=part[:, 0], j=part[:, 1], k=part[:, 2], **options))
    places = grown.places
    figure.add_trace(
        Scatter3d(
            x=places[:, 0],
            y=places[:, 1],
            z=places[:, 2],
            mode="markers",
            showlegend=False,
            marker={"size": 2, "color": "black"},
        )
    )
    figure.update_layout(height=520, margin={"l": 0, "r": 0, "t": 20, "b": 0}, scene={"aspectmode": "data"})
    return figure
