"""A ring of samples in shared memory: `shm:/dev/shm/kinid`, for programs of the robot on this machine.

The file holds a head of 64 bytes and then slots, all little-endian and in the machine's own order:

    head   8 bytes "KINIDSHM" | uint32 version 1 | uint32 slots | uint32 numbers of a slot | uint32 0
           | uint64 samples written | uint64 number of the run, another one each time the sender begins
    slot   uint64 1 + number of the sample, 0 while it is written | uint32 1 joints, 2 wrench | uint32 numbers
           | int64 stamp [ns] | float64 numbers: q (N), dq (N) or none, tau (N) or none; or the wrench (6)

The sender writes 0 to the slot's number, then the sample, then the number, then the head's count, and never waits for
anybody; a reader that was too slow is told how many it missed.
"""

from __future__ import annotations

import mmap
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kinid.errors import InputError
from kinid.inputs import check_regular
from kinid.live.messages import Item, Joints, Notice, Source, Wrench
from kinid.live.sources import IDLE, Asked

SCHEME = "shm"
HELP = "shm:PATH reads a ring in shared memory"

MAGIC, VERSION, HEAD = b"KINIDSHM", 1, 64
_LAYOUT, _SLOT = struct.Struct("<8sIIII"), struct.Struct("<QIIq")
_COUNT, _RUN = 24, 32
#: between two looks at a ring without news [s]
LOOK = 1e-4


def open_source(address: str, asked: Asked) -> Source:
    """Open a ring that a sender has made.

    Raises:
        InputError: no such file, or none that is a ring.
    """
    if asked.joints is None:
        raise InputError("a ring without a rig", "the robot whose joints it holds", "name the rig with --rig")
    return Ring(Path(address), len(asked.joints))


class Ring:
    """A ring of samples in a file that is mapped into memory.

    Args:
        path: of the file. joints: of the robot.
    """

    live = True

    def __init__(self, path: Path, joints: int) -> None:
        self.name, self._joints = f"shm:{path}", joints
        check_regular(path, "ring", "the file of a sender that has begun", "begin the sender first")
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no ring at {path} ({error})", "the file of a sender that has begun", "begin the sender first"
            ) from None
        magic, version, self._slots, self._width, _ = (
            _LAYOUT.unpack_from(self._map) if len(self._map) >= HEAD else 5 * (0,)
        )
        self._size = _SLOT.size + 8 * self._width
        if magic != MAGIC or version != VERSION or len(self._map) < HEAD + self._slots * self._size or not self._slots:
            raise InputError(f"{path}, which is no ring of version {VERSION}", "a ring", "see docs/live.md")
        self._open = True

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        run, count = self._long(_RUN), self._long(_COUNT)
        quiet = 0.0
        while self._open:
            now = self._long(_COUNT)
            if self._long(_RUN) != run:
                run, count, now = self._long(_RUN), 0, self._long(_COUNT)
                yield Notice(time.monotonic_ns(), "source-restarted", self.name)
            if now == count:
                time.sleep(LOOK)
                quiet += LOOK
                if quiet >= IDLE:
                    quiet = 0.0
                    yield None
                continue
            quiet = 0.0
            if now - count > self._slots:
                yield Notice(time.monotonic_ns(), "overrun", f"{now - count - self._slots} samples were missed")
                count = now - self._slots
            for number in range(count, now):
                yield self._read(number)
            count = now

    def close(self) -> None:
        """See `Source`."""
        self._open = False

    def _long(self, at: int) -> int:
        return int.from_bytes(self._map[at : at + 8], "little")

    def _read(self, number: int) -> Item:
        """One sample; a notice where it was overwritten meanwhile or isn't one."""
        begin = HEAD + (number % self._slots) * self._size
        received = time.monotonic_ns()
        data = self._map[begin : begin + self._size]  # a copy, which is checked against the number behind it
        mark, kind, many, stamp = _SLOT.unpack_from(data)
        if mark != number + 1 or self._long(begin) != mark:
            return Notice(received, "overrun", "1 sample was missed")
        n = self._joints
        if many > self._width or (kind, many) not in ((2, 6), (1, n), (1, 2 * n), (1, 3 * n)):
            return Notice(received, "malformed", f"{many} numbers of kind {kind} in {self.name}")
        values = np.frombuffer(data, np.float64, many, _SLOT.size)
        if kind == 2:
            return Wrench(received, stamp, values)
        return Joints(received, stamp, values[:n], values[n : 2 * n], values[2 * n :])
