"""Text and JSON that a user names, read within limits of size and depth that are checked before anything is parsed."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

from kinid.errors import InputError

#: a rig, a fit or a manifest is a page of text; what is larger is another file [bytes]
MOST_BYTES = 2_000_000
#: of lists and objects in each other; what kinid writes has six at most
MOST_LEVELS = 50
#: no quantity of any file is larger, or has more digits
LARGEST, DIGITS = 1e100, 100


def read_text(path: Path, noun: str, what: str, mend: str, most: int = MOST_BYTES) -> str:
    """A text file in UTF-8.

    Args:
        path: of the file. noun: what it is called, as "rig". what: it should be, as "a rig.toml". mend: what a user can
            do where it isn't. most: bytes.

    Raises:
        InputError: no file, none that has an end (a device or a pipe), one that is too large, or no text.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            reason = "no regular file"
        elif found.st_size > most:
            reason = f"{found.st_size / 1e6:.3g} MB, {most / 1e6:.3g} MB at most"
        else:
            return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        reason = "not UTF-8"
    except (OSError, ValueError) as error:  # a name that holds a zero byte is a ValueError
        reason = getattr(error, "strerror", None) or str(error)
    raise InputError(f"no readable {noun} at {str(path)[:200]} ({reason})", f"{what} in UTF-8", mend)


def read_json(path: Path, noun: str, what: str, mend: str, most: int = MOST_BYTES, *, open_ends: bool = False) -> Any:
    """What a JSON file holds; arguments and errors as of `read_text` and `parse_json`."""
    return parse_json(read_text(path, noun, what, mend, most), f"{noun} in {path}", what, mend, open_ends=open_ends)


def parse_json(text: str | bytes, noun: str, what: str, mend: str, *, open_ends: bool = False) -> Any:
    """JSON whose numbers are finite, and that isn't nested without an end.

    Args:
        text: to parse. noun: what it is called, with its place. what: it should be. mend: what a user can do.
        open_ends: whether Infinity and NaN, as limits that aren't there, are let through.

    Raises:
        InputError: no such JSON.
    """
    try:
        constant = float if open_ends else _no_number
        value = json.loads(text, parse_constant=constant, parse_float=_number, parse_int=_whole)
        if _deeper(value, MOST_LEVELS):
            raise RecursionError
        return value
    except RecursionError:
        reason = f"nested more than {MOST_LEVELS} levels deep"
    except ValueError as error:
        reason = f"no JSON: {str(error)[:80]}"
    raise InputError(f"no {noun} ({reason})", what, mend)


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) <= LARGEST:
        raise ValueError(f"{text[:20]} is beyond {LARGEST:g}")
    return value


def _whole(text: str) -> int:
    if len(text) > DIGITS:
        raise ValueError(f"a number of {len(text)} digits, {DIGITS} at most")
    return int(text)


def _deeper(value: Any, levels: int) -> bool:
    """Whether lists and objects are nested in more levels."""
    front = [value]
    for _ in range(levels + 1):
        front = [
            inner
            for outer in front
            if isinstance(outer, list | dict)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, list | dict)
        ]
        if not front:
            return False
    return True
