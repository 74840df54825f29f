"""Models side by side against the measurement, on samples that their fits have not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError, expect
from kinid.identification.fit import Fit, fit_model
from kinid.identification.lack_of_fit import error_rows, error_unit
from kinid.identification.problem import whole_blocks
from kinid.identification.whole import held_out_residual
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.readings import experiment_for
from kinid.shown import Shown
from kinid.writers import Json, finite

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class PairedDifference:
    """Mean over blocks, or over logs, of an error less the reference's, with the standard error of this mean."""

    difference: float
    standard_error: float

    @property
    def differs(self) -> bool:
        """Whether the difference is more than two standard errors."""
        return abs(self.difference) > 2 * self.standard_error


@dataclass(frozen=True, eq=False, kw_only=True)
class Row(PairedDifference):
    """One model of a comparison: its fit, its held-out error, and how that differs from the reference's by block."""

    rank: int
    fit: Fit
    held_out: float


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """Models in the order of their held-out error; the reference is named."""

    rows: tuple[Row, ...]
    reference: str
    unit: str
    noise_floor: float

    def __repr__(self) -> str:
        best = self.rows[0]
        many = f"{len(self.rows)} model{'s' * (len(self.rows) != 1)}"
        return f"<Comparison of {many}: {best.fit.model} has {best.held_out:.4g} {self.unit} held out>"

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Models, one a row, the best first: held-out error, and how it differs from the reference's."""
        figures = ("held_out", "difference", "standard_error")
        numbers = {name: np.array([getattr(row, name) for row in self.rows], dtype=float) for name in figures}
        return {"model": np.array([str(row.fit.model) for row in self.rows], dtype=str), **numbers}

    def notes(self) -> tuple[str, ...]:
        """What differences are to, the noise, and what to doubt."""
        doubts = [f"doubt: {row.fit.model}: {warning}" for row in self.rows for warning in row.fit.warnings]
        return (f"differences are to {self.reference}; the noise is {self.noise_floor:.4g} {self.unit}", *doubts)

    def to_dict(self) -> Json:
        """For JSON; None where there is no figure."""
        return {
            "reference": self.reference,
            "unit": self.unit,
            "noise_floor": self.noise_floor,
            "models": [
                {
                    "rank": row.rank,
                    **{name: finite(getattr(row, name)) for name in ("held_out", "difference", "standard_error")},
                    **row.fit.to_dict(),
                }
                for row in self.rows
            ],
        }


def paired(gap: Array) -> dict[str, float]:
    """Fields of a `PairedDifference` from errors less the reference's, (n,); NaN where there are too few."""
    spread = float(gap.std(ddof=1) / np.sqrt(len(gap))) if len(gap) > 1 else float("nan")
    return {"difference": float(gap.mean()) if len(gap) else float("nan"), "standard_error": spread}


def reference_place(names: Sequence[str], reference: str | None) -> int:
    """Which of the models, the best first, is the one that differences are taken to; the best by default.

    Raises:
        InputError: a reference that is none of them.
    """
    if reference is None:
        return 0
    if reference not in names:
        raise InputError(f"reference '{reference}'", f"one of {'; '.join(names)}", "name it as it is compared")
    return names.index(reference)


def compare(
    models: Sequence[Model | str | Sequence[str]],
    data: ContactSeries | Log | Experiment,
    rig: Rig | None = None,
    *,
    reference: str | None = None,
) -> Comparison:
    """Fit every model to the same samples of the same channels and hold it against those that it has not seen.

    Args:
        models: at least one; a name or a list of names is the model of these effects.
        data, rig: as for a fit.
        reference: `str(model)` of the one that differences are taken to; default: the best.

    Raises:
        InputError: no model, a reference that is none of them, or data that can't carry them.
    """
    wanted, remedy = "a list of models", "as compare([Model('hooke'), Model('kelvin-voigt')], touch)"
    expect(models, (list, tuple), "models to compare", wanted, remedy)
    if not models:
        raise InputError("no model to compare", "at least one", "name them with --model")
    asked = [each if isinstance(each, Model) else Model(each) for each in models]
    widest = max(asked, key=lambda model: (len(model.needs), "slip" in model.needs))
    experiment = experiment_for(widest, data, rig)
    keep, number = error_rows(experiment), whole_blocks(experiment)[experiment.valid]
    results = []
    for model in asked:
        fit = fit_model(model, experiment)
        unseen = held_out_residual(fit.state)[keep][:, experiment.valid]
        if not np.isfinite(fit.error.held_out):
            unseen = np.full_like(unseen, np.nan)
        squares = np.bincount(number, (unseen**2).mean(axis=0)) / np.maximum(1, np.bincount(number))
        results.append((fit.error.held_out, np.sqrt(squares[np.bincount(number) > 0]), fit))
    results.sort(key=lambda result: (not np.isfinite(result[0]), result[0]))
    names = [str(fit.model) for _, _, fit in results]
    chosen = reference_place(names, reference)
    rows = [
        Row(rank=rank, fit=fit, held_out=error, **paired(per_block - results[chosen][1]))
        for rank, (error, per_block, fit) in enumerate(results, start=1)
    ]
    return Comparison(tuple(rows), names[chosen], error_unit(experiment), results[0][2].error.noise_floor)
