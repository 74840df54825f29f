"""The tool's own load, the sensor's faults, and wrenches whose sign or axes gravity contradicts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.rig import Rig, ToolSpec
from kinid.errors import InputError
from kinid.robotics.motion import JointMotion
from kinid.robotics.robot import Kinematics, Robot
from kinid.robotics.wrench import MOST_FREE, Reading, read_wrench, tool_load

Array = NDArray[np.float64]

POSE = (0.2, 0.5, -0.1, -1.2, 0.3, 0.9, 0.0)
NOISE = np.array([0.015, 0.015, 0.03, 5e-4, 6e-4, 3e-4])  # of a small wrist sensor [N, N·m]


def rig(mass: float = 0.24, com: Any = (0.0, 0.0, 0.049), gravity: Any = (0.0, 0.0, -9.81), **sensor: Any) -> Rig:
    tables: dict[str, Any] = {"robot": {"model": "lwr4plus", "gravity": list(gravity)}, "sensor": sensor}
    tables["tool"] = {"mass": mass, "com": list(com)}
    return Rig.parse(tables)


def moving(moves: Any, n: int = 400) -> tuple[Array, JointMotion]:
    t = np.arange(n) / 200.0
    return t, JointMotion(*moves(t), {})


def read(the_rig: Rig, t: Array, motion: JointMotion, wrench: Array, **options: Any) -> Reading:
    """All rows are free motion."""
    log = Log(t, q=motion.q, wrench=wrench)
    options = {"bias": "auto", "trust": False} | options
    return read_wrench(log, the_rig, Robot.load(the_rig), motion, np.arange(len(t)), **options)


def test_tool_load_is_that_of_a_free_body(swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    """Against Pinocchio's recursive Newton-Euler of one body, for random tools and tilted bases."""
    rng = np.random.default_rng(0)
    for seed in range(8):
        half = rng.normal(size=(3, 3))
        second = half @ half.T * 1e-3  # of mass [kg·m²]; the inertia of any such distribution is a possible one
        inertia = np.trace(second) * np.eye(3) - second
        tables = rig(rng.uniform(0.1, 3), rng.normal(size=3) * 0.1, rng.normal(size=3) * 10).model_dump(
            exclude_none=True
        )
        tables["tool"]["inertia"] = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        the_rig = Rig.parse(tables)
        robot = Robot.load(the_rig)
        q, dq, ddq = swing(POSE, seed=seed, size=1.0, speed=6.0)(np.arange(200) / 50)
        found = tool_load(the_rig.tool, robot.kinematics("ft_sensor", q, dq, ddq), robot.gravity)
        expected = weighed(the_rig, robot, q, dq, ddq)
        assert np.abs(expected).max() > 5
        # rounding of sums near 100 N
        np.testing.assert_allclose(found, expected, atol=1e-11)


def test_a_tool_at_rest_reads_its_weight() -> None:
    """The contract: m·Rᵀ·g, and its moment about the sensor's origin."""
    the_rig = rig(mass=0.5, com=(0.01, 0.02, 0.05))
    robot = Robot.load(the_rig)
    place = robot.kinematics("ft_sensor", np.array([POSE]))
    load = tool_load(the_rig.tool, place, robot.gravity)[0]
    weight = 0.5 * place.rotation[0].T @ [0, 0, -9.81]
    np.testing.assert_allclose(load[:3], weight, atol=1e-14)
    np.testing.assert_allclose(load[3:], np.cross([0.01, 0.02, 0.05], weight), atol=1e-14)


def test_a_tool_in_free_fall_weighs_nothing() -> None:
    eye, zero = np.eye(3)[None], np.zeros((1, 3))
    falling = Kinematics(eye, zero, zero, np.array([[0.0, 0.0, -9.81]]), zero, zero)
    assert not tool_load(ToolSpec(mass=2.0, com=(0.1, 0.2, 0.3)), falling, np.array([0, 0, -9.81])).any()


def test_a_tool_on_a_turntable_is_flung_outward() -> None:
    """m ω² r along the arm to its centre of mass, and no moment; by hand."""
    eye, zero = np.eye(3)[None], np.zeros((1, 3))
    turning = Kinematics(eye, zero, zero, zero, np.array([[0.0, 0.0, 3.0]]), zero)
    load = tool_load(ToolSpec(mass=2.0, com=(0.1, 0.0, 0.0)), turning, np.zeros(3))[0]
    np.testing.assert_allclose(load, [2.0 * 9.0 * 0.1, 0, 0, 0, 0, 0], atol=1e-14)


def test_bias_and_crosstalk_are_removed_exactly(swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    rng = np.random.default_rng(1)
    crosstalk = np.eye(6) + 0.05 * rng.normal(size=(6, 6))
    bias = rng.normal(size=6) * 5
    t, motion = moving(swing(POSE))
    the_rig = rig(crosstalk=crosstalk.tolist())
    load = weighed(the_rig, Robot.load(the_rig), motion.q, motion.dq, motion.ddq)
    contact = rng.normal(size=(len(t), 6))
    contact[::2] = 0.0  # more than half of the free samples feel nothing but the tool: the median ignores the rest
    contact[1::2, 0] *= 0.0
    raw = (load + contact * 0) @ crosstalk.T + bias
    reading = read(the_rig, t, motion, raw)
    np.testing.assert_allclose(reading.bias, bias, atol=1e-12)
    np.testing.assert_allclose(reading.true(), load, atol=1e-12)
    assert reading.facts["bias_from"] == "median of free motion"
    raw = (load + contact) @ crosstalk.T + bias
    for known in (
        read(rig(crosstalk=crosstalk.tolist(), bias=bias.tolist()), t, motion, raw, trust=True),
        read(the_rig, t, motion, raw, bias=bias, trust=True),
    ):
        np.testing.assert_allclose(known.true(), load + contact, atol=1e-12)


def test_where_a_bias_comes_from(swing: Callable[..., Any]) -> None:
    t, motion = moving(swing(POSE))
    raw = np.ones((len(t), 6))
    plain = rig(mass=0.0)
    assert read(plain, t, motion, raw, bias="none").facts["bias_from"] == "none"
    np.testing.assert_array_equal(read(plain, t, motion, raw, bias="none").bias, 0.0)
    np.testing.assert_array_equal(read(plain, t, motion, raw).bias, 1.0)
    ready = rig(mass=0.0, bias=[1, 2, 3, 4, 5, 6])
    assert read(ready, t, motion, raw).facts["bias_from"] == "rig"
    np.testing.assert_array_equal(read(ready, t, motion, raw).bias, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(read(ready, t, motion, raw, bias=[6, 5, 4, 3, 2, 1]).bias, [6, 5, 4, 3, 2, 1])
    log = Log(t, q=motion.q, wrench=raw)
    none = read_wrench(log, plain, Robot.load(plain), motion, np.arange(5), "auto", trust=False)
    assert "no free motion" in none.facts["bias_from"]
    assert not none.bias.any()


@pytest.mark.parametrize("bias", [[1, 2, 3], [1, 2, 3, 4, 5, np.nan], "some"])
def test_a_bias_that_is_none_is_refused(bias: Any, swing: Callable[..., Any]) -> None:
    t, motion = moving(swing(POSE))
    with pytest.raises(InputError, match=r"six (finite )?numbers"):
        read(rig(), t, motion, np.zeros((len(t), 6)), bias=bias, trust=True)


def test_the_bias_of_a_long_log_takes_a_part_of_it(swing: Callable[..., Any]) -> None:
    t, motion = moving(swing(POSE), n=MOST_FREE * 2 + 500)
    reading = read(rig(mass=0.0), t, motion, np.ones((len(t), 6)))
    assert MOST_FREE // 2 < reading.facts["free_samples_used"] <= MOST_FREE


def test_invalid_samples_of_free_motion_are_left_out(swing: Callable[..., Any]) -> None:
    t, motion = moving(swing(POSE))
    raw = np.full((len(t), 6), 2.0)
    raw[::3, 1], raw[1::7, 2] = np.nan, np.inf
    np.testing.assert_array_equal(read(rig(mass=0.0), t, motion, raw).bias, 2.0)


def test_a_wrench_in_base_axes_is_turned(swing: Callable[..., Any], weighed: Callable[..., Any]) -> None:
    t, motion = moving(swing(POSE))
    the_rig = rig(wrench_frame="base")
    robot = Robot.load(the_rig)
    load = weighed(the_rig, robot, motion.q, motion.dq, motion.ddq)
    turn = robot.kinematics("ft_sensor", motion.q).rotation
    base = np.einsum("nij,nkj->nki", turn, load.reshape(-1, 2, 3)).reshape(-1, 6)
    np.testing.assert_allclose(read(the_rig, t, motion, base, bias="none").true(), load, atol=1e-12)


def test_a_wrench_without_a_frame_is_refused(swing: Callable[..., Any]) -> None:
    the_rig = Rig.parse({"robot": {"model": "ur5", "tip_frame": "tool0"}})
    t = np.arange(10.0)
    motion = JointMotion(*(np.zeros((10, 6)),) * 3, {})
    log = Log(t, q=motion.q, wrench=np.zeros((10, 6)))
    with pytest.raises(InputError, match=r"without the frame it is measured in.*\[robot\] sensor_frame"):
        read_wrench(log, the_rig, Robot.load(the_rig), motion, np.arange(10), "auto", trust=False)


# What gravity contradicts


def measured(the_rig: Rig, motion: JointMotion, weighed: Callable[..., Any], seed: int = 0) -> tuple[Robot, Array]:
    """What an honest sensor reads in free motion, with noise."""
    robot = Robot.load(the_rig)
    load = weighed(the_rig, robot, motion.q, motion.dq, motion.ddq)
    return robot, load + NOISE * np.random.default_rng(seed).normal(size=load.shape)


def in_base(robot: Robot, motion: JointMotion, load: Array) -> Array:
    turn = robot.kinematics("ft_sensor", motion.q).rotation
    out: Array = np.einsum("nij,nkj->nki", turn, load.reshape(-1, 2, 3)).reshape(-1, 6)
    return out


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (0, 0, 9.81), (6.0, -5.0, 5.9)])
@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_wrong_sign_and_axes_are_refused(
    gravity: Any, bias: float, swing: Callable[..., Any], weighed: Callable[..., Any]
) -> None:
    the_rig = rig(gravity=gravity)
    t, motion = moving(swing(POSE, size=0.8))
    robot, load = measured(the_rig, motion, weighed)
    wrong = {
        "with the opposite sign": -load,
        "as axes of the base": in_base(robot, motion, load),
        "as axes of the base with the opposite sign": -in_base(robot, motion, load),
    }
    offset = bias * np.random.default_rng(1).normal(size=6)
    read(the_rig, t, motion, load + offset)
    for how, wrench in wrong.items():
        with pytest.raises(InputError, match="gravity in free motion explains") as caught:
            read(the_rig, t, motion, wrench + offset)
        message = str(caught.value)
        assert f"better {how};" in message
        assert "\n" not in message
        assert ("scale = -1" in message) == ("sign" in how)  # the remedy that fits, and no other
        assert ('wrench_frame = "base"' in message) == ("axes" in how)
        assert "--trust-wrench" in message
        read(the_rig, t, motion, wrench + offset, trust=True)


def test_a_rig_that_says_base_is_refused_when_the_axes_are_the_sensors(
    swing: Callable[..., Any], weighed: Callable[..., Any]
) -> None:
    the_rig = rig(wrench_frame="base")
    t, motion = moving(swing(POSE, size=0.8))
    _, load = measured(the_rig, motion, weighed)
    with pytest.raises(InputError, match="loads on the tool in base axes"):
        read(the_rig, t, motion, load)


def test_wrong_sign_is_refused_without_any_turning(weighed: Callable[..., Any]) -> None:
    """One pose, as in probing: there gravity alone must tell."""
    the_rig = rig()
    t = np.arange(200) / 200
    still = np.zeros((200, 7))
    motion = JointMotion(np.tile(POSE, (200, 1)), still, still, {})
    robot, load = measured(the_rig, motion, weighed)
    read(the_rig, t, motion, load)
    read(the_rig, t, motion, load - load[0])  # tared in this very pose: says nothing
    for wrench in (-load, in_base(robot, motion, load)):
        with pytest.raises(InputError, match="explains"):
            read(the_rig, t, motion, wrench)


@settings(max_examples=300, deadline=None)
@example(seed=11890, size=0.2, mass_error=0.0, bias=4.0, noise=0.0, tilt=0.0)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([0.0, 0.05, 0.2, 0.8]),
    mass_error=st.floats(-0.3, 0.3),
    bias=st.floats(0, 20),
    noise=st.sampled_from([0.0, 1.0, 10.0]),
    tilt=st.floats(0, 5),
)
def test_right_data_are_not_refused(
    swing: Callable[..., Any],
    seed: int,
    size: float,
    mass_error: float,
    bias: float,
    noise: float,
    tilt: float,
) -> None:
    """With a tool mass 30 % wrong, the sensor turned by 5°, ten times the noise, a bias of many times the weight."""
    rng = np.random.default_rng(seed)
    t, motion = moving(swing(POSE, seed=seed % 1000, size=size), n=200)
    the_rig = rig(gravity=9.81 * (g := rng.normal(size=3)) / np.linalg.norm(g))
    robot = Robot.load(the_rig)
    kinematics = robot.kinematics("ft_sensor", motion.q, motion.dq, motion.ddq)
    load = tool_load(rig(mass=0.24 * (1 + mass_error)).tool, kinematics, robot.gravity)
    axis = rng.normal(size=3)
    axis *= np.deg2rad(tilt) / np.linalg.norm(axis)
    load = load + np.hstack([np.cross(load[:, :3], axis), np.cross(load[:, 3:], axis)])  # to first order
    direction = rng.normal(size=6)
    offset = bias * direction / np.linalg.norm(direction[:3])
    if size <= 0.05:
        # Without turning, a bias of twice the weight in just the wrong direction can't be told from a wrong sign: no
        # reading of the data can. The rig's [sensor] bias or --trust-wrench settle it.
        weight = load[:, :3].mean(axis=0)
        turned = np.einsum("nij,nj->ni", kinematics.rotation, load[:, :3]).mean(axis=0)
        for other in (-weight, turned, -turned):
            gap = np.linalg.norm(weight + offset[:3] - other)
            assume(gap > 0.6 * np.linalg.norm(offset[:3]) or np.linalg.norm(offset[:3]) < 2.0)
    read(the_rig, t, motion, load + offset + noise * NOISE * rng.normal(size=load.shape))


def test_a_known_bias_is_no_ground_for_suspicion(weighed: Callable[..., Any]) -> None:
    """Without turning, a bias of −2 m g looks like a wrong sign; not when the rig or the caller names it."""
    t, still = np.arange(200) / 200, np.zeros((200, 7))
    motion = JointMotion(np.tile(POSE, (200, 1)), still, still, {})
    _, load = measured(rig(), motion, weighed)
    bias = np.concatenate([-2 * load[:, :3].mean(axis=0), np.zeros(3)])
    with pytest.raises(InputError, match="explains"):
        read(rig(), t, motion, load + bias)
    read(rig(bias=bias.tolist()), t, motion, load + bias)
    read(rig(), t, motion, load + bias, bias=bias)


def test_a_heavy_contact_in_a_tenth_of_free_motion_does_not_matter(
    swing: Callable[..., Any], weighed: Callable[..., Any]
) -> None:
    """Labels are rough: the tool already presses in the last samples that are called free."""
    t, motion = moving(swing(POSE, size=0.8))
    _, load = measured(rig(), motion, weighed)
    load[-40:, 2] -= np.linspace(0, 15, 40)
    reading = read(rig(), t, motion, load)
    # the median moves by the quantile that a tenth of one-sided outliers shift: some tenth of the noise
    np.testing.assert_allclose(reading.bias, 0.0, atol=0.01)
