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

from kinid.diagnosis.acceptance import compare_states
from kinid.diagnosis.pooling.screening import PooledCandidate
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.effects import Effect
from kinid.identification.nuisance import nuisances
from kinid.identification.pooling.held_out import HeldOut, LogState
from kinid.identification.pooling.normals import Normals
from kinid.identification.pooling.pool import Alone, Pool
from kinid.identification.pooling.search import Begun, assemble, descend
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
    begun = []
    for number, alone in enumerate(pool.alone):
        larger = alone.model + effect
        begin = larger.place(effect.id, alone.layout).start
        names = list(larger.parameters(alone.layout))
        place = pool.coordinates(number)
        values = place[: len(alone.values)] * pool.at[number].scale[: len(alone.values)]
        own = dict(zip(names, np.insert(values, begin, starts[number])))
        begun.append(_begun(pool, number, larger, own))
    return _searched_from(pool, pool.model + effect, begun)


def reduced_by(pool: Pool, name: str) -> Pool:
    """The pool's model without an effect, searched from where it is."""
    begun = []
    for number, alone in enumerate(pool.alone):
        place = pool.coordinates(number)
        own = dict(zip(alone.names, place[: len(alone.values)] * pool.at[number].scale[: len(alone.values)]))
        begun.append(_begun(pool, number, alone.model - name, own))
    return descend(_searched_from(pool, pool.model - name, begun), ROUGH_GAIN)


def _begun(pool: Pool, number: int, model: Model, own: Mapping[str, float]) -> Begun:
    """A log with another model, at these values of its parameters."""
    alone, log = pool.alone[number], pool.problems.logs[number]
    problem = pool.problems.of(number, alone.rest)
    open_ = nuisances(model, problem.experiment.signals)
    known = dict(zip([(n.effect.id, n.index) for n in alone.open_], pool.coordinates(number)[len(alone.values) :]))
    shift = np.array([known.get((n.effect.id, n.index), 0.0) for n in open_])
    values = np.array([own[name] for name in model.parameters(alone.layout)])
    here = Alone(
        model,
        alone.layout,
        values,
        np.full(len(values), np.inf),
        open_,
        shift,
        pool.error[number],
        alone.rest,
        alone.held_out,
    )
    prior = prior_precision(model, problem, len(open_))
    # squares that weigh all logs alike: what they share has one value already
    d = len(values) + len(open_)
    flat = Normals(np.eye(d), np.zeros(d), 0.0, (np.eye(d), np.eye(d)), (np.zeros(d), np.zeros(d)), 1.0)
    return Begun(log, here, flat, prior, fixed_parameters(model, problem))


def _searched_from(pool: Pool, model: Model, begun: Sequence[Begun]) -> Pool:
    ids = {effect.id for effect in model.effects}
    asked = {name: way for name, way in pool.sharing.items() if name.split(".", 1)[0] in ids}
    out = assemble(model, begun, asked)
    out.problems = pool.problems
    out.populations |= {name: p for name, p in pool.populations.items() if name in out.populations}
    out.normals = [Normals.of(out.state(number)) for number in range(len(out))]
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
    blocks, apart, squares, changes = [], [], 0.0, []
    for number in range(len(before)):
        first, second = before.state(number), after.state(number)
        sigma = before.error[number].sigma
        one = LogState.made(first, old.by_block(number))
        found = compare_states(one, LogState.made(second, new.by_block(number)), sigma)
        blocks.append(found)
        squares += float(np.sum((one.held_out / sigma) ** 2))
        changes.append(found.change)
        if len(before) > 1:
            alone = LogState.made(first, old.by_log(number)), LogState.made(second, new.by_log(number))
            apart.append(compare_states(*alone, sigma))
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


def acceptable(tried: PooledRefit, settings: DiagnosisSettings) -> bool:
    """Whether a refit is beyond doubt, worth a name, physically possible, and true of logs that didn't tell of it."""
    e = tried.evidence
    needed = settings.min_significance * max(0.5, 1.0 - e.share)
    return (
        e.significance > needed
        and e.by_log > DOUBT
        and e.share > settings.min_share / np.sqrt(len(tried.pool))  # what chance makes of a share falls with logs
        and e.change > settings.min_reading_share
        and not implausible(tried)
        and _remarkable(tried, settings)
    )


def errors_of(pool: Pool, number: int) -> Array:
    """Rough standard error of each parameter of a log, (p,)."""
    held_out, alone, at = HeldOut(pool), pool.alone[number], pool.at[number]
    inflation = float(np.mean([normals.inflation for normals in pool.normals]))
    inverse = np.linalg.pinv(held_out.squares, hermitian=True)
    part = held_out.parts[number]
    turn = np.zeros((len(at.scale), len(at.shared)))
    turn[at.shared, np.arange(len(at.shared))] = 1.0
    turn[at.own] += part.gain
    variance = np.einsum("ij,jk,ik->i", turn, inverse[np.ix_(at.into, at.into)], turn)
    variance[at.own] += np.diag(np.linalg.pinv(part.own_squares, hermitian=True))
    out: Array = np.sqrt(np.maximum(variance * inflation, 0.0))[: len(alone.values)] * at.scale[: len(alone.values)]
    return out


def implausible(tried: PooledRefit) -> str:
    """Why an effect's values are none that a material or a machine has, in words; "" where they may be possible."""
    pool, name = tried.pool, tried.effect.id
    numbers = range(len(pool)) if tried.effect.per_log else (0,)
    for number in numbers:
        alone, p = pool.alone[number], len(pool.alone[number].values)
        values, errors = pool.coordinates(number)[:p] * pool.at[number].scale[:p], errors_of(pool, number)
        effect, place = alone.model[name], alone.model.place(name, alone.layout)
        null = amplitudes(effect, alone.layout, base_of(alone.model))
        named = dict(zip(alone.names, values.tolist()))
        own: dict[str, float] = {}
        for i, parameter in enumerate(effect.parameters(alone.layout)):
            value, room = float(values[place][i]), DOUBT * float(errors[place][i])
            towards = null.get(i, parameter.nominal)
            far = room < abs(value - towards)
            own[parameter.name] = value + room * (1.0 if towards > value else -1.0) if far else towards
        signals = pool.problems.of(number, alone.rest).experiment.signals
        why = effect.implausible(own, named | {f"{name}.{k}": v for k, v in own.items()}, signals)
        if why:
            return why
    return ""


def _remarkable(tried: PooledRefit, settings: DiagnosisSettings) -> bool:
    """Whether the logs say more of an effect than that it is as large as in every material and every rig."""
    pool, name = tried.pool, tried.effect.id
    for number in range(len(pool)) if tried.effect.per_log else (0,):
        alone = pool.alone[number]
        effect, place, p = alone.model[name], alone.model.place(name, alone.layout), len(alone.values)
        values = (pool.coordinates(number)[:p] * pool.at[number].scale[:p])[place]
        errors = errors_of(pool, number)[place]
        signals = pool.problems.of(number, alone.rest).experiment.signals
        open_, parameters = effect.calibration_sd(signals), effect.parameters(alone.layout)
        for i, null in amplitudes(effect, alone.layout, base_of(alone.model)).items():
            usual = max(effect.usual(parameters[i]), DOUBT * open_.get(parameters[i].name, 0.0))
            beyond = abs(values[i] - null) - usual
            if beyond > 0.0 and (usual == 0.0 or beyond > settings.min_significance * errors[i]):
                return True
    return False


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
