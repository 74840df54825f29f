"""From a model to the model with what it lacks: screen, refit, accept, prune, until nothing is worth a name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis import acceptance
from kinid.diagnosis.acceptance import (
    Evidence,
    Refit,
    compare_states,
    refit,
    relearn_errors,
    within_possible,
    without_effect,
)
from kinid.diagnosis.rivals import MIN_OVERLAP, covers, indistinguishable, overlap
from kinid.diagnosis.screening import Candidate, screen, screen_catalogue
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import Effect
from kinid.identification.estimation import estimate_problem
from kinid.identification.lack_of_fit import error_rows, inside_tolerance, much_left
from kinid.identification.nuisance import MAX_SHIFT
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.applicability import amplitudes, base_of
from kinid.modeling.model import Model
from kinid.parallel import parallel_map

Array = NDArray[np.float64]

#: a reported error rises where its square is so many times the one before
MAX_ERROR_RISE = 1.01
#: refits whose form of friction at rest is chosen anew; alternatives to the best, and the share of its gain they need
REST_FORM_REFITS, MAX_ALTERNATIVES, MIN_GAIN_SHARE = 2, 3, 0.5
#: effects that may stand for others; where more were needed, what is left is of many kinds
FEW = 2
#: share of what is left by its own weights that an effect takes off that others' weights hide; and of the squared error
#: that another way has to take off
MOST = 0.5


@dataclass(eq=False)
class Screening:
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
        rounds: every screening. unsupported: why the log doesn't support names that were added on request.
        pruned: names that later additions made needless. fits: of models by their names, from nothing.
    """

    states: list[State]
    added: list[str] = field(default_factory=list)
    evidence: dict[str, Evidence] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rounds: list[Screening] = field(default_factory=list)
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


def acceptable(candidate: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit is evident, and more than what every material and every rig has of it."""
    return _evident(candidate, before, settings) and _remarkable(candidate, settings)


def _evident(candidate: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit is beyond doubt, worth a name, and physically possible."""
    e = candidate.evidence
    return (
        e.significance > _needed(e, settings)
        and e.share > _worth(candidate.effect, candidate.state, settings)
        and e.change > settings.min_reading_share
        and not implausible(candidate.state, before)
    )


def _worth(effect: Effect, state: State, settings: DiagnosisSettings) -> float:
    """Share that an effect must take off: what copies each channel into each other one bends to anything, a little."""
    layout = state.problem.layout
    a_channel = len(effect.parameters(layout)) / len(layout.channels) if effect.couples else 1.0
    return settings.min_share * max(1.0, a_channel)


def _needed(evidence: Evidence, settings: DiagnosisSettings) -> float:
    """Significance that a gain needs: what takes off most of the error leaves less that could speak against it."""
    return settings.min_significance * max(0.5, 1.0 - evidence.share)


def _remarkable(candidate: Refit, settings: DiagnosisSettings, tolerated: bool = False) -> bool:
    """Whether the log says more of a refitted effect than that it is as large as in every rig, or as is tolerated."""
    state, effect, layout = candidate.state, candidate.effect, candidate.state.problem.layout
    values, parameters = state.values[state.model.place(effect.id, layout)], effect.parameters(layout)
    null = amplitudes(effect, layout, base_of(state.model))
    open_ = effect.calibration_sd(state.problem.experiment.signals)
    usual = {i: max(effect.usual(parameters[i]), MAX_SHIFT * open_.get(parameters[i].name, 0.0)) for i in null}
    if tolerated:
        usual = {i: max(much, effect.tolerable(parameters[i])) for i, much in usual.items()}
    beyond = [i for i in null if abs(values[i] - null[i]) > usual[i]]
    if not beyond or any(not usual[i] for i in beyond):
        return bool(beyond)
    ranges = [
        (null[i] - usual[i], null[i] + usual[i]) if i in null else (-np.inf, np.inf) for i in range(len(parameters))
    ]
    evidence = compare_states(acceptance.bounded(state, {effect.id: ranges}, state), state, state.error.sigma)
    return evidence.significance > _needed(evidence, settings) and evidence.share > settings.min_share


def lowers_error(after: State, before: State) -> bool:
    """Whether the reported error doesn't rise."""
    return _reported(after) <= MAX_ERROR_RISE * _reported(before)


def _reported(state: State) -> float:
    """Mean square of the error that is reported: held out, at the log's own rate and not weighed."""
    return float(np.nanmean(held_out_residual(state)[error_rows(state.problem.whole)] ** 2))


def screen_and_refit(state: State, settings: DiagnosisSettings) -> Screening:
    """Screen the catalogue and refit what promises most; and what does beside that, where it is but as usual."""
    points = screen_catalogue(state)
    refits = _promising(state, points, settings)
    # one that is more ends the question: asking costs a search each
    if refits and all(_evident(t, state, settings) and not _remarkable(t, settings) for t in refits):
        usual = {t.effect.id for t in refits}
        refits += _promising(state, {name: at for name, at in points.items() if name not in usual}, settings)
    return Screening(state, points, tuple(sorted(refits, key=_rank)))


def _promising(state: State, points: dict[str, list[Candidate]], settings: DiagnosisSettings) -> list[Refit]:
    """Refits of the points that promise most."""
    ranked = sorted((c[0] for c in points.values()), key=lambda c: -c.predicted_gain)
    least = max(
        settings.min_significance**2 / 4, settings.promising_share * (ranked[0].predicted_gain if ranked else 0.0)
    )
    promising = [c.effect.id for c in ranked if c.predicted_gain > least][: settings.refits]
    refits = sorted(parallel_map(lambda name: refit(state, points[name]), promising), key=_rank)
    # beside the right effect, friction at rest may have another form than beside the wrong ones
    refits[:REST_FORM_REFITS] = parallel_map(acceptance.with_best_rest_form, refits[:REST_FORM_REFITS])
    return refits


def choose(refits: Sequence[Refit], before: State, settings: DiagnosisSettings) -> Refit | None:
    """The acceptable refit that leaves the least; of those that fit as well, the one with the fewest parameters.

    The best are compared with their own error models: what a channel weighs differs from model to model.
    """
    evident = [t for t in refits if _evident(t, before, settings)]
    if not evident:
        # weighed by what was left before, a channel that is right can lose more than one that is wrong can gain
        left = compare_states(before, before, before.error.sigma).left - settings.min_significance**2
        own = [t.weighed_by_its_own for t in refits[:REST_FORM_REFITS] if t.evidence.left < left]
        evident = [t for t in own if t.evidence.share > MOST and _evident(t, before, settings)]
    usual = [t for t in evident if not _remarkable(t, settings)]
    # what a usual amount of another effect explains as well is no finding
    accepted = [
        t for t in evident if t not in usual and not any(covers(u, t, before.error.sigma, settings) for u in usual)
    ]
    accepted = [t for t in accepted if t.evidence.gain > MIN_GAIN_SHARE * max(a.evidence.gain for a in accepted)]
    if len(accepted) < 2:
        return accepted[0] if accepted else None
    relearnt = parallel_map(lambda t: t.relearnt, accepted[:MAX_ALTERNATIVES])
    best = min(relearnt, key=_rank)
    # of two where one is a part of the other, the part comes first: the rest of it has to prove itself beside that
    part = next((t for t in accepted if t.effect.id in best.effect.includes), None)
    if part is not None:
        return part.relearnt
    equals = [
        t
        for t in relearnt
        if t is best
        or indistinguishable(best, t, best.state.error.sigma, settings)
        or _simpler(t, best, before, settings)
    ]
    return min(equals, key=lambda t: (len(t.state.values), -t.evidence.gain))


def _simpler(one: Refit, best: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit explains the same nearly as well, with so many parameters less that the rest isn't worth them.

    What bends to anything bends to what is off in every rig, too. Where it is the right one, it proves itself beside
    the simpler one, and makes that needless.
    """
    saved = len(best.state.values) - len(one.state.values)
    worth = 1.0 - settings.parameter_price * saved
    return (
        saved > 0
        and one.evidence.gain >= worth * best.evidence.gain
        and overlap(one, best, before.error.sigma) >= MIN_OVERLAP
    )


def _rank(candidate: Refit) -> tuple[float, float]:
    """What a refit leaves; where several leave nothing but noise, what they gain. Where predictions overflow, last."""
    left = candidate.evidence.left
    return (left, -candidate.evidence.gain) if np.isfinite(left) else (np.inf, 0.0)


def best_end(candidate: Refit, fits: dict[tuple[str, ...], State]) -> Refit | None:
    """A refit with its own error model, or a fit of its model from initial guesses, whichever leaves less and doesn't
    raise the reported error; None where both do.

    Such fits are kept in `fits`.
    """
    model, before = candidate.state.model, candidate.before
    fit = fits[model.names] = within_possible(estimate_problem(model, before.problem), before)
    ends = sorted((candidate.relearnt, candidate.ended(fit)), key=_rank)
    return next((end for end in ends if lowers_error(end.state, candidate.before)), None)


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
        _add(found, replace(asked, state=relearn_errors(asked.state)))
        if why := _unsupported(found.evidence[name], found.states[-1], before, settings):
            found.unsupported[name] = why
    _grow(found, settings, forced, progress)
    return found if forced else _other_way(found, settings, progress) or found


def _grow(
    found: Selection, settings: DiagnosisSettings, forced: Sequence[str], progress: Callable[[str], None]
) -> None:
    """Add effects until none is worth a name; then swap and take back."""
    while True:
        progress("screening the catalogue" if not found.added else f"screening beside {', '.join(found.added)}")
        screening = screen_and_refit(found.states[-1], settings)
        found.rounds.append(screening)
        # what later additions made needless doesn't come back
        eligible = [t for t in screening.refits if t.effect.id not in found.pruned]
        best = choose(eligible, screening.before, settings) if len(found.added) < settings.max_effects else None
        if best is None:
            break
        end = best_end(best, found.fits)
        if end is None:
            found.pruned.add(best.effect.id)
            continue
        _add(found, end)
        _prune(found, settings, keep={*forced, end.effect.id})
    _compare_alternatives(found, settings, forced)
    _prune(found, settings, keep=set(forced), last=True)


def _other_way(found: Selection, settings: DiagnosisSettings, progress: Callable[[str], None]) -> Selection | None:
    """The way that begins with the next best effect, where it halves the squared error; None elsewhere.

    One effect that stands for two is better than either alone, and either alone may explain too little to be found.
    """
    first, last = found.rounds[0], found.states[-1]
    others = [t for t in first.refits if t.effect.id not in found.added and not implausible(t.state, t.before)]
    if not others or len(found.added) > FEW or settings.max_effects < 2 or not much_left(last):
        return None
    other = Selection([first.before], rounds=[first], fits=found.fits)
    end = best_end(choose(others, first.before, settings) or others[0], found.fits)
    if end is None:
        return None
    _add(other, end)
    _grow(other, settings, (), progress)
    evidence = compare_states(last, other.states[-1], last.error.sigma)
    better = evidence.significance > settings.min_significance
    return other if better and _reported(other.states[-1]) < MOST * _reported(last) else None


def removable(model: Model, name: str) -> bool:
    """Whether no other effect of a model acts on this one alone."""
    rest = [effect for effect in model.effects if effect.id != name]
    return all(not effect.requires or any(other.id in effect.requires for other in rest) for effect in rest)


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
    """Take back additions that others made needless; last, usual ones and doubtful ones that take little, too."""
    for name in [n for n in found.added if n not in keep]:
        best = found.states[-1]
        if not removable(best.model, name):
            continue
        reduced = without_effect(best, name)
        if implausible(reduced, best):  # the others would have to stand in for it
            continue
        found.evidence[name] = evidence = compare_states(reduced, best, best.error.sigma)
        needed = _needed(evidence, settings)
        tolerated = last and inside_tolerance(reduced)
        if tolerated:
            needed = max(needed, settings.beyond_doubt * (1.0 - evidence.beyond))
        # what seemed much beside a model that lacked others may be no more than every rig has
        usual = last and not _remarkable(Refit(best.model[name], reduced, best, evidence), settings, tolerated)
        if usual or evidence.significance < needed or evidence.share < _worth(best.model[name], best, settings):
            found.alternatives.pop(name, None)
            found.pruned.add(name)
            found.added.remove(name)
            found.states[-1] = relearn_errors(reduced)


def _compare_alternatives(found: Selection, settings: DiagnosisSettings, forced: Sequence[str]) -> None:
    """Hold each addition against its alternatives: swap it where another is better, name those as good."""
    for added in list(found.added):
        name, last = added, found.states[-1]
        if not removable(last.model, name):
            continue
        alone = len(found.added) == 1 and not forced
        reduced = found.rounds[0].before if alone else without_effect(last, name)
        if not alone and implausible(reduced, last):
            continue
        if alone and any(t.effect.id == name for t in found.rounds[0].refits):
            screening = found.rounds[0]
        else:
            screening = _beside_its_rivals(reduced, name, settings)
        current = next((t for t in screening.refits if t.effect.id == name), None)
        if current is None:
            current = Refit(last.model[name], reduced, last, compare_states(reduced, last, reduced.error.sigma))
        found.evidence[name] = current.evidence
        if name in forced:
            continue
        other = choose(
            [t for t in screening.refits if t.effect.id not in found.added or t.effect.id == name], reduced, settings
        )
        if other is not None and other.effect.id != name and _preferred(other, current, reduced, settings):
            found.states[-1] = other.relearnt.state
            found.added[found.added.index(name)] = other.effect.id
            found.evidence[other.effect.id] = other.evidence
            current, name = other, other.effect.id
        others = [
            t for t in screening.refits if t.effect.id not in {name, *found.added} and name not in t.effect.generalises
        ]
        found.alternatives[name] = tuple(
            t.effect.id
            for t in others
            if indistinguishable(current, t, reduced.error.sigma, settings) and acceptable(t, reduced, settings)
        )


def _beside_its_rivals(state: State, name: str, settings: DiagnosisSettings) -> Screening:
    """Screen the catalogue and refit an effect, those of the largest predicted gain, and those of one like its own."""
    points = screen_catalogue(state)
    gains = {other: at[0].predicted_gain for other, at in points.items()}
    own, most = gains.get(name, 0.0), max(gains.values(), default=0.0)
    best = [n for n in sorted(gains, key=lambda n: -gains[n]) if gains[n] > MIN_GAIN_SHARE * most]
    alike = sorted((n for n in gains if gains[n] > MIN_GAIN_SHARE * own), key=lambda n: abs(gains[n] - own))
    chosen = {*best[:MAX_ALTERNATIVES], *alike[:MAX_ALTERNATIVES]}
    few = replace(settings, refits=len(chosen), promising_share=0.0)
    return Screening(state, points, tuple(_promising(state, {n: points[n] for n in points if n in chosen}, few)))


def _preferred(other: Refit, current: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether another effect replaces an added one: it leaves less, or as much with fewer parameters."""
    if indistinguishable(other, current, before.error.sigma, settings):
        return len(other.state.values) < len(current.state.values)
    return other.evidence.left < current.evidence.left
