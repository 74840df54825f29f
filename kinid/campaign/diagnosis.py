"""What a model lacks over a campaign: in all logs together, in each, and between groups of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kinid.campaign.differences import Difference, differences
from kinid.campaign.oddness import reasons
from kinid.diagnosis.pooling.selection import PooledSelection, select, shown_by
from kinid.diagnosis.result import EffectStatus, EffectVerdict, Step, Verdict
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import get
from kinid.identification.fitted import FittedParameter
from kinid.identification.lack_of_fit import error_rows
from kinid.identification.pooling.held_out import LogState, Steps
from kinid.identification.pooling.result import PooledFit
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.model import Model
from kinid.parallel import one_blas_thread
from kinid.residuals import Cell
from kinid.residuals.localization import where
from kinid.writers import Json, finite

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign

#: parts of logs that hold most of the error, at most
MOST_CELLS = 8
#: change of the weighted readings, as a length over the least significance, by an amount of an effect that matters,
#: above which the logs would have shown it
VISIBLE = 2.0


@dataclass(frozen=True, eq=False)
class CampaignDiagnosis:
    """Where a model fails in many logs, and which effects it lacks.

    Attributes:
        model: that was asked about. best: with what it lacked. verdict: "adequate", "missing" or "unexplained"; says:
            why, in words. added: names, in their order.
        steps: errors held out by block, from the model to the best one; by_log: the same held out by log.
        where: parts of logs that hold most of the error of `model`.
        effects: a verdict for every effect. shown: of those that were added or tried, log → present, absent or
            "not-excited".
        before, fit: of the model that was asked about, and of the best one.
        differences: of shared parameters between groups of logs. odd: names of logs that don't belong, with why.
        warnings: what to doubt.
    """

    model: Model
    best: Model
    verdict: Verdict
    says: str
    added: tuple[str, ...]
    steps: tuple[Step, ...]
    by_log: tuple[float, ...]
    where: tuple[Cell, ...]
    effects: tuple[EffectVerdict, ...]
    shown: dict[str, dict[str, EffectStatus]]
    before: PooledFit
    fit: PooledFit
    differences: tuple[Difference, ...]
    odd: dict[str, str]
    warnings: tuple[str, ...] = field(default=())

    @property
    def explained(self) -> float:
        """Share of the squared error beyond noise that the additions take off, 0…1."""
        return self.steps[-1].explained

    def __str__(self) -> str:
        odd = "".join(f"\nodd: {name}: {why}" for name, why in self.odd.items())
        return f"{self.verdict}: {self.says}{odd}\n{self.fit}"

    def to_dict(self) -> Json:
        """The facts as `kinid diagnose --json` writes them for many logs."""
        fit = self.fit.to_dict()
        kept = ("logs", "per_log", "error_by_log", "put_aside", "groups", "sharing", "parameters")
        return {
            "model": list(self.model.names),
            "verdict": self.verdict,
            "says": self.says,
            "added": list(self.added),
            "error": {
                "unit": self.fit.error.unit,
                "before": self.steps[0].held_out,
                "after": self.steps[-1].held_out,
                "noise_floor": self.fit.error.noise_floor,
            },
            "steps": [
                step.to_dict() | {"held_out_by_log": finite(error)} for step, error in zip(self.steps, self.by_log)
            ],
            "where": [cell.to_dict() for cell in self.where],
            "tolerance": self.fit.left.tolerance,
            "explained": self.explained,
            "left": self.fit.left.to_dict(),
            "effects": [effect.to_dict() | {"by_log": self.shown.get(effect.id, {})} for effect in self.effects],
            "differences": [one.to_dict() for one in self.differences],
            **{name: fit[name] for name in kept},
            "odd": list(self.odd),
            "odd_because": dict(self.odd),
            "warnings": list(self.warnings),
        }


def diagnose(
    campaign: Campaign,
    model: Model,
    *,
    max_effects: int = 8,
    settings: DiagnosisSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> CampaignDiagnosis:
    """Compare a model with all logs of a campaign, and say which effects it lacks.

    Args:
        campaign: the logs. model: to ask about. max_effects: so many are added at most. settings: what decides.
        progress: called with each stage, in words.

    Raises:
        InputError: no log that can carry the model.
    """
    settings = dataclasses.replace(settings or DiagnosisSettings(), max_effects=max_effects)
    before = campaign.fit(model, progress=progress)
    with one_blas_thread():
        found = select(before, settings, progress)
        progress("what each log shows")
        shown = {name: _by_log(found.fits[-1], name) for name in found.added if name in found.fits[-1].model}
        for tried in found.refits:
            if tried.effect.id not in shown:
                names = found.fits[-1].pool.problems.logs
                verdicts = shown_by(tried.pool, tried.effect.id)
                shown[tried.effect.id] = {log.name: verdict for log, verdict in zip(names, verdicts)}
        odd = {name: reasons(before, campaign, name, why) for name, why in before.odd.items()}
        cells = _where(before)
    last = found.fits[-1]
    steps = _steps(found)
    verdict, says = _verdict(found, steps)
    return CampaignDiagnosis(
        model,
        last.model,
        verdict,
        says,
        tuple(found.added),
        steps,
        tuple(fit.by_log for fit in _path(found)),
        cells,
        _effects(found, settings),
        shown,
        before,
        last,
        differences(last),
        odd,
        last.warnings,
    )


def _path(found: PooledSelection) -> list[PooledFit]:
    """Fits with each addition; where one was taken back, the first and the last alone."""
    whole = len(found.fits) == len(found.added) + 1
    return found.fits if whole else [found.fits[0], found.fits[-1]] if found.added else [found.fits[-1]]


def _steps(found: PooledSelection) -> tuple[Step, ...]:
    path = _path(found)
    first, noise = path[0].error.held_out, path[-1].error.noise_floor
    beyond = max(first**2 - noise**2, 1e-300)
    out = []
    for i, fit in enumerate(path):
        added = None if i == 0 else found.added[i - 1] if len(path) == len(found.added) + 1 else ", ".join(found.added)
        share = 0.0 if i == 0 else float(np.clip((first**2 - fit.error.held_out**2) / beyond, 0.0, 1.0))
        out.append(Step(added, fit.model.names, fit.error.train, fit.error.held_out, share))
    return tuple(out)


def _verdict(found: PooledSelection, steps: tuple[Step, ...]) -> tuple[Verdict, str]:
    left = found.fits[-1].left
    allowed = f"{left.tolerance:.2g} {left.unit} may be"
    remains = f"{left.excess:.2g} {left.unit} are left beside noise, {100 * left.share_of_reading:.2g} % of the reading"
    inside = "what is left is noise" if left.excess < 0.5 * left.noise else f"{remains}; {allowed}"
    helped = ""
    if found.added:
        names = [
            f"{name} (or {', '.join(rivals)})" if (rivals := found.alternatives.get(name)) else name
            for name in found.added
        ]
        take = "takes" if len(names) == 1 else "take"
        helped = f"{' and '.join(names)} {take} off {100 * steps[-1].explained:.0f} % of the error beside noise; "
    if left.matters:
        return Verdict.UNEXPLAINED, f"{helped}{remains}, where {allowed}"
    return (Verdict.MISSING if found.added else Verdict.ADEQUATE), f"{helped}{inside}"


def _by_log(fit: PooledFit, name: str) -> dict[str, EffectStatus]:
    return dict(zip([log.name for log in fit.pool.problems.logs], shown_by(fit.pool, name)))


def _effects(found: PooledSelection, settings: DiagnosisSettings) -> tuple[EffectVerdict, ...]:
    """A verdict for each effect that the model lacked, those that were added first."""
    last, path = found.fits[-1], _path(found)
    out: list[EffectVerdict] = []
    rivals: dict[str, str] = {}
    for i, name in enumerate(found.added):
        gain = path[i].error.held_out - path[i + 1].error.held_out if len(path) > i + 1 else 0.0
        others = found.alternatives.get(name, ())
        rivals |= {other: name for other in others}
        own = {full.split(".", 1)[1]: p for full, p in _all_parameters(last).items() if full.split(".", 1)[0] == name}
        evidence = found.evidence[name]
        alone = sum(significance > settings.min_significance for significance in evidence.logs)
        says = (
            f"{evidence.significance:.1f} standard errors over {len(last.pool)} logs, {evidence.by_log:.1f} on logs "
            f"held out; by itself beyond doubt in {alone} of them"
        )
        status, sure = EffectStatus.PRESENT, evidence.significance
        out.append(EffectVerdict(name, status, sure, says, others, gain, own, _apart(name)))
    tried = {t.effect.id: t for t in found.refits}
    for name, points in found.looked.items():
        sure = tried[name].evidence.significance if name in tried else 0.0
        if name in rivals:
            status = EffectStatus.INDISTINGUISHABLE
            says = f"fits as well as {rivals[name]}: these logs can't tell them apart"
            out.append(EffectVerdict(name, status, sure, says, (rivals[name],), separate_by=_apart(name)))
        elif max(point.visible for point in points) > VISIBLE * settings.min_significance:
            says = "one that matters would show in these logs, and doesn't"
            out.append(EffectVerdict(name, EffectStatus.ABSENT, sure, says))
        else:
            says, record = "these logs would hardly show it", f"record {get(name).excited_by}"
            out.append(EffectVerdict(name, EffectStatus.NOT_EXCITED, sure, says, separate_by=record))
    for name, why in found.idle.items():
        record = f"record {get(name).excited_by}"
        out.append(EffectVerdict(name, EffectStatus.NOT_EXCITED, 0.0, why, separate_by=record, acts=False))
    return tuple(out)


def _all_parameters(fit: PooledFit) -> dict[str, FittedParameter]:
    """What is shared; of what each log has for itself the mean over logs, with the spread of logs."""
    out = dict(fit.parameters)
    for name in {name for log in fit.logs for name in log.parameters} - set(out):
        values = [log.parameters[name] for log in fit.logs if name in log.parameters]
        middle, spread = float(np.mean([p.value for p in values])), 2.0 * float(np.std([p.value for p in values]))
        out[name] = FittedParameter(name, middle, middle - spread, middle + spread, values[0].unit)
    return out


def _apart(name: str) -> str:
    return "; ".join(f"{other}: {how}" for other, how in get(name).confusions.items())


def _where(fit: PooledFit) -> tuple[Cell, ...]:
    """Parts of logs that hold most of the error, each a share of that of all logs."""
    found: list[tuple[float, Cell]] = []
    total = 0.0
    given = [(fit.held_out.by_block(number),) for number in range(len(fit.pool))]
    for log, (squares, cells) in zip(fit.pool.problems.logs, fit.pool.visits(_cells, given)):
        total += squares
        found += [(squares, dataclasses.replace(cell, says=f"{log.name}: {cell.says}")) for cell in cells]
    weighted = [dataclasses.replace(cell, share=cell.share * squares / max(total, 1e-300)) for squares, cell in found]
    return tuple(sorted(weighted, key=lambda cell: -cell.share)[:MOST_CELLS])


def _cells(state: State, by_block: Steps) -> tuple[float, list[Cell]]:
    """Squares of the error of a log, and its parts."""
    whole = state.problem.whole
    residual = held_out_residual(LogState.made(state, by_block))
    return float(np.nansum(residual[error_rows(whole)] ** 2)), list(where(whole, residual, whole.noise))
