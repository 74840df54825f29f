"""Text and JSON that a user names, read within limits of size and depth that are checked before anything is parsed."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

from kinid.errors import InputError

#: a rig, a fit or a manifest is a page of text; what is larger is another file [bytes]
MOST_BYTES = 2_000_000


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


def read_json(path: Path, noun: str, what: str, mend: str, most: int = MOST_BYTES) -> Any:
    """What a JSON file holds; arguments and errors as of `read_text`, and InputError for what is no JSON."""
    text = read_text(path, noun, what, mend, most)
    try:
        return json.loads(text)
    except RecursionError:
        reason = "nested too deeply to be read"
    except ValueError as error:
        reason = f"no JSON: {str(error)[:80]}"
    raise InputError(f"no {noun} in {path} ({reason})", what, mend)
