"""Models side by side on a campaign: on blocks of time, and on whole logs, that their fits have not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kinid.errors import InputError
from kinid.identification.pooling.fit import fit_logs
from kinid.identification.pooling.result import PooledFit
from kinid.modeling.model import Model
from kinid.writers import Json

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign


@dataclass(frozen=True, eq=False)
class CampaignRow:
    """One model: its fit, and how its errors on logs held out differ from the reference's.

    `difference` is the mean over logs of the error less the reference's, with the standard error of this mean.
    """

    rank: int
    fit: PooledFit
    difference: float
    standard_error: float

    @property
    def differs(self) -> bool:
        """Whether the difference is more than two standard errors."""
        return abs(self.difference) > 2 * self.standard_error


@dataclass(frozen=True, eq=False)
class CampaignComparison:
    """Models in the order of their error on logs held out; the reference is named."""

    rows: tuple[CampaignRow, ...]
    reference: str
    unit: str
    noise_floor: float

    def to_dict(self) -> Json:
        """For JSON; None where there is no figure."""

        def figure(value: float) -> float | None:
            return value if np.isfinite(value) else None

        return {
            "reference": self.reference,
            "unit": self.unit,
            "noise_floor": self.noise_floor,
            "models": [
                {
                    "rank": row.rank,
                    "held_out": figure(row.fit.error.held_out),
                    "held_out_by_log": figure(row.fit.by_log),
                    "difference": figure(row.difference),
                    "standard_error": figure(row.standard_error),
                    **row.fit.to_dict(),
                }
                for row in self.rows
            ],
        }


def compare(
    campaign: Campaign,
    models: Sequence[Model],
    *,
    reference: str | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> CampaignComparison:
    """Fit every model to the same logs and hold it against blocks and logs that it has not seen.

    Args:
        campaign: the logs. models: at least one. reference: `str(model)` of the one that differences are taken to;
            default: the best. progress: called with what is being done, in words.

    Raises:
        InputError: no model, a reference that is none of them, or logs that can't carry them.
    """
    if not models:
        raise InputError("no model to compare", "at least one", "name them with --model")
    widest = max(models, key=lambda model: (len(model.needs), "slip" in model.needs))
    logs = campaign.logs(widest)
    fits = [fit_logs(model, logs, campaign.sharing_for(model), progress=progress) for model in models]
    fits.sort(key=lambda fit: fit.by_log if np.isfinite(fit.by_log) else fit.error.held_out)
    names = [str(fit.model) for fit in fits]
    if reference is not None and reference not in names:
        raise InputError(f"reference '{reference}'", f"one of {'; '.join(names)}", "name it as it is compared")
    against = fits[names.index(reference) if reference is not None else 0]
    rows = []
    for rank, fit in enumerate(fits, start=1):
        gap = _errors(fit, against) - _errors(against, fit)
        spread = float(gap.std(ddof=1) / np.sqrt(len(gap))) if len(gap) > 1 else float("nan")
        rows.append(CampaignRow(rank, fit, float(gap.mean()) if len(gap) else float("nan"), spread))
    return CampaignComparison(tuple(rows), str(against.model), against.error.unit, fits[0].error.noise_floor)


def _errors(fit: PooledFit, other: PooledFit) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Error of each log that belongs to both fits, where nothing of what is shared came from it."""
    belongs = {log.name for log in other.logs} - {*fit.odd, *other.odd}
    several = len(fit.logs) > 1
    return np.array([log.by_log if several else log.error.held_out for log in fit.logs if log.name in belongs])
