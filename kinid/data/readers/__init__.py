"""Logs from files: one module a format, found by scanning this folder.

A module of this package whose name has no leading underscore is a format. It declares `SUFFIXES`, where a
folder is the log `MARKER`, the file that tells such a folder, and `read(path, rig, joints) -> Log`; where a log is made
of messages, `opened(path, rig)`, a context with them (`_bag.Bag`) and the rig that they are read with. With
`write_example(path, columns)` the tests of all formats write a log of it, and read it back.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType

from kinid.data.log import Log
from kinid.data.readers._bag import Bag
from kinid.data.rig import Rig
from kinid.errors import InputError, check_name
from kinid.inputs import check_regular

__all__ = ["formats", "messages", "read"]


def read(path: str | Path, rig: Rig | None = None, joint_names: Sequence[str] | None = None) -> Log:
    """Read a log of any known format onto one clock, in SI units.

    Args:
        path: Parquet, CSV and other text tables, NPZ, MATLAB, MCAP, a ROS 1 bag, or a ROS 2 bag (folder or
            file).
        rig: names columns, units and topics; default: `rig.toml` beside the log, else an empty rig.
        joint_names: order of q1..qN in a bag, whose messages name joints, when the rig doesn't give it.

    Raises:
        InputError: the file is absent, empty, damaged, of an unknown format, or doesn't hold what the rig
            says.
        MissingDependencyError: the library for the format is not installed.
    """
    path = Path(path)
    module = _module(path)
    if rig is None:
        beside = path.absolute().parent / "rig.toml"
        rig = Rig.load(beside) if beside.is_file() else Rig()
    joints = rig.robot.joints if rig.robot and rig.robot.joints else joint_names
    log: Log = module.read(path, rig, tuple(joints) if joints is not None else None)
    return log


def messages(path: Path, rig: Rig) -> AbstractContextManager[tuple[Bag, Rig]] | None:
    """A log that is made of messages, open, and the rig that they are read with; None where it is a table.

    Raises:
        InputError, MissingDependencyError: as `read`.
    """
    module = _module(path)
    context: AbstractContextManager[tuple[Bag, Rig]] | None
    context = module.opened(path, rig) if hasattr(module, "opened") else None
    return context


def formats() -> dict[str, ModuleType]:
    """The modules of the folder by suffix."""
    return {suffix: module for module in _modules() for suffix in module.SUFFIXES}


def _modules() -> Iterator[ModuleType]:
    for found in pkgutil.iter_modules(__path__):
        if not found.name.startswith("_"):
            yield importlib.import_module(f"{__name__}.{found.name}")


def _module(path: Path) -> ModuleType:
    """The module that reads this file or folder."""
    if path.is_dir():
        for module in _modules():
            if hasattr(module, "MARKER") and (path / module.MARKER).is_file():
                return module
        markers = [m.MARKER for m in _modules() if hasattr(m, "MARKER")]
        raise InputError(
            f"a folder {path} without {' or '.join(markers)}",
            "a log file, or the folder of a ROS 2 bag",
            "name the file in it",
        )
    if not path.exists():
        raise InputError(f"no file {path}", "a log", "check the path")
    check_name(path)
    check_regular(path, "log", "a log in a file", "copy it into one")
    known = formats()
    ending = next((known_as for known_as in known if path.name.lower().endswith(known_as)), None)
    if ending is None:
        suffix = f"suffix '{path.suffix}'" if path.suffix else "no suffix"
        raise InputError(f"{suffix} of {path}", f"one of {' '.join(sorted(known))}", "convert the log to one of these")
    if path.stat().st_size == 0:
        raise InputError(f"an empty file {path}", "a log with samples", "record or copy it again")
    return known[ending]
