"""Normal equations by log, and their Schur complement: what logs share couples them, what is a log's own couples it
alone.

With the directions a log shares, s, and its own, o, H = [[H_ss, H_so], [H_os, H_oo]]: its own ones are eliminated,
S = Σ (H_ss − H_so H_oo⁻¹ H_os) is solved for what is shared, and each log's own follow (D. C. Brown, The bundle
adjustment, Int. Arch. Photogrammetry 21, 1976; B. Triggs et al., Bundle adjustment, 2000, § 6). Cost and memory grow
linearly with logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.identification.pooling.sharing import Directions
from kinid.identification.state import State, solve_box_constrained

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Normals:
    """Squares and slopes of one log at one place.

    Attributes:
        squares: JᵀΣ⁻¹J of all its directions, in scales, (d, d). slope: JᵀΣ⁻¹r, (d,). cost: rᵀΣ⁻¹r.
        fold_squares, fold_slopes: the same of each of the two folds.
        inflation: how much more a mean varies than with white errors.
    """

    squares: Array
    slope: Array
    cost: float
    fold_squares: tuple[Array, Array]
    fold_slopes: tuple[Array, Array]
    inflation: float

    @classmethod
    def of(cls, state: State) -> Normals:
        """Those of a state."""
        channels, groups = state.problem.shape
        weight = 1.0 / state.error.sigma
        rows = state.jacobian.reshape(channels, groups, -1) * weight[:, :, None]
        residual, fold = state.residual * weight, state.problem.fold
        squares, slopes = [], []
        for seen in (fold, ~fold):
            own = rows[:, seen].reshape(-1, rows.shape[2])
            squares.append(own.T @ own)
            slopes.append(own.T @ residual[:, seen].ravel())
        return cls(
            squares[0] + squares[1],
            slopes[0] + slopes[1],
            float(np.sum(residual**2)),
            (squares[0], squares[1]),
            (slopes[0], slopes[1]),
            state.inflation,
        )


@dataclass(frozen=True, eq=False)
class Reduced:
    """One log's normal equations with its own directions eliminated.

    Attributes:
        squares: Schur complement on what it shares, (s, s). slope: (s,).
        gain: change of its own per change of what it shares, −H_oo⁻¹ H_os, (o, s). alone: of its own with what is
            shared held, H_oo⁻¹ b_o, (o,). own_squares: H_oo, (o, o).
    """

    squares: Array
    slope: Array
    gain: Array
    alone: Array
    own_squares: Array


def reduce(
    squares: Array, slope: Array, at: Directions, own_prior: Array, own: Array, *, extra: Array, free: Mask
) -> Reduced:
    """Eliminate a log's own directions.

    Args:
        squares, slope: of all directions, without priors, (d, d), (d,). at: where they stand.
        own_prior: precision of its own, (o, o). own: where those are, in scales, (o,).
        extra: what is added to the diagonal, (d,). free: which of its own no bound holds, (o,).
    """
    damped = squares + np.diag(extra)
    s, o = at.shared, at.own[free]
    h_os = damped[np.ix_(o, s)]
    # a deviation from a mean that is shared moves readings as that mean does, and what is added holds each alone
    h_os -= extra[o][:, None] * (o[:, None] == s[None, :])
    h_oo = damped[np.ix_(o, o)] + own_prior[np.ix_(free, free)]
    b_o = slope[o] - (own_prior @ own)[free]
    solved = np.linalg.solve(h_oo, np.column_stack([h_os, b_o])) if len(o) else np.zeros((0, len(s) + 1))
    gain, alone = np.zeros((len(at.own), len(s))), np.zeros(len(at.own))
    gain[free], alone[free] = -solved[:, :-1], solved[:, -1]
    full = np.diag(np.ones(len(at.own)))
    full[np.ix_(free, free)] = h_oo
    return Reduced(damped[np.ix_(s, s)] - h_os.T @ solved[:, :-1], slope[s] - h_os.T @ solved[:, -1], gain, alone, full)


def gather(parts: Sequence[tuple[Directions, Array, Array]], size: int) -> tuple[Array, Array]:
    """Sums over logs of what they say of the shared directions: squares (m, m) and slopes (m,)."""
    h, b = np.zeros((size, size)), np.zeros(size)
    for at, squares, slope in parts:
        np.add.at(h, (at.into[:, None], at.into[None, :]), squares)
        np.add.at(b, at.into, slope)
    return h, b


def shared_step(h: Array, b: Array, low: Array, high: Array, free: Mask) -> Array:
    """Step of the shared directions between bounds, (m,); none of those that a bound holds."""
    step, f = np.zeros(len(b)), np.flatnonzero(free)
    if len(f):
        step[f] = solve_box_constrained(h[np.ix_(f, f)], b[f], low[f], high[f])
    return step
