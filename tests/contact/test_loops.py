"""Energy in loops of force over depth against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.contact.loops import cycles, loops

T = np.arange(4000) * 1e-3
DT = np.diff(T, prepend=0.0)


def test_a_dashpot_that_is_never_left_loses_pi_c_w_a_squared_each_turn() -> None:
    a, w, k, c = 2e-3, 2 * np.pi * 1.5, 700.0, 12.0
    depth = 5e-3 + a * np.sin(w * T)
    found = loops(depth, k * depth + c * a * w * np.cos(w * T), DT)
    assert len(found) == 5  # between the six minima of four seconds
    for loop in found:
        # steps of 1/667 turn leave (2π/667)²/6 of the area, and each end of a loop lies within half a step
        assert loop.lost == pytest.approx(np.pi * c * w * a**2, rel=1e-3)
        assert loop.put_in > loop.lost


def test_a_spring_gives_everything_back() -> None:
    depth = 3e-3 * np.sin(7.0 * T)
    found = loops(depth, 900.0 * np.maximum(depth, 0.0), DT)
    assert len(found) == 4
    for loop in found:
        assert loop.put_in == pytest.approx(0.5 * 900.0 * 3e-3**2, rel=1e-4)
        assert abs(loop.share) < 1e-3


def test_hunt_crossley_loses_more_the_deeper_and_nothing_at_the_surface() -> None:
    """∮ B δⁿ δ̇ dδ over a half sine of amplitude A: B A^(n+2) w ∫ sinⁿ cos² from 0 to π, √π Γ(n/2 + ½)/(2 Γ(n/2 +
    2)).
    """
    from scipy.special import gamma

    a, w, n, b = 4e-3, 7.0, 1.4, 900.0
    depth, rate = a * np.sin(w * T), a * w * np.cos(w * T)
    inside = np.maximum(depth, 0.0) ** n
    expected = b * a ** (n + 2) * w * np.sqrt(np.pi) * gamma(n / 2 + 0.5) / (2 * gamma(n / 2 + 2))
    for loop in loops(depth, 2000.0 * inside + b * inside * rate, DT):
        assert loop.lost == pytest.approx(expected, rel=1e-3)


def test_several_presses_within_one_touch_are_several_loops() -> None:
    depth = np.interp(T, [0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5], [-1, 3, 1, 4, 1, 3, -1, -1]) * 1e-3
    ends = [(T[a], T[min(b, len(T) - 1)]) for a, b in cycles(depth, DT)]
    np.testing.assert_allclose(ends, [(0.125, 1.0), (1.0, 2.0), (2.0, 2.875)], atol=3e-3)


def test_noise_at_the_surface_and_gaps_are_no_loops() -> None:
    depth = 1e-5 * np.sin(900 * T)
    depth[1000:2000] = 3e-3 * np.sin(np.pi * (T[1000:2000] - 1.0))
    assert len(loops(depth, 700.0 * depth, DT)) == 1
    dt = DT.copy()
    dt[1500] = 0.0
    assert not loops(depth, 700.0 * depth, dt)
    force = 700.0 * depth
    force[1200:1300] = np.nan
    assert np.isfinite(loops(depth, force, DT)[0].lost)
