"""Weighted nonlinear least squares over many logs: Levenberg-Marquardt steps of all that is shared and of each log's
own at once, each log's error model learnt along.

Every log is first fitted by itself, as it would be alone; what those fits tell of the shared parameters is where the
search begins. It then visits log after log: a visit predicts one log and keeps its normal equations alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, KinidError
from kinid.identification.error_model import learn
from kinid.identification.estimation import estimate_problem
from kinid.identification.pooling.logs import Elsewhere, PooledLog, Problems
from kinid.identification.pooling.normals import Normals, Reduced, shared_step
from kinid.identification.pooling.pool import Alone, Pool, Spot
from kinid.identification.pooling.population import Population, learn_population, log_alone
from kinid.identification.pooling.sharing import POPULATION, SharedVector, sharing_of
from kinid.identification.problem import Problem
from kinid.identification.solver import CONVERGED_GAIN, ERROR_MODEL_ITERATIONS, MIN_GAIN_RATIO
from kinid.identification.state import State, fixed_parameters, prior_precision
from kinid.modeling.model import Model
from kinid.writers import Json

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: steps of a search; how often the spread of a population is learnt anew
STEPS, POPULATION_ROUNDS = 30, 3
#: steps in a row that may gain nothing before a search ends. And what may be left to gain for each log where it ends
#: then: touches make and lose contact sample by sample as surfaces move, and the cost has kinks of that depth
REFUSED, NEAR = 2, 0.3


@dataclass(frozen=True, eq=False)
class Begun:
    """One log fitted by itself: what a pooled fit begins from.

    Attributes:
        log: which. alone: its own fit. normals: there. prior: precision of its directions, (d, d). held: values that
            its samples show, NaN for those that are fitted, (p,).
    """

    log: PooledLog
    alone: Alone
    normals: Normals
    prior: Array
    held: Array

    @classmethod
    def of(cls, log: PooledLog, state: State) -> Begun:
        """From a log's own state."""
        prior = prior_precision(state.model, state.problem, len(state.open_))
        return cls(log, Alone.of(state), Normals.of(state), prior, fixed_parameters(state.model, state.problem))


def begin(
    model: Model, logs: Sequence[PooledLog], progress: Progress = lambda _: None, elsewhere: Elsewhere | None = None
) -> tuple[list[Begun], dict[str, str]]:
    """Fit every log by itself; and those that can't carry the model, with why.

    Raises:
        InputError: no log can carry it, or the only one can't.
    """
    out, aside, problems = [], dict[str, str](), Problems(logs)
    there = None if elsewhere is None else elsewhere.begun(model, logs, progress)
    for number, log in enumerate(logs):
        if there is None:
            progress(f"fitting {log.name} by itself ({number + 1} of {len(logs)})")
        try:
            one = begin_one(model, log, problems.of(number)) if there is None else there[number]
        except KinidError as error:
            if len(logs) == 1:
                raise
            one = str(error)
        if isinstance(one, str):
            aside[log.name] = one
        else:
            out.append(one)
    if not out:
        name, why = next(iter(aside.items()))
        raise InputError(f"{len(logs)} logs, none of which can carry {model}", "logs that can", f"{name}: {why}")
    return out, aside


def begin_one(model: Model, log: PooledLog, problem: Problem) -> Begun:
    """One log fitted by itself.

    Raises:
        KinidError: it can't carry the model.
    """
    return Begun.of(log, estimate_problem(model, problem))


def pooled(
    model: Model, begun: Sequence[Begun], sharing: Mapping[str, str], elsewhere: Elsewhere | None = None
) -> Pool:
    """Fit a model to logs that were fitted by themselves.

    Args:
        model: what is fitted. begun: the logs. sharing: what was asked of parameters (`sharing_of`).
        elsewhere: where logs are visited; default: here.
    """
    pool = assemble(model, begun, sharing)
    pool.problems.elsewhere = elsewhere
    if len(pool) > 1:
        with np.errstate(all="ignore"):
            _agree(pool)
    return settled(pool)


def assemble(model: Model, begun: Sequence[Begun], sharing: Mapping[str, str]) -> Pool:
    """A pool at the mean of what logs' own fits say, each weighed by how much it knows."""
    vector, at, ways = SharedVector(), [], dict[str, str]()
    columns = list(dict.fromkeys(column for one in begun for column in one.log.groups))
    for one in begun:
        alone = one.alone
        ways = sharing_of(alone.model, alone.layout, sharing, columns) | ways
        named = alone.model.parameters(alone.layout)
        at.append(vector.directions(one.log, named, alone.open_, one.prior, one.held, ways, len(begun) == 1))
    squares, weighted = np.full(len(vector), 1e-300), np.zeros(len(vector))
    for one, d in zip(begun, at):
        size = np.diag(one.normals.squares)[d.shared] + 1e-12
        np.add.at(squares, d.into, size)
        np.add.at(weighted, d.into, size * one.alone.coordinates[d.shared])
    own = [np.where(d.population, 0.0, one.alone.coordinates[d.own]) for one, d in zip(begun, at)]
    populations = {}
    for name in (name for name, way in ways.items() if way == POPULATION and len(begun) > 1):
        values = [one.alone.coordinates[one.alone.names.index(name)] for one in begun if name in one.alone.names]
        populations[name] = Population(max(float(np.std(values)), 1e-3), float("inf"))
    return Pool(
        model,
        Problems([one.log for one in begun]),
        ways,
        [one.alone for one in begun],
        vector,
        at,
        Spot(weighted / squares, tuple(own)),
        [one.alone.error for one in begun],
        [one.normals for one in begun],
        populations,
    )


def _agree(pool: Pool) -> None:
    """Move to where all logs' linear views agree best, and look there; to where they are in the mean if that is
    better.
    """
    here, moved = pool.spot, []
    for number, normals in enumerate(pool.normals):
        away = pool.coordinates(number) - pool.alone[number].coordinates
        moved.append(dataclasses.replace(normals, slope=normals.slope - normals.squares @ away))
    pool.normals = moved
    found, _ = _step(pool, 0.0)
    there = pool.visits(Normals.of, spot=found)
    if np.isfinite(pool.cost(found, there)):
        pool.spot, pool.normals = found, there
        return
    pool.spot, pool.normals = here, pool.visits(Normals.of, spot=here)


def settled(pool: Pool) -> Pool:
    """The pool at its best, error models and populations learnt along."""
    with np.errstate(all="ignore"):  # a step too far is taken back
        descend(pool)
        if len(pool) > 1:
            for _ in range(ERROR_MODEL_ITERATIONS):
                _relearn(pool)
                descend(pool)
        for _ in range(POPULATION_ROUNDS if pool.populations else 0):
            _spread(pool)
            descend(pool)
    return pool


def descend(pool: Pool, ends: tuple[float, float] = CONVERGED_GAIN) -> Pool:
    """Search from where it is, with the error models that it has; the same pool, at its best.

    Args:
        pool: where it begins. ends: what a step must promise, absolutely and as a share of the cost, to be tried.
    """
    damping, cost, refused = 1e-3, pool.cost(pool.spot, pool.normals), 0
    pool.converged, near = False, NEAR * len(pool)
    trial, expected = _step(pool, damping)
    for _ in range(STEPS):
        if expected < ends[0] + ends[1] * cost or (refused >= REFUSED and expected < near):
            pool.converged = True
            return pool
        pool.steps += 1
        there = pool.visits(Normals.of, spot=trial)
        gain = cost - pool.cost(trial, there)
        before = pool.spot, pool.normals
        pool.spot, pool.normals = trial, there
        following, left = _step(pool, damping)
        # near the end what calibration leaves open moves the cost by as much as the last steps do: there a step is good
        # where it leaves less to gain
        if gain > MIN_GAIN_RATIO * expected or (expected < near and abs(gain) < near and left < 0.5 * expected):
            damping = max(damping / 10.0, 1e-9) if gain > 0.5 * expected else damping * 3.0
            trial, expected, cost, refused = following, left, cost - gain, 0
            continue
        pool.spot, pool.normals = before
        damping, refused = max(damping, 1e-6) * 10.0, refused + 1
        trial, expected = _step(pool, damping)
    return pool


def _step(pool: Pool, damping: float) -> tuple[Spot, float]:
    """Where a step leads, and the gain that the linear view expects of it."""

    def part(number: int) -> Reduced:
        squares = pool.normals[number].squares
        return pool.reduced(number, extra=damping * np.diag(squares))

    h, b, parts = pool.gathered(part)
    place, (low, high) = pool.spot.shared, pool.vector.bounds
    step = shared_step(h, b, low - place, high - place, pool.free_shared(b))
    new = np.clip(place + step, low, high)
    step, own = new - place, []
    for at, found, here in zip(pool.at, parts, pool.spot.own):
        moved = here + found.alone + found.gain @ step[at.into]
        ends = np.where(at.population, -np.inf, at.low[at.own]), np.where(at.population, np.inf, at.high[at.own])
        own.append(np.clip(moved, *ends))
    trial = Spot(new, tuple(own))
    prior = pool.vector.prior
    expected = float(-2.0 * place @ prior @ step - step @ prior @ step)
    for number, (at, normals) in enumerate(zip(pool.at, pool.normals)):
        d = np.zeros(len(at.scale))
        d[at.shared] += step[at.into]
        away = own[number] - pool.spot.own[number]
        d[at.own] += away
        p = pool.own_prior(number)
        expected += float(2.0 * normals.slope @ d - d @ normals.squares @ d)
        expected -= float(2.0 * pool.spot.own[number] @ p @ away + away @ p @ away)
    return trial, expected


def _relearn(pool: Pool) -> None:
    """Every log's error model anew, from what is left there."""
    found = pool.visits(_relearnt)
    # what follows from the log alone stays as it is, once in memory
    pool.error = [dataclasses.replace(old, **learnt) for old, (learnt, _) in zip(pool.error, found)]
    pool.normals = [normals for _, normals in found]


def _relearnt(state: State) -> tuple[Json, Normals]:
    """What is new of an error model, by name, and the normal equations with it."""
    error = learn(state.problem, state.model, state.values, state.residual, state.error)
    learnt = {"discrepancy": error.discrepancy, "memory": error.memory, "unusual": error.unusual}
    return learnt, Normals.of(dataclasses.replace(state, error=error))


def _spread(pool: Pool) -> None:
    """The spread of each population anew."""
    for name in pool.populations:
        estimates = []
        for number, at in enumerate(pool.at):
            names = pool.alone[number].names
            for place in np.flatnonzero(at.population):
                if names[at.own[place]] == name:
                    prior = pool.own_prior(number)
                    estimates.append(log_alone(pool.normals[number], at, prior, pool.spot.own[number], int(place)))
        deviations, variances = np.array(estimates).T
        pool.populations[name] = learn_population(deviations, variances)
