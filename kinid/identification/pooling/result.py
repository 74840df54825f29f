"""A model fitted to many logs: what they share, what each has for itself, and how each does on readings held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from kinid.identification.fitted import FitError, FittedParameter
from kinid.identification.lack_of_fit import LackOfFit
from kinid.identification.pooling.held_out import HeldOut
from kinid.identification.pooling.pool import Pool
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import full_name
from kinid.writers import Json, finite


@dataclass(frozen=True, eq=False)
class LogResult:
    """One log of a pooled fit.

    Attributes:
        name: of the log. groups: column → value. samples: readings that count.
        parameters: its own, by "effect.parameter". alone: all parameters as a fit of this log alone has them.
        error: seen, held out by blocks, noise. by_log: error where nothing of what is shared came from this log; its
            own parameters come from its other fold. alone_error: held-out error of the fit of this log alone.
        left: what is left beside noise and tolerance.
        by_log_averaged: by_log in means of neighbours, beside whatever zero its sensor has.
        disagreement: of its shared parameters with those of the other logs, χ² over its expectation `freedom`.
    """

    name: str
    groups: Mapping[str, str]
    samples: int
    parameters: dict[str, FittedParameter]
    alone: dict[str, FittedParameter]
    error: FitError
    by_log: float
    alone_error: float
    left: LackOfFit
    by_log_averaged: float
    disagreement: float
    freedom: float

    def to_dict(self) -> Json:
        """For JSON; None where there is no figure."""
        figures = {
            "train": self.error.train,
            "held_out": self.error.held_out,
            "held_out_by_log": self.by_log,
            "alone": self.alone_error,
            "noise_floor": self.error.noise_floor,
        }
        return {name: finite(value) for name, value in figures.items()}


@dataclass(frozen=True, eq=False)
class PooledFit:
    """A model with its estimates from many logs. `fit["stiffness"]` is a `FittedParameter` of what is shared.

    Attributes:
        model: as asked. sharing: how each parameter is shared, by "effect.parameter".
        parameters: what logs share; of a parameter per group, one a group, as "hooke.stiffness[robot=a]"; of a
            population its mean. spread: of each population, its standard deviation between logs.
        error: over all logs, held out by blocks; by_log: held out by log, NaN for a single one.
        logs: each of them. odd: names of those that don't belong to the others, with the reason, left out of
            what is shared. put_aside: those that can't carry the model, with the reason. warnings: what to doubt.
        left: what is left over all logs. pool, held_out: the search's end, from which a diagnosis goes on.
    """

    model: Model
    sharing: dict[str, str]
    parameters: dict[str, FittedParameter]
    spread: dict[str, FittedParameter]
    error: FitError
    by_log: float
    logs: tuple[LogResult, ...]
    odd: dict[str, str]
    put_aside: dict[str, str]
    warnings: tuple[str, ...]
    left: LackOfFit
    pool: Pool = field(repr=False)
    held_out: HeldOut = field(repr=False)

    def __getitem__(self, name: str) -> FittedParameter:
        return self.parameters[full_name(name, self.parameters, self.model)]

    def __str__(self) -> str:
        error = f"{len(self.logs)} logs, error {self.error.train:.4g} {self.error.unit}"
        lines = [
            f"{name} = {p.value:.4g} [{p.low:.4g}, {p.high:.4g}] {p.unit}".removesuffix(" 1")
            for name, p in self.parameters.items()
        ]
        return "\n".join(
            [f"{self.model}: {error}, held out {self.error.held_out:.4g}, by log {self.by_log:.4g}", *lines]
        )

    @property
    def per_log(self) -> dict[str, dict[str, FittedParameter]]:
        """Each log's own parameters."""
        return {log.name: log.parameters for log in self.logs}

    def to_dict(self) -> Json:
        """The facts as `kinid fit --json` writes them for many logs."""
        return {
            "model": list(self.model.names),
            "parameters": {name: p.to_dict() for name, p in self.parameters.items()},
            "error": self.error.to_dict() | {"held_out_by_log": finite(self.by_log)},
            "warnings": list(self.warnings),
            "logs": [log.name for log in self.logs],
            "sharing": self.sharing,
            "per_log": {name: {key: p.to_dict() for key, p in own.items()} for name, own in self.per_log.items()},
            "spread": {name: p.to_dict() for name, p in self.spread.items()},
            "alone": {log.name: {key: p.to_dict() for key, p in log.alone.items()} for log in self.logs},
            "groups": {log.name: dict(log.groups) for log in self.logs},
            "error_by_log": {log.name: log.to_dict() for log in self.logs},
            "odd": list(self.odd),
            "odd_because": dict(self.odd),
            "put_aside": dict(self.put_aside),
        }
