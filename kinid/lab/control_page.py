"""The study of force control on screen's terms: its table, its JSON, and one page with figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinid.lab.control_study import CONSTANT, FED, MAP, MARGINS, ONLINE, SILICONES, Design, Outcome
from kinid.lab.force_jobs import TASKS
from kinid.lab.loop_margins import Margins
from kinid.reports.plots import BLUE, GREY, ORANGE, VERMILION
from kinid.reports.render import render
from kinid.writers import Json, finite, make_folder, write_json, write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_LOOK = {CONSTANT: VERMILION, FED: ORANGE, ONLINE: "#CC79A7", MAP: BLUE}
#: every so many control periods are drawn; and of each task, from when to when [s]
_EVERY, _SHOWN = 10, {TASKS[0]: (0.7, 2.0), TASKS[1]: (0.9, 3.6), TASKS[2]: (0.9, 11.0)}
#: names of how many times less an error is: of all jobs, and of those where the map's model holds
GAINS = ("task", "error_share", "error_beyond_reference", "error_share_held", "error_beyond_reference_held")
_UNITS = {
    "bandwidth": "rad/s",
    "gain_margin": "1",
    "phase_margin": "rad",
    "error": "N",
    "error_share": "of the wanted force",
    "error_beyond_reference": "of the wanted force",
    "overshoot": "of the step",
}


def facts(found: Outcome) -> Json:
    """For JSON."""
    designs = [
        {"controller": d.controller, "bandwidth": d.bandwidth, "designed": _margins(d.designed), "met": _margins(d.met)}
        for d in found.designs
    ]
    names = ("task", "controller", "error", "error_share", "error_beyond_reference", "overshoot")
    runs = [
        {
            "task": task,
            "controller": controller,
            "job": run.job.name,
            "model_holds": found.holds(run.job),
            "error": run.error(),
            "error_beyond_reference": run.error(reference=True),
            "overshoot": run.overshoot,
        }
        for (task, controller), courses in found.courses.items()
        for run in courses
    ]
    return {
        "map_by": found.map_source,
        "probes": len(found.grown),
        "silicones": [{"stiffness": s.stiffness, "damping": s.damping} for s in SILICONES],
        "margins_asked": _margins(MARGINS),
        "online_interval": {"stiffness": found.interval[0], "damping": found.interval[1]},
        "unit": _UNITS,
        "controllers": designs,
        "tasks": [dict(zip(names, score)) for score in found.scores],
        "error_falls_by": [dict(zip(GAINS, gains)) for gains in falls(found)],
        "runs": runs,
    }


def falls(found: Outcome) -> list[tuple[str, float, float, float | None, float | None]]:
    """Of each task how many times less the error is with the map, see `GAINS`; None where its model holds nowhere."""
    out = []
    for task in TASKS:
        held, far = (finite(found.gain(task, beyond, holding=True)) for beyond in (False, True))
        out.append((task, found.gain(task), found.gain(task, beyond=True), held, far))
    return out


def _margins(of: Margins) -> Json:
    return {"gain_margin": of.gain, "phase_margin": of.phase}


def design_cells(row: Design) -> tuple[str, ...]:
    """Of the table of margins: controller, ω [rad/s], designed and met in fact."""
    return row.controller, f"{row.bandwidth:.1f}", str(row.designed), str(row.met)


def write(folder: Path, found: Outcome) -> list[Path]:
    """Write `control.json`, the map `map.parquet` and the page `control.html` into a folder; their paths."""
    make_folder(folder)
    paths = [folder / "control.json", folder / "map.parquet", folder / "control.html"]
    write_json(paths[0], facts(found))
    found.grown.write(paths[1])
    page = render(
        "control.html",
        "Force control with a map",
        found=found,
        asked=MARGINS,
        falls=falls(found),
        designs=[design_cells(row) for row in found.designs],
        figures=[(task, force_figure(found, task)) for task in TASKS],
    )
    write_text(paths[2], page)
    return paths


def force_figure(found: Outcome, task: str) -> Figure:
    """Force over time of a task, a row a job; a line a controller."""
    from plotly.subplots import make_subplots

    runs = {name: found.courses[task, name] for name in _LOOK if (task, name) in found.courses}
    titles = [run.job.name for run in next(iter(runs.values()))]
    figure = make_subplots(rows=len(titles), cols=1, shared_xaxes=True, subplot_titles=titles, vertical_spacing=0.04)
    low, high = _SHOWN[task]
    for row in range(1, len(titles) + 1):
        job = next(iter(runs.values()))[row - 1].job
        t = np.arange(len(job.wanted)) * job.period
        part = np.flatnonzero((t >= low) & (t <= high))[::_EVERY]
        look = {"color": GREY, "dash": "dot", "width": 1.5}
        drawn = [("wanted", job.wanted, look)]
        drawn += [(name, of[row - 1].force, {"color": _LOOK[name], "width": 1.5}) for name, of in runs.items()]
        for name, values, line in drawn:
            figure.add_scatter(
                x=np.round(t[part], 3),
                y=np.round(values[part], 3),
                name=name,
                line=line,
                legendgroup=name,
                showlegend=row == 1,
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text="force [N]", row=row)
    figure.update_xaxes(title_text="time [s]", row=len(titles))
    height = 120 + 190 * len(titles)
    legend = {"orientation": "h", "y": -60 / (height - 150), "yanchor": "top", "x": 0}
    margin = {"l": 70, "r": 20, "t": 40, "b": 90}
    figure.update_layout(template="plotly_white", height=height, margin=margin, legend=legend)
    return figure
