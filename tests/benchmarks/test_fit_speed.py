"""Speed of offline fits, one thread, beside others in one run.

A normal run compares results alone; `pytest tests/benchmarks --benchmark-enable --benchmark-only -s` takes times.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from kinid.estimators.power_law import fit_power_law

Array = NDArray[np.float64]

TRUTH = (2500.0, 400.0, 1.3)


@pytest.fixture(scope="module")
def poke() -> tuple[Array, Array, Array]:
    """Depth, rate and force of 10 000 samples of the source study's motion."""
    t = np.arange(10_000) * 1e-3
    two_pi = 2 * np.pi
    depth = 0.012 * np.sin(two_pi * 2 * t) + 0.003 * np.sin(two_pi * 5 * t) + 0.021
    rate = two_pi * (0.024 * np.cos(two_pi * 2 * t) + 0.015 * np.cos(two_pi * 5 * t))
    force = depth ** TRUTH[2] * (TRUTH[0] + TRUTH[1] * rate)
    return depth, rate, force + np.random.default_rng(0).normal(scale=0.05, size=len(t))


def scipy_fit(depth: Array, rate: Array, force: Array) -> Array:
    """Levenberg-Marquardt of MINPACK with the analytic Jacobian."""
    log_depth = np.log(depth)

    def residual(p: Array) -> Array:
        return np.exp(p[2] * log_depth) * (p[0] + p[1] * rate) - force

    def jacobian(p: Array) -> Array:
        power = np.exp(p[2] * log_depth)
        return np.stack([power, power * rate, power * (p[0] + p[1] * rate) * log_depth], axis=1)

    return np.asarray(least_squares(residual, (1000.0, 100.0, 1.2), jacobian, method="lm", x_scale=(1e3, 1e2, 0.1)).x)


def casadi_fit(depth: Array, rate: Array, force: Array) -> Any:
    """Interior points (ipopt) with exact derivatives; building the problem is not counted."""
    casadi = pytest.importorskip("casadi")
    p = casadi.MX.sym("p", 3)
    scale = casadi.DM([1e3, 1e2, 1.0])
    q = p * scale
    r = casadi.power(depth, q[2]) * (q[0] + q[1] * rate) - force
    solver = casadi.nlpsol(
        "s", "ipopt", {"x": p, "f": casadi.sumsqr(r)}, {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    )
    return lambda: np.array(solver(x0=[1.0, 1.0, 1.2])["x"]).ravel() * [1e3, 1e2, 1.0]


def median_time(run: Any, rounds: int) -> float:
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def test_hunt_crossley_offline(
    poke: tuple[Array, Array, Array], benchmark: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    found = benchmark(fit_power_law, *poke)
    mine = np.array([found.stiffness, found.damping, found.exponent])
    reference = scipy_fit(*poke)
    np.testing.assert_allclose(mine, reference, rtol=1e-5)
    if benchmark.disabled:
        return
    own, scipy = median_time(lambda: fit_power_law(*poke), 50), median_time(lambda: scipy_fit(*poke), 20)
    line = f"Hunt-Crossley, 10 000 samples: {1e3 * own:.2f} ms, scipy LM {1e3 * scipy:.2f} ms ({scipy / own:.1f}×)"
    solver = casadi_fit(*poke)
    np.testing.assert_allclose(solver(), reference, rtol=1e-3)
    ipopt = median_time(solver, 10)
    with capsys.disabled():
        print(f"\n{line}, casadi ipopt {1e3 * ipopt:.2f} ms ({ipopt / own:.1f}×)")
        print(f"{'PASS' if own <= 2e-3 else 'FAIL'} Hunt-Crossley offline: {1e3 * own:.2f} ms (≤ 2)")
