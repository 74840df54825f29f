"""The border to the libraries that parse files: whatever they say of damaged bytes becomes one clear line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kinid.errors import InputError, KinidError
from kinid.inputs import raised, size_limit

#: bytes that a packed file may unpack to: ten million rows, and no more than fits beside what is made of them
MOST_UNPACKED = 2_000_000_000
#: times that a file of arrays may be smaller than what it holds, beyond that size: measured numbers hardly shrink
MOST_PACKED = 100


def check_unpacked(path: Path, size: float) -> None:
    """Refuse a small file that unpacks to more than memory holds, before it is unpacked.

    Args:
        path: of the file. size: of what it holds [bytes].

    Raises:
        InputError: how large.
    """
    if size > size_limit(MOST_UNPACKED) and size > MOST_PACKED * (packed := path.stat().st_size):
        raise InputError(
            f"{size / 1e9:.3g} GB of columns in {path}, a file of {packed / 1e6:.3g} MB",
            f"{size_limit(MOST_UNPACKED) / 1e9:.3g} GB, or {MOST_PACKED} times the file, at most",
            f"ask where it is from, {raised(size, MOST_UNPACKED)}",
        )


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
