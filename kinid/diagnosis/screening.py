"""Screen: how much of the residual each effect of the catalogue would explain, in the linear view (a score test)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect
from kinid.identification.jacobian import changes
from kinid.identification.nuisance import trusted
from kinid.identification.state import State
from kinid.modeling.applicability import amplitudes, base_of, candidate_effects, shape_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: squared change of all weighted readings below which a parameter isn't seen
MIN_CHANGE = 1e-12
#: readings that an effect of more than a handful of parameters needs for each of them, unless it has a prior
MIN_READINGS = 20


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one point of its shapes.

    Attributes:
        effect: specialised to the log. predicted_gain: what it would take off the weighted squares.
        start: values of model + effect to search from, (p + k,). origin: the same with the effect at its null.
        sensitivity: by amplitude (its number among the effect's parameters), length of the weighted change of the
            readings per unit that no parameter of the model and no nuisance can take up.
    """

    effect: Effect
    predicted_gain: float
    start: Array
    origin: Array
    sensitivity: dict[int, float]


def screen_catalogue(state: State, skipped: frozenset[str] = frozenset()) -> dict[str, list[Candidate]]:
    """Every effect that can act in this log, but for skipped ones, its best point first."""
    out = {}
    for effect, why in candidate_effects(state.model, state.problem.layout):
        if effect.id in skipped:
            continue
        own = effect.for_log(state.problem.experiment.signals)
        many = (
            0
            if own.prior(state.problem.layout) is not None
            else len(own.parameters(state.problem.layout)) * MIN_READINGS
        )
        if not why and not effect.detector and many <= max(6 * MIN_READINGS, state.residual.size):
            points = screen(state, effect)
            if points:
                out[effect.id] = points
    return out


def screen(state: State, effect: Effect) -> list[Candidate]:
    """How much of the residual this effect could explain at each point of its shapes, the best first.

    Its change of the means is freed of what the model's parameters and the nuisances can take up, and projected on the
    residual. A nuisance that is the same effect gives way to it.
    """
    with np.errstate(all="ignore"):
        return sorted(
            _candidates(state, effect.for_log(state.problem.experiment.signals)), key=lambda c: -c.predicted_gain
        )


def _candidates(state: State, effect: Effect) -> Iterator[Candidate]:
    problem, model, layout = state.problem, state.model, state.problem.layout
    sigma, p = state.error.sigma.reshape(-1), len(state.values)
    own = np.array([n.effect.id == effect.id for n in state.open_], np.bool_)
    keep = state.free & np.r_[np.ones(p, np.bool_), ~own]
    kept = keep[state.free]
    jacobian, information = state.weighted[:, kept], state.information[np.ix_(kept, kept)]
    residual = (state.residual.reshape(-1) + state.jacobian[:, p:][:, own] @ state.shift[own]) / sigma
    placed = np.r_[np.zeros(p), state.shift]
    gradient = jacobian.T @ residual - (state.prior @ placed)[keep]
    inverse = np.linalg.pinv(information, hermitian=True)
    given_up = _given_up(state, own, residual) - float(gradient @ inverse @ gradient)
    larger = model + effect
    effect = larger[effect.id]
    parameters, amplitude = effect.parameters(layout), amplitudes(effect, layout, base_of(model))
    before = larger.place(effect.id, layout).start
    prior = effect.prior(layout)
    for at, moving in shape_points(effect, problem.experiment.signals, amplitude):
        null = np.array([amplitude[i] for i in moving])
        steps = at[moving] - null
        scale = np.array([parameters[i].scale for i in moving])
        high = np.array([parameters[i].high for i in moving])
        steps = np.where(steps != 0.0, steps, np.where(null + scale <= high, scale, -scale))
        at_null = np.array([amplitude.get(i, v) for i, v in enumerate(at)])
        origin = np.insert(state.values, before, at_null)
        d = changes(problem, larger, origin, [before + i for i in moving], steps, state.course)
        if not np.isfinite(d).all():
            continue
        d /= sigma[:, None]
        dj = d.T @ jacobian
        gram = d.T @ d - dj @ inverse @ dj.T
        slope = d.T @ residual - dj @ inverse @ gradient
        h = gram + 1e-7 * np.diag(np.diag(d.T @ d)) + 1e-12 * np.eye(len(moving))
        if prior is not None:
            per_unit = np.outer(steps, steps)
            effect = effect.learnt(layout, gram / per_unit, slope / steps)
            learnt = effect.prior(layout)
            assert learnt is not None
            h = h + learnt * per_unit
        # along what changes nothing here, rounding alone would say where to begin
        coefficient = np.where(np.diag(d.T @ d) > MIN_CHANGE, np.linalg.solve(h, slope), 0.0)
        start = at.copy()
        for i, step, c in zip(moving, steps, coefficient):
            start[i] = float(np.clip(amplitude[i] + c * step, parameters[i].low, parameters[i].high))
        used = np.array([(start[i] - amplitude[i]) / step for i, step in zip(moving, steps)])
        gain = float(2 * slope @ used - used @ gram @ used) - given_up
        if not np.isfinite(gain):
            continue
        taken = np.zeros(len(keep))
        taken[keep] = inverse @ (gradient - dj.T @ used)
        theta = state.values + taken[:p] * state.scale
        size = np.sqrt(np.maximum(np.diag(gram), 0.0)) / np.abs(steps)
        yield Candidate(effect, gain, np.insert(theta, before, start), origin, dict(zip(moving, size.tolist())))


def _given_up(state: State, own: Mask, residual: Array) -> float:
    """Weighted squares that giving up an effect's own nuisances costs, as far as calibration is trusted.

    Beyond what the model's parameters still gain where its search ended early; `residual` is without these nuisances.
    """
    p, sigma, within = len(state.values), state.error.sigma.reshape(-1), trusted(state.shift)
    kept = (state.residual.reshape(-1) + state.jacobian[:, p:][:, own] @ (state.shift - within)[own]) / sigma
    placed = np.r_[np.zeros(p), state.shift]
    ended = state.weighted.T @ (state.residual.reshape(-1) / sigma) - (state.prior @ placed)[state.free]
    still = float(ended @ np.linalg.pinv(state.information, hermitian=True) @ ended)
    return float(np.sum(residual**2) - np.sum(kept**2) - within[own] @ within[own]) + still
