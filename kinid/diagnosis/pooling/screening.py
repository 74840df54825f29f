"""Screening over many logs: how much of what all of them leave each effect of the catalogue would explain at once.

The score test of one log, log by log: an effect's change of the readings is a few more columns of each log's normal
equations, shared where the effect is the same in all logs, and each log's own where it isn't (`Effect.per_log`). What a
log is too short to show adds up over logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect
from kinid.identification.jacobian import changes
from kinid.identification.nuisance import trusted
from kinid.identification.pooling.pool import Pool
from kinid.identification.state import State
from kinid.modeling.applicability import amplitudes, base_of, candidate_effects, shape_points

Array = NDArray[np.float64]

#: squared change of all weighted readings below which nothing is seen
UNSEEN = 1e-12
#: what keeps columns that hardly differ from running away, as a share of their squares
RIDGE = 1e-7


@dataclass(frozen=True, eq=False)
class Point:
    """One effect at one point of its shapes, as it is looked at in every log.

    Attributes:
        effect: as it is beside the model. at: values of all its parameters, (k,). moving: numbers of the amplitudes
            that are moved; null: where those do nothing; steps: by how much they are moved, (m,) each.
    """

    effect: Effect
    at: Array
    moving: tuple[int, ...]
    null: Array
    steps: Array


@dataclass(frozen=True, eq=False)
class Columns:
    """What a point changes in one log: with its directions (m, d), with itself (m, m), and with what is left (m,)."""

    cross: Array
    squares: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class PooledCandidate:
    """One effect at one point.

    Attributes:
        effect: of the catalogue. predicted_gain: what it would take off the weighted squares of all logs.
        starts: values of its parameters in each log to search from, (k,) each.
        visible: change of the weighted readings, as a length, by one scale of its least visible amplitude.
    """

    effect: Effect
    predicted_gain: float
    starts: tuple[Array, ...]
    visible: float


def screen_pool(pool: Pool, names: Sequence[str] = ()) -> tuple[dict[str, list[PooledCandidate]], dict[str, str]]:
    """Every effect that can act in these logs, its best point first; and of the others, why they can't be asked.

    Args:
        pool: at its best. names: of effects to look at; default: all that the model lacks.
    """
    first = pool.state(0)
    points, why = points_of(first, names)
    with np.errstate(all="ignore"):
        found = pool.visits(_columns, [(points,)] * len(pool))
        out: dict[str, list[PooledCandidate]] = {}
        for i, point in enumerate(points):
            columns = [c for of_log in found if (c := of_log[i]) is not None]
            if len(columns) == len(pool) and any(np.trace(c.squares) > UNSEEN for c in columns):
                candidate = _candidate(pool, point, columns)
                if np.isfinite(candidate.predicted_gain):
                    out.setdefault(point.effect.id, []).append(candidate)
    for name in {point.effect.id for point in points} - set(out):
        why[name] = "it changes nothing in these logs"
    return {name: sorted(some, key=lambda c: -c.predicted_gain) for name, some in out.items()}, why


def points_of(state: State, names: Sequence[str] = ()) -> tuple[list[Point], dict[str, str]]:
    """Points of the catalogue's effects to look at in every log, and why others can't be asked."""
    points, idle = [], {}
    signals, layout = state.problem.experiment.signals, state.problem.layout
    for bare, why in candidate_effects(state.model, layout):
        if names and bare.id not in names:
            continue
        own = bare.for_log(signals)
        if why:
            idle[bare.id] = why
            continue
        if bare.detector or own.prior(layout) is not None:
            idle[bare.id] = "it is of single logs: diagnose one of them"
            continue
        effect = (state.model + own)[bare.id]
        parameters, amplitude = effect.parameters(layout), amplitudes(effect, layout, base_of(state.model))
        for at, moving in shape_points(effect, signals, amplitude):
            null = np.array([amplitude[i] for i in moving])
            scale = np.array([parameters[i].scale for i in moving])
            high = np.array([parameters[i].high for i in moving])
            steps = at[moving] - null
            steps = np.where(steps != 0.0, steps, np.where(null + scale <= high, scale, -scale))
            values = np.array([amplitude.get(i, v) for i, v in enumerate(at)])
            points.append(
                Point(effect, np.where(np.isin(np.arange(len(at)), moving), values, at), tuple(moving), null, steps)
            )
    return points, idle


def _columns(state: State, points: Sequence[Point]) -> list[Columns | None]:
    with np.errstate(all="ignore"):
        return [columns_of(state, point) for point in points]


def columns_of(state: State, point: Point) -> Columns | None:
    """What a point changes in a log; None where that is no number."""
    larger = state.model + point.effect
    begin = larger.place(point.effect.id, state.problem.layout).start
    origin = np.insert(state.values, begin, point.at)
    d = changes(state.problem, larger, origin, [begin + i for i in point.moving], point.steps, state.course)
    if not np.isfinite(d).all():
        return None
    weight = 1.0 / state.error.sigma.reshape(-1, 1)
    d = d * weight
    return Columns(d.T @ (state.jacobian * weight), d.T @ d, d.T @ (state.residual.reshape(-1, 1) * weight)[:, 0])


def _candidate(pool: Pool, point: Point, columns: Sequence[Columns]) -> PooledCandidate:
    """What a point would gain in all logs at once."""
    ours = len(pool.vector)
    alike = not point.effect.per_log or len(pool) == 1
    size = ours + (len(point.moving) if alike else 0)
    h, b, gain = np.zeros((size, size)), np.zeros(size), 0.0
    parts = []
    kept = np.ones(size, np.bool_)
    given, once = 0.0, set[int]()
    for number, column in enumerate(columns):
        part = _log_part(pool, number, point, column, alike)
        into, squares, slope, own_gain, cost, dropped = part[:6]
        np.add.at(h, (into[:, None], into[None, :]), squares)
        np.add.at(b, into, slope)
        gain += own_gain
        given += cost
        kept[list(dropped)] = False
        once |= dropped
        parts.append(part)
    prior = pool.vector.prior
    h[:ours, :ours] += prior
    b[:ours] -= prior @ np.where(kept[:ours], pool.spot.shared, 0.0)
    for i in once:  # its prior counts once, however many logs share it
        within = float(np.clip(pool.spot.shared[i], -2.0, 2.0))
        given -= within**2
    f = np.flatnonzero(kept & (np.diag(h) > 0.0))
    h_ff = h[np.ix_(f, f)] + RIDGE * np.diag(np.where(f >= ours, np.diag(h)[f], 0.0))
    found = np.zeros(size)
    found[f] = np.linalg.solve(h_ff + 1e-12 * np.eye(len(f)), b[f])
    gain += float(b[f] @ found[f])
    starts = [_start(pool, number, point, part, found, alike) for number, part in enumerate(parts)]
    seen = np.sqrt(sum(np.diag(c.squares) for c in columns)) / np.abs(point.steps)
    parameters = point.effect.parameters(pool.alone[0].layout)
    visible = float(np.min(seen * [parameters[i].scale for i in point.moving]))
    return PooledCandidate(point.effect, gain - given, tuple(starts), visible)


#: places in the system, squares and slope on them, own gain, what giving up nuisances costs, those that are shared and
#: dropped, and how the log's own amplitudes follow: at rest, and per step of what is shared
Part = tuple[NDArray[np.int64], Array, Array, float, float, set[int], Array, Array]


def _log_part(pool: Pool, number: int, point: Point, column: Columns, alike: bool) -> Part:
    """One log's normal equations with a point's columns, the log's own directions eliminated.

    An open quantity that is the same effect gives way to it.
    """
    at, normals, alone = pool.at[number], pool.normals[number], pool.alone[number]
    p, m = len(alone.values), len(point.moving)
    same = np.r_[np.zeros(p, np.bool_), [n.effect.id == point.effect.id for n in alone.open_]].astype(np.bool_)
    shift = np.where(same, np.r_[np.zeros(p), pool.coordinates(number)[p:]], 0.0)
    within = np.r_[np.zeros(p), trusted(shift[p:])]
    beyond = shift - within
    squares, slope = normals.squares, normals.slope + normals.squares @ shift
    # against what is left with calibration as far as it is trusted
    cost = 2.0 * float((shift - beyond) @ normals.slope)
    cost += float(shift @ squares @ shift - beyond @ squares @ beyond)
    d_slope = column.slope + column.cross @ shift
    shared, own = ~same[at.shared], ~same[at.own] & pool.free_own(number)
    cost -= float(np.sum(within[at.own[same[at.own]]] ** 2))
    s, o = at.shared[shared], at.own[own]
    prior = pool.own_prior(number)
    h_oo, b_o = squares[np.ix_(o, o)] + prior[np.ix_(own, own)], slope[o]
    b_o = b_o - prior[np.ix_(own, own)] @ pool.spot.own[number][own]
    new = len(pool.vector) + np.arange(m)
    if alike:
        into = np.r_[at.into[shared], new].astype(np.int64)
        h_ss = np.block([[squares[np.ix_(s, s)], column.cross[:, s].T], [column.cross[:, s], column.squares]])
        b_s, h_os = np.r_[slope[s], d_slope], np.column_stack([squares[np.ix_(o, s)], column.cross[:, o].T])
    else:
        into, h_ss, b_s = at.into[shared], squares[np.ix_(s, s)], slope[s]
        h_os = np.vstack([squares[np.ix_(o, s)], column.cross[:, s]])
        ridge = RIDGE * np.diag(np.diag(column.squares)) + 1e-12 * np.eye(m)
        h_oo = np.block([[h_oo, column.cross[:, o].T], [column.cross[:, o], column.squares + ridge]])
        b_o = np.r_[b_o, d_slope]
    solved = np.linalg.solve(h_oo, np.column_stack([h_os, b_o])) if len(b_o) else np.zeros((0, len(into) + 1))
    dropped = {int(i) for i in at.into[~shared]}
    reduced = h_ss - h_os.T @ solved[:, :-1]
    return (
        into,
        reduced,
        b_s - h_os.T @ solved[:, -1],
        float(b_o @ solved[:, -1]),
        cost,
        dropped,
        solved[-m:, -1] if not alike else np.zeros(0),
        -solved[-m:, :-1] if not alike else np.zeros((0, 0)),
    )


def _start(pool: Pool, number: int, point: Point, part: Part, found: Array, alike: bool) -> Array:
    """Values of an effect's parameters in a log to search from."""
    coefficient = found[len(pool.vector) :] if alike else part[6] + part[7] @ found[part[0]]
    parameters = point.effect.parameters(pool.alone[number].layout)
    out = point.at.copy()
    for i, null, step, c in zip(point.moving, point.null, point.steps, coefficient):
        out[i] = float(np.clip(null + c * step, parameters[i].low, parameters[i].high))
    return out
