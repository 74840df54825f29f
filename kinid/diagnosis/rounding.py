"""A converter so coarse that noise doesn't blur its steps: what its readings say, and what they leave open.

A reading y of a step h says that the force lay within h/2 of it, give or take the noise before the converter. What a model
predicts inside of that is not contradicted, whatever it is; only what it predicts beyond counts, and there no more than the
noise is uncertain. Least squares on readings as they are would take the staircase for noise that neighbours share, and lose
most of what transitions from one step to the next tell (Gustafsson & Karlsson, IEEE Trans. Signal Process. 57(6), 2009).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d
from scipy.special import ndtr

Array = NDArray[np.float64]

#: a step of the converter is told from noise from this multiple of the noise before it on: of smaller ones noise makes noise
COARSE = 1.2
#: and from this multiple on neighbours share their error of rounding
STAIRS = 4.0
#: noise before the converter is looked for down to this share of a step: below, too few readings are restless to tell
FINEST = 0.04
#: motion is slower than this [Hz]
MOTION = 25.0
#: places of a force within a step that are looked at, in steps
PHASES = (0.0, 0.25, 0.5, 0.75)
#: a force moves where it passes a step within this time [s]; so many samples of it are enough
MOVING, ENOUGH = 0.1, 400
#: third differences beyond so many steps are impacts
IMPACT = 12.0


def blur(raw: Array, step: float, expected: Array, period: float) -> float:
    """Standard deviation of the noise before a converter, at most its step.

    That at which a converter in front of the expected force, with this noise added, changes its reading from sample to sample
    as this one did: motion makes transitions, too. Where in a step a force rests is not known that well: it is looked at where
    it moves, and where it hardly ever does, all places count.

    Args:
        raw: readings of one channel, (n,). step: of the converter. expected: forces there without noise, (n,).
        period: time between samples [s].
    """
    if len(raw) < 8:
        return step
    smooth = gaussian_filter1d(expected, max(1e-3, 1.0 / (2 * np.pi * MOTION * period)))
    white = np.random.default_rng(0).standard_normal(len(raw))
    near = max(1, round(MOVING / period))
    moving = maximum_filter1d(smooth, near) - minimum_filter1d(smooth, near) > step
    moving = moving if moving.sum() >= ENOUGH else np.ones(len(raw), np.bool_)
    seen = _restless(raw, step, moving)
    low, high = FINEST * step, step
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        shaken = smooth + middle * white
        if np.mean([_restless(step * np.round(shaken / step + phase), step, moving) for phase in PHASES]) < seen:
            low = middle
        else:
            high = middle
    return high


def _restless(readings: Array, step: float, where: NDArray[np.bool_]) -> float:
    """Mean square of third differences, in steps."""
    third = np.abs(np.diff(readings, 3))[where[3:]] / step
    return float(np.mean(third[third < IMPACT] ** 2)) if len(third) else 0.0


def shared(step: Array, noise: Array) -> Array:
    """Variance of a rounding error's mean over noise: what neighbours share, and averages don't take away.

    Of a phase that is anywhere alike often: sum over k of h²/(2 π² k²) exp(−4 π² k² σ²/h²) (Widrow & Kollár, Quantization
    Noise, 2008).
    """
    k = np.arange(1, 50)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.exp(-4.0 * np.pi**2 * k**2 * np.where(step > 0, noise / step, np.inf) ** 2) / k**2
    out: Array = step**2 / (2.0 * np.pi**2) * each.sum(axis=0)
    return out


def nearest(readings: Array, predicted: Array, steps: Array) -> Array:
    """Of what readings (channels, n) allow the nearest to predictions, as if it were read: they differ where contradicted.

    Args:
        readings, predicted: raw, (channels, n). steps: of each channel, 0 where it has none.
    """
    half = 0.5 * steps[:, None]
    out: Array = predicted + np.clip(readings - predicted, -half, half)
    return out


def contradicted(readings: Array, predicted: Array, steps: Array) -> NDArray[np.bool_]:
    """Whether a small change of a prediction changes what it says beside a reading, (channels, n)."""
    out: NDArray[np.bool_] = np.abs(readings - predicted) > 0.5 * steps[:, None]
    return out


def usual(ratio: Array, many: Array) -> Array:
    """Mean square of what noise leaves beyond half a step of a right model's predictions, in its own variances.

    Args:
        ratio: noise over step. many: samples that are averaged. Both of any one shape.
    """
    x = np.linspace(0.0, 6.0, 601)
    tail = ndtr(-x)
    alone, together = np.trapezoid(x**2 * tail, x), np.trapezoid(x**2 * tail**2, x)
    # of both sides of a transition; what follows from where it is, neighbours share
    out: Array = np.minimum(1.0, 2.0 * ratio * (alone + (many - 1.0) * together))
    return out
