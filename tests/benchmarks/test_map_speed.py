"""Speed of maps, one thread, beside scipy's and scikit-learn's on the same surface in one run.

A normal run compares results alone; `pytest tests/benchmarks --benchmark-enable --benchmark-only -s` takes times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from kinid.mapping.interpolation import PlaneSites
from kinid.mapping.interpolation.gaussian_process import GaussianProcess, interpolator
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane
from kinid.viewer import scene as scenes

Array = NDArray[np.float64]
Surface = tuple[Array, Array, float, Array, Array]


def franke(p: Array) -> Array:
    """Franke's test surface (1982) on the square of 0.1 m."""
    x, y = 90 * p[:, 0], 90 * p[:, 1]
    out: Array = (
        0.75 * np.exp(-((x - 2) ** 2 + (y - 2) ** 2) / 4)
        + 0.75 * np.exp(-((x + 1) ** 2) / 49 - (y + 1) / 10)
        + 0.5 * np.exp(-((x - 7) ** 2 + (y - 3) ** 2) / 4)
        - 0.2 * np.exp(-((x - 4) ** 2) - (y - 7) ** 2)
    )
    return out


@pytest.fixture(scope="module")
def surface() -> Surface:
    """600 probes with 1 % noise, and 200 × 200 queries with their truth."""
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 0.1, (600, 2))
    truth = franke(places)
    noise = 0.01 * float(np.ptp(truth))
    ticks = np.linspace(0, 0.1, 200)
    queries = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    return places, truth + noise * rng.standard_normal(600), noise, queries, franke(queries)


def ours(surface: Surface) -> GaussianProcess:
    places, values, noise, _, _ = surface
    return GaussianProcess.fit(PlaneSites(places, reach=1.0), values, np.full(len(values), noise))


def scipy_rbf(surface: Surface) -> RBFInterpolator:
    """Thin plates with the smoothing that leaving out would choose; no uncertainty."""
    places, values, _, _, _ = surface
    return RBFInterpolator(10 * places, values, smoothing=1e-3)


def scikit_learn(surface: Surface) -> Any:
    """The same Matérn process, its kernel learnt on all probes."""
    process = pytest.importorskip("sklearn.gaussian_process")
    kernels = pytest.importorskip("sklearn.gaussian_process.kernels")
    places, values, noise, _, _ = surface
    kernel = kernels.ConstantKernel(1.0) * kernels.Matern(0.02, (1e-3, 1.0), nu=2.5)
    return process.GaussianProcessRegressor(kernel, alpha=(noise / values.std()) ** 2, normalize_y=True).fit(
        places, values
    )


def timed(work: Callable[[], Any], rounds: int = 3) -> float:
    """The shortest of a few rounds [s]."""
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return float(best)


def grown(surface: Surface, count: int) -> PropertyMap:
    places, values, noise, _, _ = surface
    probes = [
        Probe(np.array([*p, 0.0]), np.array([1e3 * (v + 1)]), np.array([[(1e3 * noise) ** 2]]), source=str(i))
        for i, (p, v) in enumerate(zip(places[:count], values[:count]))
    ]
    return PropertyMap(Plane(np.zeros(3), np.eye(3)), (Property("stiffness", "N/m"),), tuple(probes), "truth")


def test_all_three_find_the_surface(surface: Surface) -> None:
    """Normalised error at most 1.0 %, and as scikit-learn's within a fifth."""
    *_, queries, truth = surface
    some = slice(None, None, 13)
    span = float(np.ptp(truth))
    mine = float(np.sqrt(np.nanmean((ours(surface).at(queries[some]).mean - truth[some]) ** 2))) / span
    theirs = float(np.sqrt(np.mean((scikit_learn(surface).predict(queries[some]) - truth[some]) ** 2))) / span
    rbf = float(np.sqrt(np.mean((scipy_rbf(surface)(10 * queries[some]) - truth[some]) ** 2))) / span
    print(f"normalised error: kinid {100 * mine:.2f} %, scikit-learn {100 * theirs:.2f} %, scipy {100 * rbf:.2f} %")
    assert mine <= 0.010
    assert mine < 1.2 * theirs
    assert rbf < 0.03


def test_the_speed_of_a_map(benchmark: Any, surface: Surface) -> None:
    """600 probes with uncertainty; an added probe; 200 × 200 queries with and without uncertainty; beside the
    others.
    """
    *_, queries, _ = surface
    places, values, noise, _, _ = surface
    whole = ours(surface)

    def first() -> None:
        ours(surface).at(queries[:100])

    benchmark.pedantic(first, rounds=3, warmup_rounds=1)
    if not benchmark.enabled:
        return
    fit = timed(first)
    added = timed(lambda: whole.added(places[0] + 1e-4, float(values[0]), noise))
    asked, asked_sd = timed(lambda: whole.at(queries, sd=False)), timed(lambda: whole.at(queries))
    sk, rbf = timed(lambda: scikit_learn(surface), 1), timed(lambda: scipy_rbf(surface)(10 * queries), 2)
    flat = timed(lambda: interpolator("triangles", PlaneSites(places), values, np.full(600, noise)).at(queries), 2)
    print(
        f"\n600 probes {fit:.3f} s ({sk / fit:.1f} × faster than scikit-learn's fit); added {1e3 * added:.2f} ms; "
        f"200 × 200 queries {asked:.3f} s, with uncertainty {asked_sd:.3f} s; scipy's spline with its queries "
        f"{rbf:.2f} s; "
        f"triangles with their queries {flat:.2f} s"
    )


def test_the_speed_of_the_viewers_colours(benchmark: Any, surface: Surface) -> None:
    """10 000 cells coloured anew after a probe: what a growing map costs before the browser draws it."""
    known = grown(surface, 200)
    scene = benchmark(lambda: scenes.map_scene(known, method="nearest", cells=100))
    assert scene["vertices"] >= 10_000
    guess = known.interpolator("stiffness").at(known.flat(known.places))
    colour = scenes.colours(guess.mean, 0.0, 1.0, scenes.VIRIDIS, guess.sd)
    if benchmark.enabled:
        took = timed(lambda: scenes.colours(guess.mean, 0.0, 1.0, scenes.VIRIDIS, guess.sd))
        print(f"\ncolours of {len(colour)} places: {1e6 * took:.0f} µs")
