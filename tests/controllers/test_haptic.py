"""Haptic rendering of a map: laws, friction cone, frames, energy at 1 kHz; and the arm whose stiffness follows a
map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from kinid.controllers import (
    AdaptiveImpedance,
    EnergyTank,
    Environment,
    Gains,
    HapticRendering,
    HapticSettings,
    Hooke,
    HuntCrossley,
    Impedance,
    KelvinVoigt,
    Observer,
    Plane,
    Properties,
    Schedule,
    Target,
    Uniform,
)
from kinid.errors import InputError

Array = NDArray[np.float64]
PERIOD = 1e-3
MATERIAL = Properties(1200.0, 4.0, 1.4, 0.5)


class Halves:
    """Soft to the left, hard to the right, across a sharp border."""

    def __init__(self, left: Properties, right: Properties) -> None:
        self.left, self.right = left, right

    def properties(self, x: float, y: float) -> Properties:
        return self.left if x < 0 else self.right


def fall(rendering: HapticRendering, mass: float, push: Array, steps: int, velocity: Array) -> tuple[Array, Array]:
    """A device without any damping under a constant push, force held each period and integrated exactly.

    Returns: kinetic energy less the push's work, (steps,), and positions, (steps, 3).
    """
    x, v = np.array([0.0, 0.0, 1e-3]), velocity.astype(float)
    energy, places = [], []
    for _ in range(steps):
        force = rendering.command(x, v).force
        energy.append(0.5 * mass * v @ v - push @ x)
        places.append(x)
        a = (force + push) / mass
        x, v = x + PERIOD * v + 0.5 * PERIOD**2 * a, v + PERIOD * a
    return np.array(energy), np.array(places)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (Hooke(), 1200.0 * 0.004),
        (KelvinVoigt(), 1200.0 * 0.004 + 4.0 * 0.03),
        (HuntCrossley(), 0.004**1.4 * (1200.0 + 4.0 * 0.03)),
    ],
)
def test_laws(law: Any, expected: float) -> None:
    rendering = HapticRendering(Uniform(MATERIAL), HapticSettings(law, passivity=Observer(0.0)))
    rendering.command(np.array([0, 0, -0.0039]), np.zeros(3))
    found = rendering.command(np.array([0, 0, -0.004]), np.array([0, 0, -0.03]))
    np.testing.assert_allclose(found.force, [0, 0, expected], rtol=1e-12)
    assert found.depth == pytest.approx(0.004)
    np.testing.assert_array_equal(found.proxy, 0)
    # leaving fast: no law pulls
    assert rendering.command(np.array([0, 0, -1e-6]), np.array([0, 0, 2.0])).force[2] >= 0
    assert not rendering.command(np.array([0, 0, 1e-6]), np.zeros(3)).force.any()


@given(st.integers(0, 10_000))
def test_the_force_stays_in_the_friction_cone_and_opposes_the_slip(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rendering = HapticRendering(Uniform(MATERIAL), HapticSettings(KelvinVoigt(), shear=800.0, passivity=Observer(0.0)))
    x = np.array([0.0, 0.0, -0.003])
    for _ in range(60):
        v = rng.normal(size=3) * 0.2
        x = x + v * PERIOD
        found = rendering.command(x, v)
        lateral = np.linalg.norm(found.force[:2])
        assert lateral <= MATERIAL.friction * found.force[2] + 1e-12
        if found.sliding:
            assert lateral == pytest.approx(MATERIAL.friction * found.force[2])
        # the god-object lies on the surface, and the spring to it makes the force
        np.testing.assert_allclose(found.force[:2], 800.0 * (found.proxy - x)[:2] * (found.depth > 0), atol=1e-12)
        assert found.proxy[2] == pytest.approx(max(x[2], 0.0))


def test_steady_slip_gives_mu_times_normal_force_and_a_stop_holds() -> None:
    rendering = HapticRendering(Uniform(MATERIAL), HapticSettings(Hooke()))
    for i in range(200):
        found = rendering.command(np.array([1e-4 * i, 0, -0.002]), np.array([0.1, 0, 0]))
    np.testing.assert_allclose(found.force, [-0.5 * 2.4, 0, 2.4], rtol=1e-9)
    back = rendering.command(np.array([199e-4 - 1e-4, 0, -0.002]), np.array([-0.1, 0, 0]))
    assert not back.sliding
    assert back.force[0] == pytest.approx(-1.2 + 500 * 1e-4)


@given(st.integers(0, 10_000))
def test_a_turned_plane_leaves_the_behaviour(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
    flat = HapticRendering(Uniform(MATERIAL), HapticSettings(HuntCrossley()))
    tilted = HapticRendering(Uniform(MATERIAL), HapticSettings(HuntCrossley(), Plane(shift, turn.T)))
    x = np.array([0.0, 0.0, 0.001])
    for _ in range(20):
        v = rng.normal(size=3)
        x = x + v * PERIOD
        a, b = flat.command(x, v), tilted.command(shift + turn @ x, turn @ v)
        np.testing.assert_allclose(b.force, turn @ a.force, atol=1e-10)
        np.testing.assert_allclose(b.proxy, shift + turn @ a.proxy, atol=1e-12)


@pytest.mark.parametrize("law", [Hooke(), KelvinVoigt(), HuntCrossley()])
@pytest.mark.parametrize("mass", [0.05, 0.3])
@pytest.mark.parametrize("stiffness", [500.0, 3000.0])
def test_energy_of_an_undamped_device_is_bounded(law: Any, mass: float, stiffness: float) -> None:
    """20 s of bouncing and sliding at 1 kHz: never more energy than it came with, but for one touch's debt."""
    material = Properties(stiffness, 1.0, 1.0, 0.3)
    energy, _ = fall(
        HapticRendering(Uniform(material), HapticSettings(law)),
        mass,
        np.array([0, 0, -1.0]),
        20_000,
        np.array([0.05, 0.02, -0.1]),
    )
    start = energy[0]
    # a spring held for T is a damper of −K T/2: through half a swing √(K m) T v² π/4, v the speed of the touch
    speed = np.sqrt(2 * start / mass)
    assert energy.max() < start + 2 * np.sqrt(stiffness * mass) * PERIOD * speed**2


def test_without_the_passivity_controller_a_held_spring_gives_energy() -> None:
    """What the bound above is about: the same device on the same spring runs away."""
    args = 0.1, np.array([0, 0, -1.0]), 6_000, np.array([0, 0, -0.1])
    surface = Uniform(Properties(3000.0))
    wild, _ = fall(HapticRendering(surface, HapticSettings(Hooke(), passivity=Observer(0.0))), *args)
    tame, _ = fall(HapticRendering(surface, HapticSettings(Hooke())), *args)
    assert wild.max() > 10 * max(abs(wild[0]), 1e-3)
    assert tame.max() < 2 * abs(tame[0])


def test_damping_that_a_device_needs_by_itself() -> None:
    """Colgate's bound K T/2 + B: a device with that much damping bounces down without the controller."""
    rendering = HapticRendering(
        Uniform(Properties(2000.0, 1.5)), HapticSettings(KelvinVoigt(), passivity=Observer(0.0))
    )
    assert rendering.needed_damping(0, 0) == pytest.approx(2.5)


def test_a_map_with_a_step_in_stiffness_gives_no_energy() -> None:
    """Pushed in on the soft side, let out on the hard one, round and round: work that a passive hand could harvest."""
    surface = Halves(Properties(300.0), Properties(1500.0))
    path = [np.array([-0.01, 0, z]) for z in np.linspace(0.001, -0.006, 300)]
    path += [np.array([x, 0, -0.006]) for x in np.linspace(-0.01, 0.01, 300)]
    path += [np.array([0.01, 0, z]) for z in np.linspace(-0.006, 0.001, 300)]
    path += [np.array([x, 0, 0.001]) for x in np.linspace(0.01, -0.01, 300)]
    path = path * 20
    gains = {}
    for most in (0.0, 20.0, 100.0):
        rendering, before = (
            HapticRendering(surface, HapticSettings(Hooke(), passivity=Observer(most), mass=0.2)),
            path[0],
        )
        for x in path:
            found = rendering.command(x, (x - before) / PERIOD)
            before = x
        gains[most] = -sum(found.energy)
    one_round = 0.5 * (1500 - 300) * 0.006**2
    assert gains[0.0] == pytest.approx(20 * one_round, rel=0.1)
    # each round's debt is paid as the next is pushed in
    assert gains[100.0] < 2 * one_round
    # 20 N·s/m on 6 mm at 23 mm/s is 3 mJ: too little for the 22 mJ of such a border, and what it can't pay adds up
    assert 2 * one_round < gains[20.0] < 0.9 * gains[0.0]


def test_a_slow_poke_agrees_with_the_continuous_equation() -> None:
    """A mass falls on Hunt-Crossley: the rendered device against scipy's integration of the same law."""
    law, mass = HuntCrossley(), 0.2
    material = Properties(900.0, 200.0, 1.2)
    steps = 60
    _, places = fall(
        HapticRendering(Uniform(material), HapticSettings(law)),
        mass,
        np.array([0, 0, -1.0]),
        steps,
        np.array([0, 0, -0.05]),
    )

    def slope(_: float, y: Array) -> list[float]:
        force = law.force(-y[0], -y[1], material) if y[0] < 0 else 0.0
        return [y[1], (force - 1.0) / mass]

    exact = solve_ivp(
        slope, (0, steps * PERIOD), [1e-3, -0.05], t_eval=np.arange(steps) * PERIOD, rtol=1e-9, atol=1e-12
    )
    # half a period's lag at 0.1 m/s is 0.05 mm
    np.testing.assert_allclose(places[:, 2], exact.y[0], atol=1e-4)


def test_force_limit_and_joint_torques(bench: Any) -> None:
    state = bench.state()
    plane = Plane(state.position + [0, 0, 0.01])
    rendering = HapticRendering(Uniform(Properties(5000.0)), HapticSettings(Hooke(), plane, force_limit=8.0))
    np.testing.assert_allclose(rendering.torques(state) - state.gravity, state.jacobian[2] * 8.0, atol=1e-9)


@pytest.mark.parametrize(
    "bad",
    [
        {"period": 0.0},
        {"period": np.nan},
        {"shear": -1.0},
        {"force_limit": 0.0},
        {"force_limit": np.nan},
    ],
)
def test_bad_settings_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError):
        HapticSettings(**bad)


def test_numbers_of_numpy_pass_and_truth_values_do_not() -> None:
    settings = HapticSettings(force_limit=np.float32(3), shear=np.float64(100), mass=np.float32(0.1))  # type: ignore[arg-type]
    assert settings.force_limit == 3
    assert HapticSettings(force_limit=np.inf).force_limit == np.inf
    assert Gains(np.float32(3), [500, 500, 400]).rotation == (500.0, 500.0, 400.0)  # type: ignore[arg-type]
    for bad in ({"force_limit": True}, {"shear": np.bool_(True)}, {"mass": True}, {"mass": 0.0}, {"period": True}):
        with pytest.raises(InputError):
            HapticSettings(**bad)
    for bad in ({"translation": True}, {"ratio": True}, {"rotation": [True, True, True]}):
        with pytest.raises(InputError):
            Gains(**bad)


@pytest.mark.parametrize("passivity", [Observer(), EnergyTank()])
@pytest.mark.parametrize("mass", [0.01, 0.05, 0.3, 1.0])
def test_energy_of_a_device_on_any_material_is_bounded(mass: float, passivity: Any) -> None:
    """Stiff, strongly damped and both, on light devices and heavy ones: a spring's debt of one touch, and it never
    builds up.

    A held spring gives up to ½ π T √(K/m) of a touch's energy, half of it at the stiffness that is still rendered,
    before the controller knows; a touch may bring a debt of the one before.
    """
    worst, softened = 0.0, 0
    for stiffness in (732.0, 2e4, 1e5):
        for damping in (0.0, 150.0, 1000.0):
            for law in (KelvinVoigt(), HuntCrossley()):
                material, push = Uniform(Properties(stiffness, damping, 1.0, 0.5)), np.array([0, 0, -1.0])
                rendering = HapticRendering(material, HapticSettings(law, passivity=passivity, mass=mass))
                energy, places = fall(rendering, mass, push, 1500, np.array([0.05, 0.02, -0.1]))
                # the touch has what the push does on the way through the material, too
                start = 0.5 * mass * 0.0129 - push[2] * (1e-3 - places[:, 2].min())
                worst = max(worst, (energy.max() - energy[0]) / start)
                at = rendering.settings
                softened += stiffness > at.most_stiffness or damping > at.most_damping
    print(
        f"{type(passivity).__name__}, {1e3 * mass:g} g: at most {100 * worst:.0f} % more energy; {softened} of 18 "
        f"softened"
    )
    assert softened
    assert worst < 0.5


def test_softening_is_said_and_nothing_else_is_softened() -> None:
    inside, fast = np.array([0, 0, -2e-3]), np.array([0, 0, -0.1])
    for mass, limited in ((0.05, True), (0.5, False)):
        rendering = HapticRendering(
            Uniform(Properties(732.0, 150.0)), HapticSettings(mass=mass, passivity=Observer(0.0))
        )
        found = rendering.command(inside, fast)
        assert found.limited == limited
        assert found.force[2] == pytest.approx(732.0 * 2e-3 + (15.0 if not limited else 0.05 / PERIOD * 0.1))
    with pytest.raises(InputError, match="shear spring of 500"):
        HapticSettings(mass=1e-3)


def test_bad_materials_places_and_planes_are_refused() -> None:
    for material in (Properties(-1.0), Properties(np.nan), Properties(1.0, -1.0), Properties(1.0, 1.0, 0.0)):
        with pytest.raises(InputError):
            Uniform(material)
    hole = HapticRendering(Halves(Properties(np.nan), Properties(1.0)))
    hole.command(np.array([0.01, 0, -0.001]), np.zeros(3))
    hole.reset()
    with pytest.raises(InputError, match="the map at"):
        hole.command(np.array([-0.01, 0, -0.001]), np.zeros(3))
    with pytest.raises(InputError, match="finite"):
        hole.command(np.array([np.nan, 0, 0]), np.zeros(3))
    with pytest.raises(InputError, match="orthonormal"):
        Plane(np.zeros(3), np.diag([1.0, 1.0, -1.0]))


def test_schedule_keeps_the_series_stiffness() -> None:
    schedule = Schedule(series=400.0, least=200.0, most=5000.0)
    for environment in (500.0, 800.0, 3000.0, 1e5):
        arm = schedule.stiffness(environment)
        assert arm * environment / (arm + environment) == pytest.approx(400.0)
    assert schedule.stiffness(300.0) == 5000.0


def adaptive(bench: Any, surface: Any, schedule: Schedule, below: float) -> tuple[AdaptiveImpedance, Target]:
    state = bench.state()
    target = Target(state.rotation, state.position - [0, 0, below])
    return AdaptiveImpedance(Impedance(Gains(3000.0, 200.0), target, bench.limit), surface, schedule), target


def test_the_same_push_gives_the_same_force_on_every_material(bench: Any) -> None:
    """Set-point 10 mm below a soft and a hard material: the closed loop settles at the same force; a plain one
    doesn't.
    """
    at, forces, plain = bench.state().position, [], []
    for stiffness in (600.0, 4000.0):

        def contact(state: Any, k: float = stiffness) -> Array:
            depth = at[2] - state.position[2]
            return np.array([0, 0, max(0.0, k * depth - 20 * state.twist[2]) if depth > 0 else 0.0, 0, 0, 0])

        control, _ = adaptive(bench, Uniform(Properties(stiffness)), Schedule(series=400.0, plane=Plane(at)), 0.01)
        for command, out in ((control.command, forces), (control.base.command, plain)):
            last: list[Array] = []

            def seen(state: Any, of: Any = contact, keep: list[Array] = last) -> Array:
                keep[:] = [of(state)]
                return keep[0]

            bench.run(lambda _, state, c=command: c(state), 1000, seen)
            out.append(last[0][2])
    print(f"force of a 10 mm push on 600 and 4000 N/m: adaptive {np.round(forces, 3)} N, plain {np.round(plain, 2)} N")
    # gravity and friction are exact here; what is left is settling
    np.testing.assert_allclose(forces, 4.0, rtol=0.01)
    assert plain[1] > 2 * plain[0]


def test_stiffening_is_paid_by_the_tank(bench: Any) -> None:
    """Over a border to a soft place, spring stretched, arm at rest: the energy put in is what the tank held, no
    more.
    """
    state = bench.state()
    plane = Plane(state.position - [0.05, 0, 0])
    surface = Halves(Properties(4000.0), Properties(300.0))
    schedule = Schedule(series=400.0, most=5000.0, plane=plane, tank=0.02)
    control, target = adaptive(bench, surface, schedule, 0.01)
    left = type(state)(**(vars(state) | {"position": state.position - [0.1, 0, 0]}))
    control.toward(Impedance(control.base.gains, Target(target.rotation, target.position - [0.1, 0, 0]), bench.limit))
    control.command(left)
    before = control.stiffness
    assert before == pytest.approx(400 * 4000 / 3600)
    for _ in range(5):
        control.command(state)
    assert 0.5 * (control.stiffness - before) * 0.01**2 == pytest.approx(0.02)
    assert control.tank == pytest.approx(0.0, abs=1e-12)
    control.reset()
    control.command(state)
    assert control.stiffness == 5000.0


def test_what_an_adaptive_impedance_is_not_made_of(bench: Any) -> None:
    state = bench.state()
    target = Target(state.rotation, state.position)
    base, soft = Impedance(Gains([500, 500, 500]), target, bench.limit), Uniform(Properties(600.0))  # type: ignore[arg-type]
    for bad in ((5, soft), (base, 5), (base, soft, 3)):
        with pytest.raises(InputError):
            AdaptiveImpedance(*bad)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="stiffnesses along axes"):
        AdaptiveImpedance(base, soft, Schedule(plane=Plane(axes=Rotation.from_rotvec([0.3, 0, 0]).as_matrix())))
    control = AdaptiveImpedance(base, soft)
    control.toward(Target(state.rotation, state.position + [0, 0, 0.01]))
    assert control.base.target.position[2] == pytest.approx(state.position[2] + 0.01)
    with pytest.raises(InputError, match="target"):
        control.toward(state.position)
    control.check(state)
    with pytest.raises(InputError, match="grows by"):
        control.check(state, 0.1)


@pytest.mark.parametrize("bad", [{"series": 0.0}, {"least": -1.0}, {"most": 6000.0}, {"tank": -1.0}, {"period": 0.0}])
def test_bad_schedules_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Schedule(**bad)


@pytest.mark.parametrize(
    ("position", "velocity", "match"),
    [
        (np.zeros(2), np.zeros(3), "device position of shape"),
        (np.zeros(3), np.full(3, np.nan), "device velocity with 3 values"),
        ("here", np.zeros(3), "device position 'here'"),
        (np.zeros(3), None, "device velocity"),
        (np.zeros((1, 3)), np.zeros(3), "device position of shape"),
    ],
)
def test_what_a_driver_must_not_send(position: Any, velocity: Any, match: str) -> None:
    with pytest.raises(InputError, match=match):
        HapticRendering(Uniform(Properties(500.0))).command(position, velocity)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"law": "hunt-crosley"}, "law 'hunt-crosley'.*HuntCrossley"),
        ({"law": Hooke}, "law"),
        ({"surface": "table"}, "surface"),
        ({"passivity": "tank"}, "passivity 'tank'"),
        ({"shear": "500"}, "shear"),
        ({"period": "1 ms"}, "period"),
        ({"force_limit": "8"}, "force_limit"),
        ({"force_limit": np.nan}, "force_limit"),
    ],
)
def test_settings_of_the_wrong_kind(bad: Any, match: str) -> None:
    with pytest.raises(InputError, match=match):
        HapticSettings(**bad)


def test_properties_planes_and_jacobians_of_the_wrong_kind() -> None:
    for thing in ("map.parquet", None):
        with pytest.raises(InputError, match="a map"):
            HapticRendering(thing)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="settings 7"):
        HapticRendering(Uniform(Properties(500.0)), settings=7)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a material"):
        Uniform((700.0, 1.0))  # type: ignore[arg-type]
    pair = type("Pair", (), {"properties": lambda self, x, y: (700.0, 1.0)})()
    for ask in (
        lambda: HapticRendering(pair).command(-1e-3 * np.ones(3), np.zeros(3)),
        lambda: Environment.at(pair, 0.0, 0.0),
    ):
        with pytest.raises(InputError, match="of the map at"):
            ask()
    for bad in ((Properties("stiff"), "stiffness stiff"), (Properties(500.0, None), "damping None")):  # type: ignore[arg-type]
        with pytest.raises(InputError, match=bad[1]):
            Uniform(bad[0])
    with pytest.raises(InputError, match="orthonormal"):
        Plane(axes=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(InputError, match="surface point"):
        Plane(point=np.zeros(2))
    found = HapticRendering(Uniform(Properties(500.0))).command(np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match="Jacobian of shape"):
        found.torques(np.zeros((4, 7)))
