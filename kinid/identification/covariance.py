"""Covariance of estimates whose errors remember: a sandwich over blocks of time, no tighter than memory or kinds of
motion allow.

V = H⁻¹ M H⁻¹ with the information H and M the sum over blocks of squared scores, neighbours included (W. K. Newey, K.
D. West, Econometrica 55, 1987; small samples: J. G. MacKinnon, H. White, J. Econometrics 29, 1985). Nuisances count
with their prior in both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.kinds_of_motion import kinds_of_motion
from kinid.identification.state import FOLD_RIDGE, State, fixed_parameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: change of all weighted readings per scale of a parameter, as a length, below which it isn't seen
MIN_CHANGE = 1e-4
#: eigenvalue of the normalised information below which a direction isn't identified, and share of it that takes part
MIN_EIGENVALUE, MIN_PARTICIPATION = 1e-10, 0.1


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
    size = np.sqrt(np.diag(information))
    normal = information / np.outer(size, size)
    eigenvalue, vector = np.linalg.eigh(normal)
    lost = eigenvalue < MIN_EIGENVALUE
    open_ = (np.abs(vector[:, lost]) > MIN_PARTICIPATION).any(axis=1)
    inverse = (vector[:, ~lost] / eigenvalue[~lost]) @ vector[:, ~lost].T / np.outer(size, size)
    spread = inverse @ _meat(state, jacobian[:, own], prior) @ inverse
    floor = np.maximum(np.diag(inverse) * state.inflation, _unlike(state, jacobian[:, own], information))
    with np.errstate(divide="ignore", invalid="ignore"):
        widen = np.sqrt(np.maximum(1.0, floor / np.maximum(np.diag(spread), 1e-300)))
    spread = spread * np.outer(widen, widen)
    matrix, unidentified = np.zeros((p, p)), unseen.copy()
    at = own[own < p]
    matrix[np.ix_(at, at)] = spread[: len(at), : len(at)] * np.outer(state.scale[at], state.scale[at])
    trade = np.zeros((p, p))
    trade[np.ix_(at, at)] = inverse[: len(at), : len(at)] * np.outer(state.scale[at], state.scale[at])
    unidentified[at] = open_[: len(at)]
    matrix[unidentified, :] = 0.0
    matrix[:, unidentified] = 0.0
    matrix[unidentified, unidentified] = np.inf
    seen = eigenvalue[~lost]
    return Covariance(matrix, trade, unidentified, float(np.sqrt(seen[-1] / seen[0])) if len(seen) else 1.0)


def _meat(state: State, jacobian: Array, prior: Array) -> Array:
    """Squared scores over blocks, those of neighbours included as far as that widens, and the nuisances' priors."""
    problem = state.problem
    score = jacobian * (state.residual / state.error.sigma).reshape(-1, 1)
    per_group = score.reshape(*problem.shape, -1).sum(axis=0)
    blocks = int(problem.block.max()) + 1 if len(problem.block) else 0
    total = np.stack([np.bincount(problem.block, column, blocks) for column in per_group.T], axis=1)
    total -= total.mean(axis=0)
    own = total.T @ total
    cross = total[1:].T @ total[:-1]
    near = own + 0.5 * (cross + cross.T)
    small = blocks / max(1, blocks - jacobian.shape[1]) if blocks > jacobian.shape[1] else 2.0
    widen = np.maximum(np.diag(near), np.diag(own)) / np.maximum(np.diag(own), 1e-300)
    out: Array = small * own * np.sqrt(np.outer(widen, widen)) + prior
    return out


def _unlike(state: State, jacobian: Array, information: Array) -> Array:
    """Variance of parameters (p,) from clusters of one kind of motion, the largest of several ways to cluster.

    A law of another form errs alike wherever the tool does the same, however often it does so: a sandwich over clusters
    of several kinds (A. C. Cameron, J. B. Gelbach, D. L. Miller, J. Bus. Econ. Stat. 29, 2011), right for few clusters
    that weigh unlike (R. M. Bell, D. F. McCaffrey, Survey Methodology 28, 2002).
    """
    problem, s, out = state.problem, state.problem.experiment.signals, np.zeros(len(information))
    rows = jacobian.reshape(*problem.shape, -1)
    scores = rows * (state.residual / state.error.sigma)[:, :, None]
    root = np.linalg.inv(np.linalg.cholesky(information + FOLD_RIDGE * np.diag(np.diag(information))))
    for kind in kinds_of_motion(problem.mean_at(s.depth), *map(problem.mean_at, (s.depth_rate, *s.slip_rate))):
        moved = np.zeros(len(information))
        for number in range(int(kind.max()) + 1):
            j = rows[:, kind == number].reshape(-1, len(information)) @ root.T
            share, vector = np.linalg.eigh(j.T @ j)
            own = vector.T @ root @ scores[:, kind == number].sum(axis=(0, 1))
            moved += (root.T @ vector @ (own / np.sqrt(np.maximum(1.0 - share, FOLD_RIDGE)))) ** 2
        out = np.maximum(out, moved)
    return out
