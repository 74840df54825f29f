"""What a model is fitted to: the signals that drive it and the readings it is held against, from a log and its rig."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.effects import Layout, Signals
from kinid.kernels.zero_phase import zero_phase

Array = NDArray[np.float64]

#: a material has let go where its force is below so many times the noise
LET_GO = 3.0


@dataclass(frozen=True, eq=False)
class Experiment:
    """Signals and readings on the same samples.

    Attributes:
        signals: what drives a prediction.
        measured: readings, (channels, n).
        valid: samples whose reading counts, (n,).
        noise: standard deviation of each channel's white noise, (channels,).
        slow: standard deviation of errors of each channel that last, and don't average out over neighbours,
            (channels,); or None.
        phase: names, or None. in_contact: the flag, (n,).
        rows: of the log or the contact series that the samples are: those whose motion is known, (n,).
        touch: the contact quantities that it was made of, or None.
        band: readings and predictions are compared below this frequency [Hz]: velocities and accelerations that a
            differentiator made, where one was asked for, hold nothing above it. None: at all frequencies.
        drawn: makes the signals of these rows anew, driven by samples of the motion; None where the motion's error
            isn't known.
        warnings: where what was logged contradicts itself, a sentence each.
        unstated: a bias of the sensor that free motion shows and the rig doesn't state, in a sentence; or "".
    """

    signals: Signals
    measured: Array
    valid: NDArray[np.bool_]
    noise: Array
    phase: NDArray[np.str_] | None
    in_contact: NDArray[np.bool_]
    rows: NDArray[np.int64]
    band: float | None = None
    touch: ContactSeries | None = field(default=None, repr=False)
    drawn: Callable[[Signals, NDArray[np.int64]], Iterator[Signals]] | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    unstated: str = ""
    slow: Array | None = None

    @cached_property
    def motion_draws(self) -> tuple[Signals, ...]:
        """The signals driven by samples of the motion as it may have been, given its noise; or none."""
        return tuple(self.each_draw())

    def each_draw(self) -> Iterator[Signals]:
        """`motion_draws` one after the other, without keeping them."""
        if self.drawn is not None:
            yield from self.drawn(self.signals, self.rows)

    @property
    def raw(self) -> Array:
        """Readings as the sensor's converter gave them, (channels, n)."""
        return self.as_read(self.measured)

    def as_read(self, readings: Array) -> Array:
        """Readings (channels, n) with what the rig states of the sensor's faults, as its converter would give them."""
        return readings if self.signals.as_read is None else self.signals.as_read.raw(readings)

    def as_true(self, raw: Array) -> Array:
        """Raw readings (channels, n) without what the rig states of the sensor's faults."""
        return raw if self.signals.as_read is None else self.signals.as_read.true(raw)

    @cached_property
    def normal_force(self) -> Array | None:
        """As measured, bias of free motion removed (n,); None where nobody measured it."""
        s = self.signals
        if s.layout.kind == "contact":
            channels = s.layout.channels
            return self.measured[channels.index("normal_force")] if "normal_force" in channels else None
        if s.sensor is None or s.measured is None:
            return None
        force: Array = np.einsum("ni,in->n", s.sensor.to_contact[:, 2], s.measured[:3] - s.sensor.load[:3])
        return force

    @cached_property
    def retracting(self) -> NDArray[np.bool_]:
        """Samples in which a tool retracts inside a material, (n,)."""
        return np.asarray((self.signals.depth > 0) & (self.signals.depth_rate < 0))

    @cached_property
    def unloaded(self) -> NDArray[np.bool_]:
        """Samples in which no more force is read than outside the material, (n,)."""
        force = self.normal_force
        if force is None:
            return np.zeros(len(self.signals), np.bool_)
        quiet, outside = float(np.hypot.reduce(self.noise[:3])), self.valid & (self.signals.depth < 0)
        bias = float(np.median(force[outside])) if outside.any() else 0.0
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs(force - bias) < LET_GO * quiet)

    @property
    def separated(self) -> NDArray[np.bool_]:
        """Samples in which a tool retracts inside a material, and no more force is left than outside, (n,)."""
        return self.retracting & self.unloaded

    def in_band(self, readings: Array) -> Array:
        """Readings (channels, n) without what lies above the band; zero-phase, piece by piece (Gustafsson 1996)."""
        if self.band is None:
            return readings
        out = readings.copy()
        sections, settled, pieces = self._low_pass
        for piece in pieces:
            zero_phase(sections, settled, out[:, piece])
        return out

    @cached_property
    def _low_pass(self) -> tuple[Array, Array, list[slice]]:
        """Sections of the band's filter, (2, 6), their state after a step, (2, 2), and pieces of the log to filter."""
        from scipy.signal import butter, sosfilt_zi

        assert self.band is not None
        dt = self.signals.dt
        pieces = [piece for piece in self.signals.runs if piece.stop - piece.start > 100]
        sections = butter(4, self.band * 2 * float(np.median(dt[dt > 0])), output="sos")
        return sections, sosfilt_zi(sections), pieces

    def thinned(self, step: int) -> Experiment:
        """Every so manieth sample, with the steps of time between them; memory begins anew where it did in between."""
        if step == 1:
            return self
        s = self.signals
        at = np.arange(0, len(s), step)
        restarts = np.cumsum(s.dt == 0.0)
        dt = np.diff(s.t[at], prepend=s.t[0])
        dt[np.diff(restarts[at], prepend=-1) > 0] = 0.0

        def rows(thing: object, whole: tuple[str, ...] = (), first: tuple[str, ...] = ()) -> dict[str, Array]:
            return {
                field.name: np.ascontiguousarray(value[::step] if field.name in first else value[..., ::step])
                for field in dataclasses.fields(thing)  # type: ignore[arg-type]
                if isinstance(value := getattr(thing, field.name), np.ndarray)
                and value.size
                and field.name not in whole
            }

        parts: dict[str, object] = {**rows(s), "dt": dt}
        if s.sensor is not None:
            parts["sensor"] = dataclasses.replace(s.sensor, **rows(s.sensor, ("tip", "com"), ("to_contact",)))  # type: ignore[arg-type]
        if s.joints is not None:
            parts["joints"] = dataclasses.replace(s.joints, **rows(s.joints))  # type: ignore[arg-type]
        return dataclasses.replace(
            self,
            signals=dataclasses.replace(s, **parts),  # type: ignore[arg-type]
            measured=self.measured[:, ::step],
            valid=self.valid[::step],
            phase=None if self.phase is None else self.phase[::step],
            in_contact=self.in_contact[::step],
            rows=self.rows[::step],
            band=None,
            touch=None,
        )

    @property
    def layout(self) -> Layout:
        """Its channels."""
        return self.signals.layout
