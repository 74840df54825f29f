"""Initial guesses: linear parameters by least squares, shapes at the best of the points that effects suggest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.identification.error_model import ErrorModel
from kinid.identification.jacobian import changes
from kinid.identification.problem import Problem
from kinid.identification.state import fixed_parameters, linear_parameters
from kinid.modeling.model import Model

Array = NDArray[np.float64]

#: change of all weighted readings, as a length, below which a step of a parameter isn't seen
MIN_CHANGE = 1e-4
#: a start must leave less than this share of the squares of the one before to be taken
START_IMPROVEMENT = 0.98


def nominal_values(model: Model, problem: Problem) -> Array:
    """Nominal values; of detectors what the samples show, (p,)."""
    values = model.nominal(problem.layout)
    fixed = fixed_parameters(model, problem)
    return np.where(np.isnan(fixed), values, fixed)


@np.errstate(all="ignore")  # a start may be far off
def project_linear(problem: Problem, model: Model, start: Array, error: ErrorModel) -> tuple[Array, float]:
    """A start with all parameters that enter nearly linearly at their best, inside bounds, and its weighted squares."""
    named = list(model.parameters(problem.layout).values())
    fixed = ~np.isnan(fixed_parameters(model, problem))
    free = [int(i) for i in np.flatnonzero(linear_parameters(model, problem) & ~fixed)]
    weight = 1.0 / error.sigma
    here = model.course(problem.experiment.signals, start)
    residual = (problem.target - problem.means(here.reading)) * weight
    squares = float(np.sum(residual**2))
    if not free or not np.isfinite(squares):
        return start, squares if np.isfinite(squares) else np.inf
    sizes = np.array([max(abs(named[i].nominal), named[i].scale) for i in free])
    steps = np.where(start[free] + sizes <= [named[i].high for i in free], sizes, -sizes)
    columns = changes(problem, model, start, free, steps, here) / steps * weight.reshape(-1, 1)
    if not np.isfinite(columns).all():
        return start, squares
    size = np.linalg.norm(columns, axis=0)
    columns[:, size * np.abs(steps) < MIN_CHANGE] = 0.0
    size[size * np.abs(steps) < MIN_CHANGE] = 1.0
    step = np.linalg.lstsq(columns / size, residual.ravel(), rcond=1e-8)[0] / size
    low, high = np.array([named[i].low for i in free]), np.array([named[i].high for i in free])
    for share in (1.0, 0.5, 0.25):
        trial = start.copy()
        trial[free] = np.clip(trial[free] + share * step, low, high)
        left = float(np.sum(((problem.target - problem.predict(model, trial)) * weight) ** 2))
        if left < squares:
            return trial, left
    return start, squares


def initial_values(
    problem: Problem, model: Model, start: Array, error: ErrorModel, known: frozenset[str] = frozenset()
) -> Array:
    """The best of the starts that the model's effects suggest, effect by effect, (p,).

    Args:
        start: values to begin with. known: full names of parameters that the caller knows, which no suggestion
            replaces.
    """
    with np.errstate(all="ignore"):
        best, least = project_linear(problem, model, start, error)
        names = list(model.parameters(problem.layout))
        suggestions = {effect.id: effect.initial_guesses(problem.experiment.signals) for effect in model.effects}
        suggestions = {name: points for name, points in suggestions.items() if len(points)}
        for _ in range(2 if len(suggestions) > 1 else min(1, len(suggestions))):
            before = least
            for name, points in suggestions.items():
                place = model.place(name, problem.layout)
                own = list(range(place.start, place.stop))
                varied = [k for k, i in enumerate(own) if names[i] not in known]
                for point in points:
                    trial = best.copy()
                    trial[[own[k] for k in varied]] = np.asarray(point)[varied]
                    found, left = project_linear(problem, model, trial, error)
                    if left < START_IMPROVEMENT * least:
                        best, least = found, left
            if not least < START_IMPROVEMENT * before:
                break
    return best
