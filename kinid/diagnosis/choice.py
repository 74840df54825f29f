"""Which refit is taken: what is evident, more than usual, possible, and of equals the simplest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinid.diagnosis import acceptance
from kinid.diagnosis.acceptance import Evidence, Refit, compare_states
from kinid.diagnosis.rivals import MIN_OVERLAP, covers, indistinguishable, overlap
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import Effect
from kinid.identification.lack_of_fit import brings_inside
from kinid.identification.nuisance import MAX_SHIFT
from kinid.identification.state import State
from kinid.modeling.applicability import amplitudes, base_of
from kinid.parallel import parallel_map

#: refits whose form of friction at rest is chosen anew; alternatives to the best, and the share of its gain they need
REST_FORM_REFITS, MAX_ALTERNATIVES, MIN_GAIN_SHARE = 2, 3, 0.5
#: share of what is left by its own weights that an effect takes off that others' weights hide
MOST = 0.5


def implausible(state: State, before: State | None = None) -> str:
    """Why the values of a state are none that a material or a machine has, in words; "" where they are possible."""
    if not np.isfinite(state.cost):
        return "what they predict is no number"
    known = {effect.id for effect in before.model.effects if acceptance.why_not(before, effect)} if before else set()
    new = [effect for effect in state.model.effects if effect.id not in known]
    return next((why for effect in new if (why := acceptance.why_not(state, effect))), "")


def acceptable(candidate: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit is evident, and more than what every material and every rig has of it, or all that mattered."""
    return evident(candidate, before, settings) and (
        brings_inside(before, candidate.state) or remarkable(candidate, settings)
    )


def evident(candidate: Refit, before: State, settings: DiagnosisSettings) -> bool:
    """Whether a refit is beyond doubt, worth a name, and physically possible."""
    e = candidate.evidence
    return (
        e.significance > required_significance(e, settings)
        and e.share > required_share(candidate.effect, candidate.state, settings)
        and e.change > settings.min_reading_share
        and not implausible(candidate.state, before)
    )


def required_share(effect: Effect, state: State, settings: DiagnosisSettings) -> float:
    """Share that an effect must take off: what copies each channel into each other one bends to anything, a little."""
    layout = state.problem.layout
    a_channel = len(effect.parameters(layout)) / len(layout.channels) if effect.couples else 1.0
    return settings.min_share * max(1.0, a_channel)


def required_significance(evidence: Evidence, settings: DiagnosisSettings) -> float:
    """Significance that a gain needs: what takes off most of the error leaves less that could speak against it."""
    return settings.min_significance * max(0.5, 1.0 - evidence.share)


def remarkable(candidate: Refit, settings: DiagnosisSettings, tolerated: bool = False) -> bool:
    """Whether the log says more of a refitted effect than that it is as large as in every rig, or as is tolerated."""
    state, effect, layout = candidate.state, candidate.effect, candidate.state.problem.layout
    values, parameters = state.values[state.model.place(effect.id, layout)], effect.parameters(layout)
    null = amplitudes(effect, layout, base_of(state.model))
    open_ = effect.calibration_sd(state.problem.experiment.signals)
    usual = {i: max(effect.usual(parameters[i]), MAX_SHIFT * open_.get(parameters[i].name, 0.0)) for i in null}
    if tolerated:
        usual = {i: max(much, effect.tolerable(parameters[i], layout)) for i, much in usual.items()}
    beyond = [i for i in null if abs(values[i] - null[i]) > usual[i]]
    if not beyond or any(not usual[i] for i in beyond):
        return bool(beyond)
    ranges = [
        (null[i] - usual[i], null[i] + usual[i]) if i in null else (-np.inf, np.inf) for i in range(len(parameters))
    ]
    evidence = compare_states(acceptance.bounded(state, {effect.id: ranges}, state), state, state.error.sigma)
    return evidence.significance > required_significance(evidence, settings) and evidence.share > settings.min_share


def choose(refits: Sequence[Refit], before: State, settings: DiagnosisSettings) -> Refit | None:
    """The acceptable refit that leaves the least; of those that fit as well, the one with the fewest parameters.

    The best are compared with their own error models: what a channel weighs differs from model to model.
    """
    taken = [t for t in refits if evident(t, before, settings)]
    usual = [t for t in taken if not remarkable(t, settings)]
    own: list[Refit] = []
    if len(usual) == len(taken):
        # weighed by what was left before, a channel that is right can lose more than one that is wrong can gain
        left = compare_states(before, before, before.error.sigma).left - settings.min_significance**2
        own = [t.weighed_by_its_own for t in refits[:REST_FORM_REFITS] if t.evidence.left < left and t not in usual]
        own = [t for t in own if t.evidence.share > MOST and evident(t, before, settings)]
        usual += [t for t in own if not remarkable(t, settings)]
        taken += own
    # what a usual amount of another effect explains as well is no finding
    accepted = [
        t
        for t in taken
        if t not in usual
        and not any(covers(u, t, (t.state if t in own else before).error.sigma, settings) for u in usual)
    ]
    # unless nothing else brings what is left inside the tolerance: what matters isn't usual
    accepted = accepted or [t for t in taken if brings_inside(before, t.state)]
    # gains count as a channel did before: what leaves the least may gain less than what mends a single one
    least, most = min(accepted, key=by_error, default=None), max((t.evidence.gain for t in accepted), default=0.0)
    accepted = [t for t in accepted if t is least or t.evidence.gain > MIN_GAIN_SHARE * most]
    if len(accepted) < 2:
        return accepted[0] if accepted else None
    relearnt = parallel_map(lambda t: t.relearnt, accepted[:MAX_ALTERNATIVES], len(before.problem.whole.signals))
    best = min(relearnt, key=by_error)
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
    kept = 1.0 - settings.parameter_price * saved
    return (
        saved > 0
        and one.evidence.gain >= kept * best.evidence.gain
        and overlap(one, best, before.error.sigma) >= MIN_OVERLAP
    )


def by_error(candidate: Refit) -> tuple[float, float]:
    """What a refit leaves; where several leave nothing but noise, what they gain. Where predictions overflow, last."""
    left = candidate.evidence.left
    return (left, -candidate.evidence.gain) if np.isfinite(left) else (np.inf, 0.0)
