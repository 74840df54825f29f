"""Streams of different rates and clocks onto one clock, without inventing data; offset between two clocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.log import Array, Mask, Step, frozen
from kinid.errors import InputError

#: a pause longer than this many median sample times of a stream is not bridged by interpolation
MAX_GAP_PERIODS = 3.5
#: a stream at least this many times faster than the reference is averaged, else it is interpolated
FASTER = 1.1
#: two times are the same when they differ by less than this part of a sample time: the rounding of stamps
_SAME = 1e-6

Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples of one source on its own clock, in the order and with the repetitions of their reception.

    Raises:
        InputError: no samples, shapes that don't fit, or a time that is not finite.
    """

    name: str
    t: Array  # (n,) [s]
    values: Array  # (n, k); what is not a finite number is absent
    names: tuple[str, ...]  # (k,)

    def __post_init__(self) -> None:
        for name in ("t", "values"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        n = self.t.shape[0] if self.t.ndim == 1 else 0
        if n == 0:
            raise InputError(f"no samples in {self.name}", "at least one", "check that it was recorded")
        if self.values.shape != (n, len(self.names)):
            found = f"values of shape {self.values.shape} in {self.name}"
            raise InputError(found, f"shape ({n}, {len(self.names)})", "give one name a column")
        if not np.isfinite(self.t).all():
            row = int(np.flatnonzero(~np.isfinite(self.t))[0])
            raise InputError(
                f"time that is not a number in sample {row + 1} of {self.name}",
                "finite times",
                "remove the samples without a time",
            )

    @cached_property
    def period(self) -> float:
        """Median time between samples that differ in time [s]; infinite for a single sample."""
        steps = np.abs(np.diff(self.t))
        steps = steps[steps > 0]
        return float(np.median(steps)) if steps.size else float("inf")


@dataclass(frozen=True, eq=False)
class Merged:
    """Streams on the reference's clock: `t` [s] (n,), `values` by stream name (n, k), and what was done."""

    t: Array
    values: Mapping[str, Array]
    steps: tuple[Step, ...]


def tidy(stream: Stream) -> tuple[Stream, dict[str, int]]:
    """The stream with strictly increasing time, and how many samples were `unsorted`, `repeated`, `averaged`.

    A bag keeps the order of reception, and one source may be recorded twice. Unsorted stamps are sorted; of
    samples with one stamp, identical ones are dropped and differing ones averaged over the values that are
    present.
    """
    t, values = stream.t, stream.values
    unsorted = int((np.diff(t) < 0).sum())
    if unsorted:
        order = np.argsort(t, kind="stable")
        t, values = t[order], values[order]
    doubled = np.concatenate([[False], t[1:] == t[:-1]])
    counts = {"unsorted": unsorted, "repeated": 0, "averaged": 0}
    if doubled.any():
        same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        repeated = doubled.copy()
        repeated[1:] &= same.all(axis=1)
        t, values = t[~repeated], values[~repeated]
        starts = np.flatnonzero(np.concatenate([[True], t[1:] > t[:-1]]))
        counts |= {"repeated": int(repeated.sum()), "averaged": len(t) - len(starts)}
        if len(starts) < len(t):
            values = _mean_of_present(values, starts)
        t = t[starts]
    return Stream(stream.name, t, values, stream.names), counts


def _mean_of_present(values: Array, starts: Index) -> Array:
    """Mean of the finite values of each run of rows, NaN where a run has none, (len(starts), k)."""
    present = np.isfinite(values)
    total = np.add.reduceat(np.where(present, values, 0.0), starts, axis=0)
    count = np.add.reduceat(present.astype(np.float64), starts, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def merge(
    reference: Stream,
    others: Sequence[Stream] = (),
    *,
    max_gap: float | None = None,
    offsets: Mapping[str, float] | None = None,
) -> Merged:
    """Bring streams onto the reference's clock.

    A faster stream is averaged over the reference's sample interval, centred on each of its stamps, so that
    nothing is shifted in time; a slower one is interpolated linearly between neighbours closer than
    `max_gap`. Elsewhere, and outside of a stream's own time, values are NaN: nothing is extrapolated.

    Args:
        reference: the stream whose stamps are kept.
        others: streams to bring onto them.
        max_gap: longest pause [s] that is bridged; default: 3.5 median periods of each stream.
        offsets: by stream name, time [s] that is added to its stamps.

    Raises:
        InputError: two streams of one name, or a stream that shares no time with the reference.
    """
    names = [s.name for s in (reference, *others)]
    if len(set(names)) < len(names):
        raise InputError(f"streams {', '.join(names)}", "one name a stream", "rename one of them")
    offsets = offsets or {}
    clock, facts = _on_own_clock(reference, offsets)
    brought = {reference.name: clock.values}
    steps = [Step("merge", {**facts, "method": "reference clock"})]
    for other in others:
        stream, facts = _on_own_clock(other, offsets)
        limit = max_gap if max_gap is not None else MAX_GAP_PERIODS * stream.period
        faster = stream.period * FASTER < clock.period < float("inf")
        values = resample(stream, clock.t, limit, width=clock.period if faster else 0.0)
        missing = int((~np.isfinite(values)).all(axis=1).sum())
        if missing == len(clock.t):
            spans = [f"{s.name} from {float(s.t[0]):.3f} to {float(s.t[-1]):.3f} s" for s in (stream, clock)]
            found = " and ".join(spans)
            raise InputError(found, "streams that share time", "give the offset between their clocks")
        brought[stream.name] = values
        facts["method"] = "average over the reference's interval" if faster else "linear interpolation"
        facts |= {"empty": missing} | ({"max_gap": float(limit)} if limit < float("inf") else {})
        steps.append(Step("merge", facts))
    return Merged(clock.t, {name: frozen(v) for name, v in brought.items()}, tuple(steps))


def _on_own_clock(stream: Stream, offsets: Mapping[str, float]) -> tuple[Stream, dict[str, Any]]:
    tidied, counts = tidy(stream)
    facts: dict[str, Any] = {"stream": stream.name, "samples": len(tidied.t), "rate": 1.0 / tidied.period}
    facts |= {name: count for name, count in counts.items() if count}
    offset = offsets.get(stream.name, 0.0)
    if offset:
        facts["clock_offset"] = float(offset)
        tidied = Stream(tidied.name, tidied.t + offset, tidied.values, tidied.names)
    return tidied, facts


def resample(stream: Stream, at: Array, max_gap: float, width: float = 0.0) -> Array:
    """Values of a tidy stream at other times, (len(at), k); NaN where it has none.

    Args:
        stream: with strictly increasing time.
        at: times [s], (m,).
        max_gap: longest pause [s] between two samples that is bridged.
        width: > 0: the mean over this time [s], centred; beside a gap or an end the window shrinks on both
            sides, so that it stays centred and inside the data. 0: the value itself.
    """
    out = np.full((len(at), stream.values.shape[1]), np.nan)
    for columns, rows in _by_presence(stream.values):
        t, values = stream.t[rows], stream.values[rows][:, columns]
        if len(t):
            out[:, columns] = _at(t, values, np.asarray(at, dtype=np.float64), max_gap, width)
    return out


def _by_presence(values: Array) -> Iterator[tuple[Any, Any]]:
    """Columns that have finite values in the same rows, and these rows."""
    present = np.isfinite(values)
    if present.all():
        yield slice(None), slice(None)
        return
    masks, which = np.unique(present, axis=1, return_inverse=True)
    for index in range(masks.shape[1]):
        yield np.flatnonzero(which.ravel() == index), masks[:, index]


def _at(t: Array, values: Array, at: Array, max_gap: float, width: float) -> Array:
    """`resample` for columns without absent values."""
    if len(t) == 1:
        return np.where((at == t[0])[:, None], values[0], np.nan)
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    share = (at - t[left]) / (t[left + 1] - t[left])
    near = np.round(share)
    on_sample = np.abs(share - near) < _SAME
    share = np.where(on_sample, near, share)
    point = values[left] + share[:, None] * (values[left + 1] - values[left])
    good = (share >= 0.0) & (share <= 1.0) & (on_sample | (t[left + 1] - t[left] <= max_gap))
    if width > 0:
        half = np.where(good, np.minimum(_room(t, at, left, max_gap), width / 2), 0.0)
        wide = half > 1e-3 * width  # a narrower window is the point itself, and would only add rounding
        centre = values.mean(axis=0)  # a running integral of small numbers keeps its digits
        integral = _Integral(t, values - centre)
        span = integral(at[wide] + half[wide]) - integral(at[wide] - half[wide])
        point[wide] = span / (2.0 * half[wide])[:, None] + centre
    result: Array = np.where(good[:, None], point, np.nan)
    return result


def _room(t: Array, at: Array, left: Index, max_gap: float) -> Array:
    """Time [s] from each of `at` to the nearer end of the run of samples without a gap around it."""
    breaks = np.flatnonzero(np.diff(t) > max_gap)
    first, last = np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(t) - 1]])
    # a time on a sample behind a gap belongs to the run that begins there
    left = np.where(at - t[left] > (1 - _SAME) * (t[left + 1] - t[left]), left + 1, left)
    run = np.searchsorted(last, left)
    room: Array = np.minimum(at - t[first[run]], t[last[run]] - at)
    return np.maximum(room, 0.0)


class _Integral:
    """Integral over time of the line through samples (n, k), from the first sample; exact between samples."""

    def __init__(self, t: Array, values: Array) -> None:
        steps = np.diff(t)[:, None]
        areas = 0.5 * steps * (values[1:] + values[:-1])
        self.total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(areas, axis=0)])
        self.slopes = np.diff(values, axis=0) / steps
        self.t, self.values = t, values

    def __call__(self, at: Array) -> Array:
        left = np.clip(np.searchsorted(self.t, at, side="right") - 1, 0, len(self.t) - 2)
        beyond = (at - self.t[left])[:, None]
        area: Array = self.total[left] + beyond * (self.values[left] + 0.5 * beyond * self.slopes[left])
        return area


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
    starts = np.linspace(0, len(t), blocks + 1).astype(np.intp)[:-1]
    dx = _change(_Integral(x.t, x.values - x.values.mean(axis=0)), t, scale)
    integral = _Integral(y.t, y.values - y.values.mean(axis=0))

    def sums(offsets: Array) -> Array:
        """Sums of each block for the correlation at each offset, (blocks, offsets, 6, k)."""
        table = np.empty((blocks, len(offsets), 6, dx.shape[1]))
        for i, offset in enumerate(offsets):
            dy = _change(integral, t - offset, scale)
            rows = np.stack([np.ones_like(dx), dx, dy, dx * dy, dx * dx, dy * dy], axis=1)
            table[:, i] = np.add.reduceat(rows, starts, axis=0)
        return table

    count = np.ceil(4 * reach / scale)
    coarse = middle + np.arange(-count, count + 1) * scale / 4
    coarse = coarse[np.abs(coarse) <= max_offset + scale / 2]
    curve = _correlation(sums(coarse).sum(axis=0))
    # a quarter of the samples is independent; chance must be four standard deviations away
    top, needed = float(curve.max()), max(0.3, 4.0 / np.sqrt(len(t) / 4))
    if not top >= needed:
        return _Refusal(
            top,
            f"a correlation of {top:.2f} at best, where chance alone reaches {needed:.2f}",
            "compare signals that follow one motion with one sign",
        )
    spread = scale * _LAGS

    def peak(offset: float) -> tuple[float, Array]:
        """The peak beside an offset, NaN for none, and the sums around it."""
        for _ in range(8):
            table = sums(offset + spread)
            move = float(_vertex(spread, _correlation(table.sum(axis=0))[None])[0])
            if not abs(move) < scale or abs(move) < 1e-4 * scale:
                break
            offset += move
        return offset if abs(move) < scale else np.nan, table

    value, table = peak(float(coarse[np.argmax(curve)]))
    if not (abs(value) <= max_offset and abs(value - middle) <= reach + scale / 2):
        return _Refusal(top, f"the best correlation beyond ±{max_offset:g} s", "raise max_offset")
    without = _correlation(table.sum(axis=0) - table)  # (blocks, lags), each without one block
    error = _jackknife(_vertex(spread, without))
    around = _correlation(table.sum(axis=0))
    if not np.isfinite(error) or min(around[[2, 6]]) < 0.3 * around[4]:  # a peak narrower than what is searched
        return _Refusal(top, "no clear peak of the correlation", "take a part of the log with more motion")
    for rival in _other_peaks(coarse, curve, value):
        others = peak(rival)[1]
        highest = _correlation(others.sum(axis=0)).argmax()
        lead = without[:, 4] - _correlation(others.sum(axis=0) - others)[:, highest]
        if lead.mean() < 4 * _jackknife(lead) + 1e-9:
            return _Refusal(
                top,
                f"a motion that repeats itself: {value:.3f} s and {rival:.3f} s fit alike",
                "lower max_offset, or take a motion that does not repeat",
            )
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


def _change(integral: _Integral, t: Array, scale: float) -> Array:
    """Mean over the next `scale` seconds minus mean over the previous ones, (len(t), k)."""
    change: Array = (integral(t + scale) - 2.0 * integral(t) + integral(t - scale)) / scale
    return change


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
