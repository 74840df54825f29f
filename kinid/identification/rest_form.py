"""Friction at rest, and filters of torques: forms that are chosen from the log, no effect's parameters."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from kinid.effects._signals import RestForm
from kinid.identification.solver import ROUGH_GAIN, relearn, search
from kinid.identification.state import State
from kinid.writers import Json

Array = NDArray[np.float64]

#: forms that are tried: a contact's bristles, elastic over some share of a length up to twice the stated one, an octave
#: apart [m]; speeds of what makes them creep back, and in their place speeds above which friction is full [m/s]
SHARES, LENGTHS = (0.02, 0.3, 0.7, 0.95), np.geomspace(3e-6, 2e-4, 7)
TREMORS, SPEEDS = (3e-5, 1e-4, 3e-4, 1e-3), (1e-4, 2e-4, 4e-4, 1e-3)
#: what torques were smoothed with, and time constants of the low-pass that they come through, 50 to 5 Hz [s]
SMOOTHINGS, LAGS = (0.025, 0.01, 0.004), (0.0032, 0.008, 0.016, 0.032)
#: a joint's bristles in stated lengths, and in their place speeds above which friction is full [rad/s, m/s]
JOINT_LENGTHS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
JOINT_SPEEDS = (5e-4, 0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06, 0.12)
#: of the speed that joints are faster than for a twentieth of the time, what is rest at most: friction that grows over
#: more of it is viscous
REST_SPEED_SHARE, FAST_PERCENTILE = 0.1, 95.0
#: fields that are refined, with their ends
REFINED_FIELDS = {
    "length": (1e-6, 2e-4),
    "speed": (5e-5, 1e-3),
    "share": (0.02, 0.95),
    "tremor": (1e-6, 1e-3),
    "joint": (0.1, 30.0),
    "joint_speed": (3e-4, 0.2),
    "smoothing": (1e-3, 0.1),
    "lag": (1e-3, 0.04),
}
#: steps of a search under another form, and refinements of a form
FORM_STEPS, REFINEMENTS = 6, 3
#: a form is another one where it changes readings by this share of their noise, and better where so much of the error
#: is left
NOTICEABLE_SHARE, FORM_IMPROVEMENT = 0.1, 0.97
#: a field is moved by this share to see what it does, and by a step of so many e-folds at most
FORM_STEP, MAX_FORM_STEP, MIN_CHANGE = 0.03, 0.7, 1e-6


def with_rest_form(state: State) -> State:
    """The state under the form of friction at rest that the log bears out best.

    Motion tells little of the force of friction that sticks: between P. R. Dahl's bristles (1968), which creep under
    any tremor, and L. Prandtl's (1928), which are elastic until they slip, a surface may be anything (P. Dupont et al.,
    IEEE Trans. Autom. Control 47, 2002), and the stated length of the bristles is one of its order of magnitude.
    Drives turn around within some hundredth of a degree, or over some speed where grease carries them, and their
    torques come through filters that no log states. What bends bristles before the touch is as open: most spring back
    in the air, a film that sticks to the tip doesn't. A contact's bristles that are far longer are an effect.
    """
    best = _memory_form(best_form(state))
    if any(getattr(_rest(best), name) != getattr(_rest(state), name) for name in ("kept", "smoothing", "lag")):
        best = best_form(best)
    best = refined_form(best)
    return best if best is state else relearn(best)


def _rest(state: State) -> RestForm:
    return state.problem.experiment.signals.rest


def _with(rest: RestForm, fields: list[str], values: Array) -> RestForm:
    changed: Json = dict(zip(fields, map(float, values)))
    return dataclasses.replace(rest, **changed)


def _change(state: State, rest: RestForm) -> Array:
    """What another form changes of the means, (channels, g)."""
    signals = state.problem.experiment.signals.with_rest(rest)
    return state.problem.means(state.model.predict(signals, state.values)) - state.means


def _noticed(state: State, change: Array) -> bool:
    return bool(np.mean((change / state.error.noise) ** 2) > NOTICEABLE_SHARE**2)


def _under(state: State, rest: RestForm) -> tuple[State, float]:
    """The state under another form, and its squared held-out error in units of what this one leaves."""
    problem = state.problem.with_rest(rest)
    other = search(
        problem,
        state.model,
        state.values,
        state.error,
        shift=state.shift,
        max_steps=FORM_STEPS,
        like=state,
        ends=ROUGH_GAIN,
    )
    return other, _squares(other, state)


def _squares(state: State, unit: State) -> float:
    """Squared held-out error of a state in units of another one."""
    return float(np.sum((state.held_out / unit.error.sigma) ** 2))


def _forms(state: State) -> list[RestForm]:
    """Other forms that change the readings."""
    rest, lasting = _rest(state), state.problem.experiment.signals.joints is None
    if lasting:
        shorter = _noticed(state, _change(state, dataclasses.replace(rest, length=LENGTHS[0])))
        lengths = LENGTHS if shorter else (rest.length,)
        forms = [dataclasses.replace(rest, share=share, kept=not rest.kept) for share in SHARES]
        forms += [dataclasses.replace(rest, tremor=tremor, share=share) for share in SHARES[:2] for tremor in TREMORS]
        forms += [dataclasses.replace(rest, speed=speed) for speed in SPEEDS]
        forms += [
            dataclasses.replace(rest, speed=0.0, share=share, length=float(length))
            for share in SHARES
            for length in lengths
        ]
    else:
        forms = [dataclasses.replace(rest, smoothing=smoothing) for smoothing in (0.0, *SMOOTHINGS)]
        forms += [dataclasses.replace(rest, lag=lag) for lag in (0.0, *LAGS)]
        forms += [dataclasses.replace(rest, joint=joint, joint_speed=0.0) for joint in JOINT_LENGTHS]
        most = _rest_speed(state)
        forms += [dataclasses.replace(rest, joint_speed=speed) for speed in JOINT_SPEEDS if speed <= most]
    return [form for form in forms if form != rest]


def _rest_speed(state: State) -> float:
    """Speed below which joints can be said to be at rest [rad/s, m/s]: of the middle one of those that move."""
    joints = state.problem.experiment.signals.joints
    if joints is None:
        return math.inf
    fast = np.percentile(np.abs(joints.dq), FAST_PERCENTILE, axis=1)
    return REST_SPEED_SHARE * float(np.median(fast[fast > 0.0])) if (fast > 0.0).any() else math.inf


def best_form(state: State) -> State:
    """Return the state under the form of least error in the linear view, where its held-out error is clearly less."""
    forms = _forms(state)
    if not state.finite:
        return state
    if not any(_noticed(state, _change(state, form)) for form in (*forms[:1], *forms[-1:])):
        return state
    inverse = np.linalg.pinv(state.information, hermitian=True)

    def left(change: Array) -> float:
        r = ((state.residual - change) / state.error.sigma).ravel()
        g = state.weighted.T @ r
        return float(r @ r - g @ inverse @ g)

    costs = [left(_change(state, form)) for form in forms]
    if not min(costs) < FORM_IMPROVEMENT * left(np.zeros(state.residual.shape)):
        return state
    other, least = _under(state, forms[int(np.argmin(costs))])
    return other if least < FORM_IMPROVEMENT * _squares(state, state) else state


def _memory_form(state: State) -> State:
    """The state, or that whose material remembers touches where this one's doesn't, and the other way about."""
    other = dataclasses.replace(_rest(state), anew=not _rest(state).anew)
    if not _noticed(state, _change(state, other)):
        return state
    tried, left = _under(state, other)
    return tried if left < FORM_IMPROVEMENT * _squares(state, state) else state


def refined_form(state: State) -> State:
    """The state with its form at its best, by Gauss-Newton steps of logarithms beside all parameters."""
    for _ in range(REFINEMENTS):
        if not state.finite:
            break
        rest, sigma = _rest(state), state.error.sigma
        fields = [field for field in REFINED_FIELDS if getattr(rest, field) > 0.0]
        values = np.array([getattr(rest, field) for field in fields])
        ends = np.array([REFINED_FIELDS[field] for field in fields])
        if "joint_speed" in fields:
            at = fields.index("joint_speed")
            ends[at, 1] = max(ends[at, 0], min(ends[at, 1], _rest_speed(state)))
        moved = np.where(values * (1.0 + FORM_STEP) <= ends[:, 1], FORM_STEP, -FORM_STEP)
        d = np.stack(
            [
                (_change(state, _with(rest, [field], np.array([value]))) / step / sigma).ravel()
                for field, value, step in zip(fields, values * (1.0 + moved), moved)
            ],
            axis=1,
        )
        own = d - state.weighted @ (np.linalg.pinv(state.information, hermitian=True) @ (state.weighted.T @ d))
        step = np.linalg.lstsq(own, (state.residual / sigma).ravel(), rcond=MIN_CHANGE)[0]
        new = np.clip(values * np.exp(np.clip(step, -MAX_FORM_STEP, MAX_FORM_STEP)), *ends.T)
        if not _noticed(state, (d @ np.log(new / values)).reshape(sigma.shape) * sigma):
            break
        other, left = _under(state, _with(rest, fields, new))
        if left >= _squares(state, state):
            break
        state = other
    return state
