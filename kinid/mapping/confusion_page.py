"""What left-out places were taken for, as one offline HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.mapping.picture_map import Sighted
from kinid.reports.render import render

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

#: light to dark: a count of 0 is the page's own ground
SCALE = "Blues"


def confusion_page(sighted: Sighted, picture: str) -> str:
    """Both confusion matrices, of random folds and of spatial blocks.

    Args:
        sighted: what was learnt. picture: its file's name.
    """
    seen, item = sighted.figures, sighted.item
    names = [f"{kind}: {level:.4g} {item.unit}" for kind, level in zip(seen.classes, sighted.levels)]
    titles = (
        f"Random folds, as in the study: {100.0 * seen.random_folds:.1f} % recognised",
        f"Spatial blocks, which is honest: {100.0 * seen.spatial_blocks:.1f} % recognised",
    )
    return render(
        "figures.html",
        f"What {picture} was taken for",
        facts=(
            f"{int(sighted.counts.sum())} probes of {item.name}, each left out in turn with its fold. Rows are what "
            "was probed, columns what the picture was taken for; colours are shares of a row."
        ),
        figures=[(title, _matrix(counts, names)) for title, counts in zip(titles, seen.confusion)],
    )


def _matrix(counts: NDArray[np.int64], names: list[str]) -> Figure:
    """A confusion matrix (c, c) with its counts."""
    from plotly.graph_objects import Figure, Heatmap

    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    figure = Figure(
        Heatmap(
            z=share,
            x=names,
            y=names,
            text=counts.astype(str).tolist(),
            texttemplate="%{text}",
            colorscale=SCALE,
            zmin=0.0,
            zmax=1.0,
            colorbar={"title": "share", "tickformat": ".0%"},
            hovertemplate="probed %{y}<br>taken for %{x}<br>%{text} places, %{z:.0%}<extra></extra>",
        )
    )
    figure.update_xaxes(title_text="taken for", type="category")
    figure.update_yaxes(title_text="probed", type="category", autorange="reversed", automargin=True, title_standoff=12)
    figure.update_layout(height=120 + 60 * len(names), margin={"l": 150, "r": 10, "t": 20, "b": 60})
    return figure
