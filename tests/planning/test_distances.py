"""How much of a distance counts where it lies unevenly in time; and signals that no few sines make."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.planning.distances import RARE, even
from kinid.planning.signals import Signal
from kinid.planning.strokes import by_turns, stairs

T = np.arange(2000) / 100.0
BLOCKS = 40


def test_what_lies_evenly_counts_in_full() -> None:
    assert even(np.ones((2, 2000)), T) == pytest.approx(1.0)
    assert even(np.zeros((1, 2000)), T) == 1.0


def test_what_lies_in_one_block_hardly_counts() -> None:
    squares = np.zeros((1, 2000))
    squares[0, :50] = 1.0
    assert even(squares, T) == RARE


def test_three_standard_errors_are_reached_where_it_says() -> None:
    """Evidence of many logs, block by block: at the amount that just suffices its mean is three of its standard
    errors.
    """
    rng = np.random.default_rng(0)
    shape = rng.uniform(0.2, 1.0, BLOCKS)  # squared distance of each block
    squares = np.repeat(shape / 50.0, 50)[None]
    amount = 36.0 / (shape.sum() * even(squares, T))  # squared
    change = np.sqrt(amount * shape)
    # the gain of a model with the change over one without, in each block: 2 d z + d², for noise z of each log
    gains = change**2 + 2 * change * rng.standard_normal((4000, BLOCKS))
    errors = np.std(gains, axis=1, ddof=1) * np.sqrt(BLOCKS)
    assert np.median(gains.sum(axis=1) / errors) == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize("signal", [by_turns(0.3, 2.7, 0.004, 18.0), stairs(0.004, 18.0)])
def test_strokes_and_stairs_use_the_whole_depth_and_no_more(signal: Signal) -> None:
    depth = signal(np.linspace(0.0, signal.duration, 5000))[0]
    assert 0.0 < depth.min() < 0.0005
    assert 0.0038 < depth.max() <= 0.004


def test_strokes_are_slow_and_fast_by_turns() -> None:
    signal = by_turns(0.5, 2.5, 0.004, 16.0)
    t = np.linspace(0.0, 16.0, 8001)
    speed = np.abs(signal(t)[1])
    slow, fast = ((t % 4.0 > low) & (t % 4.0 < low + 1.0) & (t > 1.0) & (t < 15.0) for low in (0.8, 2.8))
    assert speed[fast].max() == pytest.approx(5.0 * speed[slow].max(), rel=0.05)
