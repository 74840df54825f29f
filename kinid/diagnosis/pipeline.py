"""From a log and a model to what the model lacks: preprocess, screen, refit, accept, prune, check what is left."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kinid.diagnosis.acceptance import within_possible
from kinid.diagnosis.detectors import Cleaned, detect, marked
from kinid.diagnosis.selection import Selection, select
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.identification.estimation import estimate, estimate_problem
from kinid.identification.lack_of_fit import error_rows
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model

#: a fit from nothing that ends within this of where the way here led is the one that is reported; so is one without
#: marks
SAME_COST_RATIO = 1.1


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


def run(
    model: Model,
    experiment: Experiment,
    settings: DiagnosisSettings,
    *,
    known: Mapping[str, float] | None = None,
    forced: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Found:
    """All stages.

    Args:
        model: that is asked about. experiment: at the log's own rate. settings: what decides.
        known: starting values by full name. forced: effects to add whatever the evidence says. progress: called at each
            stage.
    """

    def found_beside(passed: Sequence[str]) -> Found:
        """All but marks of these names."""
        progress("looking for marks in the samples")
        expected = plain.model.predict(experiment.signals, plain.values)
        cleaned = detect(experiment, (*model.names, *passed), expected)
        marks = {mark.effect.id for mark in cleaned.marks}
        start = plain if cleaned.experiment is experiment else estimate(model, cleaned.experiment, known)
        selection = select(start, settings, [name for name in forced if name not in marks], progress)
        if selection.added and not selection.unsupported:
            # what a fit of that model finds by itself is reported, unless the way here led further down
            last = selection.states[-1]
            again = selection.fits.get(last.model.names)
            again = again or within_possible(estimate_problem(last.model, start.problem), start)
            if again.cost_with(last.error) <= SAME_COST_RATIO * last.cost_with(last.error):
                selection.states[-1] = again
        return Found(model, experiment, cleaned, plain, selection)

    progress("fitting the model")
    plain = estimate(model, experiment, known)
    found = found_beside(())
    doubtful = [mark.effect.id for mark in found.cleaned.marks if mark.found.relative]
    return found_beside(doubtful) if doubtful and _needless(found) else found


def _needless(found: Found) -> bool:
    """Whether the found model fits all samples as well without marks, which the first model alone seemed to show."""
    last, whole, rows = found.selection.states[-1], found.whole, error_rows(found.whole)
    free = estimate(last.model, whole) if found.selection.added else found.plain
    left = held_out_residual(last, whole, lambda predicted: marked(predicted, found.cleaned.marks, whole))
    return bool(np.nanmean(held_out_residual(free)[rows] ** 2) < SAME_COST_RATIO * np.nanmean(left[rows] ** 2))
