"""`kinid doctor`: is everything here that kinid needs, and what is here that it can use."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = """Examples:

kinid doctor

kinid doctor --json doctor.json

KINID_REAL_DATA=path/to/logs kinid doctor
"""

#: distributions that every command may load, and the modules of each optional extra
NEEDED = (
    "numpy",
    "scipy",
    "numba",
    "pin",
    "example-robot-data",
    "yourdfpy",
    "pyarrow",
    "pydantic",
    "typer",
    "rich",
    "plotly",
    "meshcat",
    "threadpoolctl",
    "ruckig",
    "jinja2",
    "casadi",
)
EXTRAS = {
    "bags": ("rosbags", "mcap"),
    "batch": ("dask", "distributed", "fsspec"),
    "live": ("zenoh", "foxglove", "mcap", "rosbags"),
    "vision": ("sklearn", "PIL"),
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "firefox", "microsoft-edge")


class State(StrEnum):
    """Of a thing that was looked at: fine; optional and absent; or such that kinid can't work."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


GOOD, NOTE, BAD = State
#: sign and colour on a terminal
MARK = {GOOD: ("●", "green"), NOTE: ("○", "yellow"), BAD: ("✗", "red")}


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: of it. state: see `State`. says: what was found. mend: the next thing to do, if any.
    """

    name: str
    state: State
    says: str
    mend: str = ""


def doctor(
    json_file: Annotated[Path | None, typer.Option("--json", help="What was found, to write as JSON.")] = None,
) -> None:
    """Versions, robots, caches, cores, browser, measured data and optional extras; exits 1 where something needed is
    missing.
    """
    from kinid.cli.show import written
    from kinid.writers import check_outputs, write_json

    check_outputs((json_file,), ())
    found = examine()
    healthy = all(f.state != BAD for f in found)
    if json_file is not None:
        write_json(json_file, {"healthy": healthy, "findings": [asdict(f) for f in found]})
    _show(found, healthy)
    written((json_file,))
    if not healthy:
        raise typer.Exit(1)


def examine() -> list[Finding]:
    """Everything, in the order in which it is shown."""
    checks: tuple[tuple[str, Callable[[], Finding]], ...] = (
        ("python", _python),
        ("kinid", _kinid),
        ("libraries", _libraries),
        ("robot", _robot),
        ("compiled code", _compiled),
        ("cores", _cores),
        ("renderer", _renderer),
        ("browser", _browser),
        ("measured data", _measured),
    )
    out = []
    for name, check in checks:
        try:
            out.append(check())
        except Exception as error:  # whatever is wrong with an installation, the others are still looked at
            says = " ".join(str(error).split())[:200]
            out.append(Finding(name, BAD, f"{type(error).__name__}: {says}", "pip install --force-reinstall kinid"))
    return out + [_extra(name, modules) for name, modules in EXTRAS.items()]


def _python() -> Finding:
    says = f"{platform.python_implementation()} {platform.python_version()}, {platform.system()} {platform.machine()}"
    return Finding("python", GOOD, says)


def _kinid() -> Finding:
    import kinid
    from kinid.effects import catalogue

    place = Path(kinid.__file__).parent
    return Finding("kinid", GOOD, f"{kinid.__version__} in {place}, {len(catalogue())} effects")


def _libraries() -> Finding:
    versions, missing = [], []
    for name in NEEDED:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return Finding("libraries", BAD, f"{', '.join(missing)} not installed", f"pip install {' '.join(missing)}")
    return Finding("libraries", GOOD, ", ".join(versions))


def _robot() -> Finding:
    """The robot that kinid ships, loaded by the rigid-body library."""
    import pinocchio

    import kinid

    robot = kinid.Robot.load(kinid.Rig.parse({"robot": {"model": "lwr4plus"}}))
    return Finding("robot", GOOD, f"lwr4plus loads, {len(robot.joint_names)} joints, pinocchio {pinocchio.__version__}")


def _compiled() -> Finding:
    """Loops are compiled once and kept: where numba may write, only the first run waits."""
    from kinid.kernels import chain

    kernel = next(value for value in vars(chain).values() if getattr(getattr(value, "stats", None), "cache_path", None))
    folder = Path(kernel.stats.cache_path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Finding(
            "compiled code",
            NOTE,
            f"can't be kept in {folder} ({error.strerror}): every run compiles anew",
            "set NUMBA_CACHE_DIR to a folder that can be written",
        )
    return Finding("compiled code", GOOD, f"kept in {folder}")


def _cores() -> Finding:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Finding("cores", GOOD, f"{usable} usable")


def _renderer() -> Finding:
    from kinid.viewer.page import renderer

    if renderer() is not None:
        return Finding("renderer", GOOD, "meshcat's, for scenes that need no network")
    return Finding("renderer", BAD, "meshcat comes without its viewer", "pip install --force-reinstall meshcat")


def _browser() -> Finding:
    for name in BROWSERS:
        if (path := shutil.which(name)) is not None:
            return Finding("browser", GOOD, path)
    import webbrowser

    try:
        return Finding("browser", GOOD, f"the system's ({type(webbrowser.get()).__name__})")
    except webbrowser.Error:
        return Finding(
            "browser",
            NOTE,
            "none found here: reports and scenes are files that any browser opens elsewhere",
            "install chromium or firefox, or copy the HTML files",
        )


def _measured() -> Finding:
    named = os.environ.get("KINID_REAL_DATA")
    folder = Path(named or "../shared/real")
    sets = sorted(p.name for p in folder.iterdir() if p.is_dir()) if folder.is_dir() else []
    if sets:
        return Finding("measured data", GOOD, f"{', '.join(sets)} in {folder.resolve()}")
    return Finding(
        "measured data",
        NOTE,
        f"none at {folder}: nothing but tests marked `real` needs it",
        "set KINID_REAL_DATA to the folder of measured logs, if you have it",
    )


def _extra(name: str, modules: tuple[str, ...]) -> Finding:
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if missing:
        return Finding(f"extra: {name}", NOTE, f"{', '.join(missing)} not installed", f"pip install 'kinid[{name}]'")
    return Finding(f"extra: {name}", GOOD, ", ".join(modules))


def _show(found: list[Finding], healthy: bool) -> None:
    from rich.table import Column, Table
    from rich.text import Text

    from kinid.cli.show import console

    columns = (Column(no_wrap=True), Column(no_wrap=True), Column(overflow="fold"))
    table = Table(*columns, box=None, show_header=False, pad_edge=False)
    for f in found:
        mark, colour = MARK[f.state]
        mend = f"; to mend it, {f.mend}" if f.mend else ""
        table.add_row(Text(mark, colour), f.name, f.says + mend)
    out = console()
    out.print(table)
    out.print("all that is needed is here" if healthy else Text("something that is needed is missing", "red"))
