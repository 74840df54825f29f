"""From a model to the model with what it lacks: screen, refit, accept, prune, until nothing is worth a name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis import acceptance
from kinid.diagnosis.acceptance import Evidence, Refit, compare_states, refit, settle, within_possible, without
from kinid.diagnosis.screening import Candidate, screen, screen_catalogue
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.identification.estimation import estimate_problem
from kinid.identification.lack_of_fit import error_rows, inside_tolerance
from kinid.identification.nuisance import MAX_SHIFT
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.applicability import amplitudes, base_of
from kinid.modeling.model import Model
from kinid.parallel import parallel_map

Array = NDArray[np.float64]

#: a reported error rises where its square is so many times the one before
RISES = 1.01
#: refits whose form of friction at rest is chosen anew; rivals of the best, each of which gains this share of what that
#: does
REFORMED, MAX_RIVALS, RIVAL_SHARE = 2, 3, 0.5


@dataclass(eq=False)
class Round:
    """One screening of the catalogue from one state: points of every effect, and the refits, the best first."""

    before: State
    points: dict[str, list[Candidate]]
    refits: tuple[Refit, ...]


@dataclass(eq=False)
class Selection:
    """What was found.

    Attributes:
        states: from the model that was asked about to the last one. added: names, in their order.
        evidence: of each addition beside all others. alternatives: of each, those that fit as well.
        rounds: every look. unsupported: of names that were added because they were asked for, and that the log doesn't
            support, why.
        pruned: names that later additions made needless. fits: of models by their names, from nothing.
    """

    states: list[State]
    added: list[str] = field(default_factory=list)
    evidence: dict[str, Evidence] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rounds: list[Round] = field(default_factory=list)
    unsupported: dict[str, str] = field(default_factory=dict)
    pruned: set[str] = field(default_factory=set)
    fits: dict[tuple[str, ...], State] = field(default_factory=dict)


def implausible(state: State, before: State | None = None) -> str:
    """Why the values of a state are none that a material or a machine has, in words; "" where they are possible."""
    if not np.isfinite(state.cost):
        return "what they predict is no number"
    known = {effect.id for effect in before.model.effects if acceptance.why_not(before, effect)} if before else set()
    new = [effect for effect in state.model.effects if effect.id not in known]
    return next((why for effect in new if (why := acceptance.why_not(state, effect))), "")


def acceptable(tried: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit is beyond doubt, worth a name, and physically possible."""
    e = tried.evidence
    # what takes off most of the error leaves less that could speak against it
    needed = settings.min_significance * max(0.5, 1.0 - e.share)
    return (
        e.significance > needed
        and e.share > settings.min_share
        and e.change > settings.min_reading_share
        and not implausible(tried.state, before)
        and _remarkable(tried, settings)
    )


def _remarkable(tried: Refit, settings: DiagnosisSettings) -> bool:
    """Whether the log says more of a refitted effect than that it is as large as in every material and every rig."""
    state, effect, layout = tried.state, tried.effect, tried.state.problem.layout
    values, parameters = state.values[state.model.place(effect.id, layout)], effect.parameters(layout)
    null = amplitudes(effect, layout, base_of(state.model))
    open_ = effect.calibration_sd(state.problem.experiment.signals)
    usual = {i: max(effect.usual(parameters[i]), MAX_SHIFT * open_.get(parameters[i].name, 0.0)) for i in null}
    beyond = [i for i in null if abs(values[i] - null[i]) > usual[i]]
    if not beyond or any(not usual[i] for i in beyond):
        return bool(beyond)
    ranges = [
        (null[i] - usual[i], null[i] + usual[i]) if i in null else (-np.inf, np.inf) for i in range(len(parameters))
    ]
    evidence = compare_states(acceptance.bounded(state, {effect.id: ranges}, state), state, state.error.sigma)
    return evidence.significance > settings.min_significance and evidence.share > settings.min_share


def lowers_error(after: State, before: State) -> bool:
    """Whether the reported error, held out, at the log's own rate and not weighed, doesn't rise."""
    rows = error_rows(before.problem.whole)
    old, new = (float(np.nanmean(held_out_residual(state)[rows] ** 2)) for state in (before, after))
    return new <= RISES * old


def look(state: State, settings: DiagnosisSettings) -> Round:
    """Screen the catalogue and refit what promises most."""
    points = screen_catalogue(state)
    ranked = sorted((c[0] for c in points.values()), key=lambda c: -c.predicted_gain)
    least = max(
        settings.min_significance**2 / 4, settings.promising_share * (ranked[0].predicted_gain if ranked else 0.0)
    )
    promising = [c.effect.id for c in ranked if c.predicted_gain > least][: settings.refits]
    tried = sorted(parallel_map(lambda name: refit(state, points[name]), promising), key=_rank)
    # beside the right effect, friction at rest may have another form than beside the wrong ones
    tried[:REFORMED] = parallel_map(acceptance.reformed, tried[:REFORMED])
    return Round(state, points, tuple(sorted(tried, key=_rank)))


def choose(tried: Sequence[Refit], before: State, settings: DiagnosisSettings) -> Refit | None:
    """The acceptable refit that leaves the least; of those that fit as well, the one with the fewest parameters.

    The best are compared by their settled states: what a channel weighs beside the right effect it doesn't beside the
    wrong ones.
    """
    able = [t for t in tried if acceptable(t, before, settings)]
    able = [t for t in able if t.evidence.gain > RIVAL_SHARE * max(a.evidence.gain for a in able)]
    if len(able) < 2:
        return able[0] if able else None
    settled = parallel_map(lambda t: t.settled, able[:MAX_RIVALS])
    best = min(settled, key=_rank)
    # of two where one is a part of the other, the part comes first: the rest of it has to prove itself beside that
    part = next((t for t in able if t.effect.id in best.effect.holds), None)
    if part is not None:
        return part.settled
    alike = [t for t in settled if same(best, t, best.state.error.sigma, settings)]
    return min(alike, key=lambda t: (len(t.state.values), -t.evidence.gain))


def _rank(tried: Refit) -> tuple[float, float]:
    """What a refit leaves; where several leave nothing but noise, what they gain."""
    return tried.evidence.left, -tried.evidence.gain


def deeper(tried: Refit, fits: dict[tuple[str, ...], State]) -> Refit:
    """A settled refit, or where a fit of its model ends that knows nothing of the way here, whichever leaves less.

    Such fits are kept in `fits`.
    """
    model, before = tried.state.model, tried.before
    fit = fits[model.names] = within_possible(
        estimate_problem(model, before.problem), set(model.names) - {*before.model.names}
    )
    return min(tried.settled, tried.ended(fit), key=lambda t: t.evidence.left)


def same(one: Refit, other: Refit, sigma: Array, settings: DiagnosisSettings) -> bool:
    """Whether the log can't tell two refits of one state apart, with errors weighed by σ (channels, g)."""
    between = compare_states(other.state, one.state, sigma)
    return (
        abs(between.gain) <= settings.rival_significance * between.error or abs(between.share) <= settings.rival_share
    )


def select(
    start: State,
    settings: DiagnosisSettings,
    forced: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Add effects while each is beyond doubt and worth a name.

    Args:
        start: the model that was asked about, fitted. forced: effects to add whatever the evidence says.
        progress: called with each stage, in words.
    """
    found = Selection([start])
    for name in forced:
        before = found.states[-1]
        asked = refit(before, screen(before, effects.get(name)))
        _add(found, replace(asked, state=settle(asked.state)))
        if why := _unsupported(found.evidence[name], found.states[-1], before, settings):
            found.unsupported[name] = why
    while True:
        progress("screening the catalogue" if not found.added else f"screening beside {', '.join(found.added)}")
        now = look(found.states[-1], settings)
        found.rounds.append(now)
        # what later additions made needless doesn't come back
        worth = [t for t in now.refits if t.effect.id not in found.pruned]
        best = choose(worth, now.before, settings) if len(found.added) < settings.max_effects else None
        if best is None:
            break
        best = deeper(best, found.fits)
        if not lowers_error(best.state, now.before):
            found.pruned.add(best.effect.id)
            continue
        _add(found, best)
        _prune(found, settings, keep={*forced, best.effect.id})
    _defend(found, settings, forced)
    _prune(found, settings, keep=set(forced), last=True)
    return found


def removable(model: Model, name: str) -> bool:
    """Whether no other effect of a model acts on this one alone."""
    rest = [effect for effect in model.effects if effect.id != name]
    return all(not effect.wants or any(other.id in effect.wants for other in rest) for effect in rest)


def _add(found: Selection, best: Refit) -> None:
    found.states.append(best.state)
    found.added.append(best.effect.id)
    found.evidence[best.effect.id] = best.evidence


def _unsupported(evidence: Evidence, state: State, before: State, settings: DiagnosisSettings) -> str:
    """Why an addition that was asked for isn't borne out, in words; "" where it is."""
    if evidence.significance <= settings.min_significance or evidence.share <= settings.min_share:
        return "brings nothing that chance wouldn't"
    why = implausible(state, before)
    return f"helps only with a value that no material or machine has: {why}" if why else ""


def _prune(found: Selection, settings: DiagnosisSettings, keep: set[str], last: bool = False) -> None:
    """Take back additions that others made needless; last, inside the tolerance, doubtful ones that take little."""
    for name in [n for n in found.added if n not in keep]:
        best = found.states[-1]
        if not removable(best.model, name):
            continue
        less = without(best, name)
        if implausible(less, best):  # the others would have to stand in for it
            continue
        found.evidence[name] = evidence = compare_states(less, best, best.error.sigma)
        least = settings.min_significance
        if last and inside_tolerance(less):
            least = max(least, settings.beyond_doubt * (1.0 - evidence.beyond))
        if evidence.significance < least or evidence.share < settings.min_share:
            found.alternatives.pop(name, None)
            found.pruned.add(name)
            found.added.remove(name)
            found.states[-1] = settle(less)


def _defend(found: Selection, settings: DiagnosisSettings, forced: Sequence[str]) -> None:
    """Hold each addition against its alternatives: swap it where another is better, name those as good."""
    for held in list(found.added):
        name, last = held, found.states[-1]
        if not removable(last.model, name):
            continue
        if len(found.added) == 1 and not forced:
            now, less = found.rounds[0], found.rounds[0].before
        else:
            less = without(last, name)
            if implausible(less, last):
                continue
            now = look(less, replace(settings, refits=MAX_RIVALS, promising_share=RIVAL_SHARE))
        own = next((t for t in now.refits if t.effect.id == name), None)
        if own is None:
            own = Refit(last.model[name], less, last, compare_states(less, last, less.error.sigma))
        found.evidence[name] = own.evidence
        if name in forced:
            continue
        better = choose(
            [t for t in now.refits if t.effect.id not in found.added or t.effect.id == name], less, settings
        )
        if better is not None and better.effect.id != name and _preferred(better, own, less, settings):
            found.states[-1] = better.settled.state
            found.added[found.added.index(name)] = better.effect.id
            found.evidence[better.effect.id] = better.evidence
            own, name = better, better.effect.id
        rivals = [t for t in now.refits if t.effect.id not in {name, *found.added} and name not in t.effect.generalises]
        found.alternatives[name] = tuple(
            t.effect.id for t in rivals if same(own, t, less.error.sigma, settings) and acceptable(t, less, settings)
        )


def _preferred(other: Refit, held: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether another effect replaces an added one: it leaves less, or as much with fewer parameters."""
    if same(other, held, before.error.sigma, settings):
        return len(other.state.values) < len(held.state.values)
    return other.evidence.left < held.evidence.left
