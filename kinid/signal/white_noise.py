"""White noise of a slow signal, seen in its differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: variance of a third difference of white noise of variance 1
GAIN = 20.0
#: normal standard deviations in a median absolute deviation
ROBUST = 1.4826


def white_noise(signal: Array) -> float:
    """Standard deviation of the white noise on a smooth signal (n,): from third differences, robustly; 0 of fewer than
    8 samples.

    Of a smooth signal a third difference has next to nothing, and the median absolute deviation ignores the few samples
    at impacts.
    """
    if len(signal) < 8:
        return 0.0
    return float(ROBUST * np.median(np.abs(np.diff(signal, n=3))) / np.sqrt(GAIN))
