"""Positions, velocities and accelerations that agree with each other, with their standard deviations.

A fixed-interval smoother (Rauch, Tung & Striebel 1965; Särkkä 2013, ch. 8) over a point driven by white jerk whose
intensity follows the motion. Positions come first; what was logged of velocities and accelerations is then held against
them (bias, gain, delay, noise and its memory), put right where it is off, and smoothed together with them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.state_space import ORDER
from kinid.signal.axis import Axis
from kinid.signal.clock import time_steps
from kinid.signal.noise import Positions, positions, rough, wrong
from kinid.signal.pieces import GAP_FACTOR, runs
from kinid.signal.rates import Learnt, figures, learn, together

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Single = NDArray[np.float32]
T = TypeVar("T")

#: a sample that comes so shortly behind another one, in samples, repeats it
REPEATED = 0.1
#: positions of which more seem single faults aren't faulty: their noise is larger than it seemed
MOST_FAULTS = 0.2
#: from this many numbers on, axes are smoothed side by side
WORTH_THREADS = 50_000


@dataclass(eq=False)
class Track:
    """One axis: its pieces, where each lies among the samples, and noise and step of its positions."""

    noise: float
    step: float
    pieces: list[tuple[Rows, Axis]]
    unit: float  # h, the median sample time [s]


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The estimate, each (n, k); NaN where a sample has no position, derivatives also where it stands alone.

    Attributes:
        value, first, second: position, velocity, acceleration [unit, unit/s, unit/s²].
        sd: their standard deviations, in this order.
        velocities, accelerations: what was found of logged ones, axis by axis; () where none were logged.
    """

    value: Array
    first: Array
    second: Array
    sd: tuple[Single, Single, Single]
    velocities: tuple[Learnt, ...] = field(repr=False)
    accelerations: tuple[Learnt, ...] = field(repr=False)
    _tracks: tuple[Track, ...] = field(repr=False)

    @property
    def facts(self) -> dict[str, object]:
        """Noise and step of the positions, and what was found of logged rates, as plain types."""
        tracks = self._tracks
        out: dict[str, object] = {"noise": [one.noise for one in tracks]}
        out |= {"step": [one.step for one in tracks]} if any(one.step for one in tracks) else {}
        rates = {"velocities": self.velocities, "accelerations": self.accelerations}
        return out | {name: figures(found) for name, found in rates.items() if found}

    def draws(self, number: int) -> Iterator[Smoothed]:
        """The motion with so many samples of the estimate's error, the same at each call."""
        for error in zip(*self.errors(number)):
            value, first, second = (x + e for x, e in zip((self.value, self.first, self.second), error))
            yield replace(self, value=value, first=first, second=second)

    def errors(self, number: int) -> tuple[Single, Single, Single]:
        """Samples of the error of position, velocity and acceleration with its memory (Durbin & Koopman 2002).

        Each (number, n, k); 0 where unknown.
        """
        out = [np.zeros((number, *self.value.shape), np.float32) for _ in range(3)]

        def add(j: int) -> None:
            track = self._tracks[j]
            for i, (rows, axis) in enumerate(track.pieces):
                drawn = axis.smoothed(number, (j, i))[2]
                for order in range(3):
                    out[order][:, rows, j] = drawn[:, :, order] / track.unit**order

        _each(add, range(len(self._tracks)), self.value.size)
        return out[0], out[1], out[2]


def smooth_motion(
    t: Array,
    value: Array,
    pieces: Iterable[slice],
    first: Array | None = None,
    second: Array | None = None,
    every: int = 1,
) -> Smoothed:
    """Smooth positions, and rates where they were measured.

    Args:
        t: time [s], (n,). value: positions (n, k). pieces: runs of samples without a gap, each smoothed by itself.
        first, second: measured velocities and accelerations, (n, k), or None; where one is not a number it isn't there.
        every: one sample in so many was measured, the others were interpolated between.
    """
    unit = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    unit = unit if unit > 0.0 else 1.0
    rows, which = list(runs(t, value, pieces, GAP_FACTOR * unit)), range(value.shape[1])
    steps, tracks = time_steps(t, value, rows, unit), []
    if rows:
        tracks = _each(lambda j: _track(value[:, j], rows, steps, unit, every), which, value.size)
    velocities = _with_rates(t, value, tracks, first, 1, unit)
    accelerations = _with_rates(t, value, tracks, second, 2, unit)
    out = [np.full(value.shape, np.nan) for _ in range(3)]
    sd = [np.full(value.shape, np.nan, np.float32) for _ in range(3)]

    def finish(j: int) -> None:
        for own, axis in tracks[j].pieces:
            state, deviation = axis.sound()
            for order, stated in ((0, None), (1, first), (2, second)):
                if order and len(own) < 2:  # a single row has the rates that were stated, if any
                    out[order][own, j] = np.nan if stated is None else stated[own, j]
                    sd[order][own, j] = np.nan if stated is None else 0.0
                    continue
                out[order][own, j] = state[:, order] / unit**order
                sd[order][own, j] = deviation[:, order] / unit**order

    _each(finish, range(len(tracks)), value.size)
    return Smoothed(out[0], out[1], out[2], (sd[0], sd[1], sd[2]), velocities, accelerations, tuple(tracks))


def _track(x: Array, runs: Sequence[Rows], steps: Sequence[Array], unit: float, every: int) -> Track:
    """One axis from its positions (n,), in runs of rows with their steps of time; see `smooth_motion`."""
    ticks = np.concatenate(steps)
    ticks[ticks == 0.0] = 1.0  # over a gap differences mean nothing, whatever it is

    def single_faults(known: Positions) -> list[NDArray[np.bool_]]:
        pairs = zip(runs, steps)
        return [wrong(x[rows], np.where(tau > 0.0, tau, 1.0), known.noise, known.step) for rows, tau in pairs]

    known = positions(x[np.concatenate(runs)], ticks, every)
    faults = single_faults(known)
    if np.mean(np.concatenate(faults)) > MOST_FAULTS:
        known = rough(x[np.concatenate(runs)])
        faults = single_faults(known)
    quieter = 1.0 if known.step else min(1.0, (known.least / known.noise) ** 2)
    made, at = [], 0
    for rows, tau, fault in zip(runs, steps, faults):
        own = slice(at, at + len(rows))
        at += len(rows)
        variance = known.variance[own].copy()
        if every > 1 and len(rows) > ORDER * every:
            variance[np.arange(len(rows)) % every > 0] = np.inf
        variance[1:][tau[1:] < REPEATED] = np.inf  # what the sample before has said already
        variance[fault] = np.inf
        axis = Axis.of(tau, known.value[own], variance, known.noise**2, quieter)
        axis.climb()
        made.append((rows, axis))
    return Track(known.noise, known.step, made, unit)


def _with_rates(
    t: Array, value: Array, tracks: Sequence[Track], logged: Array | None, order: int, unit: float
) -> tuple[Learnt, ...]:
    """Learn what logged rates (n, k) of this order are worth, and take them among the axes' measurements."""
    if logged is None:
        return ()
    which, size = range(len(tracks)), logged.size
    learnt = together(_each(lambda j: learn(t, value[:, j], tracks[j].pieces, logged[:, j], order, unit), which, size))
    _each(lambda j: _fuse(t, tracks[j], logged[:, j], learnt[j], order), which, size)
    return tuple(replace(one, local=[]) for one in learnt)  # those are as long as the log


def _fuse(t: Array, track: Track, logged: Array, learnt: Learnt, order: int) -> None:
    """Take measured rates, put right, among an axis' measurements."""
    if not learnt.noise < np.inf:
        return
    for i, (rows, axis) in enumerate(track.pieces):
        value, variance = learnt.measurements(t[rows], logged[rows], i)
        n, c = axis.value.shape
        wide, vary = np.zeros((n, order + 1)), np.full((n, order + 1), np.inf)
        wide[:, :c], vary[:, :c] = axis.value, axis.variance
        wide[:, order], vary[:, order] = value * track.unit**order, variance * track.unit ** (2 * order)
        while len(axis.quieter) <= order:
            axis.quieter.append(1.0)
        axis.quieter[order] = learnt.quieter
        wide[:, order] = np.where(vary[:, order] < np.inf, wide[:, order], 0.0)
        axis.value, axis.variance = wide, vary
        axis.climb()


def _each(do: Callable[[int], T], which: Sequence[int], size: int) -> list[T]:
    """Do it for each axis; two at a time where that pays, for the kernels let go of the interpreter."""
    if size < WORTH_THREADS or len(which) < 2 or (os.cpu_count() or 1) < 2:
        return [do(j) for j in which]
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(do, which))
