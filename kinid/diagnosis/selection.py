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
from kinid.diagnosis.choice import (
    MAX_ALTERNATIVES,
    MIN_GAIN_SHARE,
    REST_FORM_REFITS,
    acceptable,
    by_error,
    choose,
    evident,
    implausible,
    remarkable,
    required_share,
    required_significance,
)
from kinid.diagnosis.rivals import indistinguishable
from kinid.diagnosis.screening import Candidate, screen, screen_catalogue
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.identification.estimation import estimate_problem
from kinid.identification.lack_of_fit import brings_inside, error_rows, inside_tolerance, much_left
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.model import Model
from kinid.parallel import parallel_map

Array = NDArray[np.float64]

#: a reported error rises where its square is so many times the one before
MAX_ERROR_RISE = 1.01
#: effects that may stand for others; where more were needed, what is left is of many kinds
FEW = 2
#: share of the squared error that another way has to take off
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
        pruned: names that later additions made needless. skipped: names that this way does without. fits: of models by
            their names, from nothing.
    """

    states: list[State]
    added: list[str] = field(default_factory=list)
    evidence: dict[str, Evidence] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    rounds: list[Screening] = field(default_factory=list)
    unsupported: dict[str, str] = field(default_factory=dict)
    pruned: set[str] = field(default_factory=set)
    skipped: frozenset[str] = frozenset()
    fits: dict[tuple[str, ...], State] = field(default_factory=dict)


def lowers_error(after: State, before: State) -> bool:
    """Whether the reported error doesn't rise."""
    return _reported(after) <= MAX_ERROR_RISE * _reported(before)


def _reported(state: State) -> float:
    """Mean square of the error that is reported: held out, at the log's own rate and not weighed."""
    return float(np.nanmean(held_out_residual(state)[error_rows(state.problem.whole)] ** 2))


def screen_and_refit(state: State, settings: DiagnosisSettings, skipped: frozenset[str] = frozenset()) -> Screening:
    """Screen the catalogue and refit what promises most; and what does beside that, where it is but as usual."""
    points = screen_catalogue(state, skipped)
    refits = _promising(state, points, settings)
    # one that is more ends the question: asking costs a search each
    if refits and all(evident(t, state, settings) and not remarkable(t, settings) for t in refits):
        usual = {t.effect.id for t in refits}
        refits += _promising(state, {name: at for name, at in points.items() if name not in usual}, settings)
    return Screening(state, points, tuple(sorted(refits, key=by_error)))


def _promising(state: State, points: dict[str, list[Candidate]], settings: DiagnosisSettings) -> list[Refit]:
    """Refits of the points that promise most."""
    ranked = sorted((c[0] for c in points.values()), key=lambda c: -c.predicted_gain)
    least = max(
        settings.min_significance**2 / 4, settings.promising_share * (ranked[0].predicted_gain if ranked else 0.0)
    )
    promising = [c.effect.id for c in ranked if c.predicted_gain > least][: settings.refits]
    samples = len(state.problem.whole.signals)
    refits = sorted(parallel_map(lambda name: refit(state, points[name]), promising, samples), key=by_error)
    # beside the right effect, friction at rest may have another form than beside the wrong ones
    refits[:REST_FORM_REFITS] = parallel_map(acceptance.with_best_rest_form, refits[:REST_FORM_REFITS], samples)
    return refits


def best_end(candidate: Refit, fits: dict[tuple[str, ...], State]) -> Refit | None:
    """A refit with its own error model, or a fit of its model from initial guesses, whichever leaves less and doesn't
    raise the reported error; None where both do.

    Such fits are kept in `fits`.
    """
    model, before = candidate.state.model, candidate.before
    fit = fits[model.names] = within_possible(estimate_problem(model, before.problem), before)
    ends = sorted((candidate.relearnt, candidate.ended(fit)), key=by_error)
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
    if forced:
        return found
    found = _other_way(found, settings, progress) or found
    return _with_fewer(found, settings, progress) or found


def _grow(
    found: Selection, settings: DiagnosisSettings, forced: Sequence[str], progress: Callable[[str], None]
) -> None:
    """Add effects until none is worth a name; then swap and take back."""
    while True:
        progress("screening the catalogue" if not found.added else f"screening beside {', '.join(found.added)}")
        screening = screen_and_refit(found.states[-1], settings, found.skipped)
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


def _with_fewer(found: Selection, settings: DiagnosisSettings, progress: Callable[[str], None]) -> Selection | None:
    """The way without an effect of many parameters, where others with fewer leave nothing that it is worth a name for.

    What copies each channel into each other one stands for several effects at once, and hides them.
    """
    last = found.states[-1]
    shares = {name: required_share(last.model[name], last, settings) for name in found.added}
    many = {name: least for name, least in shares.items() if least > settings.min_share}
    if not many:
        return None
    other = Selection([found.states[0]], fits=found.fits, skipped=frozenset(many))
    _grow(other, settings, (), progress)
    one = other.states[-1]
    share = max(compare_states(one, last, one.error.sigma).share, 1.0 - _reported(last) / _reported(one))
    fewer = len(one.values) < len(last.values)
    return other if fewer and share < max(many.values()) else None


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
    """Take back additions that others made needless; last, usual ones and doubtful ones that take little, too.

    Of several that are needless beside each other the one goes without which least is left; of those without which as
    little is left, the one with the most parameters.
    """
    while True:
        shorter = {name: _without(found, name, settings, last) for name in found.added if name not in keep}
        needless = {name: reduced for name, reduced in shorter.items() if reduced is not None}
        if not needless:
            return
        left = {name: _reported(reduced) for name, reduced in needless.items()}
        equals = [name for name in left if left[name] <= MAX_ERROR_RISE * min(left.values())]
        name = min(equals, key=lambda n: (len(needless[n].values), found.evidence[n].gain))
        found.alternatives.pop(name, None)
        found.pruned.add(name)
        found.added.remove(name)
        found.states[-1] = relearn_errors(needless[name])


def _without(found: Selection, name: str, settings: DiagnosisSettings, last: bool) -> State | None:
    """The last state without an addition, refitted, where that is needless; None where it isn't.

    No law has exactly the form of a material or a machine: inside the tolerance, what leaves much has to be beyond
    doubt. Beside other additions, of all that is left; alone, of what is beyond noise.
    """
    best = found.states[-1]
    if not removable(best.model, name):
        return None
    reduced = without_effect(best, name)
    if implausible(reduced, best):  # the others would have to stand in for it
        return None
    found.evidence[name] = evidence = compare_states(reduced, best, best.error.sigma)
    needed, small = required_significance(evidence, settings), False
    if last and inside_tolerance(reduced):
        taken = evidence.beyond if len(found.added) == 1 else 1.0 - _reported(best) / _reported(reduced)
        needed = max(needed, settings.beyond_doubt * (1.0 - taken))
        small = taken < settings.explains or best.model[name].tolerated_at_any_share(best.problem.layout)
    # what seemed much beside a model that lacked others may be no more than every rig has
    usual = (
        last
        and not brings_inside(reduced, best)
        and not remarkable(Refit(best.model[name], reduced, best, evidence), settings, small)
    )
    enough = evidence.significance >= needed and evidence.share >= required_share(best.model[name], best, settings)
    return reduced if usual or not enough else None


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
            screening = _beside_its_rivals(reduced, name, settings, found.skipped)
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


def _beside_its_rivals(state: State, name: str, settings: DiagnosisSettings, skipped: frozenset[str]) -> Screening:
    """Screen the catalogue and refit an effect, those of the largest predicted gain, and those of one like its own."""
    points = screen_catalogue(state, skipped)
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
