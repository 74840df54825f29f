"""Covariance of estimates whose errors remember: a sandwich over blocks of time, no tighter than memory or kinds of
motion allow, and what a sensor's gain and curvature may add to it.

V = H⁻¹ M H⁻¹ with the information H and M the sum over blocks of squared scores, neighbours included (W. K. Newey, K.
D. West, Econometrica 55, 1987; small samples: J. G. MacKinnon, H. White, J. Econometrics 29, 1985). Nuisances count
with their prior in both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.kinds_of_motion import kinds_of_motion
from kinid.identification.error_model import NOISE_UNCERTAINTY
from kinid.identification.state import FOLD_RIDGE, State, fixed_parameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: change of all weighted readings per scale of a parameter, as a length, below which it isn't seen
MIN_CHANGE = 1e-4
#: eigenvalue of the normalised information below which a direction isn't identified, and share of it that takes part
MIN_EIGENVALUE, MIN_PARTICIPATION = 1e-10, 0.1

#: of a channel's root mean square, the nonlinearity that six-axis sensors are sold with; and of a curvature, the least
#: share that is taken to be visible
MAX_NONLINEARITY, MIN_VISIBLE = 0.01, 1e-6


@dataclass(frozen=True, eq=False)
class Covariance:
    """Of a model's parameters.

    Attributes:
        matrix: (p, p); infinite in rows of unidentified parameters, zero in those read off the samples.
        inverse: of the information alone, scaled by nothing, (p, p): how parameters trade against each other.
        unidentified: (p,). condition: of the sensitivity, its columns brought to length one.
    """

    matrix: Array
    inverse: Array
    unidentified: Mask
    condition: float


def covariance_of(state: State) -> Covariance:
    """Covariance of a state's parameters, nuisances integrated out."""
    p = len(state.values)
    if not p:
        return Covariance(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0, np.bool_), 1.0)
    moving = np.isnan(fixed_parameters(state.model, state.problem))
    jacobian = state.jacobian / state.error.sigma.reshape(-1, 1)
    length = np.linalg.norm(jacobian[:, :p], axis=0)
    unseen = moving & (length < MIN_CHANGE)
    keep = np.r_[moving & ~unseen, np.ones(len(state.shift), np.bool_)]
    own = np.flatnonzero(keep)
    prior = state.prior[np.ix_(own, own)]
    information = jacobian[:, own].T @ jacobian[:, own] + prior
    rows = jacobian[:, own]
    meat = small_sample(blocks_of(state), len(own)) * squared_scores(state, rows) + prior
    spread, inverse, open_, condition = sandwich(
        information,
        meat,
        lambda inverse: (
            np.maximum(np.diag(inverse) * state.inflation, _unlike(state, rows, information))
            + np.sum((inverse @ scores_of_nonlinear_sensor(state, rows, inverse)) ** 2, axis=1)
        ),
    )
    matrix, unidentified = np.zeros((p, p)), unseen.copy()
    at = own[own < p]
    matrix[np.ix_(at, at)] = spread[: len(at), : len(at)] * np.outer(state.scale[at], state.scale[at])
    trade = np.zeros((p, p))
    trade[np.ix_(at, at)] = inverse[: len(at), : len(at)] * np.outer(state.scale[at], state.scale[at])
    unidentified[at] = open_[: len(at)]
    matrix[unidentified, :] = 0.0
    matrix[:, unidentified] = 0.0
    matrix[unidentified, unidentified] = np.inf
    return Covariance(matrix, trade, unidentified, condition)


def sandwich(information: Array, meat: Array, floor: Callable[[Array], Array]) -> tuple[Array, Array, Mask, float]:
    """Covariance of directions, the inverse of their information alone, which are open (m,), and the condition.

    Args:
        information: of all directions, priors included, (m, m). meat: squared scores, (m, m).
        floor: variances (m,) that no direction's is below, from the inverse of the information (m, m).
    """
    size = np.sqrt(np.diag(information))
    eigenvalue, vector = np.linalg.eigh(information / np.outer(size, size))
    lost = eigenvalue < MIN_EIGENVALUE
    open_ = (np.abs(vector[:, lost]) > MIN_PARTICIPATION).any(axis=1)
    inverse = (vector[:, ~lost] / eigenvalue[~lost]) @ vector[:, ~lost].T / np.outer(size, size)
    spread = inverse @ meat @ inverse
    with np.errstate(divide="ignore", invalid="ignore"):
        widen = np.sqrt(np.maximum(1.0, floor(inverse) / np.maximum(np.diag(spread), 1e-300)))
    seen = eigenvalue[~lost]
    condition = float(np.sqrt(seen[-1] / seen[0])) if len(seen) else 1.0
    return spread * np.outer(widen, widen), inverse, open_, condition


def blocks_of(state: State) -> int:
    """Blocks of time that count."""
    return int(state.problem.block.max()) + 1 if len(state.problem.block) else 0


def small_sample(blocks: int, directions: int) -> float:
    """By how much squared scores of so many blocks fall short of the truth beside so many free directions."""
    return blocks / max(1, blocks - directions) if blocks > directions else 2.0


def squared_scores(state: State, jacobian: Array) -> Array:
    """Squared scores over blocks, (m, m), those of neighbours included as far as that widens.

    Args:
        state: as fitted. jacobian: weighted change of the means per step of each direction, (channels · g, m).
    """
    return widened(*block_scores(state, jacobian))


def widened(own: Array, near: Array) -> Array:
    """Squared scores (m, m), with those of neighbours where these are more."""
    widen = np.maximum(np.diag(near), np.diag(own)) / np.maximum(np.diag(own), 1e-300)
    return np.asarray(own * np.sqrt(np.outer(widen, widen)), dtype=np.float64)


def block_scores(state: State, jacobian: Array) -> tuple[Array, Array]:
    """Squared scores over blocks by themselves, and with those of neighbours, each (m, m); see `squared_scores`."""
    problem = state.problem
    score = jacobian * (state.residual / state.error.sigma).reshape(-1, 1)
    per_group = score.reshape(*problem.shape, -1).sum(axis=0)
    blocks = blocks_of(state)
    total = np.stack([np.bincount(problem.block, column, blocks) for column in per_group.T], axis=1)
    total -= total.mean(axis=0)
    own = np.asarray(total.T @ total, dtype=np.float64)
    cross = total[1:].T @ total[:-1]
    return own, own + 0.5 * (cross + cross.T)


def _unlike(state: State, jacobian: Array, information: Array) -> Array:
    """Variance of parameters (p,) from clusters of one kind of motion, the largest of several ways to cluster.

    A law of another form errs alike wherever the tool does the same, however often it does so: a sandwich over clusters
    of several kinds (A. C. Cameron, J. B. Gelbach, D. L. Miller, J. Bus. Econ. Stat. 29, 2011), right for few clusters
    that weigh unlike (R. M. Bell, D. F. McCaffrey, Survey Methodology 28, 2002).
    """
    problem, s, out = state.problem, state.problem.experiment.signals, np.zeros(len(information))
    rows = jacobian.reshape(*problem.shape, -1)
    scores = rows * (state.residual / state.error.sigma)[:, :, None]
    for kind in kinds_of_motion(problem.mean_at(s.depth), *map(problem.mean_at, (s.depth_rate, *s.slip_rate))):
        clusters = []
        for number in range(int(kind.max()) + 1):
            part = rows[:, kind == number].reshape(-1, len(information))
            clusters.append((part.T @ part, scores[:, kind == number].sum(axis=(0, 1))))
        out = np.maximum(out, cluster_variance(information, clusters))
    return out


def scores_of_nonlinear_sensor(state: State, jacobian: Array, inverse: Array) -> Array:
    """Scores of a gain and a curvature of each channel, both of one size, (m, 2 · channels).

    An error that goes with the reading errs alike all over a log, and parameters take most of it up. Its size follows
    from the discrepancy, as far as that may be what parameters leave of a curvature.

    Args:
        state: as fitted. jacobian: weighted change of the means per step of each direction, (channels · g, m).
        inverse: of the information of these directions, (m, m).
    """
    predicted = state.problem.target.reshape(state.problem.shape) - state.residual
    rows, sigma = jacobian.reshape(*state.problem.shape, -1), state.error.sigma
    out = np.zeros((jacobian.shape[1], len(predicted), 2))
    for channel, reading in enumerate(predicted):
        doubt = NOISE_UNCERTAINTY * float(np.mean(state.error.noise[channel] ** 2))
        seen = float(np.sqrt(max(0.0, state.error.discrepancy[channel] ** 2 - doubt)))
        if seen == 0.0 or not reading.any():
            continue
        shapes = np.stack([reading / _rms(reading), reading**2 / _rms(reading**2)])
        score = rows[channel].T @ (shapes / sigma[channel]).T
        visible = _rms(shapes[1] - sigma[channel] * (rows[channel] @ (inverse @ score[:, 1])))
        most = MAX_NONLINEARITY * _rms(reading)
        out[:, channel] = min(seen / max(visible, MIN_VISIBLE), most) * score
    return out.reshape(len(out), -1)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def cluster_variance(information: Array, clusters: Iterable[tuple[Array, Array]]) -> Array:
    """Variance of directions, (m,), from the scores of a few clusters that weigh unlike.

    Args:
        information: of all directions, (m, m). clusters: of each its squares (m, m) and its score (m,).
    """
    root: Array = np.linalg.inv(np.linalg.cholesky(information + FOLD_RIDGE * np.diag(np.diag(information))))
    out = np.zeros(len(information))
    for squares, score in clusters:
        share, vector = np.linalg.eigh(root @ squares @ root.T)
        own = vector.T @ root @ score
        out += (root.T @ vector @ (own / np.sqrt(np.maximum(1.0 - share, FOLD_RIDGE)))) ** 2
    return out
