"""Offset between the clocks of two signals of one motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.log import Array, Mask
from kinid.data.streams import MAX_GAP_PERIODS, Stream, running_integral, tidy
from kinid.errors import InputError


@dataclass(frozen=True)
class ClockOffset:
    """Offset between two clocks, and how far it can be trusted."""

    value: float  # [s] to add to the other signal's stamps, so that it lines up with the reference
    standard_error: float  # [s] of the value, from leaving out one block of time after another
    correlation: float  # of the two signals' changes, once lined up; 1 is the same motion without noise
    scale: float  # [s] over which changes were compared


@dataclass(frozen=True)
class _Refusal:
    """Why there is no offset."""

    correlation: float  # the largest one
    found: str
    mend: str


Signal = tuple[ArrayLike, ArrayLike]
_FINEST, _BLOCKS = 3.0, 16  # sample times, blocks of the jackknife
_LAGS = np.arange(-4, 5) / 8.0  # [scale] around a peak


def clock_offset(reference: Signal, other: Signal, max_offset: float = 0.5) -> ClockOffset:
    """Offset between the clocks of two signals of one motion, with a positive factor between them.

    What is compared is the change of each signal, its mean over the next `scale` seconds minus that over
    the previous ones: drift and bias fall out, noise is averaged, nothing is shifted. Each scale gives the
    offset at which the changes correlate most. From the coarsest scale to the finest, each searches where
    the ones before leave room; that with the smallest standard error (delete-one-block jackknife, Künsch
    1989) is kept.

    Args:
        reference: t [s] (n,) and x (n,) or (n, k), several components of one vector.
        other: t [s] (m,) and y (m,) or (m, k); its rate and its units are its own.
        max_offset: largest offset [s] that is looked for.

    Raises:
        InputError: too little time in common, no motion, no clear correlation, or a motion that repeats, so
            that several offsets fit alike.
    """
    x, y = _signal(reference, "the reference signal"), _signal(other, "the other signal")
    if x.values.shape[1] != y.values.shape[1]:
        found = f"{x.values.shape[1]} and {y.values.shape[1]} components"
        raise InputError(found, "as many in both signals", "compare the same components")
    if not max_offset > 0:
        raise InputError(f"max_offset {max_offset}", "a time > 0 s", "give the largest offset to look for")
    period = max(x.period, y.period)
    shared = float(min(x.t[-1], y.t[-1]) - max(x.t[0], y.t[0]))
    need = 2 * max_offset + max(max_offset, 32 * _FINEST * period)
    if not shared > need:
        found = f"{max(0.0, shared):.2f} s in common"
        raise InputError(found, f"more than {need:.2f} s", "record both for longer, or lower max_offset")
    for signal in (x, y):
        if np.ptp(signal.values, axis=0).max() <= 1e-9 * np.abs(signal.values).max():
            mend = "take a part of the log in which the robot moves"
            raise InputError(f"no motion in {signal.name}", "signals that change", mend)
    scales = _FINEST * period * 2.0 ** np.arange(12)
    usable = scales[scales <= max((shared - 2 * max_offset) / 24, _FINEST * period)]
    best: ClockOffset | None = None
    refusals = []
    for scale in usable[::-1].tolist():
        middle, reach = (best.value, 5 * best.standard_error + scale / 4) if best else (0.0, max_offset)
        result = _offset_at(x, y, scale, max_offset, middle, reach)
        if isinstance(result, _Refusal):
            refusals.append(result)
        elif best is None or result.standard_error < best.standard_error:
            best = result
    if best is None:
        worst = max(refusals, key=lambda refusal: refusal.correlation)
        raise InputError(worst.found, "two signals of one motion, with one clear best offset", worst.mend)
    return best


def _signal(signal: Signal, name: str) -> Stream:
    t, values = (np.asarray(part, dtype=np.float64) for part in signal)
    values = values[:, None] if values.ndim == 1 else values
    fits = values.shape[:1] == t.shape
    keep = np.isfinite(values).all(axis=1) & np.isfinite(t) if fits else slice(None)
    return tidy(Stream(name, t[keep], values[keep], tuple(str(i) for i in range(values.shape[-1]))))[0]


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Changes of two signals over one scale [s].

    Attributes:
        t: times that are compared [s], (n,). starts: first one of each block, (blocks,).
    """

    x: Stream
    y: Stream
    scale: float
    t: Array
    starts: NDArray[np.intp]

    @cached_property
    def change_of_x(self) -> Array:
        """Changes of the reference at the times, (n, k)."""
        return self._change(self.x, self.t)

    def _change(self, signal: Stream, t: Array) -> Array:
        """Mean over the next `scale` seconds minus mean over the previous ones, (len(t), k)."""
        integral, scale = self._integrals[signal.name], self.scale
        return np.asarray((integral(t + scale) - 2.0 * integral(t) + integral(t - scale)) / scale)

    @cached_property
    def _integrals(self) -> dict[str, Callable[[Array], Array]]:
        return {s.name: running_integral(s.t, s.values - s.values.mean(axis=0)) for s in (self.x, self.y)}

    def sums(self, offsets: Array) -> Array:
        """Sums of each block for the correlation at each offset, (blocks, offsets, 6, k)."""
        dx = self.change_of_x
        table = np.empty((len(self.starts), len(offsets), 6, dx.shape[1]))
        for i, offset in enumerate(offsets):
            dy = self._change(self.y, self.t - offset)
            rows = np.stack([np.ones_like(dx), dx, dy, dx * dy, dx * dx, dy * dy], axis=1)
            table[:, i] = np.add.reduceat(rows, self.starts, axis=0)
        return table

    def peak(self, offset: float) -> tuple[float, Array]:
        """The peak beside an offset, NaN for none, and the sums around it."""
        spread = self.scale * _LAGS
        for _ in range(8):
            table = self.sums(offset + spread)
            move = float(_vertex(spread, _correlation(table.sum(axis=0))[None])[0])
            if not abs(move) < self.scale or abs(move) < 1e-4 * self.scale:
                break
            offset += move
        return offset if abs(move) < self.scale else np.nan, table


def _offset_at(
    x: Stream, y: Stream, scale: float, max_offset: float, middle: float, reach: float
) -> ClockOffset | _Refusal:
    """The offset from changes over one scale [s] within `middle` ± `reach` [s], or why there is none."""
    margin = max_offset + 2 * scale
    start, stop = max(x.t[0] + scale, y.t[0] + margin), min(x.t[-1] - scale, y.t[-1] - margin)
    t = np.arange(start, stop, scale / 4)
    t = t[_clear_of_gaps(t, x, scale) & _clear_of_gaps(t, y, margin)]
    blocks = min(_BLOCKS, len(t) // 12)
    if blocks < 6:
        return _Refusal(-1.0, "too little time without gaps", "record for longer, or lower max_offset")
    compared = _Comparison(x, y, scale, t, np.linspace(0, len(t), blocks + 1).astype(np.intp)[:-1])
    count = np.ceil(4 * reach / scale)
    coarse = middle + np.arange(-count, count + 1) * scale / 4
    coarse = coarse[np.abs(coarse) <= max_offset + scale / 2]
    curve = _correlation(compared.sums(coarse).sum(axis=0))
    # a quarter of the samples is independent; chance must be four standard deviations away
    top, needed = float(curve.max()), max(0.3, 4.0 / np.sqrt(len(t) / 4))
    if not top >= needed:
        found = f"a correlation of {top:.2f} at best, where chance alone reaches {needed:.2f}"
        return _Refusal(top, found, "compare signals that follow one motion with one sign")
    value, table = compared.peak(float(coarse[np.argmax(curve)]))
    if not (abs(value) <= max_offset and abs(value - middle) <= reach + scale / 2):
        return _Refusal(top, f"the best correlation beyond ±{max_offset:g} s", "raise max_offset")
    without = _correlation(table.sum(axis=0) - table)  # (blocks, lags), each without one block
    error = _jackknife(_vertex(scale * _LAGS, without))
    around = _correlation(table.sum(axis=0))
    if not np.isfinite(error) or min(around[[2, 6]]) < 0.3 * around[4]:  # a peak narrower than what is searched
        return _Refusal(top, "no clear peak of the correlation", "take a part of the log with more motion")
    for other in _other_peaks(coarse, curve, value):
        others = compared.peak(other)[1]
        highest = _correlation(others.sum(axis=0)).argmax()
        lead = without[:, 4] - _correlation(others.sum(axis=0) - others)[:, highest]
        if lead.mean() < 4 * _jackknife(lead) + 1e-9:
            found = f"a motion that repeats itself: {value:.3f} s and {other:.3f} s fit alike"
            return _Refusal(top, found, "lower max_offset, or take a motion that does not repeat")
    return ClockOffset(value, error, float(around[4]), scale)


def _jackknife(without: Array) -> float:
    """Standard error of a figure from its values without one block each, (blocks,)."""
    return float(np.sqrt((1 - 1 / len(without)) * np.sum((without - without.mean()) ** 2)))


def _clear_of_gaps(t: Array, stream: Stream, margin: float) -> Mask:
    """True where no gap of the stream is within `margin` [s], (len(t),)."""
    clear = np.ones(len(t), dtype=np.bool_)
    for i in np.flatnonzero(np.diff(stream.t) > MAX_GAP_PERIODS * stream.period):
        a, b = np.searchsorted(t, (stream.t[i] - margin, stream.t[i + 1] + margin))
        clear[a:b] = False
    return clear


def _correlation(sums: Array) -> Array:
    """Correlation from sums of 1, x, y, xy, xx, yy over samples, (..., 6, k) -> (...)."""
    n, x, y, xy, xx, yy = np.moveaxis(sums, -2, 0)
    products = ((xy, x, y), (xx, x, x), (yy, y, y))
    covariance, var_x, var_y = ((s - a * b / n).sum(axis=-1) for s, a, b in products)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: Array = covariance / np.sqrt(var_x * var_y)
    return ratio


def _vertex(lags: Array, curves: Array) -> Array:
    """Lag at which the parabola through each curve of (m, n) is largest, (m,); NaN where it opens upwards."""
    c2, c1, _ = np.polyfit(lags, curves.T, 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(c2 < 0, -c1 / (2 * c2), np.nan)


def _other_peaks(lags: Array, curve: Array, value: float) -> list[float]:
    """Lags of the three highest local peaks but that at `value`."""
    inner = np.flatnonzero((curve[1:-1] > curve[:-2]) & (curve[1:-1] >= curve[2:])) + 1
    inner = inner[np.abs(lags[inner] - value) > 2 * (lags[1] - lags[0])]
    return [float(lags[i]) for i in inner[np.argsort(-curve[inner])][:3]]
