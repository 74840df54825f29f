"""Where a pooled fit is: what all logs share, what each has for itself, and what each log says there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout
from kinid.effects._signals import RestForm
from kinid.identification.error_model import ErrorModel
from kinid.identification.lack_of_fit import error_rows, rms
from kinid.identification.nuisance import Nuisance
from kinid.identification.pooling.logs import Problems
from kinid.identification.pooling.normals import Normals, Reduced, gather, reduce
from kinid.identification.pooling.population import Population
from kinid.identification.pooling.sharing import Directions, SharedVector
from kinid.identification.problem import Problem
from kinid.identification.solver import search
from kinid.identification.state import State
from kinid.identification.whole import held_out_residual
from kinid.modeling.model import Model

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Out = TypeVar("Out")


@dataclass(frozen=True, eq=False)
class Alone:
    """One log's own fit, as it would be without the others.

    Attributes:
        model: as this log needs it. layout: its channels. values: of its parameters, (p,); errors: rough standard
            errors of them, infinite where open. open_: what calibration leaves open; shift: of each, in tolerances,
            (k,). error: its error model. rest: form of friction at rest. held_out: its held-out error [N, N·m].
    """

    model: Model
    layout: Layout
    values: Array
    errors: Array
    open_: tuple[Nuisance, ...]
    shift: Array
    error: ErrorModel
    rest: RestForm
    held_out: float

    @classmethod
    def of(cls, state: State) -> Alone:
        """What a state says."""
        rest, whole = state.problem.whole.signals.rest, state.problem.whole
        held_out = rms(held_out_residual(state)[error_rows(whole)][:, whole.valid])
        return cls(
            state.model,
            state.problem.layout,
            state.values,
            state.standard_errors,
            state.open_,
            state.shift,
            state.error,
            rest,
            held_out,
        )

    @property
    def names(self) -> list[str]:
        """Names of its parameters, in order."""
        return list(self.model.parameters(self.layout))

    @property
    def coordinates(self) -> Array:
        """All its directions, in scales, (p + k,)."""
        scale = [p.scale for p in self.model.parameters(self.layout).values()]
        return np.concatenate([self.values / np.array(scale, dtype=np.float64), self.shift])


@dataclass(frozen=True, eq=False)
class Spot:
    """Values of everything, in scales: what is shared, (m,), and each log's own, (o,) each."""

    shared: Array
    own: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Visit:
    """What one log is predicted with: its model, values (p,), amounts of what calibration leaves open (k,), errors."""

    model: Model
    values: Array
    shift: Array
    error: ErrorModel

    def state(self, problem: Problem) -> State:
        """The log there."""
        return search(problem, self.model, self.values, self.error, shift=self.shift, max_steps=0)


def _visited(problem: Problem, visit: Visit, do: Callable[..., Out], more: tuple[Any, ...]) -> Out:
    return do(visit.state(problem), *more)


@dataclass(eq=False)
class Pool:
    """Logs, a model, and where its parameters are.

    Attributes:
        model: as asked. problems: of the logs. sharing: of each parameter, by name. alone: each log's own fit.
        vector: what the shared directions are of. at: directions of each log. spot: where everything is.
        error: error model of each log. normals: what each log says there. populations: by name of the parameter.
        converged, steps: of the search.
    """

    model: Model
    problems: Problems
    sharing: dict[str, str]
    alone: list[Alone]
    vector: SharedVector
    at: list[Directions]
    spot: Spot
    error: list[ErrorModel]
    normals: list[Normals]
    populations: dict[str, Population] = field(default_factory=dict)
    converged: bool = False
    steps: int = 0

    def __len__(self) -> int:
        return len(self.at)

    def coordinates(self, number: int, spot: Spot | None = None) -> Array:
        """All directions of a log, in scales, inside their bounds, (d,)."""
        at, spot = self.at[number], spot or self.spot
        out = np.where(np.isnan(at.fixed), 0.0, at.fixed)
        out[at.shared] += spot.shared[at.into]
        out[at.own] += spot.own[number]
        return np.clip(out, at.low, at.high)

    def state(self, number: int, spot: Spot | None = None) -> State:
        """One log predicted there, with how its prediction changes: a visit of the log."""
        return self.visit(number, spot).state(self.problems.of(number, self.alone[number].rest))

    def visit(self, number: int, spot: Spot | None = None) -> Visit:
        """What such a visit begins from."""
        alone, at = self.alone[number], self.at[number]
        place, p = self.coordinates(number, spot), len(alone.values)
        return Visit(alone.model, place[:p] * at.scale[:p], place[p:], self.error[number])

    def visits(
        self, do: Callable[..., Out], more: Sequence[tuple[Any, ...]] | None = None, spot: Spot | None = None
    ) -> list[Out]:
        """`do(state, …)` of every log there, in order, wherever that is worked out; what it gives is small.

        Args:
            do: a function of a module. more: what it takes beside the state, of each log. spot: default: where it is.
        """
        numbers = range(len(self))
        given = [(self.visit(i, spot), do, more[i] if more else ()) for i in numbers]
        return self.problems.each(_visited, given, [alone.rest for alone in self.alone])

    def own_prior(self, number: int) -> Array:
        """Prior precision of a log's own directions, (o, o)."""
        at = self.at[number]
        out: Array = at.prior[np.ix_(at.own, at.own)].copy()
        names = self.alone[number].names
        for i in np.flatnonzero(at.population):
            out[i, :] = out[:, i] = 0.0
            out[i, i] = 1.0 / self.populations[names[at.own[i]]].spread ** 2
        return out

    def free_own(self, number: int) -> Mask:
        """Which of a log's own directions it sees, and no bound holds, (o,)."""
        at, normals = self.at[number], self.normals[number]
        slope = normals.slope[at.own] - self.own_prior(number) @ self.spot.own[number]
        place, low, high = (x[at.own] for x in (self.coordinates(number), at.low, at.high))
        pinned = ((place <= low + 1e-9) & (slope < 0)) | ((place >= high - 1e-9) & (slope > 0))
        return np.asarray(~pinned & (np.diag(normals.squares)[at.own] > 1e-12))

    def reduced(
        self, number: int, squares: Array | None = None, slope: Array | None = None, extra: Array | None = None
    ) -> Reduced:
        """One log's normal equations with its own directions eliminated.

        Args:
            number: of the log. squares, slope: in place of those of all its readings. extra: added to the diagonal,
                (d,).
        """
        normals = self.normals[number]
        squares = normals.squares if squares is None else squares
        return reduce(
            squares,
            normals.slope if slope is None else slope,
            self.at[number],
            self.own_prior(number),
            self.spot.own[number],
            extra=np.zeros(len(squares)) if extra is None else extra,
            free=self.free_own(number),
        )

    def gathered(self, each: Callable[[int], Reduced]) -> tuple[Array, Array, list[Reduced]]:
        """What all logs and the priors say of the shared directions, squares (m, m) and slope (m,), and the parts."""
        parts = [each(number) for number in range(len(self))]
        h, b = gather([(at, part.squares, part.slope) for at, part in zip(self.at, parts)], len(self.vector))
        prior = self.vector.prior
        return h + prior, b - prior @ self.spot.shared, parts

    def free_shared(self, slope: Array) -> Mask:
        """Which shared directions some log sees, and no bound holds, (m,)."""
        low, high = self.vector.bounds
        seen = np.zeros(len(self.vector))
        for at, normals in zip(self.at, self.normals):
            np.add.at(seen, at.into, np.diag(normals.squares)[at.shared])
        place = self.spot.shared
        pinned = ((place <= low + 1e-9) & (slope < 0)) | ((place >= high - 1e-9) & (slope > 0))
        return np.asarray(~pinned & (seen > 1e-12))

    def cost(self, spot: Spot, normals: list[Normals]) -> float:
        """Weighted sum of squares, priors included."""
        own = sum(float(o @ self.own_prior(i) @ o) for i, o in enumerate(spot.own))
        return sum(n.cost for n in normals) + own + float(spot.shared @ self.vector.prior @ spot.shared)
