"""What diagnosis holds models against: readings in means, weighted by noise and tolerance, dealt into blocks and halves."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.course import Course
from kinid.diagnosis import rounding
from kinid.diagnosis.calibration import Calibration
from kinid.diagnosis.noise import period_of, spread
from kinid.diagnosis.together import ALL
from kinid.effects import Signals
from kinid.experiment import Experiment
from kinid.kernels.averages import weighted_changes, weighted_sums
from kinid.model import Model
from kinid.task import folds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: means a second that diagnosis compares, unless readings are compared at higher frequencies; of logs with more of them than
#: so many, all channels together, half of them
RATE, PLENTY = 125.0, 30_000
#: motion is followed at so many samples at most; of contact, at no more than so many readings where they are as dense as that,
#: in samples a second. Torques change sign within milliseconds: what means take off them would pass for a lag
MOST_SAMPLES, AMPLE, FINE = 40_000, 60_000, 160.0
#: means that are compared, of all channels together, at most: of long logs fewer tell as much
MOST_MEANS = 100_000
#: degrees of freedom of Student's t, whose logarithm bounds what a single sample can say
FREEDOM = 5.0
#: two blocks are half a second apart: longer than the noise remembers
BLOCK = 0.5


def thin(experiment: Experiment) -> Experiment:
    """The experiment with motion and readings in means of neighbouring samples, where it has more than diagnosis needs."""
    samples, rate = len(experiment.signals), 1.0 / period_of(experiment.signals)
    many = math.ceil(samples / MOST_SAMPLES)
    if experiment.band is None:
        many = max(many, min(math.ceil(experiment.measured.size / AMPLE), round(rate / FINE)))
    if many <= 1:
        return experiment
    s = experiment.signals
    edge, count = _groups(experiment, many)

    def mean(x: Array) -> Array:
        """Along the last axis."""
        return np.ascontiguousarray(np.add.reduceat(x, edge, axis=-1) / count)

    run = np.cumsum(s.dt == 0.0)[edge]
    t = mean(s.t)
    dt = np.where(np.r_[True, np.diff(run) != 0], 0.0, np.diff(t, prepend=t[0]))
    sensor, joints = s.sensor, s.joints
    if sensor is not None:
        turned = np.moveaxis(mean(np.moveaxis(sensor.to_contact, 0, -1)), -1, 0)
        sensor = dataclasses.replace(
            sensor, to_contact=np.ascontiguousarray(turned), specific=mean(sensor.specific), omega=mean(sensor.omega),
            alpha=mean(sensor.alpha), load=mean(sensor.load),
        )  # fmt: skip
    if joints is not None:
        arrays: dict[str, Any] = {field.name: mean(getattr(joints, field.name)) for field in dataclasses.fields(joints)
                                  if isinstance(getattr(joints, field.name), np.ndarray)}  # fmt: skip
        joints = dataclasses.replace(joints, **arrays)
    signals = dataclasses.replace(
        s, t=t, dt=dt, depth=mean(s.depth), depth_rate=mean(s.depth_rate), slip=mean(s.slip), slip_rate=mean(s.slip_rate),
        measured=None if s.measured is None else mean(s.measured), sensor=sensor, joints=joints,
    )  # fmt: skip
    return dataclasses.replace(
        experiment, signals=signals, measured=mean(experiment.measured), valid=experiment.valid[edge],
        noise=experiment.noise / np.sqrt(many), phase=None if experiment.phase is None else experiment.phase[edge],
        in_contact=experiment.in_contact[edge], rows=experiment.rows[edge],
    )  # fmt: skip


def _groups(experiment: Experiment, many: int) -> tuple[NDArray[np.int64], Array]:
    """First sample of each group of at most `many` neighbours of one run and one validity, and how many are in it."""
    s = experiment.signals
    starts = np.flatnonzero(s.dt == 0.0)
    within = np.arange(len(s)) - starts[np.cumsum(s.dt == 0.0) - 1]
    begins = (within % many == 0) | np.r_[True, np.diff(experiment.valid.astype(np.int8)) != 0]
    edge = np.flatnonzero(begins)
    return edge, np.diff(np.r_[edge, len(s)]).astype(float)


@dataclass(frozen=True, eq=False)
class Problem:
    """What diagnosis holds a model against: readings in means over a few milliseconds, because what is faster is noise.

    Predictions are made at the experiment's own rate and then averaged, so that nothing is lost of fast reversals.

    Attributes:
        experiment: at most `MOST_SAMPLES` long.
        edge, count: first sample and size of each group that is averaged, (g,).
        sigma: standard deviation of a mean reading's noise, position noise carried through the model included, (channels, g).
        even: which half of the log each group lies in, (g,). block: number of its block, (g,).
        valid: whether it counts, (g,).
    """

    experiment: Experiment
    edge: NDArray[np.int64]
    count: Array
    sigma: Array
    even: Mask
    block: NDArray[np.int64]
    valid: Mask

    @classmethod
    def build(cls, experiment: Experiment, model: Model, values: Array) -> Problem:
        """Groups, and weights from a first fit of the model."""
        s = experiment.signals
        period = period_of(s)
        span = float(s.t[-1]) if len(s) else 0.0
        rate = RATE if len(experiment.measured) * span * RATE < PLENTY else 0.5 * RATE
        rate = max(rate, 4.0 * (experiment.band or 0.0))
        many = max(1, int(1.0 / (rate * period)), math.ceil(experiment.measured.size / MOST_MEANS))
        edge, count = _groups(experiment, many)
        length = BLOCK if span >= 16 * BLOCK else max(span / 16, 1e-9)
        return cls(experiment, edge, count, spread(experiment, model, values, edge, count), folds(experiment)[edge],
                   (s.t / length).astype(np.int64)[edge], experiment.valid[edge])  # fmt: skip

    @cached_property
    def measured(self) -> Array:
        """Readings in the band that counts, (channels, n)."""
        return filled(self.experiment)

    @cached_property
    def target(self) -> Array:
        """The same as they are compared, (m,)."""
        return self.stack(self.measured)

    def predict(self, model: Model, values: Array, signals: Signals | None = None, near: Course | None = None) -> Array:
        """What a model expects there, at all frequencies, (channels, n)."""
        return model.predict(signals or self.experiment.signals, values, near)

    def expected(self, predicted: Array) -> Array:
        """Predictions (channels, n) as they stand beside readings: in the band, as near to them as rounding allows, stacked."""
        steps = self.experiment.steps
        if steps is not None:
            raw = self.experiment.as_read(predicted)
            predicted = self.experiment.as_true(rounding.nearest(self._raw, raw, steps))
        return self.stack(self.experiment.in_band(predicted))

    def change(self, moved: Array, beside: Array) -> Array:
        """How `expected` changes, to first order, as predictions move by so much, (channels, n), from those beside; (m,)."""
        steps, of_one = self.experiment.steps, self.experiment.signals.as_read is None
        rows = np.flatnonzero(moved.any(axis=1)) if of_one else np.arange(len(moved))  # most joint parameters move one channel
        moved = moved[rows]
        if steps is not None:
            zero = self.experiment.as_read(np.zeros_like(moved))
            raw = (self.experiment.as_read(moved) - zero) * rounding.contradicted(
                self._raw[rows], self.experiment.as_read(beside[rows]), steps[rows])  # fmt: skip
            moved = self.experiment.as_true(raw + zero)
        out = np.zeros((len(self.sigma), int(self.valid.sum())))
        out[rows] = self.stack(self.experiment.in_band(moved), rows).reshape(-1, out.shape[1])
        return out.reshape(-1)

    def changed_apart(self, after: Array, before: Array, beside: Array, group: Mapping[int, int], factors: Array, out: Array
                      ) -> None:  # fmt: skip
        """`changed` for parameters that were moved together: what each did is the change of its own channel.

        Args:
            group: of each, channel → column of `out`. factors: of columns. out: (m, columns), zero.
        """
        if ALL in group:
            j = group[ALL]
            self.changed(after, before, beside, float(factors[j]), out[:, j])
            return
        change = self.change(after - before, beside)
        many = len(change) // len(after)
        for channel, j in group.items():
            own = slice(channel * many, (channel + 1) * many)
            out[own, j] = factors[j] * change[own]

    def changed(self, after: Array, before: Array, beside: Array, factor: float, out: Array) -> None:
        """A factor times `change` by what lies between two predictions, into `out`, (m,)."""
        if self.experiment.steps is None and self.experiment.band is None:
            begin, end, weight = self._kept
            weighted_changes(after, before, begin, end, weight, factor, out)
        else:
            np.multiply(self.change(after - before, beside), factor, out=out)

    @cached_property
    def of_biases(self) -> Array:
        """How `expected` changes per tolerance of each channel's bias, (m, channels); the same everywhere, stairs apart."""
        none = np.zeros_like(self.measured)
        return np.stack([self.change(self.calibration.constant(i, none), none) for i in range(len(none))], axis=1)

    @cached_property
    def _raw(self) -> Array:
        """Raw readings, (channels, n); what is no number contradicts nothing."""
        raw = self.experiment.raw
        return np.where(np.isfinite(raw), raw, 0.0)

    @cached_property
    def stairs(self) -> Array:
        """Steps of a coarse converter in readings without what the rig states of the sensor's faults, (channels,)."""
        steps, as_read = self.experiment.steps, self.experiment.signals.as_read
        if steps is None:
            return np.zeros(len(self.sigma))
        out: Array = steps if as_read is None else np.sqrt(as_read.inverse**2 @ steps**2)
        return out

    @cached_property
    def quiet(self) -> float:
        """Weighted error that noise alone leaves of a right model: 1, and less where rounding leaves much open."""
        if self.experiment.steps is None:
            return 1.0
        wide, band, many = self.stairs[:, None], self.experiment.band, self.count[self.valid]
        if band is not None:
            many = np.full(len(many), max(1.0, 0.5 / (band * period_of(self.experiment.signals))))
        single = self.sigma[:, self.valid] * np.sqrt(many)
        with np.errstate(divide="ignore"):
            left = rounding.usual(np.where(wide > 0, single / wide, np.inf), np.broadcast_to(many, single.shape))
        return float(np.sqrt(np.mean(np.where(wide > 0, left, 1.0))))

    def stack(self, readings: Array, rows: NDArray[np.int64] | slice = slice(None)) -> Array:
        """Averaged, weighted, channel after channel, valid groups only, (m,); of these channels, all if not told."""
        begin, end, weight = self._kept
        weight = weight[rows]
        out = np.empty(weight.size)
        weighted_sums(np.ascontiguousarray(readings), begin, end, weight, out)
        return out

    @cached_property
    def _kept(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """First sample of each valid group and the one after its last, (g,), and the weight of their sum, (channels, g)."""
        begin, count = self.edge[self.valid].astype(np.int64), self.count[self.valid]
        return begin, begin + count.astype(np.int64), np.ascontiguousarray(1.0 / (count * self.sigma[:, self.valid]))

    def only(self, part: Mask) -> Problem:
        """The same, with groups outside of a part (g,) left out."""
        return dataclasses.replace(self, valid=self.valid & part)

    @cached_property
    def calibration(self) -> Calibration:
        """What calibration leaves open."""
        return Calibration(self.experiment.signals)

    @cached_property
    def of_stairs(self) -> Problem:
        """The same with readings of a coarse converter taken at their word."""
        return dataclasses.replace(self, experiment=dataclasses.replace(self.experiment, steps=None))

    @cached_property
    def half(self) -> Mask:
        """`even` for stacked readings, (m,)."""
        return np.tile(self.even[self.valid], len(self.sigma))

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """`block` for stacked readings, numbered without holes, (m,)."""
        number: NDArray[np.int64] = np.unique(self.block[self.valid], return_inverse=True)[1]
        return np.tile(number, len(self.sigma))

    def loss(self, stacked: Array) -> Array:
        """Minus log-likelihood of weighted residuals under Student's t, per block, (blocks,)."""
        each = 0.5 * (FREEDOM + 1.0) * np.log1p(stacked**2 / FREEDOM)
        out: Array = np.bincount(self.blocks, each).astype(float)
        return out


def filled(experiment: Experiment) -> Array:
    """Readings in the band that counts, (channels, n); what is no number is bridged by a straight line, or it would ring."""
    out = experiment.measured.copy()
    for row in out:
        gone = ~np.isfinite(row)
        if gone.any() and not gone.all():
            row[gone] = np.interp(np.flatnonzero(gone), np.flatnonzero(~gone), row[~gone])
    return experiment.in_band(np.nan_to_num(out))
