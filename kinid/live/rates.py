"""Whether a stream's joint velocities are the rates of its positions: another sign or unit shows while joints move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: a joint is judged by pieces of so much motion [rad or m], far above what encoders round to; of so many at least
PIECE, FEWEST = 0.02, 8
#: a piece that takes longer is left out, for a bias of the velocities adds up [s]; and one with such a pause in it
LONGEST, PAUSE = 2.0, 0.1
#: velocities are others than the positions' rates beyond this factor: filters and lags stay far below it
MOST = 2.0


class Rates:
    """Takes samples now and then; what it keeps doesn't grow.

    Args:
        joints: how many.
    """

    def __init__(self, joints: int) -> None:
        self._t = -np.inf
        self._dq = np.full(joints, np.nan)
        self._from, self._since, self._integral = np.zeros(joints), np.zeros(joints), np.zeros(joints)
        self._pieces, self._squares, self._products = np.zeros((3, joints))

    def take(self, t: float, q: Array, dq: Array) -> Array | None:
        """One sample.

        Args:
            t: time [s]. q: positions (N,) [rad or m]. dq: velocities as they came, (N,) [rad/s or m/s].

        Returns:
            Velocity over the positions' rate by joint, (N,), NaN where too little moved, once one of them is beyond
            `MOST`; None else. It is the slope of ∫ dq dt over Δq, piece by piece, by least squares.
        """
        step, mean = t - self._t, 0.5 * (dq + self._dq)
        self._t, self._dq = t, dq.copy()
        if not (0.0 < step < PAUSE and np.isfinite(mean).all()):
            self._begin(np.ones(len(q), bool), t, q)
            return None
        self._integral += step * mean
        moved = q - self._from
        whole = np.abs(moved) >= PIECE
        if whole.any():
            self._pieces[whole] += 1.0
            self._squares[whole] += moved[whole] ** 2
            self._products[whole] += moved[whole] * self._integral[whole]
        self._begin(whole | (t - self._since > LONGEST), t, q)
        judged = self._pieces >= FEWEST
        if not (whole & judged).any():
            return None
        slope = np.full(len(q), np.nan)
        slope[judged] = self._products[judged] / self._squares[judged]
        with np.errstate(invalid="ignore"):
            is_other = (slope < 1.0 / MOST) | (slope > MOST)
        return slope if is_other.any() else None

    def _begin(self, which: NDArray[np.bool_], t: float, q: Array) -> None:
        """Another piece of these joints."""
        self._from[which], self._since[which], self._integral[which] = q[which], t, 0.0
