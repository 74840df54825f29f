"""Bilateral teleoperation with delay: stability, transparency, and the passivity controller."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import signal

from kinid.controllers import Environment, Properties, Teleoperator, Uniform, measured_impedance, simulate, study
from kinid.controllers.passivity import brake
from kinid.controllers.teleoperation import Study
from kinid.controllers.teleoperator import REFLECTIONS
from kinid.errors import InputError

FREQUENCY = [0.2, 0.5, 1.0, 2.0, 4.0, 8.0]


@pytest.fixture(scope="module")
def table() -> Study:
    return study()


def test_the_study(table: Study) -> None:
    """50 to 400 ms: reflection from the map is stable and transparent, direct reflection neither."""
    print("\n" + table.table())
    assert [row.delay for row in table.rows[::4]] == [0.05, 0.1, 0.2, 0.4]
    for row in table.rows:
        match row.method:
            case "direct":
                assert not row.stable
                assert row.error > 0.8
            case "impedance":
                assert row.stable
                assert row.error < 1e-12  # the formula, with the true map
            case _:
                assert row.stable
        assert row.nyquist in {None, row.stable}


def test_a_wrong_map_costs_transparency_not_stability() -> None:
    found = study(believed=Environment(732 * 1.2, 9.9 * 1.2), delays=[0.05, 0.4], methods=["impedance"])
    for row in found.rows:
        assert row.stable
        assert row.error == pytest.approx(0.2)


@pytest.mark.parametrize("method", ["direct", "impedance"])
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4])
def test_frequency_response_of_the_simulation_is_the_formula(method: str, delay: float) -> None:
    environment = Environment(500.0, 5.0)
    error = []
    for period in (1e-3, 2.5e-4):
        o = Teleoperator(delay=delay, period=period)
        formula = o.transmitted(environment, np.array(FREQUENCY), method)
        error.append(np.abs(measured_impedance(o, environment, FREQUENCY, method) / formula - 1).max())
    # a delay of half a period for averaging or holding, one more where there is no line: 2.5 or 7.5 % of phase at 8 Hz
    assert error[0] < (0.04 if delay else 0.08)
    assert error[1] < 0.3 * error[0]


def test_following_and_environment_against_scipy() -> None:
    o, e, omega = Teleoperator(), Environment(), 2 * np.pi * np.array(FREQUENCY)
    _, g = signal.freqs([140.0, 5000.0], [2.0, 5.0 + 140.0 + 9.9, 5000.0 + 732.0], omega)
    np.testing.assert_allclose(o.following(e, np.array(FREQUENCY)), g, rtol=1e-12)
    _, z = signal.freqs([9.9, 732.0], [1.0, 0.0], omega)
    np.testing.assert_allclose(e.impedance(np.array(FREQUENCY)), z, rtol=1e-12)
    _, hand = signal.freqs([0.8, 8.5, 250.0], [1.0, 0.0], omega)
    np.testing.assert_allclose(o.operator_impedance(np.array(FREQUENCY)), hand, rtol=1e-12)


@pytest.mark.parametrize("stiffness", [400.0, 732.0, 1000.0])
def test_nyquist_and_simulation_find_the_same_critical_delay(stiffness: float) -> None:
    environment, low, high = Environment(stiffness, 9.9), 0.0, 0.2
    assert Teleoperator(delay=low).is_stable(environment, "direct")
    assert not Teleoperator(delay=high).is_stable(environment, "direct")
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if Teleoperator(delay=middle).is_stable(environment, "direct") else (low, middle)
    # sampling adds 1 to 2 ms of round trip: simulate with a period that makes it small beside the delay
    for factor, stable in ((0.8, True), (1.25, False)):
        o = Teleoperator(delay=factor * low, period=1e-4)
        assert simulate(o, environment, "direct", duration=8.0).stable is stable


def test_nyquist_against_roots_without_delay() -> None:
    """The closed loop's polynomial, by its roots, for lines with and without a stable answer."""
    seen = set()
    for stiffness in (200.0, 2000.0, 20_000.0, 80_000.0):
        for hand in (0.1, 1.0, 8.0):
            o, e = Teleoperator(delay=0.0, hand_damping=hand), Environment(stiffness, 0.5)
            slave = np.array(
                [o.slave_mass, o.slave_damping + o.coupling_damping + e.damping, o.coupling_stiffness + stiffness]
            )
            master = np.array([o.moving_mass, o.master_damping + hand, o.hand_stiffness])
            reflected = np.polymul([e.damping, stiffness], [o.coupling_damping, o.coupling_stiffness])
            expected = bool((np.roots(np.polyadd(np.polymul(slave, master), reflected)).real < 0).all())
            assert o.is_stable(e, "direct") is expected
            seen.add(expected)
    assert seen == {True, False}


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2, 0.4])
def test_passivity_controller_keeps_direct_reflection_stable(delay: float) -> None:
    """The same line: direct reflection runs away; observed and damped it rests, and the debt it ever had is small."""
    o, e = Teleoperator(delay=delay), Environment()
    wild, tame = simulate(o, e, "direct"), simulate(o, e, "passivated")
    spent = 0.5 * e.stiffness * 0.01**2  # to press the material in
    assert wild.port_energy.min() < -100 * spent
    assert not wild.stable
    assert tame.stable
    assert tame.port_energy.min() > -spent
    assert np.abs(tame.master).max() < 0.012
    assert tame.injected.max() > 0
    # the push ends where it would without any delay
    still = simulate(dataclasses.replace(o, delay=0.0, hand_damping=30.0), e, "direct")
    assert tame.master[-1] == pytest.approx(still.master[-1], abs=3e-4)


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2, 0.4])
def test_a_tank_keeps_direct_reflection_passive_and_stable(delay: float) -> None:
    """It gives no more than its capacity, ever, and ends where the push ends without any delay."""
    o, e = Teleoperator(delay=delay), Environment()
    tame = simulate(o, e, "tank")
    assert tame.stable
    # what the acceleration within a period adds is booked one period later
    late = 0.5 * np.abs(tame.force).max() ** 2 / o.moving_mass * o.period**2
    assert tame.port_energy.min() > -o.tank - late
    assert tame.injected.max() > 0
    still = simulate(dataclasses.replace(o, delay=0.0, hand_damping=30.0), e, "direct")
    assert tame.master[-1] == pytest.approx(still.master[-1], abs=3e-4)
    # no force that goes on and off: it rises and falls with the echoes, once a round trip
    echoes = tame.t[-1] / (2 * delay)
    assert np.abs(np.diff(tame.force)).sum() < 2 * echoes * np.abs(tame.force).max()
    assert np.abs(np.diff(tame.share)).max() < 0.5


@pytest.mark.parametrize("stiffness", [732.0, 1853.0, 2400.0])
@pytest.mark.parametrize("method", ["passivated", "tank"])
def test_passivity_controllers_hold_hard_materials_at_400_ms(method: str, stiffness: float) -> None:
    """All that is felt is there, but for what the slave's coupling gives way."""
    o = Teleoperator(delay=0.4)
    motion = simulate(o, Environment(stiffness, 0.01 * stiffness), method)
    assert motion.stable
    felt = motion.force[-1000:].mean() / motion.master[-1000:].mean()
    assert felt == pytest.approx(stiffness * 5000 / (stiffness + 5000), rel=0.02)


@pytest.mark.parametrize("delay", [0.2, 0.4])
def test_a_damper_below_the_bound_never_pays(delay: float) -> None:
    """By simulation and by Nyquist's criterion the same stiffness; below it the account is settled, above never."""
    o = Teleoperator(delay=delay, most_damping=300.0)
    low, high = 50.0, 20_000.0
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if o.pays(Environment(middle, 0.01 * middle)) else (low, middle)
    print(f"{1e3 * delay:.0f} ms, 300 N·s/m: {low:.0f} N/m")
    for factor, stable in ((0.8, True), (1.2, False)):
        e = Environment(factor * low, 0.01 * factor * low)
        motion = simulate(o, e, "passivated", duration=60.0)
        assert motion.stable is stable
        late = motion.injected[len(motion.t) // 2 :]
        assert stable or (late >= 300.0 * (1 - 1e-12)).all()
    # without mass, slave and sampling it is the formula of the docstring
    felt, k = low * 5000 / (low + 5000), 250.0
    bound = 2 * delay * np.sqrt(felt**2 - k**2) / (np.pi - np.arccos(k / felt))
    assert bound == pytest.approx(300.0 + 8.5, rel=0.1)


def test_the_damping_of_a_delay_is_that_of_the_bound_for_any_hand() -> None:
    for delay in (0.05, 0.2, 0.4):
        o = Teleoperator(delay=delay)
        for k in (10.0, 250.0, 1000.0):
            felt = 2500.0
            needed = o.round_trip * np.sqrt(felt**2 - k**2) / (np.pi - np.arccos(k / felt))
            assert needed <= o.full_damping * (1 + 1e-12)
        assert o.full_damping == Teleoperator(delay=delay, hand_stiffness=77.0, hand_damping=3.0).full_damping
    assert Teleoperator(most_damping=12.0).full_damping == 12.0


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4])
def test_a_line_of_waves_is_passive_and_its_simulation_is_the_formula(delay: float) -> None:
    frequency = np.geomspace(0.05, 50.0, 4000)
    for stiffness in (100.0, 1853.0, 20_000.0):
        o, e = Teleoperator(delay=delay), Environment(stiffness, 1.0)
        assert o.transmitted(e, frequency, "wave").real.min() > 0.0
        assert o.is_stable(e, "wave")
        assert simulate(o, e, "wave").port_energy.min() > -1e-4
    # a material that damps, so that waves die out between a master that doesn't give way and the slave
    o, e = Teleoperator(delay=delay, period=2.5e-4), Environment(300.0, 90.0)
    at = [1.0, 2.0, 4.0]
    found = measured_impedance(o, e, at, "wave")
    # held for half a period and counted for one each way: 1.5 ms in all at 250 µs
    assert np.abs(found / o.transmitted(e, np.array(at), "wave") - 1).max() < 0.06


def test_a_wave_line_at_rest_is_a_spring_of_its_own() -> None:
    """b/T in series with what the slave feels: the force is whole, the stiffness isn't."""
    for delay in (0.1, 0.4):
        o, e = Teleoperator(delay=delay), Environment()
        motion = simulate(o, e, "wave")
        slave = 732.0 * 5000 / 5732
        line = o.wave_impedance / delay
        felt = motion.force[-1000:].mean() / motion.master[-1000:].mean()
        assert felt == pytest.approx(1 / (1 / slave + 1 / line), rel=0.03)
        assert motion.force[-1] == pytest.approx(motion.environment_force[-1], rel=1e-3)


def test_a_spring_lets_a_damper_be_stronger_than_a_held_one_can_be() -> None:
    """Slow motion meets the damper; fast motion no more than the spring."""
    force, slow, quick = 0.0, [], []
    for _ in range(4000):
        force = brake(force, 1e-6, 30_000.0, 1276.0, 1e-3)
        slow.append(force)
    assert slow[-1] == pytest.approx(1276.0 * 1e-3, rel=1e-6)
    for i in range(4000):
        force = brake(force, 1e-3 * np.sin(2 * np.pi * 0.05 * i) * 2 * np.pi * 0.05, 30_000.0, 1276.0, 1e-3)
        quick.append(force)
    assert np.abs(quick[2000:]).max() < 1.05 * 30_000.0 * 1e-3
    assert brake(5.0, 1e-3, 30_000.0, 0.0, 1e-3) == 0.0


def test_impedance_reflection_settles_in_static_balance() -> None:
    motion = simulate(Teleoperator(delay=0.2), Environment(), "impedance")
    x = motion.master[-1]
    assert 250.0 * (0.01 - x) == pytest.approx(732.0 * x, rel=1e-6)
    assert motion.force[-1] == pytest.approx(motion.environment_force[-1], rel=0.15)  # the slave's spring gives way
    assert motion.port_energy.min() > -1e-6


def test_the_data_of_a_figure(table: Study) -> None:
    assert len(table.rows) == 16
    assert set(table.transmitted) == set(table.motions) == {(row.delay, row.method) for row in table.rows}
    for z in table.transmitted.values():
        assert z.shape == table.frequency.shape == table.environment.shape
    assert {row.method for row in table.rows} == set(REFLECTIONS)


def test_environment_from_a_map() -> None:
    e = Environment.at(Uniform(Properties(2000.0, 30.0, 1.5)), 0.0, 0.0, depth=0.004)
    assert e.stiffness * 0.004 == pytest.approx(2000 * 0.004**1.5)
    assert e.damping == pytest.approx(30 * 0.004**1.5)
    assert Environment.at(Uniform(Properties(700.0, 8.0)), 0, 0) == Environment(700.0, 8.0)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"master_damping": 0.0, "hand_damping": 0.0}, "without damping on a delayed line"),
        ({"hand_stiffness": -1.0}, "hand_stiffness"),
        ({"master_mass": 0.0}, "master_mass"),
        ({"slave_mass": np.nan}, "slave_mass"),
        ({"delay": -0.1}, "delay"),
        ({"coupling_damping": -1.0}, "coupling_damping"),
        ({"coupling_stiffness": 0.0}, "hold"),
        ({"period": 0.0}, "period"),
        ({"coupling_damping": 5000.0}, "too strong"),
        ({"most_damping": -1.0}, "most_damping"),
        ({"network": "lossy"}, "network"),
        ({"tank": 0.0}, "tank"),
        ({"slave_mass": "2"}, "slave_mass"),
        ({"delay": None}, "delay"),
    ],
)
def test_a_line_that_makes_no_sense_is_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Teleoperator(**bad)


def test_other_bad_input_is_refused() -> None:
    o, e = Teleoperator(), Environment()
    Teleoperator(master_damping=0.0, hand_damping=0.0, delay=0.0)
    with pytest.raises(InputError, match="stiffness"):
        Environment(-1.0)
    with pytest.raises(InputError, match="method 'dirct'"):
        simulate(o, e, "dirct")
    with pytest.raises(InputError, match="duration"):
        simulate(o, e, duration=1.0)
    with pytest.raises(InputError, match="depth"):
        simulate(o, e, depth=0.0)
    with pytest.raises(InputError, match="linear"):
        o.is_stable(e, "passivated")
    with pytest.raises(InputError, match="linear"):
        o.is_stable(e, "tank")
    with pytest.raises(InputError, match="delay"):
        study(delays=[0.1, -0.1])
    with pytest.raises(InputError, match="delays"):
        study(delays=[])
    with pytest.raises(InputError, match="delay slow"):
        study(delays=["slow"])  # type: ignore[list-item]
    with pytest.raises(InputError, match="depth deep"):
        simulate(o, e, depth="deep")  # type: ignore[arg-type]
