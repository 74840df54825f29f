"""Models side by side on a campaign: on blocks of time, and on whole logs, that their fits have not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.identification.compare import PairedDifference, paired, reference_place
from kinid.identification.pooling.fit import fit_logs
from kinid.identification.pooling.result import PooledFit
from kinid.modeling.model import Model
from kinid.writers import Json, finite

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign


@dataclass(frozen=True, eq=False, kw_only=True)
class CampaignRow(PairedDifference):
    """One model: its fit, and how its errors on logs held out differ from the reference's."""

    rank: int
    fit: PooledFit


@dataclass(frozen=True, eq=False)
class CampaignComparison:
    """Models in the order of their error on logs held out; the reference is named."""

    rows: tuple[CampaignRow, ...]
    reference: str
    unit: str
    noise_floor: float

    def to_dict(self) -> Json:
        """For JSON; None where there is no figure."""
        return {
            "reference": self.reference,
            "unit": self.unit,
            "noise_floor": self.noise_floor,
            "models": [
                {
                    "rank": row.rank,
                    "held_out": finite(row.fit.error.held_out),
                    "held_out_by_log": finite(row.fit.by_log),
                    "difference": finite(row.difference),
                    "standard_error": finite(row.standard_error),
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
    fits = [
        fit_logs(model, logs, campaign.sharing_for(model), progress=progress, elsewhere=campaign.elsewhere)
        for model in models
    ]
    fits.sort(key=lambda fit: fit.by_log if np.isfinite(fit.by_log) else fit.error.held_out)
    names = [str(fit.model) for fit in fits]
    against = fits[reference_place(names, reference)]
    rows = tuple(
        CampaignRow(rank=rank, fit=fit, **paired(_errors(fit, against) - _errors(against, fit)))
        for rank, fit in enumerate(fits, start=1)
    )
    return CampaignComparison(rows, str(against.model), against.error.unit, fits[0].error.noise_floor)


def _errors(fit: PooledFit, other: PooledFit) -> NDArray[np.float64]:
    """Error of each log that belongs to both fits, where nothing of what is shared came from it."""
    belongs = {log.name for log in other.logs} - {*fit.odd, *other.odd}
    several = len(fit.logs) > 1
    return np.array([log.by_log if several else log.error.held_out for log in fit.logs if log.name in belongs])
