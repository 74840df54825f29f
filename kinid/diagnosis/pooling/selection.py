"""From many logs and a model to what the model lacks: screen, refit, accept, prune, over all logs at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.pooling.refit import (
    PooledEvidence,
    PooledRefit,
    acceptable,
    compare_pools,
    reduced_by,
    refit,
    same,
)
from kinid.diagnosis.pooling.screening import PooledCandidate, screen_pool
from kinid.diagnosis.result import EffectStatus
from kinid.diagnosis.selection import removable
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.identification.pooling.fit import fit_of_pool
from kinid.identification.pooling.held_out import HeldOut
from kinid.identification.pooling.pool import Pool
from kinid.identification.pooling.result import PooledFit
from kinid.identification.pooling.search import settled
from kinid.identification.state import State
from kinid.modeling.applicability import amplitudes, base_of

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: effects that are refitted in a round: each costs some visits of every log
REFITS = 4
#: a reported error rises where its square is so many times the one before
RISES = 1.01
#: standard errors of a log's own share of an effect beyond which it shows it, or shows that it isn't there
SHOWS = 3.0
#: squared change of a log's weighted readings below which an effect does nothing there
UNSEEN = 1e-9


@dataclass(eq=False)
class PooledSelection:
    """What was found.

    Attributes:
        fits: from the model that was asked about to the last one. added: names, in their order.
        evidence: of each addition. alternatives: of each, those that fit as well. looked: best points of the last look;
            idle: why others weren't asked. refits: of the last look.
    """

    fits: list[PooledFit]
    added: list[str] = field(default_factory=list)
    evidence: dict[str, PooledEvidence] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    looked: dict[str, list[PooledCandidate]] = field(default_factory=dict)
    idle: dict[str, str] = field(default_factory=dict)
    refits: tuple[PooledRefit, ...] = ()


def select(start: PooledFit, settings: DiagnosisSettings, progress: Progress = lambda _: None) -> PooledSelection:
    """Add effects while each is beyond doubt and worth a name, in the logs together.

    Args:
        start: the model that was asked about, fitted. settings: what decides. progress: called at each stage.
    """
    found = PooledSelection([start])
    refused: set[str] = set()
    while True:
        pool = found.fits[-1].pool
        progress("screening the catalogue" if not found.added else f"screening beside {', '.join(found.added)}")
        found.looked, found.idle = screen_pool(pool)
        found.refits = _refitted(found.looked, pool, settings, progress)
        able = [t for t in found.refits if t.effect.id not in refused and acceptable(t, settings)]
        if not able or len(found.added) >= settings.max_effects:
            break
        best = min(able, key=lambda t: t.evidence.left)
        # how much is worth a name is no reason to take, of equals, what bends further
        others = [t for t in found.refits if t is not best and t.effect.id not in refused]
        any_share = replace(settings, min_reading_share=0.0)
        rivals = [t for t in others if acceptable(t, any_share) and same(best, t, settings)]
        best, rivals = _smallest([best, *rivals])
        progress(f"fitting all logs with {best.effect.id}")
        fit = fit_of_pool(settled(best.pool))
        if _error(fit) > RISES**0.5 * _error(found.fits[-1]):
            refused.add(best.effect.id)
            continue
        found.fits.append(fit)
        found.added.append(best.effect.id)
        found.evidence[best.effect.id] = best.evidence
        found.alternatives[best.effect.id] = tuple(t.effect.id for t in rivals)
    _prune(found, settings)
    return found


def _error(fit: PooledFit) -> float:
    return fit.by_log if np.isfinite(fit.by_log) else fit.error.held_out


def _refitted(
    looked: dict[str, list[PooledCandidate]], pool: Pool, settings: DiagnosisSettings, progress: Progress
) -> tuple[PooledRefit, ...]:
    """Refits of what promises most, the best first."""
    ranked = sorted((points[0] for points in looked.values()), key=lambda c: -c.predicted_gain)
    least = settings.min_significance**2 / 4
    if ranked:
        least = max(least, settings.promising_share * ranked[0].predicted_gain)
    out = []
    for candidate in [c for c in ranked if c.predicted_gain > least][:REFITS]:
        progress(f"fitting all logs with {candidate.effect.id}")
        out.append(refit(pool, looked[candidate.effect.id]))
    return tuple(sorted(out, key=lambda t: t.evidence.left))


def _smallest(alike: Sequence[PooledRefit]) -> tuple[PooledRefit, list[PooledRefit]]:
    """Of those that fit as well, the one with the fewest parameters; and the others."""
    best = min(alike, key=lambda t: (len(t.pool.alone[0].values), -t.evidence.gain))
    return best, [t for t in alike if t is not best and best.effect.id not in t.effect.generalises]


def _prune(found: PooledSelection, settings: DiagnosisSettings) -> None:
    """Take back additions that later ones made needless."""
    for name in found.added[:-1]:
        pool = found.fits[-1].pool
        if not removable(pool.model, name):
            continue
        less = reduced_by(pool, name)
        evidence = found.evidence[name] = compare_pools(less, pool)
        if evidence.significance < settings.min_significance or evidence.share < settings.min_share / np.sqrt(
            len(pool)
        ):
            found.added.remove(name)
            found.alternatives.pop(name, None)
            found.fits[-1] = fit_of_pool(settled(less))


def shown_by(pool: Pool, name: str) -> list[EffectStatus]:
    """Which logs show an effect of the pool's model: present, absent, or not excited where one can't tell.

    Each log's own share of the effect, 1 where it is as large there as in the others, follows from its readings with
    what is shared as all others know it. A log shows the effect where that share is `SHOWS` standard errors from
    nothing, and its absence where it is as far from 1 and not from nothing.
    """
    held_out, given = HeldOut(pool), []
    for number, at in enumerate(pool.at):
        known = np.zeros((len(at.scale), len(at.scale)))
        others = held_out.squares[np.ix_(at.into, at.into)] - held_out.parts[number].squares
        known[np.ix_(at.shared, at.shared)] = others
        known[np.ix_(at.own, at.own)] += pool.own_prior(number)
        given.append((name, known, pool.normals[number].inflation))
    return pool.visits(_shown, given)


def _shown(state: State, name: str, known: Array, inflation: float) -> EffectStatus:
    """What one log shows of an effect, beside what other logs and priors know of its directions, (d, d)."""
    weight = 1.0 / state.error.sigma
    without = state.problem.predict(state.model, _nulled(state, name))
    d = ((state.problem.means(state.course.reading) - without) * weight).ravel()
    residual = (state.residual * weight).ravel()
    rest = np.ones(len(known), np.bool_)
    rest[state.model.place(name, state.problem.layout)] = False
    jacobian = state.jacobian[:, rest] * weight.reshape(-1, 1)
    h = jacobian.T @ jacobian + known[np.ix_(rest, rest)]
    h += 1e-9 * np.diag(np.diag(h)) + 1e-12 * np.eye(len(h))
    cross = jacobian.T @ d
    along = np.linalg.solve(h, cross)
    information = float(d @ d - cross @ along)
    if information < UNSEEN:
        return EffectStatus.NOT_EXCITED
    share = 1.0 + float(d @ residual - along @ (jacobian.T @ residual)) / information
    error = float(np.sqrt(inflation / information))
    if share > SHOWS * error:
        return EffectStatus.PRESENT
    return EffectStatus.ABSENT if 1.0 - share > SHOWS * error else EffectStatus.NOT_EXCITED


def _nulled(state: State, name: str) -> Array:
    """A state's values with an effect's amplitudes where they do nothing, (p,)."""
    values, layout = state.values.copy(), state.problem.layout
    begin = state.model.place(name, layout).start
    for i, null in amplitudes(state.model[name], layout, base_of(state.model)).items():
        values[begin + i] = null
    return np.asarray(values)
