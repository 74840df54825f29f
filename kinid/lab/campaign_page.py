"""A campaign at a glance: which places are poked, and how hard they pushed back; from the logs alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.data.rig import Rig
from kinid.errors import KinidError
from kinid.lab.places import Grid
from kinid.reports.plots import BLUE, finish, round_span
from kinid.reports.render import render
from kinid.robotics.robot import Robot
from kinid.writers import write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

NAME = "overview.html"
#: the page of a campaign that goes on is written again after so long [s]
AGAIN = 5.0
#: of a poke that ends before it holds, so many samples stand for the hold
LAST = 25
#: points of each force that is drawn
DRAWN = 200


class Seen(NamedTuple):
    """What a poke's log shows: greatest and mean held normal force [N], greatest depth [m], and the force over time."""

    greatest: float
    held: float
    deepest: float
    t: Array
    force: Array


class Overview:
    """Looks at each poke once, and writes the page whole or not at all.

    Args:
        folder: of the campaign, with `rig.toml`. grid: its places. title: one line on what is poked.
    """

    def __init__(self, folder: Path, grid: Grid, title: str) -> None:
        self.folder, self.grid, self.title = folder, grid, title
        self.seen: dict[int, Seen] = {}
        self.unreadable: list[str] = []
        self._written = 0.0
        self._robot: tuple[Rig, Robot] | None = None

    def add(self, index: int) -> None:
        """Look at a poke that is done; now and then write the page."""
        from kinid.contact.series import contact_series
        from kinid.robotics.reading import read
        from kinid.signal.derivative import Differentiator

        path = self.folder / f"{self.grid.name(index)}.parquet"
        try:
            if self._robot is None:
                rig = Rig.load(self.folder / "rig.toml")
                self._robot = rig, Robot.load(rig)
            rig, robot = self._robot
            # forces and depths at a glance: rates are of no interest, and smoothing would take as long as the poke
            touch = contact_series(read(path, rig), rig, robot=robot, differentiator=Differentiator())
        except KinidError:
            self.unreadable.append(path.name)
            return
        phase = np.full(len(touch), "") if touch.phase is None else touch.phase
        held = phase == "hold"
        if not held.any():  # a poke that ended before
            held = np.roll(phase == "retract", -LAST) & (phase != "retract")
        hold = touch.normal_force[held & touch.in_contact]
        rows = np.linspace(0, len(touch) - 1, DRAWN).astype(np.int64)
        self.seen[index] = Seen(
            float(np.nanmax(touch.normal_force)),
            float(np.median(hold)) if len(hold) else float("nan"),
            float(np.nanmax(touch.depth)),
            touch.t[rows] - touch.t[0],
            np.round(touch.normal_force[rows], 3),
        )
        if time.monotonic() - self._written > AGAIN:
            self.write()

    def write(self) -> None:
        """Write the page as things are."""
        write_text(self.folder / NAME, campaign_page(self.title, self.grid, self.seen, self.unreadable))
        self._written = time.monotonic()


def campaign_page(title: str, grid: Grid, seen: dict[int, Seen], unreadable: Sequence[str] = ()) -> str:
    """Progress, places and forces as one self-contained HTML page; with the names of logs that can't be read."""
    values = np.array([[s.greatest, s.held, 1e3 * s.deepest] for s in seen.values()]).reshape(-1, 3)
    names = ("greatest normal force [N]", "normal force held [N]", "greatest depth [mm]")
    spans = np.nanquantile(values, [0.0, 0.5, 1.0], axis=0).T if seen else []
    left = [grid.name(i) for i in range(grid.count) if i not in seen]
    return render(
        "overview.html",
        title,
        grid=grid,
        done=len(seen) + len(unreadable),
        unreadable=unreadable,
        spans=[(name, *(f"{value:.3g}" for value in span)) for name, span in zip(names, spans)],
        missing=[name for name in left if f"{name}.parquet" not in unreadable],
        figures=[
            ("Normal force held at each place", _map(grid, seen)),
            ("Normal force over time, all places", _forces(grid, seen)),
        ]
        if seen
        else [],
    )


def _map(grid: Grid, seen: dict[int, Seen]) -> Figure:
    """A field a place; empty where nothing has been poked."""
    import plotly.graph_objects as go

    held = np.full((grid.rows, grid.columns), np.nan)
    for index, poke in seen.items():
        held[divmod(index, grid.columns)] = poke.held
    apart, (x, y) = 1e3 * grid.spacing, grid.place(0)
    low, high = round_span(float(np.nanmin(held)), float(np.nanmax(held)))
    figure = go.Figure(
        go.Heatmap(
            zmin=low,
            zmax=high,
            x0=1e3 * x,
            dx=apart,
            y0=1e3 * y,
            dy=apart,
            z=held.T,
            colorscale="Viridis",
            xgap=1,
            ygap=1,
            colorbar={"title": {"text": "[N]"}},
            hovertemplate="(%{x:g}, %{y:g}) mm: %{z:.3g} N<extra></extra>",
        )
    )
    finish(figure, 420)
    figure.update_layout(hovermode="closest", plot_bgcolor="#f3f4f6")
    figure.update_xaxes(title_text="along tangent 1 [mm]", constrain="domain", showgrid=False)
    figure.update_yaxes(title_text="along tangent 2 [mm]", scaleanchor="x", constrain="domain", showgrid=False)
    return figure


def _forces(grid: Grid, seen: dict[int, Seen]) -> Figure:
    """All pokes in one line that is broken between them: one a place would make the page slow."""
    import plotly.graph_objects as go

    gap = np.array([np.nan])
    t = np.concatenate([part for poke in seen.values() for part in (poke.t, gap)])
    force = np.concatenate([part for poke in seen.values() for part in (poke.force, gap)])
    names = np.concatenate([np.full(len(poke.t) + 1, grid.name(index)) for index, poke in seen.items()])
    figure = go.Figure(
        go.Scattergl(
            x=np.round(t, 3),
            y=force,
            text=names,
            mode="lines",
            line={"color": BLUE, "width": 0.8},
            opacity=0.5,
            hovertemplate="%{text}: %{y:.3g} N<extra></extra>",
        )
    )
    finish(figure, 420)
    figure.update_layout(hovermode="closest")
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text="normal force [N]")
    return figure
