"""Teleoperation in six degrees of freedom: its kinematics, its line along one axis, energy, and rest on lossy lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinid.controllers import Environment, Teleoperator, _rigid_line, rigid_teleoperation, simulate
from kinid.controllers.packets import Network
from kinid.controllers.rigid_teleoperation import RigidMotion, Tool, simulate_rigid
from kinid.controllers.teleoperator import METHODS
from kinid.errors import InputError

LOSSY = Network(jitter=0.02, loss=0.1, burst=3.0, seed=11)
HARD = Environment(1853.0, 18.5)


def test_poses_are_stepped_and_compared_as_scipy_does() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        turn, other, spin = Rotation.random(random_state=rng), Rotation.random(random_state=rng), rng.normal(size=3)
        body = np.array([*rng.normal(size=3), *np.roll(turn.as_quat(), 1), *rng.normal(size=3), *spin])
        target, apart, v = body.copy(), np.empty(6), np.empty(3)
        target[3:7] = np.roll(other.as_quat(), 1)
        _rigid_line._apart(body, target, apart)
        np.testing.assert_allclose(apart[3:], (other * turn.inv()).as_rotvec(), atol=1e-9)
        _rigid_line._turned(body, np.array([0.1, -0.2, 0.3]), v)
        np.testing.assert_allclose(v, turn.apply([0.1, -0.2, 0.3]), atol=1e-12)
        for _ in range(1000):
            _rigid_line._step(body, 1e-3)
        there = Rotation.from_rotvec(spin) * turn
        assert np.abs((Rotation.from_quat(np.roll(body[3:7], -1)) * there.inv()).as_rotvec()).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
def test_straight_in_it_is_the_line_of_one_axis(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rigid_teleoperation, "ALONG", 0.0)
    monkeypatch.setattr(rigid_teleoperation, "TURNED", (0.0, 0.0, 0.0))
    o, e = Teleoperator(delay=0.1), Environment()
    there, one = simulate_rigid(o, e, method, duration=4.0), simulate(o, e, method, duration=4.0)
    first = slice(0, 1500) if method == "direct" else slice(None)  # it runs away, and with it all differences
    for found, expected in ((there.depth, one.master), (there.wrench[:, 2], one.force)):
        apart = float(np.sqrt(np.mean((found[first] - expected[first]) ** 2)))
        assert apart < 0.02 * np.abs(expected[first]).max()
    assert np.abs(there.master[first][:, [0, 1, 3, 4, 5]]).max() < 1e-9


def energy_given(motion: RigidMotion) -> float:
    return -float(motion.port_energy.min())


def test_waves_give_no_energy_where_force_gives_more_and_more() -> None:
    for network in (Network(), LOSSY):
        o = Teleoperator(delay=0.4, network=network)
        assert energy_given(simulate_rigid(o, HARD, "wave")) < 1e-3
        assert energy_given(simulate_rigid(o, HARD, "direct")) > 1.0


@pytest.mark.parametrize("network", [Network(), LOSSY], ids=["ideal", "lossy"])
def test_all_but_direct_force_come_to_rest(network: Network) -> None:
    o = Teleoperator(delay=0.4, network=network)
    for method in METHODS:
        motion = simulate_rigid(o, HARD, method)
        print(f"{method}: felt {motion.stiffness:.0f} N/m, tracking {1e3 * motion.tracking(0.4):.2f} mm")
        assert motion.stable is (method != "direct"), method
        if method in ("passivated", "tank"):  # nothing but the slave's coupling is missing
            assert motion.stiffness == pytest.approx(1853 * 5000 / 6853, rel=0.03)
        if method == "tank":
            late = 0.5 * np.abs(motion.wrench[:, :3]).max() ** 2 / o.moving_mass * o.period**2
            assert energy_given(motion) < o.tank + 6 * late
    soft = simulate_rigid(o, HARD, "impedance", Environment(0.8 * 1853, 0.8 * 18.5))
    assert soft.stiffness == pytest.approx(0.8 * 1853, rel=1e-3)


def drawn(seed: int) -> tuple[Teleoperator, Environment, Tool]:
    """A hand, a line, a material and a tool; controllers know of it what `Teleoperator` says of device and delay."""
    rng = np.random.default_rng([20, seed])
    stiffness = float(np.exp(rng.uniform(np.log(300.0), np.log(2400.0))))
    network = Network(rng.uniform(0.0, 0.03), rng.uniform(0.0, 0.2), rng.uniform(1.0, 5.0), seed)
    hand = {"hand_mass": (0.2, 1.0), "hand_damping": (3.0, 15.0), "hand_stiffness": (80.0, 600.0)}
    drawn_hand = {name: float(rng.uniform(*range_)) for name, range_ in hand.items()}
    o = Teleoperator(delay=float(rng.uniform(0.02, 0.4)), network=network, **drawn_hand)
    return o, Environment(stiffness, 0.01 * stiffness * rng.uniform(0.5, 1.5)), Tool(friction=rng.uniform(0.2, 1.0))


def at_rest(method: str, seeds: range) -> int:
    count = 0
    for seed in seeds:
        o, e, tool = drawn(seed)
        count += simulate_rigid(o, e, method, tool=tool).stable
    return count


def test_some_hands_lines_and_materials() -> None:
    for method in ("passivated", "tank", "wave"):
        assert at_rest(method, range(4)) >= 3, method
    assert at_rest("direct", range(4)) == 0


@pytest.mark.slow
def test_a_hundred_hands_lines_and_materials() -> None:
    for method in METHODS:
        count = at_rest(method, range(300, 400))
        print(f"{method}: {count} of 100 at rest")
        assert count == 0 if method == "direct" else count >= 90, method


@pytest.mark.parametrize(
    ("bad", "match"),
    [({"tip": (0.0, 0.0)}, "tip"), ({"lever": 0.0}, "lever"), ({"friction": -0.1}, "friction")],
)
def test_a_tool_that_makes_no_sense_is_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Tool(**bad)
    with pytest.raises(InputError, match="method 'waves'"):
        simulate_rigid(Teleoperator(), HARD, "waves")
    with pytest.raises(InputError, match="duration"):
        simulate_rigid(Teleoperator(), HARD, duration=1.0)
