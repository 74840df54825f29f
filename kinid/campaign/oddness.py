"""Why a log is the odd one: which effect of rig or touch, in this log alone, would make it like the others."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.pooling.screening import columns_of, points_of
from kinid.effects import Stage, get
from kinid.identification.pooling.result import PooledFit
from kinid.identification.problem import Problem
from kinid.identification.solver import first_error_model, search
from kinid.identification.state import State
from kinid.modeling.experiment import Experiment

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign

Array = NDArray[np.float64]

#: stages of what is the rig's, not the material's
RIGS = frozenset({Stage.GEOMETRY, Stage.TOOL, Stage.SENSOR, Stage.ACQUISITION, Stage.FRAME})
#: share of the squares that an explanation must take off
ENOUGH = 0.5


def reasons(fit: PooledFit, campaign: Campaign, name: str, why: str) -> str:
    """Why a log is odd, in words, with what would make it like the others.

    Args:
        fit: of all logs but the odd ones. campaign: the logs. name: of the odd one. why: what its figures say.
    """
    log = next(log for log in campaign.logs(fit.model) if log.name == name)
    state = _as_others_say(fit, log.load())
    turned = _axes(state)
    if turned:
        return f"{why}; {turned}"
    best, remedy = ENOUGH, ""
    squares = float(np.sum((state.residual / state.error.sigma) ** 2))
    with np.errstate(all="ignore"):
        for point in points_of(state)[0]:
            if not set(get(point.effect.id).stages()) & RIGS:
                continue
            columns = columns_of(state, point)
            if columns is None:
                continue
            h = columns.squares + 1e-6 * np.diag(np.diag(columns.squares)) + 1e-12 * np.eye(len(columns.slope))
            coefficient = np.linalg.solve(h, columns.slope)
            share = float(columns.slope @ coefficient) / max(squares, 1e-300)
            if share > best + 0.02:
                parameters = point.effect.parameters(state.problem.layout)
                amounts = [
                    f"{parameters[i].name} {null + c * step:.2g} {parameters[i].unit}".removesuffix(" 1")
                    for i, null, c, step in zip(point.moving, point.null, coefficient, point.steps)
                ]
                best = share
                remedy = f"{point.effect.id} ({', '.join(amounts[:3])}) would take off {100 * share:.0f} % of that"
    return f"{why}; {remedy}" if remedy else why


def _as_others_say(fit: PooledFit, whole: Experiment) -> State:
    """An odd log, predicted with what is shared; its own parameters where the other logs have them in the middle."""
    problem = Problem.build(whole)
    model = fit.model.for_log(problem.experiment.signals)
    values = []
    for name, p in model.parameters(problem.layout).items():
        others = [log.parameters[name].value for log in fit.logs if name in log.parameters and log.name not in fit.odd]
        known = fit.parameters.get(name)
        values.append(known.value if known is not None else float(np.median(others)) if others else p.nominal)
    held = np.array(values)
    # its sensor's zero, and whatever else calibration leaves open, is its own
    return search(problem, model, held, first_error_model(problem), bounds=(held, held), max_steps=3)


def _axes(state: State) -> str:
    """Which axes of a sensor are swapped or turned, in words; "" where no such thing makes the log like the others."""
    if state.problem.layout.kind != "wrench":
        return ""
    read = state.problem.target
    expected = state.problem.means(state.course.reading)
    # a constant is the sensor's zero, whose axes are turned too
    read, expected = (x - x.mean(axis=1, keepdims=True) for x in (read, expected))
    weight = 1.0 / np.repeat([read[:3].std() + 1e-12, read[3:].std() + 1e-12], 3)[:, None]

    def left(order: tuple[int, ...], signs: tuple[int, ...]) -> float:
        turn = np.array(signs)[:, None]
        moved = np.vstack([turn * expected[list(order)], turn * expected[[3 + i for i in order]]])
        return float(np.sum(((read - moved) * weight) ** 2))

    plain = left((0, 1, 2), (1, 1, 1))
    tried = {
        (order, signs): left(order, signs) for order in permutations(range(3)) for signs in product((1, -1), repeat=3)
    }
    (order, signs), least = min(tried.items(), key=lambda item: item[1])
    if least > (1.0 - ENOUGH) * plain:
        return ""
    words = [f"{'−' if sign < 0 else ''}{'xyz'[i]}" for i, sign in zip(order, signs)]
    return f"its sensor's axes x, y, z read {', '.join(words)} of the others'"
