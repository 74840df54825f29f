"""Four slides over the mould, and the borders between its silicones that are found along them.

Slides 1 and 2 go along tangent1, through the lower and the upper pair of quarters; 3 and 4 along tangent2. Borders wind
and blend over 2 mm, and a film covers a part of the last quarter, so that slides 2 and 4 cross its edge, too. What is
found is what `kinid changes` finds in the written log; the truth alone says where borders are: where the force of a
slow press changes most from place to place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.lab.experiments import prepare
from kinid.lab.materials import Material
from kinid.lab.protocol import Slide, five_phases
from kinid.lab.setup import Setup
from kinid.lab.writing import write_log, write_rig
from kinid.mapping.changes import Leg, find_changes, legs
from kinid.reports.plots import BLUE, GREY, ORANGE, VERMILION
from kinid.writers import Json, finite, make_folder, write_json, write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

#: where each slide begins, along both tangents [m], and which of them it follows
WAYS = (((-0.006, -0.022), 0), ((-0.006, 0.022), 0), ((-0.022, -0.006), 1), ((0.022, -0.006), 1))
#: to both sides of that [m], depth [m] and speed [m/s]
REACH, DEPTH, SPEED = 0.022, 2.5e-3, 6e-3
#: steps in which the truth is looked through [m]; change of force with place over mean force from which on there is a
#: border [1/m]
FINE, STEEP = 1e-5, 30.0
#: a border that is found belongs to the nearest true one within so much [m]
SAME = 2e-3


class Crossing(NamedTuple):
    """A border that a leg of a slide crossed, or that was found there.

    Attributes:
        slide: from 1. leg: of the slide, from 1. true, found: place along the slide's tangent [m], NaN where it is only
            found or only there. sd: standard deviation of the place that was found [m].
    """

    slide: int
    leg: int
    true: float
    found: float
    sd: float

    @property
    def error(self) -> float:
        """[m]"""
        return self.found - self.true


@dataclass(frozen=True, eq=False)
class Ride:
    """One slide.

    Attributes:
        number: from 1. axis: of the tangents, 0 or 1. log: what was recorded. setup: how. legs: its straight stretches.
        crossings: borders that they cross. borders: where they are along the way [m], in truth.
    """

    number: int
    axis: int
    log: Log
    setup: Setup
    legs: tuple[Leg, ...]
    crossings: tuple[Crossing, ...]
    borders: Array


def study(seed: int = 0, progress: Callable[[int], None] = lambda _: None) -> list[Ride]:
    """Slide over the mould four times and find the borders.

    Args:
        seed: of sensor faults and noise. progress: called with the number of each slide as it begins.
    """
    rides = []
    for number, (place, axis) in enumerate(WAYS, start=1):
        progress(number)
        slide = Slide(depth=DEPTH, speed=SPEED, length=REACH, directions=(axis * np.pi / 2,))
        base = prepare("slide", material="mould", seed=seed)
        setup = replace(base, script=five_phases(slide, place=place), seed=10 * seed + number)
        rides.append(_ride(number, setup, np.asarray(place), axis))
    return rides


def true_borders(material: Material, place: Array, axis: int) -> Array:
    """Where along a tangent, on a way through `place` (2,), the force of a slow press changes most [m]."""
    along = place[axis] + np.arange(-REACH, REACH + FINE / 2, FINE)
    x, y = _on_way(place, axis, along).T
    force = material.press(x, y, np.full(len(along), DEPTH))
    steep = np.abs(np.gradient(force, along)) / force.mean()
    return np.asarray(along[find_peaks(steep, height=STEEP)[0]])


def _on_way(place: Array, axis: int, along: Array) -> Array:
    """Places on the way through one along a tangent, (n, 2) [m]."""
    out = np.tile(place, (len(along), 1))
    out[:, axis] = along
    return out


def _ride(number: int, setup: Setup, place: Array, axis: int) -> Ride:
    log = setup.run().log
    touch = contact_series(log, setup.rig, robot=setup.robot)
    found, stretches = [change for change in find_changes(touch) if not change.doubt], legs(touch)
    borders = true_borders(setup.material, place, axis)
    crossings: list[Crossing] = []
    for k, leg in enumerate(stretches, start=1):
        seen = {float(c.place[axis]): c.sd for c in found if leg.t[0] <= c.t <= leg.t[-1]}
        crossed = [leg.crosses(border) for border in _on_way(place, axis, borders)]
        crossings += [Crossing(number, k, *pair) for pair in _matched(borders, crossed, seen)]
    return Ride(number, axis, log, setup, tuple(stretches), tuple(crossings), borders)


def _matched(borders: Array, crossed: list[bool], found: dict[float, float]) -> list[tuple[float, float, float]]:
    """Each border that a leg crosses with the place found nearest to it and its standard deviation, and those found
    where none is.
    """
    out, left = [], dict(found)
    for border, is_crossed in zip(borders.tolist(), crossed):
        near = min(left, key=lambda place: abs(place - border), default=np.inf)
        if abs(near - border) <= SAME:
            out.append((border, near, left.pop(near)))
        elif is_crossed:
            out.append((border, np.nan, np.nan))
    return out + [(np.nan, place, sd) for place, sd in left.items()]


def figure(ride: Ride) -> Figure:
    """Force over depth along a slide, there and back, with the borders that were found and those that are."""
    from plotly.graph_objects import Figure

    out = Figure()
    way = np.eye(2)[ride.axis]
    for number, (leg, color) in enumerate(zip(ride.legs, (BLUE, ORANGE, GREY)), start=1):
        along = 1e3 * (leg.start @ way + leg.x * (leg.direction @ way))
        ahead = "+" if leg.direction @ way > 0 else "−"
        out.add_scatter(x=along, y=leg.felt[0], name=f"leg {number}, to {ahead}", line_color=color)
    for border in 1e3 * ride.borders:
        out.add_vline(x=border, line={"color": "#000000", "dash": "dash", "width": 1})
    for c in ride.crossings:
        if np.isfinite(c.found):
            low, high = (1e3 * (c.found + sign * 1.96 * c.sd) for sign in (-1, 1))
            out.add_vrect(x0=low, x1=high, fillcolor=VERMILION, opacity=0.2, line_width=0)
    out.update_layout(
        height=300,
        margin={"t": 20},
        xaxis_title=f"slip along tangent{ride.axis + 1} [mm]",
        yaxis_title="force over depth [N/m]",
    )
    return out


def facts(rides: list[Ride]) -> list[Json]:
    """Every crossing, for JSON."""
    names = Crossing._fields + ("error",)
    every = [{name: getattr(c, name) for name in names} for ride in rides for c in ride.crossings]
    return [{k: finite(v) for k, v in one.items()} for one in every]


def said(rides: list[Ride]) -> str:
    """How many borders were crossed, found, and found where none is, and how far off, in one sentence."""
    every = [c for ride in rides for c in ride.crossings]
    both = [c for c in every if np.isfinite(c.error)]
    crossed, false = sum(np.isfinite(c.true) for c in every), sum(not np.isfinite(c.true) for c in every)
    errors = 1e3 * np.array([c.error for c in both] or [np.nan])
    return (
        f"{len(both)} of {crossed} crossings found, {false or 'none'} where no border is; "
        f"{np.sqrt(np.mean(errors**2)):.2f} mm rms, {np.max(np.abs(errors)):.2f} mm at most"
    )


def write(folder: Path, rides: list[Ride]) -> tuple[Path, Path]:
    """Write each slide's log with the rig, `slides.json` and `slides.html` into a folder; the latter two's paths."""
    from kinid.reports.render import render

    make_folder(folder)
    write_rig(folder, rides[0].setup)
    for ride in rides:
        write_log(folder / f"slide_{ride.number}.parquet", ride.log)
    table, page = folder / "slides.json", folder / "slides.html"
    write_json(table, facts(rides))
    what = "Dashed: where the force of a slow press changes most, in truth. Bands: where a border was found, ± 95 %."
    shown = [(f"Slide {ride.number}", figure(ride)) for ride in rides]
    write_text(
        page, render("figures.html", "Four slides over four silicones", facts=f"{said(rides)}. {what}", figures=shown)
    )
    return table, page
