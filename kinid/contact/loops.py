"""Loops of force over depth: where each begins and ends, and the energy that it encloses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: a way in and out counts as a cycle from this share of the greatest depth (or, without separation, of the range) on
NOTICEABLE = 0.25


@dataclass(frozen=True)
class Loop:
    """One way in and out: rows from `begin` to before `end`; energy that went in, and that did not come back [J]."""

    begin: int
    end: int
    put_in: float
    lost: float

    @property
    def share(self) -> float:
        """Share of the energy put in that was lost."""
        return self.lost / self.put_in if self.put_in > 0 else float("nan")


def loops(depth: Array, force: Array, dt: Array) -> list[Loop]:
    """Ways in and out of a material with their energy ∮ N dδ (positive: lost to the material).

    A touch from contact to separation is one; in a touch with several presses each lies between two minima of the
    depth. The loop is closed by a straight line from its end to its beginning.

    Args:
        depth: δ [m], (n,). force: N [N], (n,); samples that are NaN are passed over. dt: 0 where a piece begins, (n,).
    """
    out = []
    for begin, end in cycles(depth, dt):
        rows = np.arange(begin, end)
        rows = rows[np.isfinite(depth[rows]) & np.isfinite(force[rows])]
        if len(rows) < 4:
            continue
        d, f = depth[rows], force[rows]
        work = 0.5 * (f[1:] + f[:-1]) * np.diff(d)
        closing = 0.5 * (f[0] + f[-1]) * (d[0] - d[-1])
        out.append(Loop(begin, end, float(work[work > 0].sum()), float(work.sum() + closing)))
    return out


def cycles(depth: Array, dt: Array) -> list[tuple[int, int]]:
    """First row, and the row after the last, of each way in and out."""
    from scipy.signal import find_peaks

    deepest = float(np.nanmax(depth, initial=0.0))
    out: list[tuple[int, int]] = []
    for begin, end, closed in _touches(depth, dt):
        inside = depth[begin:end]
        span = float(inside.max()) if closed else float(np.ptp(inside))
        if len(inside) < 4 or (closed and span < NOTICEABLE * deepest):
            continue
        minima = find_peaks(-inside, prominence=max(NOTICEABLE * span, 1e-12))[0]
        ends = [*([0] if closed else []), *minima.tolist(), *([len(inside)] if closed else [])]
        out += [(begin + a, begin + b + (b < len(inside))) for a, b in zip(ends[:-1], ends[1:])]
    return out


def _touches(depth: Array, dt: Array) -> Sequence[tuple[int, int, bool]]:
    """Runs inside the material, from the sample before to the one after; whether both are in the air."""
    inside = np.nan_to_num(depth, nan=-1.0) > 0.0
    starts = np.flatnonzero(dt == 0.0)
    edges = [*starts.tolist(), len(depth)] if len(starts) and starts[0] == 0 else [0, *starts.tolist(), len(depth)]
    out = []
    for a, b in zip(edges[:-1], edges[1:]):
        change = np.diff(inside[a:b].astype(np.int8), prepend=0, append=0)
        for first, after in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1)):
            closed = bool(first > 0 and after < b - a)
            out.append((a + int(first) - closed, a + int(after) + closed, closed))
    return out
