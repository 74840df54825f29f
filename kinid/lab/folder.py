"""A folder for results: one experiment or campaign in it, one process at work in it, and files that are known by their
digest.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kinid.errors import InputError
from kinid.inputs import digest
from kinid.writers import lock, made_folder, make_folder, write_text

#: what an experiment, a campaign or a study leaves in its folder
LEFT = (
    "rig.toml",
    "log.parquet",
    "log.mcap",
    "streams",
    "truth",
    "campaign.json",
    "learnt.parquet",
    "teleoperation.json",
    "control.json",
    "study.json",
    "slides.json",
    "poke_*.parquet",
    "slide_*.parquet",
)


@contextmanager
def at_work(folder: Path) -> Iterator[None]:
    """Make a folder, and keep other processes that ask out of it until the block ends, however it ends.

    What is locked is the folder itself, so that no file is left.

    Raises:
        InputError: a folder that can't be made, or in which another process is at work.
    """
    with made_folder(folder):
        handle = os.open(folder, os.O_RDONLY)
        try:
            found = f"another process at work in {folder}"
            lock(handle, found, "a folder to itself", "wait until it is done, or choose another folder with -o")
            yield
        finally:
            os.close(handle)


def check_free(folder: Path) -> None:
    """Refuse a folder that holds an experiment: a second one's log would stand beside the first one's rig and truth.

    What an experiment that was stopped as it wrote has left is no experiment: it is made again.

    Raises:
        InputError: what is there.
    """
    if unfinished(folder):
        return
    there = [
        path.name for name in LEFT for path in sorted(folder.glob(name))[:1] if path.is_file() or any(path.iterdir())
    ]
    if there:
        raise InputError(
            f"{', '.join(there[:3])}{', …' if len(there) > 3 else ''} in {folder}, where results are already",
            "a folder without results",
            "choose another folder with -o, or remove them first",
        )


def unfinished(folder: Path, name: str = "log") -> bool:
    """Whether a folder holds no more than what an experiment that was stopped as it wrote has left.

    An experiment says what it is about to write before it writes, in `truth/NAME.begun`, and takes that away when its
    log, the last file, is there.
    """
    begun = folder / "truth" / f"{name}.begun"
    if not begun.is_file() or (folder / f"{name}.parquet").exists():
        return False
    return all(_own(path.relative_to(folder), name) for path in folder.rglob("*") if path.is_file())


def _own(path: Path, name: str) -> bool:
    """Whether an experiment of this name writes such a file, or writes it at first under another name."""
    stem, folders = path.name.lstrip("."), path.parts[:-1]
    if not folders:
        return stem.startswith(("rig.", f"{name}."))
    return folders in (("truth",), ("streams",)) and stem.startswith((f"{name}.", f"{name}_"))


@contextmanager
def making(folder: Path, name: str = "log") -> Iterator[None]:
    """Say that an experiment begins, and that it is whole when the block ends well; else take away what it has written.

    One that is killed can't: what it has left is taken away here, before another one begins.
    """
    _clear(folder, name)
    begun = folder / "truth" / f"{name}.begun"
    try:
        make_folder(begun.parent)
        write_text(begun, "")
        yield
    except BaseException:
        _clear(folder, name)
        raise
    begun.unlink(missing_ok=True)


def _clear(folder: Path, name: str) -> None:
    """Take away what an experiment that isn't whole has left."""
    if unfinished(folder, name):
        for path in [p for p in folder.rglob("*") if p.is_file()]:
            path.unlink()
    for empty in (folder / "truth", folder / "streams"):
        with suppress(OSError):
            empty.rmdir()


def digests(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of files, by their names within a folder."""
    return {path.relative_to(folder).as_posix(): digest(path) for path in files}


def is_whole(folder: Path, name: str) -> bool:
    """Whether an experiment's log, truth and streams are all there as they were written."""
    try:
        files = json.loads((folder / "truth" / f"{name}.json").read_text(encoding="utf-8"))["files"]
        return f"{name}.parquet" in files and all(digest(folder / file) == known for file, known in files.items())
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return False
