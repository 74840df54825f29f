"""Where logged rates contradict the positions: offset, scale and clock, in words with figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: what is off exceeds so many of its standard errors, and this share of the greatest rate
SURE, SHARE = 5.0, 1e-4
#: a scale is off by more than this; a clock by more than this many samples, and by more than this [s]
SCALE, SAMPLES, LEAST_DELAY = 0.02, 0.5, 1e-3


def contradictions(
    facts: Mapping[str, Any], what: str, names: Sequence[str], largest: Array, period: float
) -> list[str]:
    """At most a sentence each for offsets, scales and delays that are large.

    Args:
        facts: as `Smoothed.facts` has them of these rates. what: "velocities" or "accelerations". names: of the axes,
            (k,).
        largest: greatest rate of each axis, (k,). period: sample time [s].
    """
    unit = "/s" if what == "velocities" else "/s²"
    bias, gain, delay, errors = (np.asarray(facts[name], dtype=float) for name in ("bias", "scale", "delay", "errors"))
    left_out = ~np.isfinite(np.asarray(facts["noise"], dtype=float))
    done = "they add nothing to the positions and were left out" if left_out.all() else ""
    out = []
    off = (np.abs(bias) > SURE * errors[:, 0]) & (np.abs(bias) > SHARE * largest)
    if off.any():
        figures = [f"{names[j]} {bias[j]:+.3g} ± {errors[j, 0]:.1g}{unit}" for j in np.flatnonzero(off).tolist()]
        out.append(
            f"logged {what} are offset from the derivative of the positions, {', '.join(figures)}; "
            + (done or "the offset was taken out")
        )
    off = (np.abs(gain - 1.0) > SCALE) & (np.abs(gain - 1.0) > SURE * errors[:, 1]) & (gain != 0.0)
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
