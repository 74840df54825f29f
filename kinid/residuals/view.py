"""A residual as a reader sees it: wrenches in the contact frame, in means short enough to keep what moves, beside the
motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid.modeling.experiment import Experiment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Scalar = TypeVar("Scalar", bound=np.generic)

#: forces of a wrench in contact axes, in the order of `SensorMotion.to_contact`'s rows
CONTACT_AXES = ("tangential_force1", "tangential_force2", "normal_force")
#: means that a log is looked at in, at most; more only takes longer
MOST_GROUPS = 40_000
#: forces are read in sensor axes where one of them holds at least this share of their error, and this multiple of what
#: the best contact axis holds: then the sensor has a fault, and the contact axes only smear it
ONE_AXIS, CLEARER = 0.5, 1.25
#: no channel's noise counts as smaller than this share of the largest of the same unit
LEAST_NOISE = 0.02
#: squared error above what noise explains, as a share of the latter, from which on there is something to look for; in
#: short logs so many standard deviations of the mean square of noise
BEYOND, BEYOND_SIGMA = 0.05, 4.0


@dataclass(frozen=True, eq=False)
class View:
    """A residual in channels that people read.

    Attributes:
        experiment: what it is of.
        channels, units: of the rows. turned: whether a wrench is read at the contact: forces along tangents and normal,
            torques about the tip, instead of both at the sensor.
        residual: (channels, n), NaN where it doesn't count. sigma: white noise of each channel, (channels,).
        edge, count: first sample and samples of each group of neighbours, (g,).
    """

    experiment: Experiment
    channels: tuple[str, ...]
    units: tuple[str, ...]
    turned: bool
    residual: Array
    sigma: Array
    edge: NDArray[np.int64]
    count: Array

    @classmethod
    def of(cls, experiment: Experiment, residual: Array, sigma: Array, turned: bool | None = None) -> View:
        """The view of a residual.

        Args:
            experiment: what it is of.
            residual: measured less predicted, in the channels' units, (channels, n); NaN where it doesn't count.
            sigma: white noise of each channel, (channels,).
            turned: whether a wrench is read at the contact; None: as it is easier to read.
        """
        layout = experiment.layout
        residual = np.where(experiment.valid & np.isfinite(residual), residual, np.nan)
        edge, count = groups(experiment, MOST_GROUPS)
        channels = layout.channels
        units = np.array(layout.units)
        noise = np.asarray(sigma, dtype=float).copy()
        for unit in set(units.tolist()):
            alike = units == unit
            noise[alike] = np.maximum(noise[alike], max(LEAST_NOISE * noise[alike].max(), 1e-12))
        if turned is None:
            turned = _easier_turned(experiment, residual)
        if turned:
            residual = to_contact(experiment, residual)
            channels = (*CONTACT_AXES, *channels[3:])
            noise = turned_noise(experiment, noise)
            order = [2, 0, 1, *range(3, len(channels))]  # the normal force is read first
            residual, noise, units = residual[order], noise[order], units[order]
            channels = tuple(channels[i] for i in order)
        return cls(experiment, channels, tuple(units.tolist()), turned, residual, noise, edge, count)

    def readings(self, values: Array) -> Array:
        """Readings (channels of the log, n) in this view's channels; where these are the contact's, without the rig's
        tool.
        """
        if not self.turned:
            return values
        sensor = self.experiment.signals.sensor
        assert sensor is not None
        own = to_contact(self.experiment, values - sensor.load)
        return own[[2, 0, 1, *range(3, len(own))]]

    @cached_property
    def scale(self) -> Array:
        """What errors are divided by before channels are pooled: the noise of all channels of the same unit,
        (channels,).
        """
        units = np.array(self.units)
        return np.array([np.sqrt(np.mean(self.sigma[units == unit] ** 2)) for unit in self.units])

    @cached_property
    def samples(self) -> Array:
        """How many samples of each group count, (channels, g)."""
        return np.asarray(np.add.reduceat(np.isfinite(self.residual).astype(float), self.edge, axis=1))

    @cached_property
    def mean(self) -> Array:
        """Mean residual of each group, (channels, g); 0 where nothing counts."""
        total = np.add.reduceat(np.nan_to_num(self.residual), self.edge, axis=1)
        out: Array = total / np.maximum(self.samples, 1.0)
        return out

    @cached_property
    def squares(self) -> Array:
        """Sum of squared residual in each group, in the channels' units, (channels, g)."""
        return np.asarray(np.add.reduceat(np.nan_to_num(self.residual) ** 2, self.edge, axis=1))

    @cached_property
    def excess(self) -> Array:
        """Squared error beyond noise in each group, over `scale`², (channels, g); zero in channels of mere noise."""
        out: Array = (self.squares - self.samples * self.sigma[:, None] ** 2) / self.scale[:, None] ** 2
        out[~self.beyond] = 0.0
        return out

    @cached_property
    def beyond(self) -> Mask:
        """Channels whose residual is more than noise, (channels,)."""
        n = np.maximum(self.samples.sum(axis=1), 1.0)
        ratio = self.squares.sum(axis=1) / (n * self.sigma**2)
        return np.asarray(ratio - 1.0 > np.maximum(BEYOND, BEYOND_SIGMA * np.sqrt(2.0 / n)))

    @cached_property
    def total(self) -> float:
        """All squared error beyond noise, over `scale`²."""
        return float(np.maximum(self.excess.sum(axis=1), 0.0).sum())

    def at(self, values: NDArray[Scalar]) -> NDArray[Scalar]:
        """Values of samples (…, n) at the first sample of each group, (…, g)."""
        return np.asarray(values[..., self.edge])

    @cached_property
    def t(self) -> Array:
        """Time of each group [s], (g,)."""
        return self.at(self.experiment.signals.t)

    @cached_property
    def piece(self) -> NDArray[np.int64]:
        """Number of the gapless piece that each group lies in, (g,)."""
        return np.asarray(np.cumsum(self.experiment.signals.dt == 0.0)[self.edge])

    @cached_property
    def touching(self) -> Mask:
        """Groups in contact, (g,)."""
        return self.at(self.experiment.in_contact | (self.experiment.signals.depth > 0.0))

    @cached_property
    def period(self) -> float:
        """Between two samples [s]."""
        steps = self.experiment.signals.dt[self.experiment.signals.dt > 0]
        return float(np.median(steps)) if len(steps) else 1.0


def groups(experiment: Experiment, most: int) -> tuple[NDArray[np.int64], Array]:
    """First sample and size of each group of neighbours of one piece, so that there are about `most` of them."""
    s = experiment.signals
    n = len(s)
    many = max(1, int(np.ceil(n / most)))
    starts = np.flatnonzero(s.dt == 0.0)
    if not len(starts) or starts[0] != 0:
        starts = np.r_[0, starts]
    within = np.arange(n) - np.repeat(starts, np.diff(np.r_[starts, n]))
    edge = np.flatnonzero(within % many == 0)
    return edge, np.diff(np.r_[edge, n]).astype(float)


def to_contact(experiment: Experiment, wrench: Array) -> Array:
    """A wrench (6, n) with its forces along tangent 1, tangent 2 and normal, and its torques about the tip, in sensor
    axes.

    About the sensor's origin a force at the tip would be read twice, as itself and as its torque.
    """
    sensor = experiment.signals.sensor
    assert sensor is not None
    out = np.array(wrench, dtype=float)
    out[:3] = np.einsum("nij,jn->in", sensor.to_contact, wrench[:3])
    (x, y, z), force = sensor.tip, wrench[:3]
    for row, moment in enumerate(
        (y * force[2] - z * force[1], z * force[0] - x * force[2], x * force[1] - y * force[0])
    ):
        out[3 + row] -= moment
    return out


def turned_noise(experiment: Experiment, noise: Array) -> Array:
    """Noise of what `to_contact` makes, mean over the log, from that of the sensor's channels, (6,)."""
    sensor = experiment.signals.sensor
    assert sensor is not None
    x, y, z = sensor.tip
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) ** 2
    force = noise[:3] ** 2
    share = np.einsum("nij,nij->ij", sensor.to_contact, sensor.to_contact) / len(sensor.to_contact)
    variance = np.r_[share @ force, noise[3:] ** 2 + lever @ force]
    return np.asarray(np.sqrt(variance))


def _easier_turned(experiment: Experiment, residual: Array) -> bool:
    """Whether contact axes say more plainly than the sensor's where the error of the forces is."""
    touching = experiment.in_contact | (experiment.signals.depth > 0)
    if experiment.layout.kind != "wrench" or experiment.signals.sensor is None or not touching.any():
        return False
    own = np.nansum(residual[:3] ** 2, axis=1)
    turned = np.nansum(to_contact(experiment, residual)[:3] ** 2, axis=1)
    total = float(own.sum())
    return not (total > 0 and own.max() >= ONE_AXIS * total and own.max() >= CLEARER * turned.max())
