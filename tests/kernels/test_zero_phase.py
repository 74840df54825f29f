"""The compiled filters against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfilt_zi, sosfiltfilt

from kinid.kernels.zero_phase import symmetric, zero_phase


@pytest.mark.parametrize(("order", "band", "n"), [(4, 0.3, 40), (4, 0.1, 1000), (4, 0.02, 301)])
def test_it_is_scipys(order: int, band: float, n: int) -> None:
    """To rounding, which a narrow band's sections carry on for long; into its input, too."""
    sections = butter(order, band, output="sos")
    x = np.random.default_rng(order).standard_normal((3, n)).cumsum(axis=1)  # a pair, and one without a second
    wanted = sosfiltfilt(sections, x, axis=1)
    zero_phase(sections, sosfilt_zi(sections), x)
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(("width", "edges"), [(0.7, (0, 1000)), (6.0, (0, 1, 300, 300, 1000)), (40.0, (0, 600, 1000))])
def test_symmetric_is_scipys_piece_by_piece(width: float, edges: tuple[int, ...]) -> None:
    """To rounding; pieces may be shorter than the window, or empty."""
    reach = int(3.0 * width + 0.5)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / width) ** 2)
    weights /= weights[0] + 2.0 * weights[1:].sum()
    x, out = np.random.default_rng(1).standard_normal((3, 1000)).cumsum(axis=1), np.full((3, 1000), np.nan)
    symmetric(weights, np.array(edges), x, out)
    pieces = [x[:, a:b] for a, b in zip(edges, edges[1:]) if b > a]
    wanted = [gaussian_filter1d(piece, width, axis=1, mode="nearest", truncate=3.0) for piece in pieces]
    np.testing.assert_allclose(out, np.concatenate(wanted, axis=1), rtol=0, atol=1e-12 * np.abs(x).max())
