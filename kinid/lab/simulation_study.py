"""The simulation study: a contact whose stiffness and damping drift, followed by forgetting of several kinds.

Depth 21 mm ± 12 mm at 2 Hz ± 3 mm at 5 Hz, K = 100 + 10 t N/m and B = 10 + t N·s/m at 1 kHz, with noise 40 dB below the
force. As published it lasts 2 s; what a schedule does is seen only after its end.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators import (
    Constant,
    Forgetting,
    HuntCrossleyKalman,
    KelvinVoigt,
    Scheduled,
    SingleStage,
    Track,
    TwoStage,
)
from kinid.estimators.hunt_crossley import force as hunt_crossley
from kinid.estimators.kelvin_voigt import force as kelvin_voigt
from kinid.writers import finite, make_folder, write_json, write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Array = NDArray[np.float64]

#: ends of the stretches that errors are told of [s]; what comes before 0.3 s is the start
STRETCHES = (0.3, 2.0, 3.0, 5.0, 10.0, 60.0)
#: of the power law
EXPONENT = 1.2
#: force over noise, in rms
SNR = 100.0
#: share of each value that a valid estimate is asked to be known to
ASKED = 0.02
_ALL = (ASKED, ASKED, ASKED)
#: what is tried: forgetting of Kelvin-Voigt and of Hunt-Crossley in one stage
SCHEDULES: dict[str, Forgetting] = {
    "β = 0.98": Constant(0.98),
    "published schedule": Scheduled(5.0, 2.0),
    "schedule, memory 50": Scheduled(5.0, 0.0, 0.02, memory=50.0),
    "schedule, memory 100": Scheduled(5.0, 2.0, memory=100.0),
}


class Row(NamedTuple):
    """Errors of a method over a stretch of time, in parts of the truth.

    Attributes:
        method: estimator and forgetting. start, end: of the stretch [s]. force: largest error over the force's rms.
        stiffness, damping, exponent: rms errors; NaN for an exponent that there is not.
        valid: share of the samples at which the estimate is called valid, where `ASKED` is asked of it. right: share of
            these at which all of its values are within that; NaN where none is.
    """

    method: str
    start: float
    end: float
    force: float
    stiffness: float
    damping: float
    exponent: float
    valid: float
    right: float


class Run(NamedTuple):
    """A method's track and its force error over the force's rms, (n,)."""

    method: str
    track: Track
    error: Array


def simulate(seconds: float = 60.0, seed: int = 0) -> tuple[list[Run], list[Row]]:
    """Follow the drifting contact with every method.

    Args:
        seconds: how long. seed: of the noise.

    Raises:
        InputError: less than 2 s.
    """
    if not 2.0 <= seconds <= 3600.0:
        raise InputError(f"a simulation of {seconds} s", "2 to 3600 s", "use 60")
    t = np.arange(0.0, seconds, 1e-3)
    slow, fast = 2 * np.pi * 2.0, 2 * np.pi * 5.0
    x = 0.012 * np.sin(slow * t) + 0.003 * np.sin(fast * t) + 0.021
    v = 0.012 * slow * np.cos(slow * t) + 0.003 * fast * np.cos(fast * t)
    truth = np.column_stack([100.0 + 10.0 * t, 10.0 + t, np.full(len(t), EXPONENT)])
    runs, rows = [], []
    for law in ("Kelvin-Voigt", "Hunt-Crossley"):
        linear = law == "Kelvin-Voigt"
        clean = kelvin_voigt(x, v, *truth.T[:2]) if linear else hunt_crossley(x, v, *truth.T)
        # of the published two seconds: noise doesn't grow with the material
        sigma = float(np.sqrt(np.mean(clean[:2000] ** 2))) / SNR
        y = clean + sigma * np.random.default_rng(seed).normal(size=len(t))
        tracks = {
            f"{law}, {name}": (
                KelvinVoigt(rule, accuracy=(ASKED, ASKED))
                if linear
                else SingleStage(noise=sigma, forgetting=rule, accuracy=_ALL)
            ).run(x, v, y, t)
            for name, rule in SCHEDULES.items()
        }
        if not linear:
            others = {
                "K grows, memory 500": SingleStage(
                    noise=sigma, forgetting=Constant(1.0 - 1.0 / 500.0), growth=0.2, accuracy=_ALL
                ),
                "two stages, β = 0.98": TwoStage(noise=sigma, forgetting=Constant(0.98), accuracy=_ALL),
                "Kalman filter, values walk": HuntCrossleyKalman(
                    noise=sigma, walk=(0.05, 0.02, 0.0, 0.0), surface=1e-6, accuracy=_ALL
                ),
            }
            tracks |= {f"{law}, {name}": estimator.run(x, v, y, t) for name, estimator in others.items()}
        for name, track in tracks.items():
            p = track.theta.T
            said = kelvin_voigt(x, v, p[0], p[1]) if linear else hunt_crossley(x, v, p[0], p[1], p[2])
            runs.append(Run(name, track, np.abs(said - clean)))
            rows += _rows(name, t, track, truth, np.abs(said - clean), clean)
    return runs, rows


def _rows(name: str, t: Array, track: Track, truth: Array, error: Array, clean: Array) -> list[Row]:
    """A row for each stretch."""
    out = []
    p = min(3, len(track.names))
    off = track.theta[:, :p] / truth[:, :p] - 1.0
    right = np.all(np.abs(off) <= ASKED, axis=1)
    for start, end in zip(STRETCHES, STRETCHES[1:]):
        part = (t >= start) & (t < end)
        if not part.any():
            continue
        stands = part & track.valid
        size = float(np.sqrt(np.mean(clean[part] ** 2)))
        k, b, n = [*np.sqrt(np.mean(off[part] ** 2, axis=0)).tolist(), float("nan")][:3]
        valid, true = float(stands.sum() / part.sum()), float(right[stands].mean()) if stands.any() else float("nan")
        out.append(Row(name, start, min(end, float(t[-1])), float(error[part].max()) / size, k, b, n, valid, true))
    return out


def figure(runs: list[Run]) -> Figure:
    """Stiffness over time by every method, and the truth."""
    from plotly.graph_objects import Figure

    out = Figure()
    rows = slice(0, None, 50)
    for run in runs:
        t = run.track.t
        assert t is not None
        out.add_scatter(x=t[rows], y=run.track["stiffness"][rows], name=run.method, mode="lines")
    assert t is not None
    out.add_scatter(x=t[rows], y=100.0 + 10.0 * t[rows], name="true", mode="lines", line={"color": "#000000"})
    out.update_layout(height=460, xaxis_title="time [s]", yaxis_title="stiffness [N/m, N/mⁿ]")
    return out


def write(folder: Path, runs: list[Run], rows: list[Row]) -> tuple[Path, Path]:
    """Write `simulation.json` and `simulation.html` into a folder; their paths."""
    from kinid.reports.render import render

    make_folder(folder)
    facts, drawn = folder / "simulation.json", folder / "simulation.html"
    whole = [{k: v if isinstance(v, str) else finite(v) for k, v in row._asdict().items()} for row in rows]
    write_json(facts, whole)
    said = "K = 100 + 10 t N/m, B = 10 + t N·s/m; noise 40 dB below the force of the first two seconds."
    shown = [("Stiffness as it was followed", figure(runs))]
    write_text(drawn, render("figures.html", "Forgetting on a drifting contact", facts=said, figures=shown))
    return facts, drawn
