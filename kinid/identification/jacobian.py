"""How predictions change with parameters: differences of predictions, and columns that are known already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout, Stage
from kinid.identification.problem import Problem
from kinid.modeling.forward import Course
from kinid.modeling.model import Model

Array = NDArray[np.float64]

#: in place of a channel's number: all of them
ALL_CHANNELS = -1
#: bytes of columns that are kept for one log
MAX_COLUMN_BYTES = 64_000_000


def parameter_groups(names: Sequence[str], layout: Layout) -> list[Mapping[int, int]]:
    """Parameters that are moved together because each changes another channel, each group as channel → place in
    `names`.

    Of joint torques, a parameter with a joint or a channel in brackets changes that one alone, so that one prediction
    does for many (A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst. Maths. Applics. 13, 1974). Others are alone.
    """
    rows = {f"[{name}]": row for own in (layout.channels, layout.joints) for row, name in enumerate(own)}
    alone: list[Mapping[int, int]] = []
    groups: list[dict[int, int]] = []
    for place, name in enumerate(names):
        row = (
            rows.get(name[name.find("[") :], ALL_CHANNELS) if layout.kind == "joints" and "[" in name else ALL_CHANNELS
        )
        if row == ALL_CHANNELS:
            alone.append({ALL_CHANNELS: place})
            continue
        group = next((g for g in groups if row not in g), None)
        if group is None:
            groups.append({row: place})
        else:
            group[row] = place
    return alone + list(groups)


def changes(
    problem: Problem,
    model: Model,
    values: Array,
    numbers: Sequence[int] | NDArray[np.int64],
    steps: Array,
    here: Course,
) -> Array:
    """Change of the means for a step of each of some parameters alone, (channels · g, k).

    Args:
        problem, model: whose means. values: of all parameters (p,), those that `here` was predicted with.
        numbers: of the parameters that are moved, (k,). steps: by how much, in their units, (k,). here: the prediction.
    """
    names = list(model.parameters(problem.layout))
    many = problem.shape[1]
    out = np.zeros((problem.target.size, len(numbers)), order="F")
    keys = _additive(problem, model, values, numbers)
    scratch = np.empty(problem.target.size)
    for group in parameter_groups([names[i] for i in numbers], problem.layout):
        # taken once: another thread may empty what is kept
        kept = {k: problem.columns.get(keys[k]) for k in group.values()}
        known = all(column is not None for column in kept.values())
        if not known:
            ahead = values.copy()
            for k in group.values():
                ahead[numbers[k]] += steps[k]
            problem.add_change(model.predict(problem.experiment.signals, ahead, here), here.reading, 1.0, scratch)
        for channel, k in group.items():
            rows = slice(None) if channel == ALL_CHANNELS else slice(channel * many, (channel + 1) * many)
            column = kept[k]
            if known and column is not None:
                np.multiply(column, steps[k], out=out[rows, k])
                continue
            out[rows, k] = scratch[rows]
            if keys[k] is not None:
                if (len(problem.columns) + 1) * scratch[rows].nbytes > MAX_COLUMN_BYTES:
                    problem.columns.clear()
                problem.columns[keys[k]] = scratch[rows] / steps[k]
    return out


def _additive(
    problem: Problem, model: Model, values: Array, numbers: Sequence[int] | NDArray[np.int64]
) -> list[object]:
    """What tells the column of each parameter, wherever else a model is, None where that depends on all of it, (k,).

    Torques of an arm's joints add up: what is in proportion to a parameter follows from the motion and the effect's
    shapes alone.
    """
    if not problem.layout.joints or model.stages - {Stage.JOINT}:
        return [None] * len(numbers)
    owner: list[object] = []
    for effect in model.effects:
        place, parameters = model.place(effect.id, problem.layout), effect.parameters(problem.layout)
        shapes = tuple(float(v) for v, p in zip(values[place], parameters) if not p.linear)
        owner += [(effect, shapes, p.name) if p.linear else None for p in parameters]
    return [owner[i] for i in numbers]
