"""The border to the libraries that parse files: whatever they say of damaged bytes becomes one clear line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kinid.errors import InputError, KinidError


@contextmanager
def readable(path: Path, kind: str, mend: str = "copy it again, it may be cut off") -> Iterator[None]:
    """Turn any failure of a format's library on this file into an InputError.

    Only calls of the library belong inside: parsers raise nearly every exception there is on damaged bytes,
    from struct.error to RecursionError, so all are caught, and a mistake of this library must not hide among
    them.
    """
    try:
        yield
    except KinidError:
        raise
    except Exception as error:
        said = " ".join(str(error).split()) or type(error).__name__
        said = said.rstrip(".") if len(said) <= 120 else said[:117] + "..."
        raise InputError(f"{path}, which can't be read as {kind} ({said})", f"{kind} without damage", mend) from None
