"""Robots as data: URDFs that kinid ships, those of example-robot-data, and a user's own; and their check."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from kinid.errors import InputError, near
from kinid.urdf.safety import check

__all__ = ["check", "path", "shipped"]

_HERE = Path(__file__).parent


def shipped() -> tuple[str, ...]:
    """Names of the robots that come with kinid: one `.urdf` file here, one name."""
    return tuple(sorted(file.stem for file in _HERE.glob("*.urdf")))


def path(name_or_path: str, folder: Path) -> Path:
    """The URDF file that a rig's `[robot] model` means; found, but neither read nor checked.

    Args:
        name_or_path: a name that kinid ships ("lwr4plus"), one of example-robot-data ("panda", …), or a path.
        folder: what a relative path is relative to: the folder of rig.toml.

    Raises:
        InputError: no such name, or no such file.
    """
    if name_or_path in shipped():
        return _HERE / f"{name_or_path}.urdf"
    file = folder / name_or_path
    is_a_path = any(c in name_or_path for c in "/\\") or file.suffix.lower() in (".urdf", ".xacro", ".xml")
    if not is_a_path and name_or_path in _others():
        return _others()[name_or_path]
    if os.path.isfile(file):  # Path.is_file would raise where the system refuses to look
        return file
    if is_a_path:
        siblings = [f.name for f in file.parent.glob("*.urdf")]
        mend = near(file.name, siblings) if siblings else "correct [robot] model, relative to the rig's file"
        raise InputError(f"no robot at {file}", "a URDF file", mend)
    raise InputError(
        f"an unknown robot, '{name_or_path}'",
        f"a robot that kinid ships ({', '.join(shipped())}), one of example-robot-data, or a URDF's path",
        near(name_or_path, (*shipped(), *_others())),
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
