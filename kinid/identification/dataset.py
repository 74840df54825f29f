"""Samples in means of neighbours: what is faster than some milliseconds is noise, and long logs are bounded."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Signals
from kinid.effects._derived import sample_period
from kinid.modeling.experiment import Experiment
from kinid.writers import Json

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Places = NDArray[np.int64]

#: samples that predictions are made at, at most; and where they are denser than `DENSE_RATE` [Hz]
MAX_SAMPLES, MAX_DENSE, DENSE_RATE = 40_000, 10_000, 160.0


def group_edges(signals: Signals, valid: Mask, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first sample and end (exclusive) of groups of at most `size` neighbours of one run and validity, (g,)."""
    starts = np.flatnonzero(signals.dt == 0.0)
    within = np.arange(len(signals)) - starts[np.cumsum(signals.dt == 0.0) - 1]
    begins = (within % size == 0) | np.r_[True, np.diff(valid.astype(np.int8)) != 0]
    begin = np.flatnonzero(begins).astype(np.int64)
    return begin, np.r_[begin[1:], len(signals)].astype(np.int64)


def averaged_signals(signals: Signals, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Signals:
    """Signals in means over groups."""
    count = (end - begin).astype(float)

    def mean(x: Array) -> Array:
        return np.ascontiguousarray(np.add.reduceat(x, begin, axis=-1) / count)

    run = np.cumsum(signals.dt == 0.0)[begin]
    t = mean(signals.t)
    dt = np.where(np.r_[True, np.diff(run) != 0], 0.0, np.diff(t, prepend=t[0]))
    sensor, joints = signals.sensor, signals.joints
    if sensor is not None:
        turned = np.moveaxis(mean(np.moveaxis(sensor.to_contact, 0, -1)), -1, 0)
        sensor = dataclasses.replace(
            sensor,
            to_contact=np.ascontiguousarray(turned),
            specific=mean(sensor.specific),
            omega=mean(sensor.omega),
            alpha=mean(sensor.alpha),
            load=mean(sensor.load),
        )
    if joints is not None:
        arrays: Json = {
            field.name: mean(getattr(joints, field.name))
            for field in dataclasses.fields(joints)
            if isinstance(getattr(joints, field.name), np.ndarray)
        }
        joints = dataclasses.replace(joints, **arrays)
    return dataclasses.replace(
        signals,
        t=t,
        dt=dt,
        depth=mean(signals.depth),
        depth_rate=mean(signals.depth_rate),
        slip=mean(signals.slip),
        slip_rate=mean(signals.slip_rate),
        measured=None if signals.measured is None else mean(signals.measured),
        sensor=sensor,
        joints=joints,
    )


class Draws:
    """Draws of a motion's error, averaged as an experiment is; worked out when they are first asked for.

    Args:
        whole: at the log's own rate. begin, end: the samples that are averaged over, (g,); None where none are.
    """

    def __init__(self, whole: Experiment, begin: Places | None = None, end: Places | None = None) -> None:
        self._whole, self._begin, self._end = whole, begin, end

    @cached_property
    def signals(self) -> tuple[Signals, ...]:
        """Signals under each draw."""
        if self._begin is None or self._end is None:
            return self._whole.motion_draws
        # one draw at a time: each is as large as the log
        return tuple(averaged_signals(draw, self._begin, self._end) for draw in self._whole.each_draw())


def averaged(experiment: Experiment) -> tuple[Experiment, Draws]:
    """Average an experiment and its motion draws over neighbouring samples where there are more than needed."""
    signals = experiment.signals
    size = math.ceil(len(signals) / MAX_SAMPLES)
    rate = 1.0 / sample_period(signals)
    size = max(size, min(math.ceil(len(signals) / MAX_DENSE), round(rate / DENSE_RATE)))
    if size <= 1:
        return experiment, Draws(experiment)
    begin, end = group_edges(signals, experiment.valid, size)
    count = (end - begin).astype(float)
    small = dataclasses.replace(
        experiment,
        signals=averaged_signals(signals, begin, end),
        measured=np.ascontiguousarray(np.add.reduceat(experiment.measured, begin, axis=-1) / count),
        valid=experiment.valid[begin],
        noise=experiment.noise / np.sqrt(size),
        phase=None if experiment.phase is None else experiment.phase[begin],
        in_contact=experiment.in_contact[begin],
        rows=experiment.rows[begin],
        touch=None,
    )
    return small, Draws(experiment, begin, end)


def hold_out_folds(signals: Signals, block: NDArray[np.int64]) -> Mask:
    """Which of two folds each block lies in, (blocks,): blocks of time, dealt out so that both folds hold alike
    contact.

    Neighbours in the order of their share of contact and depth go to different folds, by a fixed lot: blocks that
    alternated in time would beat with a periodic motion, and one fold would see nothing but air.
    """
    count = np.maximum(1, np.bincount(block))
    inside = np.bincount(block, signals.depth > 0) / count
    deep = np.bincount(block, np.maximum(signals.depth, 0.0)) / count
    order = np.lexsort((deep, np.round(inside, 2)))
    lot = np.random.default_rng(0)
    even = np.zeros(len(count), dtype=np.bool_)
    for i in range(0, len(order), 2):
        pair = order[i : i + 2]
        even[pair[lot.integers(len(pair))]] = True
    return even
