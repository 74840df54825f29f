"""A law that is a little off is off in the same way at every poke: intervals don't shrink with their number."""

from __future__ import annotations

import numpy as np

import kinid
from kinid.contact.kinds_of_motion import kinds_of_motion

#: 95 % of 30 are 28.5; as many as 7 misses have a chance of 1 in 5000 then. Blocks of time alone hold half of the values
LOGS, FEWEST = 30, 23


def test_kinds_of_motion() -> None:
    """The air and thirds of the depths; each way and none; nothing where all is alike."""
    depth = np.array([-1.0, -2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0]) * 1e-3
    rate = np.array([0.0, 0.01, 1.0, -1.0, 0.0, 0.0, 1.0, -1.0])
    deep, way = kinds_of_motion(depth, rate, np.zeros(8))
    np.testing.assert_array_equal(deep, [0, 0, 1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(way, [1, 1, 2, 0, 1, 1, 2, 0])
    assert kinds_of_motion(-np.abs(depth)) == []


def test_intervals_hold_where_the_law_is_a_little_off() -> None:
    """Stiffness 1 kN/m, and a force that waves by 1 % of its greatest over the depth, another wave in each log."""
    t = np.arange(0.0, 40.0, 0.01)
    depth = 1.5e-3 - 2.5e-3 * np.cos(2 * np.pi * 0.5 * t)
    held = 0
    for seed in range(LOGS):
        rng = np.random.default_rng(seed)
        wave = np.sin(2 * np.pi * depth / rng.uniform(3e-3, 9e-3) + rng.uniform(0, 2 * np.pi))
        force = np.where(depth > 0, 1000.0 * depth + 0.04 * wave, 0.0) + 0.01 * rng.standard_normal(len(t))
        fit = kinid.Model("hooke").fit(kinid.Log(t, contact={"depth": depth, "normal_force": force}), kinid.Rig())
        held += fit["stiffness"].low <= 1000.0 <= fit["stiffness"].high
    assert held >= FEWEST
