"""How long a diagnosis takes, and how much memory.

A normal run compares results alone; `pytest tests/benchmarks --benchmark-enable --benchmark-only -s` takes times and
prints them beside what they should be. No time is ever asserted.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden.cases import case
from hidden.limited import cropped
from hidden.study import jobs
from numpy.typing import NDArray
from scipy.signal import lfilter

import kinid

Array = NDArray[np.float64]

#: what is asked for: seconds of a log of 60 s at 500 Hz and of 600 s at 1 kHz, GiB
SHORT_S, LONG_S, MEMORY_GIB = 5.0, 30.0, 1.0
MODEL = ("kelvin-voigt", "coulomb-friction")
RATIO, TAU = 0.25, 0.6
#: kinds of the hidden suite's logs that are timed
MINUTES = ("single", "pair", "none", "outside")


def sliding(seconds: float, rate: float) -> kinid.Log:
    """Pokes, holds and slides without end on a material that relaxes, which the model lacks; the whole catalogue of a
    tester.
    """
    n = round(seconds * rate)
    t = np.arange(n) / rate
    rng = np.random.default_rng(0)
    # twelve seconds: air, a hold, pokes that grow faster, slides along both tangents
    at = t % 12.0
    depth = np.interp(at, [0, 1, 1.2, 3, 8, 11, 11.3, 12], [-1e-3, -1e-3, 2.5e-3, 2.5e-3, 2.5e-3, 2.5e-3, -1e-3, -1e-3])
    depth = depth + 0.8e-3 * np.sin(2 * np.pi * 0.25 * (at - 3) ** 2 / 2) * ((at > 3) & (at < 11))
    slip = np.stack(
        [
            3e-3 * np.sin(2 * np.pi * 0.5 * (at - 6)) * (at > 6) * (at < 8),
            3e-3 * np.sin(2 * np.pi * 0.5 * (at - 8)) * (at > 8) * (at < 10),
        ]
    )
    smooth = np.hanning(round(0.06 * rate))
    depth, slip = (np.apply_along_axis(np.convolve, -1, x, smooth / smooth.sum(), "same") for x in (depth, slip))
    depth_rate = np.gradient(depth, 1 / rate)
    elastic = 900 * np.maximum(depth, 0)
    a = np.exp(-1 / (rate * TAU))
    held = lfilter([1 - a], [1, -a], elastic)
    normal = np.where(depth > 0, np.maximum(elastic - RATIO * held, 0) + 5 * depth_rate, 0.0)
    rub = -0.35 * np.maximum(normal, 0) * _direction(np.diff(slip, axis=1, prepend=slip[:, :1]), depth > 0)
    noise = 0.02 * rng.standard_normal((3, n))
    phase = np.array(["free", "approach", "hold", "poke", "slide", "retract"])[
        np.searchsorted([1, 1.2, 3, 6, 11], at, side="right")
    ]
    phase[at > 11.4] = "free"
    return kinid.Log(
        t=t,
        phase=phase,
        contact={
            "depth": depth,
            "normal_force": normal + noise[0],
            "slip1": slip[0],
            "slip2": slip[1],
            "tangential_force1": rub[0] + noise[1],
            "tangential_force2": rub[1] + noise[2],
        },
    )


def _direction(steps: Array, inside: NDArray[np.bool_]) -> Array:
    """Of friction, (2, n): it turns into that of the slip within 0.1 mm, and a touch begins without any."""
    out, x, y = np.zeros_like(steps), 0.0, 0.0
    for i, (dx, dy, touches) in enumerate(zip(*steps.tolist(), inside.tolist())):
        size = (dx * dx + dy * dy) ** 0.5
        keep = math.exp(-size / 1e-4)
        x, y = (dx / size + (x - dx / size) * keep, dy / size + (y - dy / size) * keep) if size > 0 else (x, y)
        if not touches:
            x = y = 0.0
        out[:, i] = x, y
    return out


def report(seconds: float, rate: float) -> None:
    """For a process of its own: time of a diagnosis, without what is loaded and compiled once, and the most memory
    held.
    """
    import resource

    kinid.diagnose(sliding(24.0, 250.0), kinid.Rig(), model=kinid.Model(*MODEL))
    log = sliding(seconds, rate)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began, busy, said = time.perf_counter(), time.process_time(), []
    found = kinid.diagnose(log, kinid.Rig(), model=kinid.Model(*MODEL), progress=said.append)
    took, busy = time.perf_counter() - began, time.process_time() - busy
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(took, busy, before / 2**20, most / 2**20, len(said), *found.added)


def test_what_is_timed_is_right() -> None:
    """The timed log, in short: the effect that the model lacks, and nothing else that a touch has."""
    found = kinid.diagnose(sliding(36.0, 250.0), kinid.Rig(), model=kinid.Model(*MODEL))
    assert found.added[:1] == ("relaxation",)
    ratio, tau = (found["relaxation"].parameters[name].value for name in ("ratio", "time-constant"))
    assert ratio == pytest.approx(RATIO / (1.0 - RATIO), rel=0.05)  # beside what lasts
    assert tau == pytest.approx(TAU, rel=0.05)


@pytest.mark.benchmark
@pytest.mark.parametrize(("seconds", "rate", "asked"), [(60.0, 500.0, SHORT_S), (600.0, 1000.0, LONG_S)])
def test_time_and_memory(
    seconds: float, rate: float, asked: float, benchmark: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    if benchmark.disabled:
        pytest.skip("takes times: pytest tests/benchmarks --benchmark-enable")
    here = Path(__file__)
    code = f"import sys; sys.path[:0] = [{str(here.parent)!r}]; import {here.stem} as m; m.report({seconds}, {rate})"
    out: list[str] = []

    def run() -> None:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        assert done.returncode == 0, done.stderr
        out[:] = done.stdout.split()

    benchmark.pedantic(run, rounds=1)
    took, busy, before, most = map(float, out[:4])
    assert out[5] == "relaxation"
    assert int(out[4]) >= 4  # progress was told
    with capsys.disabled():
        what = f"diagnosis of {seconds:.0f} s at {rate:.0f} Hz"
        mark = "PASS" if took <= asked else "FAIL"
        print(f"\n{mark} {what}: {took:.1f} s, {busy:.1f} s of cores (≤ {asked:g}); found {', '.join(out[5:])}")
        print(
            f"{'PASS' if most <= MEMORY_GIB else 'FAIL'} {what}: {most:.2f} GiB held at most (≤ {MEMORY_GIB:g}), "
            f"{before:.2f} GiB of them before it began"
        )


@pytest.mark.benchmark
def test_time_of_the_hidden_suite(benchmark: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """What the second simulator hides, its logs cut to a minute: how many answers take no longer than is asked for."""
    if benchmark.disabled:
        pytest.skip("takes times: pytest tests/benchmarks --benchmark-enable")
    took: list[tuple[float, str]] = []

    def run() -> None:
        for job in jobs():
            if job.kind not in MINUTES:
                continue
            hidden = case(job.kind, job.number, job.seed, job.world)
            log = cropped(hidden.log, slice(0, int((hidden.log.t < hidden.log.t[0] + 60.0).sum())))
            if not took:  # what is compiled once
                kinid.diagnose(log, hidden.rig, model=kinid.Model(*hidden.model))
            began = time.perf_counter()
            found = kinid.diagnose(log, hidden.rig, model=kinid.Model(*hidden.model))
            took.append((time.perf_counter() - began, f"{hidden.name} ({', '.join(found.added) or found.verdict})"))

    benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        within = sum(seconds <= SHORT_S for seconds, _ in took)
        mark, median = "PASS" if within == len(took) else "FAIL", np.median([seconds for seconds, _ in took])
        print(
            f"\n{mark} diagnosis of 60 s with hidden effects: {within} of {len(took)} logs within {SHORT_S:g} s, "
            f"median {median:.1f} s"
        )
        for seconds, name in sorted(took, reverse=True)[:5]:
            print(f"  {seconds:.1f} s {name}")
