"""Effects that leave their mark in the samples themselves: flat tops, a lattice of values, lines in the spectrum.

They are looked for first: a clipped or humming reading would be taken for physics.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.effects import Detection, Effect, Samples
from kinid.effects._derived import sample_period
from kinid.modeling.experiment import Experiment

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mark:
    """What was found.

    Attributes:
        effect: of the catalogue. values: of its parameters. says: in words.
        found: what the effect told of the samples.
    """

    effect: Effect
    values: Array
    says: str
    found: Detection

    def apply(self, predicted: Array, experiment: Experiment) -> Array:
        """Predictions (channels, n) as readings with this mark have them."""
        raw = experiment.as_read(predicted)
        if self.found.removed is not None:
            return experiment.as_true(raw + self.found.removed)
        signals = experiment.signals.copy()
        signals.reading = raw
        self.effect.acquisition(signals, self.values if self.found.held is None else self.found.held)
        return experiment.as_true(signals.reading)


@dataclass(frozen=True, eq=False)
class Cleaned:
    """The experiment without what detectors found, and what that was."""

    experiment: Experiment
    marks: tuple[Mark, ...]


def detect(experiment: Experiment, names: tuple[str, ...], motion: Array | None = None) -> Cleaned:
    """Look for marks of effects that the model lacks, one kind after the other.

    Args:
        experiment: the whole one, at its own rate. names: effects that the model has already.
        motion: readings that the model predicts, (channels, n).
    """
    marks: list[Mark] = []
    expected = None if motion is None else experiment.as_read(motion)
    known = [kind() for kind in effects.catalogue().values() if kind.detector and kind.id not in names]
    for effect in sorted(known, key=lambda effect: effect.detection_order):
        samples = _samples(experiment, expected)
        found = effect.detect(samples)
        if found is None:
            continue
        if not found.usual:
            marks.append(Mark(dataclasses.replace(effect, **found.form), found.values, found.says, found))
        experiment = _without(experiment, samples, found)
    return Cleaned(experiment, tuple(marks))


def marked(predicted: Array, marks: Sequence[Mark], experiment: Experiment) -> Array:
    """Predictions (channels, n) with what was found in the samples."""
    for mark in marks:
        predicted = mark.apply(predicted, experiment)
    return predicted


def _samples(experiment: Experiment, expected: Array | None) -> Samples:
    s, noise = experiment.signals, experiment.noise
    if s.as_read is not None:
        noise = np.sqrt(s.as_read.crosstalk**2 @ noise**2)
    return Samples(experiment.raw, expected, noise, experiment.valid, s.t, sample_period(s), s.layout)


def _without(experiment: Experiment, samples: Samples, found: Detection) -> Experiment:
    """The experiment without what was found; noise of channels changes as that of raw readings does."""
    valid = experiment.valid if found.keep is None else experiment.valid & found.keep
    measured = experiment.measured if found.removed is None else experiment.as_true(samples.raw - found.removed)
    noise = experiment.noise if found.noise is None else experiment.noise * found.noise / samples.noise
    return dataclasses.replace(experiment, measured=measured, valid=valid, noise=noise)
