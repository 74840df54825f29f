"""A model fitted to a log: the one way from an experiment to a state, for fits, comparisons and diagnoses alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinid.effects import Stage
from kinid.effects._signals import BRISTLE
from kinid.experiment import Experiment
from kinid.identification.initial_guesses import initial_values, nominal_values
from kinid.identification.problem import Problem
from kinid.identification.solver import State, first_error_model, search, solve
from kinid.kernels.memory import ELASTIC
from kinid.model import Model

#: shares of their length over which bristles may be elastic; the second is the form that predictions have by default
ELASTIC_SHARES = (0.02, 0.3, 0.7, 0.95)
#: lengths of bristles that are tried [m]: within a quarter of the stated one
LENGTHS = (0.8 * BRISTLE, 1.25 * BRISTLE)
#: steps of a search under another form
FORM_STEPS = 6
#: a form is another one where it changes readings by this share of their noise, and better where so much of the error is left
UNNOTICED, BETTER_FORM = 0.1, 0.97


def estimate(model: Model, experiment: Experiment, known: Mapping[str, float] | None = None) -> State:
    """Fit a model to an experiment.

    Args:
        model: what is fitted. experiment: at the log's own rate.
        known: starting values by full name; where one is given, no other start is tried for it.
    """
    return estimate_problem(model, Problem.build(experiment), known)


def estimate_problem(model: Model, problem: Problem, known: Mapping[str, float] | None = None) -> State:
    """The same for a problem that is there already, so that several models share it."""
    problem = problem.with_bristles(ELASTIC, BRISTLE)  # the form is chosen anew, the same way for all who ask
    model = model.for_log(problem.experiment.signals)
    error = first_error_model(problem)
    values = nominal_values(model, problem)
    named = model.parameters(problem.layout)
    given = {name: value for name, value in (known or {}).items() if name in named}
    values = np.array([given.get(name, value) for name, value in zip(named, values)])
    return with_friction_form(solve(problem, model, initial_values(problem, model, values, error, frozenset(given))))


def with_friction_form(state: State) -> State:
    """The state under the form of friction at rest that the log bears out best.

    Motion tells little of the force of friction that sticks: between P. R. Dahl's bristles (1968), which creep under any
    tremor, and
    L. Prandtl's (1928), which are elastic until they slip, a surface may be anything (P. Dupont et al., IEEE Trans. Autom.
    Control
    47, 2002), and the stated length of the bristles is one of its order of magnitude. Both are chosen from a few; they are
    parameters of no effect. One that is far off is (`presliding`).
    """
    signals = state.problem.experiment.signals
    if Stage.FRICTION not in state.model.stages or not signals.inside.any():
        return state
    best, first = state, (signals.play, signals.stated_bristle)
    forms = [(share, first[1]) for share in ELASTIC_SHARES if share != first[0]]
    best = _best_form(best, forms)
    chosen = best.problem.experiment.signals
    best = _best_form(best, [(chosen.play, length) for length in (BRISTLE, *LENGTHS) if length != chosen.stated_bristle])
    return best if best is state else solve(best.problem, best.model, best.values, shift=best.shift, error=best.error)


def _best_form(state: State, forms: list[tuple[float, float]]) -> State:
    """The state, or that under another form of the bristles (share, length) whose held-out error is clearly less."""
    best, sigma = state, state.error.sigma
    least = float(np.sum((state.held_out / sigma) ** 2))
    here = state.problem.predict(state.model, state.values)
    for share, length in forms:
        problem = state.problem.with_bristles(share, length)
        change = problem.predict(state.model, state.values) - here
        if np.mean((change / state.error.noise) ** 2) < UNNOTICED**2:
            continue
        other = search(problem, state.model, state.values, state.error, shift=state.shift, max_steps=FORM_STEPS)
        left = float(np.sum((other.held_out / sigma) ** 2))
        if left < BETTER_FORM * least:
            best, least = other, left
    return best
