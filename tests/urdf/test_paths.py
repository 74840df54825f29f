"""Which file a rig's robot name or path means."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from kinid import urdf
from kinid.errors import InputError

# the arms, and the mobile and humanoid robots with arms, that example-robot-data has had for years
OTHERS = {
    "panda": "panda.urdf",
    "ur3": "ur3_robot.urdf",  # example-robot-data's own table says UR5 here
    "ur5": "ur5_robot.urdf",
    "ur10": "ur10_robot.urdf",
    "kinova": "kinova.urdf",
    "z1": "z1.urdf",
    "xarm7": "xarm7.urdf",
    "talos_arm": "talos_left_arm.urdf",
    "tiago": "tiago.urdf",
    "baxter": "baxter.urdf",
    "double_pendulum": "double_pendulum.urdf",
}


def test_every_shipped_robot_is_found_and_passes_its_own_check(tmp_path: Path) -> None:
    assert "lwr4plus" in urdf.shipped()
    for name in urdf.shipped():
        file = urdf.path(name, tmp_path)
        assert file.name == f"{name}.urdf"
        urdf.check(file)


@pytest.mark.parametrize("name", OTHERS)
def test_example_robot_data_is_found_and_passes_the_check(name: str, tmp_path: Path) -> None:
    file = urdf.path(name, tmp_path)
    assert file.is_absolute()
    assert file.name == OTHERS[name]
    urdf.check(file)


def test_a_shipped_robot_is_found_without_loading_a_heavy_library() -> None:
    code = (
        "import sys; from pathlib import Path; from kinid import urdf;"
        "urdf.check(urdf.path('lwr4plus', Path('.')));"
        "print([m for m in ('pinocchio', 'example_robot_data', 'yourdfpy') if m in sys.modules])"
    )
    root = Path(urdf.__file__).resolve().parent.parent
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize("spelling", ["mine.urdf", "robots/mine.urdf", "./mine.urdf", "robots/../mine.urdf", "mine"])
def test_paths_are_relative_to_the_rig(spelling: str, tmp_path: Path) -> None:
    file = tmp_path / spelling
    (tmp_path / "robots").mkdir()
    file.write_text("<robot name='mine'/>")
    assert urdf.path(spelling, tmp_path).samefile(file)
    assert urdf.path(str(file), Path("elsewhere")).samefile(file)


def test_a_name_wins_over_a_folder_or_file_of_that_name(tmp_path: Path) -> None:
    for name in ("lwr4plus", "panda"):
        (tmp_path / name).write_text("<robot name='impostor'/>")
        assert urdf.path(name, tmp_path).parent != tmp_path
        assert urdf.path(f"./{name}", tmp_path).parent == tmp_path


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("lwr4plu", "did you mean 'lwr4plus'?"),
        ("pandas", "did you mean 'panda'"),
        ("qqqqqq", "ships (lwr4plus)"),
        ("", "or one of lwr4plus, panda"),
        ("cassie", "unknown robot"),  # an SDF, not a URDF
        ("robots/none.urdf", "relative to the rig"),
        ("none.urdf", "no robot at"),
        ("left_arm.urdf", "did you mean 'left-arm.urdf'?"),
        (".", "unknown robot"),
        ("x" * 5000, "unknown robot"),
        ("nul\0.urdf", "no robot at"),
    ],
)
def test_what_is_not_there_is_refused_in_one_line(wrong: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "left-arm.urdf").write_text("<robot name='mine'/>")
    with pytest.raises(InputError) as caught:
        urdf.path(wrong, tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_that_is_named_as_a_robot_is_said_to_be_one(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").mkdir()
    with pytest.raises(InputError, match="a folder, no regular file") as refused:
        urdf.path("r.urdf", tmp_path)
    assert "did you mean" not in refused.value.mend
