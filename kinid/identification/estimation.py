"""A model fitted to a log: the one way from an experiment to a state, for fits, comparisons and diagnoses alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinid.effects._signals import RestForm
from kinid.identification.initial_guesses import initial_values, nominal_values
from kinid.identification.problem import Problem
from kinid.identification.rest_form import best_form, with_rest_form
from kinid.identification.solver import first_error_model, search, solve
from kinid.identification.state import State, linear_parameters
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model

#: a fit from nothing under another form of friction at rest is kept where it comes to this share of the cost
FRESH_FIT_RATIO = 0.97


def estimate(model: Model, experiment: Experiment, known: Mapping[str, float] | None = None) -> State:
    """Fit a model to an experiment.

    Args:
        model: what is fitted. experiment: at the log's own rate.
        known: starting values by full name; where one is given, no other start is tried for it.
    """
    return estimate_problem(model, Problem.build(experiment), known)


def estimate_problem(model: Model, problem: Problem, known: Mapping[str, float] | None = None) -> State:
    """The same for a problem that is there already, so that several models share it."""
    problem = problem.with_rest(RestForm())  # the form is chosen anew, the same way for all who ask
    model = model.for_log(problem.experiment.signals)
    error = first_error_model(problem)
    nominal, named = nominal_values(model, problem), model.parameters(problem.layout)
    given = {name: value for name, value in (known or {}).items() if name in named}
    values = np.array([given.get(name, value) for name, value in zip(named, nominal)])
    # before a search has bent anything to make up for a wrong one, and the same from wherever it starts
    fresh = initial_values(problem, model, nominal, error)
    looked = search(problem, model, fresh, error, max_steps=0)
    begun = best_form(looked)
    start = initial_values(problem, model, values, error, frozenset(given)) if given else begun.values
    known_there = looked.jacobian if begun is looked and not given else None
    state = with_rest_form(solve(begun.problem, model, start, known=known_there))
    if state.problem is begun.problem or linear_parameters(model, problem).all():
        return state
    # under the wrong form, what bends may have stood in for the right one, and may stay where it ended
    anew = solve(state.problem, model, initial_values(state.problem, model, values, error, frozenset(given)))
    better = anew.cost_with(state.error) < FRESH_FIT_RATIO * state.cost_with(state.error)
    return with_rest_form(anew) if better else state
