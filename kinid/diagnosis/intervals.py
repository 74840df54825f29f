"""Intervals of a diagnosed model's parameters, which know that its residual is not white."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from kinid import effects
from kinid.diagnosis.candidates import amplitudes, base_of
from kinid.diagnosis.descent import LOOSE, State, bounds
from kinid.diagnosis.noise import alike_at_each_turn
from kinid.fit import Z95, FittedParameter

Array = NDArray[np.float64]

#: estimates that are correlated by more hang on each other
ALIKE = 0.9
#: a parameter whose scale moves all weighted readings together by less is open
UNSEEN = 1e-3


def covariance(state: State, stated: bool = True) -> Array:
    """Sandwich covariance over blocks of half a second (White 1980, clustered: Liang & Zeger 1986), (p, p).

    Infinite in the rows of parameters that the log leaves open. Tolerances of calibration count: no parameter is better known
    than they are; nor than what is wrong in the same way at each turn of the motion lets them be.

    Args:
        stated: of the fit with calibration as it was stated; else of the one with calibration free, which is at hand.
    """
    p = len(state.values)
    tolerant = np.diag(state.inverse)[:p]
    state = state.plain if stated else state
    inverse = state.inverse
    number = state.problem.blocks
    each = csr_array((state.residual, (number, np.arange(len(number)))), shape=(number.max(initial=0) + 1, len(number)))
    scores = each @ state.jacobian  # summed within each block
    meat = scores.T @ scores
    whole = inverse @ meat @ inverse
    # calibration is no better known than its tolerance, and noise alone is the least
    whole = np.maximum(np.maximum(np.diag(whole), np.diag(inverse))[:p], tolerant)
    out = np.diag(whole * state.scale**2)
    sandwich = (inverse @ meat @ inverse)[:p, :p] * np.outer(state.scale, state.scale)
    off = ~np.eye(p, dtype=np.bool_)
    out[off] = sandwich[off]
    for moved in _moved_at_each_turn(state):
        out += np.outer(moved[:p] * state.scale, moved[:p] * state.scale)
    open_ = open_parameters(state)
    out[open_, :] = np.inf
    out[:, open_] = np.inf
    return out


def _moved_at_each_turn(state: State) -> Iterator[Array]:
    """How far all columns' coefficients would move with readings that are wrong in the same way at each turn, (p + k,) each."""
    problem = state.problem
    if problem.experiment.layout.kind == "joints":
        return
    predicted = problem.experiment.in_band(problem.predict(state.model, state.values))
    for change in alike_at_each_turn(problem.experiment, state.model, state.values, predicted):
        yield state.inverse @ (state.jacobian.T @ problem.stack(change))


def open_parameters(state: State) -> NDArray[np.bool_]:
    """Which parameters the log does not move, alone or together with others, (p,)."""
    p = len(state.values)
    lengths = np.linalg.norm(state.jacobian[:, :p], axis=0)
    variance = np.diag(state.inverse)[:p]
    out: NDArray[np.bool_] = state.free[:p] & ((lengths < UNSEEN) | (variance > 1.0 / UNSEEN**2))
    return out


def fitted(state: State, variance: Array, stated: bool = True) -> dict[str, FittedParameter]:
    """Estimates with 95 % intervals, by "effect.parameter"; where a bound holds an estimate, its interval begins there.

    Args:
        variance: the `covariance`, (p, p). stated: as for it.
    """
    error = np.sqrt(np.maximum(np.diag(variance), 0.0))
    told = state.plain if stated else state
    low, high = told.values - Z95 * error, told.values + Z95 * error
    parameters = state.model.parameters(state.problem.experiment.layout)
    for i, sign, width in _pinned(told):
        wide = max(width, Z95 * error[i]) if np.isfinite(error[i]) else width
        low[i], high[i] = (told.values[i], told.values[i] + wide) if sign > 0 else (told.values[i] - wide, told.values[i])
    least, greatest = bounds(state.model, state.problem)
    low = np.where(np.isfinite(low), np.maximum(low, least), low)
    high = np.where(np.isfinite(high), np.minimum(high, greatest), high)
    return {name: FittedParameter(name, float(v), float(lo), float(hi), p.unit)
            for (name, p), v, lo, hi in zip(parameters.items(), told.values, low, high)}  # fmt: skip


def unsized(state: State, name: str, known: dict[str, FittedParameter], variance: Array) -> list[str] | None:
    """Parameters of other effects that an effect's size hangs on, where its interval holds "not there"; None where it doesn't.

    Args:
        known, variance: estimates and covariance of all parameters.
    """
    layout, effect = state.problem.experiment.layout, effects.get(name)
    names, own = list(known), np.flatnonzero(state.own(name))
    null = {own[i]: zero for i, zero in amplitudes(effect, layout, base_of(state.model)).items()}
    if not null or not all(known[names[i]].low <= zero <= known[names[i]].high for i, zero in null.items()):
        return None
    error = np.sqrt(np.maximum(np.diag(variance), 0.0))
    seen = np.flatnonzero(np.isfinite(error) & (error > 0.0))
    return [names[j] for j in seen if j not in own
            and any(abs(variance[i, j]) > ALIKE * error[i] * error[j] for i in null if i in seen)]  # fmt: skip


def _pinned(state: State) -> list[tuple[int, int, float]]:
    """Parameters that a bound holds: which, on which side of it they may lie, and how far from it noise alone may put them."""
    p = len(state.values)
    least, greatest = bounds(state.model, state.problem)
    spread = float(np.mean(state.residual**2))
    a = state.jacobian.T @ state.jacobian
    out = []
    for i in np.flatnonzero(~state.free[:p] & (np.diag(a)[:p] > UNSEEN**2)):
        room = 1e-6 * state.scale[i]
        sign = 1 if state.values[i] <= least[i] + room else -1 if state.values[i] >= greatest[i] - room else 0
        if not sign:
            continue
        f = np.r_[i, np.flatnonzero(state.free)]
        variance = np.linalg.inv(a[np.ix_(f, f)] + np.diag(np.full(len(f), LOOSE)))[0, 0]
        out.append((int(i), sign, float(Z95 * np.sqrt(variance * max(1.0, spread)) * state.scale[i])))
    return out
