"""A ring of samples in shared memory: `shm:/dev/shm/kinid`, for programs of the robot on this machine.

The file holds a head of 64 bytes and then slots, all little-endian and in the machine's own order:

    head   8 bytes "KINIDSHM" | uint32 version 1 | uint32 slots | uint32 numbers of a slot | uint32 0
           | uint64 samples written | uint64 number of the run, another one each time the sender begins
    slot   uint64 1 + number of the sample, 0 while it is written | uint32 1 joints, 2 wrench | uint32 numbers
           | int64 stamp [ns] | float64 numbers: q (N), dq (N) or none, tau (N) or none; or the wrench (6)

The sender writes 0 to the slot's number, then the sample, then the number, then the head's count, and never waits for
anybody; a reader that was too slow is told how many it missed. It reads the file instead of mapping it: a sender that
begins anew may cut it off, or put another one in its place, and a mapping would end the reader with it.
"""

from __future__ import annotations

import contextlib
import os
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
        self._path = path
        try:
            self._file = path.open("rb", buffering=0)
        except OSError as error:
            raise InputError(
                f"no ring at {path} ({error.strerror})", "the file of a sender that has begun", "begin the sender first"
            ) from None
        if not self._look_at_head():
            self._file.close()
            raise InputError(f"{path}, which is no ring of version {VERSION}", "a ring", "see docs/live.md")
        self._open = True

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        with contextlib.suppress(ValueError):  # it was closed while it was read
            yield from self._items()

    def _items(self) -> Iterator[Item]:
        run, count = self._long(_RUN), self._long(_COUNT)
        quiet = 0.0
        while self._open:
            now = self._long(_COUNT)
            if self._long(_RUN) != run and self._look_at_head():
                run, count, now = self._long(_RUN), 0, self._long(_COUNT)
                yield Notice(time.monotonic_ns(), "source-restarted", self.name)
            if now <= count:  # less: a sender that is just beginning anew
                time.sleep(LOOK)
                quiet += LOOK
                if quiet >= IDLE:
                    quiet = 0.0
                    self._follow()
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
        self._file.close()

    def _look_at_head(self) -> bool:
        """Whether the file is a ring by now; takes its sizes from there."""
        head = os.pread(self._file.fileno(), _LAYOUT.size, 0)
        if len(head) < _LAYOUT.size:
            return False
        magic, version, self._slots, self._width, _ = _LAYOUT.unpack(head)
        self._size = _SLOT.size + 8 * self._width
        whole = os.fstat(self._file.fileno()).st_size >= HEAD + self._slots * self._size
        return bool(magic == MAGIC and version == VERSION and self._slots and whole)

    def _follow(self) -> None:
        """Go on with the file that stands at the path now, if it is another one."""
        try:
            if os.path.samestat(self._path.stat(), os.fstat(self._file.fileno())):
                return
            now = self._path.open("rb", buffering=0)
        except OSError:  # the sender is about to make it
            return
        self._file.close()
        self._file = now

    def _long(self, at: int) -> int:
        return int.from_bytes(os.pread(self._file.fileno(), 8, at), "little")

    def _read(self, number: int) -> Item:
        """One sample; a notice where it was overwritten meanwhile or isn't one."""
        begin = HEAD + (number % self._slots) * self._size
        received = time.monotonic_ns()
        data = os.pread(self._file.fileno(), self._size, begin)  # a copy, which is checked against the number behind it
        if len(data) < self._size:
            return Notice(received, "overrun", "1 sample was missed")
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
