"""Runs of samples without a gap."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: a pause longer than this many median sample times is a gap: nothing is filtered or interpolated across it
GAP_FACTOR = 5.0


def finite_rows(values: Array) -> NDArray[np.bool_]:
    """Rows of (n, k) whose entries are all finite numbers, (n,): exactly then their sum is."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.isfinite(values @ np.ones(values.shape[1])))  # faster than a sum over few columns


def runs(t: Array, x: Array, pieces: Iterable[slice], gap: float) -> Iterator[NDArray[np.int64]]:
    """Rows of the pieces in which all of `x` (n, k) are finite numbers, apart where what is left out makes a gap."""
    good = finite_rows(x)
    for piece in pieces:
        rows = piece.start + np.flatnonzero(good[piece])
        if len(rows) == piece.stop - piece.start:
            yield rows
        elif len(rows):
            yield from np.split(rows, np.flatnonzero(np.diff(t[rows]) > gap) + 1)
