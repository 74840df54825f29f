"""What a log says about every effect: present, absent, not excited by it, or indistinguishable from others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.acceptance import Refit
from kinid.diagnosis.choice import acceptable
from kinid.diagnosis.pipeline import Found
from kinid.diagnosis.result import EffectStatus, EffectVerdict
from kinid.diagnosis.screening import Candidate, screen
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import Effect
from kinid.effects._derived import sample_period
from kinid.identification.fitted import FittedParameter
from kinid.identification.lack_of_fit import LackOfFit, error_rows, inside_tolerance
from kinid.identification.nuisance import MAX_SHIFT
from kinid.identification.state import State
from kinid.modeling.applicability import amplitudes, base_of, candidate_effects

Array = NDArray[np.float64]

#: an effect is excited where one that matters would show at this share of the shapes that were looked at
EXCITED_SHARE = 0.75
#: of what an absent effect may look like in what is left: significance and share of its refit
DOUBTFUL_SHARE = 0.5


def verdicts(
    found: Found,
    parameters: dict[str, FittedParameter],
    gains: dict[str, float],
    left: LackOfFit,
    settings: DiagnosisSettings,
) -> tuple[EffectVerdict, ...]:
    """One for each effect that the model lacked, those that were added first.

    Args:
        found: by the stages. parameters: of the best model, by "effect.parameter".
        gains: by how much additions and those that were refitted lower the held-out error. left: by the best model.
    """
    selection, last = found.selection, found.selection.states[-1]
    out = [
        EffectVerdict(name, EffectStatus.PRESENT, np.inf, mark.says, parameters=_own(name, parameters))
        for name, mark in ((mark.effect.id, mark) for mark in found.cleaned.marks)
    ]
    out += [_of_added(name, found, _own(name, parameters), left, settings) for name in selection.added]
    known = {verdict.id for verdict in out}
    groups = {
        alternative: tuple(dict.fromkeys([name, *(r for r in alternatives if r != alternative)]))
        for name, alternatives in selection.alternatives.items()
        if name in selection.added
        for alternative in alternatives
    }
    others = [
        _of_other(effect, why, groups.get(effect.id, ()), found, settings)
        for effect, why in candidate_effects(last.model, found.whole.layout)
        if effect.id not in known
    ]
    order = {EffectStatus.INDISTINGUISHABLE: 0, EffectStatus.NOT_EXCITED: 1, EffectStatus.ABSENT: 2}
    others.sort(key=lambda v: (order[v.verdict], -v.evidence))
    return tuple(replace(v, held_out_gain=gains.get(v.id, 0.0) if v.acts else 0.0) for v in (*out, *others))


def _of_added(
    name: str, found: Found, own: dict[str, FittedParameter], left: LackOfFit, settings: DiagnosisSettings
) -> EffectVerdict:
    selection, effect = found.selection, effects.get(name)
    evidence, alternatives = selection.evidence[name], selection.alternatives.get(name, ())
    made = EffectVerdict(name, EffectStatus.PRESENT, evidence.significance, effect.signature, parameters=own)
    if name in selection.unsupported:
        says = f"added because it was asked for; it {selection.unsupported[name]}"
        return replace(made, verdict=EffectStatus.NOT_EXCITED, says=says, separate_by=f"record {effect.excited_by}")
    made = replace(made, equivalent_to=alternatives, separate_by=_separate(name, alternatives))
    if is_stand_in(name, found, left, settings):
        says = (
            "a stand-in: much is left beside what it takes off, and something that the catalogue doesn't hold may be "
            "what it follows"
        )
        return replace(made, verdict=EffectStatus.INDISTINGUISHABLE, says=says, stand_in=True)
    return replace(made, verdict=EffectStatus.INDISTINGUISHABLE, says=_as_good(alternatives)) if alternatives else made


def _of_other(
    effect: Effect, why: str, group: tuple[str, ...], found: Found, settings: DiagnosisSettings
) -> EffectVerdict:
    """Of an effect that was not added; `why` it can't act in this log, `group` of those that it is as good as."""
    selection, last, name = found.selection, found.selection.states[-1], effect.id
    if group:
        refit = {t.effect.id: t for look in selection.rounds for t in look.refits}.get(name)
        evidence = refit.evidence.significance if refit else 0.0
        separate = _separate(name, group)
        status, says = EffectStatus.INDISTINGUISHABLE, _as_good(group)
        return EffectVerdict(name, status, evidence, says, group, separate_by=separate)
    hidden = EffectStatus.NOT_EXCITED
    if why:
        return EffectVerdict(name, hidden, 0.0, why, separate_by=f"record {effect.excited_by}", acts=False)
    final = selection.rounds[-1] if selection.rounds else None
    if final is None or final.before.model.names != last.model.names:
        points, latest = None, None
    else:
        points, latest = final.points.get(name), next((t for t in final.refits if t.effect.id == name), None)
    evidence = latest.evidence.significance if latest else 0.0
    if latest and len(selection.added) >= settings.max_effects and acceptable(latest, last, settings):
        takes = f"it would take {100 * latest.evidence.share:.0f} % of what is left"
        says, more = f"left out: no more effects were asked for; {takes}", f"--add {name}, or a larger --max-effects"
        return EffectVerdict(name, hidden, evidence, says, separate_by=more, left_out=True)
    verdict, says = _unseen(found, effect, points, latest, settings)
    if verdict == EffectStatus.NOT_EXCITED:
        return EffectVerdict(name, verdict, evidence, says, separate_by=f"record more: {effect.excited_by}")
    within = effect.validity_range(last.problem.experiment.signals)
    return EffectVerdict(name, verdict, evidence, f"{says}; {within}" if within else says, within=within)


def _as_good(alternatives: tuple[str, ...]) -> str:
    return f"fits as well as {', '.join(alternatives)}: this log can't tell them apart"


def is_stand_in(name: str, found: Found, left: LackOfFit, settings: DiagnosisSettings) -> bool:
    """Whether an addition takes off too little beside what is left, where the diagnosis ends unexplained."""
    if not left.matters:
        return False
    evidence = found.selection.evidence[name]
    return evidence.beyond < settings.explains


def _unseen(
    found: Found, effect: Effect, points: Sequence[Candidate] | None, latest: Refit | None, settings: DiagnosisSettings
) -> tuple[EffectStatus, str]:
    """Absent or not excited, and why."""
    last = found.selection.states[-1]
    if effect.detector:
        unseen = effect.unseen(1.0 / sample_period(found.whole.signals))
        return (EffectStatus.NOT_EXCITED if unseen else EffectStatus.ABSENT), unseen or "no such mark in the samples"
    points = screen(last, effect) if points is None else points
    if not points:
        return EffectStatus.NOT_EXCITED, "it changes nothing in this log"
    refit = found.selection.evidence.get(effect.id) if latest is None else latest.evidence
    if (
        refit is not None
        and refit.share > settings.min_share
        and refit.significance > DOUBTFUL_SHARE * settings.min_significance
    ):
        much, sure = 100 * refit.share, refit.significance
        layout = last.problem.layout
        if sure < settings.min_significance:
            proof = "no proof, for or against"
        elif inside_tolerance(last) and any(effect.tolerable(p, layout) for p in effect.parameters(layout)):
            proof = "as much as many a rig has, inside the tolerance"
        else:
            proof = "too little, or impossibly much"
        return EffectStatus.NOT_EXCITED, f"it would take {much:.0f} % of the rest, {sure:.1f} standard errors: {proof}"
    hidden = _too_small_to_see(last, points, settings)
    if hidden:
        return EffectStatus.NOT_EXCITED, f"one that matters ({hidden}) would hardly show in this log"
    tolerances = effect.calibration_sd(last.problem.experiment.signals)
    if tolerances:
        name, sd = next(iter(tolerances.items()))
        return EffectStatus.ABSENT, f"none beyond what calibration is trusted to: {name} of {MAX_SHIFT * sd:.2g}"
    return EffectStatus.ABSENT, "one that matters would show in this log, and doesn't"


def _too_small_to_see(state: State, points: Sequence[Candidate], settings: DiagnosisSettings) -> str:
    """Which amounts of an effect that matter would hide in what is left, in words; "" where none would."""
    layout, effect = state.problem.layout, points[0].effect
    parameters, amplitude = effect.parameters(layout), amplitudes(effect, layout, base_of(state.model))
    whole = float(np.sum((state.residual / state.error.sigma) ** 2))
    rows = error_rows(state.problem.whole)
    matters = np.mean(
        (settings.min_reading_share * state.problem.channel_rms[rows, None] / state.error.sigma[rows]) ** 2
    )
    least = max(
        (2.0 * settings.min_significance) ** 2 * state.inflation,
        settings.min_share * whole,
        float(matters) * state.residual.shape[1],
    )
    # large steps of what has a grid of its own say how far it could go, not whether a small one shows
    weak: list[int] = []
    seen = 0
    for point in points:
        hidden = [i for i in amplitude if (point.sensitivity.get(i, 0.0) * parameters[i].scale) ** 2 <= least]
        seen += not hidden
        weak = weak or hidden
    if seen >= EXCITED_SHARE * len(points):
        return ""
    texts = [
        f"{parameters[i].name} of {parameters[i].scale:.3g} {parameters[i].unit}".removesuffix(" 1") for i in weak[:2]
    ]
    return ", ".join(texts) + (f" and {len(weak) - 2} more" if len(weak) > 2 else "")


def _own(name: str, parameters: dict[str, FittedParameter]) -> dict[str, FittedParameter]:
    return {full.split(".", 1)[1]: p for full, p in parameters.items() if full.split(".", 1)[0] == name}


def _separate(name: str, alternatives: tuple[str, ...]) -> str:
    """What tells an effect from its alternatives, in words."""
    mine = effects.get(name)
    if not alternatives:
        return "; ".join(f"{other}: {how}" for other, how in mine.confusions.items())
    out = []
    for alternative in alternatives:
        other = effects.get(alternative)
        how = mine.confusions.get(alternative) or other.confusions.get(name) or f"{mine.excited_by}; {other.excited_by}"
        out.append(how if len(alternatives) == 1 else f"{alternative}: {how}")
    return "; ".join(out)
