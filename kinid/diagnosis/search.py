"""From a model to the model with what it lacks: forward by held-out evidence, then each addition must defend its place."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.belief import (
    BIAS,
    accepted,
    as_stated,
    at_end,
    believed,
    calibration_shows,
    plausibility,
    possible,
    shown_error,
)
from kinid.diagnosis.candidates import amplitudes, base_of, screen
from kinid.diagnosis.descent import State, fit, settled
from kinid.diagnosis.effort import REFITTING, RIVALS, SCREENING, Effort, weight_of
from kinid.diagnosis.look import (
    DEFENDED,
    ENOUGH,
    FAR_LESS,
    REFITTED,
    Evidence,
    Round,
    Tried,
    attempt,
    look,
    pursue,
    weigh,
    worth_searching,
)
from kinid.fit import starting_values
from kinid.model import Model

Array = NDArray[np.float64]

#: after several additions, while the error is so many times the noise, what takes off less than this share only stands in for
#: something that the catalogue lacks; so does, most often, what comes last with all work done
SEVERAL, LOUD, CRUMB = 2, 2.0, 0.1
#: where no effect helps alone and the error is as loud, so many are tried with a second one, of those that leave less than this
PAIRED, ALONE = 3, 0.98
#: rivals within so much evidence, or so many standard errors of the difference, fit as well: where contact begins decides what
#: friction remembers, and two searches for one and the same optimum end so far apart
ALIKE, ALIKE_SE = 25.0, 2.0
#: an effect takes another's place where it brings so much more evidence
BETTER = 12.0
#: … but never when they lack this share of what the addition brought
CLOSE = 0.15
#: … they are told beside what was found within so many of them; or within this share of what it brought, up to so much evidence:
#: no law has quite the catalogue's form; or, of what brought nearly as much, where the log's own error is the same to this share
HARDLY_SE, FORM, FORMS, SAME = 3.0, 0.03, 150.0, 0.01
#: a rival that alone would not be believed is one nevertheless with this share of what the addition brought
HALF = 0.5
#: another start's fit is another one where its cost is so much less
LOWER = 0.98
#: weighted squares of a reading below which a fit lacks nothing that another start could find
NEAR_NOISE = 1.3
#: what promises more, after the last effect that may be added, was left out
WANTED = 10 * ENOUGH
#: calibration that was left so many tolerances away may be further off than it can go
AT_ENDS = 1.5
#: rounds beyond the number of effects that may be added
EXTRA_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Search:
    """What was found.

    Attributes:
        states: from the model that was asked about to the last one; each has one effect more.
        added: names, in the order of the steps, the most helpful first. rivals: of each addition, those that fit as well.
        rounds: every look, first to last. evidence: for each addition, beside all others.
        left_out: names of what promises much beside all that, and wasn't tried or settled. spent: whether because the search had
            done all the work that it may; if not, because no more effects were asked for.
    """

    states: tuple[State, ...]
    added: tuple[str, ...]
    rivals: dict[str, tuple[str, ...]]
    rounds: tuple[Round, ...]
    evidence: dict[str, Evidence]
    left_out: tuple[str, ...] = ()
    spent: bool = False


@dataclass(frozen=True, eq=False)
class Trail:
    """What a search came by, before rivals are looked for.

    Attributes:
        first, last: the model that was asked about, and with all additions. added, rounds, spent: as of `Search`.
        unsettled: names of what is believed, but was left out because there was no work left to hold it against the others.
        full: whether no more effects were asked for. forced, spare: as `search` takes them. met: on the way.
    """

    first: State
    last: State
    added: tuple[str, ...]
    rounds: tuple[Round, ...]
    unsettled: tuple[str, ...]
    full: bool
    spent: bool
    forced: Sequence[str]
    spare: Sequence[str]
    met: _Met

    @cached_property
    def end(self) -> Search:
        """What it comes to: with rivals, and each addition where it helps most."""
        rounds = self.rounds
        if not rounds or rounds[-1].before is not self.last or not rounds[-1].points:
            rounds = (*rounds, self.met.look(self.last, spare=self.spare, most=0))
        tried = {t.effect.id for t in rounds[-1].tried}
        promising = [c.effect.id for c in rounds[-1].screened if c.gain > WANTED and c.effect.id not in tried]
        left_out = (*self.unsettled, *promising) if self.full or self.spent else ()
        self.met.effort.allow(RIVALS)
        state, added, rivals, evidence = _rivals(self.last, self.added, self.forced, self.spare, self.met)
        ladder, order = _ladder(self.first, state, added, self.met)
        return Search(tuple(ladder), tuple(order), rivals, rounds, evidence, left_out, self.spent)


def search(start: State, effort: Effort, *, most: int = 4, forced: Sequence[str] = (), spare: Sequence[str] = (),
           progress: Callable[[str], None] = lambda _: None) -> Trail:  # fmt: skip
    """Add effects while held-out evidence asks for more.

    Args:
        start: the model as the user has it, fitted. effort: that may be spent on it. most: effects to add.
        forced: names to add first, whatever the evidence.
        spare: names that are out of the question. progress: told what is being done.
    """
    states, rounds, added, paired = [start], [], [], False
    unsettled: tuple[str, ...] = ()
    met = _Met([start], effort)
    for name in forced:
        progress(f"adding {name}")
        points = worth_searching(states[-1], screen(states[-1], effects.get(name)))
        found = min((attempt(states[-1], point.effect, point) for point in points), key=lambda t: t.state.cost)
        states.append(pursue(states[-1], found).state)
        added.append(name)
    # an effect that is defended away may come back, but not for ever
    for _ in range(most + EXTRA_ROUNDS):
        if len(added) >= most or not effort.lasts():
            break
        progress(f"looking for what {' + '.join(['the model', *added])} lacks")
        seen = met.look(states[-1], spare=spare)
        rounds.append(seen)
        good = believed(states[-1], seen.tried)
        effort.spend(sum(t.state.plain.work for t in seen.tried if t.evidence.sure))
        if len(added) >= SEVERAL and states[-1].rms > LOUD:
            good = [t for t in good if t.state.rms < (1.0 - CRUMB) * states[-1].rms]
        if len(added) >= SEVERAL and good and not effort.lasts():
            unsettled = tuple(t.effect.id for t in good)
            break
        good = good or _biased(seen)
        steps = [_simplest(good)] if good else _together(seen, spare, met) if not paired and len(added) + 2 <= most else []
        if not steps:
            break
        paired = paired or len(steps) > 1
        states.append(steps[-1].state)
        added += [step.effect.id for step in steps]
        progress(f"defending {', '.join(added)}")
        states, added = _defend(states[0], states[-1], added, forced, spare, met)
        if states[-1] is not states[0] and effort.lasts(REFITTING * weight_of(states[-1].model, start.problem)):
            states[-1] = _afresh(states[-1], effort)
            met.note([states[-1]])
    return Trail(start, states[-1], tuple(added), tuple(rounds), unsettled, len(added) >= most, effort.short,
                 forced, spare, met)  # fmt: skip


def _simplest(good: Sequence[Tried]) -> Tried:
    """Of those that fit as well as the best, the one with the fewest parameters.

    The best has the most evidence; but what leaves far less error than that comes first: evidence, bounded for each sample,
    counts how many come near, and far from noise a wrong law may bring more of them near than the right one beside its faults.
    """
    best = min(good, key=lambda t: t.state.rms)
    best = best if best.state.rms < FAR_LESS * good[0].state.rms else good[0]
    alike = [t for t in good if t is best or _alike(t, best.state, best.evidence)]
    return min(alike, key=lambda t: (len(t.state.values), -t.evidence.value))


def _biased(found: Round) -> list[Tried]:
    """A bias beyond its tolerance, most of which calibration took: next to nothing is left then.

    Where more is left, what a law of another form leaves may look like one.
    """
    before, bias = found.before, effects.get(BIAS)
    left = before.cost > NEAR_NOISE * len(before.residual)
    near = float(np.linalg.norm(before.shift)) < AT_ENDS or not calibration_shows(before)
    if left or near or bias.id not in found.points:
        return []
    tried = next((t for t in found.tried if t.effect is bias), None) or attempt(before, bias, screen(before, bias)[0])
    evidence = as_stated(before, tried.state, bias)
    return [dataclasses.replace(tried, evidence=evidence)] if evidence else []


def _together(found: Round, spare: Sequence[str], met: _Met) -> list[Tried]:
    """Two effects that explain together what neither does alone, where much is left: from those that alone leave least.

    The one, then the other beside it; nothing where no two do.
    """
    before = found.before
    if before.rms < LOUD:
        return []
    goal = FAR_LESS**2 * before.cost  # what two must come down to
    alone = sorted((t for t in found.tried if t.state.rms < ALONE * before.rms), key=lambda t: t.state.rms)[:PAIRED]
    pairs = [(one, other, weigh(before, other.state)) for one in alone
             for other in met.look(one.state, spare=spare, most=DEFENDED, goal=goal).tried if not at_end(other)]  # fmt: skip
    far = [[one, other] for one, other, evidence in pairs if evidence.sure and evidence.left < FAR_LESS]
    return min(far, key=lambda pair: pair[1].state.rms, default=[])


class _Met:
    """What the search came by: the best fit of each model, which may end at several optima, and what was seen from each fit."""

    def __init__(self, states: Sequence[State], effort: Effort) -> None:
        self.effort = effort
        self._best: dict[frozenset[str], State] = {}
        self._seen: dict[State, Round] = {}
        self._less: dict[tuple[State, str], State] = {}
        self.note(states)

    def note(self, states: Sequence[State]) -> None:
        """Remember states, the best of each model; what isn't better by as much as an addition must bring is the same fit."""
        for state in states:
            names = frozenset(state.model.names)
            if names not in self._best or state.cost < self._best[names].cost - ENOUGH:
                self._best[names] = state

    def best(self, names: Iterable[str]) -> State | None:
        """Of the model of these effects; None where the search didn't come by it."""
        return self._best.get(frozenset(names))

    def look(self, state: State, *, most: int = REFITTED, spare: Sequence[str] = (), goal: float = np.inf,
             like: str = "") -> Round:
        """A look that does nothing twice."""
        known = self._seen.get(state)
        if most and known is None and not self.effort.lasts(SCREENING * weight_of(state.model, state.problem)):
            return Round(state, {}, ())
        found = look(state, self.effort, most=most, spare=spare, known=known, goal=goal, like=like)
        self.note([t.state for t in found.tried])
        tried = {t.effect.id: t for t in (*(known.tried if known else ()), *found.tried)}
        self._seen[state] = Round(state, {**(known.points if known else {}), **found.points}, tuple(tried.values()))
        return found

    def without(self, state: State, name: str) -> State:
        """The same model less one effect, and less what can't act without it: as met or refitted, whichever fits better."""
        if (state, name) not in self._less:
            less = _without(state, name)
            self.effort.spend(less.work)
            self.note([less])
            self._less[state, name] = less
        less = self._less[state, name]
        return self.best(less.model.names) or less


def _without(state: State, name: str) -> State:
    """The same model less one effect, and less those that can't act without it, refitted."""
    gone = {name} | {e.id for e in state.model.effects if e.wants and not any(w in state.model and w != name for w in e.wants)}
    if name not in state.model:
        return state
    kept = [part for effect, part in zip(state.model.effects, _parts(state)) if effect.id not in gone]
    model = Model(*(effect for effect in state.model.effects if effect.id not in gone))
    return fit(state.problem, model, np.concatenate([np.zeros(0), *kept]), shift=state.shift)


def _afresh(state: State, effort: Effort) -> State:
    """The same model from its usual start, where that ends lower: an addition may have begun far from where it belongs."""
    problem, layout = state.problem, state.problem.experiment.layout
    named = state.model.parameters(layout)
    if state.cost < NEAR_NOISE * len(state.residual) or all(p.linear for p in named.values()):
        return state
    values, _ = starting_values(state.model, problem.experiment, named, None)
    found = fit(problem, state.model, settled(problem, state.model, values))
    effort.spend(found.work)
    return found if found.cost < LOWER * state.cost else state


def _parts(state: State) -> list[Array]:
    ends = np.cumsum([len(e.parameters(state.problem.experiment.layout)) for e in state.model.effects])
    return np.split(state.values, ends[:-1])


def _defend(first: State, state: State, added: list[str], forced: Sequence[str], spare: Sequence[str],
            met: _Met) -> tuple[list[State], list[str]]:  # fmt: skip
    """Each addition against being left out, and against every other effect in its place."""
    for name in [n for n in added if n not in forced]:
        if len(added) == 1:
            break
        if name not in added:
            continue
        less = met.without(state, name)
        mine = weigh(less, state)
        if _vanished(state, name) or not (mine.sure or as_stated(less, state, effects.get(name))):
            added = [n for n in added if n in less.model]
            state = less
            continue
        others = met.look(less, spare=[*spare, name], most=DEFENDED, goal=state.cost)
        better = [t for t in others.tried if _displaces(t, state, mine) and accepted(less, t)]
        if better:
            state = better[0].state
            added = [n for n in (better[0].effect.id if n == name else n for n in added) if n in state.model]
    return [first, state], added


def _displaces(other: Tried, state: State, mine: Evidence) -> bool:
    """Whether another effect takes the place of one: it fits better, or as well with fewer parameters."""
    if len(other.state.values) < len(state.values) and _alike(other, state, mine):
        return True
    return other.evidence.value > mine.value + BETTER and other.state.rms < state.rms


def _vanished(state: State, name: str) -> bool:
    """Whether an effect does nothing any more beside those that came after it."""
    layout = state.problem.experiment.layout
    effect = effects.get(name)
    parameters = effect.parameters(layout)
    own = state.own(name)
    null = amplitudes(effect, layout, base_of(state.model))
    if not null:
        return False
    # with calibration free, or as it was stated
    return any(all(abs(fitted.values[own][i] - zero) < 1e-3 * parameters[i].scale for i, zero in null.items())
               for fitted in (state, state.plain.light()))  # fmt: skip


def _rivals(state: State, added: Sequence[str], forced: Sequence[str], spare: Sequence[str],
            met: _Met) -> tuple[State, list[str], dict[str, tuple[str, ...]], dict[str, Evidence]]:  # fmt: skip
    """Of each addition, the effects that fit as well in its place; where one of them is more plausible, it takes the place."""
    rivals: dict[str, tuple[str, ...]] = {}
    evidence, named = {}, list(added)
    for place, name in enumerate(added):
        less = met.without(state, name)
        others = met.look(less, spare=[*spare, name], goal=state.cost, like=name)
        mine = weigh(less, state)
        mine = mine if mine.sure else as_stated(less, state, effects.get(name)) or mine
        near = [t for t in others.tried if t.effect.id != name and _hardly_apart(t, state, mine) and possible(less, t.state)]
        if name in forced and not mine.sure:
            near = []  # all that does more than nothing would be as good
        ids = [t.effect.id for t in near]
        better = None if name in forced else _more_plausible(state, name, [t for t in near if _alike(t, state, mine)])
        if better is not None:
            ids[ids.index(better.effect.id)] = name
            named[place], state, mine = better.effect.id, better.state, better.evidence
        rivals[named[place]], evidence[named[place]] = tuple(ids), mine
    return state, named, rivals, evidence


def _more_plausible(state: State, name: str, alike: Sequence[Tried]) -> Tried | None:
    """Of rivals that fit as well with as many parameters, the one whose size is the most usual; None where none is more so."""
    before = plausibility(state, effects.get(name))
    gains = [(plausibility(t.state, t.effect) - before - weigh(t.state, state).value, t) for t in alike
             if len(t.state.values) == len(state.values) and t.evidence.sure]  # fmt: skip
    gain, best = max(gains, key=lambda pair: pair[0], default=(0.0, None))
    for _, other in gains:
        other.state.light()
    return best if gain > 0.0 else None


def _alike(rival: Tried, state: State, mine: Evidence, errors: float = ALIKE_SE, least: float = ALIKE) -> bool:
    """Whether a rival fits as well: within so many standard errors, or so much evidence, and without far more left."""
    difference = weigh(rival.state, state)
    close = max(least, min(errors * difference.error, CLOSE * mine.value))
    # a few blocks may tell two apart that one alone isn't sure of
    stands = rival.evidence.sure or rival.evidence.value > max(ENOUGH, HALF * mine.value)
    return bool(difference.value < close and stands and difference.left > FAR_LESS)


def _hardly_apart(rival: Tried, state: State, mine: Evidence) -> bool:
    """Whether a rival fits nearly as well: its law may be the true one, in another form than the catalogue's."""
    if _alike(rival, state, mine, HARDLY_SE, max(ALIKE, min(FORM * mine.value, FORMS))):
        return True
    near = _alike(rival, state, mine, np.inf, ALIKE)
    return near and shown_error(rival.state) < (1.0 + SAME) * shown_error(state)


def _ladder(first: State, last: State, added: Sequence[str], met: _Met) -> tuple[list[State], list[str]]:
    """States from the first to the last, one addition more at a time, and the additions in that order: each is the one
    that lowers the held-out error most.
    """
    states: list[State] = [first]
    order: list[str] = []
    while len(order) < len(added):
        further = [(name, _with(states[-1], last, name, added, met)) for name in added
                   if name not in order and _can_stand(name, states[-1].model)]  # fmt: skip
        # the other states of a step are not needed again: their sensitivities are most of the memory
        name, state = min(further, key=lambda pair: shown_error(pair[1].light(), exact=True)) if len(further) > 1 else further[0]
        states.append(state)
        order.append(name)
    return states, order


def _can_stand(name: str, model: Model) -> bool:
    """Whether an effect has what it acts on."""
    wants = effects.get(name).wants
    return not wants or any(w in model for w in wants)


def _with(state: State, last: State, name: str, added: Sequence[str], met: _Met) -> State:
    """A state's model with one addition: as it was met, or the last model less the other additions, whichever fits better."""
    names = {*state.model.names, name}
    known = met.best(names)
    if set(added) <= names:
        return last
    if known is not None and known.converged:
        return known
    less = last
    for other in (n for n in reversed(added) if n not in names):
        less = _without(less, other)
    return less if known is None or less.cost < known.cost else known
