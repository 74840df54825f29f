"""Observer and energy tank: what a port may give, whatever force is asked of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.controllers import (
    EnergyTank,
    HapticRendering,
    HapticSettings,
    Hooke,
    HuntCrossley,
    KelvinVoigt,
    Observer,
    Properties,
    Uniform,
)
from kinid.controllers.haptic import Rendered
from kinid.controllers.passivity import LASTS, RETURN, Passivity, afford, ease, pay
from kinid.errors import InputError

Array = NDArray[np.float64]
PERIOD = 1e-3


def test_a_damper_pays_a_debt_within_a_period() -> None:
    assert pay(0.1, 1.0, PERIOD, 50.0) == 0.0
    assert pay(-1e-5, 1e-3, PERIOD, 50.0) == pytest.approx(1e-5 / 1e-6)
    assert pay(-1.0, 1e-3, PERIOD, 50.0) == 50.0
    assert pay(-1.0, 0.0, PERIOD, 50.0) == 0.0


def test_a_tank_affords_what_it_holds() -> None:
    assert afford(1e-3, -1.0, 2.0, 0.25, PERIOD, 10.0) == 1.0  # a force that takes energy needs none
    # nearly empty: no jump from what an empty one affords
    assert afford(1e-9, -0.2, 2.0, 0.01, PERIOD, 10.0) == pytest.approx(0.5, abs=1e-5)
    assert afford(1.0, 2.0, 2.0, 1.0, PERIOD, 10.0) == 1.0
    # what there is lasts for some periods; at rest a force costs nothing
    assert afford(1e-3, 2.0, 2.0, 1.0, PERIOD, 10.0) == pytest.approx(0.5 / LASTS)
    assert afford(1e-9, 0.0, 2.0, 0.0, PERIOD, 10.0) == 1.0
    # empty: nothing along the motion or at rest, a damper's force against it
    assert afford(0.0, 2.0, 2.0, 1.0, PERIOD, 10.0) == 0.0
    assert afford(-1.0, 0.0, 2.0, 0.0, PERIOD, 10.0) == 0.0
    assert afford(0.0, -0.2, 2.0, 0.01, PERIOD, 10.0) == pytest.approx(0.5)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([1e-4, 5e-3]))
def test_a_tank_never_gives_more_than_it_had(seed: int, capacity: float) -> None:
    """Any force on a mass that nothing else holds: the mass never has more energy than came with it and was in the
    tank.
    """
    rng = np.random.default_rng(seed)
    ledger, mass = EnergyTank(capacity, filling=capacity).open(PERIOD), 0.2
    v, strongest, most = 0.3 * float(rng.normal()), 8.0, 0.0
    wild = v
    start = 0.5 * mass * v * v
    for _ in range(3000):
        push = float(rng.uniform(-strongest, strongest))
        wild += (push + 2.0 * np.sign(wild)) / mass * PERIOD
        wanted = push + 2.0 * np.sign(v)
        force = wanted * ledger.settle(wanted * v, abs(wanted), v * v)[0]
        way = v * PERIOD + 0.5 * force / mass * PERIOD**2
        ledger.book(force * way)
        v += force / mass * PERIOD
        most = max(most, 0.5 * mass * v * v)
    # what the acceleration within a period adds is known one period later
    late = 0.5 * (strongest + 2.0) ** 2 / mass * PERIOD**2
    assert most <= start + capacity + late
    assert 0.5 * mass * wild**2 > 10.0  # without the tank it runs away


def drop(rendering: HapticRendering, mass: float, steps: int) -> Array:
    """Energy of a device without damping that falls on a material under 1 N, at each period."""
    x, v, push, energy = 1e-3, -0.1, -1.0, []
    for _ in range(steps):
        force = float(rendering.command(np.array([0, 0, x]), np.array([0, 0, v])).force[2])
        energy.append(0.5 * mass * v * v - push * x)
        a = (force + push) / mass
        x, v = x + PERIOD * v + 0.5 * PERIOD**2 * a, v + PERIOD * a
    return np.array(energy)


@pytest.mark.parametrize("law", [Hooke(), KelvinVoigt(), HuntCrossley()])
@pytest.mark.parametrize("mass", [0.05, 0.3])
@pytest.mark.parametrize("stiffness", [500.0, 3000.0])
def test_energy_of_an_undamped_device_behind_a_tank_is_bounded(law: Hooke, mass: float, stiffness: float) -> None:
    """20 s at 1 kHz; without a tank the same spring drives the device away (`test_haptic.py`)."""
    tank = EnergyTank(filling=1e-3)
    energy = drop(
        HapticRendering(Uniform(Properties(stiffness, 1.0)), HapticSettings(law, passivity=tank)), mass, 20_000
    )
    force = stiffness * 0.1 * np.sqrt(mass / stiffness) + 2.0
    assert energy.max() < energy[0] + tank.filling + 0.5 * force**2 / mass * PERIOD**2
    assert np.isfinite(energy).all()


@pytest.mark.parametrize("passivity", [Observer(200.0), EnergyTank(0.03)], ids=["observer", "tank"])
def test_a_border_in_stiffness_can_t_be_harvested(passivity: Passivity) -> None:
    """In on the soft side, out on the hard one, forty times: a map that a hand could run a mill with."""

    class Halves:
        def properties(self, x: float, y: float) -> Properties:
            return Properties(300.0 if x < 0 else 1500.0)

    legs = [
        ((-0.01, 0.001), (-0.01, -0.006)),
        ((-0.01, -0.006), (0.01, -0.006)),
        ((0.01, -0.006), (0.01, 0.001)),
        ((0.01, 0.001), (-0.01, 0.001)),
    ]
    lap = np.concatenate([np.linspace(a, b, 300) for a, b in legs])
    path = np.tile(lap, (40, 1))
    rendering = HapticRendering(Halves(), HapticSettings(Hooke(), passivity=passivity, mass=0.2))
    won, before, last = [], path[0], np.zeros(2)
    for at in path:
        won.append(float(last @ (at - before)))
        found = rendering.command(
            np.array([at[0], 0, at[1]]), np.array([at[0] - before[0], 0, at[1] - before[1]]) / PERIOD
        )
        last, before = found.force[[0, 2]], at
    one = 0.5 * (1500 - 300) * 0.006**2
    assert sum(won) < 0.031 if isinstance(passivity, EnergyTank) else sum(won) < 2 * one
    assert 40 * one > 0.8  # what the map would have given


def test_a_full_tank_renders_the_material_as_it_is() -> None:
    """Pressed and let go slowly, spring energy below the capacity: not a newton is missing."""
    tank = EnergyTank(0.02, filling=0.02)
    rendering = HapticRendering(Uniform(Properties(1000.0)), HapticSettings(Hooke(), passivity=tank))
    depth = 0.004 * np.sin(np.linspace(0, 6 * np.pi, 3000))
    for d, rate in zip(depth, np.gradient(depth, PERIOD)):
        found = rendering.command(np.array([0, 0, -d]), np.array([0, 0, -rate]))
        assert found.force[2] == pytest.approx(1000.0 * max(d, 0.0))
        assert found.share == (1.0, 1.0)


@pytest.mark.parametrize("mass", [0.03, 0.05, 0.1])
def test_the_default_tank_acts_for_light_devices(mass: float) -> None:
    """A fall that a sampled spring would drive on without end: the tank as it comes gives its millijoule and no
    more.
    """
    seen = []

    class Watched(HapticRendering):
        def command(self, position: Array, velocity: Array) -> Rendered:
            seen.append(super().command(position, velocity))
            return seen[-1]

    energy = drop(Watched(Uniform(Properties(1500.0)), HapticSettings(Hooke(), passivity=EnergyTank())), mass, 20_000)
    wild = drop(
        HapticRendering(Uniform(Properties(1500.0)), HapticSettings(Hooke(), passivity=Observer(0.0))), mass, 20_000
    )
    late = 0.5 * (1500.0 * 0.1 * np.sqrt(mass / 1500.0) + 2.0) ** 2 / mass * PERIOD**2
    assert energy.max() < energy[0] + EnergyTank().filling + late
    assert wild.max() > energy[0] + 10 * EnergyTank().filling
    assert min(found.share[0] for found in seen) < 0.9


def test_what_a_touch_has_lost_is_not_given_back_in_the_next() -> None:
    """A hand that presses into a lossy material fills the tank; once it has left, the filling alone is there."""
    ledger, tank = EnergyTank(0.02, filling=1e-3).open(PERIOD), EnergyTank(0.02, filling=1e-3)
    ledger.book(-0.5)
    assert ledger.energy == tank.capacity
    ledger.leave()
    assert ledger.energy == tank.filling
    ledger.book(5e-4)
    ledger.leave()
    assert ledger.energy == pytest.approx(5e-4)


def test_a_share_falls_at_once_and_comes_back_slowly() -> None:
    assert ease(0.8, 0.1, PERIOD) == 0.1
    share = 0.1
    for _ in range(round(RETURN / PERIOD)):
        share = ease(share, 1.0, PERIOD)
    assert share == pytest.approx(1.0 - 0.9 * np.exp(-1.0), abs=2e-3)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, "a", None])
def test_bad_capacities_and_dampings_are_refused(bad: Any) -> None:
    with pytest.raises(InputError, match="tank"):
        EnergyTank(bad)
    with pytest.raises(InputError, match="most_damping"):
        EnergyTank(0.02, bad)
    with pytest.raises(InputError, match="filling"):
        EnergyTank(0.02, 20.0, bad)
    if bad != 0.0:
        with pytest.raises(InputError, match="most_damping"):
            Observer(bad)
