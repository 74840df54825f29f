"""What a pooled fit would have said without a part of the readings: one fold of every log's blocks, or a whole log."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.identification.pooling.normals import Reduced, shared_step
from kinid.identification.pooling.pool import Pool
from kinid.identification.state import FOLD_RIDGE, State

Array = NDArray[np.float64]
Steps = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class LogState(State):
    """One log of a pooled fit, whose folds are predicted from what other readings say.

    Attributes:
        given_steps: step of all directions, in scales, to the parameters that each fold, and then the other, tells.
    """

    given_steps: Steps

    @classmethod
    def made(cls, state: State, steps: Steps) -> LogState:
        """A state with other steps than its own."""
        own = {field.name: getattr(state, field.name) for field in dataclasses.fields(State)}
        return cls(**own, given_steps=steps)

    @cached_property
    def fold_steps(self) -> Steps:
        """Those that were given."""
        return self.given_steps


class HeldOut:
    """Steps of each log's directions from the common fit to fits without a part, one Gauss-Newton step each.

    Args:
        pool: at its best.
    """

    def __init__(self, pool: Pool) -> None:
        self.pool = pool
        prior, (low, high) = pool.vector.prior, pool.vector.bounds
        self._low, self._high = low - pool.spot.shared, high - pool.spot.shared
        self.squares, self.slope, self.parts = pool.gathered(pool.reduced)
        self.free = pool.free_shared(self.slope)
        self._folds = []
        for fold in (0, 1):
            h, b, parts = pool.gathered(lambda number, fold=fold: self._fold(number, fold))  # type: ignore[misc]
            h += FOLD_RIDGE * np.diag(np.diag(prior))
            self._folds.append((shared_step(h, b, self._low, self._high, self.free), parts))

    def _fold(self, number: int, fold: int) -> Reduced:
        normals, at = self.pool.normals[number], self.pool.at[number]
        extra = FOLD_RIDGE * np.diag(normals.squares)
        extra[at.own] += FOLD_RIDGE * np.diag(self.pool.own_prior(number))
        return self.pool.reduced(number, normals.fold_squares[fold], normals.fold_slopes[fold], extra)

    def by_block(self, number: int) -> Steps:
        """To the fits of each fold of all logs alone."""
        first, second = (self._all(number, step, parts[number]) for step, parts in self._folds)
        return first, second

    def without(self, number: int) -> Array:
        """Step of what is shared to where all logs but one would have it, (m,)."""
        at, part = self.pool.at[number], self.parts[number]
        h, b = self.squares.copy(), self.slope.copy()
        np.add.at(h, (at.into[:, None], at.into[None, :]), -part.squares)
        np.add.at(b, at.into, -part.slope)
        h += FOLD_RIDGE * np.diag(np.diag(self.squares))
        return shared_step(h, b, self._low, self._high, self.free)

    def by_log(self, number: int) -> Steps:
        """To what is shared as all other logs say, and the log's own as each of its folds says beside that."""
        step = self.without(number)
        first, second = (self._all(number, step, parts[number]) for _, parts in self._folds)
        return first, second

    def _all(self, number: int, step: Array, part: Reduced) -> Array:
        """Step of all directions of a log, (d,), for one of what is shared, (m,)."""
        at, here = self.pool.at[number], self.pool.spot.own[number]
        own = here + part.alone + part.gain @ step[at.into]
        ends = np.where(at.population, -np.inf, at.low[at.own]), np.where(at.population, np.inf, at.high[at.own])
        out = np.zeros(len(at.scale))
        out[at.shared] += step[at.into]
        out[at.own] += np.clip(own, *ends) - here
        return out

    def disagreement(self, number: int) -> tuple[float, float]:
        """How far a log's own wish for the shared parameters is from what the others say: χ², and its expectation."""
        at, part = self.pool.at[number], self.parts[number]
        kept = self.pool.vector.parameters()[at.into]
        s, slope = part.squares[np.ix_(kept, kept)], part.slope[kept]
        rest = (self.squares[np.ix_(at.into, at.into)] - part.squares)[np.ix_(kept, kept)]
        size = np.sqrt(np.maximum(np.diag(s), 1e-300))
        value, vector = np.linalg.eigh(s / np.outer(size, size))
        seen = value > 1e-6
        turn = vector[:, seen] / size[:, None]
        alone = turn @ ((turn.T @ slope) / value[seen])
        others = np.linalg.lstsq(rest + 1e-12 * np.diag(np.diag(rest) + 1.0), slope, rcond=1e-10)[0]
        found = float(slope @ (alone + others)) / self.pool.normals[number].inflation
        return found, float(seen.sum())
