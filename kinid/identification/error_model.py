"""The error of a reading: its own noise, the motion's noise carried through the model, and what no effect so far
explains.

σ² = (a) noise and resolution of the reading + (b) noise of the motion estimate, carried through the model by draws +
(d) the discrepancy: per channel, with a size and a memory that are learnt from the residual (M. C. Kennedy, A. O'Hagan,
J. R. Stat. Soc. B 63, 2001). It is learnt after the parameters, so that it can't take from the effects what they
explain (M. Gu, L. Wang, SIAM/ASA J. Uncertainty Quantification 6, 2018). What calibration leaves open (c) are nuisance
parameters.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from kinid.effects._derived import sample_period
from kinid.identification.problem import Problem
from kinid.modeling.model import Model
from kinid.robotics.motion import STATIC_PERIOD

Array = NDArray[np.float64]

#: of a channel's own size, what no converter resolves and no reading is believed to; and of the noise of the loudest
#: channel of the same unit, what no other of one sensor is quieter than
RESOLUTION, MIN_NOISE_RATIO = 1e-4, 0.02
#: share of a channel's own size that noise of static poses is taken to be at most
STATIC_NOISE = 0.001
#: share of a usual force that is open where a material has let go
SEPARATION_FORCE_SHARE = 0.1
#: what is left in a block of time, in standard deviations, beyond which it weighs no more; and how often weights are
#: found anew
UNUSUAL_DEVIATIONS, REWEIGHTINGS = 3.0, 4
#: share of its square that noise is known to
NOISE_UNCERTAINTY = 0.1
#: the motion's noise is averaged over so long [s]: draws are few
MOTION_VARIANCE_WINDOW = 0.2


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Standard deviations of means, all (channels, g) or (channels,).

    Attributes:
        reading: variance of the reading's own noise, (channels, g). motion: of the motion's, (channels, g).
        discrepancy: standard deviation of what is left beyond both, (channels,).
        memory: time over which the residual remembers itself [s]. unusual: factor of the variance in blocks that leave
            many times what others do, (channels, g).
    """

    reading: Array
    motion: Array
    discrepancy: Array
    memory: float
    unusual: Array | float = 1.0

    @property
    def sigma(self) -> Array:
        """Standard deviation of each mean, (channels, g)."""
        out: Array = np.sqrt((self.reading + self.motion + self.discrepancy[:, None] ** 2) * self.unusual)
        return out

    @property
    def noise(self) -> Array:
        """The same without the discrepancy, (channels, g)."""
        out: Array = np.sqrt(self.reading + self.motion)
        return out


def reading_noise(problem: Problem, averaged: bool = False) -> Array:
    """Standard deviation of a single reading's own noise, or of the averaged experiment's, (channels,)."""
    noise = (problem.experiment if averaged else problem.whole).noise.copy()
    if (
        sample_period(problem.experiment.signals) >= STATIC_PERIOD
    ):  # from pose to pose all changes: neighbours tell no noise
        noise = np.minimum(noise, STATIC_NOISE * problem.channel_rms)
    return noise


def reading_variance(problem: Problem) -> Array:
    """Variance of a mean's own noise, (channels, g)."""
    noise = reading_noise(problem, averaged=True)
    units = np.array(problem.layout.units)
    for unit in set(units.tolist()):
        alike = units == unit
        noise[alike] = np.maximum(noise[alike], MIN_NOISE_RATIO * noise[alike].max())
    out: Array = noise[:, None] ** 2 / problem.count + (RESOLUTION * problem.channel_rms[:, None]) ** 2
    if problem.experiment.slow is not None:
        out = out + problem.experiment.slow[:, None] ** 2
    return out + problem.rounding[:, None] + _released(problem) ** 2


def _released(problem: Problem) -> Array:
    """Standard deviation that is open of each mean while a tool retracts from a material that has let it go already,
    (channels, g) [N, N·m].

    Linear dashpots pull there, and rub; materials that remember or lose energy don't: laws that differ in this alone
    are one. Whether it has let go is decided by the neighbouring means. A weight that depends on the mean's own noise
    biases the estimate: means with positive noise keep their weight, and stiffness and exponent come out too large.
    """
    experiment = problem.experiment
    s, normal = experiment.signals, experiment.normal_force
    if normal is None or not experiment.separated.any():
        return np.zeros(problem.shape)
    arm = 1.0 if s.sensor is None else float(np.linalg.norm(s.sensor.tip))
    lever = np.array([1.0 if unit == "N" else arm for unit in s.layout.units])
    usual = float(np.nanpercentile(normal[s.depth > 0], 95))
    unloaded, retracting = (problem.mean_at(x.astype(float)) for x in (experiment.unloaded, experiment.retracting))
    beside = np.minimum(np.r_[unloaded[1:], 1.0], np.r_[1.0, unloaded[:-1]])
    out: Array = lever[:, None] * (SEPARATION_FORCE_SHARE * usual * retracting * beside)
    return out


def motion_variance(problem: Problem, model: Model, values: Array) -> Array:
    """Variance of the means from errors of the motion estimate, carried through the model by draws, (channels, g)."""
    total = np.zeros(problem.shape)
    draws = problem.draws
    if not draws:
        return total
    here = problem.predict(model, values)
    for draw in draws:
        total += (problem.means(model.predict(draw, values)) - here) ** 2 / len(draws)
    width = max(1, round(MOTION_VARIANCE_WINDOW / problem.spacing))
    # never below its own share of the window: sums that run along lose the small beside the large
    return np.asarray(np.maximum(uniform_filter1d(total, width, axis=1), total / width))


def discrepancy(residual: Array, known: Array) -> Array:
    """Size d of what is left in each channel beyond known variances v, (channels,): the mean of r²/(v + d²) is 1.

    Where v is large for a while, what is left elsewhere still counts (R. C. Paule, J. Mandel, J. Res. NBS 87, 1982).

    Args:
        residual, known: of the means, (channels, g).
    """
    square = np.zeros(len(residual))
    some = np.flatnonzero(~(np.mean(residual**2 / known, axis=1) <= 1.0)) if residual.size else np.zeros(0, np.int64)
    r, v = residual[some] ** 2, known[some]
    low, high = np.zeros(len(some)), np.mean(r, axis=1)
    for _ in range(60):
        middle = 0.5 * (low + high)
        more = np.mean(r / (v + middle[:, None]), axis=1) > 1.0
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    square[some] = high
    return np.asarray(np.sqrt(square))


def memory_of(problem: Problem, whitened: Array) -> float:
    """Integrated autocorrelation time of a whitened residual (channels, g) [s], over lags up to a block."""
    spacing, power = problem.spacing, float(np.sum(whitened**2))
    if power <= 0 or whitened.shape[1] < 16:
        return spacing
    total = 1.0
    for lag in range(1, min(whitened.shape[1] // 4, max(2, round(2.0 / spacing)))):
        rho = float(np.sum(whitened[:, lag:] * whitened[:, :-lag])) / power
        if rho < 0.05:
            break
        total += 2.0 * rho
    return spacing * total


def learn(
    problem: Problem, model: Model, values: Array, residual: Array, known: ErrorModel | None = None
) -> ErrorModel:
    """Learn the error model from a residual (channels, g); of a known one, what the residual doesn't tell stays."""
    if known is None:
        reading, motion = reading_variance(problem), motion_variance(problem, model, values)
    else:
        reading, motion = known.reading, known.motion
    unusual = np.ones(problem.shape)
    for _ in range(REWEIGHTINGS):
        left = discrepancy(residual / np.sqrt(unusual), reading + motion)
        squares = residual**2 / (reading + motion + left[:, None] ** 2)
        unusual = unusual_blocks(problem, squares)
    made = ErrorModel(reading, motion, left, 0.0, unusual)
    return dataclasses.replace(made, memory=memory_of(problem, residual / made.sigma))


def unusual_blocks(problem: Problem, squares: Array) -> Array:
    """Factor, at least 1, of the variance in blocks of time that leave much more than others, (channels, g)."""
    many = np.bincount(problem.block)
    means = np.stack([(np.bincount(problem.block, row) / many)[problem.block] for row in squares])
    return np.maximum(1.0, means / UNUSUAL_DEVIATIONS**2)
