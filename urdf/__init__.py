"""Robots as data: URDFs that kinid ships, those of example-robot-data, and a user's own; and their check."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from kinid.errors import InputError, near
from kinid.inputs import check_regular
from kinid.urdf.safety import check

__all__ = ["check", "path", "shipped"]

#: other names of arms that are here
ALIASES = {"lwr": "lwr4plus", "lwr4": "lwr4plus", "lwr4+": "lwr4plus", "lbr4+": "lwr4plus", "franka": "panda"}
#: families of arms that are asked for, and that nobody ships a URDF of that kinid could use
ELSEWHERE = (
    "iiwa",
    "lbr",
    "med7",
    "med14",
    "kuka",
    "gen3",
    "fanuc",
    "abb",
    "yaskawa",
    "staubli",
    "ur3e",
    "ur5e",
    "ur10e",
    "ur16e",
)
#: of those that are here, serial arms that a sensor is likely to be on
ARMS = ("lwr4plus", "panda", "ur3", "ur5", "ur10", "xarm7", "kinova", "z1", "so100", "so101")

_HERE = Path(__file__).parent


def shipped() -> tuple[str, ...]:
    """Names of the robots that come with kinid: one `.urdf` file here, one name."""
    return tuple(sorted(file.stem for file in _HERE.glob("*.urdf")))


def path(name_or_path: str, folder: Path) -> Path:
    """The URDF file that a rig's `[robot] model` means; found, but neither read nor checked.

    Args:
        name_or_path: a name that kinid ships ("lwr4plus", or "lwr"), one of example-robot-data ("panda", …), in small
            or in capital letters, or a path.
        folder: what a relative path is relative to: the folder of rig.toml.

    Raises:
        InputError: no such name, or no such file.
    """
    known = ALIASES.get(name_or_path.lower(), name_or_path.lower())
    if known in shipped():
        return _HERE / f"{known}.urdf"
    file = folder / name_or_path
    is_a_path = any(c in name_or_path for c in "/\\") or file.suffix.lower() in (".urdf", ".xacro", ".xml")
    if not is_a_path and known in _others():
        return _others()[known]
    if os.path.isfile(file):  # Path.is_file would raise where the system refuses to look
        return file
    if is_a_path:
        check_regular(file, "robot", "a URDF file", "name a file in [robot] model")
        siblings = [f.name for f in file.parent.glob("*.urdf")]
        mend = near(file.name, siblings) if siblings else "correct [robot] model, relative to the rig's file"
        raise InputError(f"no robot at {file}", "a URDF file", mend)
    raise _unknown(name_or_path)


def _unknown(name: str) -> InputError:
    """Why there is no such robot, and what there is."""
    there = (*shipped(), *_others())
    arms = ", ".join(arm for arm in ARMS if arm in there)
    if any(name.lower().startswith(family) for family in ELSEWHERE):
        return InputError(
            f"the robot '{name}', whose URDF comes neither with kinid nor with example-robot-data",
            f"a robot that is here ({arms}), or a URDF's path",
            "name the path of its URDF in [robot] model; its maker publishes one (a .xacro is to be expanded)",
        )
    found = near(name, there)
    return InputError(
        f"an unknown robot, '{name}'",
        f"a robot that kinid ships ({', '.join(shipped())}), one of example-robot-data, or a URDF's path",
        found if found.startswith("did") else f"name the path of its URDF in [robot] model, or one of {arms}",
    )


@cache
def _others() -> dict[str, Path]:
    """Robots of the installed example-robot-data, name → URDF. Its loaders are read, not run."""
    try:
        from example_robot_data import robots_loader
    except ImportError:
        return {}
    # "ur3" is bound to the UR5's loader there; the class beside it is the right one
    loaders = {**robots_loader.ROBOTS, "ur3": robots_loader.UR3Loader}
    found = {}
    for name, loader in loaders.items():
        if loader.urdf_filename:  # cassie is SDF only
            relative = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
            try:
                found[name] = Path(robots_loader.getModelPath(str(relative)), relative).resolve()
            except OSError:  # the loaders know a robot that this version of the data lacks
                continue
    return found
