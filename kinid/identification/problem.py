"""What a model is held against: readings in means of neighbours, in blocks of time, dealt into two folds."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout, Signals
from kinid.effects._derived import sample_period
from kinid.effects._samples import lattice
from kinid.effects._signals import RestForm
from kinid.identification.dataset import Draws, averaged, group_edges, hold_out_folds
from kinid.kernels.averages import weighted_changes, weighted_sums
from kinid.modeling.experiment import Experiment
from kinid.modeling.forward import Course
from kinid.modeling.model import Model
from kinid.modeling.sample_times import block_length
from kinid.signal.noise import white_noise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: means a second that are compared; of logs with more of them than `MANY_MEANS`, all channels together, half of that
MEAN_RATE, MANY_MEANS, MAX_MEANS = 125.0, 30_000, 100_000
#: of joint torques so many a second: where friction turns, torques are faster than any estimate of the motion
TORQUE_RATE = 50.0
#: rounding is shared by neighbours where a step is so many times the noise
COARSE_STEP_RATIO = 2.0
#: means of a short log, at least, where it has so many samples
MIN_MEANS = 400


@dataclass(frozen=True, eq=False)
class Problem:
    """Readings of one log in means, and how they are dealt out.

    Predictions are made at the experiment's own samples and then averaged, so that nothing is lost of fast reversals.

    Attributes:
        whole: at the log's own rate. experiment: averaged to a bounded size. drawn: draws of the motion's error.
        begin, end: samples of each group that counts, (g,). block: number of the block of each, without holes, (g,).
        fold: which of two folds each lies in, (g,). whole_fold: and each sample of the whole, (n,).
        columns: changes of the means per unit of a parameter that are the same for all models (`jacobian.changes`).
    """

    whole: Experiment
    experiment: Experiment
    drawn: Draws
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    block: NDArray[np.int64]
    fold: Mask
    whole_fold: Mask
    columns: dict[object, Array] = field(default_factory=dict)

    @classmethod
    def build(cls, whole: Experiment) -> Problem:
        """Average and deal out a log."""
        experiment, drawn = averaged(whole)
        s = experiment.signals
        span = float(s.t[-1]) if len(s) else 0.0
        channels = len(experiment.measured)
        rate = MEAN_RATE if channels * span * MEAN_RATE < MANY_MEANS else 0.5 * MEAN_RATE
        rate = min(rate, TORQUE_RATE) if s.joints is not None else rate
        size = max(1, round(1.0 / (rate * sample_period(s))), math.ceil(experiment.measured.size / MAX_MEANS))
        size = max(1, min(size, len(s) // MIN_MEANS))
        begin, end = group_edges(s, experiment.valid, size)
        length = block_length(span)
        # by their order: a log may hold seconds within years
        times, block = np.unique((s.t / length).astype(np.int64), return_inverse=True)
        keep = experiment.valid[begin]
        begin, end = begin[keep], end[keep]
        dealt = hold_out_folds(s, block)
        whole_block = np.searchsorted(times, (whole.signals.t / length).astype(np.int64)).clip(max=len(dealt) - 1)
        return cls(
            whole,
            experiment,
            drawn,
            begin,
            end,
            np.unique(block[begin], return_inverse=True)[1],
            dealt[block[begin]],
            dealt[whole_block],
        )

    def with_rest(self, rest: RestForm) -> Problem:
        """The same with another form of friction at rest."""
        whole, experiment = (
            dataclasses.replace(one, signals=one.signals.with_rest(rest)) for one in (self.whole, self.experiment)
        )
        return dataclasses.replace(self, whole=whole, experiment=experiment, columns={})

    @property
    def draws(self) -> tuple[Signals, ...]:
        """Its signals under draws of the motion's error."""
        rest = self.experiment.signals.rest
        return tuple(draw.with_rest(rest) for draw in self.drawn.signals)

    @property
    def layout(self) -> Layout:
        """Its channels."""
        return self.experiment.layout

    @property
    def shape(self) -> tuple[int, int]:
        """Channels and groups."""
        return len(self.experiment.measured), len(self.begin)

    @cached_property
    def count(self) -> Array:
        """Samples in each group, (g,)."""
        return (self.end - self.begin).astype(float)

    @cached_property
    def spacing(self) -> float:
        """Usual time between means [s]."""
        return sample_period(self.experiment.signals) * float(np.median(self.count))

    @cached_property
    def _mean_weight(self) -> Array:
        return np.ascontiguousarray(np.broadcast_to(1.0 / self.count, self.shape))

    @cached_property
    def target(self) -> Array:
        """Readings in means, (channels, g)."""
        return self.means(np.nan_to_num(self.experiment.measured))

    @cached_property
    def channel_rms(self) -> Array:
        """Root mean square of each channel's readings about their mean, never zero, (channels,)."""
        rms = np.sqrt(np.mean(self.target**2, axis=1)) if self.shape[1] else np.zeros(self.shape[0])
        return np.maximum(rms, 1e-9)

    @cached_property
    def rounding(self) -> Array:
        """Variance of rounding by a converter so coarse that neighbours share it, (channels,); 0 for others."""
        steps = np.array([lattice(row) for row in self.whole.raw])
        white = [white_noise(row[self.whole.valid]) for row in self.whole.raw]
        coarse = (steps > 0) & (steps > COARSE_STEP_RATIO * np.array(white))
        return np.where(coarse, steps**2 / 12.0, 0.0)

    def means(self, readings: Array) -> Array:
        """Readings (channels, n) in means over the groups that count, (channels, g)."""
        out = np.empty(self.shape)
        weighted_sums(np.ascontiguousarray(readings), self.begin, self.end, self._mean_weight, out.reshape(-1))
        return out

    def mean_at(self, x: Array) -> Array:
        """A quantity (n,) of the motion in means over the groups that count, (g,)."""
        total = np.concatenate([np.zeros(1), np.cumsum(x)])
        return np.asarray((total[self.end] - total[self.begin]) / self.count, dtype=np.float64)

    def predict(self, model: Model, values: Array, near: Course | None = None) -> Array:
        """What a model expects, in means, (channels, g)."""
        return self.means(model.predict(self.experiment.signals, values, near))

    def add_change(self, after: Array, before: Array, factor: float, out: Array) -> None:
        """Write a factor times the change of means between two predictions (channels, n) to `out`, (channels · g,)."""
        after, before = np.ascontiguousarray(after), np.ascontiguousarray(before)
        weighted_changes(after, before, self.begin, self.end, self._mean_weight, factor, out)

    def per_block(self, values: Array) -> Array:
        """Sums of (channels, g) over channels and the groups of each block, (blocks,)."""
        return np.asarray(np.bincount(self.block, values.sum(axis=0)), dtype=np.float64)


def whole_blocks(experiment: Experiment) -> NDArray[np.int64]:
    """Number of the block that each sample of a log lies in, (n,)."""
    t = experiment.signals.t
    return np.asarray((t / block_length(float(t[-1]) if len(t) else 0.0)).astype(np.int64))
