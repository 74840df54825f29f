"""Refits over many logs, and the paired held-out gain that decides about them: on blocks, and on whole logs.

Of each log the evidence is what it is for one log (`diagnosis.acceptance`); gains of logs add up, and so do the squares
of their standard errors. An effect must also hold on logs that told nothing of it: what is shared is then taken from
the others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.acceptance import Evidence, compare_states
from kinid.diagnosis.pooling.screening import PooledCandidate
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import Effect
from kinid.identification.nuisance import Nuisance, nuisances
from kinid.identification.pooling.held_out import HeldOut, LogState, Steps
from kinid.identification.pooling.normals import Normals
from kinid.identification.pooling.pool import Alone, Pool, Visit
from kinid.identification.pooling.search import Begun, assemble, descend
from kinid.identification.problem import Problem
from kinid.identification.solver import ROUGH_GAIN
from kinid.identification.state import fixed_parameters, prior_precision
from kinid.modeling.applicability import amplitudes, base_of
from kinid.modeling.model import Model

Array = NDArray[np.float64]

#: points of an effect's shapes that a search begins at, those that promise nearly as much
STARTS, NEARLY = 2, 0.8
#: a value is no value that can be where it is so many standard errors away from one that can
DOUBT = 2.0


@dataclass(frozen=True)
class PooledEvidence:
    """Paired held-out gain over many logs.

    Attributes:
        gain: in units of what is left before. error: its standard error. left: of the likelihood of what is left, minus
            twice the logarithm. share: of the squared held-out error that goes. change: root mean square of the change
            of the readings over that of the readings. by_log: significance of the gain on logs held out, infinite for
            one log.
        logs: significance of the gain in each log.
    """

    gain: float
    error: float
    left: float
    share: float
    change: float
    by_log: float
    logs: tuple[float, ...]

    @property
    def significance(self) -> float:
        """Gain over its standard error."""
        return self.gain / self.error if self.error > 0 else 0.0


@dataclass(frozen=True, eq=False)
class PooledRefit:
    """An effect refitted beside a model in all logs, and the evidence for it."""

    effect: Effect
    before: Pool
    pool: Pool
    evidence: PooledEvidence


def enlarged(pool: Pool, effect: Effect, starts: Sequence[Array]) -> Pool:
    """The pool's model with one more effect, begun at these values of its parameters in each log, and not yet
    searched.
    """
    models, values = [], []
    for number, alone in enumerate(pool.alone):
        larger = alone.model + effect
        begin = larger.place(effect.id, alone.layout).start
        names = list(larger.parameters(alone.layout))
        own = dict(zip(names, np.insert(_values(pool, number), begin, starts[number])))
        models.append(larger)
        values.append(own)
    return _searched_from(pool, pool.model + effect, _begun(pool, models, values))


def reduced_by(pool: Pool, name: str) -> Pool:
    """The pool's model without an effect, searched from where it is."""
    models = [alone.model - name for alone in pool.alone]
    values = [dict(zip(alone.names, _values(pool, number))) for number, alone in enumerate(pool.alone)]
    return descend(_searched_from(pool, pool.model - name, _begun(pool, models, values)), ROUGH_GAIN)


def _values(pool: Pool, number: int) -> Array:
    """A log's parameters, (p,)."""
    p = len(pool.alone[number].values)
    return pool.coordinates(number)[:p] * pool.at[number].scale[:p]


def _opened(problem: Problem, model: Model) -> tuple[tuple[Nuisance, ...], Array, Array]:
    """What calibration leaves open of a log beside a model, precision of all directions, and values that it shows."""
    open_ = nuisances(model, problem.experiment.signals)
    return open_, prior_precision(model, problem, len(open_)), fixed_parameters(model, problem)


def _begun(pool: Pool, models: Sequence[Model], values: Sequence[Mapping[str, float]]) -> list[Begun]:
    """The logs with other models, at these values of their parameters."""
    found = pool.problems.each(_opened, [(model,) for model in models], [alone.rest for alone in pool.alone])
    out = []
    for number, (alone, model, (open_, prior, held)) in enumerate(zip(pool.alone, models, found)):
        places = pool.coordinates(number)[len(alone.values) :]
        known = dict(zip([(n.effect.id, n.index) for n in alone.open_], places))
        here = dataclasses.replace(
            alone,
            model=model,
            values=(own := np.array([values[number][name] for name in model.parameters(alone.layout)])),
            errors=np.full(len(own), np.inf),
            open_=open_,
            shift=np.array([known.get((n.effect.id, n.index), 0.0) for n in open_]),
            error=pool.error[number],
        )
        # squares that weigh all logs alike: what they share has one value already
        d = len(own) + len(open_)
        flat = Normals(np.eye(d), np.zeros(d), 0.0, (np.eye(d), np.eye(d)), (np.zeros(d), np.zeros(d)), 1.0)
        out.append(Begun(pool.problems.logs[number], here, flat, prior, held))
    return out


def _searched_from(pool: Pool, model: Model, begun: Sequence[Begun]) -> Pool:
    ids = {effect.id for effect in model.effects}
    asked = {name: way for name, way in pool.sharing.items() if name.split(".", 1)[0] in ids}
    out = assemble(model, begun, asked)
    out.problems = pool.problems
    out.populations |= {name: p for name, p in pool.populations.items() if name in out.populations}
    out.normals = out.visits(Normals.of)
    return out


def refit(before: Pool, candidates: Sequence[PooledCandidate]) -> PooledRefit:
    """The best refit of an effect from its best points, with the error models of the pool before."""
    tried = []
    least = NEARLY * candidates[0].predicted_gain
    for candidate in [c for c in candidates[:STARTS] if c.predicted_gain >= least]:
        with np.errstate(all="ignore"):
            pool = descend(enlarged(before, candidate.effect, candidate.starts), ROUGH_GAIN)
            tried.append((pool.cost(pool.spot, pool.normals), pool))
    cost, best = min(tried, key=lambda one: one[0] if np.isfinite(one[0]) else np.inf)
    return PooledRefit(candidates[0].effect, before, best, compare_pools(before, best))


def compare_pools(before: Pool, after: Pool) -> PooledEvidence:
    """Evidence for the second pool over the first, with errors weighed as before."""
    old, new = HeldOut(before), HeldOut(after)
    several = len(before) > 1
    given = [
        (
            (before.visit(i), old.by_block(i), old.by_log(i) if several else None),
            (after.visit(i), new.by_block(i), new.by_log(i) if several else None),
            before.error[i].sigma,
        )
        for i in range(len(before))
    ]
    # both are of one form of friction at rest
    found = before.problems.each(_compared, given, [alone.rest for alone in before.alone])
    blocks, apart = [one for one, _, _ in found], [one for _, one, _ in found if one is not None]
    squares, changes = float(sum(size for _, _, size in found)), [one.change for one in blocks]
    gain, error = sum(e.gain for e in blocks), float(np.sqrt(sum(e.error**2 for e in blocks)))
    by_log = np.inf
    if apart:
        by_log = sum(e.gain for e in apart) / max(float(np.sqrt(sum(e.error**2 for e in apart))), 1e-12)
    return PooledEvidence(
        gain,
        error,
        sum(e.left for e in blocks),
        gain / max(squares, 1e-300),
        float(np.sqrt(np.mean(np.square(changes)))),
        float(by_log),
        tuple(e.significance for e in blocks),
    )


#: a visit of a log, and its steps to where it is held out by block, and by log
_Side = tuple[Visit, Steps, Steps | None]


def _compared(problem: Problem, before: _Side, after: _Side, sigma: Array) -> tuple[Evidence, Evidence | None, float]:
    """Evidence of one log, on blocks and on the log held out, and the weighted squares that the first leaves."""
    with np.errstate(all="ignore"):
        first, second = before[0].state(problem), after[0].state(problem)
        one = LogState.made(first, before[1])
        blocks = compare_states(one, LogState.made(second, after[1]), sigma)
        squares, apart = float(np.sum((one.held_out / sigma) ** 2)), None
        if before[2] is not None and after[2] is not None:
            apart = compare_states(LogState.made(first, before[2]), LogState.made(second, after[2]), sigma)
    return blocks, apart, squares


def acceptable(tried: PooledRefit, settings: DiagnosisSettings) -> bool:
    """Whether a refit is beyond doubt, worth a name, physically possible, and true of logs that didn't tell of it."""
    e = tried.evidence
    needed = settings.min_significance * max(0.5, 1.0 - e.share)
    return (
        e.significance > needed
        and e.by_log > DOUBT
        and e.share > settings.min_share / np.sqrt(len(tried.pool))  # what chance makes of a share falls with logs
        and e.change > settings.min_reading_share
        and _believable(tried, settings)
    )


def _errors_of(pool: Pool, held_out: HeldOut, inverse: Array, number: int) -> Array:
    """Rough standard error of each parameter of a log, (p,)."""
    alone, at, part = pool.alone[number], pool.at[number], held_out.parts[number]
    inflation = float(np.mean([normals.inflation for normals in pool.normals]))
    turn = np.zeros((len(at.scale), len(at.shared)))
    turn[at.shared, np.arange(len(at.shared))] = 1.0
    turn[at.own] += part.gain
    variance = np.einsum("ij,jk,ik->i", turn, inverse[np.ix_(at.into, at.into)], turn)
    variance[at.own] += np.diag(np.linalg.pinv(part.own_squares, hermitian=True))
    out: Array = np.sqrt(np.maximum(variance * inflation, 0.0))[: len(alone.values)] * at.scale[: len(alone.values)]
    return out


def _believable(tried: PooledRefit, settings: DiagnosisSettings) -> bool:
    """Whether an effect's values are such as a material or a machine may have, and the logs say more of it than that it
    is as large as in every material and every rig.
    """
    pool, name = tried.pool, tried.effect.id
    held_out = HeldOut(pool)
    inverse = np.asarray(np.linalg.pinv(held_out.squares, hermitian=True), np.float64)
    # what all logs share is the same in each
    numbers = range(len(pool)) if tried.effect.per_log else range(1)
    given = [(pool.alone[i], name, _values(pool, i), _errors_of(pool, held_out, inverse, i), settings) for i in numbers]
    if tried.effect.per_log:
        verdicts = pool.problems.each(_believed, given, [alone.rest for alone in pool.alone])
    else:
        verdicts = [_believed(pool.problems.of(0, pool.alone[0].rest), *given[0])]
    return all(possible for possible, _ in verdicts) and any(remarkable for _, remarkable in verdicts)


def _believed(
    problem: Problem, alone: Alone, name: str, values: Array, errors: Array, settings: DiagnosisSettings
) -> tuple[bool, bool]:
    """Of one log: whether an effect's values are possible, and whether they are remarkable."""
    effect, place = alone.model[name], alone.model.place(name, alone.layout)
    null, signals = amplitudes(effect, alone.layout, base_of(alone.model)), problem.experiment.signals
    parameters, open_ = effect.parameters(alone.layout), effect.calibration_sd(signals)
    own: dict[str, float] = {}
    for i, parameter in enumerate(parameters):
        value, room = float(values[place][i]), DOUBT * float(errors[place][i])
        towards = null.get(i, parameter.nominal)
        far = room < abs(value - towards)
        own[parameter.name] = value + room * (1.0 if towards > value else -1.0) if far else towards
    named = dict(zip(alone.names, values.tolist())) | {f"{name}.{k}": v for k, v in own.items()}
    remarkable = False
    for i, at_null in null.items():
        usual = max(effect.usual(parameters[i]), DOUBT * open_.get(parameters[i].name, 0.0))
        beyond = abs(values[place][i] - at_null) - usual
        remarkable |= bool(beyond > 0.0 and (usual == 0.0 or beyond > settings.min_significance * errors[place][i]))
    return not effect.implausible(own, named, signals), remarkable


def same(one: PooledRefit, other: PooledRefit, settings: DiagnosisSettings) -> bool:
    """Whether the logs can't tell two refits of one pool apart."""
    between = compare_pools_weighed(other.pool, one.pool, one.before)
    return (
        abs(between.gain) <= settings.alternative_significance * between.error
        or abs(between.share) <= settings.alternative_share
    )


def compare_pools_weighed(before: Pool, after: Pool, weigh: Pool) -> PooledEvidence:
    """Evidence for the second pool over the first, with errors weighed as in a third."""
    return compare_pools(dataclasses.replace(before, error=weigh.error), dataclasses.replace(after, error=weigh.error))
