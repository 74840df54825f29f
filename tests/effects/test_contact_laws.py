"""Contact laws against references that share no code with them: hand formulas, scipy's integrators, and energy."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from kinid.effects import Layout, Signals, get
from kinid.effects.relaxation import Relaxation
from kinid.effects.stiffness_inhomogeneity import StiffnessInhomogeneity
from kinid.errors import InputError
from kinid.kernels import memory
from kinid.modeling.model import Model

Array = NDArray[np.float64]
CHANNELS = ("normal_force", "tangential_force1", "tangential_force2")
#: compiled kernels are loaded within the first example
QUICK = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def signals(
    t: Array, depth: Array, rate: Array, slips: Array | None = None, slip_rates: Array | None = None
) -> Signals:
    """Signals of one stretch of time."""
    none = np.zeros((2, len(t)))
    return Signals(
        Layout(CHANNELS, "contact"),
        t,
        np.diff(t, prepend=t[0]),
        depth,
        rate,
        none if slips is None else slips,
        none if slip_rates is None else slip_rates,
    )


def spline(knots: list[tuple[float, float]]) -> CubicSpline:
    """Smooth motion through knots (time [s], value [mm]), at rest at both ends; value in m."""
    t, value = np.array(knots).T
    return CubicSpline(t, 1e-3 * value, bc_type="clamped")


def uneven(length: float, n: int, seed: int = 0) -> Array:
    """Times from 0 to `length` whose steps differ by a factor of ten."""
    steps = np.random.default_rng(seed).uniform(0.2, 2.0, n)
    return np.asarray(length * (np.cumsum(steps) - steps[0]) / (steps.sum() - steps[0]))


POKES = spline(
    [(0, -1), (0.4, 2), (0.9, 2), (1.1, 1), (1.3, 3), (1.8, -1), (2.2, 4), (3.4, 3.9), (3.8, -1.2), (4.0, -1)]
)


def poke(n: int = 6000) -> Signals:
    """Two touches with a hold and partial unloading."""
    t = uneven(4.0, n)
    return signals(t, POKES(t), POKES(t, 1))


def normal(model: Model, s: Signals, **values: float) -> Array:
    """Normal force; names of values have "__" for "." and "_" for "-"."""
    named = {name.replace("__", ".").replace("_", "-"): value for name, value in values.items()}
    return model.predict(s, named)[0]


# ---- by hand --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "values", "formula"),
    [
        (("hooke",), {"hooke__stiffness": 700.0}, lambda d, v: 700 * d),
        (
            ("kelvin-voigt",),
            {"kelvin_voigt__stiffness": 700.0, "kelvin_voigt__damping": 9.0},
            lambda d, v: 700 * d + 9 * v,
        ),
        (("hertz",), {"hertz__stiffness": 2e4}, lambda d, v: 2e4 * d**1.5),
        (
            ("hunt-crossley",),
            {"hunt_crossley__stiffness": 3e3, "hunt_crossley__damping": 2e3, "hunt_crossley__exponent": 1.3},
            lambda d, v: 3e3 * d**1.3 + 2e3 * d**1.3 * v,
        ),
        (
            ("hooke", "hertz-exponent"),
            {"hooke__stiffness": 3e3, "hertz_exponent__exponent": 1.3},
            lambda d, v: 3e3 * d**1.3,
        ),
        (
            ("hertz", "hertz-exponent"),
            {"hertz__stiffness": 3e3, "hertz_exponent__exponent": 1.2},
            lambda d, v: 3e3 * d**1.2,
        ),
        (
            ("hertz", "viscous-damping"),
            {"hertz__stiffness": 2e4, "viscous_damping__damping": 9.0},
            lambda d, v: 2e4 * d**1.5 + 9 * v,
        ),
        (
            ("hertz", "hunt-crossley-damping"),
            {"hertz__stiffness": 2e4, "hunt_crossley_damping__damping": 0.7},
            lambda d, v: 2e4 * d**1.5 * (1 + 0.7 * v),
        ),
        (
            ("hooke", "stiffening-layer"),
            {"hooke__stiffness": 700.0, "stiffening_layer__stiffness": 400.0, "stiffening_layer__depth": 1.7e-3},
            lambda d, v: 700 * d + 400 * max(0.0, d - 1.7e-3),
        ),
    ],
)
def test_laws_without_memory(model: tuple[str, ...], values: dict[str, float], formula: Callable[..., float]) -> None:
    s = poke(900)
    expected = [formula(float(d), float(v)) if d > 0 else 0.0 for d, v in zip(s.depth, s.depth_rate)]
    np.testing.assert_allclose(normal(Model(*model), s, **values), expected, rtol=1e-12, atol=1e-12)


def test_kelvin_voigt_pulls_at_separation_and_hunt_crossley_does_not() -> None:
    s = poke()
    assert normal(Model("kelvin-voigt"), s, kelvin_voigt__stiffness=500.0, kelvin_voigt__damping=10.0).min() < -0.01
    damped = normal(Model("hunt-crossley"), s, hunt_crossley__stiffness=500.0, hunt_crossley__damping=5000.0)
    assert damped.min() == 0.0  # λ = B/K = 10 s/m, and no speed above 30 mm/s


def test_a_layer_and_an_offset_add_to_depth() -> None:
    s = poke()
    shifted = signals(s.t, s.depth + 3e-4, s.depth_rate)
    np.testing.assert_array_equal(
        normal(Model("hertz", "surface-offset"), s, surface_offset__offset=3e-4), normal(Model("hertz"), shifted)
    )


def test_drift_is_per_minute() -> None:
    t = np.linspace(0, 120, 50)
    s = signals(t, np.full(50, 1e-3), np.zeros(50))
    force = normal(Model("hooke", "stiffness-drift"), s, hooke__stiffness=1000.0, stiffness_drift__rate=0.25)
    assert force[[0, -1]] == pytest.approx([1.0, 1.5])


def test_restitution_of_hunt_crossley_damping() -> None:
    """A mass that hits K δⁿ (1 + λ δ̇) at a slow speed v leaves with e = 1 − 2/3 λ v of it."""
    stiffness, lam, mass, speed = 1e5, 0.4, 0.2, 0.05

    def fall(_: float, state: Array) -> list[float]:
        depth, rate = state
        s = signals(np.zeros(1), np.array([depth]), np.array([rate]))
        values = {"hertz.stiffness": stiffness, "hunt-crossley-damping.damping": lam}
        return [rate, -float(model.predict(s, values)[0, 0]) / mass]

    def leaves(_: float, state: Array) -> float:
        return float(state[0]) + 1e-12

    leaves.terminal, leaves.direction = True, -1  # type: ignore[attr-defined]
    model = Model("hertz", "hunt-crossley-damping")
    out = solve_ivp(fall, (0, 1.0), [0.0, speed], events=leaves, rtol=1e-9, atol=1e-12)
    lost = 1 + out.y[1, -1] / speed
    assert lost == pytest.approx(2 / 3 * lam * speed, rel=2 * lam * speed)  # the next order in λ v


# ---- relaxation -----------------------------------------------------------------------------------------------------


def network(t: Array, spring: float, branches: list[tuple[float, float]]) -> Array:
    """Force of springs and Maxwell branches (stiffness, time constant) side by side, moved by the pokes (scipy's
    DOP853).
    """

    def flow(time: float, inner: Array) -> list[float]:
        depth = max(0.0, float(POKES(time)))
        return [(depth - x) / tau for x, (_, tau) in zip(inner, branches)]

    touches = [float(root) for root in POKES.roots(extrapolate=False)]
    edges = [0.0, *touches, float(t[-1])]
    inner, state = np.zeros((len(branches), len(t))), np.zeros(len(branches))
    for a, b in zip(edges[:-1], edges[1:]):  # the input has a corner at each touch
        out = solve_ivp(flow, (a, b), state, method="DOP853", rtol=1e-11, atol=1e-16, dense_output=True)
        rows = (t >= a) & (t <= b)
        inner[:, rows], state = out.sol(t[rows]), out.y[:, -1]
    depth = np.maximum(POKES(t), 0.0)
    force = spring * depth + sum((k * (depth - x) for x, (k, _) in zip(inner, branches)), start=np.zeros(len(t)))
    return np.asarray(np.where(depth > 0, force, 0.0))


def relaxing(spring: float, *branches: tuple[float, float]) -> tuple[Model, dict[str, float]]:
    """The network as hooke + relaxation: k is the stiffness that lasts, ratios are the branches' beside it."""
    values = {"hooke.stiffness": spring}
    for end, (k, tau) in zip(("", "2", "3"), branches):
        values |= {f"relaxation.ratio{end}": k / spring, f"relaxation.time-constant{end}": tau}
    return Model("hooke", Relaxation(len(branches))), values


@pytest.mark.parametrize(
    ("model", "values", "spring", "branches"),
    [
        (Model("maxwell"), {"maxwell.stiffness": 900.0, "maxwell.time-constant": 0.3}, 0.0, [(900.0, 0.3)]),
        (
            Model("zener"),
            {"zener.stiffness": 600.0, "zener.branch-ratio": 0.75, "zener.time-constant": 0.2},
            600.0,
            [(450.0, 0.2)],
        ),
        (*relaxing(600.0, (450.0, 0.2)), 600.0, [(450.0, 0.2)]),
        (*relaxing(500.0, (450.0, 0.05), (300.0, 1.1)), 500.0, [(450.0, 0.05), (300.0, 1.1)]),
    ],
)
def test_relaxation_is_the_network_of_springs_and_dashpots(
    model: Model, values: dict[str, float], spring: float, branches: list[tuple[float, float]]
) -> None:
    errors = []
    for n in (1500, 6000):
        s = poke(n)
        force, expected = model.predict(s, values)[0], network(s.t, spring, branches)
        assert expected.min() < -0.1  # a tool that retracts faster than the material follows leaves it
        expected = np.maximum(expected, 0.0)
        errors.append(np.abs(force - expected).max())
    # straight lines between samples: dt²/8 of the force's curvature, 3 N/0.1 s² · (4 s/1500 · 2)²/8 = 1e-3 N at most,
    # and second order in the step
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 8


def test_relaxation_of_a_power_law_is_the_hereditary_integral() -> None:
    """N(t) = ∫ G(t − s) dF_e(s) with G = 1 + ρ exp(−t/τ), F_e = K δ^1.5 (Fung's quasi-linear law), by
    quadrature.
    """
    ratio, tau, stiffness = 0.6, 0.25, 2e4
    ramp = spline([(0, 0), (0.5, 3), (1.5, 2)])
    t = np.linspace(0, 1.5, 3001)
    force = normal(
        Model("hertz", "relaxation"),
        signals(t, ramp(t), ramp(t, 1)),
        hertz__stiffness=stiffness,
        relaxation__ratio=ratio,
        relaxation__time_constant=tau,
    )

    def change(s: float) -> float:
        return float(1.5 * stiffness * np.sqrt(max(0.0, ramp(s))) * ramp(s, 1))

    for k in (300, 1000, 2000, 3000):
        kept = quad(lambda s, k=k: (1 + ratio * np.exp((s - t[k]) / tau)) * change(s), 0, t[k], limit=200)[0]
        assert force[k] == pytest.approx(kept, abs=2e-5)  # 0.5 ms steps: 30 N/s² · (5e-4)²/8 and the quadrature's own


def test_relaxation_after_a_fast_step_is_an_exponential() -> None:
    t = np.concatenate([[0.0, 1e-6], np.geomspace(1e-3, 50.0, 400)])
    s = signals(t, np.where(t > 0, 1e-3, -1e-9), np.zeros(len(t)))
    force = normal(
        Model("hooke", "relaxation"), s, hooke__stiffness=1000.0, relaxation__ratio=0.4, relaxation__time_constant=2.0
    )
    np.testing.assert_allclose(force[1:], 1 + 0.4 * np.exp(-t[1:] / 2.0), rtol=0, atol=1e-6)  # the step takes 1 µs


def test_relaxation_wants_a_branch() -> None:
    with pytest.raises(InputError, match="0 branches"):
        Relaxation(0)


@pytest.mark.parametrize("h", [1e-9, 0.9e-3, 1.1e-3, 0.1, 3.0, 500.0])
def test_lowpass_of_a_ramp_for_any_step(h: float) -> None:
    """y = s − τ (1 − exp(−s/τ)) for x = s, for steps of time far below and far above τ."""
    t = h * np.arange(5)
    out = np.empty(5)
    memory.lowpass(t, np.diff(t, prepend=0.0), 1.0, out)
    np.testing.assert_allclose(out, t + np.expm1(-t), rtol=1e-9, atol=1e-17 + 1e-9 * h * h)


# ---- loops, softening, adhesion -------------------------------------------------------------------------------------


def test_a_loop_is_dahls_equation_over_the_path() -> None:
    s = poke(20_000)
    length, path = 6e-4, np.empty((2, 20_000))
    memory.bristles(s.depth_rate, 0 * s.depth_rate, s.dt, s.depth, length, path, 0.0)
    z = path[0]

    def bend(time: float, state: Array) -> list[float]:
        rate = float(POKES(time, 1))
        return [(rate - abs(rate) * state[0]) / length]

    first = np.flatnonzero(s.depth > 0)
    one = first[: int(np.flatnonzero(np.diff(first) > 1)[0]) + 1]  # the first touch
    began = float(min(root for root in POKES.roots(extrapolate=False) if root > 0))
    out = solve_ivp(bend, (began, s.t[one[-1]]), [0.0], rtol=1e-9, atol=1e-12, max_step=2e-3, t_eval=s.t[one])
    # a reversal lies between two samples: half a step of path, 0.4 ms · 0.1 mm/s of ℓ, counts for the wrong direction
    np.testing.assert_allclose(z[one], out.y[0], rtol=0, atol=2e-4)


def test_hysteresis_does_not_depend_on_speed() -> None:
    model = Model("hertz", "hysteresis")
    path = np.linspace(0, 4.0, 8001)
    slow, fast = [
        normal(
            model,
            signals(path / speed, POKES(path), speed * POKES(path, 1)),
            hysteresis__ratio=0.4,
            hysteresis__length=7e-4,
        )
        for speed in (0.1, 7.0)
    ]
    np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-9)
    # nor on how time is sampled, to the error of the path: half a step's turn at each reversal
    t = uneven(4.0, 8001)
    other = normal(model, signals(t, POKES(t), POKES(t, 1)), hysteresis__ratio=0.4, hysteresis__length=7e-4)
    np.testing.assert_allclose(np.interp(path, t, other), slow, rtol=0, atol=2e-3 * slow.max())
    loading = slow[np.searchsorted(path, 0.3)]
    elastic = normal(Model("hertz"), signals(path, POKES(path), POKES(path, 1)))[np.searchsorted(path, 0.3)]
    assert elastic < loading <= 1.4 * elastic


def test_softening_by_steps() -> None:
    """In to 2 mm, out, in to 3 mm: one softer path below the deepest past depth, the virgin one beyond it."""
    depth = 1e-3 * np.concatenate([np.linspace(0.01, 2, 200), np.linspace(2, 0.01, 200), np.linspace(0.01, 3, 300)])
    t = np.arange(len(depth)) * 1e-3
    force = normal(
        Model("hooke", "stress-softening"),
        signals(t, depth, np.gradient(depth, t)),
        hooke__stiffness=1000.0,
        stress_softening__ratio=0.5,
        stress_softening__length=5e-4,
    )
    virgin = 1000.0 * depth
    np.testing.assert_allclose(force[:200], virgin[:200])
    np.testing.assert_allclose(
        force[200:400][::-1], virgin[:200] * (1 - 0.5 * (1 - np.exp((depth[:200] - 2e-3) / 5e-4)))
    )
    below = depth[400:] <= 2e-3
    again = np.interp(depth[400:][below], depth[:200], force[200:400][::-1])
    np.testing.assert_allclose(force[400:][below], again, atol=1e-4)  # interpolated over 10 µm
    np.testing.assert_allclose(force[400:][~below], virgin[400:][~below])


def test_a_bond_pulls_on_the_way_out_only_and_tears() -> None:
    pull, length = 0.5, 4e-4
    way = spline([(0, -1), (1, 2), (2, -0.2), (3, 1), (4, -1), (5, 1), (6, -1)])
    t = np.linspace(0, 6, 6001)
    s = signals(t, way(t), way(t, 1))
    bonded = normal(Model("hooke", "adhesion"), s, adhesion__force=pull, adhesion__length=length)
    added = bonded - normal(Model("hooke"), s)
    assert (added <= 0).all()
    first = int(np.argmax(s.depth))
    np.testing.assert_array_equal(added[: first + 1], 0.0)  # approach and way in
    assert added[(t > 1) & (t < 2)].min() == pytest.approx(-pull, rel=1e-2)
    early, late = (t > 1.5) & (t < 2.5), (t > 3) & (t < 4)
    assert (added[early & (s.depth < -1e-5)] < 0).all()  # nothing deeper than −ℓ: it holds, and comes back
    assert (added[late & (s.depth <= -length)] == 0).all()
    outside = late & (s.depth < 0) & (s.depth > -length)
    assert added[outside].min() < -0.9 * pull
    assert (np.diff(added[outside]) >= 0).all()  # tears smoothly
    np.testing.assert_array_equal(added[(t > 4) & (t <= 4 + np.argmax(way(t[t > 4])) * 1e-3)], 0.0)  # a new contact


def test_without_a_log_inhomogeneity_is_a_gradient() -> None:
    place = np.random.default_rng(0).uniform(-0.02, 0.02, (2, 200))
    s = signals(np.arange(200) * 1.0, np.full(200, 1e-3), np.zeros(200), place, np.zeros_like(place))
    force = normal(
        Model("hooke", "stiffness-inhomogeneity"),
        s,
        hooke__stiffness=1000.0,
        stiffness_inhomogeneity__gradient1=8.0,
        stiffness_inhomogeneity__gradient2=-3.0,
    )
    np.testing.assert_allclose(force, 1 + 8 * place[0] - 3 * place[1])


PROFILES: dict[str, Callable[[Array, Array], Array]] = {
    "edge": lambda x, y: 0.25 * (1 + np.tanh((x - 4e-3) / 6e-4)),
    "inclusion": lambda x, y: 0.6 * np.exp(-((x + 5e-3) ** 2 + (y - 2e-3) ** 2) / (2 * 4e-3**2)),
    "gradient": lambda x, y: 15 * x - 8 * y,
    "waves": lambda x, y: 0.2 * np.sin(x / 4e-3),
}


@pytest.mark.parametrize("shape", sorted(PROFILES))
@pytest.mark.parametrize("turned", [0.0, 0.6])
def test_a_profile_takes_off_what_a_free_one_along_the_path_does(shape: str, turned: float) -> None:
    """Held out, in turns of three seconds: of fifteen free nodes along the path nine tenths at least; smoothness is
    learnt.
    """
    t, noise = np.arange(6000) * 0.01, 0.03
    along = 0.02 * np.sin(0.37 * t) + 0.002 * np.sin(3 * t)
    place = np.outer([np.cos(turned), np.sin(turned)], along)
    depth = 2e-3 + 3e-4 * np.sin(0.9 * t)
    s = signals(t, depth, np.gradient(depth, t), place, np.gradient(place, t, axis=1))
    force = 1000.0 * (1 + PROFILES[shape](*place)) * depth + noise * np.random.default_rng(0).standard_normal(len(t))
    seen = (np.arange(len(t)) // 300) % 2 == 0

    def left(columns: Array, ridge: Array) -> float:
        a, y = columns[:, seen].T / noise, force[seen] / noise
        found = np.linalg.solve(a.T @ a + ridge, a.T @ y)
        return float(np.mean((force - found @ columns)[~seen] ** 2))

    effect = StiffnessInhomogeneity().for_log(s)
    assert effect.nodes is not None
    stiffness = float(depth[seen] @ force[seen] / (depth[seen] @ depth[seen]))
    plain = left(depth[None], np.zeros((1, 1)))
    weights = stiffness * effect.nodes.shares(place) * depth
    # the base's stiffness projected out
    unit = depth[seen] / np.linalg.norm(depth[seen])
    a = (weights[:, seen] - np.outer(weights[:, seen] @ unit, unit)) / noise
    effect = effect.learnt(s.layout, a @ a.T, a @ force[seen] / noise)
    ridge = np.zeros((len(weights) + 1,) * 2)
    ridge[1:, 1:] = effect.prior(s.layout)
    own = left(np.concatenate([depth[None], weights]), ridge)
    nodes = np.linspace(along.min(), along.max(), 15)
    hats = np.maximum(1 - np.abs(along - nodes[:, None]) / (nodes[1] - nodes[0]), 0.0) * depth
    free = left(hats, 1e-6 * np.eye(15))
    print(f"{shape}: squares without {plain:.4f}, free {free:.5f}, own {own:.5f} N²; noise {noise**2:.5f}")
    assert plain - own > 0.9 * (plain - free)
    assert plain - own > 0.9 * (plain - noise**2)


def test_where_nothing_differs_a_profile_is_learnt_to_be_flat() -> None:
    t = np.arange(3000) * 0.01
    place = np.stack([0.02 * np.sin(2 * t), np.interp(t, [0, 30], [-0.015, 0.015])])
    s = signals(t, np.full(len(t), 2e-3), np.zeros(len(t)), place, np.zeros_like(place))
    effect = StiffnessInhomogeneity().for_log(s)
    assert effect.nodes is not None
    assert 20 <= len(effect.nodes.kept) <= 25
    a = effect.nodes.shares(place) / 0.01
    a -= a.mean(axis=1, keepdims=True)
    rng = np.random.default_rng(3)
    found = effect.learnt(s.layout, a @ a.T, a @ rng.standard_normal(len(t)))
    assert found.size <= 0.02


def test_nodes_are_where_the_tool_was() -> None:
    rng = np.random.default_rng(5)
    spots = 1e-3 * np.array([[-18, -8, -4, -3, 0, 12, 15], [-10, 6, -2, 18, 20, -18, 3]])
    place = np.repeat(spots, 100, axis=1) + 1e-5 * rng.standard_normal((2, 700))
    s = signals(np.arange(700) * 0.01, np.full(700, 1e-3), np.zeros(700), place, np.zeros_like(place))
    nodes = StiffnessInhomogeneity().for_log(s).nodes
    assert nodes is not None
    order = np.argsort(nodes.places[0])
    np.testing.assert_allclose(nodes.places[:, order], spots[:, np.argsort(spots[0])], atol=1e-5)
    one = signals(s.t, s.depth, s.depth_rate, 1e-5 * rng.standard_normal((2, 700)), np.zeros_like(place))
    assert StiffnessInhomogeneity().for_log(one).nodes is None
    # an L has no nodes in its corner
    t = np.linspace(0, 1, 4000)
    bent = np.where(t < 0.5, np.stack([0.08 * t, 0 * t]), np.stack([0 * t + 0.04, 0.08 * (t - 0.5)]))
    s = signals(t * 40, np.full(4000, 1e-3), np.zeros(4000), bent, np.zeros_like(bent))
    nodes = StiffnessInhomogeneity().for_log(s).nodes
    assert nodes is not None
    away = np.hypot(nodes.places[0][:, None] - bent[0], nodes.places[1][:, None] - bent[1]).min(axis=1)
    assert away.max() < 0.8 * nodes.step


def _sphere(depth: Array) -> Array:
    """Hertz's force less that of Johnson, Kendall and Roberts: R = 5 mm, E* = 0.2 MPa, γ = 8 J/m² (twice its usual
    half).
    """
    radius, modulus, energy = 5e-3, 2e5, 8.0
    a = np.linspace(1e-6, 6e-3, 20001)
    reach = a**2 / radius - np.sqrt(2 * np.pi * energy * a / modulus)
    first = int(np.argmin(reach))
    force = 4 * modulus * a**3 / (3 * radius) - np.sqrt(8 * np.pi * modulus * energy * a**3)
    hertz = 4 * modulus / 3 * np.sqrt(radius) * np.maximum(depth, 0.0) ** 1.5
    return np.where(depth > reach[first], hertz - np.interp(depth, reach[first:], force[first:]), 0.0)


#: pull of a bond by depth [N], and whether it pulls on the way in, too
PULLS: dict[str, tuple[Callable[[Array], Array], bool]] = {
    "constant, with a neck": (lambda d: np.where(d > -8e-4, 0.4, 0.0), False),
    "constant, in and out": (lambda d: np.where(d > -8e-4, 0.4, 0.0), True),
    "stress within a distance": (lambda d: 0.4 * np.clip(1 + d / 6e-4, 0.0, 1.0), False),
    "soft sphere": (_sphere, True),
}


@pytest.mark.parametrize("kind", sorted(PULLS))
def test_a_bond_has_the_shape_of_known_laws(kind: str) -> None:
    """Of a constant pull, Dugdale's tail and a soft sphere's a tenth of the pull is left at most; of a shifted surface
    most.
    """
    law, both = PULLS[kind]
    way = spline([(0, -2), (1, 2), (2, -2), (3, 1), (3.5, 0.4), (4, 1.5), (5.5, -2), (7, 3), (10, -2)])
    t = np.linspace(0, 10, 3000)
    s = signals(t, way(t), way(t, 1))
    bonded, deepest, pull = False, 0.0, np.zeros(len(t))
    full = law(s.depth)
    for i, depth in enumerate(s.depth):
        bonded = (bonded or depth > 0) and full[i] > 0
        deepest = max(deepest, depth) if bonded else 0.0
        pull[i] = full[i] if bonded and (both or depth < deepest) else 0.0
    base = normal(Model("hertz"), s, hertz__stiffness=1.9e4)
    base_and_bond = Model("hertz", "adhesion")

    def added(z: Array) -> Array:
        values = dict(zip(("force", "tack", "length", "rise", "neck"), (*z[:2], *np.exp(z[2:]))))
        return base - normal(
            base_and_bond, s, hertz__stiffness=1.9e4, **{f"adhesion__{key}": v for key, v in values.items()}
        )

    low, high = [0, 0, np.log(1e-5), np.log(1e-6), np.log(0.5)], [5, 1, np.log(0.01), np.log(0.1), np.log(20.0)]
    starts = [(0.4, 0.5, np.log(length), np.log(1e-4), np.log(4.0)) for length in (3e-4, 6e-4, 1e-3)]
    found = min(
        (least_squares(lambda z: added(z) - pull, start, bounds=(low, high), diff_step=1e-3) for start in starts),
        key=lambda one: one.cost,
    )
    share = float(np.sqrt(2 * found.cost / np.sum(pull**2)))
    slope = np.gradient(base, s.depth)
    shifted = pull + slope * (-(pull @ slope) / (slope @ slope))
    beside = float(np.sqrt(np.sum(shifted**2) / np.sum(pull**2)))
    print(f"{kind}: {100 * share:.1f} % of the pull is left, {100 * beside:.0f} % by a shift")
    assert share < 0.1
    assert beside > 4 * share


# ---- friction -------------------------------------------------------------------------------------------------------


def slide(depth: float = 2e-3, n: int = 8000) -> Signals:
    """Slip along a curved path with reversals, under a constant load."""
    t = uneven(4.0, n)
    one = spline([(0, 0), (0.5, 3), (0.9, 2.5), (1.6, 2.7), (2.3, -3), (3.2, 1), (4, 1)])
    two = spline([(0, 0), (0.7, -2), (1.4, -1), (2.1, -1.2), (3, 2), (4, 2)])
    slips, rates = np.stack([one(t), two(t)]), np.stack([one(t, 1), two(t, 1)])
    return signals(t, np.full(n, depth), np.zeros(n), slips, rates)


def test_bristles_are_dahls_equation() -> None:
    s = slide()
    length, u = 3e-4, np.empty((2, len(s)))
    memory.bristles(s.slip_rate[0], s.slip_rate[1], s.dt, s.depth, length, u, 0.0)
    rate = CubicSpline(s.t, s.slip_rate, axis=1)

    def bend(time: float, state: Array) -> Array:
        v = rate(time)
        return np.asarray((v - np.hypot(*v) * state) / length)

    out = solve_ivp(bend, (0, 4), [0.0, 0.0], rtol=1e-8, atol=1e-10, max_step=5e-3, t_eval=s.t)
    # constant velocity between samples: a step (≤ 1 ms · 20 mm/s) is 0.07 ℓ at most, its square is the error
    np.testing.assert_allclose(u, out.y, rtol=0, atol=2e-3)
    # with the elastic share, off by at most twice that share, after reversals
    memory.bristles(s.slip_rate[0], s.slip_rate[1], s.dt, s.depth, length, u)
    np.testing.assert_allclose(u, out.y, rtol=0, atol=2 * memory.ELASTIC + 2e-3)
    assert (np.hypot(*u) <= 1 + 1e-12).all()


def test_short_bristles_follow_the_direction_of_a_curve_without_delay() -> None:
    """Bristles of 1 µm on a circle, a turn of 0.05 rad a sample: they point along the velocity, not along half a step
    ago's.
    """
    t = np.arange(0.0, 2.0, 5e-3)
    turn = 10.0 * t
    u = np.empty((2, len(t)))
    memory.bristles(0.04 * np.cos(turn), 0.04 * np.sin(turn), np.diff(t, prepend=0.0), np.ones(len(t)), 1e-6, u)
    late = np.angle((u[0] - 1j * u[1]) * np.exp(1j * turn))[10:]
    print(f"{np.abs(late).max():.2g} rad behind, of a step of {turn[1]:.2g} rad")
    assert np.abs(late).max() < 0.1 * turn[1]


def test_bristles_keep_their_deflection_under_the_noise_of_rest() -> None:
    """1 µm of noise, seen at 25 Hz for 10 s: Dahl's own bristles would have crept back."""
    dt = 1e-3
    t = np.arange(0, 10.5, dt)
    rng = np.random.default_rng(4)
    noise = np.convolve(rng.normal(size=len(t) + 40), np.hanning(41) / np.sqrt(np.sum(np.hanning(41) ** 2)), "valid")
    slip = np.where(t < 0.5, 4e-3 * t, 2e-3) + 0.3e-6 * noise
    rate = np.gradient(slip, t)
    steps = np.diff(t, prepend=0.0)
    kept, crept = np.empty((2, len(t))), np.empty((2, len(t)))
    memory.bristles(rate, 0 * rate, steps, np.ones(len(t)), 1e-4, kept)
    memory.bristles(rate, 0 * rate, steps, np.ones(len(t)), 1e-4, crept, 0.0)
    assert kept[0, -1] > 0.9
    assert crept[0, -1] < 0.7


@pytest.mark.parametrize("length", [1e-4, 5e-6])
def test_a_slip_that_turns_between_two_samples(length: float) -> None:
    """Bristles of a log at 250 Hz follow those of the same slip at 10 kHz, also where it turns back within a sample."""

    def bent(rate_hz: float) -> tuple[Array, Array]:
        t = np.arange(0, 2, 1 / rate_hz)
        dt, u = np.diff(t, prepend=0.0), np.empty((2, len(t)))
        memory.bristles(0.05 * np.cos(9 * t + 0.4), 0.02 * np.cos(9 * t + 0.4), dt, np.ones(len(t)), length, u)
        return t, u

    t, coarse = bent(250.0)
    fine_t, fine = bent(10_000.0)
    away = np.abs(coarse[0] - np.interp(t, fine_t, fine[0]))
    assert away.max() < 0.06


def test_friction_in_steady_slip() -> None:
    """Forces of fast slip along either tangent, by hand."""
    t = np.linspace(0, 1, 1001)
    values = {
        "hooke.stiffness": 1000.0,
        "coulomb-friction.coefficient": 0.3,
        "viscous-friction.damping": 4.0,
        "stribeck-friction.coefficient": 0.2,
        "stribeck-friction.speed": 0.02,
        "presliding.length": 1e-3,
        "load-dependent-friction.exponent": -0.25,
        "friction-anisotropy.ratio": 0.1,
    }
    model = Model(
        "hooke",
        "coulomb-friction",
        "stribeck-friction",
        "presliding",
        "viscous-friction",
        "friction-anisotropy",
        "load-dependent-friction",
    )
    for axis, share in ((0, 1.1), (1, 0.9)):
        for v in (0.03, -0.03):
            rates = np.zeros((2, len(t)))
            rates[axis] = v
            s = signals(t, np.full(len(t), 4e-3), np.zeros(len(t)), np.cumsum(rates, axis=1) * 1e-3, rates)
            force = model.predict(s, values)
            mu = (0.3 + 0.2 * np.exp(-(1.5**2))) * share * 4.0**-0.25
            assert force[0, -1] == pytest.approx(4.0)
            assert force[1 + axis, -1] == pytest.approx(-np.sign(v) * mu * 4.0 - 4.0 * v, rel=1e-9)  # after 30 ℓ
            assert force[2 - axis, -1] == 0.0


def test_friction_under_a_dashpot_that_pulls_is_a_power_of_the_load_too() -> None:
    """Where a tool retracts fast, N is negative: T is as large as under one that presses, no power of nothing."""
    t = np.linspace(0, 1, 1001)
    values = {
        "kelvin-voigt.stiffness": 1000.0,
        "kelvin-voigt.damping": 100.0,
        "coulomb-friction.coefficient": 1.0,
        "load-dependent-friction.exponent": -0.65,
    }
    model = Model("kelvin-voigt", "coulomb-friction", "load-dependent-friction")
    slip = np.stack([np.full(len(t), 0.03), np.zeros(len(t))])
    for rate in (0.03, -0.03):
        s = signals(t, np.full(len(t), 1e-3), np.full(len(t), rate), np.cumsum(slip, axis=1) * 1e-3, slip)
        normal, tangential = model.predict(s, values)[:2, -1]
        assert normal == pytest.approx(1.0 + 100.0 * rate)
        assert abs(tangential) == pytest.approx(abs(normal) ** 0.35)


@pytest.mark.parametrize("rubbing", [0.0, 0.4, 1.0])
def test_a_bond_presses_by_its_share_and_friction_never_pushes(rubbing: float) -> None:
    """T = μ max(F + (λ − 1) pull, 0) by hand, while a tool slides steadily out of a sticky material."""
    t = np.linspace(0, 1, 4001)
    depth = 2e-3 - 2.4e-3 * t
    slip = np.stack([0.03 * t, 0 * t])
    s = signals(t, depth, np.full(len(t), -2.4e-3), slip, np.stack([np.full(len(t), 0.03), 0 * t]))
    values = {"hooke.stiffness": 1000.0, "coulomb-friction.coefficient": 0.5, "adhesion.force": 0.8}
    values |= {"adhesion.tack": 1.0, "adhesion.length": 2e-4, "adhesion.neck": 20.0, "adhesion.rubbing": rubbing}
    normal, tangential = Model("hooke", "coulomb-friction", "adhesion").predict(s, values)[:2]
    settled = (t > 0.05) & (depth > 1e-5)  # bristles have bent, and the neck is whole
    np.testing.assert_allclose(normal[settled], 1000.0 * depth[settled] - 0.8, rtol=1e-12)
    expected = -0.5 * np.maximum(1000.0 * depth + (rubbing - 1.0) * 0.8, 0.0)
    np.testing.assert_allclose(tangential[settled], expected[settled], rtol=2e-3, atol=1e-12)


def test_friction_at_rest_keeps_its_direction_and_ends_with_the_touch() -> None:
    t = np.linspace(0, 2, 2001)
    depth = np.where(t < 1.5, 2e-3, -1e-3)
    rate = np.where(t < 0.5, 0.02, 0.0)
    s = signals(t, depth, np.zeros(len(t)), None, np.stack([rate, 0 * rate]))
    force = Model("hooke", "coulomb-friction").predict(
        s, {"hooke.stiffness": 1000.0, "coulomb-friction.coefficient": 0.4}
    )
    np.testing.assert_allclose(force[1, (t > 0.5) & (t < 1.5)], -0.8, rtol=1e-9)
    np.testing.assert_array_equal(force[1, t > 1.5], 0.0)


def test_a_touch_between_samples_moves_nothing_abruptly() -> None:
    """Bristles count the slip since the tip touched, not since the last sample: forces change smoothly with the
    surface.
    """
    t = np.linspace(0, 0.1, 101)
    rates = np.stack([np.full(101, 0.02), np.zeros(101)])
    s = signals(t, 0.02 * (t - 0.0503), np.full(101, 0.02), None, rates)
    u = np.empty((2, 101))
    offsets = np.linspace(-2e-5, 2e-5, 401)  # a sample's depth to either side
    seen = []
    for offset in offsets:
        memory.bristles(rates[0], rates[1], s.dt, s.depth + offset, 1e-4, u)
        seen.append(u[0, 60])
    steps = np.abs(np.diff(seen))
    assert steps.max() < 3 * np.median(steps)


# ---- energy ---------------------------------------------------------------------------------------------------------

times = st.lists(st.floats(0.05, 0.6), min_size=4, max_size=9)
share = st.floats(0.0, 1.0)
length = st.floats(1e-4, 3e-3)

#: laws that only store and dissipate, with strategies for their parameters
PASSIVE: dict[str, dict[str, Any]] = {
    "viscous-damping": {"damping": st.floats(0, 30)},
    "hunt-crossley-damping": {"damping": st.floats(0, 10)},
    "relaxation": {"ratio": share, "time-constant": st.floats(0.01, 10)},
    "hysteresis": {"ratio": share, "length": length},
    "stress-softening": {"ratio": share, "length": length},
    "adhesion": {"force": st.floats(0, 2), "length": length},
    "stiffening-layer": {"stiffness": st.floats(0, 3000), "depth": st.floats(0, 4e-3)},
    "hertz-exponent": {"exponent": st.floats(1.0, 2.5)},
}
BASES = ("hooke", "hertz")


@st.composite
def excursion(draw: st.DrawFn) -> Signals:
    """Depth that starts and ends outside the material, with turns at any depth between."""
    steps = [0.1, *draw(times)]
    depths = [-1.0, *(draw(st.floats(-0.5, 5.0)) for _ in steps[1:]), -1.0]
    at = np.cumsum([0.0, *steps])
    t = np.linspace(0, at[-1], 6000)
    k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(steps) - 1)
    x = (t - at[k]) / np.array(steps)[k]
    rise = np.diff(depths)[k]
    depth = 1e-3 * (np.array(depths)[k] + rise * x * x * (3 - 2 * x))
    return signals(t, depth, 1e-3 * rise * 6 * x * (1 - x) / np.array(steps)[k])


def work(force: Array, path: Array) -> tuple[float, float]:
    """Work done along a path, and the sum of its amounts, by the trapezoidal rule."""
    parts = 0.5 * (force[1:] + force[:-1]) * np.diff(path)
    return float(parts.sum()), float(np.abs(parts).sum())


@pytest.mark.parametrize("name", sorted(PASSIVE))
@QUICK
@given(data=st.data())
def test_passive_laws_give_no_energy(name: str, data: Any) -> None:
    base = data.draw(st.sampled_from(BASES))
    s = data.draw(excursion())
    values = {f"{name}.{key}": data.draw(strategy) for key, strategy in PASSIVE[name].items()}
    force = Model(base, name).predict(s, values)[0]
    put_in, amounts = work(force, s.depth)
    # steps of at most 0.1 mm: a corner of the force (touch, layer) costs the rule 1e-3 of a step's share of the work
    assert put_in >= -2e-4 * amounts - 1e-9


@QUICK
@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=2, max_size=7),
    st.floats(2e-5, 2e-3),
    st.floats(-0.9, 0.9),
    st.floats(0, 5),
)
def test_friction_gives_no_energy(
    places: list[tuple[float, float]], bristle: float, aniso: float, viscous: float
) -> None:
    """Along any slip that returns to its start, under a constant load."""
    at = np.arange(len(places) + 2.0)
    way = np.array([(0.0, 0.0), *places, (0.0, 0.0)])
    t = np.linspace(0, at[-1], 20_000)
    k = np.clip(t.astype(int), 0, len(way) - 2)
    x, rise = t - k, np.diff(way, axis=0)[k]
    slips = 1e-3 * (way[k] + rise * (x * x * (3 - 2 * x))[:, None]).T
    rates = 1e-3 * (rise * (6 * x * (1 - x))[:, None]).T
    s = signals(t, np.full(len(t), 2e-3), np.zeros(len(t)), slips, rates)
    model = Model("hooke", "coulomb-friction", "presliding", "friction-anisotropy", "viscous-friction")
    force = model.predict(
        s, {"presliding.length": bristle, "friction-anisotropy.ratio": aniso, "viscous-friction.damping": viscous}
    )
    done = [work(-force[1 + axis], slips[axis]) for axis in (0, 1)]
    # a step is at most 1 µm per bristle of 20 µm: the trapezoidal rule is off by its square
    assert sum(put_in for put_in, _ in done) >= -2e-3 * sum(amounts for _, amounts in done) - 1e-12


@pytest.mark.parametrize("amplitude", [0.01, 0.03, 0.1, 0.3])
def test_small_oscillations_are_damped_not_driven(amplitude: float) -> None:
    """Within and just beyond the elastic share of a bristle, where a lag of force behind motion would feed energy
    in.
    """
    t = np.linspace(0, 6, 30_001)
    ell = 1e-3
    sway, rate = amplitude * ell * np.sin(2 * np.pi * t), 2 * np.pi * amplitude * ell * np.cos(2 * np.pi * t)
    none = np.zeros(len(t))
    last = t >= 5.0  # settled
    s = signals(t, np.full(len(t), 2e-3), none, np.stack([sway, none]), np.stack([rate, none]))
    force = Model("hooke", "coulomb-friction", "presliding").predict(s, {"presliding.length": ell})[1]
    poking = signals(t, 0.05 + sway, rate)
    loop = normal(Model("hooke", "hysteresis"), poking, hysteresis__ratio=0.5, hysteresis__length=ell)
    for put_in, amounts in (work(-force[last], sway[last]), work(loop[last], sway[last])):
        assert put_in >= -1e-6 * amounts
        if amplitude > memory.ELASTIC:
            assert put_in > 0


def test_signals_stay_as_they_were() -> None:
    s = poke(200)
    kept = {field.name: getattr(s, field.name) for field in dataclasses.fields(s)}
    Model("zener", "hysteresis", "surface-offset", "coulomb-friction", "presliding").predict(s, {})
    assert all(getattr(s, name) is value for name, value in kept.items())


def test_rounded_friction_is_the_simulators_law() -> None:
    """Without memory, whatever presliding says; stronger friction at rest, load and direction act through the
    coefficient.
    """
    s = slide()
    model = Model(
        "hooke",
        "coulomb-friction",
        "stribeck-friction",
        "load-dependent-friction",
        "friction-anisotropy",
        "friction-rounding",
        "presliding",
    )
    values = {
        "hooke.stiffness": 900.0,
        "coulomb-friction.coefficient": 0.3,
        "stribeck-friction.coefficient": 0.2,
        "stribeck-friction.speed": 5e-3,
        "load-dependent-friction.exponent": -0.2,
        "friction-anisotropy.ratio": 0.15,
        "friction-rounding.speed": 3e-3,
    }
    _, *found = model.predict(s, values)
    speed = np.hypot(*s.slip_rate)
    mu = (0.3 + 0.2 * np.exp(-((speed / 5e-3) ** 2))) * 1.8**-0.2
    expected = -mu * 1.8 * s.slip_rate / np.sqrt(speed**2 + 9e-6) * np.array([[1.15], [0.85]])
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-15)
    np.testing.assert_array_equal(found, model.predict(s, {**values, "presliding.length": 2e-3})[1:])
    plain = model.predict(s, {**values, "friction-rounding.speed": 0.0})
    np.testing.assert_array_equal(
        plain,
        (model - "friction-rounding").predict(
            s, {key: value for key, value in values.items() if not key.startswith("friction-rounding")}
        ),
    )


def test_negative_friction_is_told() -> None:
    stribeck, layer = get("stribeck-friction"), get("stiffening-layer")
    assert stribeck.implausible({"coefficient": 0.1, "speed": 0.01}, {"coulomb-friction.coefficient": 0.3}) == ""
    assert "at rest" in stribeck.implausible(
        {"coefficient": -0.4, "speed": 0.01}, {"coulomb-friction.coefficient": 0.3}
    )
    assert "coefficient" in stribeck.implausible(
        {"coefficient": -0.2, "speed": 0.01}, {"coulomb-friction.coefficient": 0.3}
    )
    assert "negative" not in layer.implausible({"stiffness": -300.0, "depth": 1e-3}, {"hooke.stiffness": 500.0})
    assert "more than" in layer.implausible({"stiffness": -700.0, "depth": 1e-3}, {"hooke.stiffness": 500.0})


def test_a_branch_that_is_faster_than_samples_follow_is_damping() -> None:
    s = poke()
    period = float(np.median(np.diff(s.t)))
    for found, share in (("damping", 0.9), ("", 1.1)):
        why = Relaxation(2).implausible(
            {"ratio": 0.3, "time-constant": 0.5, "ratio2": 0.3, "time-constant2": share * period}, {}, s
        )
        assert found in why
        assert bool(why) == bool(found)
