"""What a log says about every effect of the catalogue: present, absent, not excited by it, or not to be told from others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.belief import trusted_to
from kinid.diagnosis.candidates import Candidate, able, amplitudes, base_of, screen
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.descent import State
from kinid.diagnosis.detectors import Mark
from kinid.diagnosis.look import ENOUGH, NEARER, Tried
from kinid.diagnosis.result import ABSENT, INDISTINGUISHABLE, NOT_EXCITED, PRESENT, EffectVerdict
from kinid.diagnosis.search import Search
from kinid.diagnosis.unexplained import OTHER_FORM
from kinid.effects import Effect
from kinid.fit import FittedParameter
from kinid.parameter import Parameter

Array = NDArray[np.float64]

#: an effect is excited where one that matters would bring so many times the evidence that is asked for
POWER = 2.0
#: at this share of the shapes that were looked at, at least
SHAPES = 0.75
#: an effect isn't absent where what is left looks like one of this share of the least that matters
LOOKS = 0.5


def verdicts(
    search: Search, marks: tuple[Mark, ...], parameters: dict[str, FittedParameter], gains: dict[str, float],
    rate: float, forced: tuple[str, ...] = (),
) -> tuple[EffectVerdict, ...]:  # fmt: skip
    """One for each effect that the model lacked, those that are there first.

    Args:
        search, marks: what was found. parameters: of the best model, by "effect.parameter".
        gains: by how much additions and those that were tried lower the held-out error. rate: samples a second.
    """
    last = search.states[-1]
    out: list[EffectVerdict] = []
    rivals_of: dict[str, list[str]] = {}
    for name, rivals in search.rivals.items():
        for rival in rivals:
            rivals_of.setdefault(rival, []).append(name)
    for mark in marks:
        name = mark.effect.id
        out.append(EffectVerdict(name, PRESENT, mark.evidence, (), gains.get(name, 0.0), _own(name, parameters), "",
                                 mark.says))  # fmt: skip
    for name in search.added:
        rivals = search.rivals.get(name, ())
        verdict = INDISTINGUISHABLE if rivals else PRESENT
        if name in forced and not search.evidence[name].sure:
            out.append(EffectVerdict(name, NOT_EXCITED, search.evidence[name].value, (), gains.get(name, 0.0),
                                     _own(name, parameters), f"record {effects.get(name).excited_by}",
                                     "added because it was asked for; the log doesn't support it"))  # fmt: skip
            continue
        says = (f"fits as well as {', '.join(rivals)}: this log can't tell them apart" if rivals
                else effects.get(name).signature)  # fmt: skip
        out.append(EffectVerdict(name, verdict, search.evidence[name].value, rivals, gains.get(name, 0.0),
                                 _own(name, parameters), _separate(name, rivals, search), says))  # fmt: skip
    tried = _tried(search)
    # the last look was often from the last model
    points = search.rounds[-1].points if search.rounds and search.rounds[-1].before is last else {}
    known = {v.id for v in out}
    # what an effect would have brought to an earlier model says nothing of the last one
    latest = {t.effect.id: t for look in search.rounds if look.before is last for t in look.tried}
    inflation, layout = _inflation(last), last.problem.experiment.layout
    others_able = [(effect, why) for effect, why in able(last.model, layout) if effect.id not in known]
    attempts = {effect.id: tried.get(effect.id) if effect.id in rivals_of else latest.get(effect.id) for effect, _ in others_able}
    refitted = dict(zip(attempts, side_by_side(_fitted, list(attempts.values()))))
    for effect, why in others_able:
        name = effect.id
        attempt, shown = attempts[name], refitted[name]
        evidence = attempt.evidence.value if attempt is not None else 0.0
        gain = gains.get(name, 0.0)
        if name in rivals_of:
            beside = (rival for added in rivals_of[name] for rival in search.rivals[added] if rival != name)
            others = tuple(dict.fromkeys([*rivals_of[name], *beside]))
            out.append(EffectVerdict(name, INDISTINGUISHABLE, evidence, others, gain, shown, _separate(name, others, search),
                                     f"fits as well as {', '.join(others)}: this log can't tell them apart"))  # fmt: skip
            continue
        if why:
            verdict, says = NOT_EXCITED, why
        else:
            verdict, says = _unmarked(effect, rate) if effect.detector else _seen(last, effect, points.get(name), inflation)
        if verdict == ABSENT and attempt is not None and evidence >= ENOUGH and attempt.state.rms < NEARER * last.rms:
            verdict, says = NOT_EXCITED, "it would take much of the rest, but this log is no proof of it"
        elif verdict == ABSENT and evidence >= ENOUGH:
            says = "one that matters would show in this log; the fit gains by one that is too small to count"
        if verdict == ABSENT and (size := trusted_to(effect, layout)):
            says = f"none beyond what calibration is trusted to: {size}"
        elif verdict == ABSENT and last.rms > OTHER_FORM and name in tried and tried[name].evidence.sure:
            verdict, says = NOT_EXCITED, "others explain more of the same, but what they leave is no noise: no proof against it"
        record = "" if verdict == ABSENT else f"record {'' if why else 'more: '}{effect.excited_by}"
        left_out = not why and name in search.left_out
        if left_out:
            verdict, says = NOT_EXCITED, f"it was left out: {ended(search)}, and it may help"
            record = f"try it: --add {name}" if search.spent else "allow more effects: --max-effects"
        within = effect.within(last.problem.experiment.signals) if verdict == ABSENT else ""
        says += f"; {within}" if within else ""
        out.append(EffectVerdict(name, verdict, evidence, (), gain, shown, record, says, not why, left_out, within))
    order = {PRESENT: 0, INDISTINGUISHABLE: 1, NOT_EXCITED: 2, ABSENT: 3}
    first = {name: i for i, name in enumerate(search.added)}
    return tuple(sorted(out, key=lambda v: (first.get(v.id, 99) if v.id in first else 98, order[v.verdict], -v.evidence)))


def ended(search: Search) -> str:
    """Why a search ended that left something out, in words."""
    return "the search had done all the work that it may (--effort)" if search.spent else "no more effects were asked for"


def meaning(told: EffectVerdict) -> str:
    """What an effect's values say that its name doesn't; "" where the name says it."""
    return effects.get(told.id).meaning({name: p.value for name, p in told.parameters.items()})


def _unmarked(effect: Effect, rate: float) -> tuple[str, str]:
    """Absent or not excited, and why, of what leaves a mark in the samples and left none."""
    if effect.id == "saturation":
        return NOT_EXCITED, "no reading stays at a largest value: the end of the range was not reached"
    if effect.id == "mains-hum" and rate < 125.0:
        return NOT_EXCITED, f"at {rate:.3g} Hz a line at 50 or 60 Hz can't be seen"
    return ABSENT, "no such mark in the samples"


def _seen(state: State, effect: Effect, points: Sequence[Candidate] | None, inflation: float) -> tuple[str, str]:
    """Absent or not excited, and why."""
    layout = state.problem.experiment.layout
    parameters = effect.parameters(layout)
    amplitude = amplitudes(effect, layout, base_of(state.model))
    if points is None:
        points = screen(state, effect)
    if not points:
        return NOT_EXCITED, "it changes nothing in this log"
    least = np.array([parameters[i].scale for i in amplitude])
    # large steps of what has a grid of its own say how far it could go, not whether a small one shows
    points = [point for point in points if point.small] or points
    visible = []
    for point in points:
        size = np.array([point.sensitivity.get(i, 0.0) for i in amplitude]) * least
        visible.append(bool((size**2 > POWER * ENOUGH * inflation).all()))
    share = float(np.mean(visible))
    if share < SHAPES:
        hidden = _hidden(parameters, amplitude, points[0].sensitivity, least, inflation)
        return NOT_EXCITED, f"one that matters ({hidden}) would hardly show in this log"
    if alike := _looks_like(points[0], parameters, amplitude, inflation):
        return NOT_EXCITED, f"what is left looks in part like one ({alike}): no proof of it, and none against it"
    return ABSENT, "one that matters would show in this log, and doesn't"


def _looks_like(best: Candidate, parameters: tuple[Parameter, ...], amplitude: dict[int, float], inflation: float) -> str:
    """The size of it that explains most of what is left, in words; "" where that is small beside what matters, or chance."""
    size = {i: float(best.start[best.place + i]) - null for i, null in amplitude.items()}
    i = max(size, key=lambda i: abs(size[i]) / parameters[i].scale)
    if abs(size[i]) < LOOKS * parameters[i].scale or best.gain < POWER * ENOUGH * inflation:
        return ""
    return f"{parameters[i].name} of {best.start[best.place + i]:.2g} {parameters[i].unit}".removesuffix(" 1")


def _hidden(parameters: tuple[Parameter, ...], amplitude: dict[int, float], sensitivity: dict[int, float], least: Array,
            inflation: float) -> str:  # fmt: skip
    weak = [(i, m) for i, m in zip(amplitude, least) if (sensitivity.get(i, 0.0) * m) ** 2 <= POWER * ENOUGH * inflation]
    chosen = weak or list(zip(amplitude, least))
    texts = [f"{parameters[i].name} of {m:.3g} {parameters[i].unit}".removesuffix(" 1") for i, m in chosen[:2]]
    return ", ".join(texts) + (f" and {len(chosen) - 2} more" if len(chosen) > 2 else "")


def _inflation(state: State) -> float:
    """How much more the residual varies, averaged over neighbours, than white noise of size one would; at least 1."""
    rows = state.residual.reshape(len(state.problem.sigma), -1)
    k = 8
    n = rows.shape[1] // k * k
    if n == 0:
        return 1.0
    return max(1.0, float(np.mean(k * rows[:, :n].reshape(len(rows), -1, k).mean(axis=2) ** 2)))


def _tried(search: Search) -> dict[str, Tried]:
    """Of each effect, the refit that helped most."""
    out: dict[str, Tried] = {}
    for look in search.rounds:
        for tried in look.tried:
            if tried.effect.id not in out or tried.evidence.value > out[tried.effect.id].evidence.value:
                out[tried.effect.id] = tried
    return out


def _fitted(tried: Tried | None) -> dict[str, FittedParameter]:
    """Parameters of the effect alone, from its refit, with intervals; none where it wasn't refitted."""
    from kinid.diagnosis.intervals import covariance, fitted

    if tried is None:
        return {}
    own = _own(tried.effect.id, fitted(tried.state, covariance(tried.state, stated=False), stated=False))
    tried.state.light()
    return own


def _own(name: str, parameters: dict[str, FittedParameter]) -> dict[str, FittedParameter]:
    return {full.split(".", 1)[1]: p for full, p in parameters.items() if full.split(".", 1)[0] == name}


def _separate(name: str, rivals: tuple[str, ...], search: Search) -> str:
    """What tells an effect from its rivals, in words, and the command that plans the experiment."""
    mine = effects.get(name)
    if not rivals:
        return "; ".join(f"{other}: {how}" for other, how in mine.confusions.items())
    out = []
    for rival in rivals:
        other = effects.get(rival)
        how = mine.confusions.get(rival) or other.confusions.get(name) or f"{mine.excited_by}; {other.excited_by}"
        out.append(how if len(rivals) == 1 else f"{rival}: {how}")
    touch = search.states[-1].problem.experiment.touch
    if touch is not None and (touch.source is None or touch.source[1].robot is None):
        return "; ".join(out)  # a log without a robot
    known = ",".join(n for n in search.states[-1].model.names if n != name and n not in rivals)
    plan = f"kinid plan discriminate --model {known or 'none'} --effects {','.join([name, *rivals])} -o separate.parquet"
    return "; ".join(out) + f"; a trajectory for it: {plan}"
