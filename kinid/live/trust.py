"""Whether a session's estimates are to be trusted as a whole: what no single sample shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.effects import Layout
from kinid.estimators import Friction
from kinid.estimators.estimate import Estimate, Status

Array = NDArray[np.float64]

#: what a value may scatter by within one touch: this multiple of its standard errors, or this share of itself
MOST_ERRORS, MOST_SHARE = 3.0, 0.1
#: nothing is said of fewer estimates
FEWEST = 10
#: a touch may drive a sensor to the end of its range for a while, but not for this share of a session
MOSTLY = 0.5
#: nothing is estimated then
IDLE = (Status.NO_CONTACT, Status.NOT_SLIDING)
#: what is estimated beside friction's coefficient: its unit, and what takes energy
BESIDE: dict[str, tuple[str, tuple[float, float]]] = {"viscous": ("N·s/m", (0.0, 1e5))}
FORCES = Layout(("normal_force", "tangential_force1", "tangential_force2"), "contact")


@dataclass
class Scatter:
    """Of estimates of p values that stood during one touch of one material, weighed by their errors (D. H. D. West,
    Commun. ACM 22, 1979).

    Attributes:
        count: of them. weight, mean, squares: Σ w, the mean, and Σ w (x − mean)². low, high: ends; (p,) each.
    """

    count: int = 0
    weight: Array = field(default_factory=lambda: np.zeros(1))
    mean: Array = field(default_factory=lambda: np.zeros(1))
    squares: Array = field(default_factory=lambda: np.zeros(1))
    low: Array = field(default_factory=lambda: np.full(1, np.inf))
    high: Array = field(default_factory=lambda: np.full(1, -np.inf))

    def add(self, values: Array, std: Array) -> None:
        """One more."""
        w = 1.0 / np.maximum(std, 1e-12 * np.abs(values) + 1e-300) ** 2
        off = values - self.mean
        self.count, self.weight = self.count + 1, self.weight + w
        self.mean = self.mean + off * w / self.weight
        self.squares = self.squares + w * off * (values - self.mean)
        self.low, self.high = np.minimum(self.low, values), np.maximum(self.high, values)

    @property
    def times(self) -> Array:
        """Scatter over what the errors allow, (p,); 0 where that is too little of the value to matter."""
        if self.count < FEWEST:
            return np.zeros_like(self.squares)
        matters = self.high - self.low > MOST_SHARE * np.maximum(np.abs(self.low), np.abs(self.high))
        return np.asarray(np.where(matters, np.sqrt(self.squares / (self.count - 1)), 0.0))


class Trust:
    """Takes estimates now and then; what it keeps doesn't grow.

    Args:
        model: names of its effects. full: range of the sensor [N, N·m], where it is known.

    Attributes:
        units: of all that is estimated, by name.
    """

    def __init__(self, model: Sequence[str], full: Sequence[float] | None = None) -> None:
        self._full, self._looked, self._beyond = None if full is None else np.asarray(full), 0, 0
        chosen = [effects.get(name) for name in model]
        rubs = any(effect.recursive == Friction.__name__ for effect in chosen)
        self.units = {name: unit for name, (unit, _) in BESIDE.items() if rubs}
        self._possible = {name: span for name, (_, span) in BESIDE.items() if rubs}
        for effect in chosen:
            for p in effect.parameters(FORCES):
                name = effect.map_names.get(p.name, p.name)
                self.units[name] = p.unit
                self._possible[name] = effect.admissible.get(p.name, (-np.inf, np.inf))
        self._seen: dict[str, Counter[Status]] = {}
        self._now: dict[str, Scatter] = {}
        self._worst: dict[str, Scatter] = {}

    def take(self, estimates: Mapping[str, Estimate]) -> None:
        """Estimates of the model's parts as they are now."""
        for part, estimate in estimates.items():
            status = Status(estimate.status)
            if status is Status.NO_CONTACT:
                self.parted(part)
            if status in IDLE:
                continue
            self._seen.setdefault(part, Counter())[status] += 1
            if status is Status.VALID:
                self._now.setdefault(part, Scatter()).add(estimate.values, estimate.std)

    def felt(self, wrench: Array) -> None:
        """A wrench of the sensor now and then, (6,)."""
        if self._full is not None:
            self._looked += 1
            self._beyond += bool((np.abs(wrench) >= self._full).any())

    def parted(self, *parts: str) -> None:
        """Another touch, or another material: values may differ from here on; default: of all parts."""
        for part in parts or tuple(self._now):
            if part in self._now:
                self._worst[part] = self._of(part)
                del self._now[part]

    def doubts(self, estimates: Mapping[str, Estimate]) -> list[str]:
        """What speaks against the values, a line each."""
        out = []
        if self._looked >= FEWEST and self._beyond > MOSTLY * self._looked:
            share = 100 * self._beyond / self._looked
            out.append(
                f"the wrench is at or beyond [sensor] range in {share:.3g} % of the session: it is in another unit, as "
                "mN and N·mm, or the range is another's"
            )
        for part, estimate in estimates.items():
            names, seen = ", ".join(estimate.names), self._seen.get(part, Counter())
            if seen.total() >= FEWEST and not seen[Status.VALID]:
                mostly = seen.most_common(1)[0][0].remedy
                out.append(f"{names}: no estimate stood while the tool touched, mostly: {mostly}")
            for name, value, (low, high) in zip(estimate.names, estimate.values.tolist(), estimate.interval.tolist()):
                least, most = self._possible.get(name, (-np.inf, np.inf))
                if high < least or low > most:
                    out.append(f"{name} {value:.4g}{self._unit(name)} is of no material: {least:g} to {most:g} is")
            worst = self._of(part)
            went = [
                f"{name} went from {low:.4g} to {high:.4g}{self._unit(name)}, {times:.0f} times what ± allows"
                for name, low, high, times in zip(estimate.names, worst.low, worst.high, worst.times)
                if times > MOST_ERRORS
            ]
            if went:
                remedy = "the model lacks something; --record it, and kinid diagnose the recording"
                out.append(f"within one touch {', and '.join(went)}: {remedy}")
        return out

    def _of(self, part: str) -> Scatter:
        """The touch within which values scattered most, the one that lasts included."""
        return max(
            (kept[part] for kept in (self._worst, self._now) if part in kept),
            key=lambda touch: float(touch.times.max()),
            default=Scatter(),
        )

    def _unit(self, name: str) -> str:
        unit = self.units.get(name, "1")
        return "" if unit == "1" else f" {unit}"
