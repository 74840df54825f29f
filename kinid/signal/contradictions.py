"""Where logged rates contradict the positions: offset, scale and clock, in words with figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.signal.rates import ALIEN, Learnt
from kinid.signal.smoother import Smoothed

Array = NDArray[np.float64]

#: what is off exceeds so many of its standard errors, and this share of the greatest rate
SURE, SHARE = 5.0, 1e-4
#: a scale is off by more than this; a clock by more than this many samples, and by more than this [s]
SCALE, SAMPLES, LEAST_DELAY = 0.02, 0.5, 1e-3


def contradictions(made: Smoothed, names: Sequence[str], period: float) -> list[str]:
    """At most a sentence each for offsets, scales and delays that are large, of velocities and of accelerations.

    Args:
        made: the estimate. names: of the axes, (k,). period: sample time [s].
    """
    out = []
    for what, unit, learnt, rate in (
        ("velocities", "/s", made.velocities, made.first),
        ("accelerations", "/s²", made.accelerations, made.second),
    ):
        if learnt:
            largest = np.nan_to_num(np.fmax.reduce(np.abs(rate), axis=0))
            out += _of_rates(learnt, what, unit, names, largest, period)
    return out


def _of_rates(
    learnt: Sequence[Learnt], what: str, unit: str, names: Sequence[str], largest: Array, period: float
) -> list[str]:
    """Of one kind of rates, whose greatest values are these, (k,)."""
    bias, gain, delay, noise = np.array([(one.bias, one.scale, one.delay, one.noise) for one in learnt]).T
    errors, left_out = np.array([one.errors for one in learnt]), ~np.isfinite(noise)
    done = "they add nothing to the positions and were left out" if left_out.all() else ""
    out = []
    dead = left_out & (np.abs(gain) < 1.0 / ALIEN) & (SURE * errors[:, 1] < 1.0)
    if dead.any():
        still = ", ".join(names[j] for j in np.flatnonzero(dead).tolist())
        out.append(
            f"logged {what} of {still} never change, though the positions do; they were left out: name their columns "
            "in [columns], or leave them out of the log"
        )
    off = ~dead & (np.abs(bias) > SURE * errors[:, 0]) & (np.abs(bias) > SHARE * largest)
    if off.any():
        figures = [f"{names[j]} {bias[j]:+.3g} ± {errors[j, 0]:.1g}{unit}" for j in np.flatnonzero(off).tolist()]
        out.append(
            f"logged {what} are offset from the derivative of the positions, {', '.join(figures)}; "
            + (done or "the offset was taken out")
        )
    off = ~dead & (np.abs(gain - 1.0) > SCALE) & (np.abs(gain - 1.0) > SURE * errors[:, 1]) & (gain != 0.0)
    if off.any():
        figures = [f"{names[j]} {gain[j]:.4g} ± {errors[j, 1]:.1g}" for j in np.flatnonzero(off).tolist()]
        out.append(
            f"logged {what} are not the derivative of the positions but a multiple, {', '.join(figures)}; "
            f"{done + '; ' if done else ''}state their unit or scale in [columns]"
        )
    off = (np.abs(delay) > max(SAMPLES * period, LEAST_DELAY)) & (np.abs(delay) > SURE * errors[:, 2])
    if off.any():
        at = np.flatnonzero(off).tolist()
        figures = [f"{names[j]} {1e3 * abs(delay[j]):.3g} ms {'after' if delay[j] > 0 else 'before'}" for j in at]
        out.append(
            f"logged {what} do not come with the positions, {', '.join(figures)}; " + (done or "they were moved back")
        )
    return out
