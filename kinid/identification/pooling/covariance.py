"""Covariance of pooled estimates: the sandwich of one log's, log by log on what is shared; no tighter than memory,
kinds of motion or logs allow.

What is a log's own is projected out of its scores (E = s − H_so H_oo⁻¹ o), so that the sandwich on what is shared is
that of the whole problem. Logs are clusters as well: what differs between them and isn't in the model widens intervals
(R. M. Bell, D. F. McCaffrey, Survey Methodology 28, 2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.kinds_of_motion import labels_of_motion
from kinid.identification.covariance import (
    MIN_CHANGE,
    block_scores,
    blocks_of,
    cluster_variance,
    sandwich,
    scores_of_nonlinear_sensor,
    small_sample,
    widened,
)
from kinid.identification.pooling.held_out import HeldOut
from kinid.identification.pooling.normals import Reduced
from kinid.identification.pooling.pool import Pool
from kinid.identification.pooling.sharing import Directions
from kinid.identification.state import State

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Cluster = tuple[Array, Array]

#: logs from which on they are clusters: fewer tell nothing of how logs differ
ENOUGH_LOGS = 5


@dataclass(frozen=True, eq=False)
class PooledCovariance:
    """Of what is shared, in scales.

    Attributes:
        matrix: (m, m), infinite where unidentified. inverse: of the information alone, (m, m). unidentified: (m,).
        condition: of the sensitivity.
    """

    matrix: Array
    inverse: Array
    unidentified: Mask
    condition: float


@dataclass(frozen=True, eq=False)
class Asked:
    """What a log must know to say what it adds: where its directions stand, its own ones reduced, their prior, and its
    squares at the pool's best.
    """

    at: Directions
    part: Reduced
    prior: Array
    squares: Array

    @property
    def turn(self) -> Array:
        """Change of all directions of the log per change of what it shares, (d, s)."""
        out = np.zeros((len(self.at.scale), len(self.at.shared)))
        out[self.at.shared, np.arange(len(self.at.shared))] = 1.0
        out[self.at.own] += self.part.gain
        return out


@dataclass(frozen=True, eq=False)
class Shares:
    """What one log adds to the squared scores of what it shares.

    Attributes:
        meat: of blocks by themselves and with their neighbours, (2, s, s). length: squared length of each column, (s,).
        blocks: of time. inflation: of a mean. kinds: squares and scores of each kind of motion. own: covariance of its
            own directions, (o, o).
        channels: of its readings. sensor: scores of each one's gain and curvature, (s, 2 · channels).
    """

    meat: Array
    length: Array
    blocks: int
    inflation: float
    kinds: dict[tuple[int, int], Cluster]
    own: Array
    channels: tuple[str, ...]
    sensor: Array

    @classmethod
    def of(cls, state: State, asked: Asked) -> Shares:
        """Those of a log as it is at the pool's best."""
        at, part, prior, turn = asked.at, asked.part, asked.prior, asked.turn
        jacobian = state.jacobian / state.error.sigma.reshape(-1, 1)
        scores = block_scores(state, jacobian)
        inverse = np.linalg.pinv(part.own_squares, hermitian=True)
        own = inverse @ (widened(*scores)[np.ix_(at.own, at.own)] + prior) @ inverse
        floor = np.diag(inverse) * state.inflation
        widen = np.sqrt(np.maximum(1.0, floor / np.maximum(np.diag(own), 1e-300)))
        own = own * np.outer(widen, widen)
        lost = np.diag(asked.squares)[at.own] < MIN_CHANGE**2
        own[lost, lost] = np.inf
        meat = turn.T @ np.stack(scores) @ turn + part.gain.T @ prior @ part.gain
        length = np.sum(jacobian[:, at.shared] ** 2, axis=0)
        information = jacobian.T @ jacobian
        information[np.ix_(at.own, at.own)] += prior
        whole: Array = np.asarray(np.linalg.pinv(information, hermitian=True), dtype=np.float64)
        sensor = turn.T @ scores_of_nonlinear_sensor(state, jacobian, whole)
        kinds = _kinds(state, jacobian @ turn)
        return cls(
            meat, length, blocks_of(state), state.inflation, kinds, own, tuple(state.problem.layout.channels), sensor
        )


def _kinds(state: State, reduced: Array) -> dict[tuple[int, int], Cluster]:
    problem, s = state.problem, state.problem.experiment.signals
    rows = reduced.reshape(*problem.shape, -1)
    scores = rows * (state.residual / state.error.sigma)[:, :, None]
    labels = labels_of_motion(problem.mean_at(s.depth), *map(problem.mean_at, (s.depth_rate, *s.slip_rate)))
    out = {}
    for way, label in enumerate(labels):
        for value in np.unique(label).tolist():
            own = rows[:, label == value].reshape(-1, rows.shape[2])
            out[way, value] = own.T @ own, scores[:, label == value].sum(axis=(0, 1))
    return out


class Scores:
    """Squared scores of logs, added one after the other.

    Args:
        pool: at its best. held_out: whose reduced normal equations are known.
    """

    def __init__(self, pool: Pool, held_out: HeldOut) -> None:
        self.pool, self.held_out = pool, held_out
        size = len(pool.vector)
        self.meat, self.inflated = np.zeros((2, size, size)), np.zeros((size, size))
        self.length, self.blocks, self.inflation = np.zeros(size), 0, 0.0
        self.kinds: dict[tuple[int, int], Cluster] = {}
        self.sensors: dict[tuple[str, ...], Array] = {}
        self.logs: list[Cluster] = []
        self.own: list[Array] = []

    def asked(self, number: int) -> Asked:
        """What a log must know to say what it adds."""
        pool = self.pool
        return Asked(pool.at[number], self.held_out.parts[number], pool.own_prior(number), pool.normals[number].squares)

    def add(self, number: int, shares: Shares) -> None:
        """What one log adds."""
        at, part = self.pool.at[number], self.held_out.parts[number]
        for total, squares in zip(self.meat, shares.meat):
            self._scatter(total, at.into, squares)
        self._scatter(self.inflated, at.into, shares.inflation * part.squares)
        self.inflation += shares.inflation / len(self.pool)
        np.add.at(self.length, at.into, shares.length)
        self.blocks += shares.blocks
        for kind, cluster in shares.kinds.items():
            new, old = self._placed(at.into, *cluster), self.kinds.get(kind)
            self.kinds[kind] = new if old is None else (old[0] + new[0], old[1] + new[1])
        # one sensor errs alike in all logs
        sensor = self.sensors.setdefault(shares.channels, np.zeros((len(self.length), shares.sensor.shape[1])))
        np.add.at(sensor, at.into, shares.sensor)
        self.logs.append(self._placed(at.into, part.squares, part.slope))
        self.own.append(shares.own)

    def _placed(self, into: NDArray[np.int64], squares: Array, slope: Array) -> Cluster:
        h, b = np.zeros_like(self.inflated), np.zeros(len(self.inflated))
        self._scatter(h, into, squares)
        np.add.at(b, into, slope)
        return h, b

    @staticmethod
    def _scatter(total: Array, into: NDArray[np.int64], squares: Array) -> None:
        np.add.at(total, (into[:, None], into[None, :]), squares)

    def covariance(self) -> PooledCovariance:
        """Of what is shared, once all logs were added."""
        pool, size = self.pool, len(self.pool.vector)
        parameters = pool.vector.parameters()
        unseen = parameters & (np.sqrt(self.length) < MIN_CHANGE)
        kept = np.flatnonzero(~unseen)
        at = np.ix_(kept, kept)
        if not len(kept):
            return PooledCovariance(np.diag(np.full(size, np.inf)), np.zeros((size, size)), unseen, 1.0)
        prior = pool.vector.prior[at]
        directions = len(kept) + sum(len(d.own) for d in pool.at)
        # the larger of both in each log would add up what chance makes larger
        scores = widened(self.meat[0][at], self.meat[1][at])
        meat = small_sample(self.blocks, directions) * scores + prior
        information = self.held_out.squares[at]
        inflated = self.inflated[at] + self.inflation * prior
        clusters = [[(h[at], b[kept]) for (w, _), (h, b) in self.kinds.items() if w == way] for way, _ in self.kinds]
        if len(self.logs) >= ENOUGH_LOGS:
            clusters.append([(h[at], b[kept]) for h, b in self.logs])

        def floor(inverse: Array) -> Array:
            out = np.diag(inverse @ inflated @ inverse)
            for several in clusters:
                if len(several) > 1:
                    out = np.maximum(out, cluster_variance(information, several))
            return np.asarray(out + sum(np.sum((inverse @ s[kept]) ** 2, axis=1) for s in self.sensors.values()))

        spread, inverse, open_, condition = sandwich(information, meat, floor)
        matrix, whole, lost = np.zeros((size, size)), np.zeros((size, size)), unseen.copy()
        matrix[at], whole[at] = spread, inverse
        lost[kept] = open_ & parameters[kept]
        matrix[lost, :] = matrix[:, lost] = 0.0
        matrix[lost, lost] = np.inf
        return PooledCovariance(matrix, whole, lost, condition)

    def own_covariance(self, number: int, shared: Array) -> Array:
        """Covariance of all directions of a log, (d, d), given that of what is shared (m, m), in scales."""
        at, turn = self.pool.at[number], self.asked(number).turn
        known = np.where(np.isfinite(shared), shared, 0.0)[np.ix_(at.into, at.into)]
        out = turn @ known @ turn.T
        own = self.own[number]
        out[np.ix_(at.own, at.own)] += np.where(np.isfinite(own), own, 0.0)
        lost = np.zeros(len(out), np.bool_)
        lost[at.shared] = ~np.isfinite(np.diag(shared)[at.into])
        lost[at.own] |= ~np.isfinite(np.diag(own))
        out[lost, lost] = np.inf
        return out
