"""The guard: one answer a cycle, quick, and no for good."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from kinid.data.rig import CONTACT
from kinid.errors import InputError
from kinid.live import Guard


def sample(**values: float) -> np.ndarray:
    return np.array([values.get(name, 0.0) for name in CONTACT])


class Hands:
    """A clock that stands where it is put."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize(
    ("beyond", "says"),
    [
        ({"normal_force": 20.1}, "force beyond 20.0 N"),
        ({"normal_force": -20.1}, "force beyond 20.0 N"),
        ({"depth": 9e-3}, "depth beyond 0.008 m"),
        ({"depth_rate": -0.3}, "speed beyond 0.2 m/s"),
        ({"tangential_force1": 8.0, "tangential_force2": 8.0}, "tangential beyond 10.0 N"),
        ({"normal_force": np.nan}, "no finite number"),
        ({"tangential_force2": np.nan}, "no finite number"),
        ({"depth": np.inf}, "no finite number"),
    ],
)
def test_each_limit_says_no_for_good(beyond: dict[str, float], says: str) -> None:
    guard = Guard(force=20.0, depth=8e-3, speed=0.2, tangential=10.0, clock=Hands())
    assert guard.check(sample(normal_force=19.9, depth=7e-3, depth_rate=0.1, tangential_force1=9.0)) == guard.OK
    assert says in guard.check(sample(**beyond))
    assert says in guard.check(sample())  # it stays so
    guard.reset()
    assert guard.check(sample()) == guard.OK


def test_a_dead_mans_time() -> None:
    hands = Hands()
    guard = Guard(dead_man=0.02, clock=hands)
    for _ in range(5):
        hands.now += 0.019
        assert guard.check(sample()) == guard.OK
    hands.now += 0.01
    assert guard.check(None) == guard.OK  # no new sample, within the time
    hands.now += 0.0101
    assert guard.check(sample()) == "no sample for more than 0.02 s"  # too late, even with one
    guard.reset()
    guard.trip("a border")
    guard.trip("something later")
    assert guard.check(sample()) == "a border"


@pytest.mark.parametrize("wrong", [{"force": 0.0}, {"depth": -1.0}, {"dead_man": np.nan}, {"speed": np.inf}])
def test_limits_that_are_none(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="a positive number"):
        Guard(**wrong)  # type: ignore[arg-type]


def test_it_takes_microseconds() -> None:
    guard, values, times = Guard(force=20.0, depth=8e-3, speed=1.0, dead_man=60.0), sample(normal_force=3.0), []
    for _ in range(20_000):
        begin = time.perf_counter_ns()
        guard.check(values)
        times.append(time.perf_counter_ns() - begin)
    median, p99 = np.percentile(times, [50, 99]) / 1e3
    print(f"median {median:.2f} µs, 99 % {p99:.2f} µs, longest {max(times) / 1e3:.0f} µs")
    assert median < 5.0  # asked for; the longest are those in which something else ran


@pytest.mark.parametrize(
    "bad", [[1.0] * 9, np.zeros(3), "touch", np.array(["a"] * 9)], ids=["list", "short", "text", "words"]
)
def test_what_is_no_sample_is_a_no(bad: Any) -> None:
    guard = Guard(force=20.0, dead_man=10.0)
    assert "no contact quantities" in guard.check(bad)
