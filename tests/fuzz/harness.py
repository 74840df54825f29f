"""What is asked of every input: success or one clear refusal, soon, in little memory, and nothing half-written."""

from __future__ import annotations

import contextlib
import io
import resource
import time
from pathlib import Path

from fuzz.cases import Case
from kinid.errors import KinidError

#: that an input may take [s], and bytes that it may raise this process's memory to
LONGEST, MOST_BYTES = 60.0, 2 << 30


def attempt(case: Case, data: bytes, folder: Path) -> str | None:
    """What a case's input is refused with; None where it is taken. The file stays in the folder."""
    path = folder / case.file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    before, peak, refused = _files(folder), _peak(), None
    begun = time.monotonic()
    with contextlib.redirect_stderr(io.StringIO()) as said:
        try:
            case.use(path)
        except KinidError as error:
            refused = str(error)
            assert "\n" not in refused.strip(), refused
    took = time.monotonic() - begun
    assert took < LONGEST, f"{took:.0f} s"
    assert _peak() <= max(peak, MOST_BYTES), f"{_peak() / 1e9:.1f} GB"
    assert "Traceback" not in said.getvalue(), said.getvalue()
    left = _files(folder) - before
    assert not any(name.startswith(".") for name in left), left
    assert not (refused and any(name.startswith("out") for name in left)), (refused, left)
    return refused


def _files(folder: Path) -> set[str]:
    return {path.name for path in folder.rglob("*")}


def _peak() -> int:
    """Most memory that this process had [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
