"""The power grid in the cables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._samples import QUIETEST, Detection, Samples
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: frequencies of power grids [Hz], how far they may be off, and the least step in which a line is looked for at first
GRIDS, OFF, COARSE = (50.0, 60.0), 0.3, 0.01
#: logs of fewer samples, and of a lower rate [Hz], show no line
FEWEST, SLOWEST = 500, 125.0
#: share of the rate up to which a line is looked for
NYQUIST = 0.48
#: a line counts from this amplitude on, in standard deviations of the white noise, …
LINE = 0.2
#: … and where it holds so many times the power of its neighbours, so far away [Hz]
STANDS_OUT, BESIDE = 25.0, (-2.1, -1.4, -0.9, 0.9, 1.4, 2.1)
#: steps of least squares from the best of the frequencies that are tried
SHARPENED = 4
#: stretches over which a grid's phase is one [s], and time over which a line is followed [s]
STEADY, FOLLOWED = 4.0, 0.5
#: step of time at which a line that was made slow is taken [s]: the motion does not alias to it
STEP = 5e-3
#: so many of these steps are one where a line is looked for at first
COARSER = 4
#: where fewer of the samples count, a line is taken to be weaker instead of being guessed
SEEN = 0.1

Complex = NDArray[np.complex128]


@final
@dataclass(frozen=True)
class MainsHum(Effect):
    """y = f + Σ_h a_h sin 2πh f₀t + b_h cos 2πh f₀t for each channel.

    Attributes:
        frequency: f₀ [Hz]; None is where the log's own readings have the sharpest line near 50 or 60 Hz (a grid drifts
            by part of a turn in half a minute), and 50 where there are none.
        harmonics: which h.
    """

    frequency: float | None = None
    harmonics: tuple[int, ...] = (1, 2, 3)

    id = "mains-hum"
    title = "hum of the mains"
    equation = "y = f + Σ_h a_h sin 2πh f₀t + b_h cos 2πh f₀t"
    source = "IEC 60038 (grid frequencies)"
    signature = "lines in the spectrum at the grid's frequency and its harmonics, in every phase"
    excited_by = "any log sampled faster than twice the grid's frequency"
    needs = ()
    detector = True
    detection_order = 2
    null = {"sine": 0.0, "cosine": 0.0}
    order = 2
    example = Example(
        ("hooke",),
        {
            name: tuple(size * share for share in (1.0, -0.7, 1.4, 0.05, 0.03, -0.04) for _ in range(3))
            for name, size in (("sine", 0.1), ("cosine", -0.04))
        },
        Motion.WRENCH,
    )

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Sine and cosine amplitude of each harmonic, channel by channel."""
        return tuple(
            Parameter(f"{wave}[{name},{h}]", symbol, unit, 0.0, scale=0.05 if unit == "N" else 0.002, linear=True)
            for name, unit in zip(layout.channels, layout.units)
            for h in self.harmonics
            for wave, symbol in (("sine", "a"), ("cosine", "b"))
        )

    def detect(self, samples: Samples) -> Detection | None:
        """The grid whose lines hold the most power in what the model leaves; phase and size are followed."""
        if samples.raw.shape[1] < FEWEST:
            return None
        rest = samples.raw.copy() if samples.expected is None else samples.raw - samples.expected
        rest[:, ~samples.valid] = 0.0
        grids = [_lines(rest, samples, grid) for grid in GRIDS]
        # harmonics without the line itself are a machine's vibration
        power, frequency, lines = max((grid for grid in grids if 1 in grid[2]), default=(0.0, 0.0, ()))
        if not lines:
            return None
        hum = sum((_followed(rest, samples, h * frequency) for h in lines), np.zeros_like(rest))
        (sizes,) = _amplitudes(*_mixed_down(rest, samples.t, lines[0] * frequency), len(samples.t))
        top = int(np.argmax(sizes / samples.noise))
        says = (
            f"a line at {frequency:.2f} Hz{' and its harmonics' if len(lines) > 1 else ''}, "
            f"{sizes[top]:.3g} {samples.layout.units[top]} in {samples.layout.channels[top]}"
        )
        # the white noise that differences of neighbours show held the hum, too
        noise = np.maximum(np.minimum(samples.noise, samples.white(samples.raw - hum)), QUIETEST)
        count = samples.valid
        pairs = np.concatenate([_coherent(rest[:, count], samples.t[count], h * frequency) for h in lines])
        return Detection(
            pairs.T.ravel(), says, form={"frequency": frequency, "harmonics": lines}, removed=hum, noise=noise
        )

    def unseen(self, rate: float) -> str:
        """A slow log takes a line for something else."""
        return f"at {rate:.3g} Hz a line at 50 or 60 Hz can't be seen" if rate < SLOWEST else ""

    def acquisition(self, s: Signals, p: Array) -> None:
        """Add the hum."""
        frequency = self.frequency or _line_of(s)
        angles = [2.0 * np.pi * h * frequency * s.t for h in self.harmonics]
        waves = np.stack([wave(angle) for angle in angles for wave in (np.sin, np.cos)])
        s.reading = s.reading + p.reshape(len(s.layout.channels), -1) @ waves


def _lines(rest: Array, samples: Samples, grid: float) -> tuple[float, float, tuple[int, ...]]:
    """Power of a grid's lines that stand out in a residual (channels, n), their frequency [Hz], and which they are."""
    possible = [h for h in (1, 2, 3) if h * (grid + OFF) < NYQUIST / samples.period]
    if not possible:
        return 0.0, grid, ()
    frequency, noise = _refined(rest, samples, grid), samples.noise
    found, power = [], 0.0
    for h in possible:
        size, *beside = _amplitudes(*_mixed_down(rest, samples.t, h * frequency), len(samples.t), (0.0, *BESIDE))
        clear = (size > LINE * noise) & (size**2 > STANDS_OUT * np.mean(np.square(beside), axis=0))
        if clear.any():
            found.append(h)
            power += float(((size / noise) ** 2)[clear].sum())
    return power, frequency, tuple(found)


def _mixed_down(readings: Array, t: Array, frequency: float) -> tuple[Complex, Array]:
    """A line (channels, n) made slow: its means over steps of time, (channels, m), and their times, (m,)."""
    many = max(1, round(STEP * (len(t) - 1) / max(float(t[-1] - t[0]), 1e-9)))
    begin = np.arange(0, len(t), many)
    count = np.diff(begin, append=len(t))
    turned = readings * np.exp(-2j * np.pi * frequency * t)
    mean = np.asarray(np.add.reduceat(turned, begin, axis=1) / count, np.complex128)
    return mean, np.add.reduceat(t, begin) / count


def _amplitudes(mixed: Complex, t: Array, samples: int, offsets: Sequence[float] = (0.0,)) -> list[Array]:
    """Amplitudes (channels,) of a line made slow (channels, m), and so far beside it [Hz]: roots of mean squares over
    stretches in which a grid's phase is one.
    """
    many = max(1, min(int(t[-1] / STEADY), samples // FEWEST))
    edges = np.linspace(0, len(t), many + 1).astype(int)
    windows = [np.hanning(n) for n in np.diff(edges)]
    seen = mixed * np.concatenate([2.0 * window / window.sum() for window in windows])
    turned = (seen * np.exp(-2j * np.pi * offset * t) for offset in offsets)
    return [np.sqrt(np.mean(abs(np.add.reduceat(one, edges[:-1], axis=1)) ** 2, axis=1)) for one in turned]


def _coherent(readings: Array, t: Array, frequency: float) -> Array:
    """Sine and cosine amplitude over the whole log, by least squares beside a constant, (2, channels)."""
    angle = 2.0 * np.pi * frequency * t
    out: Array = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle), np.ones_like(t)], axis=1), readings.T)[0][:2]
    return out


def _followed(readings: Array, samples: Samples, frequency: float) -> Array:
    """A line in a residual that is 0 where samples don't count, its phase and size followed, (channels, n)."""
    from scipy.ndimage import gaussian_filter1d

    turned = np.exp(-2j * np.pi * frequency * samples.t)
    width = FOLLOWED / samples.period
    mixed = 2.0 * readings * turned
    slow = gaussian_filter1d(mixed.real, width, axis=1) + 1j * gaussian_filter1d(mixed.imag, width, axis=1)
    seen = np.maximum(gaussian_filter1d(samples.valid.astype(float), width), SEEN)
    out: Array = (slow * np.conj(turned)).real / seen
    return out


def _refined(readings: Array, samples: Samples, grid: float) -> float:
    """Frequency near the grid's at which the line in a residual (channels, n) is strongest [Hz]."""
    mixed, t = _mixed_down(readings, samples.t, grid)
    loudest = mixed[int(np.argmax(_amplitudes(mixed, t, len(samples.t))[0] / samples.noise))]
    trials = np.arange(-OFF, OFF + 1e-9, max(0.4 / max(float(t[-1]), 1.0), COARSE))
    begin = np.arange(0, len(t), COARSER)
    slow, middle = np.add.reduceat(loudest, begin), t[np.minimum(begin + COARSER // 2, len(t) - 1)]
    power = [abs(slow @ np.exp(-2j * np.pi * off * middle)) for off in trials]
    near = found = float(trials[int(np.argmax(power))])
    for _ in range(SHARPENED):  # between two trials: least squares
        wave = np.exp(2j * np.pi * found * t)
        line = np.vdot(wave, loudest) / len(t) * wave
        turned = 2j * np.pi * (t - t.mean()) * line
        found += float(np.vdot(turned, loudest - line).real / max(np.vdot(turned, turned).real, 1e-300))
    return grid + (found if abs(found - near) < trials[1] - trials[0] else near)


def _line_of(s: Signals) -> float:
    """Frequency of the sharpest line near a grid's in the readings of a log [Hz]."""
    if s.measured is None or len(s) < 3:
        return GRIDS[0]
    readings = s.measured
    return float(derived("line of the mains", lambda: np.array([_sharpest(readings, s.t)]), readings, s.t)[0])


def _sharpest(readings: Array, t: Array) -> float:
    """Of readings (channels, n), the frequency at which the windowed transform of their differences is largest [Hz]."""
    # differences of neighbours leave lines and noise; a window keeps the rest of the motion away from them
    rough = np.nan_to_num(np.diff(readings, axis=1)) * np.hanning(readings.shape[1] - 1)
    rough /= np.maximum(np.sqrt(np.mean(rough**2, axis=1, keepdims=True)), 1e-300)

    def loudest(trials: Array) -> float:
        power = [float(np.max(np.abs(rough @ np.exp(-2j * np.pi * f * t[1:])))) for f in trials]
        return float(trials[int(np.argmax(power))])

    step = max(0.4 / max(float(t[-1] - t[0]), 1.0), COARSE)
    near = loudest(np.concatenate([np.arange(grid - OFF, grid + OFF + step / 2, step) for grid in GRIDS]))
    return loudest(near + step * np.linspace(-1.0, 1.0, 21))
