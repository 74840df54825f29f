"""Signals of the motion phase: derivatives, and rest at both ends."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.planning.signals import Multisine, Sampled, Signal

STUDY = Multisine(0.012, ((0.003, 0.9), (0.001, 5.0)))
TIMES = np.linspace(0.0, 3.0, 61)
OWN = Sampled(TIMES, 0.004 + 0.001 * np.sin(2 * np.pi * 0.7 * TIMES) + 0.0005 * TIMES)


@pytest.mark.parametrize("signal", [STUDY, OWN, Multisine(0.003)])
def test_it_begins_and_ends_at_rest_at_its_base(signal: Signal) -> None:
    ends = signal(np.array([0.0, signal.duration]))
    np.testing.assert_allclose(ends[0], signal.base, atol=1e-15)
    np.testing.assert_allclose(ends[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("signal", [STUDY, OWN])
def test_derivatives(signal: Signal) -> None:
    t = np.linspace(0.02, signal.duration - 0.02, 997)
    h = 1e-5
    for order in range(3):
        slope = (signal(t + h)[order] - signal(t - h)[order]) / (2 * h)
        size = np.abs(signal(t)[order + 1]).max()
        # the spline's third derivative has kinks, at which a difference of 1e-5 s is off by little
        np.testing.assert_allclose(slope, signal(t)[order + 1], atol=2e-3 * size)


def test_the_middle_is_what_was_asked_for() -> None:
    t = np.linspace(0.5, 3.0, 200)
    wanted = 0.012 + 0.003 * np.sin(2 * np.pi * 0.9 * t) + 0.001 * np.sin(2 * np.pi * 5.0 * t)
    np.testing.assert_allclose(STUDY(t)[0], wanted, atol=1e-15)
    inner = TIMES[10:-10]
    np.testing.assert_allclose(OWN(inner)[0], OWN.depths[10:-10], atol=1e-15)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Multisine(0.003, ((0.001, -1.0),)),
        lambda: Multisine(float("nan")),
        lambda: Multisine(0.003, (), 0.0),
        lambda: Multisine(0.003, (), 1.0, fade=0.7),
        lambda: Sampled(np.arange(3.0), np.zeros(3)),
        lambda: Sampled(np.array([0.0, 1, 2, 2, 3, 4]), np.zeros(6)),
    ],
)
def test_nonsense_is_refused(make: object) -> None:
    with pytest.raises(InputError):
        make()  # type: ignore[operator]
