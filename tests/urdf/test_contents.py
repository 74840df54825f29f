"""Numbers and sizes of a URDF are looked at before any other parser sees it."""

from __future__ import annotations

from pathlib import Path

import pytest

import kinid
import kinid.urdf
from kinid.planning.collision import Scene
from kinid.urdf import path as robot_path

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def urdf(
    links: int = 3,
    *,
    kind: str = "revolute",
    mass: str = "1",
    axis: str = "0 0 1",
    inertia: str = INERTIA,
    joint: str = "",
    limits: str = 'lower="-3" upper="3"',
) -> str:
    """A chain; `joint` is put into the second joint, and "0" in it names the first one."""
    body = f'<inertial><mass value="{mass}"/>{inertia}</inertial>'
    bodies = [f'<link name="l{i}">{body}</link>' for i in range(links)]
    joints = [
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="{axis}"/>'
        f'<limit {limits} effort="1" velocity="1"/>{joint if i == 1 else ""}</joint>'
        for i in range(links - 1)
    ]
    return f'<robot name="r">{"".join(bodies)}{"".join(joints)}</robot>'


def shaped(shape: str) -> str:
    """A chain whose first link has a collision shape."""
    return urdf().replace("</inertial>", f"</inertial><collision><geometry>{shape}</geometry></collision>", 1)


RING = urdf(joint='<mimic joint="j0"/>').replace('<child link="l1"/>', '<child link="l1"/><mimic joint="j1"/>')


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (urdf(1002, kind="fixed"), "more than 1000 links"),
        (urdf(60_000, kind="fixed"), "more than 1000 links"),
        (urdf(502), "more than 500 moving joints"),
        (urdf(mass="-1"), "a mass of -1 kg"),
        (urdf(mass="nan"), "'nan'; expected a finite number"),
        (urdf(mass="inf"), "'inf'; expected a finite number"),
        (urdf(mass="heavy"), "'heavy'; expected a finite number"),
        (urdf(mass="1e300"), "a mass of 1e300 kg"),
        (urdf(inertia=INERTIA.replace('izz="1"', 'izz="-1"')), "izz = -1"),
        (urdf(inertia=INERTIA.replace('ixy="0"', 'ixy="nan"')), "ixy in"),
        (urdf(axis="0 0 0"), "axis 0 0 0"),
        (urdf(axis="0 1"), "expected 3 numbers"),
        (urdf(axis="nan 0 1"), "'nan'"),
        (urdf().replace('<axis xyz="0 0 1"/>', "<axis/>", 1), "axis of joint 'j0'"),
        (urdf(mass="1e5"), "a mass of 1e5 kg"),
        (urdf(mass="1e-3"), "an inertia of 1 kg·m² of 0.001 kg"),
        (urdf(inertia=INERTIA.replace('izz="1"', 'izz="100"')), "moments of inertia of 1, 1 and 100 kg·m²"),
        (urdf(inertia='<inertia ixx="1"/>'), "<inertial> without iyy, izz, ixy, ixz, iyz"),
        (urdf().replace('<mass value="1"/>', "", 1), "<inertial> without mass"),
        (urdf(kind="hinge"), "joint 'j0' of type 'hinge'"),
        (urdf().replace('parent link="l0"', 'parent link="l2"'), "links in a ring (l1 → l2 → l1)"),
        (shaped('<sphere radius="nan"/>'), "radius of a sphere"),
        (shaped('<cylinder radius="-1" length="1"/>'), "radius of a cylinder"),
        (shaped('<box size="1 1"/>'), "size of a box"),
        (urdf(axis="0 0 1e300"), "axis 0 0 1e300"),
        (urdf(joint='<origin xyz="1e300 0 0"/>'), "10000 m at most"),
        (urdf(limits='lower="3" upper="-3"'), "limits from 3 to -3"),
        (urdf(joint='<mimic joint="j1"/>'), "j1 → j1"),
        (RING, "j0 → j1 → j0"),
        ("<robot>" + 5000 * "<a>" + 5000 * "</a>" + "</robot>", "100 levels deep"),
    ],
    ids=lambda value: value[:30] if "<" not in value else "",
)
def test_what_can_not_be_is_refused_in_one_line(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(text, encoding="utf-8")
    with pytest.raises(kinid.InputError) as refused:
        kinid.Robot.load(tmp_path / "r.urdf")
    assert says in str(refused.value)
    assert str(tmp_path / "r.urdf") in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        urdf(),
        urdf(501),
        urdf(axis="0 0 0", kind="fixed"),  # exporters write it
        urdf(mass="0"),
        urdf().replace('<axis xyz="0 0 1"/>', ""),  # 1 0 0, says the format
        urdf(mass="0.01", inertia=INERTIA.replace('"1"', '"1e-5"').replace('izz="1e-5"', 'izz="5e-5"')),  # of a camera
        urdf().replace('<parent link="l0"/><child link="l1"/>', '<child link="l1"/><parent link="l0"/>'),
        shaped('<sphere radius="0.1"/>'),
        urdf(inertia=INERTIA.replace('ixx="1"', 'ixx="-5e-20"')),  # rounding of a program
        urdf(joint='<mimic joint="of another file"/>'),
        urdf().replace("</robot>", '<transmission><joint name="j0"><mass value="any"/></joint></transmission></robot>'),
    ],
    ids=[
        "plain",
        "500 joints",
        "fixed axis",
        "no mass",
        "no axis",
        "a guess",
        "child first",
        "shape",
        "rounding",
        "mimic of nothing",
        "transmission",
    ],
)
def test_what_robots_have_is_read(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(text, encoding="utf-8")
    kinid.urdf.check(tmp_path / "r.urdf")


def test_no_parser_writes_to_the_screen(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r.urdf").write_text(shaped(""), encoding="utf-8")  # of which urdfdom says that there is no shape
    robot = kinid.Robot.load(tmp_path / "r.urdf")
    Scene.of(robot, tmp_path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["panda", "ur3", "ur5", "ur10", "xarm7", "kinova", "talos_arm", "icub", "lwr4plus"])
def test_robots_that_are_here_pass(name: str) -> None:
    kinid.urdf.check(robot_path(name, Path()))


@pytest.mark.parametrize(
    ("name", "file"), [("lwr", "lwr4plus"), ("LWR4+", "lwr4plus"), ("UR5", "ur5"), ("Franka", "panda")]
)
def test_a_robot_is_found_by_the_names_it_has(name: str, file: str) -> None:
    assert robot_path(name, Path()) == robot_path(file, Path())


@pytest.mark.parametrize("name", ["iiwa", "iiwa14", "kuka", "ur16e"])
def test_an_arm_that_nobody_ships_says_why(name: str) -> None:
    with pytest.raises(kinid.InputError, match=r"comes neither with kinid nor .*lwr4plus, panda.*path of its URDF"):
        robot_path(name, Path())


def test_a_name_like_none_gets_arms_to_choose_from() -> None:
    with pytest.raises(kinid.InputError, match=r"path of its URDF .* or one of lwr4plus, panda"):
        robot_path("qqq", Path())


def test_a_missing_tip_names_the_last_links() -> None:
    robot = kinid.Robot.load("ur5")
    assert robot.tip_frame is None
    assert "tool0" in robot.end_frames
