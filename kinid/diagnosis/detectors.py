"""Effects that leave their mark in the samples themselves: flat tops, a lattice of values, lines of the mains.

They are looked for first: a clipped or humming reading would be taken for physics.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.contact import force_noise
from kinid.diagnosis.noise import as_their_like, period_of
from kinid.diagnosis.problem import RATE
from kinid.diagnosis.rounding import COARSE, STAIRS, blur, shared
from kinid.effects import Effect
from kinid.effects.mains_hum import GRIDS, OFF, MainsHum
from kinid.effects.saturation import FLAT
from kinid.experiment import Experiment

Array = NDArray[np.float64]

#: from this multiple on several samples may share their largest value by chance
SHARED = 0.1
#: a line of the mains counts from this amplitude on, in standard deviations of the white noise
LINE = 0.2
#: and where it holds so many times the power of its neighbours
STANDS_OUT = 25.0
#: so many times as open as at a known frequency are the sine and cosine of a line, counted from the log's first sample, where its
#: frequency is found from it too (D. C. Rife, R. R. Boorstyn, IEEE Trans. Inf. Theory 20, 1974)
UNSURE = 2.0
#: steps of least squares from the best of the frequencies that are tried
SHARPENED = 4
#: share of a log that must be left beside flat tops; else they stay in
ENOUGH_LEFT = 0.15


@dataclass(frozen=True, eq=False)
class Mark:
    """What was found.

    Attributes:
        effect: of the catalogue. values: of its parameters. says: in words.
        evidence: on the scale of all effects (twice a log-likelihood).
        error: standard errors of the values; of what stands in the samples themselves there are none.
    """

    effect: Effect
    values: Array
    says: str
    evidence: float
    error: Array | None = None


@dataclass(frozen=True, eq=False)
class Cleaned:
    """The experiment without what detectors found, and what that was.

    `hum` is the mains' part of the readings, (channels, n); (channels, 1) where there is none.
    """

    experiment: Experiment
    marks: tuple[Mark, ...]
    hum: Array


def detect(experiment: Experiment, names: tuple[str, ...], motion: Array | None = None) -> Cleaned:
    """Look for marks of effects that the model lacks.

    Args:
        experiment: the whole one, at its own rate. names: effects that the model has already.
        motion: readings that the model predicts; lines are looked for in the difference.
    """
    marks: list[Mark] = []
    if "saturation" not in names:
        mark, experiment = _saturation(experiment, motion)
        marks += [] if mark is None else [mark]
    if "quantization" not in names:
        mark, experiment = _quantization(experiment, motion)
        marks += [] if mark is None else [mark]
    hum = np.zeros((len(experiment.measured), 1))
    if "mains-hum" not in names:
        mark, without = _hum(experiment, motion)
        if mark is not None:
            hum = experiment.measured - without.measured
            marks.append(mark)
        experiment = without
    return Cleaned(experiment, tuple(marks), hum)


def _saturation(experiment: Experiment, motion: Array | None) -> tuple[Mark | None, Experiment]:
    effect, raw = effects.get("saturation"), experiment.raw
    found = effect.marks(raw)
    steps = effects.get("quantization").marks(raw)
    assert found is not None
    assert steps is not None
    limits = found[0]
    clipped = np.abs(raw) >= limits[:, None] * (1 - 1e-9)
    # a reading that never changes is not a saturated one; nor is a coarse one that reaches its highest step now and then,
    # unless the model expects more than another step there
    alive = np.array([len(np.unique(channel[:5000])) > 20 for channel in raw])
    coarse = steps[0] > SHARED * _raw_noise(experiment)
    # the end of a range holds a reading for a while; single samples meet at a largest value by chance
    alive &= np.array([_held(flags) >= FLAT for flags in clipped])
    expected = None if motion is None else experiment.as_read(motion)
    if expected is not None:
        beyond = (np.abs(expected) > limits[:, None] + steps[0][:, None]) & clipped
        alive &= ~coarse | (beyond.sum(axis=1) >= 5)
    clipped &= alive[:, None]
    hits: NDArray[np.bool_] = np.any(clipped, axis=1)
    limits = np.where(hits, limits, 1e12)
    if not clipped.any():
        return None, experiment
    channels = ", ".join(f"{c} at {limit:.4g} {u}" for c, u, limit, hit in zip(
        experiment.layout.channels, experiment.layout.units, limits, hits) if hit)  # fmt: skip
    count = int(clipped.any(axis=0).sum())
    # the end of a range touches what is just below it, too: filters and sampling
    reach = 1 if experiment.band is None else round(1.0 / (period_of(experiment.signals) * experiment.band))
    valid = experiment.valid
    for wide in (reach, 1, 0):
        near = np.convolve(clipped.any(axis=0), np.ones(2 * wide + 1), mode="same") > 0
        valid = experiment.valid & ~near
        if valid.sum() > ENOUGH_LEFT * experiment.valid.sum():
            break
    else:
        valid = experiment.valid  # clipped nearly everywhere: what is left would be no log
    mark = Mark(effect, limits, f"flat tops: {channels} in {count} samples", 4.0 * count)
    measured = experiment.measured
    if experiment.band is not None and expected is not None:
        # the filter of the band carries a flat top to its neighbours: what the model expects there is nearer to the truth
        measured = experiment.as_true(np.where(clipped & (np.abs(expected) > limits[:, None]), expected, raw))
    # flat tops have no noise: a channel's own shows beside them
    noise = np.maximum(experiment.noise, [force_noise(channel[valid]) for channel in experiment.measured])
    return mark, dataclasses.replace(experiment, measured=measured, valid=valid, noise=noise)


def _held(flags: NDArray[np.bool_]) -> int:
    """Samples that stand in rows of three or more, of flags (n,)."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    rows = edges[1::2] - edges[::2]
    return int(rows[rows >= 3].sum())


def _raw_noise(experiment: Experiment) -> Array:
    """White noise of each raw channel, (channels,)."""
    if experiment.signals.as_read is None:
        return experiment.noise
    return np.array([force_noise(channel[experiment.valid]) for channel in experiment.raw])


def _quantization(experiment: Experiment, motion: Array | None) -> tuple[Mark | None, Experiment]:
    effect, raw = effects.get("quantization"), experiment.raw
    found = effect.marks(raw)
    assert found is not None
    steps = found[0]
    noise = np.array([force_noise(channel[experiment.valid]) for channel in raw])
    spread = np.maximum(noise, steps / np.sqrt(12.0))
    coarse = (steps > 0) & (steps > COARSE * spread)
    if not coarse.any():
        return None, experiment
    says = ", ".join(f"{c} in steps of {step:.4g} {u}" for c, u, step, hit in zip(
        experiment.layout.channels, experiment.layout.units, steps, coarse) if hit)  # fmt: skip
    ratio = float((steps / spread)[coarse].max())
    # each sample on a lattice of steps h, rather than anywhere within a standard deviation
    evidence = 2.0 * experiment.measured.shape[1] * max(0.1, float(np.log1p(ratio)))
    steps = np.where(coarse, steps, 0.0)
    expected = raw if motion is None else experiment.as_read(motion)
    # beside coarse channels, one that never leaves its value has their steps; else it tells nothing finer than the model
    still = np.ptp(raw[:, experiment.valid], axis=1) == 0.0
    assumed = as_their_like(steps, still, experiment.layout.units)
    white, stairs = _before_rounding(experiment, raw, assumed, expected)
    as_read = experiment.signals.as_read
    alone = still & (assumed == 0.0)
    many = max(1.0, 1.0 / (period_of(experiment.signals) * RATE))
    white[alone] = np.maximum(np.sqrt(many * np.mean(expected[alone] ** 2, axis=1)), experiment.noise[alone])
    coarse |= still
    if as_read is None:
        white = np.where(coarse, white, experiment.noise)
    else:
        white = np.sqrt(as_read.inverse**2 @ np.where(coarse, white, noise) ** 2)
    return Mark(effect, steps, f"a lattice of values: {says}", evidence), dataclasses.replace(
        experiment, noise=white, steps=np.where(stairs, assumed, 0.0) if stairs.any() else None)  # fmt: skip


def _before_rounding(experiment: Experiment, raw: Array, steps: Array, expected: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Noise that counts of channels on a lattice, and which of them are stairs, each (channels,).

    Of stairs it is the noise before the converter, because what rounding leaves open is left open (`rounding`); where noise
    nearly blurs the steps, that and the error of rounding, with the part that neighbours share as large as means leave it.
    """
    period = period_of(experiment.signals)
    noise, stairs = np.zeros(len(raw)), np.zeros(len(raw), np.bool_)
    for i in np.flatnonzero(steps):
        noise[i] = blur(raw[i, experiment.valid], steps[i], expected[i, experiment.valid], period)
        stairs[i] = steps[i] > STAIRS * noise[i]
    many = max(1.0, 1.0 / (period * RATE))
    differences = np.array([force_noise(channel[experiment.valid]) for channel in raw])
    whole = np.maximum(differences**2, noise**2 + steps**2 / 12.0) + (many - 1.0) * shared(steps, noise)
    return np.where(stairs, noise, np.sqrt(whole)), stairs


def _hum(experiment: Experiment, motion: Array | None) -> tuple[Mark | None, Experiment]:
    s = experiment.signals
    rate = 1.0 / period_of(experiment.signals)
    if len(s) < 500:
        return None, experiment
    rest = experiment.measured.copy() if motion is None else experiment.measured - motion
    rest[:, ~experiment.valid] = 0.0
    best: tuple[float, float, tuple[int, ...]] | None = None
    for grid in GRIDS:
        possible = tuple(h for h in (1, 2, 3) if h * (grid + OFF) < 0.48 * rate)
        if not possible:
            continue
        frequency = _sharpest(rest, s.t, grid, experiment.noise)
        found_lines, power = [], 0.0
        for h in possible:
            pair = _pair(rest, s.t, h * frequency)
            beside = np.mean([np.hypot(*_pair(rest, s.t, h * frequency + d)).ravel() ** 2
                              for d in (-2.1, -1.4, -0.9, 0.9, 1.4, 2.1)], axis=0)  # fmt: skip
            size = np.hypot(*pair)
            clear = (size > LINE * experiment.noise) & (size**2 > STANDS_OUT * beside)
            if clear.any():
                found_lines.append(h)
                power += float(((size / experiment.noise) ** 2)[clear].sum())
        # harmonics without the line itself are a machine's vibration
        if 1 in found_lines and (best is None or power > best[0]):
            best = (power, frequency, tuple(found_lines))
    if best is None:
        return None, experiment
    power, frequency, lines = best
    hum = sum((_line(rest, s.t, h * frequency) for h in lines), np.zeros_like(rest))
    sizes = np.hypot(*_pair(rest, s.t, lines[0] * frequency))
    top = int(np.argmax(sizes / experiment.noise))
    says = (f"a line at {frequency:.2f} Hz{' and its harmonics' if len(lines) > 1 else ''}, "
            f"{sizes[top]:.3g} {experiment.layout.units[top]} in {experiment.layout.channels[top]}")  # fmt: skip
    quiet = experiment.measured - hum
    # the white noise that differences of neighbours show held the hum, too
    noise = np.minimum(experiment.noise, [force_noise(channel[experiment.valid]) for channel in quiet])
    # per channel: sine and cosine of each harmonic, one after the other
    pairs = np.concatenate([_coherent(rest[:, experiment.valid], s.t[experiment.valid], h * frequency) for h in lines])
    error = np.broadcast_to(UNSURE * noise * np.sqrt(2.0 / max(1, int(experiment.valid.sum()))), pairs.shape)
    if s.as_read is not None:  # the effect acts on raw readings
        pairs, error = pairs @ s.as_read.crosstalk.T, np.sqrt(error**2 @ s.as_read.crosstalk.T**2)
    mark = Mark(MainsHum(frequency=frequency, harmonics=lines), pairs.T.ravel(), says, 0.5 * power * len(s.t), error.T.ravel())
    return mark, dataclasses.replace(experiment, measured=quiet, noise=np.maximum(noise, 1e-9))


def _pair(readings: Array, t: Array, frequency: float) -> Array:
    """Sine and cosine amplitude at a frequency, root mean square over stretches of four seconds, (2, channels).

    Stretches, because a grid's phase wanders.
    """
    many = max(1, int(t[-1] / 4.0))
    angle = 2.0 * np.pi * frequency * t
    out = np.zeros((2, len(readings)))
    edges = np.linspace(0, len(t), many + 1).astype(int)
    for begin, end in zip(edges[:-1], edges[1:]):
        window = np.hanning(end - begin)
        window *= 2.0 / window.sum()
        waves = np.stack([np.sin(angle[begin:end]), np.cos(angle[begin:end])], axis=1) * window[:, None]
        out += (readings[:, begin:end] @ waves).T ** 2 / many
    return np.sqrt(out)


def _coherent(readings: Array, t: Array, frequency: float) -> Array:
    """Sine and cosine amplitude over the whole log, by least squares beside a constant, (2, channels)."""
    angle = 2.0 * np.pi * frequency * t
    out: Array = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle), np.ones_like(t)], axis=1), readings.T)[0][:2]
    return out


def _line(readings: Array, t: Array, frequency: float) -> Array:
    """The line itself, its phase and size followed over half a second, (channels, n)."""
    from scipy.ndimage import gaussian_filter1d

    turned = np.exp(-2j * np.pi * frequency * t)
    width = 0.5 / float(np.median(np.diff(t)))
    mixed = 2.0 * readings * turned
    slow = gaussian_filter1d(mixed.real, width, axis=1) + 1j * gaussian_filter1d(mixed.imag, width, axis=1)
    out: Array = (slow * np.conj(turned)).real
    return out


def _sharpest(readings: Array, t: Array, grid: float, noise: Array) -> float:
    """Frequency near the grid's at which the line is strongest [Hz]."""
    loudest = readings[int(np.argmax(np.hypot(*_pair(readings, t, grid)) / noise))][None]
    trials = np.arange(-OFF, OFF + 1e-9, max(0.4 / max(float(t[-1]), 1.0), 0.01))
    # mixed down to the grid's frequency, a line is slow: means over 20 ms hold it
    many = max(1, round(0.02 * (len(t) - 1) / max(float(t[-1] - t[0]), 1e-9)))
    begin = np.arange(0, len(t), many)
    slow = np.add.reduceat(loudest[0] * np.exp(-2j * np.pi * grid * t), begin)
    middle = t[np.minimum(begin + many // 2, len(t) - 1)]
    power = [abs(slow @ np.exp(-2j * np.pi * off * middle)) for off in trials]
    near = found = float(grid + trials[int(np.argmax(power))])
    for _ in range(SHARPENED):  # between two trials: least squares
        wave = np.exp(2j * np.pi * found * t)
        sine, cosine = _coherent(loudest, t, found)[:, 0]
        turned = 2.0 * np.pi * (t - t.mean()) * (sine * wave.real - cosine * wave.imag)
        rest = loudest[0] - sine * wave.imag - cosine * wave.real
        found += float(turned @ rest / max(float(turned @ turned), 1e-300))
    return found if abs(found - near) < trials[1] - trials[0] else near
