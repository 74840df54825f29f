"""How much faster than real time the closed loop runs, and how long a campaign takes."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from kinid.lab import campaign
from kinid.lab.experiments import prepare
from kinid.lab.loop import Loop


def test_closed_loop(benchmark) -> None:
    setup = prepare("poke")
    q0 = setup.check()
    positions, rotations = setup.script.poses(setup.axes, np.asarray(setup.point))
    loop = Loop(setup.arm, setup.joints, setup.gains, setup.axes, np.asarray(setup.point))
    loop.run(q0, positions[:5], rotations[:5], setup.material)
    began = time.perf_counter()
    benchmark(loop.run, q0, positions, rotations, setup.material)
    took = time.perf_counter() - began if benchmark.stats is None else benchmark.stats.stats.min
    print(f"closed loop, elastic joints, 1 kHz control, 4 kHz integration: {len(positions) * 1e-3 / took:.0f} times real time")


@pytest.mark.slow
def test_hundred_pokes(tmp_path: Path) -> None:
    prepare("poke").run()  # compiled
    began = time.perf_counter()
    assert campaign.run(campaign.Campaign(), tmp_path) == 100
    print(f"a campaign of 100 pokes: {time.perf_counter() - began:.1f} s")
