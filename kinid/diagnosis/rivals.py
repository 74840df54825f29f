"""Whether two refits of one state explain the same part of the error, and one of them better."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.acceptance import Evidence, Refit, compare_states
from kinid.diagnosis.settings import DiagnosisSettings

Array = NDArray[np.float64]

#: two refits that have less than this share of their changes in common explain different parts of the error
MIN_OVERLAP = 0.5


def indistinguishable(one: Refit, other: Refit, sigma: Array, settings: DiagnosisSettings) -> bool:
    """Whether two refits of one state explain the same, as well, with errors weighed by σ (channels, g)."""
    between = compare_states(other.state, one.state, sigma)
    if between.gain < 0.0:  # what the better one leaves is what chance acts through
        between = compare_states(one.state, other.state, sigma)
    return not _clear(between, settings) and overlap(one, other, sigma) >= MIN_OVERLAP


def _clear(between: Evidence, settings: DiagnosisSettings) -> bool:
    """Whether two refits differ by more than chance, and by a share that is worth a word."""
    return (
        abs(between.gain) > settings.alternative_significance * between.error
        and abs(between.share) > settings.alternative_share
    )


def covers(one: Refit, other: Refit, sigma: Array, settings: DiagnosisSettings) -> bool:
    """Whether a refit explains what another one explains, as well or better."""
    between = compare_states(one.state, other.state, sigma)
    better = _clear(between, settings) and between.gain > 0.0 and between.share > 0.0
    return not better and overlap(one, other, sigma) >= MIN_OVERLAP


def overlap(one: Refit, other: Refit, sigma: Array) -> float:
    """Squared cosine between what two refits change, held out: 1 where they explain the same, 0 where other parts."""
    a, b = (((t.before.held_out - t.state.held_out) / sigma).ravel() for t in (one, other))
    return float(a @ b) ** 2 / max(1e-300, float(a @ a) * float(b @ b))
