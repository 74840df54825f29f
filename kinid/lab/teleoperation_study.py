"""Teleoperation by every scheme: what the operator feels and how the slave follows, against delay, jitter and loss.

Each case is a push that turns and moves along, held, in six degrees of freedom
(`kinid.controllers.rigid_teleoperation`), and the transparency along the normal (`kinid.controllers.teleoperation`).
Beside it stands how hard a material each delay bears, by simulation and by theory. Controllers know neither the
material nor the hand; a map knows the material, 20 % off where that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kinid.controllers.packets import Network
from kinid.controllers.rigid_teleoperation import simulate_rigid
from kinid.controllers.teleoperation import BAND, measured_impedance, simulate, transparency_error
from kinid.controllers.teleoperator import Environment, Teleoperator
from kinid.lab import materials
from kinid.reports.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, finish
from kinid.writers import Json, finite

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

DELAYS = (0.0, 0.05, 0.1, 0.2, 0.4)
#: of Ecoflex 00-50, beside a place that direct reflection behind a plain damper fails on, and of Dragon Skin 30 [N/m]
STIFFNESSES = (732.0, 1853.0, 2400.0)
#: what the lines do beside delaying
IDEAL, LOSSY = "every packet, on time", "20 ms of jitter, 10 % lost in bursts of 3"
NETWORKS = {IDEAL: Network(), LOSSY: Network(jitter=0.02, loss=0.1, burst=3.0)}
#: error of a map whose cost is shown
MISTAKEN = 0.2
#: frequencies of a simulated curve, and of a formula's, which may have resonances
POINTS, FINER = 12, 400
#: stiffnesses between which a bound is looked for [N/m], steps of that, and how long is waited [s]
SOUGHT, STEPS, PATIENCE = (50.0, 20_000.0), 8, 40.0
#: what a damper without a spring may be [N·s/m]
PLAIN = Teleoperator().plain_damping


class Scheme(NamedTuple):
    """A method of `kinid.controllers.teleoperator.METHODS`, and what its map says over what is true."""

    name: str
    method: str
    share: float = 1.0


SCHEMES = (
    Scheme("direct force", "direct"),
    Scheme("observer and damper", "passivated"),
    Scheme("energy tank", "tank"),
    Scheme("wave variables", "wave"),
    Scheme("map", "impedance"),
    Scheme(f"map {100 * MISTAKEN:.0f} % too hard", "impedance", 1.0 + MISTAKEN),
    Scheme(f"map {100 * MISTAKEN:.0f} % too soft", "impedance", 1.0 - MISTAKEN),
)


class Case(NamedTuple):
    """One scheme on one line and material.

    Attributes:
        line: of `NETWORKS`. stiffness: true [N/m]. scheme: name. delay: one-way [s]. stable: comes to rest about all
        axes. transparency: rms of |Z_t − Z_e| / |Z_e| over the hand's band [1]. felt: stiffness felt at rest over the
        true one, less 1 [1]. tracking: way of the slave's tip from the master's, a delay before, rms [m]; NaN where
        there is no rest.
    """

    line: str
    stiffness: float
    scheme: str
    delay: float
    stable: bool
    transparency: float
    felt: float
    tracking: float


class Bound(NamedTuple):
    """The hardest material that a delay [s] bears, by simulation and by theory [N/m]; inf beyond `SOUGHT`."""

    scheme: str
    delay: float
    simulated: float
    theory: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of the study: cases, and bounds of direct reflection."""

    cases: list[Case]
    bounds: list[Bound]

    def case(self, line: str, stiffness: float, scheme: str, delay: float) -> Case:
        """One of them."""
        return next(c for c in self.cases if c[:4] == (line, stiffness, scheme, delay))


def environment(stiffness: float) -> Environment:
    """A silicone of a stiffness [N/m]: damping between those of the published ones."""
    known = (materials.ECOFLEX_30, materials.ECOFLEX, materials.DRAGON_SKIN, materials.DRAGON_SKIN_30)
    return Environment(stiffness, float(np.interp(stiffness, [m.stiffness for m in known], [m.damping for m in known])))


def case(line: str, stiffness: float, scheme: Scheme, delay: float) -> Case:
    """Push, and measure the transparency."""
    o, true = Teleoperator(delay=delay, network=NETWORKS[line]), environment(stiffness)
    image = Environment(scheme.share * true.stiffness, scheme.share * true.damping)
    motion = simulate_rigid(o, true, scheme.method, image)
    if scheme.method in ("wave", "impedance"):
        frequency = np.geomspace(*BAND, FINER)
        z_t = o.transmitted(true, frequency, scheme.method, image)
    else:
        frequency = np.array([rounded(f, o.period) for f in np.geomspace(*BAND, POINTS)])
        z_t = measured_impedance(o, true, list(frequency), scheme.method)
    error = transparency_error(z_t, true.impedance(frequency))
    felt, off = (motion.stiffness / stiffness - 1.0, motion.tracking(delay)) if motion.stable else (np.nan, np.nan)
    return Case(line, stiffness, scheme.name, delay, motion.stable, error, felt, off)


def rounded(frequency: float, period: float) -> float:
    """The frequency at which `measured_impedance` measures [Hz]: whole periods of samples."""
    return 1.0 / (max(8, round(1.0 / (frequency * period))) * period)


def bounds(delays: Sequence[float] = DELAYS) -> list[Bound]:
    """How hard a material each delay bears: direct, with a damper that the device bears, with one that is enough."""
    out = []
    for delay in delays:
        for name, method, damping in (
            ("direct force", "direct", 0.0),
            (f"observer, damper of {PLAIN:g} N·s/m", "passivated", PLAIN),
            ("observer, damper by the delay", "passivated", None),
        ):
            o = Teleoperator(delay=delay, most_damping=damping)
            out.append(Bound(name, delay, hardest(partial(_rests, o, method)), hardest(o.pays)))
    return out


def _rests(o: Teleoperator, method: str, touched: Environment) -> bool:
    return simulate(o, touched, method, duration=PATIENCE).stable


def hardest(bears: Callable[[Environment], bool]) -> float:
    """The greatest stiffness that is borne [N/m], by bisection within `SOUGHT`; inf where all of it is."""
    low, high = SOUGHT
    if bears(environment(high)):
        return np.inf
    for _ in range(STEPS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if bears(environment(middle)) else (low, middle)
    return low


def study(
    delays: Sequence[float] | None = None,
    stiffnesses: Sequence[float] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Outcome:
    """All schemes on all lines and materials.

    Args:
        delays: one-way [s]; default: `DELAYS`. stiffnesses: [N/m]; default: `STIFFNESSES`. progress: takes the share
            that is done.
    """
    delays, stiffnesses = DELAYS if delays is None else delays, STIFFNESSES if stiffnesses is None else stiffnesses
    asked = [
        (line, k, scheme, delay) for line in NETWORKS for k in stiffnesses for scheme in SCHEMES for delay in delays
    ]
    cases = []
    for i, each in enumerate(asked):
        progress(i / len(asked))
        cases.append(case(*each))
    return Outcome(cases, bounds(delays))


def cells(found: Outcome, line: str) -> tuple[list[str], list[list[str]]]:
    """Of the table of a line: headings and rows; a cell is transparency error, stiffness felt, tracking [mm]."""
    mine = [c for c in found.cases if c.line == line]
    delays = list(dict.fromkeys(c.delay for c in mine))
    rows = []
    for stiffness, scheme in dict.fromkeys((c.stiffness, c.scheme) for c in mine):
        row = [f"{stiffness:g}", scheme]
        for delay in delays:
            c = found.case(line, stiffness, scheme, delay)
            row.append(_shown(c) if c.stable else "no rest")
        rows.append(row)
    return ["[N/m]", "scheme", *(f"{1e3 * delay:g} ms" for delay in delays)], rows


def _shown(c: Case) -> str:
    return f"{c.transparency:.2f}, {round(100 * c.felt):+d} %, {1e3 * c.tracking:.1f}"


def bound_cells(found: Outcome) -> tuple[list[str], list[list[str]]]:
    """Of the table of bounds: headings and rows; a cell is by simulation and by theory [N/m]."""
    delays = list(dict.fromkeys(b.delay for b in found.bounds))
    rows = []
    for scheme in dict.fromkeys(b.scheme for b in found.bounds):
        mine = {b.delay: b for b in found.bounds if b.scheme == scheme}
        rows.append([scheme, *(f"{_hard(mine[d].simulated)}, {_hard(mine[d].theory)}" for d in delays)])
    return ["scheme", *(f"{1e3 * delay:g} ms" for delay in delays)], rows


def yielded(stiffness: float) -> float:
    """Share of a stiffness [N/m] that isn't felt where forces come back: the slave's coupling gives way."""
    return stiffness / (stiffness + Teleoperator().coupling_stiffness)


def _hard(stiffness: float) -> str:
    return f"{stiffness:.0f}" if np.isfinite(stiffness) else "all"


def facts(found: Outcome) -> Json:
    """For JSON."""
    return {
        "unit": {"stiffness": "N/m", "delay": "s, one-way", "tracking": "m", "transparency": "1", "felt": "1"},
        "cases": [{k: finite(v) if isinstance(v, float) else v for k, v in c._asdict().items()} for c in found.cases],
        "hardest_material": [
            {k: finite(v) if isinstance(v, float) else v for k, v in b._asdict().items()} for b in found.bounds
        ],
    }


def bound_figure(found: Outcome) -> Figure:
    """The hardest material against the delay: lines by theory, dots by simulation."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for scheme, colour in zip(dict.fromkeys(b.scheme for b in found.bounds), (VERMILION, ORANGE, GREEN, BLUE)):
        mine = [b for b in found.bounds if b.scheme == scheme]
        x = [1e3 * b.delay for b in mine]
        drawn = {"name": scheme, "legendgroup": scheme, "line": {"color": colour}, "marker": {"color": colour}}
        figure.add_scatter(x=x, y=[finite(b.theory) for b in mine], mode="lines", **drawn)
        figure.add_scatter(x=x, y=[finite(b.simulated) for b in mine], mode="markers", showlegend=False, **drawn)
    for stiffness in dict.fromkeys(c.stiffness for c in found.cases):
        figure.add_hline(y=stiffness, line={"color": GREY, "dash": "dot", "width": 1})
    figure.update_yaxes(type="log", title_text="hardest material [N/m]")
    figure.update_xaxes(title_text="one-way delay [ms]")
    finish(figure, 380)
    return figure
