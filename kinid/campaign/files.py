"""Where a campaign's logs are: files, folders, or a `campaign.toml` that says more of each.

```toml
rig = "rig.toml"                        # optional; default: rig.toml beside each log
logs = ["tuesday/*.parquet", "c.csv"]   # optional: names or patterns, relative to this file

[sharing]                               # optional: shared, per-log, population, or per COLUMN
"kelvin-voigt.stiffness" = "per robot"
surface-offset = "shared"

[[log]]                                 # optional: of single logs, their rig and any columns
file = "d.parquet"
rig = "other/rig.toml"
robot = "left"
day = "2026-03-02"
```
"""

from __future__ import annotations

import filecmp
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from kinid.errors import InputError, near
from kinid.inputs import parse_toml, read_text

#: files of logs in a folder, and folders in it that hold none
SUFFIXES = (".parquet", ".csv", ".csv.gz", ".npz", ".mat", ".mcap", ".bag")
NO_LOGS = ("truth", "streams")
#: bytes at a file's end that tell most files apart
END = 65536
#: what marks a folder as one ROS 2 bag, and as a campaign
BAG, CAMPAIGN = "metadata.yaml", "campaign.toml"


@dataclass(frozen=True)
class Source:
    """One log of a campaign: its file, the file of its rig (None: beside it), and columns that it is grouped by."""

    path: Path
    rig: Path | None = None
    columns: dict[str, str] = field(default_factory=dict)


class NoLogs(InputError):
    """A folder without logs: they may still come."""


def is_campaign(paths: Sequence[Path]) -> bool:
    """Whether paths name many logs, or one place that holds them, and not just one log."""
    if len(paths) != 1:
        return len(paths) > 1
    return paths[0].suffix.lower() == ".toml" or (paths[0].is_dir() and not (paths[0] / BAG).is_file())


def sources(paths: Sequence[Path], rig: Path | None = None) -> tuple[list[Source], dict[str, str]]:
    """The logs that files, folders and `campaign.toml` files name, in order, and how parameters are shared.

    Args:
        paths: of logs, of folders (with their sub-folders), of campaign files. rig: of all that have no other.

    Raises:
        InputError: nothing there, a folder without logs, or a campaign file that is none.
    """
    out: dict[Path, Source] = {}
    sharing: dict[str, str] = {}
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if list(paths).count(path) > 1)
        raise InputError(f"{twice} named twice", "each log once", "name it once")
    for given in paths:
        path = given / CAMPAIGN if given.is_dir() and (given / CAMPAIGN).is_file() else given
        if path.suffix.lower() == ".toml":
            found, ways = _from_file(path, rig)
            sharing |= ways
        elif path.is_dir() and not (path / BAG).is_file():
            found = [Source(file, rig) for file in _in_folder(path)]
        elif path.exists():
            found = [Source(path, rig)]
        else:
            raise InputError(f"no log at {path}", "logs, a folder of logs, or a campaign.toml", "correct the name")
        out |= {source.path: source for source in found}
    return list(out.values()), sharing


def refuse_copies(paths: Sequence[Path]) -> None:
    """Refuse a log that is there twice, as a copy or by a link: it would count as two that agree.

    Only files of one size and with one end, where the formats keep checksums or the last rows, are read as a whole.

    Raises:
        InputError: the names of both.
    """
    alike: dict[tuple[int, bytes], list[Path]] = {}
    for path in paths:
        if not path.is_file() or not os.access(path, os.R_OK):  # a bag of several files; or reading it says why
            continue
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - END))
            others = alike.setdefault((size, hashlib.sha256(file.read()).digest()), [])
        for other in others:
            if path.samefile(other) or filecmp.cmp(path, other, shallow=False):
                raise InputError(
                    f"the same log twice, {other} and {path}",
                    "each log once: counted twice, it makes intervals too narrow",
                    "leave one of them out",
                )
        others.append(path)


def names_of(paths: Sequence[Path]) -> list[str]:
    """What logs are called: by their file where those differ, else by as much of the path as tells them apart."""
    for parts in range(1, max((len(path.parts) for path in paths), default=1) + 1):
        names = ["/".join(path.parts[-parts:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def _in_folder(folder: Path) -> list[Path]:
    found = sorted(
        path
        for path in folder.rglob("*")
        if path.name.lower().endswith(SUFFIXES)
        and path.is_file()
        and not any(part.startswith(".") or part in NO_LOGS for part in path.relative_to(folder).parts)
    )
    if not found:
        raise NoLogs(f"no logs in {folder}", f"files ending in {', '.join(SUFFIXES)}", "name another folder")
    return found


def _from_file(path: Path, rig: Path | None) -> tuple[list[Source], dict[str, str]]:
    text = read_text(path, "campaign", "a campaign.toml", "correct its name")
    tables = parse_toml(text, str(path), "the logs of a campaign")
    known = ("rig", "logs", "sharing", "log")
    for key in tables:
        if key not in known:
            raise InputError(f"'{key}' in {path}", f"one of {', '.join(known)}", near(key, known))
    common = path.parent / _text(tables["rig"], "rig", path) if "rig" in tables else rig
    sharing = tables.get("sharing", {})
    if not isinstance(sharing, dict) or not all(isinstance(way, str) for way in sharing.values()):
        raise InputError(f"[sharing] in {path}", 'lines as "hooke.stiffness" = "per robot"', "write names in quotes")
    out: dict[Path, Source] = {}
    for pattern in _listed(tables.get("logs", []), "logs", path):
        try:
            files = sorted(path.parent.glob(_text(pattern, "logs", path)))
        except (ValueError, NotImplementedError, OSError, RecursionError) as error:  # "", "a**", "/…", "*/*/*/…"
            found = f"logs = {str(pattern)[:60]!r} in {path} ({error})"
            raise InputError(found, "a name, or a pattern as *.parquet, relative to that file", "correct it") from None
        if not files:
            raise InputError(f"no log like '{pattern}' in {path}", "a file there", "correct the name")
        out |= {file: Source(file, common) for file in files}
    named = set[Path]()  # a table of its own may tell more of a log that a pattern found, once
    for table in _listed(tables.get("log", []), "[[log]]", path):
        source = _of_table(table, common, path)
        if source.path in named:
            raise InputError(f"two [[log]] of {source.path} in {path}", "one of each file", "leave one out")
        named.add(source.path)
        out[source.path] = source
    if not out:
        raise InputError(f"no logs in {path}", 'logs = ["*.parquet"], or [[log]] tables', "name them")
    return list(out.values()), dict(sharing)


def _of_table(table: object, rig: Path | None, path: Path) -> Source:
    """A log of its own table."""
    if not isinstance(table, dict) or "file" not in table:
        raise InputError(f"a [[log]] without a file in {path}", 'file = "a.parquet"', "add that line")
    file = path.parent / _text(table["file"], "file", path)
    if not file.exists():
        raise InputError(f"no log at {file}, which {path} names", "a log", "correct the name")
    own = path.parent / _text(table["rig"], "rig", path) if "rig" in table else rig
    return Source(file, own, {key: str(value) for key, value in table.items() if key not in ("file", "rig")})


def _text(value: object, key: str, path: Path) -> str:
    if not isinstance(value, str):
        raise InputError(f"{key} = {value!r} in {path}", "a name in quotes", "correct that line")
    return value


def _listed(value: object, key: str, path: Path) -> list[object]:
    if not isinstance(value, list):
        raise InputError(f"{key} = {value!r} in {path}", "a list", "correct that line")
    return value
