"""What differs between groups of logs: two robots, before and after a repair, one day and the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from kinid.identification.pooling.result import PooledFit
from kinid.writers import Json

#: probability of such a difference by chance below which it is told, over all that are looked at
CHANCE = 0.01


@dataclass(frozen=True)
class Difference:
    """A shared parameter whose values, as each log alone has them, differ between groups of logs.

    Attributes:
        column: that groups the logs. parameter: its name; unit. values: group → mean. chance: probability of such
            differences where there are none.
    """

    column: str
    parameter: str
    unit: str
    values: dict[str, float]
    chance: float

    def __str__(self) -> str:
        by_group = ", ".join(
            f"{value:.4g} {self.unit} ({group})".replace(" 1 ", " ") for group, value in self.values.items()
        )
        return f"{self.parameter} differs by {self.column}: {by_group}"

    def to_dict(self) -> Json:
        """For JSON."""
        return {
            "column": self.column,
            "parameter": self.parameter,
            "unit": self.unit,
            "values": self.values,
            "chance": self.chance,
        }


def differences(fit: PooledFit) -> tuple[Difference, ...]:
    """Differences between groups that chance doesn't make, the surest first.

    Analysis of variance of logs' own fits (R. A. Fisher, Statistical Methods for Research Workers, 1925): the spread of
    logs inside the groups tells what chance makes.
    """
    logs = [log for log in fit.logs if log.name not in fit.odd]
    columns = list(dict.fromkeys(column for log in logs for column in log.groups))
    names = [name for name in fit.sharing if name in fit.parameters]
    out = []
    for column in columns:
        for name in names:
            estimates = [(log.groups.get(column, ""), log.alone[name]) for log in logs if name in log.alone]
            estimates = [(group, p) for group, p in estimates if np.isfinite(p.high)]
            groups = {group: np.array([p.value for g, p in estimates if g == group]) for group, _ in estimates}
            inside = sum(len(values) for values in groups.values()) - len(groups)
            if len(groups) < 2 or inside < 2:
                continue
            everything = np.concatenate(list(groups.values()))
            between = sum(len(v) * (v.mean() - everything.mean()) ** 2 for v in groups.values()) / (len(groups) - 1)
            within = sum(float(np.sum((v - v.mean()) ** 2)) for v in groups.values()) / inside
            chance = float(f_distribution.sf(between / max(within, 1e-300), len(groups) - 1, inside))
            if chance < CHANCE / max(1, len(names) * len(columns)):
                means = {group: float(values.mean()) for group, values in groups.items()}
                out.append(Difference(column, name, estimates[0][1].unit, means, chance))
    return tuple(sorted(out, key=lambda one: one.chance))
