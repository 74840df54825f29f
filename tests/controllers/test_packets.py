"""What arrives of packets, and waves that are made of it: never more energy than was sent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.controllers import _line
from kinid.controllers.packets import NONE, Network, Schedule
from kinid.errors import InputError

Array = NDArray[np.float64]
PERIOD = 1e-3


def played(wave: Array, schedule: Schedule) -> tuple[Array, Array]:
    """What is played out of a wave, and integral and energy of both at each period, (n, 4)."""
    n = len(wave)
    sums, given_, out, both = np.zeros((n, 2)), np.zeros(2), np.empty(n), np.empty((n, 4))
    for i in range(n):
        _line.send(sums, i, wave[i], PERIOD)
        out[i] = _line.play(sums, schedule, given_, i, PERIOD)
        both[i] = *sums[i], *given_
    return out, both


def test_a_line_without_jitter_or_loss_delays_and_nothing_else() -> None:
    for way, first in ((0, 0), (1, 1)):
        late = Network().schedule(50, 0.007, PERIOD, way)
        assert late.buffer == 7
        np.testing.assert_array_equal(late.newest[:7], NONE)
        np.testing.assert_array_equal(late.newest[7:], np.arange(43))
        np.testing.assert_array_equal(late.due, late.newest)
        at_once = Network().schedule(50, 0.0, PERIOD, way)  # a mean over a period is known at its end
        np.testing.assert_array_equal(at_once.newest[first:], np.arange(50 - first))


def test_packets_are_lost_as_often_and_as_long_as_asked() -> None:
    lost = Network(loss=0.2, burst=4.0, seed=3)._lost(np.random.default_rng(3), 200_000)
    begins = np.flatnonzero(np.diff(lost.astype(int)) == 1)
    assert lost.mean() == pytest.approx(0.2, abs=0.01)
    assert lost.sum() / len(begins) == pytest.approx(4.0, rel=0.05)
    there = Network(jitter=0.02, loss=0.2, burst=4.0).schedule(2000, 0.1, PERIOD, 0)
    assert (np.diff(there.newest) >= 0).all()
    assert (np.arange(2000)[200:] - there.newest[200:]).min() >= 100


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10_000), st.sampled_from([0.0, 0.01, 0.03]), st.floats(0.0, 0.45), st.sampled_from([1.0, 3.0, 40.0])
)
def test_what_is_played_out_has_no_more_energy_than_was_sent(
    seed: int, jitter: float, loss: float, burst: float
) -> None:
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(size=800)) * 0.1 + rng.normal(size=800) + 3.0 * rng.normal()
    _, both = played(steps, Network(jitter, loss, burst, seed).schedule(800, 0.02, PERIOD, 0))
    assert (both[:, 3] <= both[:, 1] * (1 + 1e-9)).all()


def test_a_hold_would_make_energy_of_the_same_packets() -> None:
    """What the rule above keeps from: the last wave, held while none arrives."""
    wave, beyond = np.random.default_rng(5).normal(size=2000), []
    for seed in range(20):
        late = Network(loss=0.4, burst=10.0, seed=seed).schedule(2000, 0.0, PERIOD, 0)
        held = np.where(late.newest >= 0, wave[late.newest], 0.0)
        beyond.append(np.max(np.cumsum(held**2) - np.cumsum(wave**2)) / np.sum(wave**2))
    assert max(beyond) > 0.05


def test_a_buffer_outlasts_bursts() -> None:
    network = Network(loss=0.15, burst=4.0, seed=9)
    late = network.schedule(100_000, 0.05, PERIOD, 0)
    missing = np.flatnonzero(np.diff((late.due[late.buffer :] < 0).astype(int)) == 1)
    bursts = np.flatnonzero(np.diff(network._lost(np.random.default_rng(0), 100_000).astype(int)) == 1)
    assert len(missing) < 0.003 * len(bursts)
    assert Network().wait(PERIOD) == 0


def test_loss_within_the_buffer_costs_a_smooth_wave_nothing() -> None:
    """Its integral comes out whole, a buffer later, and nearly all of its energy."""
    wave = np.sin(2 * np.pi * 1.3 * np.arange(4000) * PERIOD)
    late = Network(jitter=0.02, loss=0.1, seed=2).schedule(4000, 0.05, PERIOD, 0)
    out, both = played(wave, late)
    d = late.buffer
    assert d == 71
    np.testing.assert_allclose(both[d:, 2], both[:-d, 0], atol=0.05 * PERIOD)
    assert both[-1, 3] == pytest.approx(both[-1 - d, 1], rel=1e-4)
    assert np.abs(out[d:] - wave[:-d]).max() < 0.03


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"jitter": -0.1}, "jitter"),
        ({"jitter": "much"}, "jitter"),
        ({"loss": 0.9}, "loss"),
        ({"burst": 0.5}, "burst"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
    ],
)
def test_a_network_that_makes_no_sense_is_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Network(**bad)
