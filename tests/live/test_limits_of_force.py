"""The force above what the model and its uncertainty allow, and a model that no longer explains it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from live.prepared import NAMES, Prepared
from scripted import RIG, follow

from kinid.data.rig import Rig
from kinid.lab.experiments import prepare
from kinid.live import Pipeline, Session
from kinid.live.messages import Item, Joints, Wrench
from kinid.live.sources.lab import Laboratory
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load

MODELS = (("kelvin-voigt",), ("hunt-crossley",))
Law = Callable[[np.ndarray, np.ndarray], np.ndarray]


def press(law: Law, rig: Rig, robot: Robot) -> list[Item]:
    """Down by 4 mm at 4.7 mm/s from 0.2 s on, and 1.3 s of rest, at 1 kHz; the force is a law of depth and time."""
    t = np.arange(3000) / 1000.0
    down = 0.003 - 0.007 * np.clip((t - 0.2) / 1.5, 0.0, 1.0)
    offset = np.column_stack([0.0 * t, 0.0 * t, down])
    assert rig.surface is not None
    q = follow(robot, np.asarray(rig.surface.point) + offset @ np.asarray(rig.axes), np.zeros((len(t), 2)))
    still = robot.kinematics("ft_sensor", q, 0.0 * q, 0.0 * q)
    force = law(np.maximum(-down, 0.0), t)[:, None] * np.asarray(rig.axes)[2]
    wrench = tool_load(rig.carried, still, robot.gravity)
    in_sensor = np.einsum("nji,nj->ni", still.rotation, force)
    wrench[:, :3] += in_sensor
    wrench[:, 3:] += np.cross(robot.tip_in_sensor(), in_sensor)
    wrench += np.random.default_rng(1).normal(scale=np.asarray(rig.sensor.noise), size=wrench.shape)
    stamps = [10**9 + round(1e9 * at) for at in t.tolist()]
    return [item for s, a, b in zip(stamps, q, wrench) for item in (Joints(s, s, a), Wrench(s, s, b))]


@pytest.fixture(scope="module")
def still_rig() -> Rig:
    return Rig.parse_text(RIG + "bias = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n")


def events(items: list[Item], rig: Rig, model: tuple[str, ...]) -> Session:
    session = Session(Prepared(items), Pipeline(rig, model), NAMES)
    session.run()
    return session


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model[0])
@pytest.mark.parametrize(
    ("law", "begins"),
    [
        (lambda d, t: 700.0 * d + 19300.0 * np.maximum(d - 2e-3, 0.0), 1.272),
        (lambda d, t: np.where(d > 0.0, 700.0 * d + 2.0 * (t > 1.3), 0.0), 1.3),
        (lambda d, t: np.where(d > 0.0, 700.0 * d + 20.0 * np.maximum(t - 1.3, 0.0), 0.0), 1.3),
    ],
    ids=["a stop behind it", "a collision", "a ramp"],
)
def test_a_force_that_nothing_explains_is_said(law: Law, begins: float, model: tuple[str, ...], still_rig: Rig) -> None:
    robot = Robot.load(still_rig)
    session = events(press(law, still_rig, robot), still_rig, model)
    above = [event.t for event in session.events if event.kind == "force-above"]
    assert above
    assert begins < above[0] < begins + 0.1


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model[0])
def test_a_plain_press_has_no_such_force(model: tuple[str, ...], still_rig: Rig) -> None:
    plain = press(lambda d, t: 700.0 * d, still_rig, Robot.load(still_rig))
    assert not events(plain, still_rig, model).counts.keys() & {"force-above", "divergence", "force-jump", "border"}


@pytest.mark.parametrize("experiment", ["poke", "slide"])
def test_nor_has_the_laboratory(experiment: str) -> None:
    source = Laboratory(experiment, prepare(experiment, seed=77), 0.0)
    session = Session(source, Pipeline(source.rig, ("kelvin-voigt", "coulomb-friction")), NAMES)
    session.run()
    assert session.counts["touch"] >= 1
    assert not session.counts.keys() & {"force-above", "divergence", "force-jump"}


def test_a_force_that_is_none_of_the_depth_is_a_divergence(still_rig: Rig) -> None:
    robot = Robot.load(still_rig)
    items = press(lambda d, t: np.where(d > 0.0, 3.0 + 2.5 * np.sin(25.0 * t), 0.0), still_rig, robot)
    assert events(items, still_rig, ("kelvin-voigt",)).counts["divergence"] >= 1
