"""From a model to the model with what it lacks: forward by held-out evidence, then each addition must defend its place."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.candidates import NEAR, SEARCHED, Candidate, able, amplitudes, base_of, screen
from kinid.diagnosis.descent import State, bounds, fit
from kinid.diagnosis.problem import BIAS_FORCE, BIAS_TORQUE, CLOCK, SURFACE
from kinid.effects import Effect
from kinid.fit import error_rows
from kinid.model import Model

Array = NDArray[np.float64]
In = TypeVar("In")
Out = TypeVar("Out")

#: evidence below which nothing is added
ENOUGH = 16.0
#: and how many of its own standard errors it must be
SURE = 3.0
#: what each further parameter costs, in evidence
PRICE = 4.0
#: held-out error must fall by this share at least, for each of the samples that are averaged together, within these ends: means
#: have less noise, in which a fall would hide
MATERIAL, LEAST, MOST = 0.005, 0.008, 0.02
#: … or the log's own error must, calibration as it was stated, and evidence be beyond what calibration leaves
LIGHTER, STRONG = 0.015, 100.0
#: after several additions, while the error is so many times the noise, what takes off less than this share only stands in for
#: something that the catalogue lacks
SEVERAL, LOUD, CRUMB = 2, 2.0, 0.04
#: rivals within so much evidence, or so many standard errors of the difference, fit as well
ALIKE, ALIKE_SE = 12.0, 2.0
#: … but never when they lack this share of what the addition brought
CLOSE = 0.15
#: a search that still goes down is taken up again so many times
PATIENCE = 4
#: steps of a search, so that models of many parameters don't take minutes: so many divided by their number, within these ends
EFFORT, FEW_STEPS, MANY_STEPS = 900, 12, 60
#: of a small log, effects with more than a handful of parameters need so many readings for each
READINGS = 20
#: rounds beyond the number of effects that may be added
EXTRA_ROUNDS = 2
#: candidates that are refitted, a round
REFITTED = 6


#: parameters below these are calibration, not physics, by unit
TOLERATED: dict[str, dict[str, float]] = {
    "surface-offset": {"m": 3 * SURFACE},
    "tip-offset": {"m": 2.5 * SURFACE},
    "time-offset": {"s": 4 * CLOCK},
    "sensor-lag": {"s": 4 * CLOCK},
    "sensor-bias": {"N": 2 * BIAS_FORCE, "N·m": 2 * BIAS_TORQUE},
}


@dataclass(frozen=True)
class Evidence:
    """Twice the gain in held-out log-likelihood (bounded per sample), less the price of parameters.

    Attributes:
        value: the figure. error: its standard error, from the spread over blocks of half a second.
        gaining, losing: blocks that gain or lose more than one unit. kept: share of the gain that losing blocks don't take back.
    """

    value: float
    error: float
    gaining: int
    losing: int
    kept: float

    @property
    def sure(self) -> bool:
        """Whether chance is no explanation: many blocks gain alike, or a few gain much and next to none loses."""
        if self.value < ENOUGH:
            return False
        rare = self.gaining >= 3 and self.kept > 0.8 and self.gaining >= 3 * self.losing
        return self.value > SURE * self.error or rare


def weigh(before: State, after: State) -> Evidence:
    """Evidence for the second model over the first."""
    gain = 2.0 * (before.loss - after.loss)
    price = PRICE * (len(after.values) - len(before.values)) + float(after.shift @ after.shift - before.shift @ before.shift)
    up, down = float(gain[gain > 0].sum()), float(-gain[gain < 0].sum())
    error = float(gain.std(ddof=1) * np.sqrt(len(gain))) if len(gain) > 1 else float("inf")
    return Evidence(float(gain.sum() - price), error, int((gain > 1).sum()), int((gain < -1).sum()),
                    1.0 - down / up if up > 0 else 0.0)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tried:
    """A candidate that was refitted: its state, and the evidence for it over the state before."""

    effect: Effect
    state: State
    evidence: Evidence


@dataclass(frozen=True, eq=False)
class Round:
    """One look at the catalogue from one model: all points of every effect, best first, and the best effects refitted."""

    before: State
    points: Mapping[str, Sequence[Candidate]]
    tried: tuple[Tried, ...]

    @property
    def screened(self) -> list[Candidate]:
        """The best point of each effect, the most promising effect first."""
        return sorted((points[0] for points in self.points.values()), key=lambda c: PRICE * c.rank - c.gain)


def look(state: State, *, most: int = REFITTED, spare: Sequence[str] = ()) -> Round:
    """Screen the catalogue and refit the best.

    Args:
        state: the model as it is. most: how many to refit. spare: names to leave out.
    """
    layout = state.problem.experiment.layout
    able_ones = [effect for effect, why in able(state.model, layout)
                 if not why and not effect.detector and effect.id not in spare
                 and len(effect.parameters(layout)) * READINGS <= max(6 * READINGS, len(state.residual))]  # fmt: skip
    starts = {points[0].effect.id: points for points in _side_by_side(lambda e: screen(state, e), able_ones) if points}
    look = Round(state, starts, ())
    worth = [c for c in look.screened[:most] if c.gain >= ENOUGH / 2]
    tried = _side_by_side(lambda c: attempt(state, c, starts[c.effect.id]), worth)
    tried.sort(key=lambda t: -t.evidence.value)
    light = {name: [dataclasses.replace(c, columns=None) for c in points] for name, points in starts.items()}
    return Round(state, light, tuple(tried))


def _side_by_side(do: Callable[[In], Out], items: Sequence[In]) -> list[Out]:
    """The same for all, on as many cores as there are; kernels let go of the interpreter's lock."""

    def quietly(item: In) -> Out:
        with np.errstate(all="ignore"):  # a shape that doesn't suit the log may overflow: it is passed over
            return do(item)

    cores = min(os.cpu_count() or 1, 4)
    if cores < 2 or len(items) < 2:
        return [quietly(item) for item in items]
    with ThreadPoolExecutor(cores) as pool:
        return list(pool.map(quietly, items))


def attempt(state: State, candidate: Candidate, points: Sequence[Candidate]) -> Tried:
    """Refit with the candidate, from its best shapes."""
    model = state.model + candidate.effect
    steps = int(np.clip(EFFORT / max(1, len(candidate.start)), FEW_STEPS, MANY_STEPS))
    best: State | None = None
    for point in points[:SEARCHED]:
        if best is not None and point.gain < NEAR * points[0].gain:
            break
        found = fit(state.problem, model, _nearest(state, model, point), guess=point.guess(state), steps=min(30, steps))
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    for _ in range(PATIENCE):  # parameters that trade against each other make valleys: slow, but steadily downhill
        if best.converged:
            break
        further = fit(state.problem, model, best.values, steps=steps)
        if further.cost > 0.97 * best.cost:
            break
        best = further
    return Tried(candidate.effect, best.light(), weigh(state, best))


def _nearest(state: State, model: Model, point: Candidate) -> Array:
    """As much of the linear view's step as helps: curved laws reward only its beginning."""
    problem, none = state.problem, point.origin
    y = problem.stack(problem.measured)
    low, high = bounds(model, problem)
    best, least = none, np.inf
    for share in (1.0, 0.3, 0.1, 0.03):
        trial = none + share * (point.start - none)
        if (trial < low).any() or (trial > high).any():
            continue
        rest = y - problem.stack(problem.predict(model, trial))
        cost = float(rest @ rest)
        if cost < least:
            best, least = trial, cost
        elif np.isfinite(least):
            break
    return np.clip(best, low, high)


def accepted(before: State, tried: Tried) -> bool:
    """Whether an addition is believed: evidence that chance doesn't explain, and a size that matters."""
    return (tried.evidence.sure and material(tried) and not at_end(tried) and _matters(before, tried)
            and _beyond_rounding(before, tried))  # fmt: skip


def _beyond_rounding(before: State, tried: Tried) -> bool:
    """Whether it changes readings by more than a coarse converter rounds them: neighbours share that, in any shape."""
    steps = before.problem.experiment.steps
    if steps is None or not (steps > 0).all():
        return True
    sigma = before.problem.sigma[:, before.problem.valid]
    change = (before.residual - tried.state.residual).reshape(len(sigma), -1) * sigma
    return bool((np.percentile(np.abs(change), 95, axis=1) > 0.5 * steps).any())


def _matters(before: State, tried: Tried) -> bool:
    """Whether it takes enough off the weighted error; or, if calibration is no explanation, off the error as users see it."""
    if tried.state.rms < (1.0 - _worth(before)) * before.rms:
        return True
    if tried.effect.id in TOLERATED or tried.evidence.value < STRONG:
        return False
    return _error(tried.state) < (1.0 - LIGHTER) * _error(before)


def _error(state: State) -> float:
    """Held-out error in the unit of the readings, calibration as it was stated, noise of single samples included."""
    problem = state.problem
    rows = error_rows(problem.experiment)
    sigma = problem.sigma[rows][:, problem.valid]
    held = state.plain.light().held.reshape(len(rows), -1)[rows]
    averaged = np.mean(problem.experiment.noise[rows] ** 2) * (1.0 - np.mean(1.0 / problem.count[problem.valid]))
    return float(np.sqrt(np.mean((held * sigma) ** 2) + averaged))


def _believed(before: State, tried: Sequence[Tried]) -> list[Tried]:
    """Those that are accepted, and that calibration a little beyond its tolerance doesn't explain as well."""
    good = [t for t in tried if accepted(before, t)]
    calibration = [t.evidence.value for t in tried if t.effect.id in TOLERATED and t.evidence.sure and t not in good]
    doubt = max(calibration, default=-np.inf)
    return [t for t in good if t.evidence.value > doubt + ALIKE]


def _worth(state: State) -> float:
    """Share by which an addition must lower the error of means."""
    return float(np.clip(MATERIAL * state.problem.count.mean(), LEAST, MOST))


def at_end(tried: Tried) -> bool:
    """Whether one of its parameters was driven to the end of what is possible: then it stands in for something else."""
    layout = tried.state.problem.experiment.layout
    parameters = tried.effect.parameters(layout)
    null = amplitudes(tried.effect, layout, base_of(tried.state.model))
    own = [name.split(".")[0] == tried.effect.id for name in tried.state.model.parameters(layout)]
    for i, (p, value) in enumerate(zip(parameters, tried.state.values[np.array(own)])):
        room = 1e-3 * p.scale
        if any(abs(value - end) < room and end != null.get(i) for end in (p.low, p.high)):
            return True
    return False


def material(tried: Tried) -> bool:
    """Whether what was added is outside of what calibration is trusted to anyway."""
    layout = tried.state.problem.experiment.layout
    own = np.array([name.split(".")[0] == tried.effect.id for name in tried.state.model.parameters(layout)])
    values = tried.state.values[own]
    least = TOLERATED.get(tried.effect.id)
    if least is None:
        return True
    units = [p.unit for p in tried.effect.parameters(layout)]
    return any(abs(v) > least[unit] for v, unit in zip(values, units) if unit in least)


@dataclass(frozen=True, eq=False)
class Search:
    """What was found.

    Attributes:
        states: from the model that was asked about to the last one; each has one effect more.
        added: names, in the order of the steps. rivals: of each addition, those that fit as well.
        rounds: every look, first to last. evidence: for each addition, beside all others.
        cut_short: whether it ended because no more effects were asked for, with candidates left.
    """

    states: tuple[State, ...]
    added: tuple[str, ...]
    rivals: dict[str, tuple[str, ...]]
    rounds: tuple[Round, ...]
    evidence: dict[str, Evidence]
    cut_short: bool = False


def search(start: State, *, most: int = 4, forced: Sequence[str] = (), spare: Sequence[str] = (),
           progress: Callable[[str], None] = lambda _: None) -> Search:  # fmt: skip
    """Add effects while held-out evidence asks for more.

    Args:
        start: the model as the user has it, fitted. most: effects to add. forced: names to add first, whatever the evidence.
        spare: names that are out of the question. progress: told what is being done.
    """
    states, rounds, added = [start], [], []
    for name in forced:
        progress(f"adding {name}")
        points = screen(states[-1], effects.get(name))
        states.append(attempt(states[-1], points[0], points).state)
        added.append(name)
    # an effect that is defended away may come back, but not for ever
    for _ in range(most + EXTRA_ROUNDS):
        if len(added) >= most:
            break
        progress(f"looking for what {' + '.join(['the model', *added])} lacks")
        found = look(states[-1], spare=spare)
        rounds.append(found)
        good = _believed(states[-1], found.tried)
        if len(added) >= SEVERAL and states[-1].rms > LOUD:
            good = [t for t in good if t.state.rms < (1.0 - CRUMB) * states[-1].rms]
        if not good:
            break
        chosen = _simplest(good)
        states.append(chosen.state)
        added.append(chosen.effect.id)
        progress(f"defending {', '.join(added)}")
        states, added = _defend(states[0], states[-1], added, forced, spare)
    if not rounds or rounds[-1].before is not states[-1]:
        rounds.append(look(states[-1], spare=spare, most=0))
    cut_short = len(added) >= most and any(c.gain > 10 * ENOUGH for c in rounds[-1].screened)
    known = {added[0]: rounds[0]} if len(added) == 1 and not forced else {}
    rivals, evidence = _rivals(states[-1], added, spare, known)
    return Search(tuple(_ladder(states[0], states[-1], added)), tuple(added), rivals, tuple(rounds), evidence, cut_short)


def _simplest(good: Sequence[Tried]) -> Tried:
    """Of those that fit as well as the best, the one with the fewest parameters."""
    best = good[0]
    alike = [t for t in good if t is best or _alike(t, best.state, best.evidence)]
    return min(alike, key=lambda t: (len(t.state.values), -t.evidence.value))


def _without(state: State, name: str) -> State:
    """The same model less one effect, and less those that can't act without it, refitted."""
    gone = {name} | {e.id for e in state.model.effects if e.wants and not any(w in state.model and w != name for w in e.wants)}
    if name not in state.model:
        return state
    kept = [part for effect, part in zip(state.model.effects, _parts(state)) if effect.id not in gone]
    model = Model(*(effect for effect in state.model.effects if effect.id not in gone))
    return fit(state.problem, model, np.concatenate([np.zeros(0), *kept]))


def _parts(state: State) -> list[Array]:
    ends = np.cumsum([len(e.parameters(state.problem.experiment.layout)) for e in state.model.effects])
    return np.split(state.values, ends[:-1])


def _defend(first: State, state: State, added: list[str], forced: Sequence[str], spare: Sequence[str]
            ) -> tuple[list[State], list[str]]:  # fmt: skip
    """Each addition against being left out, and against every other effect in its place."""
    for name in [n for n in added if n not in forced]:
        if len(added) == 1:
            break
        if name not in added:
            continue
        less = _without(state, name)
        if _vanished(state, name) or not weigh(less, state).sure:
            added = [n for n in added if n in less.model]
            state = less
            continue
        others = look(less, spare=[*spare, name], most=3)
        mine = weigh(less, state)
        better = [t for t in others.tried if accepted(less, t) and _displaces(t, state, mine)]
        if better:
            state = better[0].state
            added = [n for n in (better[0].effect.id if n == name else n for n in added) if n in state.model]
    return [first, state], added


def _displaces(other: Tried, state: State, mine: Evidence) -> bool:
    """Whether another effect takes the place of one: it fits better, or as well with fewer parameters."""
    if len(other.state.values) < len(state.values) and _alike(other, state, mine):
        return True
    return other.evidence.value > mine.value + ALIKE and other.state.rms < state.rms


def _vanished(state: State, name: str) -> bool:
    """Whether an effect does nothing any more beside those that came after it."""
    layout = state.problem.experiment.layout
    effect = effects.get(name)
    parameters = effect.parameters(layout)
    own = np.array([full.split(".")[0] == name for full in state.model.parameters(layout)])
    null = amplitudes(effect, layout, base_of(state.model))
    if not null:
        return False
    # with calibration free, or as it was stated
    return any(all(abs(fitted.values[own][i] - zero) < 1e-3 * parameters[i].scale for i, zero in null.items())
               for fitted in (state, state.plain.light()))  # fmt: skip


def _rivals(state: State, added: Sequence[str], spare: Sequence[str], known: Mapping[str, Round]
            ) -> tuple[dict[str, tuple[str, ...]], dict[str, Evidence]]:  # fmt: skip
    """Of each addition, the effects that fit as well in its place; `known` are looks that were made from there already."""
    rivals, evidence = {}, {}
    for name in added:
        others = known[name] if name in known else look(_without(state, name), spare=[*spare, name])
        evidence[name] = weigh(others.before, state)
        rivals[name] = tuple(t.effect.id for t in others.tried if t.effect.id != name and _alike(t, state, evidence[name]))
    return rivals, evidence


def _alike(rival: Tried, state: State, mine: Evidence) -> bool:
    """Whether a rival fits as well: within what chance moves, and not by many more parameters."""
    difference = weigh(rival.state, state)
    close = max(ALIKE, min(ALIKE_SE * difference.error, CLOSE * mine.value))
    return bool(difference.value < close and rival.evidence.sure)


def _ladder(first: State, last: State, added: Sequence[str]) -> list[State]:
    """States between: one addition more at a time, in the order in which each helps most."""
    if not added:
        return [first]
    if len(added) == 1:
        return [first, last]
    out = [first]
    for k in range(1, len(added)):
        current = last
        for name in added[k:]:
            current = _without(current, name)
        out.append(current)
    return [*out, last]
