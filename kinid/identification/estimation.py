"""A model fitted to a log: the one way from an experiment to a state, for fits, comparisons and diagnoses alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinid.effects import Stage
from kinid.experiment import Experiment
from kinid.identification.initial_guesses import initial_values, nominal_values
from kinid.identification.problem import Problem
from kinid.identification.solver import State, first_error_model, search, solve
from kinid.model import Model

#: shares of their length over which bristles may be elastic; the second is the form that predictions have by default
ELASTIC_SHARES = (0.02, 0.3, 0.7, 0.95)
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
    model = model.for_log(problem.experiment.signals)
    error = first_error_model(problem)
    values = nominal_values(model, problem)
    named = model.parameters(problem.layout)
    given = {name: value for name, value in (known or {}).items() if name in named}
    values = np.array([given.get(name, value) for name, value in zip(named, values)])
    return with_friction_form(solve(problem, model, initial_values(problem, model, values, error, frozenset(given))))


def with_friction_form(state: State) -> State:
    """The state under the form of friction at rest that the log bears out best.

    Motion tells little of the force of friction that sticks: between P. R. Dahl's bristles (1968), which creep under any tremor, and
    L. Prandtl's (1928), which are elastic until they slip, a surface may be anything (P. Dupont et al., IEEE Trans. Autom. Control 47,
    2002). The elastic share of a bristle's length is chosen from a few; it is no parameter of any effect.
    """
    signals = state.problem.experiment.signals
    if Stage.FRICTION not in state.model.stages or not signals.inside.any():
        return state
    best, least = state, np.sum((state.held_out / state.error.sigma) ** 2)
    for share in ELASTIC_SHARES:
        if share == signals.play:
            continue
        problem = state.problem.with_elastic_share(share)
        change = problem.predict(state.model, state.values) - state.problem.predict(state.model, state.values)
        if np.mean((change / state.error.noise) ** 2) < UNNOTICED**2:
            continue
        other = search(problem, state.model, state.values, state.error, shift=state.shift)
        left = np.sum((other.held_out / state.error.sigma) ** 2)
        if left < BETTER_FORM * least:
            best, least = other, left
    return best if best is state else solve(best.problem, best.model, best.values, shift=best.shift, error=best.error)
