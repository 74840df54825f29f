"""Recursive estimators, time a sample: least squares over a log beside others, and one sample at a time in a loop.

Run with `pytest tests/benchmarks/test_recursive.py --benchmark-enable -s`. Everything runs in one thread.
"""

from __future__ import annotations

import gc
import time

import numpy as np
import pytest
from scripted import RIG, scripted_poke

from kinid.contact.online import OnlineContact, OnlineEstimator
from kinid.data.rig import Rig
from kinid.estimators import (
    Constant,
    HuntCrossleyKalman,
    KelvinVoigt,
    RecursiveLeastSquares,
    Scheduled,
    SingleStage,
    TwoStage,
)

N = 100_000
TRUTH = np.array([1.0, 2.0, 3.0, 4.0])
NAMES = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def log():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(N, 4))
    return rows, rows @ TRUTH + 0.1 * rng.normal(size=N), np.arange(N) * 1e-3


def best_of(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


@pytest.mark.parametrize(
    "estimator",
    [
        RecursiveLeastSquares(NAMES, Constant(0.99)),
        RecursiveLeastSquares(NAMES, Scheduled(5.0, 2.0)),
        RecursiveLeastSquares(NAMES, Constant(0.99), directional=True),
        RecursiveLeastSquares(NAMES, Constant(0.99), excitation=None),
    ],
    ids=["exponential", "scheduled", "directional", "without excitation"],
)
def test_batch(benchmark, log, estimator):
    track = benchmark.pedantic(estimator.run, log, rounds=20, warmup_rounds=2)
    np.testing.assert_allclose(track.theta[-1], TRUTH, atol=0.2)
    if benchmark.stats:
        print(
            f"\n{1e6 * benchmark.stats.stats.min / N:.4f} µs a sample (median "
            f"{1e6 * benchmark.stats.stats.median / N:.4f})"
        )


def test_ratio_to_others(benchmark, log):
    """padasip and filterpy do the same update from Python; both keep only what the loop stores."""
    padasip = pytest.importorskip("padasip")
    filterpy = pytest.importorskip("filterpy.kalman")
    rows, y, _ = log
    few = 2000
    estimator = RecursiveLeastSquares(NAMES, Constant(0.99))
    benchmark.pedantic(estimator.run, (rows, y), rounds=3, warmup_rounds=1)

    def with_padasip():
        return padasip.filters.FilterRLS(n=4, mu=0.99, eps=1e-3, w="zeros").run(y[:few], rows[:few])

    def with_kalman():
        kalman = filterpy.KalmanFilter(dim_x=4, dim_z=1)
        kalman.P *= 1e6
        kalman.Q[:] = 0.0
        kalman.R[:] = 1.0
        kalman._alpha_sq = 1.0 / 0.99  # fading memory: exponential forgetting
        history = np.empty((few, 4))
        for k in range(few):
            kalman.H = rows[k : k + 1]
            kalman.predict()
            kalman.update(y[k])
            history[k] = kalman.x[:, 0]
        return history

    own = best_of(lambda: estimator.run(rows, y), 10) / N
    others = {
        "padasip FilterRLS": best_of(with_padasip, 3) / few,
        "filterpy KalmanFilter": best_of(with_kalman, 3) / few,
    }
    np.testing.assert_allclose(with_kalman()[-1], estimator.run(rows[:few], y[:few]).theta[-1], rtol=1e-4)
    listed = [f"{name} {1e6 * taken:.1f} µs, {taken / own:.0f} times" for name, taken in others.items()]
    print(f"\nkinid {1e6 * own:.4f} µs a sample; {'; '.join(listed)}")


@pytest.mark.parametrize("kind", ["least squares", "single stage", "Kalman bank"])
def test_online(benchmark, log, kind):
    """One sample through `update`, from Python: what a 1 kHz loop pays."""
    rows, y, t = log
    depth = 0.006 + 0.004 * np.sin(2 * np.pi * 1.3 * t)
    rate = 0.004 * 2 * np.pi * 1.3 * np.cos(2 * np.pi * 1.3 * t)
    force = (2000.0 + 100.0 * rate) * depth**1.4 + 0.02 * y / np.abs(y).max()
    if kind == "least squares":
        samples = list(zip(rows, y))
        online = RecursiveLeastSquares(NAMES, Constant(0.99)).online()
    else:
        samples = list(zip(depth, rate, force))
        online = (SingleStage() if kind == "single stage" else HuntCrossleyKalman()).online()
    for sample in samples[:2000]:
        online.update(*sample)
    taken = []
    for sample in samples[2000:12000]:
        start = time.perf_counter_ns()
        online.update(*sample)
        taken.append(time.perf_counter_ns() - start)
    median, late = np.percentile(taken, [50, 99.9]) / 1e3
    print(f"\n{kind}: update {median:.1f} µs, p99.9 {late:.1f} µs")
    assert benchmark(online.update, *samples[0]).updates > 10_000


def durations(work, calls, period=0.0):
    """Time that each call of `work` takes [µs]; with a period [s], calls begin that far apart."""
    taken = np.empty(len(calls))
    begin = time.perf_counter()
    for i, call in enumerate(calls):
        while time.perf_counter() < begin + i * period:
            pass
        start = time.perf_counter_ns()
        work(*call)
        taken[i] = time.perf_counter_ns() - start
    return 1e-3 * taken


def nothing(duration):
    """Spin for so long [µs]."""
    end = time.perf_counter_ns() + int(1e3 * duration)
    while time.perf_counter_ns() < end:
        pass


KINDS = {
    "Kelvin-Voigt": KelvinVoigt(),
    "single stage": SingleStage(),
    "scheduled": SingleStage(forgetting=Scheduled(5.0, 2.0)),
    "two stages": TwoStage(),
    "Kalman bank": HuntCrossleyKalman(),
}


@pytest.mark.parametrize("kind", KINDS)
def test_from_raw_joints_and_wrench_to_estimate(benchmark, kind, capsys):
    """What a control loop pays, beside a loop that does nothing for as long: what the machine itself takes.

    All calls of all passes count, none is picked. Back to back, and 1 ms apart with the processor kept awake, as in a
    loop at 1 kHz: then whatever else runs on the machine has taken the caches, and the rare late call is later.
    """
    poke = scripted_poke(seed=1)
    loop = OnlineEstimator(OnlineContact(Rig.parse_text(RIG + f"bias = {poke.bias.tolist()}\n")), KINDS[kind].online())
    samples = list(zip(poke.log.t.tolist(), poke.log.q, poke.log.wrench))

    def one_pass(calls=samples, period=0.0):
        loop.reset()
        return durations(loop.update, calls, period)

    first = benchmark.pedantic(one_pass, rounds=1)
    assert loop.estimator.estimate.updates > 1000
    if kind == "Kelvin-Voigt":
        assert loop.estimator.values[0] == pytest.approx(poke.material.stiffness, rel=0.02)
    if benchmark.disabled:
        return
    duration = float(np.median(first))
    gc.collect()
    gc.freeze()
    gc.disable()  # a control loop collects garbage when it has time
    try:
        lines = []
        for name, calls, period, passes in (("back to back", samples, 0.0, 8), ("1 ms apart", samples[:3000], 1e-3, 1)):
            own, idle = [], []
            for _ in range(passes):
                own.append(one_pass(calls, period))
                idle.append(durations(nothing, [(duration,)] * len(calls), period))
            figures = [np.quantile(np.concatenate(some), [0.5, 0.99, 0.999]) for some in (own, idle)]
            shown = ["median {:.1f}, p99 {:.1f}, p99.9 {:.1f} µs".format(*some) for some in figures]
            lines.append(f"online, {kind}, {name}: {shown[0]} (doing nothing for as long: {shown[1]})")
            if not period:
                verdict = "PASS" if figures[0][2] <= 20.0 else "FAIL"
                lines.append(f"{verdict} online, {kind}: p99.9 {figures[0][2]:.1f} µs (≤ 20)")
    finally:
        gc.enable()
        gc.unfreeze()
    with capsys.disabled():
        print("\n" + "\n".join(lines))
