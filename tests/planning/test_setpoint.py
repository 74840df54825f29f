"""Set-point changes against their limits, and against the trapezoid."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.planning.setpoint_timing import Pace, change, rest, trapezoid_duration


def test_a_change_keeps_its_pace_and_its_parts_join() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        pace = Pace(*np.exp(rng.uniform([-4, -2, 0], [0, 2, 4])))
        a, b = rng.uniform(-0.3, 0.3, 2)
        way = change(a, b, pace)
        t = np.linspace(0, way.duration, 400)
        p, v, acc, jerk = way(t)
        assert np.abs(v).max() <= pace.speed * (1 + 1e-9)
        assert np.abs(acc).max() <= pace.acceleration * (1 + 1e-9)
        assert np.abs(jerk).max() <= pace.jerk * (1 + 1e-9)
        assert p[0] == pytest.approx(a, abs=1e-12)
        assert p[-1] == pytest.approx(b, abs=1e-12)
        # the states that pieces begin with are those that the pieces before end with
        eps = 1e-12
        for k, when in enumerate(way.times[1:-1], start=1):
            before = way(np.array([when - eps]))[:3, 0]
            np.testing.assert_allclose(before, way.states[k], atol=1e-9 + eps * pace.jerk)


def test_derivatives_are_those_of_the_position() -> None:
    way = change(0.0, 0.1, Pace(0.08, 0.5, 5.0))
    t = np.linspace(0.01, way.duration - 0.01, 50)
    h = 1e-5
    for order, tolerance in ((0, 1e-8), (1, 1e-6)):
        slope = (way(t + h)[order] - way(t - h)[order]) / (2 * h)
        np.testing.assert_allclose(slope, way(t)[order + 1], atol=1e-3 * 5.0 * h + tolerance)


def test_never_slower_than_a_trapezoid(capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(1)
    saved = []
    for _ in range(500):
        pace = Pace(rng.uniform(0.01, 0.3), rng.uniform(0.1, 2.0), rng.uniform(1.0, 40.0))
        distance = float(np.exp(rng.uniform(np.log(5e-4), np.log(0.3))))
        quick, usual = change(0.0, distance, pace).duration, trapezoid_duration(distance, pace)
        assert quick <= usual + 1e-9
        saved.append(1 - quick / usual)
    with capsys.disabled():
        print(
            f"\nset-points: {100 * np.mean(saved):.1f} % less time than trapezoids under the same limits "
            f"(at most {100 * max(saved):.0f} %), 500 changes"
        )
    assert np.mean(saved) > 0.02


def test_parts_that_do_not_join_are_refused() -> None:
    pace = Pace(0.1, 1.0, 10.0)
    both = change(0.0, 0.02, pace, end_speed=0.03).then(change(0.02, 0.05, pace, start_speed=0.03))
    assert both(np.array([both.duration]))[0, 0] == pytest.approx(0.05, abs=1e-12)
    with pytest.raises(ValueError, match="ends at"):
        rest(0.1, 1.0).then(change(0.0, 0.1, pace))
    with pytest.raises(InputError, match="positive"):
        Pace(0.0, 1.0, 1.0)
    with pytest.raises(InputError, match="finite"):
        change(0.0, float("nan"), pace)


def test_the_trapezoid_itself_keeps_the_limits() -> None:
    """The figure it is compared with is that of a motion that could be run: built here, sample by sample."""
    for distance, pace in ((0.1, Pace(0.1, 1.0, 20.0)), (0.004, Pace(0.1, 1.0, 20.0)), (0.011, Pace(0.1, 1.0, 30.0))):
        h = 2e-5
        duration = trapezoid_duration(distance, pace)
        peak = min(pace.speed, float(np.sqrt(distance * pace.acceleration)))
        cruise = max(0.0, distance / peak - peak / pace.acceleration)
        t = np.arange(0.0, duration, h)
        plain = np.clip(np.minimum(t, cruise + 2 * peak / pace.acceleration - t) * pace.acceleration, 0.0, peak)
        window = round((duration - cruise - 2 * peak / pace.acceleration) / h)
        speed = np.convolve(plain, np.ones(window) / window)[: len(t)]
        acceleration = np.gradient(speed, h)
        assert speed.sum() * h == pytest.approx(distance, rel=1e-3)
        assert speed[-1] == pytest.approx(0.0, abs=1e-3 * peak)
        assert np.abs(acceleration).max() <= pace.acceleration * 1.01
        assert np.abs(np.gradient(acceleration, h))[5:-5].max() <= pace.jerk * 1.05
