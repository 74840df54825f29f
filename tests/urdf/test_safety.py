"""URDF files that must not reach another parser."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path, PurePosixPath

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinid import urdf
from kinid.errors import InputError

SHIPPED = urdf.path("lwr4plus", Path.cwd()).read_bytes()

_ENTITIES = "".join(f'<!ENTITY a{i} "{10 * f"&a{i - 1};"}">' for i in range(1, 10))
BILLION_LAUGHS = f'<!DOCTYPE robot [<!ENTITY a0 "ha">{_ENTITIES}]><robot name="&a9;"/>'

BAD = {
    "billion laughs": (BILLION_LAUGHS, "DOCTYPE"),
    "external entity": ('<!DOCTYPE r [<!ENTITY x SYSTEM "/etc/passwd">]><robot name="&x;"/>', "DOCTYPE"),
    "parameter entity": ('<!DOCTYPE r [<!ENTITY % x SYSTEM "http://x/y"> %x;]><robot name="r"/>', "DOCTYPE"),
    "a bare doctype": ('<!DOCTYPE robot><robot name="r"/>', "DOCTYPE"),
    "an undeclared entity": ('<robot name="&x;"/>', "undefined entity"),
    "truncated": ('<robot name="r"><link name="base">', "truncated"),
    "truncated in a tag": ('<robot name="r"><link na', "truncated"),
    "two roots": ('<robot name="r"/><robot name="s"/>', "XML"),
    "empty": ("", "XML"),
    "no XML": ("joints: 7\n", "XML"),
    "an SDF": ('<sdf version="1.7"><model name="r"/></sdf>', "<sdf> as the root"),
    "an MJCF": ("<mujoco/>", "<mujoco> as the root"),
    "a robot within": ('<a><robot name="r"/></a>', "<a> as the root"),
    "an unknown encoding": ('<?xml version="1.0" encoding="klingon"?><robot name="r"/>', "encoding"),
    "a xacro macro": ('<robot name="r"><xacro:arm prefix="l"/></robot>', "xacro"),
    "a xacro value": ('<robot name="r"><joint name="${prefix}_1"/></robot>', "xacro"),
}

OUTSIDE = (
    "/etc/passwd",
    "file:///etc/passwd",
    "file:/etc/passwd",
    "../../secret.stl",
    "meshes/../../../secret.stl",
    r"..\..\secret.stl",
    "%2e%2e/%2e%2e/secret.stl",
    " /etc/passwd",
    "package://arm/../../secret.stl",
    "package://../secret.stl",
    "package://arm/%2e%2e/secret.stl",
    "package:///etc/passwd",
    "model://../secret.stl",
    "http://example.org/arm.stl",
    "ftp://example.org/arm.stl",
    "FILE:///etc/passwd",
    "escape/secret.stl",  # a symbolic link that leads out
)
INSIDE = (
    "arm.stl",
    "./arm.stl",
    "meshes/arm.stl",
    "../meshes/arm.stl",
    "../arm.stl",
    "meshes/../arm.stl",
    "package://arm/arm.stl",
    "package://arm/meshes/a..b.stl",
    "model://arm/arm.stl",
    "file://arm.stl",
)


def refused(text: str | bytes, file: Path) -> str:
    """The message with which a URDF of that content is refused."""
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        urdf.check(file)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def with_file(name: str, tag: str = "mesh") -> str:
    mesh = f'<{tag} filename="{name}"/>'
    return f'<robot name="r"><link name="base"><visual><geometry>{mesh}</geometry></visual></link></robot>'


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot's folder as ROS has it, arm/urdf/arm.urdf, with a link that leads out of it."""
    folder = tmp_path_factory.mktemp("ws") / "arm" / "urdf"
    (folder / "meshes").mkdir(parents=True)
    (folder / "escape").symlink_to(folder.parent.parent, target_is_directory=True)
    return folder / "arm.urdf"


@pytest.mark.parametrize("case", BAD)
def test_a_broken_or_unsafe_urdf_is_refused(case: str, tmp_path: Path) -> None:
    text, said = BAD[case]
    assert said in refused(text, tmp_path / "bad.urdf")


@pytest.mark.parametrize("tag", ["mesh", "texture"])
@pytest.mark.parametrize("name", OUTSIDE)
def test_no_file_outside_the_robots_folder(name: str, tag: str, robot: Path) -> None:
    message = refused(with_file(name, tag), robot)
    assert name.strip() in message
    assert "copy the mesh" in message


@pytest.mark.parametrize("name", INSIDE)
def test_files_of_the_robot_pass(name: str, robot: Path) -> None:
    robot.write_text(with_file(name))
    urdf.check(robot)


def test_an_absolute_path_into_the_robots_folder_passes(robot: Path) -> None:
    for prefix in ("", "file://"):
        robot.write_text(with_file(f"{prefix}{robot.parent.parent / 'meshes' / 'arm.stl'}"))
        urdf.check(robot)


def test_only_a_folder_named_urdf_or_robots_opens_its_parent(tmp_path: Path) -> None:
    for name, passes in (("urdf", True), ("robots", True), ("other", False)):
        file = tmp_path / name / "arm.urdf"
        file.parent.mkdir()
        file.write_text(with_file("../meshes/arm.stl"))
        if passes:
            urdf.check(file)
        else:
            refused(with_file("../meshes/arm.stl"), file)


parts = st.lists(st.sampled_from(["..", ".", "a", "b", "..c", "meshes"]), min_size=1, max_size=8)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(parts)
@example([".."])
@example(["..", ".."])
def test_a_relative_name_is_judged_by_where_it_ends(robot: Path, parts: list[str]) -> None:
    name = "/".join(parts)
    robot.write_text(with_file(name))
    end = PurePosixPath(os.path.normpath(f"/ws/arm/urdf/{name}"))
    if end.is_relative_to("/ws/arm"):
        urdf.check(robot)
    else:
        with pytest.raises(InputError):
            urdf.check(robot)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, len(SHIPPED.rstrip()) - 1))
def test_any_truncation_of_the_shipped_robot_is_refused(robot: Path, length: int) -> None:
    refused(SHIPPED[:length], robot)


patches = st.tuples(st.integers(0, len(SHIPPED) - 1), st.binary(min_size=1, max_size=3))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.one_of(st.binary(max_size=200), patches))
def test_no_bytes_bring_anything_but_an_input_error(robot: Path, garbage: bytes | tuple[int, bytes]) -> None:
    if isinstance(garbage, tuple):
        at, patch = garbage
        garbage = SHIPPED[:at] + patch + SHIPPED[at + len(patch) :]
    robot.write_bytes(garbage)
    with suppress(InputError):
        urdf.check(robot)


def test_utf16_and_a_byte_order_mark_are_xml_too(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    for encoding in ("utf-8-sig", "utf-16"):
        file.write_text('<robot name="größe"/>', encoding=encoding)
        urdf.check(file)
        assert "DOCTYPE" in refused(BILLION_LAUGHS.encode(encoding), file)


def test_what_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    loop = tmp_path / "loop.urdf"
    loop.symlink_to(loop)
    for file in (tmp_path, tmp_path / "none.urdf", loop, Path("/dev/null")):
        with pytest.raises(InputError, match="no file at"):
            urdf.check(file)


def test_a_xacro_file_is_to_be_expanded_first(tmp_path: Path) -> None:
    assert "expand it first" in refused('<robot name="r"/>', tmp_path / "arm.urdf.xacro")
