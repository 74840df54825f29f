"""Which parameters all logs share, which a group of them does, and which each log has for itself."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout
from kinid.errors import InputError, near
from kinid.identification.nuisance import Nuisance, shift_bounds
from kinid.identification.pooling.logs import PooledLog
from kinid.modeling.model import Model
from kinid.parameter import Parameter

Array = NDArray[np.float64]
Places = NDArray[np.int64]

#: one value for all logs; one for each; one for each, out of a normal population whose mean and spread are learnt
SHARED, PER_LOG, POPULATION = "shared", "per-log", "population"
#: what a parameter may be instead: one value for each value of a column, as "per robot"
PER = "per "
#: of many logs one is always beyond two tolerances: bounds of what calibration leaves open of each log, whose shared
#: values other logs hold, are so many times those of a single log (0.006 % of logs are beyond four)
WIDER = 2.0
#: logs that a message names
MOST_NAMED = 3


def sharing_of(model: Model, layout: Layout, asked: Mapping[str, str], columns: Sequence[str] = ()) -> dict[str, str]:
    """How each parameter is shared, by "effect.parameter": as asked for, else as its effect says (`Effect.per_log`).

    Args:
        model: whose parameters. layout: of a log. columns: that logs may be grouped by.
        asked: parameter, with its effect or without, or effect → `SHARED`, `PER_LOG`, `POPULATION` or "per COLUMN".

    Raises:
        InputError: a name that is no parameter, or a way to share that there isn't.
    """
    named = model.parameters(layout)
    own = {effect.id: effect.per_log for effect in model.effects}
    out = {name: PER_LOG if own[name.split(".", 1)[0]] else SHARED for name in named}
    ways = (SHARED, PER_LOG, POPULATION, *(PER + column for column in columns))
    for given, way in asked.items():
        if way not in ways:
            raise InputError(f"{given} = '{way}'", f"one of {', '.join(ways)}", near(way, ways))
        meant = [name for name in named if given in (name, *name.split(".", 1), name.partition("[")[0])]
        if not meant:
            known = [*own, *named]
            raise InputError(f"'{given}' to be {way}", f"an effect or a parameter of {model}", near(given, known))
        out |= dict.fromkeys(meant, way)
    return out


def refuse_ungrouped(logs: Sequence[PooledLog], asked: Mapping[str, str]) -> None:
    """Refuse logs that lack a column which a parameter is shared by: they would be a group of their own, unnamed.

    Args:
        logs: of which each has its columns. asked: as of `sharing_of`, which refuses a column that no log has.

    Raises:
        InputError: the column, and the logs without it.
    """
    for given, way in asked.items():
        column = way.removeprefix(PER)
        lacking = [log.name for log in logs if not log.groups.get(column)]
        if column == way or not lacking or len(lacking) == len(logs):
            continue
        shown = ", ".join(lacking[:MOST_NAMED]) + (", …" if len(lacking) > MOST_NAMED else "")
        raise InputError(
            f"{given} = '{way}', and {len(lacking)} of {len(logs)} logs without {column}: {shown}",
            f"{column} of every log",
            f'state it in the [[log]] table of each, as {column} = "…", or share {given} in another way',
        )


@dataclass(frozen=True, eq=False)
class Directions:
    """Where the directions of one log, its p parameters and then its k open quantities, stand in the pooled problem.

    Attributes:
        shared: those that are shared with other logs; into: their places in the shared vector, both (s,).
        own: those that are the log's own, (o,). scale: of each direction, 1 for open quantities, (p + k,).
        low, high: bounds in scales, (p + k,). population: which of `own` are deviations from a shared mean, (o,).
        prior: precision of all directions, (p + k, p + k). fixed: values that nothing moves, in scales, NaN for the
            others.
    """

    shared: Places
    into: Places
    own: Places
    scale: Array
    low: Array
    high: Array
    population: NDArray[np.bool_]
    prior: Array
    fixed: Array


class SharedVector:
    """The directions that several logs share, each known by what it is of."""

    def __init__(self) -> None:
        self.keys: list[tuple[Hashable, ...]] = []
        self._at: dict[tuple[Hashable, ...], int] = {}
        self._low: list[float] = []
        self._high: list[float] = []
        self._scale: list[float] = []
        self._prior: dict[tuple[int, int], float] = {}

    def __len__(self) -> int:
        return len(self.keys)

    def directions(
        self,
        log: PooledLog,
        named: Mapping[str, Parameter],
        open_: Sequence[Nuisance],
        prior: Array,
        held: Array,
        sharing: Mapping[str, str],
        alone: bool,
    ) -> Directions:
        """Those of a log, with room for what of them isn't there yet.

        Args:
            log: whose. named: parameters. open_: quantities that calibration leaves open. prior: precision of all,
                (p + k, p + k). held: values that its samples show, NaN for those that are fitted, (p,).
            sharing: of each parameter by name. alone: whether it is the only log: all it has is shared then.
        """
        scale = np.array([p.scale for p in named.values()] + [1.0] * len(open_))
        least, most = shift_bounds(open_)
        low = np.r_[[p.low for p in named.values()], least] / scale
        high = np.r_[[p.high for p in named.values()], most] / scale
        shared, into, own, population = [], [], [], []
        keys = [self._parameter(log, name, sharing[name], alone) for name in named]
        keys += [None if n.effect.per_log and not alone else ("nuisance", log.rig, n.effect.id, n.name) for n in open_]
        fresh = []
        for i, key in enumerate(keys):
            if i < len(held) and not np.isnan(held[i]):
                continue
            if key is not None:
                if key not in self._at:
                    self._add(key, low[i], high[i], scale[i])
                    fresh.append(i)
                shared.append(i)
                into.append(self._at[key])
            drawn = i < len(held) and not alone and sharing[list(named)[i]] == POPULATION
            if key is None or drawn:
                if i >= len(held):
                    low[i], high[i] = WIDER * low[i], WIDER * high[i]
                own.append(i)
                population.append(drawn)
        for i in fresh:
            for j in fresh:
                a, b = self._at[keys[i] or ()], self._at[keys[j] or ()]
                self._prior[a, b] = float(prior[i, j])
        return Directions(
            np.array(shared, np.int64),
            np.array(into, np.int64),
            np.array(own, np.int64),
            scale,
            low,
            high,
            np.array(population, np.bool_),
            prior,
            np.r_[held / scale[: len(held)], np.full(len(open_), np.nan)],
        )

    def _parameter(self, log: PooledLog, name: str, way: str, alone: bool) -> tuple[Hashable, ...] | None:
        if way == PER_LOG and not alone:
            return None
        group = log.groups.get(way.removeprefix(PER), "") if way.startswith(PER) else ""
        return ("parameter", name, group)

    def _add(self, key: tuple[Hashable, ...], low: float, high: float, scale: float) -> None:
        self._at[key] = len(self.keys)
        self.keys.append(key)
        self._low.append(low)
        self._high.append(high)
        self._scale.append(scale)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest values in scales, each (m,)."""
        return np.array(self._low), np.array(self._high)

    @property
    def scale(self) -> Array:
        """Scale of each, (m,)."""
        return np.array(self._scale)

    @property
    def prior(self) -> Array:
        """Prior precision, (m, m): that of one log, however many share it."""
        out = np.zeros((len(self), len(self)))
        for (a, b), value in self._prior.items():
            out[a, b] = value
        return out

    def parameters(self) -> NDArray[np.bool_]:
        """Which are parameters of the model, (m,)."""
        return np.array([key[0] == "parameter" for key in self.keys], np.bool_)
