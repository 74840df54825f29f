"""Teleoperation with delay on a material of the laboratory: poked first, so that a map of it can be reflected.

The slave's material is poked in the virtual laboratory and fitted as a user would; what that fit says is the map. Then
direct force reflection, impedance reflection from that map, and direct reflection behind passivity controllers are held
side by side: `kinid.controllers.teleoperator` has the equations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.controllers.teleoperation import Study, measured_impedance, study, transparency_error
from kinid.controllers.teleoperator import LINEAR, Environment, Teleoperator
from kinid.errors import InputError
from kinid.lab import materials
from kinid.lab.experiments import SILICONE_POKE, prepare
from kinid.lab.materials import Material
from kinid.lab.protocol import five_phases
from kinid.lab.teleoperation_study import Outcome, bound_cells, bound_figure, cells, facts, yielded
from kinid.reports.plots import BLUE, GREEN, GREY, ORANGE, VERMILION
from kinid.reports.render import render
from kinid.writers import make_folder, write_json, write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

DELAYS = (0.05, 0.1, 0.2, 0.4)
#: frequencies at which the formulas are held against simulations [Hz]
CHECKED = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
#: frequencies of the curves
POINTS = 80
#: how wrong a map is whose cost is shown, beside the one that was measured
MISTAKEN = 1.2
_LOOK = {
    "direct": ("direct force reflection", VERMILION),
    "impedance": ("impedance reflection from the map", BLUE),
    "passivated": ("direct, observer and damper", ORANGE),
    "tank": ("direct, energy tank", GREEN),
}


@dataclass(frozen=True, eq=False)
class Comparison:
    """What was poked, what is believed of it, and the study.

    Attributes:
        material: its name. truth, believed: as it is, and as the fit to its poke says. study: see `kinid.controllers`.
        measured: Z_t by simulation at `CHECKED`, by delay and linear method. mistaken: error of reflection from a map
            that is `MISTAKEN` times too stiff and too damped. place: along both tangents [m]. map_source: by what the
            map is known.
    """

    material: str
    truth: Environment
    believed: Environment
    study: Study
    measured: dict[tuple[float, str], NDArray[np.complex128]]
    mistaken: float
    place: tuple[float, float] = (0.0, 0.0)
    map_source: str = "a fit to one virtual poke"

    def to_dict(self) -> dict[str, object]:
        """The facts, for JSON."""
        names = ("delay", "method", "stable", "stable_by_nyquist", "transparency_error")
        rows = [dict(zip(names, row)) for row in self.study.rows]
        return {
            "material": self.material,
            "place": self.place,
            "map_by": self.map_source,
            "true": dataclasses.asdict(self.truth),
            "map": dataclasses.asdict(self.believed),
            "unit": {"delay": "s, one-way", "stiffness": "N/m", "damping": "N·s/m"},
            "cases": rows,
            f"transparency_error_of_a_map_{MISTAKEN:g}_times_too_hard": self.mistaken,
        }


def at_place(material: Material, x: float, y: float, depth: float = SILICONE_POKE.depth) -> Environment:
    """A material at a place [m], linearised by its secant at a depth [m]: what a spring and a damper can say of it."""
    here = material.at(np.array([x]), np.array([y]))
    force = float(material.press(np.array([x]), np.array([y]), np.array([depth]))[0])
    return Environment(force / depth, float(here["damping"][0]) + material.loss * force)


def believed_of(path: Path, x: float, y: float) -> Environment:
    """What a measured map says of a place.

    Raises:
        InputError: no map there, or a place that it doesn't know.
    """
    from kinid.controllers.measured import Measured
    from kinid.mapping.property_map import PropertyMap

    return Environment.at(Measured(PropertyMap.read(path), unknown="refuse"), x, y, SILICONE_POKE.depth)


def poked(material: str, seed: int, place: tuple[float, float] = (0.0, 0.0)) -> Environment:
    """What a fit to the log of a virtual poke says of a material at a place along both tangents [m].

    Raises:
        InputError: no such material, or a place beside it.
    """
    from kinid.contact.series import contact_series
    from kinid.identification.fit import fit_model
    from kinid.modeling.model import Model

    setup = prepare("poke", material=material, seed=seed).replace(script=five_phases(SILICONE_POKE, place=place))
    touch = contact_series(setup.run().log, setup.rig)
    assert touch.phase is not None
    # without the retraction: the material lets go where the equation of Kelvin-Voigt would pull
    fit = fit_model(
        Model("kelvin-voigt", "sensor-bias"),
        touch,
        channels=("normal_force",),
        train=touch.phase != "retract",
        held_out=False,
    )
    return Environment(fit["stiffness"].value, max(0.0, fit["damping"].value))


def compare(
    material: str = "ecoflex-50",
    seed: int = 0,
    delays: Sequence[float] = DELAYS,
    measured_map: Path | None = None,
    place: tuple[float, float] = (0.0, 0.0),
) -> Comparison:
    """Poke and fit, or look a measured map up, and run the study.

    Args:
        material: of the laboratory; linearised at the place. seed: of the poke's sensor. delays: one-way [s].
        measured_map: what `kinid map` wrote; default: the place is poked. place: along both tangents [m].

    Raises:
        InputError: see `poked`, `believed_of` and `kinid.controllers.study`.
    """
    cases = [Teleoperator(delay=float(delay)) for delay in delays]  # refused before anything runs
    chosen = materials.material(material)
    if not max(abs(place[0]), abs(place[1])) <= chosen.side / 2:
        raise InputError(
            f"a place ({1e3 * place[0]:g}, {1e3 * place[1]:g}) mm, beside the {material}",
            f"one within ±{500 * chosen.side:g} mm",
            "choose another",
        )
    truth = at_place(chosen, *place)
    believed = poked(material, seed, place) if measured_map is None else believed_of(measured_map, *place)
    found = study(truth, believed, delays, points=POINTS)
    measured = {
        (o.delay, method): measured_impedance(o, truth, CHECKED, method, believed)
        for o in cases
        for method in ("direct", "impedance")
    }
    hard = Environment(MISTAKEN * truth.stiffness, MISTAKEN * truth.damping)
    error = transparency_error(hard.impedance(found.frequency), found.environment)
    map_source = "a fit to one virtual poke" if measured_map is None else measured_map.name
    return Comparison(material, truth, believed, found, measured, error, place, map_source)


def write(folder: Path, comparison: Comparison, found: Outcome) -> Path:
    """Write `teleoperation.json` and the page `teleoperation.html` into a folder; the page's path."""
    make_folder(folder)
    write_json(folder / "teleoperation.json", comparison.to_dict() | {"study": facts(found)})
    write_text(folder / "teleoperation.html", comparison_page(comparison, found))
    return folder / "teleoperation.html"


def comparison_page(c: Comparison, found: Outcome) -> str:
    """Transparency and stability as one self-contained HTML page."""
    return render(
        "teleoperation.html",
        "Teleoperation with delay",
        c=c,
        mistaken=MISTAKEN,
        words={True: "yes", False: "no", None: "–"},
        shown_as=_LOOK,
        figures=[
            ("Transparency: impedance that the operator feels, and the environment's", transparency_figure(c)),
            ("Stability: a push of 10 mm, held", stability_figure(c)),
        ],
        lines=[(line, *cells(found, line)) for line in dict.fromkeys(each.line for each in found.cases)],
        bounds=bound_cells(found),
        yielded=", ".join(
            f"{100 * yielded(k):.0f} % of {k:g} N/m" for k in dict.fromkeys(e.stiffness for e in found.cases)
        ),
        bound_figure=bound_figure(found),
    )


def transparency_figure(c: Comparison) -> Figure:
    """Transmitted and environment's impedance over frequency, one column a delay; dots are simulations of the
    formulas.
    """
    figure, delays = _columns(c, ("|Z| [N·s/m]", "phase [°]", "|Z / Z environment − 1|"), 720)
    frequency, true = c.study.frequency, c.study.environment
    for column, delay in enumerate(delays, start=1):
        _impedance(figure, column, frequency, true, true, ("environment", "#9ca3af"), 7.0)
        for method in ("direct", "passivated", "tank", "impedance"):
            _impedance(figure, column, frequency, c.study.transmitted[delay, method], true, _LOOK[method], 1.7)
            if method in LINEAR:
                at = np.array(CHECKED)
                _impedance(figure, column, at, c.measured[delay, method], c.truth.impedance(at), _LOOK[method], None)
    figure.update_xaxes(type="log", tickvals=[0.2, 0.5, 1, 2, 5], range=[np.log10(0.18), np.log10(9.0)])
    figure.update_yaxes(type="log", range=[0.6, 3.1], tickvals=[10, 100, 1000], row=1)
    figure.update_yaxes(tickvals=[-180, -90, 0, 90, 180], range=[-190, 190], row=2)
    figure.update_yaxes(range=[-0.1, 2.6], row=3)
    figure.update_xaxes(title_text="frequency [Hz]", row=3)
    return figure


def stability_figure(c: Comparison) -> Figure:
    """Place of the master and the force felt over time, one column a delay."""
    figure, delays = _columns(c, ("master [mm]", "force felt [N]"), 520)
    for column, delay in enumerate(delays, start=1):
        for method in ("direct", "passivated", "tank", "impedance"):
            name, colour = _LOOK[method]
            motion = c.study.motions[delay, method]
            rows = slice(0, None, 4)
            for row, values in ((1, 1e3 * motion.master), (2, motion.force)):
                drawn = {"x": motion.t[rows], "y": np.round(values[rows], 3), "line": {"color": colour, "width": 1.3}}
                _line(figure, name, row, column, drawn, legend=row == 1)
        look = {"color": GREY, "width": 1.2, "dash": "dot"}
        drawn = {"x": motion.t[::100], "y": 1e3 * motion.intended[::100], "line": look}
        _line(figure, "intended", 1, column, drawn, legend=True)
    figure.update_xaxes(title_text="time [s]", row=2)
    figure.update_xaxes(range=[0, 8])
    figure.update_yaxes(range=[-8, 16], row=1)
    figure.update_yaxes(range=[-0.5, 16], row=2)
    return figure


def _line(figure: Figure, name: str, row: int, column: int, drawn: dict[str, object], legend: bool) -> None:
    """Drawn in one place of a figure; in its legend once for all columns."""
    shown = legend and column == 1
    figure.add_scatter(**{"mode": "lines", **drawn}, name=name, legendgroup=name, showlegend=shown, row=row, col=column)


def _columns(c: Comparison, labels: tuple[str, ...], height: int) -> tuple[Figure, list[float]]:
    """An empty figure with a column a delay, and the delays."""
    from plotly.subplots import make_subplots

    delays = list(dict.fromkeys(row.delay for row in c.study.rows))
    figure = make_subplots(
        rows=len(labels),
        cols=len(delays),
        shared_xaxes=True,
        shared_yaxes=True,
        vertical_spacing=0.05,
        horizontal_spacing=0.02,
        column_titles=[f"{1e3 * delay:.0f} ms" for delay in delays],
    )
    for row, label in enumerate(labels, start=1):
        figure.update_yaxes(title_text=label, row=row, col=1)
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 20, "t": 60, "b": 90},
        legend={"orientation": "h", "y": -60 / (height - 150), "yanchor": "top", "x": 0},
    )
    return figure, delays


def _impedance(
    figure: Figure,
    column: int,
    frequency: Array,
    z: NDArray[np.complex128],
    true: NDArray[np.complex128],
    look: tuple[str, str],
    width: float | None,
) -> None:
    """Size, phase, and distance from the true one; a line of some width, or dots."""
    (name, colour), line = look, width is not None
    phase = np.degrees(np.angle(z))
    if line:  # a phase that wraps is no line from bottom to top
        phase = np.where(np.abs(np.diff(phase, prepend=phase[0])) > 180, np.nan, phase)
    for row, values in ((1, np.abs(z)), (2, phase), (3, np.abs(z / true - 1.0))):
        drawn = {"x": frequency, "y": values, "line": {"color": colour, "width": width or 1.0}}
        drawn |= {"mode": "lines" if line else "markers", "marker": {"color": colour, "size": 6}}
        _line(figure, name, row, column, drawn, legend=line and row == 1)
