"""One axis between two gaps: how strongly its jerk varies along the way, and the state that follows.

A single intensity of the jerk fails: it differs a thousandfold between holds, touches and reversals. A bank of Kalman
filters, each with an intensity that stays as it is, runs over the positions forwards and backwards; which one foretells
them best from moment to moment, a hidden Markov chain tells. From there the intensity climbs to where the likelihood of
all measurements is greatest (the quotient of found and expected energy of the jerk, in windows of a few degrees of
freedom).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.kernels import fixed_interval, intensity
from kinid.kernels.state_space import ORDER

Array = NDArray[np.float64]

#: intensities of the bank, in units of the noise's variance: a bandwidth an octave, from 1/512 of a sample's angular
#: rate on
LEVELS = 2.0 ** (2 * ORDER * np.arange(-9, 5))
#: probability that the level moves up, or down, from one sample to the next
SWITCH = 0.02
#: degrees of freedom of the jerk in a window, and how often the intensity is climbed
WINDOW, CLIMBS = 2.0, 4
#: a climb goes so many times as far, on a logarithmic scale, as found and expected energies differ: it arrives sooner
HASTE = 2.0
#: greatest factor of a climb, and the range of intensities in units of the noise's variance
STRIDE, LEAST, MOST = 1e3, 2.0 ** (-24 * ORDER), 2.0 ** (10 * ORDER)
#: log-likelihood that each degree of freedom of an intensity that varies must be worth; a search that gains less is at
#: its end
WORTH, SETTLED = 1.0, 0.01
#: a single intensity that would change by a smaller share has been found
ARRIVED = 0.01
#: a search gains at most so many times more than its last climb did
REMAINS = 10.0
#: an intensity that was a single one must be worth so many times as much to vary: a verdict of the motion, not of a
#: measurement
AGAIN = 2.0
#: noise is put right where less than a share of it is found, by no more than another at a time, from so many degrees of
#: freedom
LOUD, QUIETER, ENOUGH = 0.7, 1e-2, 30.0
#: where digits are lost, positions are held to this share of their size at best, and to this variance
FINEST, TINY = 1e-9, 1e-200
#: variance of the state before the first sample, times that of the parabola through the first three
VAGUE = 100.0


@dataclass(eq=False)
class Axis:
    """Measurements of one axis in one piece, in units of the median sample time.

    Attributes:
        tau: steps of time, the first of them 0, (n,). value, variance: measurements, of positions, or with rates as
            well, (n, c).
        noise: variance of a position. jerk: intensity of each step, (n,).
        quieter: share of its variance that each kind of measurement may turn out to have, (c,).
        single: one intensity does for all steps.
        constant: the likeliest of the intensities that are alike at all steps, as far as known; 0 for not at all.
    """

    tau: Array
    value: Array
    variance: Array
    noise: float
    jerk: Array
    quieter: list[float]
    single: bool = False
    constant: float = 0.0

    @classmethod
    def of(cls, tau: Array, position: Array, variance: Array, noise: float, quieter: float) -> Axis:
        """From positions and their variances, (n,); the intensity is that of the bank."""
        axis = cls(tau, position[:, None].copy(), variance[:, None].copy(), noise, np.empty(0), [quieter])
        axis.jerk = axis._from_bank()
        return axis

    def _from_bank(self) -> Array:
        n = len(self.tau)
        if n <= ORDER:
            return np.full(n, self.noise)
        measured = self.variance[:, 0] < np.inf
        there = np.flatnonzero(measured)
        y, r = self.value[there, 0], self.variance[there, 0]
        tau = np.diff(np.cumsum(self.tau)[there], prepend=0.0)
        out = np.empty((len(there), len(LEVELS)), np.float32)
        forth, back = np.empty(len(there)), np.empty(len(there))
        levels = LEVELS * self.noise
        intensity.bank(tau, y, r, levels, *_before(tau, y, r), out)
        self.constant = float(levels[0] * (levels[1] / levels[0]) ** _highest(out.sum(axis=0, dtype=np.float64)))
        intensity.local_level(out, SWITCH, forth)
        # backwards; the intensity of a step belongs to the sample at its end
        tau, y, r = np.r_[0.0, tau[:0:-1]], y[::-1].copy(), r[::-1].copy()
        intensity.bank(tau, y, r, levels, *_before(tau, y, r), out)
        intensity.local_level(out, SWITCH, back)
        forth[1:] = 0.5 * (forth[1:] + back[:0:-1])
        jerk: Array = levels[0] * 2.0 ** (2.0 * ORDER * forth)
        return jerk[np.minimum(np.cumsum(measured) - measured, len(there) - 1)]

    def climb(self) -> None:
        """Bring intensities, and noise that differences of a fast motion made too large, nearer to the greatest
        likelihood.

        An intensity that varies must be worth it: where it gains less than a unit of log-likelihood a degree of freedom
        that was fitted, a single one does as well, and follows noise less.
        """
        n, c = self.value.shape
        if n <= ORDER:
            return
        fits, work, out, factor = np.ones((c, 2)), np.empty((n, c, 2 + ORDER)), np.empty((n, 2)), np.empty(n)
        begin = self.begin()

        def score(jerk: Array) -> float:
            return float(intensity.score(self.tau, self.value, self.variance, jerk, *begin, work, out, fits))

        def grown(jerk: Array, factor: Array | float) -> Array:
            kept: Array = np.clip(
                jerk * np.clip(factor**HASTE, 1.0 / STRIDE, STRIDE), LEAST * self.noise, MOST * self.noise
            )
            return kept

        for _ in range(CLIMBS):
            score(self.jerk)
            intensity.in_windows(out[:, 0], out[:, 1], WINDOW, factor)
            self.jerk = grown(self.jerk, factor)
            for kind, (found, expected) in enumerate(fits):
                share = max(found / expected, self.quieter[kind], QUIETER) if expected > ENOUGH else 1.0
                if share < LOUD:
                    self.variance[:, kind] *= share
                    self.quieter[kind] = min(1.0, self.quieter[kind] / share)
        varied, worth = score(self.jerk), WORTH * (AGAIN if self.single else 1.0)
        fitted = float(out[:, 1].sum())
        enough, settled = varied - worth * fitted, SETTLED * fitted
        if self._found_constant(score, out, enough, settled):
            self.jerk, self.single = np.full(n, self.constant), True

    def _found_constant(self, score: Callable[[Array], float], out: Array, enough: float, settled: float) -> bool:
        """Whether some intensity that is the same at all steps is as likely as `enough`; it becomes `constant`.

        The logarithm of found over expected energy is zero where it is likeliest: secants go there. A search that
        gains less than `settled`, or too little for what is missing, is at its end.
        """
        lowest, highest, stride = np.log(LEAST * self.noise), np.log(MOST * self.noise), np.log(STRIDE)
        at = float(np.log(self.constant)) if self.constant else float(np.mean(np.log(self.jerk)))
        before, wanted_before, plain = at, np.nan, -np.inf
        for _ in range(3 * CLIMBS):
            self.constant = float(np.exp(at))
            last, plain = plain, score(np.full(len(self.tau), self.constant))
            if plain <= enough and plain - last < max(settled, (enough - plain) / REMAINS):
                return False
            wanted = float(np.log(max(out[:, 0].sum(), 1e-300) / max(out[:, 1].sum(), 1e-300)))
            slope = (wanted - wanted_before) / (at - before) if at != before else np.nan
            step = float(np.clip(-wanted / slope if slope < 0.0 else HASTE * wanted, -stride, stride))
            if plain > enough and abs(step) < ARRIVED:
                break
            before, wanted_before, at = at, wanted, float(np.clip(at + step, lowest, highest))
        return plain > enough

    def sound(self) -> tuple[Array, Array]:
        """What `smoothed` gives, of positions alone, or of noisier ones, where it isn't sound.

        No finite log shall end without an estimate: measurements that differ a billion times in size can lose all
        digits.
        """
        made = self.smoothed()[:2]
        for louder in (1.0, 1e6, 1e12):
            if self._sound(*made):
                break
            self.value, self.variance = self.value[:, :1].copy(), louder * self.variance[:, :1]
            size = float(np.ptp(self.value))
            self.variance = np.maximum(self.variance, (FINEST * max(size, float(np.abs(self.value).max()))) ** 2 + TINY)
            self.noise = max(louder * self.noise, float(self.variance.min()))
            self.jerk = self._from_bank() if louder == 1.0 else np.full(len(self.tau), self.noise)
            made = self.smoothed()[:2]
        return made

    def _sound(self, state: Array, sd: Array) -> bool:
        """Whether an estimate is a number, and no further from a position than all positions are from each other."""
        if not (np.isfinite(state).all() and np.isfinite(sd).all()):
            return False
        there = self.variance[:, 0] < np.inf
        position = self.value[there, 0]
        return bool(np.abs(state[there, 0] - position).max() <= np.ptp(position) + self.noise**0.5)

    def begin(self) -> tuple[Array, Array]:
        """State before the first sample, and its covariance."""
        there = np.flatnonzero(self.variance[:, 0] < np.inf)[: ORDER + 1]
        return _before(
            np.diff(np.cumsum(self.tau[: there[-1] + 1])[there], prepend=0.0),
            self.value[there, 0],
            self.variance[there, 0],
        )

    def smoothed(self, draws: int = 0, seed: Sequence[int] = ()) -> tuple[Array, Array, NDArray[np.float32]]:
        """State and its standard deviations (n, d), and so many draws of the error of its first parts (m, n, 3)."""
        n, random = len(self.tau), np.random.default_rng(seed)
        state, sd, drawn = np.empty((n, ORDER)), np.empty((n, ORDER)), np.empty((draws, n, 3), np.float32)
        fixed_interval.smooth(self.tau, self.value, self.variance, self.jerk, *self.begin(), state, sd, random, drawn)
        return state, sd, drawn


def _highest(values: Array) -> float:
    """Where the parabola through the highest of some values (m,) and its neighbours is highest, in steps."""
    at = int(np.argmax(values))
    if not 0 < at < len(values) - 1:
        return float(at)
    left, middle, right = values[at - 1 : at + 2]
    bend = 2.0 * middle - left - right
    return at + float(np.clip(0.5 * (right - left) / bend, -0.5, 0.5)) if bend > 0.0 else float(at)


def _before(tau: Array, y: Array, r: Array) -> tuple[Array, Array]:
    """A vague state before the first sample: the polynomial through the first of them, (d,) and (d, d)."""
    n, t = min(ORDER, len(y)), np.cumsum(tau[: ORDER + 1])
    unit = np.array([float(math.factorial(i)) for i in range(ORDER)])
    fit = np.linalg.inv(np.vander(t[:n], n, increasing=True)) * unit[:n, None]
    away = 0.0
    if len(y) > ORDER:  # one sample more tells how far it is from a polynomial
        away = float(np.linalg.solve(np.vander(t, ORDER + 1, increasing=True), y[: ORDER + 1] - y[0])[ORDER])
    state, size = np.zeros(ORDER), np.ones(ORDER)
    state[:n], size[:n] = fit @ (y[:n] - y[0]), (fit**2).sum(axis=1)
    state[0] += y[0]
    noise = float(np.min(r[:n]))
    return state, np.diag(VAGUE * (noise * size + (unit[-1] * ORDER * away) ** 2))
