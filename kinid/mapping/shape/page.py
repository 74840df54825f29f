"""A surface that touches found, as one offline HTML page: coloured by its properties and by how well it is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.mapping.map_page import SCALE, colour_range, coloured_mesh, marks
from kinid.mapping.shape import Shape, Sheet
from kinid.mapping.shape.exploration import NextTouch
from kinid.reports.plots import round_span
from kinid.reports.render import render

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]


def shape_page(
    shape: Shape, sheet: Sheet, title: str, lines: Sequence[str], following: Sequence[NextTouch] = ()
) -> str:
    """The surface by its own uncertainty and by each property with its standard deviation.

    Args:
        lines: what is said of it. following: touches that are proposed, marked in red.
    """
    figures = {
        "place": [("standard deviation along the normal", _by(shape, sheet, 1e3 * sheet.located.sd, "mm", following))]
    }
    for item in shape.touches.properties:
        if np.isfinite(shape.grown.values(item.name)).any():
            guess = shape.interpolator(item.name).at(sheet.flat)
            span = colour_range(shape.grown, item.name)
            figures[f"{item.name} [{item.unit}]"] = [
                ("between the touches", _by(shape, sheet, guess.mean, item.unit, following, span, SCALE)),
                ("standard deviation", _by(shape, sheet, guess.sd, item.unit, following)),
            ]
    return render("shape.html", title, lines=lines, figures=figures)


def _by(
    shape: Shape,
    sheet: Sheet,
    values: Array,
    unit: str,
    following: Sequence[NextTouch],
    span: tuple[float, float] | None = None,
    scale: str = "Greys",
) -> Figure:
    """The surface coloured by values at its places, (m,), over their own span unless another is given."""
    span = span or round_span(float(np.nanmin(values)), float(np.nanmax(values)))
    figure = coloured_mesh(sheet.located.points, sheet.faces, values, span, scale, unit)
    figure.add_trace(marks(shape.touches.places, "#000000"))
    if following:
        figure.add_trace(marks(np.array([each.place for each in following]), "#dc2626", 5))
    return figure
