"""Candidates to tell apart: which are worth an experiment, what they plausibly look like, and what a refit can make of
them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid import effects as catalogue
from kinid.effects import Effect, Signals
from kinid.errors import InputError
from kinid.modeling.applicability import amplitudes, shape_points
from kinid.modeling.model import Model
from kinid.parameter import Parameter
from kinid.planning.information import sizes

Array = NDArray[np.float64]
T = TypeVar("T")

#: points of an effect's shapes that are looked at
POINTS = 10


@dataclass(frozen=True, eq=False)
class Form:
    """A plausible amount of an effect: one of its parameters a step away from where the effect vanishes.

    Attributes:
        effect: which. at: values of all its parameters, at which it does nothing. index: of the parameter that is
            moved.
        step: how far. parameters: its own.
    """

    effect: Effect
    at: Array
    index: int
    step: float
    parameters: tuple[Parameter, ...]

    @property
    def values(self) -> Array:
        """Of all its parameters."""
        out = self.at.copy()
        out[self.index] += self.step
        return out

    def described(self) -> str:
        """In words."""
        null = self.effect.null
        shapes = [
            f"{p.name} {v:.3g}{_unit(p)}"
            for p, v in zip(self.parameters, self.at)
            if p.name not in null and p.name.split("[")[0] not in null
        ]
        moved = self.parameters[self.index]
        amount = f"{moved.name} {self.values[self.index]:.3g}{_unit(moved)}"
        return ", ".join([f"{self.effect.id} with {amount}", *shapes])


def candidates(model: Model, names: Sequence[str]) -> list[Effect]:
    """The effects of these names, if an experiment is what tells them apart.

    Raises:
        InputError: unknown, in the model, a contact law, a detector, or effects that change different readings.
    """
    chosen = [catalogue.get(name) for name in names]
    if len(set(names)) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"candidates {', '.join(names) or 'none'}", "two different effects or more", "name them as a,b"
        )
    for effect in chosen:
        if effect.id in model:
            raise InputError(
                f"candidate '{effect.id}' in the model {model}", "a model without the candidates", "leave it out"
            )
        if effect.base:
            raise InputError(
                f"candidate '{effect.id}'",
                "effects to add, not a contact law",
                f"hold models side by side: kinid compare LOG --model {_with(model, effect)} --model {_text(model)}",
            )
        if effect.detector:
            raise InputError(
                f"candidate '{effect.id}'",
                "effects that an experiment tells apart",
                f"run kinid diagnose LOG --model {_text(model)}: it is recognised in the samples themselves",
            )
    sides = {effect.id: _side(effect) for effect in chosen}
    for a, b in itertools.combinations(sides, 2):
        if sides[a] and sides[b] and sides[a] != sides[b]:
            raise InputError(
                f"'{a}', which acts on {sides[a]}, and '{b}', which acts on {sides[b]}",
                "effects that change the same readings",
                f"run kinid diagnose LOG --model {_text(model)}: any log that shows both tells them apart",
            )
    return chosen


def _text(model: Model) -> str:
    """As --model takes it."""
    return ",".join(model.names) or "none"


def _with(model: Model, law: Effect) -> str:
    """The model with another contact law, as --model takes it."""
    return ",".join([law.id, *(effect.id for effect in model.effects if not effect.base)])


def _side(effect: Effect) -> str:
    """The readings that an effect changes alone, "" for those that reach several."""
    stages = {stage.value for stage in effect.stages()}
    if stages == {"joint"}:
        return "joint torques"
    if "wrench" not in effect.needs and stages == {"friction"}:
        return "tangential forces"
    return "the normal force" if stages and stages <= {"elastic", "normal"} else ""


def _points(effect: Effect, s: Signals, amplitude: dict[int, float]) -> list[tuple[Array, list[int]]]:
    """Points of its shapes, thinned evenly where there are many."""
    return _thinned(list(shape_points(effect, s, amplitude)))


def _thinned(points: list[T]) -> list[T]:
    return points if len(points) <= POINTS else [points[int(k)] for k in np.linspace(0, len(points) - 1, POINTS)]


def forms(effect: Effect, signals: Sequence[Signals], base: str | None) -> list[Form]:
    """What an effect may plausibly look like in any of these experiments: each parameter by itself, at points of its
    shapes.
    """
    layout = signals[0].layout
    parameters, amplitude = effect.parameters(layout), amplitudes(effect, layout, base)
    shapes = set()
    for s in signals:
        for at, _ in shape_points(effect, s, amplitude):
            at[list(amplitude)] = list(amplitude.values())
            shapes.add(tuple(at))
    out: dict[tuple[float, ...], Form] = {}
    for still in map(np.array, _thinned(sorted(shapes))):
        for i, null in amplitude.items():
            p = parameters[i]
            step = p.scale if null + p.scale <= p.high else -p.scale
            out.setdefault((*still, i), Form(effect, still, i, step, parameters))
    return list(out.values())


def refit_directions(effect: Effect, s: Signals, base: str | None) -> list[list[tuple[Array, Array]]]:
    """For each point of a rival's shapes: pairs of its values whose difference of readings a refit can use."""
    parameters, amplitude = effect.parameters(s.layout), amplitudes(effect, s.layout, base)
    size = sizes(np.zeros(len(parameters)), {p.name: p for p in parameters})
    out = []
    for at, moving in _points(effect, s, amplitude):
        still = at.copy()
        still[list(amplitude)] = list(amplitude.values())
        pairs, away = [], still.copy()
        for i in moving:
            p = parameters[i]
            up = p.scale if amplitude[i] + p.scale <= p.high else -p.scale
            moved = still.copy()
            moved[i] = at[i] if at[i] != amplitude[i] else amplitude[i] + up
            away[i] = moved[i]
            pairs.append((moved, still))
        for k, p in enumerate(parameters):
            if k not in amplitude:  # a shape shows where there is something of the effect
                step = 0.01 * max(abs(at[k]), size[k])
                ends = [away.copy(), away.copy()]
                ends[0][k], ends[1][k] = min(at[k] + step, p.high), max(at[k] - step, p.low)
                pairs.append((ends[0], ends[1]))
        out.append(pairs)
    return out


def _unit(p: Parameter) -> str:
    return "" if p.unit == "1" else f" {p.unit}"
