"""Force control with constant gains, with an online estimate and with a measured map, at equal stability margins.

The mould is poked by the laboratory's campaign and mapped as a user would; controllers know that map with its errors,
the four silicones' published values, and what their sensors say. Each one's bandwidth is the greatest at which the loop
keeps `MARGINS` on every contact that it may meet: `kinid.lab.loop_margins` has the loop. The truth only makes the force
that is felt, and the column of margins as they were in fact.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import cKDTree

from kinid.controllers.force import (
    SURE,
    ContactGains,
    FixedGains,
    ForceControl,
    GainSource,
    MapGains,
    OnlineGains,
    Reading,
)
from kinid.controllers.measured import CELLS, EDGE, Measured
from kinid.controllers.properties import Properties
from kinid.errors import InputError
from kinid.lab import force_jobs, materials
from kinid.lab.campaign import Campaign
from kinid.lab.experiments import prepare
from kinid.lab.force_loop import Course, ForceLoop, Job
from kinid.lab.loop_margins import Margins, Plant, Response, bandwidth_of, plant, response, worst
from kinid.mapping.origin import origin
from kinid.mapping.probes import Prober
from kinid.mapping.property_map import WITHIN, PropertyMap
from kinid.robotics.surface import Plane

Array = NDArray[np.float64]

#: that each controller keeps on all that it may meet: 8 dB and 60°
MARGINS = Margins(10.0 ** (8.0 / 20.0), np.radians(60.0))
#: what the mould is made of, as published; and the middle of these, for which constant gains are designed
SILICONES = tuple(
    Properties(m.stiffness, m.damping)
    for m in (materials.ECOFLEX_30, materials.ECOFLEX, materials.DRAGON_SKIN, materials.DRAGON_SKIN_30)
)
MEAN = Properties(*(float(np.mean(values)) for values in zip(*(s[:2] for s in SILICONES))))
#: bounds of an estimate: the silicones', and half as much again
LEAST = Properties(*(min(values) / 1.5 for values in zip(*(s[:2] for s in SILICONES))))
MOST = Properties(*(max(values) * 1.5 for values in zip(*(s[:2] for s in SILICONES))))
#: error of a map whose cost is shown
MISTAKEN = 0.2
CONSTANT, FED, ONLINE, MAP = "constant gains", "constant gains, fed forward", "online estimate", "map"
HARD, SOFT = f"map {100 * MISTAKEN:.0f} % too hard", f"map {100 * MISTAKEN:.0f} % too soft"
CONTROLLERS = (CONSTANT, FED, ONLINE, MAP, HARD, SOFT)
#: by controller: what makes a fresh source; bandwidth and margins
Sources = dict[str, Callable[[], GainSource]]
Designs = dict[str, tuple[float, Margins]]
#: of the places and times at which margins are worked out: along the paths [m], and in time [s]
APART, SAMPLED = 0.005, 0.25
#: contacts nearer to each other than this share count as one there
CLOSE = 0.01
#: residual over noise of the probes beside a job up to which the map's model holds there
HOLDS = 2.0


class Design(NamedTuple):
    """A controller's bandwidth [rad/s], and the least margins on what it may meet and on what it met in fact."""

    controller: str
    bandwidth: float
    designed: Margins
    met: Margins


class Score(NamedTuple):
    """Of one controller in one task; forces as root mean squares over its runs.

    Attributes:
        error: wanted less true force [N]. share: the same, each run's over its wanted force [1]. beyond: as share, but
            against the wanted force behind the filter that the arm can follow. overshoot: greatest of any run [1].
    """

    task: str
    controller: str
    error: float
    share: float
    beyond: float
    overshoot: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of the study.

    Attributes:
        grown: the map. map_source: where it came from. interval: half widths of the 95 % intervals of K and B, as
            shares, of online estimates. designs, scores: rows. courses: by task and controller.
    """

    grown: PropertyMap
    map_source: str
    interval: tuple[float, float]
    designs: list[Design]
    scores: list[Score]
    courses: dict[tuple[str, str], list[Course]]

    def score(self, task: str, controller: str) -> Score:
        """Of a controller in a task."""
        return next(s for s in self.scores if (s.task, s.controller) == (task, controller))

    def holds(self, job: Job) -> bool:
        """Whether the map's own residuals say that its model holds wherever a job goes."""
        beside = cKDTree(self.grown.flat(self.grown.places)).query(job.place)[1]
        return bool((self.grown.residual_over_noise[beside] < HOLDS).all())

    def gain(self, task: str, beyond: bool = False, holding: bool = False) -> float:
        """How many times less force error the map leaves than constant gains, with or without feed-forward.

        Args:
            task: see `Score`. beyond: against what the arm is asked for. holding: of jobs alone where the map's model
                holds; NaN without any.
        """
        rms = []
        for name in (MAP, CONSTANT, FED):
            runs = [run for run in self.courses[task, name] if not holding or self.holds(run.job)]
            shares = [run.error(beyond) / float(run.job.wanted.max()) for run in runs]
            rms.append(float(np.sqrt(np.mean(np.square(shares)))) if shares else np.nan)
        return min(rms[1:]) / rms[0]


def probed(seed: int = 0, count: int = 10, spacing: float = 0.01) -> PropertyMap:
    """A map of the mould from a campaign of virtual pokes, count × count.

    Args:
        seed: of the sensor. spacing: between pokes [m].
    """
    campaign = Campaign(count, count, spacing, seed=seed)
    prober = Prober.of(campaign.base()[0].rig)
    found = [prober.of_log(campaign.setup(i)[0].run().log, campaign.name(i)) for i in range(campaign.count)]
    probes = tuple(probe for _, some in found for probe in some)
    return PropertyMap(prober.surface, found[0][0], probes, prober.name, origin(prober.rig))


class _Bench:
    """The arm, and the loops that were worked out."""

    def __init__(self, seed: int) -> None:
        self.setup, self.seed = prepare("mould", seed=seed), seed
        self.loop = ForceLoop(self.setup)
        self.stiffness = self.setup.gains.translation
        self.inertia = self.loop.inertia(np.zeros(2))
        self._plants: dict[tuple[float, ...], Plant] = {}

    def run(self, job: Job, source: GainSource, ahead: bool = True) -> Course:
        """A job with a fresh controller."""
        control = ForceControl(self.stiffness, self.inertia, self.setup.gains.period, ahead)
        return self.loop.run(job, control, source, self.seed)

    def response(self, place: Array, true: Properties, model: Properties) -> Response:
        """Open loop on a contact that is modelled as another."""
        at = np.round(np.asarray(place) / (2 * APART)) * 2 * APART  # the arm is the same within a centimetre
        contact = Properties(*np.exp(np.round(np.log(true[:2]) / CLOSE) * CLOSE).tolist())
        key = (*at.tolist(), *contact[:2])
        if key not in self._plants:
            self._plants[key] = plant(self.loop, at, contact)
        return response(self._plants[key], model, self.stiffness, self.inertia, self.setup.gains.period)

    def true(self, x: float, y: float, depth: float) -> Properties:
        """The contact as it is where the tip stands: by the slope of its force."""
        here = {name: float(v[0]) for name, v in self.setup.material.at(np.full(1, x), np.full(1, y)).items()}
        layer = here["layer"] if depth > here["layer_depth"] else 0.0
        return Properties(here["stiffness"] + layer, here["damping"])


def _corners(at: Properties, error: Iterable[float]) -> list[Properties]:
    """What a contact may be: each of K and B at the ends of its interval, within what the silicones are."""
    ranges = []
    for value, share, possible in zip(at[:2], error, zip(*(s[:2] for s in SILICONES))):
        low, high = max(value * (1 - share), min(possible)), min(value * (1 + share), max(possible))
        ranges.append({min(low, value), max(high, value)} if low <= high else {value})
    return [Properties(*each) for each in itertools.product(*ranges)]


class _MeasuredMap:
    """A measured map with its errors."""

    def __init__(self, grown: PropertyMap) -> None:
        self.grown, self.values = grown, Measured(grown)
        ticks = grown.grid(2 * CELLS, EDGE)
        guess = grown.over_grid("stiffness", ticks)
        half = WITHIN * np.where(guess.known, guess.sd, np.inf)
        stiffness = np.array([[self.values.properties(x, y).stiffness for y in ticks[1]] for x in ticks[0]])
        hardest = np.maximum(np.minimum(stiffness + half, max(s.stiffness for s in SILICONES)), stiffness)
        self._caution = RectBivariateSpline(*ticks, stiffness / hardest, kx=1, ky=1)

    def errors(self, places: Array) -> Array:
        """Half widths of the 95 % intervals of K and B at places (n, 2) [m], (n, 2)."""
        return WITHIN * np.stack([self.grown.interpolator(n).at(places).sd for n in ("stiffness", "damping")], axis=1)

    def caution(self, x: float, y: float) -> float:
        """Stiffness over the greatest that its error leaves possible at a place: loops gain as much."""
        return float(self._caution.ev(x, y))


def _places(tasks: Sequence[Job]) -> Array:
    """Where the jobs go, (n, 2), once each `APART`."""
    return np.unique(np.round(np.concatenate([job.place for job in tasks]) / APART), axis=0) * APART


def _met_by_constant(bench: _Bench) -> list[Response]:
    return [bench.response(np.zeros(2), silicone, MEAN) for silicone in SILICONES]


def _met_by_estimate(bench: _Bench, interval: tuple[float, float]) -> list[Response]:
    """Estimate ± interval on each silicone; B may still be the one that was assumed."""
    out = []
    for silicone in SILICONES:
        for model in (silicone, Properties(silicone.stiffness, MEAN.damping)):
            for true in _corners(silicone, interval):
                out.append(bench.response(np.zeros(2), true, model))
    return out


def _met_by_map(bench: _Bench, known: _MeasuredMap, places: Array, share: float = 1.0) -> list[Response]:
    """The map's value ± its error at all places of the jobs, with the caution that is taken there."""
    out = []
    for place, half in zip(places, known.errors(places)):
        here, caution = known.values.properties(*place.tolist()), known.caution(*place.tolist())
        model = Properties(share * here.stiffness, share * here.damping)
        for true in _corners(here, half / np.array(here[:2])):
            angle, loop = bench.response(place, true, model)
            out.append(Response(angle, caution * loop))
    return out


def _in_fact(bench: _Bench, courses: Sequence[Course]) -> Margins:
    """The least margins along courses, by the contact as it was."""
    least = Margins(np.inf, np.inf)
    for course in courses:
        for i in np.flatnonzero(course.job.scored)[:: round(SAMPLED / course.job.period)]:
            stiffness, damping, bandwidth = course.model[i].tolist()
            true = bench.true(*course.place[i].tolist())
            now = bench.response(course.place[i, :2], true, Properties(stiffness, damping)).margins(bandwidth)
            least = Margins(min(least.gain, now.gain), min(least.phase, now.phase))
    return least


def _sources(
    bench: _Bench, known: _MeasuredMap, tasks: dict[str, list[Job]]
) -> tuple[Sources, Designs, tuple[float, float]]:
    """Of each controller a maker of fresh ones, its bandwidth and margins; and the intervals of online estimates."""
    constant, places = _met_by_constant(bench), _places([job for some in tasks.values() for job in some])
    slow = bandwidth_of(constant, MARGINS)
    assumed = FixedGains(MEAN, slow)
    interval = _intervals(bench, assumed, tasks)
    estimate, mapped = _met_by_estimate(bench, interval), _met_by_map(bench, known, places)
    quick, best = bandwidth_of(estimate, MARGINS), bandwidth_of(mapped, MARGINS)
    sources: Sources = {CONSTANT: lambda: assumed, FED: lambda: assumed}
    sources[ONLINE] = lambda: OnlineGains(assumed, LEAST, MOST, quick)
    designs = {name: (slow, worst(constant, slow)) for name in (CONSTANT, FED)} | {
        ONLINE: (quick, worst(estimate, quick))
    }
    for name, share in ((MAP, 1.0), (HARD, 1.0 + MISTAKEN), (SOFT, 1.0 - MISTAKEN)):
        sources[name] = partial(MapGains, known.values, best, known.caution, share)
        designs[name] = (best, worst(mapped if share == 1.0 else _met_by_map(bench, known, places, share), best))
    return sources, designs, interval


def _intervals(bench: _Bench, assumed: FixedGains, tasks: dict[str, list[Job]]) -> tuple[float, float]:
    """How wide the 95 % intervals of K and B are in use, 95 of a hundred times, in runs at the gains of `assumed`."""
    seen: list[list[float]] = []

    class Watched(OnlineGains):
        def contact(self, now: Reading) -> ContactGains:
            out = super().contact(now)
            seen.append(list(self.error))
            return out

    for job in (job for some in tasks.values() for job in some):
        bench.run(job, Watched(assumed, LEAST, MOST, assumed.bandwidth))
    widths = np.array(seen)
    stiffness, damping = (
        float(np.percentile(w[np.isfinite(w)], 95)) if np.isfinite(w).any() else SURE for w in widths.T
    )
    return stiffness, damping


def study(
    seed: int = 0,
    grown: PropertyMap | None = None,
    map_source: str = "a campaign of 100 virtual pokes",
    some: slice = slice(None),
    controllers: Sequence[str] = CONTROLLERS,
) -> Outcome:
    """Map the mould, choose bandwidths, do all jobs with all controllers.

    Args:
        seed: of the sensors. grown: a map of the mould; default: `probed`. map_source: where it came from.
        some: of each task's jobs. controllers: of `CONTROLLERS`.

    Raises:
        InputError: a map without stiffness and damping, on a mesh, or one that doesn't know where the jobs go.
    """
    grown, bench = probed(seed) if grown is None else checked(grown), _Bench(seed)
    tasks = {task: force_jobs.jobs(bench.setup.material, task)[some] for task in force_jobs.TASKS}
    known = _MeasuredMap(grown)
    _check_known(known, [job for each in tasks.values() for job in each])
    sources, designs, interval = _sources(bench, known, tasks)
    courses = {
        (task, name): [bench.run(job, sources[name](), ahead=name != CONSTANT) for job in jobs]
        for task, jobs in tasks.items()
        for name in controllers
    }
    scores = [_score(task, name, runs) for (task, name), runs in courses.items()]
    rows = []
    for name in controllers:
        met = _in_fact(bench, [run for (_, who), runs in courses.items() if who == name for run in runs])
        rows.append(Design(name, *designs[name], met))
    return Outcome(grown, map_source, interval, rows, scores, courses)


def _score(task: str, controller: str, runs: Sequence[Course]) -> Score:
    wanted = np.array([run.job.wanted.max() for run in runs])
    error, beyond = (np.array([run.error(reference) for run in runs]) for reference in (False, True))
    rms, share, over = (float(np.sqrt(np.mean(each**2))) for each in (error, error / wanted, beyond / wanted))
    return Score(task, controller, rms, share, over, max(run.overshoot for run in runs))


def checked(grown: PropertyMap) -> PropertyMap:
    """Itself.

    Raises:
        InputError: a map that isn't one of stiffness and damping [N/m, N·s/m] on a plane.
    """
    units = {p.name: p.unit for p in grown.properties}
    if not isinstance(grown.surface, Plane) or (units.get("stiffness"), units.get("damping")) != ("N/m", "N·s/m"):
        raise InputError(
            f"a map of {', '.join(f'{name} [{unit}]' for name, unit in units.items())}",
            "stiffness [N/m] and damping [N·s/m] on a plane",
            "map the mould with the default model: kinid map LOG -o map.parquet",
        )
    return grown


def _check_known(known: _MeasuredMap, jobs: Sequence[Job]) -> None:
    for x, y in _places(jobs).tolist():
        if not known.values.knows(x, y):
            raise InputError(
                f"a map that doesn't know the place ({1e3 * x:g}, {1e3 * y:g}) mm, where a job goes",
                "a map of the whole mould",
                "poke it: kinid lab mould --campaign 10x10 -o campaign",
            )
