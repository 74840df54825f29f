"""What a change is made from: measured samples, their smoothed rates, and what the starting model leaves of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt, welch

import kinid
from measured.logs import Source
from measured.solver import Fitting

Array = NDArray[np.float64]

FORCES = ("normal_force", "tangential_force1", "tangential_force2")
#: above this a motion that is differentiated here is noise [Hz], unless its spectrum stands so many times above its
#: floor
BAND, STANDS_OUT = 15.0, 30.0
#: share of the unknowns' own directions that are no more than rounding
RANK = 1e-9
#: a channel holds nothing that is less than this share of the largest of the same unit
LEAST = 1e-3


def readings(log: kinid.Log) -> Array:
    """What sensors gave, (n, k): joint torques, else the wrench, else contact forces."""
    if log.tau is not None:
        return np.array(log.tau)
    if log.wrench is not None:
        return np.array(log.wrench)
    return np.stack([log.contact[name] for name in FORCES if name in log.contact], axis=1)


def with_readings(log: kinid.Log, values: Array) -> kinid.Log:
    """The log with other readings, and the same motion."""
    if log.tau is not None:
        return dataclasses.replace(log, tau=values)
    if log.wrench is not None:
        return dataclasses.replace(log, wrench=values)
    names = [name for name in FORCES if name in log.contact]
    return dataclasses.replace(
        log, contact={**log.contact, **{name: values[:, i].copy() for i, name in enumerate(names)}}
    )


def experiment_of(model: kinid.Model, log: kinid.Log, rig: kinid.Rig) -> Any:
    """Signals, readings and which of them count, as a fit of the project makes them from a log."""
    options: dict[str, Any] = {"held_out": False}
    if log.contact and "tangential_force1" not in log.contact:
        options["channels"] = ("normal_force",)
    if log.wrench is not None and log.tau is None:
        model = kinid.Model("none", "sensor-bias")  # no model of the tool alone says that it is about the whole wrench
    return model.fit(log, rig, **options).experiment


@dataclass(frozen=True, eq=False)
class Scene:
    """A log as it was recorded, and what a starting model makes of it.

    Attributes:
        source: where it comes from. log, rig: as recorded. model: that a user starts from.
    """

    source: Source
    log: kinid.Log
    rig: kinid.Rig
    model: tuple[str, ...]

    @classmethod
    def of(cls, source: Source, real: Path, without: str = "") -> Scene:
        """Of a source, with its model less one effect."""
        return cls(source, *source.read(real), tuple(name for name in source.model if name != without))

    @cached_property
    def experiment(self) -> Any:
        """What the starting model is fitted to."""
        return experiment_of(kinid.Model(*self.model), self.log, self.rig)

    @cached_property
    def fitting(self) -> Fitting:
        """Of the starting model; each channel is weighed by what is left in it."""
        first = Fitting(kinid.Model(*self.model), self.experiment)
        left = np.sqrt(np.nanmean(first.held_out(first.solve(first.start({}), first.valid)) ** 2, axis=1))
        return Fitting(first.model, self.experiment, 1.0 / np.maximum(left, LEAST * left.max()))

    @cached_property
    def values(self) -> Array:
        """Parameters of the starting model, fitted to all samples."""
        return self.fitting.solve(self.fitting.start({}), self.fitting.valid)

    @cached_property
    def left(self) -> Array:
        """Root mean square of the held-out error of the starting model, by channel, (k,)."""
        return np.asarray(np.sqrt(np.nanmean(self.fitting.held_out(self.values) ** 2, axis=1)))

    @cached_property
    def residual(self) -> Array:
        """What the starting model leaves on the samples that count, (k, m)."""
        return (self.fitting.measured - self.fitting.predict(self.values))[:, self.fitting.valid]

    def counted(self, change: Array) -> Array:
        """A change of all readings (n, k), on the samples and in the band that count, (k, m)."""
        rows = change[self.experiment.rows].T
        return self.fitting.in_band(np.ascontiguousarray(rows))[:, self.fitting.valid]

    @cached_property
    def _directions(self) -> Array:
        """Orthonormal directions that the starting model can take up, of weighed samples (k m, r)."""
        slopes = self.fitting.slopes(self.values, self.fitting.predict(self.values))[:, self.fitting.valid]
        return spanned(slopes.reshape(slopes.shape[0] * slopes.shape[1], slopes.shape[2]))

    def beyond(self, change: Array, also: Array | None = None) -> Array:
        """What the starting model's linear refit leaves of a change (k, m), in units of what is left by channel.

        Args:
            change: of the samples that count. also: further changes that may take it up, (p, k, m).
        """
        y = (change * self.fitting.weight[:, None]).ravel()
        y = y - self._directions @ (self._directions.T @ y)
        if also is not None and len(also):
            more = (also * self.fitting.weight[None, :, None]).reshape(len(also), -1).T
            more = spanned(more - self._directions @ (self._directions.T @ more))
            y = y - more @ (more.T @ y)
        return np.asarray(y.reshape(change.shape))

    # ------------------------------------------------------------------------------------------------------ what moved

    @cached_property
    def readings(self) -> Array:
        """As recorded, (n, k)."""
        return readings(self.log)

    @cached_property
    def band(self) -> float:
        """Frequency up to which what moves stands out of its noise in the spectrum [Hz]."""
        moved = self.depth[:, None] if self.log.q is None else np.asarray(self.log.q)
        rate = 1.0 / float(np.median(np.diff(self.log.t)))
        if len(moved) < 1024 or 0.2 * rate < BAND:
            return BAND
        f, power = welch(np.diff(moved, axis=0), rate, nperseg=512, axis=0)
        power = power / np.maximum(f, f[1])[:, None] ** 2  # of positions
        floor = np.median(power[f > 0.35 * rate], axis=0)
        out = [
            float(f[np.flatnonzero((row < STANDS_OUT * least) & (f > 1.0))[0]]) if least > 0 else BAND
            for row, least in zip(power.T, floor)
        ]
        return float(np.clip(np.median(out), BAND, 0.2 * rate))

    def smooth(self, values: Array, band: float | None = None) -> Array:
        """Without what is faster than the band, zero phase; all of it where samples are rarer than that."""
        band = self.band if band is None else band
        rate = 1.0 / float(np.median(np.diff(self.log.t)))
        if 4.0 * band > rate or len(values) < 50:
            return values
        return np.asarray(sosfiltfilt(butter(2, 2 * band / rate, output="sos"), values, axis=0))

    def rate(self, values: Array, band: float | None = None) -> Array:
        """Derivative of what is slower than the band."""
        return np.asarray(np.gradient(self.smooth(values, band), self.log.t, axis=0))

    @cached_property
    def dq(self) -> Array:
        """Joint velocities (n, N): what rubs doesn't see the noise of the log. Where accelerations were logged, both
        were made from positions by filters that are off where a log begins and ends."""
        made = self.log.dq is None or self.log.ddq is not None
        return self.rate(np.asarray(self.log.q)) if made else self.smooth(np.asarray(self.log.dq))

    @cached_property
    def ddq(self) -> Array:
        """Joint accelerations (n, N)."""
        return self.rate(self.dq)

    @cached_property
    def turn(self) -> Array:
        """Direction of each joint, −1 to 1, (n, N): dry friction turns within a hundredth of the greatest speed."""
        slow = 0.01 * np.abs(self.dq).max(axis=0)
        return np.asarray(self.dq / np.sqrt(self.dq**2 + slow**2))

    @cached_property
    def robot(self) -> kinid.Robot:
        """The rig's, for its kinematics."""
        return kinid.Robot.load(self.rig)

    @property
    def depth(self) -> Array:
        """Of a tester [m], (n,)."""
        return np.asarray(self.log.contact["depth"])

    @cached_property
    def inside(self) -> Array:
        """Depth inside the material, as the fitted model has its surface [m], (n,)."""
        offset = dict(zip(self.fitting.named, self.values)).get("surface-offset.offset", 0.0)
        return np.asarray(np.maximum(self.smooth(self.depth) + offset, 0.0))


def spanned(columns: Array) -> Array:
    """Orthonormal basis of what columns span."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if not columns.shape[1]:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > RANK * s[0]])
