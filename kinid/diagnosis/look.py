"""One look at the catalogue from a model: every effect screened, the promising ones refitted, and the evidence for each."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.candidates import NEAR, SEARCHED, Candidate, able, screen
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.descent import State, bounds, cost_of, fit
from kinid.diagnosis.effort import REFITTING, Effort, weight_of
from kinid.effects import Effect
from kinid.memory import give_back
from kinid.model import Model

Array = NDArray[np.float64]

#: evidence below which nothing is added
ENOUGH = 16.0
#: and how many of its own standard errors it must be
SURE = 3.0
#: an error that falls to less than this share has fallen far
FAR_LESS = 0.6
#: what each further parameter costs, in evidence
PRICE = 4.0
#: held-out error must fall by this share at least, for each of the samples that are averaged together, within these ends: means
#: have less noise, in which a fall would hide
MATERIAL, LEAST, MOST = 0.005, 0.008, 0.02
#: the same share for readings that are stairs: only transitions tell, and all that pass one share it
STAIRS = 0.04
#: a search that still goes down by this share in a slice of its steps is taken up again for so many slices; not where a rival's
#: cost is so much less
SLICES, STALLED, HOPELESS = 16, 0.0025, 9.0
#: of so many steps is a slice, as a share of those that a search may have, and at least
SLICE, SHORT = 0.25, 10
#: slices to come are trusted to gain so many times what their pace says
TRUST = 3.0
#: steps of a search, so that models of many parameters don't take minutes: so many divided by their number, within these ends
EFFORT, FEW_STEPS, MANY_STEPS = 900, 12, 60
#: … and from each point at first
FIRST_STEPS = 30
#: of a small log, effects with more than a handful of parameters need so many readings for each
READINGS = 20
#: candidates that are refitted, a round, and against each addition that defends its place
REFITTED, DEFENDED = 6, 3
#: effects that are screened before the sensitivities of those behind are let go
AT_ONCE = 4
#: an effect that isn't believed is worth a word where it lowers what is left to this share
NEARER = 0.9
#: a gain that is worth a refit, however much is needed
HOPEFUL = 50.0
#: two searches that begin within so many scales of each other end at the same place
APART = 0.2
#: an effect that promises less than this share of what a better one has brought has never come first; nor one that promises less
#: than the second share, where more is left than so many times the noise and the linear view sees little
FAR_BEHIND, LOUDEST, FARTHEST_BEHIND = 0.33, 10.0, 0.05
#: … nor one that is often mistaken for the better one, and promises less than this
BEHIND_ITS_LIKE = 0.2
#: another start of an effect is tried where the first one brought this share of what the best effect did
CONTENDING = 0.5
#: effects that are refitted before what they brought decides about those behind them
ABREAST = 2


@dataclass(frozen=True)
class Evidence:
    """Twice the gain in held-out log-likelihood (bounded per sample), less the price of parameters.

    Attributes:
        value: the figure. error: its standard error, from the spread over blocks of half a second.
        gaining, losing: blocks that gain or lose more than one unit. kept: share of the gain that losing blocks don't take back.
        left: share of the held-out error that is left.
    """

    value: float
    error: float
    gaining: int
    losing: int
    kept: float
    left: float

    @property
    def sure(self) -> bool:
        """Whether chance is no explanation: many blocks gain alike, a few gain much and next to none loses, or the error falls
        so far that what some blocks lose is no matter.
        """
        if self.value < ENOUGH:
            return False
        rare = self.gaining >= 3 and self.kept > 0.8 and self.gaining >= 3 * self.losing
        return self.value > SURE * self.error or rare or (self.left < FAR_LESS and self.gaining > self.losing)


def weigh(before: State, after: State) -> Evidence:
    """Evidence for the second model over the first."""
    gain = 2.0 * (before.loss - after.loss)
    price = PRICE * (len(after.values) - len(before.values)) + float(after.shift @ after.shift - before.shift @ before.shift)
    up, down = float(gain[gain > 0].sum()), float(-gain[gain < 0].sum())
    error = float(gain.std(ddof=1) * np.sqrt(len(gain))) if len(gain) > 1 else float("inf")
    return Evidence(float(gain.sum() - price), error, int((gain > 1).sum()), int((gain < -1).sum()),
                    1.0 - down / up if up > 0 else 0.0, after.rms / before.rms if before.rms > 0 else 1.0)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tried:
    """A candidate that was refitted: its state, the evidence for it over the state before, and the work that it took."""

    effect: Effect
    state: State
    evidence: Evidence
    work: float


@dataclass(frozen=True, eq=False)
class Round:
    """One look at the catalogue from one model: all points of every effect, best first, and the best effects refitted."""

    before: State
    points: Mapping[str, Sequence[Candidate]]
    tried: tuple[Tried, ...]

    @property
    def screened(self) -> list[Candidate]:
        """The best point of each effect, the most promising effect first."""
        return [points[0] for points in sorted(self.points.values(), key=_promise)]


def look(state: State, effort: Effort, *, most: int = REFITTED, spare: Sequence[str] = (), known: Round | None = None,
         goal: float = np.inf, like: str = "") -> Round:  # fmt: skip
    """Screen the catalogue and refit the best.

    Args:
        state: the model as it is. effort: that may be spent on refits; screening is done in any case.
        most: how many to refit. spare: names to leave out.
        known: what earlier looks from the same state found, which is taken over.
        goal: cost of a model that is there: what can't come down to it is not pursued. like: name of the effect that it has.
    """
    done = {t.effect.id: t for t in known.tried} if known else {}
    layout = state.problem.experiment.layout
    able_ones = [effect for effect, why in able(state.model, layout)
                 if not why and not effect.detector and effect.id not in spare
                 and len(effect.parameters(layout)) * READINGS <= max(6 * READINGS, len(state.residual))]  # fmt: skip
    starts: dict[str, Sequence[Candidate]] = {e.id: known.points[e.id] for e in able_ones if known and e.id in known.points}
    fresh_ones = [e for e in able_ones if e.id not in starts]
    starts |= _screened(state, fresh_ones, most)
    effort.spend(sum(len(starts[e.id]) * weight_of(state.model + e, state.problem)
                     for e in fresh_ones if e.id in starts))  # fmt: skip
    ranked = Round(state, starts, ()).screened[:most]
    worth = [c for c in ranked if c.gain >= _promising(state)]
    known_ones = [done[c.effect.id] for c in worth if c.effect.id in done]
    goal = min([goal, *(t.state.cost for t in known_ones)])
    fresh = _refitted(state, effort, [starts[c.effect.id] for c in worth if c.effect.id not in done], goal, like)
    rival, share = min([goal, *(t.state.cost for t in fresh)]), effort.left / max(1, sum(not t.state.converged for t in fresh))
    pursued = side_by_side(lambda t: pursue(state, t, rival, share), fresh)
    effort.spend(sum(t.work for t in pursued) - sum(t.work for t in fresh))
    tried = known_ones + pursued
    tried.sort(key=lambda t: -t.evidence.value)
    points = {name: _slim(found) for name, found in starts.items()}
    del starts
    give_back()
    return Round(state, points, tuple(tried))


def _screened(state: State, able_ones: Sequence[Effect], most: int) -> dict[str, Sequence[Candidate]]:
    """Points of every effect, best first; only the `most` promising keep their sensitivities, which are large."""
    out: dict[str, Sequence[Candidate]] = {}
    for begin in range(0, len(able_ones), AT_ONCE):
        found = side_by_side(lambda e: screen(state, e), able_ones[begin : begin + AT_ONCE])
        out |= {points[0].effect.id: points for points in found if points}
        for name in sorted(out, key=lambda n: _promise(out[n]))[most:]:
            out[name] = _slim(out[name])
    state.forget("course")
    return out


def _promise(points: Sequence[Candidate]) -> float:
    """To sort by: the price of an effect's parameters less what its best point explains."""
    return PRICE * points[0].rank - points[0].gain


def _slim(points: Sequence[Candidate]) -> list[Candidate]:
    """The same without sensitivities."""
    return [dataclasses.replace(c, columns=None) for c in points]


def _promising(state: State) -> float:
    """Least gain, in the linear view, of what is worth a refit: a tenth of what an addition must bring, evidence apart."""
    needed = 2.0 * worth(state) * float(state.held @ state.held)
    return float(np.clip(0.1 * needed, ENOUGH / 2, HOPEFUL))


def _refitted(state: State, effort: Effort, starts: Sequence[Sequence[Candidate]], goal: float, like: str) -> list[Tried]:
    """Effects refitted from their points, the most promising effect and the best point first, beside another of cost `goal`.

    Those that promise far less than others have brought are passed over; so are further points of those that brought far less.
    """
    share = FAR_BEHIND if state.rms < LOUDEST else FARTHEST_BEHIND
    of_its_like = min(share, BEHIND_ITS_LIKE)
    most = max(0.0, state.cost - goal)
    found: list[Tried] = []
    for begin in range(0, len(starts), ABREAST):
        hopeful = [points[0] for points in starts[begin : begin + ABREAST]
                   if points[0].gain >= (of_its_like if _mistaken(points[0].effect, like) else share) * most]  # fmt: skip
        if not hopeful or not effort.lasts(REFITTING * max(weight_of(state.model + c.effect, state.problem) for c in hopeful)):
            continue
        for tried in side_by_side(lambda point: attempt(state, point.effect, point), hopeful):
            effort.spend(tried.work)
            found.append(tried)
            if state.cost - tried.state.cost > most:
                most, like = state.cost - tried.state.cost, tried.effect.id
    of = {points[0].effect.id: points for points in starts}
    again = [point for t in found if state.cost - t.state.cost >= CONTENDING * most
             for point in worth_searching(state, of[t.effect.id])[1:] if point.gain >= share * most]  # fmt: skip
    best = {t.effect.id: t for t in found}
    if again and not effort.lasts():
        return found
    for other in side_by_side(lambda point: attempt(state, point.effect, point), again):
        effort.spend(other.work)
        best[other.effect.id] = min(best[other.effect.id], other, key=lambda t: t.state.cost)
    return list(best.values())


def _mistaken(effect: Effect, name: str) -> bool:
    """Whether the catalogue says that an effect is mistaken for one of this name, or that one for it."""
    return name in effect.confusions or (bool(name) and effect.id in effects.get(name).confusions)


def worth_searching(state: State, points: Sequence[Candidate]) -> list[Candidate]:
    """The points of an effect, best first, that are worth a search: they explain much, and begin somewhere else."""
    best = points[0]
    scale = np.array([p.scale for p in best.effect.parameters(state.problem.experiment.layout)])
    own = slice(best.place, best.place + len(scale))
    return [best, *(point for point in points[1:SEARCHED] if point.gain >= NEAR * best.gain
                    and (np.abs(point.start - best.start)[own] > APART * scale).any())]  # fmt: skip


def attempt(state: State, effect: Effect, point: Candidate) -> Tried:
    """Refit with an effect from one point."""
    model = state.model + effect
    values, shift = _nearest(state, model, point)
    found = fit(state.problem, model, values, shift=shift, guess=point.guess(state),
                steps=min(FIRST_STEPS, _steps(model, state)))  # fmt: skip
    return Tried(effect, found.light(), weigh(state, found), found.work)


def pursue(state: State, tried: Tried, least: float = np.inf, most: float = np.inf) -> Tried:
    """The same with its search taken up again where it still went down: parameters that trade against each other make valleys,
    slow, but steadily downhill. What couldn't come down to `least`, the cost of the best rival, at its pace, is left where it is;
    so is what would take more work than `most`.
    """
    best, before, work = tried.state, 0.0, 0.0
    steps = max(SHORT, round(SLICE * _steps(best.model, state)))
    for left in reversed(range(SLICES)):
        if best.converged or best.cost > HOPELESS * least or work > most:
            break
        further = fit(state.problem, best.model, best.values, shift=best.shift, steps=steps)
        gained, work = best.cost - further.cost, work + further.work
        best = further.light() if gained > 0 else best
        # slices that gain ever less, each a share of the one before, sum up to no more than this many like the last
        worn = gained / (before - gained) if before > gained else np.inf
        if gained < STALLED * best.cost or best.cost - min(left, TRUST * worn) * gained > least:
            break
        before = gained
    if best is tried.state:
        return dataclasses.replace(tried, work=tried.work + work)
    return Tried(tried.effect, best, weigh(state, best), tried.work + work)


def _steps(model: Model, state: State) -> int:
    """Of a search of so many parameters."""
    return int(np.clip(EFFORT / max(1, len(model.parameters(state.problem.experiment.layout))), FEW_STEPS, MANY_STEPS))


def _nearest(state: State, model: Model, point: Candidate) -> tuple[Array, Array]:
    """As much of the linear view's step as helps, values and shift: curved laws reward only its beginning."""
    none = point.origin
    low, high = bounds(model, state.problem)
    best, least = (none, state.shift), np.inf
    for share in (1.0, 0.3, 0.1, 0.03):
        values, shift = none + share * (point.start - none), state.shift + share * (point.shift - state.shift)
        if (values < low).any() or (values > high).any():
            continue
        cost = cost_of(state.problem, model, values, shift)
        if cost < least:
            best, least = (values, shift), cost
        elif np.isfinite(least):
            break
    return np.clip(best[0], low, high), best[1]


def worth(state: State) -> float:
    """Share by which an addition must lower the error of means."""
    if state.problem.experiment.steps is not None:
        return STAIRS
    return float(np.clip(MATERIAL * state.problem.count.mean(), LEAST, MOST))
