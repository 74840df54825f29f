"""Refit, accept, prune: nonlinear refits of what promises most, and the paired held-out gain that decides about them.

Blocks of time that a fit has not seen are predicted by two models. With residuals r before and r' after, weighed by
what is left before, block b gains d = Σ(r² − r'²) = |δ|² + 2 Σ r' δ, where δ = r − r' is what the addition changes. It
is the second term that chance makes: its sum over blocks has the standard error 2 √Σ(Σ_b r' δ)², memory within a block
included, and between neighbours (W. K. Newey, K. D. West, Econometrica 55, 1987). What acts rarely is judged by what it
leaves, not by how its gain is spread.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.screening import Candidate
from kinid.effects import Effect
from kinid.identification.error_model import NOISE_UNCERTAINTY, REWEIGHTINGS, unusual_blocks
from kinid.identification.initial_guesses import initial_values, nominal_values, project_linear
from kinid.identification.nuisance import trusted
from kinid.identification.problem import Problem
from kinid.identification.rest_form import best_form, refined_form, with_rest_form
from kinid.identification.solver import ROUGH_GAIN, relearn, search
from kinid.identification.state import State, linear_parameters, parameter_bounds
from kinid.modeling.applicability import amplitudes, base_of
from kinid.modeling.model import Model

Array = NDArray[np.float64]

#: steps of a refit; points of an effect's shapes that are tried, searches from the best of them where they leave nearly
#: as little
REFIT_STEPS, MAX_POINTS, MAX_STARTS, START_COST_RATIO = 20, 8, 2, 1.3
#: a value is no value that can be where it is so many standard errors away from one that can
ADMISSIBLE_ERRORS = 2.0
#: blocks of a log in which one event doesn't count
MIN_BLOCKS_OF_VETO = 40
#: of values that can't be together, shares that are asked for
POSSIBLE_SHARES = (1.0, 0.95, 0.9, 0.8, 0.65, 0.5, 0.25, 0.0)
#: steps after which only those searches are ended that have come within this factor of the deepest
TRIAL_STEPS, TRIAL_COST_RATIO = 5, 1.15


@dataclass(frozen=True)
class Evidence:
    """Paired held-out gain of one state over another.

    Attributes:
        gain: in units of what is left before (weighted squares, prior included). error: its standard error. left: minus
            twice the logarithm of the likelihood of what the second state leaves, each channel with a variance of its
            own.
        share: of the squared held-out error that goes; beyond: of what is beyond noise. change: root mean square of the
            change of the readings over that of the readings, in the channels where it is largest.
    """

    gain: float
    error: float
    left: float
    share: float
    beyond: float
    change: float

    @property
    def significance(self) -> float:
        """Gain over its standard error."""
        return self.gain / self.error if self.error > 0 else np.inf * np.sign(self.gain)


def compare_states(before: State, after: State, sigma: Array) -> Evidence:
    """Evidence for the second state over the first, with errors weighed by σ (channels, g)."""
    old, new = _beside(before, after) / sigma, _beside(after, before) / sigma
    change = old - new
    gain = before.problem.per_block(old**2 - new**2)
    chance = before.problem.per_block(new * change)
    squares = before.problem.per_block(old**2)
    given = _prior_cost(before, after) - _prior_cost(after, before)
    total, error = float(gain.sum()) + given, _standard_error(chance)
    if len(gain) >= MIN_BLOCKS_OF_VETO:
        # one event in a log may be of another kind (a stop, a push, the end of a file) and has no veto
        against = int(np.argmin(gain[1:] + gain[:-1]))
        kept = np.ones(len(gain), np.bool_)
        kept[against : against + 2] = False
        rest, rest_error = float(gain[kept].sum()) + given, _standard_error(np.where(kept, chance, 0.0))
        if rest / rest_error > total / error:
            total, error, gain, squares = rest, rest_error, gain[kept], squares[kept]
    rms = np.sqrt(np.mean((change * sigma) ** 2, axis=1)) / before.problem.channel_rms
    noise = (before.error.noise / sigma) ** 2
    share = float(gain.sum() / max(1e-300, squares.sum()))
    beyond = share / max(NOISE_UNCERTAINTY, 1.0 - float(noise.sum() / max(1e-300, squares.sum())))
    left = _deviance(before.problem, new**2, np.mean(noise, axis=1)) + _prior_cost(after, before)
    return Evidence(total, error, left, share, beyond, float(rms.max()))


def _deviance(problem: Problem, squares: Array, floor: Array) -> float:
    """Minus twice the logarithm of the likelihood of what is left (channels, g), each channel with a variance of its
    own, no less than `floor`, and blocks that leave many times what others do weighed down as an error model does.
    """
    weight = np.ones_like(squares)
    for _ in range(REWEIGHTINGS):
        variance = np.maximum(np.mean(squares / weight, axis=1), floor)[:, None]
        weight = unusual_blocks(problem, squares / variance)
    return float(np.sum(np.log(variance * weight) + squares / (variance * weight)))


def _standard_error(chance: Array) -> float:
    """Of a gain, from what chance makes of it in each block, (blocks,)."""
    variance = float(np.sum(chance**2))
    return 2.0 * float(np.sqrt(max(variance, variance + 2.0 * float(np.sum(chance[1:] * chance[:-1]))))) + 1e-12


def _beside(state: State, other: State) -> Array:
    """Held-out residual; nuisances that the other state has as effects count no further than they are trusted."""
    beyond = state.shift - _as_trusted(state, other)
    if not beyond.any():
        return state.held_out
    p = len(state.values)
    return state.held_out + (state.jacobian[:, p:] @ beyond).reshape(state.problem.shape)


def _as_trusted(state: State, other: State) -> Array:
    """Amounts of the nuisances; those that the other state has as effects clipped to what is trusted, (k,)."""
    shared = [nuisance.effect.id in other.model for nuisance in state.open_]
    return np.where(shared, trusted(state.shift), state.shift)


def _prior_cost(state: State, other: State) -> float:
    return float(np.sum(_as_trusted(state, other) ** 2))


@dataclass(frozen=True, eq=False)
class Refit:
    """An effect refitted beside a model: the states without and with it, and the evidence for the second."""

    effect: Effect
    before: State
    state: State
    evidence: Evidence

    def ended(self, state: State) -> Refit:
        """The same where another search of its model ended, which may leave less."""
        left = compare_states(self.before, state, self.before.error.sigma).left
        return replace(self, state=state, evidence=replace(self.evidence, left=left))

    @cached_property
    def relearnt(self) -> Refit:
        """The same with its own error model."""
        out = self.ended(within_possible(relearn_errors(self.state), self.before))
        out.__dict__["relearnt"] = out
        return out

    @cached_property
    def weighed_by_its_own(self) -> Refit:
        """The same with its own error model, by which its gain is weighed, too."""
        out = self.relearnt
        return replace(out, evidence=compare_states(self.before, out.state, out.state.error.sigma))


def refit(before: State, candidates: list[Candidate]) -> Refit:
    """The best refit of an effect from its best points, with the error model of the state before.

    Points are ranked once more with all that enters linearly at its best: the screening's steps are small.
    """
    model = before.model + candidates[0].effect
    with np.errstate(all="ignore"):
        near = [_nearest(before, model, candidate) for candidate in candidates[:MAX_POINTS]]
        starts = [project_linear(before.problem, model, start, before.error) for start in near]
        # and one that knows nothing of where the smaller model ended: a power law may have bent far to stand in for a
        # layer
        bent = not linear_parameters(before.model, before.problem).all()
        fresh = (
            [initial_values(before.problem, model, nominal_values(model, before.problem), before.error)] if bent else []
        )
    starts.sort(key=lambda start: start[1])
    near = [values for values, cost in starts[:MAX_STARTS] if cost <= START_COST_RATIO * starts[0][1]]
    best = _deepest(before, model, [*near, *fresh])
    # along what the log leaves open a search may wander off: what counts is how well values do that can be
    best = within_possible(best, before)
    return Refit(candidates[0].effect, before, best.slim(), compare_states(before, best, before.error.sigma))


def within_possible(state: State, before: State) -> State:
    """The state, or where values can't be that could before, its refit to those that can.

    Values are held to their ranges; those of a joint or a channel that can't be together, to the largest share of them
    that can.
    """
    layout, signals = state.problem.layout, state.problem.experiment.signals
    ranges = {}
    for effect in state.model.effects:
        if not why_not(state, effect) or (effect.id in before.model and why_not(before, before.model[effect.id])):
            continue
        parameters, (own, named) = effect.parameters(layout), _nearest_null(state, effect)
        null = {p.name: value for p, value in zip(parameters, state.values[state.model.place(effect.id, layout)])}
        null |= {parameters[i].name: value for i, value in amplitudes(effect, layout, base_of(state.model)).items()}
        possible = {p.name: effect.admissible_range(p) or (-np.inf, np.inf) for p in parameters}
        inside = {name: float(np.clip(value, *possible[name])) for name, value in own.items()}
        for part in {_place(name) for name in own}:
            here = [name for name in own if _place(name) == part]
            for share in POSSIBLE_SHARES:
                ends = {name: null[name] + share * (inside[name] - null[name]) for name in here}
                together = named | {f"{effect.id}.{k}": v for k, v in (null | ends).items()}
                if not effect.implausible(null | ends, together, signals):
                    break
            if share < 1.0:
                possible |= {name: (min(null[name], end), max(null[name], end)) for name, end in ends.items()}
        ranges[effect.id] = [possible[p.name] for p in parameters]
    return bounded(state, ranges, state) if ranges else state


def why_not(state: State, effect: Effect) -> str:
    """Say why an effect has values that no material or machine has; "" where they may be possible."""
    return effect.implausible(*_nearest_null(state, effect), state.problem.experiment.signals)


def _nearest_null(state: State, effect: Effect) -> tuple[dict[str, float], dict[str, float]]:
    """Values of an effect moved towards its null by two standard errors, and all values with them, by name."""
    layout = state.problem.layout
    values = dict(zip(state.model.parameters(layout), state.values.tolist()))
    null, begin = amplitudes(effect, layout, base_of(state.model)), state.model.place(effect.id, layout).start
    own: dict[str, float] = {}
    for i, p in enumerate(effect.parameters(layout)):
        value, room = float(state.values[begin + i]), ADMISSIBLE_ERRORS * float(state.standard_errors[begin + i])
        towards = null.get(i, p.nominal)
        own[p.name] = towards if not room < abs(value - towards) else value + room * (1.0 if towards > value else -1.0)
    return own, values | {f"{effect.id}.{name}": value for name, value in own.items()}


def _place(name: str) -> str:
    """Joint or channel of a parameter: what stands in brackets, before its number or axis."""
    return re.split(r"[],.]", name.partition("[")[2])[0]


def bounded(state: State, ranges: Mapping[str, Sequence[tuple[float, float]]], like: State) -> State:
    """Refit a state with effects' parameters held to ranges, with the error model of a similar state."""
    low, high = parameter_bounds(state.model, state.problem)
    for name, own in ranges.items():
        place = state.model.place(name, state.problem.layout)
        low[place] = np.maximum(low[place], [a for a, _ in own])
        high[place] = np.minimum(high[place], [b for _, b in own])
    # a value that is held far from where it was leaves the linear ones where they were
    start, _ = project_linear(state.problem, state.model, np.clip(state.values, low, high), like.error)
    return search(
        state.problem,
        state.model,
        np.clip(start, low, high),
        like.error,
        max_steps=REFIT_STEPS,
        bounds=(low, high),
        like=like,
        ends=ROUGH_GAIN,
    )


def with_best_rest_form(candidate: Refit) -> Refit:
    """A refit under the form of friction at rest that is best beside it."""
    state = best_form(candidate.state)
    if state is candidate.state:
        return candidate
    evidence = compare_states(candidate.before, state, candidate.before.error.sigma)
    return replace(candidate, state=state.slim(), evidence=evidence)


def _deepest(before: State, model: Model, starts: list[Array]) -> State:
    """Search from several starts, continue those near the deepest after some steps, return the deepest end."""
    begun = [
        search(before.problem, model, start, before.error, max_steps=TRIAL_STEPS, like=before, ends=ROUGH_GAIN)
        for start in starts
    ]
    costs = [state.cost if np.isfinite(state.cost) else np.inf for state in begun]
    near = [state for state, cost in zip(begun, costs) if cost <= TRIAL_COST_RATIO * min(costs)] or begun
    ended = [
        state
        if state.converged
        else search(
            before.problem,
            model,
            state.values,
            before.error,
            shift=state.shift,
            known=state.jacobian,
            max_steps=REFIT_STEPS,
            ends=ROUGH_GAIN,
        )
        for state in near
    ]
    return min(ended, key=lambda state: state.cost if np.isfinite(state.cost) else np.inf)


def _nearest(before: State, model: Model, candidate: Candidate) -> Array:
    """As much of the linear view's step as helps: curved laws reward only its beginning."""
    problem, weight = before.problem, 1.0 / before.error.sigma
    low, high = parameter_bounds(model, problem)
    best, least = np.clip(candidate.start, low, high), np.inf
    with np.errstate(all="ignore"):
        for share in (1.0, 0.3, 0.1):
            values = np.clip(candidate.origin + share * (candidate.start - candidate.origin), low, high)
            cost = float(np.sum(((problem.target - problem.predict(model, values)) * weight) ** 2))
            if cost < least:
                best, least = values, cost
            elif np.isfinite(least):
                break
    return best


def without_effect(state: State, name: str) -> State:
    """The state's model without an effect, refitted with the state's error model, under its own best form of rest."""
    names = list(state.model.parameters(state.problem.layout))
    values = np.array([v for full, v in zip(names, state.values) if full.split(".", 1)[0] != name])
    model = state.model - name
    start, _ = project_linear(state.problem, model, values, state.error)
    reduced = search(state.problem, model, start, state.error, max_steps=REFIT_STEPS, like=state, ends=ROUGH_GAIN)
    # the form that is best beside an effect may leave room for it: what it takes off has to be its own
    return refined_form(best_form(reduced))


def relearn_errors(state: State) -> State:
    """The same model with its error model learnt anew from its own residual."""
    return with_rest_form(relearn(state))
