"""What `contact` doubts of joint torques beside those that the robot's model predicts."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from contact.doubting import changed, doubts

import kinid.urdf
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.inverse_dynamics import inverse_dynamics, joint_torques
from kinid.robotics.robot import Robot


@pytest.fixture(scope="module")
def torques(touched: tuple[Log, Rig, Robot]) -> np.ndarray:
    """As a sensor in each joint reads them, with friction of the size that arms have."""
    log, rig, robot = touched
    assert log.q is not None
    ideal = joint_torques(dataclasses.replace(log, tau=np.zeros((len(log), 7))), rig, robot=robot).predicted
    moves = np.sign(np.gradient(log.q, axis=0)) * [0.4, 0.4, 0.3, 0.3, 0.2, 0.1, 0.1]
    return ideal + moves + np.random.default_rng(1).normal(scale=0.1, size=ideal.shape)


@pytest.mark.parametrize(("factor", "unit"), [(1.0, None), (1e3, "Nmm"), (1e-3, "kNm")])
def test_joint_torques_in_another_unit(touched: tuple[Log, Rig, Robot], factor: float, unit: str | None) -> None:
    log, rig, robot = touched
    torques = joint_torques(dataclasses.replace(log, tau=np.zeros((len(log), 7))), rig, robot=robot).predicted
    said = doubts(dataclasses.replace(log, tau=factor * torques), rig, robot)
    assert said == "" if unit is None else f'tau = {{ unit = "{unit}" }}' in said


def test_joint_torques_of_the_opposite_sign_in_another_order_or_dead(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    torques = joint_torques(dataclasses.replace(log, tau=np.zeros((len(log), 7))), rig, robot=robot).predicted
    tau = torques + np.random.default_rng(1).normal(scale=0.1, size=torques.shape)
    assert doubts(dataclasses.replace(log, tau=tau), rig, robot) == ""
    for wrong, words in (
        (-tau, "tau = { scale = -1 }"),
        (tau[:, [0, 3, 2, 1, 4, 5, 6]], "tau2 is what the robot's model predicts of tau4"),
        (tau / 160, "tau = { scale = 16"),
        (0.0 * tau, "the joint torques never change"),
        (tau * [1, 1, 1, 1, 0, 1, 1], "tau5 never changes"),
    ):
        assert words in doubts(dataclasses.replace(log, tau=wrong), rig, robot)


def scaled(joint: int, factor: float) -> np.ndarray:
    return np.where(np.arange(7) == joint - 1, factor, 1.0)


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        (scaled(4, -1.0), "tau4 has the opposite sign of what the robot's model predicts of"),
        (scaled(4, 1e3), "times what the robot's model predicts of"),
        (np.full(7, 0.1), "are not those that the robot's model predicts"),
        (np.linspace(8.0, 12.0, 7), "are not those that the robot's model predicts"),
    ],
)
def test_torques_of_another_sign_or_scale(
    touched: tuple[Log, Rig, Robot], torques: np.ndarray, factors: np.ndarray, says: str
) -> None:
    log, rig, robot = touched
    assert doubts(dataclasses.replace(log, tau=torques), rig, robot) == ""
    assert says in doubts(dataclasses.replace(log, tau=torques * factors), rig, robot)


def test_torques_of_noise_alone_or_without_gravity(touched: tuple[Log, Rig, Robot], torques: np.ndarray) -> None:
    log, rig, robot = touched
    noise = np.random.default_rng(2).normal(scale=torques.std(axis=0) + 5.0, size=torques.shape)
    for tau in (noise, torques - torques.mean(axis=0)):
        assert 'torques = "external"' in doubts(dataclasses.replace(log, tau=tau), rig, robot)


def test_a_channel_that_stands_still_for_a_while(touched: tuple[Log, Rig, Robot], torques: np.ndarray) -> None:
    log, rig, robot = touched
    tau = torques.copy()
    tau[2000:4000, 1] = tau[2000, 1]
    assert "tau2 repeats one reading for 4 s" in doubts(dataclasses.replace(log, tau=tau), rig, robot)


def test_an_arm_that_its_friction_moves_more_than_its_weight(tmp_path: Path) -> None:
    """One that lies flat: friction is all that its drives feel, and no model of rigid bodies has it."""
    links = "".join(
        f'<link name="l{i}"><inertial><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for i in range(3)
    )
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 0 1"/></joint>'
        for i in range(2)
    )
    (tmp_path / "flat.urdf").write_text(f'<robot name="flat">{links}{joints}</robot>')
    rig = Rig.parse_text('[robot]\nmodel = "flat.urdf"\n', tmp_path)
    t = np.arange(4000) / 500.0
    q = np.stack([np.sin(t), np.sin(1.7 * t)], axis=1)
    rub = 2.0 * np.sign(np.gradient(q, axis=0)) + np.random.default_rng(3).normal(scale=0.05, size=q.shape)
    tau = rub + joint_torques(Log(t=t, q=q, tau=rub), rig).predicted
    assert doubts(Log(t=t, q=q, tau=tau), rig, Robot.load(rig)) == ""
    assert "are not those" in doubts(Log(t=t, q=q, tau=tau + 2.0 * np.cos(3.0 * t)[:, None]), rig, Robot.load(rig))


def swinging(rig: Rig, gain: float = 1.0) -> Log:
    """An arm with friction and offsets in its torques that swings through many poses, 20 s."""
    rng, t = np.random.default_rng(0), np.arange(2000) * 0.01
    q = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]) + 0.4 * sum(
        np.sin(2 * np.pi * rng.uniform(0.05, 0.2, 7) * t[:, None] + rng.uniform(0, 6, 7)) for _ in range(2)
    )
    dq = np.gradient(q, t, axis=0)
    ddq = np.gradient(dq, t, axis=0)
    assert rig.tool is not None
    tau = gain * inverse_dynamics(Robot.load(rig).with_tool(rig.tool), q, dq, ddq)
    tau = tau + rng.uniform(0.2, 0.8, 7) * np.tanh(dq / 0.01) + rng.normal(scale=0.4, size=7)
    return Log(t=t, q=q, tau=tau + rng.normal(scale=0.05, size=q.shape))


@pytest.mark.parametrize(("link", "mass"), [(7, 0.3), (6, 1.6), (5, 1.7), (4, 2.7), (3, 2.7)])
@pytest.mark.parametrize("factor", [0.1, 3.0, 10.0])
def test_a_link_of_another_mass_is_told_by_torques_in_several_poses(
    tmp_path: Path, touched: tuple[Log, Rig, Robot], link: int, mass: float, factor: float
) -> None:
    _, rig, _ = touched
    text = (Path(kinid.urdf.__file__).parent / "lwr4plus.urdf").read_text(encoding="utf-8")
    before, own = text.split(f'<link name="link_{link}">')
    own = own.replace(f'<mass value="{mass}"/>', f'<mass value="{factor * mass}"/>', 1)
    (tmp_path / "arm.urdf").write_text(f'{before}<link name="link_{link}">{own}', encoding="utf-8")
    other = changed(rig.model_copy(update={"surface": None}), robot={"model": str(tmp_path / "arm.urdf")})
    said = doubts(swinging(rig), other, Robot.load(other))
    assert "the joint torques in these poses ask for " in said
    named = said.split("ask for ")[1].split(", which explains")[0].split(" or ")
    (own_words,) = [words for words in named if f"behind joint_{link}, not {factor * mass:.2g}" in words]
    # noise and the tool's own mass, beside a link's
    assert float(own_words.split(" kg")[0]) == pytest.approx(mass, rel=0.15, abs=0.1)


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.1])
def test_gains_of_torques_are_no_masses_of_links(touched: tuple[Log, Rig, Robot], gain: float) -> None:
    _, rig, robot = touched
    assert doubts(swinging(rig, gain), rig.model_copy(update={"surface": None}), robot) == ""
