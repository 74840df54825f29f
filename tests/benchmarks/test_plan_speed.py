"""Speed of planning, one thread. A normal run checks results alone; `--benchmark-enable -s` takes times."""

from __future__ import annotations

import time
from typing import Any

import pytest

import kinid
from kinid.planning import Law, Multisine, Planner, Poke, grid, shortest_tour
from kinid.planning.excite import optimise
from kinid.planning.poke_design import Bounds

TABLES: dict[str, Any] = {
    "robot": {"model": "lwr4plus"},
    "tool": {"mass": 0.24, "com": (0.0, 0.0, 0.049)},
    "surface": {"point": (0.55, 0.0, 0.10), "normal": (0, 0, 1), "tangent": (1, 0, 0)},
}


def least(run: Any, rounds: int) -> float:
    """The quickest of some rounds: what else the machine does only ever adds [s]."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def test_planning(benchmark: Any, capsys: pytest.CaptureFixture[str]) -> None:
    rig = kinid.Rig.parse(TABLES)
    law = Law(kinid.Model("hunt-crossley"), {"stiffness": 1200.0, "damping": 1500.0, "exponent": 1.2})
    motion = benchmark(lambda: Planner(rig, law=law).plan([Poke()]))
    assert motion.place is not None
    assert motion.place[:, 2].max() > 0.004
    if benchmark.disabled:
        return
    short = Multisine(0.003, ((0.0015, 0.9), (0.0005, 5.0)), 3.0)
    places = grid(10, 10, 0.01)

    def campaign() -> None:
        order = shortest_tour(places)
        Planner(rig, law=law).plan([Poke(places[k], short, 0.4) for k in order])

    figures = {
        "one poke": (least(lambda: Planner(rig, law=law).plan([Poke()]), 10), 0.050),
        "a campaign of 100 pokes": (least(campaign, 3), 3.0),
        "an optimised excitation": (
            least(lambda: optimise(law, Bounds(force=8.0, speed=0.15), criterion="A"), 2),
            10.0,
        ),
    }
    with capsys.disabled():
        print()
        for name, (seconds, asked) in figures.items():
            print(
                f"{'PASS' if seconds <= asked else 'FAIL'} planning {name}: {1e3 * seconds:.0f} ms (≤ "
                f"{1e3 * asked:.0f})"
            )
