"""Where samples come from: one module a kind of source, found by scanning this folder.

A module whose name has no leading underscore is a kind. It declares `SCHEME`, by which an address such as
`udp://127.0.0.1:5005` names it, `HELP`, a line on it, and `open_source(address, asked) -> Source`. A plain path is
replayed.
"""

from __future__ import annotations

import importlib
import pkgutil
import time
from dataclasses import dataclass
from types import ModuleType

from kinid.data.rig import Rig
from kinid.errors import InputError, near
from kinid.live.messages import Source

__all__ = ["Asked", "Pace", "kinds", "open_source"]

#: between two looks at a source that says nothing [s]
IDLE = 0.05


@dataclass(frozen=True)
class Asked:
    """What a source is told.

    Attributes:
        rig: names columns and topics; None where the source has one of its own. joints: names of q1…qN, in order.
        speed: of what is replayed or simulated, in parts of its own; 0 for as fast as it goes.
    """

    rig: Rig | None = None
    joints: tuple[str, ...] | None = None
    speed: float = 1.0


class Pace:
    """When a sample of a recorded time is due.

    Args:
        speed: in parts of the recorded one; 0 never waits.
    """

    def __init__(self, speed: float) -> None:
        self._speed, self._begin, self._first = speed, 0, 0

    def due(self, recorded: int) -> int:
        """Time until which a sample of this recorded time [ns] is to be waited for, by the monotonic clock [ns]."""
        if not self._begin:
            self._begin, self._first = time.monotonic_ns(), recorded
        return self._begin + round((recorded - self._first) / self._speed)

    def wait(self, recorded: int) -> int:
        """Wait until then; when a sample of this recorded time is received [ns]: by the recorded clock where nobody
        waits.
        """
        if self._speed <= 0.0:
            return recorded
        due = self.due(recorded)
        while (left := due - time.monotonic_ns()) > 0:
            time.sleep(1e-9 * left)
        return time.monotonic_ns()


def kinds() -> dict[str, ModuleType]:
    """The modules of the folder by scheme."""
    found = (m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))
    modules = [importlib.import_module(f"{__name__}.{name}") for name in found]
    return {module.SCHEME: module for module in modules}


def open_source(address: str, asked: Asked) -> Source:
    """The source that an address names.

    Raises:
        InputError: an unknown scheme, an address that can't be opened, a speed that is negative.
    """
    if not asked.speed >= 0.0:
        raise InputError(f"a speed of {asked.speed}", "0 for as fast as it goes, or more", "leave it out for 1")
    scheme, colon, rest = address.partition(":")
    known = kinds()
    if scheme in known:
        opened: Source = known[scheme].open_source(rest.removeprefix("//"), asked)
        return opened
    if colon and rest.startswith("//"):
        shown = "".join(f"; {module.HELP}" for module in known.values())
        raise InputError(f"source '{address}'", f"a log, or one of {', '.join(known)}{shown}", near(scheme, known))
    replayed: Source = known["file"].open_source(address, asked)
    return replayed
