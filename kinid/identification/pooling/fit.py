"""The entrance: many logs and a model, to a pooled fit."""

from __future__ import annotations

import dataclasses
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators.batch import Solution
from kinid.identification import warnings as doubts
from kinid.identification.fit import Z95
from kinid.identification.fitted import FitError, FittedParameter
from kinid.identification.lack_of_fit import LackOfFit, error_rows, error_unit, lack_of_fit, rms
from kinid.identification.pooling.covariance import Asked, PooledCovariance, Scores, Shares
from kinid.identification.pooling.held_out import HeldOut, LogState, Steps
from kinid.identification.pooling.logs import Elsewhere, PooledLog
from kinid.identification.pooling.odd import odd_logs
from kinid.identification.pooling.pool import Pool
from kinid.identification.pooling.result import LogResult, PooledFit
from kinid.identification.pooling.search import Begun, begin, pooled
from kinid.identification.pooling.sharing import PER, PER_LOG, POPULATION, refuse_ungrouped
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual, train_residual
from kinid.modeling.model import Model
from kinid.parallel import one_blas_thread

Array = NDArray[np.float64]
Progress = Callable[[str], None]


class _Errors(NamedTuple):
    """Errors of a log: seen and held out by block; by log, and that in means beside its own zero; what is left of it,
    and how many readings count.
    """

    error: FitError
    by_log: float
    by_log_averaged: float
    left: LackOfFit
    samples: int


def fit_logs(
    model: Model,
    logs: Sequence[PooledLog],
    sharing: Mapping[str, str] | None = None,
    *,
    progress: Progress = lambda _: None,
    elsewhere: Elsewhere | None = None,
) -> PooledFit:
    """Fit a model to many logs.

    Args:
        model: what is fitted. logs: of which names differ.
        sharing: parameter or effect → "shared", "per-log", "population" or "per COLUMN"; default: as effects say.
        progress: called with what is being done, in words. elsewhere: where logs are worked at; default: here.

    Raises:
        InputError: no log that can carry the model, two logs of one name, or sharing that can't be, as by a column
            that a log lacks.
    """
    twice = next((name for name, count in Counter(log.name for log in logs).items() if count > 1), None)
    if twice is not None or not logs:
        found = "no log" if twice is None else f"two logs called {twice}"
        raise InputError(found, "logs, each with a name of its own", "name each log once")
    refuse_ungrouped(logs, sharing or {})
    with one_blas_thread():
        begun, aside = begin(model, logs, progress, elsewhere)
        return fit_begun(model, begun, sharing or {}, aside, progress, elsewhere)


def fit_begun(
    model: Model,
    begun: Sequence[Begun],
    sharing: Mapping[str, str],
    aside: Mapping[str, str],
    progress: Progress = lambda _: None,
    elsewhere: Elsewhere | None = None,
) -> PooledFit:
    """The same for logs that were fitted by themselves already; odd ones are left out of what is shared.

    Args:
        model, sharing, progress, elsewhere: as for `fit_logs`. begun: the logs. aside: names that can't carry the
            model, with why.
    """
    progress("fitting all logs")
    first = fit_of_pool(pooled(model, begun, sharing, elsewhere), aside)
    if not first.odd:
        return first
    progress(f"fitting all but {', '.join(first.odd)}")
    rest = [one for one in begun if one.log.name not in first.odd]
    second = fit_of_pool(pooled(model, rest, sharing, elsewhere), aside)
    known = {log.name: log for log in (*first.logs, *second.logs)}
    warnings = [f"{name} is the odd one, and left out of what is shared: {why}" for name, why in first.odd.items()]
    every = tuple(known[one.log.name] for one in begun)
    return dataclasses.replace(second, logs=every, odd=first.odd, warnings=(*warnings, *second.warnings))


def fit_of_pool(pool: Pool, aside: Mapping[str, str] | None = None) -> PooledFit:
    """The fit that a pool at its best is: log after log is visited once more.

    Args:
        pool: at its best. aside: names that can't carry the model, with why.
    """
    held_out = HeldOut(pool)
    scores, made = Scores(pool, held_out), []
    several = len(pool) > 1
    given = [(scores.asked(i), held_out.by_block(i), held_out.by_log(i) if several else None) for i in range(len(pool))]
    for number, (shares, errors) in enumerate(pool.visits(_looked_at, given)):
        scores.add(number, shares)
        made.append(errors)
    found = scores.covariance()
    logs = []
    for number, one in enumerate(made):
        logs.append(_log_result(pool, held_out, number, scores.own_covariance(number, found.matrix), one))
    counts = np.array([one.samples for one in made], float)
    left = _together([one.left for one in made], counts)
    error = FitError(
        _mean([one.error.train for one in made], counts),
        _mean([one.error.held_out for one in made], counts),
        left.noise,
        left.unit,
    )
    by_log = _mean([one.by_log for one in made], counts) if len(pool) > 1 else float("nan")
    parameters, spread = _shared(pool, found)
    warnings = _warnings(pool, found, left)
    for name, why in (aside or {}).items():  # a command that it advises is for this log
        warnings.append(f"{name} is put aside: {why.replace(' LOG ', f' {shlex.quote(name)} ')}")
    scales = {name: p.scale for one in pool.alone for name, p in one.model.parameters(one.layout).items()}
    odd = odd_logs(logs, scales)
    return PooledFit(
        pool.model,
        pool.sharing,
        parameters,
        spread,
        error,
        by_log,
        tuple(logs),
        odd,
        dict(aside or {}),
        tuple(warnings),
        left,
        pool,
        held_out,
    )


def _looked_at(state: State, asked: Asked, by_block: Steps, by_log: Steps | None) -> tuple[Shares, _Errors]:
    """What one log adds to the covariance; its errors, seen, held out by blocks and by log, what is left of it, and its
    samples.
    """
    whole = state.problem.whole
    rows = error_rows(whole)
    seen = train_residual(state, whole)
    blocks = LogState.made(state, by_block)
    left = lack_of_fit(blocks, seen)
    unseen = rms(held_out_residual(blocks)[rows][:, whole.valid])
    apart_error = by_log_averaged = float("nan")
    if by_log is not None:
        apart = LogState.made(state, by_log)
        apart_error, by_log_averaged = rms(held_out_residual(apart)[rows][:, whole.valid]), rms(apart.held_out[rows])
    error = FitError(rms(seen[rows][:, whole.valid]), unseen, left.noise, error_unit(whole))
    errors = _Errors(error, apart_error, by_log_averaged, left, int(whole.valid.sum()) * int(rows.sum()))
    return Shares.of(state, asked), errors


def _log_result(pool: Pool, held_out: HeldOut, number: int, covariance: Array, made: _Errors) -> LogResult:
    alone, log = pool.alone[number], pool.problems.logs[number]
    place, half = pool.coordinates(number), Z95 * np.sqrt(np.diag(covariance))
    own, every = {}, {}
    for i, (name, p) in enumerate(alone.model.parameters(alone.layout).items()):
        if p.fixed:
            continue
        every[name] = _fitted(name, alone.values[i], Z95 * alone.errors[i], p.low, p.high, p.unit)
        if pool.sharing[name] in (PER_LOG, POPULATION):
            own[name] = _fitted(name, place[i] * p.scale, half[i] * p.scale, p.low, p.high, p.unit)
    found, freedom = held_out.disagreement(number) if len(pool) > 1 else (0.0, 1.0)
    return LogResult(
        log.name,
        log.groups,
        made.samples,
        own,
        every,
        made.error,
        made.by_log,
        alone.held_out,
        made.left,
        made.by_log_averaged,
        found / max(freedom, 1.0),
        freedom,
    )


def _fitted(name: str, value: float, half: float, low: float, high: float, unit: str) -> FittedParameter:
    ends = (max(value - half, low), min(value + half, high)) if np.isfinite(half) else (-np.inf, np.inf)
    return FittedParameter(name, float(value), float(ends[0]), float(ends[1]), unit)


def _shared(pool: Pool, found: PooledCovariance) -> tuple[dict[str, FittedParameter], dict[str, FittedParameter]]:
    """What logs share, and the spread of populations."""
    named = {name: p for one in pool.alone for name, p in one.model.parameters(one.layout).items()}
    half, out, spread, of = Z95 * np.sqrt(np.diag(found.matrix)), {}, {}, {}
    for i, key in enumerate(pool.vector.keys):
        if key[0] != "parameter" or named[str(key[1])].fixed:
            continue
        name, group = str(key[1]), str(key[2])
        if pool.sharing[name] == PER_LOG:  # of a single log, whose own are told beside it
            continue
        p, way = named[name], pool.sharing[name]
        label = f"{name}[{way.removeprefix(PER)}={group}]" if way.startswith(PER) else name
        of[label] = name
        out[label] = _fitted(label, pool.spot.shared[i] * p.scale, half[i] * p.scale, p.low, p.high, p.unit)
    for name, population in pool.populations.items():
        p = named[name]
        size, error = population.spread * p.scale, population.error * p.scale
        spread[name] = FittedParameter(name, size, max(0.0, size - Z95 * error), size + Z95 * error, p.unit)
    names = list(named)
    return dict(sorted(out.items(), key=lambda item: names.index(of[item[0]]))), spread


def _mean(values: Sequence[float], counts: Array) -> float:
    """Root mean square over all samples, of root mean squares of each log."""
    return float(np.sqrt(np.sum(counts * np.square(values)) / np.sum(counts)))


def _together(parts: Sequence[LackOfFit], counts: Array) -> LackOfFit:
    """What is left over all logs."""

    def mean(name: str) -> float:
        return _mean([getattr(part, name) for part in parts], counts)

    memory = float(np.median([part.memory for part in parts]))
    return LackOfFit(
        mean("rms"), mean("noise"), mean("excess"), mean("tolerance"), mean("reading"), memory, parts[0].unit
    )


def _warnings(pool: Pool, found: PooledCovariance, left: LackOfFit) -> list[str]:
    """What to doubt of what is shared."""
    named = {name: p for one in pool.alone for name, p in one.model.parameters(one.layout).items()}
    keys = {i: key for i, key in enumerate(pool.vector.keys) if key[0] == "parameter" and not named[str(key[1])].fixed}
    parameters = {f"{key[1]}[{key[2]}]" if key[2] else str(key[1]): named[str(key[1])] for key in keys.values()}
    kept = np.array(list(keys), np.int64)
    scale = pool.vector.scale[kept]
    values = pool.spot.shared[kept] * scale
    at = np.ix_(kept, kept)
    bound = np.array(
        [v <= p.low + 1e-6 * p.scale or v >= p.high - 1e-6 * p.scale for v, p in zip(values, parameters.values())],
        np.bool_,
    )
    solution = Solution(
        values,
        found.matrix[at] * np.outer(scale, scale),
        found.unidentified[kept],
        bound,
        np.zeros(0),
        found.condition,
        (),
        pool.steps,
        pool.converged,
    )
    words = doubts.of_fit(parameters, solution, left, {}, found.inverse[at] * np.outer(scale, scale))
    several = "these logs" if len(pool) > 1 else "this log"
    return [word.replace("this log", several) for word in words]
