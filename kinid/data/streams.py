"""Streams of different rates and clocks onto one clock, without inventing data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Array, Mask, Step, frozen
from kinid.errors import InputError

#: a pause longer than this many median sample times of a stream is not bridged by interpolation
MAX_GAP_PERIODS = 3.5
#: a stream at least this many times faster than the reference is averaged, else it is interpolated
FASTER = 1.1
#: streams that were recorded together share all of their time but for this share, or this much [s]
LOST, LOST_LEAST = 0.05, 0.5
#: stamps are no times of measurement where more than this share of samples has that of another one
ONE_STAMP = 0.02
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
    """Streams on the reference's clock.

    Attributes:
        t: [s], (n,). values: by stream name, (n, k). steps: what was done.
        interpolated: median sample time of each stream that was interpolated, by its name [s].
    """

    t: Array
    values: Mapping[str, Array]
    steps: tuple[Step, ...]
    interpolated: Mapping[str, float]


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
        InputError: two streams of one name, a stream whose samples all have one stamp, or one that shares no time with
            the reference.
    """
    names = [s.name for s in (reference, *others)]
    if len(set(names)) < len(names):
        raise InputError(f"streams {', '.join(names)}", "one name a stream", "rename one of them")
    offsets = offsets or {}
    clock, facts = _on_own_clock(reference, offsets)
    brought = {reference.name: clock.values}
    steps = [Step("merge", {**facts, "method": "reference clock"}, _of_one_stamp(reference, facts))]
    interpolated: dict[str, float] = {}
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
        interpolated |= {} if faster else {stream.name: stream.period}
        facts["method"] = "average over the reference's interval" if faster else "linear interpolation"
        facts |= {"empty": missing} | ({"max_gap": float(limit)} if limit < float("inf") else {})
        doubts = _parted((reference, other), (clock, stream)) or apart(
            {s.name: (float(s.t[0]), float(s.t[-1])) for s in (clock, stream)},
            ", or state the offset between their clocks, [streams] wrench_clock_offset",
        )
        steps.append(Step("merge", facts, (*_of_one_stamp(other, facts), *doubts)))
    return Merged(clock.t, {name: frozen(v) for name, v in brought.items()}, tuple(steps), interpolated)


def _parted(raw: tuple[Stream, Stream], shifted: tuple[Stream, Stream]) -> tuple[str, ...]:
    """A doubt where stated offsets take time away that two streams share without them: they were recorded together."""
    before, after = (
        min(float(s.t.max()) for s in pair) - max(float(s.t.min()) for s in pair) for pair in (raw, shifted)
    )
    if before - after <= max(LOST * before, LOST_LEAST):
        return ()
    return (
        f"the streams {raw[0].name} and {raw[1].name} share {after:.4g} s with the stated clock offset, {before:.4g} s "
        "without it: correct [streams] wrench_clock_offset of the rig [s], or take it out",
    )


def apart(spans: Mapping[str, tuple[float, float]], mend: str) -> tuple[str, ...]:
    """At most one doubt: that one of several sources begins late or ends early beside the others.

    Args:
        spans: first and last time of each [s], on one clock. mend: what else to do about it, in words.
    """
    first, last = (max(spans, key=lambda name: sign * spans[name][k]) for sign, k in ((-1, 0), (1, 1)))
    begin, end = spans[first][0], spans[last][1]
    most = max(LOST * (end - begin), LOST_LEAST)
    late = {name: span[0] - begin for name, span in spans.items() if span[0] - begin > most}
    early = {name: end - span[1] for name, span in spans.items() if end - span[1] > most}
    said = [f"{name} begins {by:.3g} s after {first}" for name, by in late.items()]
    said += [f"{name} ends {by:.3g} s before {last}" for name, by in early.items()]
    if not said:
        return ()
    shared = min(span[1] for span in spans.values()) - max(span[0] for span in spans.values())
    return (
        f"{', '.join(said)}: {max(shared, 0.0):.4g} s of {end - begin:.4g} s hold all, and the rest counts for "
        f"nothing; record them together from begin to end{mend}",
    )


def _of_one_stamp(stream: Stream, facts: Mapping[str, object]) -> tuple[str, ...]:
    """A doubt where many samples of a stream that differ have one stamp: it is none of a measurement.

    Args:
        stream: as it was received. facts: what `tidy` did to it.
    """
    many = int(str(facts.get("averaged", 0)))
    if many <= ONE_STAMP * len(stream.t):
        return ()
    return (
        f"{many} of {len(stream.t)} samples of {stream.name} have the stamp of another one and other values, and their "
        "mean is taken: stamps of when a block was sent, or too coarse ones; give each sample its own when it is "
        "recorded",
    )


def _on_own_clock(stream: Stream, offsets: Mapping[str, float]) -> tuple[Stream, dict[str, object]]:
    tidied, counts = tidy(stream)
    if counts["averaged"] and len(tidied.t) == 1:
        raise InputError(
            f"{len(stream.t)} samples of {stream.name} with one stamp, {float(tidied.t[0]):.6g} s",
            "the time of each sample",
            "record anew with stamps of the sensor or of reception; as a table, rows that come evenly need no time: "
            "[columns] t = { rate = … }",
        )
    facts: dict[str, object] = {"stream": stream.name, "samples": len(tidied.t), "rate": 1.0 / tidied.period}
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


def _by_presence(values: Array) -> Iterator[tuple[slice | Index, slice | Mask]]:
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
        integral = running_integral(t, values - centre)
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


def running_integral(t: Array, values: Array) -> Callable[[Array], Array]:
    """Integral over time of the line through samples (n, k), a function of times (m,) -> (m, k); exact between samples,
    up to a constant.
    """
    from scipy.interpolate import make_interp_spline

    integral: Callable[[Array], Array] = make_interp_spline(t, values, k=1).antiderivative()
    return integral
