"""Readings on a lattice."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._samples import Detection, Samples, lattice
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: a step of at least so many standard deviations of the noise is coarse
COARSE = 1.2
#: steps in what a channel reads: converters of sensors have twelve bits and more
LEVELS = 4096
#: steps come from differences of readings: by this share they are known
ROUNDING = 1e-6


@final
class Quantization(Effect):
    """y = h round(f/h) for each channel: whole numbers of a step h; none leaves a channel as it is."""

    id = "quantization"
    title = "steps of the converter"
    equation = "y = h round(f / h)"
    source = "W. R. Bennett, Bell System Technical Journal 27(3), 1948"
    signature = "a lattice of values, and steps where the reading changes slowly"
    excited_by = "noise below half a step, or slow changes"
    needs = ()
    detector = True
    detection_order = 1
    null = {"step": 0.0}
    unremarkable = {"step[N]": 0.02, "step[N·m]": 5e-4}  # resolution of wrist sensors (ATI Mini40)
    affine = False
    order = 4
    admissible = {"step": (0.0, 1e3)}  # a lattice has a width
    example = Example(("hooke",), {"step": (0.2, 0.3, 0.5, 0.02, 0.03, 0.01)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One step a channel."""
        sizes = {"N": 0.01, "N·m": 2.5e-4}
        return tuple(
            Parameter(f"step[{name}]", "h", unit, sizes[unit], 0.0, 1e3, scale=sizes[unit])
            for name, unit in zip(layout.channels, layout.units)
        )

    def detected(self, measured: Array) -> tuple[Array, Array]:
        """The step between neighbouring values of each channel, where all values lie on its lattice; else none.

        The search for other parameters goes without steps: rounding moves a reading up as often as down, and a
        staircase has no slope to follow.
        """
        steps = np.array([lattice(channel) for channel in measured])
        return steps, np.zeros_like(steps)

    def detect(self, samples: Samples) -> Detection | None:
        """A lattice that is coarse beside the noise: readings are off by up to half a step.

        In slow logs of fast loads, neighbours differ by the load as well: what the model leaves tells the noise there.
        """
        steps, held = self.detected(samples.raw[:, samples.valid])
        rounding, white = steps / np.sqrt(12.0), samples.white(samples.raw)
        if samples.expected is not None:
            white = np.minimum(white, samples.white(samples.raw - samples.expected))
        coarse = (steps > 0) & (steps > COARSE * np.maximum(white, rounding))
        if not coarse.any():
            return None
        usual = np.array([self.usual(parameter) for parameter in self.parameters(samples.layout)])
        usual = np.maximum(usual, np.ptp(samples.raw[:, samples.valid], axis=1) / LEVELS)
        says = f"a lattice of values: {samples.named(steps, coarse, 'in steps of')}"
        return Detection(
            np.where(coarse, steps, 0.0),
            says,
            held,
            noise=np.maximum(samples.noise, rounding),
            usual=bool((steps <= usual * (1.0 + ROUNDING))[coarse].all()),
        )

    def acquisition(self, s: Signals, p: Array) -> None:
        """Round the readings."""
        step = np.where(p > 0.0, p, 1.0)[:, None]
        s.reading = np.where(p[:, None] > 0.0, step * np.round(s.reading / step), s.reading)
