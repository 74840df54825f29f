"""A small solver of its own: least squares of a model to an experiment, and what is left of it on blocks that it has
not seen.

It asks the project for no more than a model's parameters, its prediction and the samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinid

Array = NDArray[np.float64]


class Fitting:
    """Least squares of a model to an experiment (signals, measured, valid); the error of each channel is its weight."""

    def __init__(self, model: kinid.Model, experiment: Any, weight: Array | None = None) -> None:
        self.model, self.e = model, experiment
        self.named = model.parameters(experiment.signals.layout)
        of = list(self.named.values())
        self.low, self.high, self.scale = (np.array([getattr(p, k) for p in of]) for k in ("low", "high", "scale"))
        self.in_band: Callable[[Array], Array] = getattr(experiment, "in_band", lambda rows: rows)
        self.measured = self.in_band(experiment.measured)
        self.valid = experiment.valid & np.isfinite(self.measured).all(axis=0)
        spread = np.std(self.measured[:, self.valid], axis=1)
        self.weight = 1.0 / np.maximum(spread, 1e-6 * spread.max() + 1e-12) if weight is None else weight
        marks = [
            (
                m.detected(getattr(experiment, "raw", experiment.measured)) if m.detector else None,
                len(m.parameters(experiment.signals.layout)),
            )
            for m in model.effects
        ]
        self.shown, self.held = (
            np.concatenate([np.zeros(0), *(np.full(n, np.nan) if m is None else m[i] for m, n in marks)])
            for i in (0, 1)
        )
        self.free = np.flatnonzero(np.isnan(self.held))
        self._slopes: dict[bytes, Array] = {}

    def start(self, known: dict[str, float]) -> Array:
        """Nominal values, and those that are known."""
        values = np.array([known.get(name, p.nominal) for name, p in self.named.items()], dtype=np.float64)
        return np.where(np.isnan(self.held), values, self.held)

    def predict(self, values: Array) -> Array:
        """Readings, in the band that counts."""
        return self.in_band(self.model.predict(self.e.signals, values))

    def slopes(self, values: Array, base: Array) -> Array:
        """Change of the weighed readings with each free parameter by its scale, (c, n, p)."""
        key = values.tobytes()
        if key not in self._slopes:
            self._slopes = {key: np.empty((*base.shape, len(self.free)))}
            for i, k in enumerate(self.free):
                step = 1e-3 * self.scale[k] * (1.0 if values[k] + 1e-3 * self.scale[k] <= self.high[k] else -1.0)
                there = values.copy()
                there[k] += step
                change = (self.predict(there) - base) * (self.scale[k] / step)
                self._slopes[key][:, :, i] = np.nan_to_num(change) * self.weight[:, None]
        return self._slopes[key]

    def solve(self, start: Array, mask: NDArray[np.bool_], steps: int = 12) -> Array:
        """Levenberg-Marquardt inside the bounds, from these values; a linear model needs one step."""
        values, base, damping = start.copy(), self.predict(start), 1e-9

        def left(readings: Array) -> Array:
            return np.asarray(((self.measured - readings) * self.weight[:, None])[:, mask])

        cost = float((left(base) ** 2).sum())
        for _ in range(steps if len(self.free) else 0):
            j, r = self.slopes(values, base)[:, mask].reshape(-1, len(self.free)), left(base).ravel()
            h, g = j.T @ j, j.T @ r
            for _ in range(6):
                move = np.linalg.lstsq(h + damping * np.diag(np.diag(h) + 1e-12), g, rcond=1e-12)[0]
                there = values.copy()
                there[self.free] += self.scale[self.free] * move
                there = np.clip(there, self.low, self.high)
                readings = self.predict(there)
                now = float((left(readings) ** 2).sum())
                if now <= cost:
                    break
                damping = max(10 * damping, 1e-4)
            if not now <= cost:
                break
            predicted_gain = cost - float(((r - j @ ((there - values)[self.free] / self.scale[self.free])) ** 2).sum())
            values, base, gained, cost, damping = there, readings, cost - now, now, damping / 10
            if gained <= 1e-4 * cost or abs(gained - predicted_gain) <= 1e-3 * predicted_gain:
                break
        return values

    def held_out(self, start: Array) -> Array:
        """Residual of each sample by a fit that has not seen its block, (c, n); NaN where nothing was read."""
        number = blocks(self.e.signals.t)
        large = np.abs(self.measured * self.weight[:, None]).sum(0) * self.valid
        size = np.bincount(number, large) / np.maximum(1, np.bincount(number))
        order, lot, even = np.argsort(size), np.random.default_rng(0), np.zeros(len(size), np.bool_)
        for i in range(0, len(order), 2):
            even[order[i + lot.integers(len(order[i : i + 2]))]] = True
        out = np.full_like(self.measured, np.nan)
        for fold in (even[number], ~even[number]):
            found = self.solve(start, self.valid & fold)
            out[:, ~fold] = (self.measured - self.predict(np.where(np.isnan(self.shown), found, self.shown)))[:, ~fold]
        out[:, ~self.valid] = np.nan
        return out


def blocks(t: Array) -> NDArray[np.int64]:
    """Number of the block each sample lies in: half a second at least, a two-hundredth of the log."""
    span = float(t[-1] - t[0])
    return np.asarray(((t - t[0]) / (max(0.5, span / 200) if span >= 2.0 else max(span / 8, 1e-9))).astype(np.int64))
