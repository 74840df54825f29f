"""Words of a diagnosis, the same on the terminal, in reports and in sentences of JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from kinid import effects as catalogue
from kinid.diagnosis.result import Diagnosis, EffectStatus, EffectVerdict, Verdict, with_alternatives
from kinid.identification.warnings import listed
from kinid.parameter import ParameterId

if TYPE_CHECKING:
    from kinid.identification.fitted import FittedParameter

#: verdicts in the order in which a reader wants them
ORDER = (EffectStatus.PRESENT, EffectStatus.INDISTINGUISHABLE, EffectStatus.NOT_EXCITED, EffectStatus.ABSENT)
#: errors that differ by a smaller share are said to be the same
SAME = 5e-3
#: what is left beside noise is noise, too, where it is a smaller share of it
NOISE_SHARE = 0.5


def headline(result: Diagnosis) -> str:
    """The verdict in a sentence."""
    first, last = result.steps[0].held_out, result.steps[-1].held_out
    before, after = f"{first:.3g}", f"{last:.3g}"
    moved = result.added and abs(last - first) > SAME * first and after != before
    error = (
        f"the held-out error {'falls' if last < first else 'rises'} from {before} to {after} {result.unit}"
        if moved
        else f"the held-out error {'stays' if result.added else 'is'} {before} {result.unit}"
    )
    noise = f"noise alone is {result.noise_floor:.3g} {result.unit}"
    idle = {
        effect.id for effect in result.effects if effect.verdict == EffectStatus.NOT_EXCITED
    }  # added because they were asked for
    real = [name for name in result.added if name not in idle] or list(result.added)
    named = with_alternatives(real, result.effects)
    names = listed(named)
    if result.verdict == Verdict.ADEQUATE:
        return f"The model is adequate: {error}, and {noise}."
    if result.verdict == Verdict.MISSING:
        which = " (this log can't tell which)" if named != real else ""
        them = "all that was added" if len(real) < len(result.added) else "it" if len(real) == 1 else "them"
        return f"The model lacks {names}{which}: with {them} {error}; {noise}."
    left_out = [effect.id for effect in result.effects if effect.left_out]
    unknown = (
        f"No more effects were asked for, and {listed(left_out)} would take off more"
        if left_out
        else "Something is missing that the catalogue does not hold"
    )
    if not result.added:
        return f"{unknown}: {error}; {noise}."
    stand_in_ids = {effect.id for effect in result.effects if effect.stand_in}
    follow = [name for name in real if name in stand_in_ids]
    help_ = with_alternatives([name for name in real if name not in stand_in_ids], result.effects)
    said = []
    if help_:
        alone = len(help_) == 1
        helps = (
            ("helps, but does" if alone else "help, but do") if moved and last < first else "does" if alone else "do"
        )
        said.append(f"{listed(help_)} {helps} not suffice")
    if follow:
        said.append(f"{listed(follow)} {'is a stand-in' if len(follow) == 1 else 'are stand-ins'} for it")
    return f"{unknown}. {', and '.join(said)}: {error}; {noise}."


def beside(result: Diagnosis) -> str:
    """What where the model fails leaves out, as words behind that; "" where nothing."""
    return f", beside {listed(result.corrected)}" if result.corrected else ""


def leftover(result: Diagnosis) -> str:
    """What the best model leaves, and what it may leave, in sentences."""
    left = result.left
    allowed = f"The tolerance is {left.tolerance:.3g} {left.unit}."
    if left.excess < NOISE_SHARE * left.noise:
        return f"{left.rms:.3g} {left.unit} are left, and noise explains them. {allowed}"
    return (
        f"{left.rms:.3g} {left.unit} are left. Beside noise they are {left.excess:.3g} {left.unit}, "
        f"{100 * left.share_of_reading:.2g} % of the reading, and remember themselves for {left.memory:.2g} s. "
        f"{allowed}"
    )


def verdict_words(effect: EffectVerdict) -> str:
    """The verdict as a reader has it, with what is as good."""
    own = "stand-in" if effect.stand_in else effect.verdict
    return own + (f", as good: {', '.join(effect.equivalent_to)}" if effect.equivalent_to else "")


def one_sided(p: FittedParameter, write: Callable[[float], str]) -> str:
    """Say "at most …" of an estimate at the end of what is possible, which is an end of its interval, too.

    Returns:
        The phrase; "" for an estimate inside.
    """
    wide = p.high - p.low
    if 0.0 < wide < np.inf and p.value - p.low < 1e-9 * wide:
        return f"at most {write(p.high)}"
    if 0.0 < wide < np.inf and p.high - p.value < 1e-9 * wide:
        return f"at least {write(p.low)}"
    return ""


def acting(parameters: Mapping[str, FittedParameter]) -> dict[str, FittedParameter]:
    """Without parameters of effects that are read off the samples, for channels that don't bear their mark."""

    def acts(p: FittedParameter) -> bool:
        own = ParameterId.parse(p.name)
        effect = catalogue.get(own.effect)
        return not effect.detector or p.value != effect.null.get(own.name)

    return {name: p for name, p in parameters.items() if acts(p)}


def by_verdict(result: Diagnosis) -> list[EffectVerdict]:
    """Effects, those present first, and by evidence within a verdict."""
    rank = {verdict: k for k, verdict in enumerate(ORDER)}
    return sorted(
        result.effects, key=lambda e: (rank.get(e.verdict, len(rank)), -e.evidence if np.isfinite(e.evidence) else 0.0)
    )


def indistinguishable_classes(result: Diagnosis) -> list[EffectVerdict]:
    """Of effects that this log can't tell apart, the first of each class: how to separate them is the same for all."""
    open_ = [e for e in result.effects if e.equivalent_to and e.separate_by]
    return list({frozenset([e.id, *e.equivalent_to]): e for e in reversed(open_)}.values())[::-1]


def doubts(result: Diagnosis) -> list[str]:
    """What to doubt, each once; without the advice of a fit to do what was done here."""
    return [d for d in dict.fromkeys([*result.warnings, *result.fit.warnings]) if "kinid diagnose" not in d]
