"""From a log and a model to what the model lacks: preprocess, screen, refit, accept, prune, check what is left."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kinid.diagnosis.acceptance import within_possible
from kinid.diagnosis.detectors import Cleaned, detect, marked
from kinid.diagnosis.selection import Selection, select
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.experiment import Experiment
from kinid.identification.estimation import estimate, estimate_problem
from kinid.identification.lack_of_fit import error_rows
from kinid.identification.solver import State
from kinid.identification.whole import held_out_residual
from kinid.model import Model

#: a fit from nothing that ends within this of where the way here led is the one that is reported; so is one without marks
SAME_COST = 1.1


@dataclass(eq=False)
class Found:
    """What the stages found.

    Attributes:
        model: that was asked about. whole: the experiment as it was recorded. cleaned: without what detectors found.
        plain: the model fitted to the log as it was recorded. selection: what was added, from the cleaned log.
    """

    model: Model
    whole: Experiment
    cleaned: Cleaned
    plain: State
    selection: Selection


def run(model: Model, experiment: Experiment, settings: DiagnosisSettings, *, known: Mapping[str, float] | None = None,
        forced: Sequence[str] = (), passed: Sequence[str] = (), progress: Callable[[str], None] = lambda _: None) -> Found:
    """All stages.

    Args:
        model: that is asked about. experiment: at the log's own rate. settings: what decides.
        known: starting values by full name. forced: effects to add whatever the evidence says. passed: marks not to look for.
    """
    progress("fitting the model")
    plain = estimate(model, experiment, known)
    progress("looking for marks in the samples")
    cleaned = detect(experiment, (*model.names, *passed), model.predict(experiment.signals, plain.values))
    marks = {mark.effect.id for mark in cleaned.marks}
    start = estimate(model, cleaned.experiment, known) if marks else plain
    selection = select(start, settings, [name for name in forced if name not in marks], progress)
    if selection.added and not selection.unsupported:
        # what a fit of that model finds by itself is reported, unless the way here led further down
        last = selection.states[-1]
        again = selection.fits.get(last.model.names)
        again = again or within_possible(estimate_problem(last.model, start.problem), selection.added)
        if again.cost_with(last.error) <= SAME_COST * last.cost_with(last.error):
            selection.states[-1] = again
    doubtful = [mark.effect.id for mark in cleaned.marks if mark.found.relative]
    if doubtful and _needless(selection.states[-1], cleaned, experiment):
        return run(model, experiment, settings, known=known, forced=forced, progress=progress, passed=[*passed, *doubtful])
    return Found(model, experiment, cleaned, plain, selection)


def _needless(last: State, cleaned: Cleaned, whole: Experiment) -> bool:
    """Whether a fit of what was found to all samples does as well without marks, which some model alone seemed to show."""
    free, rows = estimate(last.model, whole), error_rows(whole)
    left = held_out_residual(last, whole, lambda predicted: marked(predicted, cleaned.marks, whole))
    return bool(np.nanmean(held_out_residual(free)[rows] ** 2) < SAME_COST * np.nanmean(left[rows] ** 2))
