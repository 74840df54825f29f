"""Text, JSON and TOML that a user names, read within limits of size and depth, checked before anything is parsed."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from kinid.errors import InputError

#: a rig, a fit or a manifest is a page of text; what is larger is another file [bytes]
MOST_BYTES = 2_000_000
#: of lists and objects in each other; what kinid writes has six at most
MOST_LEVELS = 50
#: no quantity of any file is larger, or has more digits
LARGEST, DIGITS = 1e100, 100
#: a key of TOML with more parts than there may be levels: tomllib takes memory with the square of their number. The
#: search begins where a word does and never goes back, so that it takes time with the length of the text
_PART = r"""(?:(?<![\w-])[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{MOST_LEVELS}}}")
#: names in the environment what all limits of size are multiplied by
FACTOR = "KINID_LIMIT_FACTOR"


def size_limit(most: float) -> float:
    """A limit of size, `most` by default, as the environment raises it.

    Raises:
        InputError: it names no factor.
    """
    text = os.environ.get(FACTOR, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 0.0 < factor < math.inf:
        raise InputError(
            f"{FACTOR}={text[:40]}", "a positive number that limits of size are multiplied by", "set it to 10"
        )
    return most * factor


def raised(size: float, most: float) -> str:
    """How a message says that a limit can be raised: `size` is beyond `most`, the limit by default."""
    return f"or raise the limit by {FACTOR}={math.ceil(min(size / most, LARGEST)):.6g}"


def check_regular(path: Path, noun: str, what: str, mend: str) -> None:
    """Refuse what has no end, or nobody at its other end: a device, a pipe or a socket; opening it may wait forever.

    What isn't there is left to whoever opens it. Arguments as of `read_text`.

    Raises:
        InputError: what it is.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        mode = path.stat().st_mode
        kinds = {stat.S_ISDIR: "a folder", stat.S_ISFIFO: "a pipe", stat.S_ISSOCK: "a socket"}
        reason = next((kind for is_kind, kind in kinds.items() if is_kind(mode)), "a device")
        raise InputError(f"no readable {noun} at {str(path)[:200]} ({reason}, no regular file)", what, mend)


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_text(path: Path, noun: str, what: str, mend: str, most: int = MOST_BYTES) -> str:
    """A text file in UTF-8.

    Args:
        path: of the file. noun: what it is called, as "rig". what: it should be, as "a rig.toml". mend: what a user can
            do where it isn't. most: bytes.

    Raises:
        InputError: no file, none that has an end (a device or a pipe), one that is too large, or no text.
    """
    allowed = size_limit(most)
    try:
        check_regular(path, noun, f"{what} in UTF-8", mend)
        found = path.stat()
        if found.st_size > allowed:
            reason = f"{found.st_size / 1e6:.3g} MB, {allowed / 1e6:.3g} MB at most"
            mend = f"{mend}, {raised(found.st_size, most)}"
        else:
            return path.read_text(encoding="utf-8-sig")  # Windows' editors begin a text with a mark
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


def parse_toml(text: str, where: str, what: str) -> dict[str, Any]:
    """Tables of a TOML file.

    Args:
        text: to parse. where: it stands. what: it should be, as "the tables of a rig".

    Raises:
        InputError: no TOML, or nested too deeply.
    """
    try:
        if _DEEP_KEY.search(text) or _deeper(tables := tomllib.loads(text), MOST_LEVELS):
            raise RecursionError
        return tables
    except RecursionError:
        raise InputError(f"{where}, nested more than {MOST_LEVELS} levels deep", what, "correct it") from None
    except ValueError as error:  # TOML's own error, and a whole number with too many digits
        raise InputError(f"{where}: {str(error)[:200]}", "valid TOML", "correct that line") from None


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
