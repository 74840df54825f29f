"""The compiled filter against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt_zi, sosfiltfilt

from kinid.kernels.zero_phase import zero_phase


@pytest.mark.parametrize(("order", "band", "n"), [(4, 0.3, 40), (4, 0.1, 1000), (4, 0.02, 301)])
def test_it_is_scipys(order: int, band: float, n: int) -> None:
    """To rounding, which a narrow band's sections carry on for long; into its input, too."""
    sections = butter(order, band, output="sos")
    x = np.random.default_rng(order).standard_normal((3, n)).cumsum(axis=1)  # a pair, and one without a second
    wanted = sosfiltfilt(sections, x, axis=1)
    zero_phase(sections, sosfilt_zi(sections), x)
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
