"""Pictures of a plan: what the joints use of their limits, the tip, and the expected force; one offline HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.planning.trajectory import Trajectory
from kinid.reports.plots import AXES, BLUE, GREY, ORANGE, VERMILION, finish, stacked, thin
from kinid.reports.render import render

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

#: one colour a joint, of Okabe and Ito
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#6b7280")


def plan_page(motion: Trajectory, title: str) -> str:
    """The whole plan as one self-contained HTML page."""
    known = motion.normal_force is not None and bool(np.nan_to_num(motion.normal_force).any())
    name = "Tip, base frame" if motion.place is None else "Depth and expected force" if known else "Depth"
    figures = [(name, tip_figure(motion))]
    if motion.touch is not None and int(motion.touch.max()) > 0 and motion.place is not None:
        figures.append(("Places, in the order of the touches", places_figure(motion)))
    figures.append(("Joints, shares of their limits", joints_figure(motion)))
    return render(
        "plan.html",
        title,
        motion=motion,
        touches=0 if motion.touch is None else int(motion.touch.max()) + 1,
        facts=motion.provenance,
        why=str((motion.provenance.get("discrimination") or {}).get("words", "")),
        figures=figures,
    )


def tip_figure(motion: Trajectory) -> Figure:
    """Depth, normal force and its guard over time; position where there is no surface."""
    lead = motion.tip[:, 2] if motion.place is None else motion.place[:, 2]
    rows: list[tuple[str, list[tuple[str, Array, str]]]] = []
    if motion.place is not None:
        rows.append(("depth [mm]", [("depth", 1e3 * motion.place[:, 2], BLUE)]))
        if np.ptp(motion.place[:, :2], axis=0).max() > 1e-6:  # else rounding
            rows.append(
                (
                    "slip [mm]",
                    [
                        ("along tangent 1", 1e3 * motion.place[:, 0], AXES[0]),
                        ("along tangent 2", 1e3 * motion.place[:, 1], AXES[1]),
                    ],
                )
            )
    else:
        rows.append(("position [m]", [("xyz"[k], motion.tip[:, k], AXES[k]) for k in range(3)]))
    if motion.normal_force is not None and np.nan_to_num(motion.normal_force).any() and motion.place is not None:
        force = [("expected normal force", motion.normal_force, VERMILION)]
        if motion.force_limit is not None and np.isfinite(motion.force_limit).any():
            force.append(("limit", np.where(np.isfinite(motion.force_limit), motion.force_limit, np.nan), GREY))
        rows.append(("force [N]", force))
    figure = stacked(motion.t, rows, (lead,), height=200, legend=True)
    _phases(figure, motion)
    return figure


def joints_figure(motion: Trajectory) -> Figure:
    """Position, velocity, acceleration of every joint as shares of its limits; in rad where the limits aren't known."""
    limits = motion.provenance.get("limits")
    each = [("position", motion.q), ("velocity", motion.dq), ("acceleration", motion.ddq)]
    if limits:
        low, high = (np.asarray(limits[side]) for side in ("lower", "upper"))
        with np.errstate(invalid="ignore"):  # a joint that turns on and on has no limits
            shares = [(motion.q - 0.5 * (low + high)) / (0.5 * (high - low))]
        shares += [values / np.asarray(limits[name]) for name, values in each[1:]]
        each = [(name, share) for (name, _), share in zip(each, shares)]
    colours = [COLOURS[j % len(COLOURS)] for j in range(len(motion.joint_names))]
    rows = [
        (f"{name} [{'of limit' if limits else 'rad, s'}]", list(zip(motion.joint_names, values.T, colours)))
        for name, values in each
    ]
    fastest = int(np.abs(motion.dq).max(axis=0).argmax())
    return stacked(motion.t, rows, (motion.dq[:, fastest],), legend=True)


def places_figure(motion: Trajectory) -> Figure:
    """Where the tip goes along the surface, and where it touches."""
    import plotly.graph_objects as go

    assert motion.place is not None
    keep = thin(len(motion), motion.place[:, 0], motion.place[:, 1])
    inside = keep[motion.place[keep, 2] > 0]
    figure = go.Figure()
    figure.add_scatter(
        x=1e3 * motion.place[keep, 0],
        y=1e3 * motion.place[keep, 1],
        mode="lines",
        name="in the air",
        line={"color": GREY, "width": 1},
    )
    figure.add_scatter(
        x=1e3 * motion.place[inside, 0],
        y=1e3 * motion.place[inside, 1],
        mode="markers",
        name="in the material",
        marker={"color": ORANGE, "size": 6},
    )
    figure.update_xaxes(title_text="along tangent 1 [mm]")
    figure.update_yaxes(title_text="along tangent 2 [mm]", scaleanchor="x")
    finish(figure, 520)
    figure.update_layout(hovermode="closest")
    return figure


def _phases(figure: Figure, motion: Trajectory) -> None:
    """Names of the phases above the first row, where there are few enough to read."""
    starts = np.flatnonzero(np.append(True, motion.phase[1:] != motion.phase[:-1]))
    if len(starts) > 12:
        return
    ends = np.append(starts[1:], len(motion))
    for k, (a, b) in enumerate(zip(starts.tolist(), ends.tolist())):
        x0, x1 = float(motion.t[a]), float(motion.t[b - 1])
        figure.add_vrect(
            x0=x0, x1=x1, fillcolor=ORANGE if k % 2 else BLUE, opacity=0.06, line_width=0, row="all", col=1
        )
        figure.add_annotation(
            x=0.5 * (x0 + x1),
            y=1.0,
            yref="y domain",
            yanchor="top",
            text=str(motion.phase[a]),
            showarrow=False,
            font={"size": 11, "color": GREY},
            textangle=-90 if x1 - x0 < 0.12 * motion.duration else 0,
        )
