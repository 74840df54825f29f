"""A session on disk as MCAP, which holds all but the last moments whatever becomes of the program.

Everything that waits is written, with the end that makes a file whole, in one go every `sink.FLUSH` seconds; the next
go writes over that end. So the file can be read at any moment, and a program that is killed has lost no more than that
time. What is read again is what was used: samples that were left out stand on a topic of their own, with the reason.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kinid.errors import InputError, MissingDependencyError
from kinid.live.encoding import Coder
from kinid.live.messages import Joints, Wrench
from kinid.live.sink import Sink
from kinid.writers import Json

#: the end of a file without a summary: DataEnd, Footer, magic (mcap.dev, specification 0)
_TAIL = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + b"\x89MCAP0\r\n"


class _Growing:
    """A file that is whole after each `commit`: what is written waits for it."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o644)
        self._end, self._waiting = 0, bytearray()

    def write(self, data: bytes) -> int:
        """Let it wait."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self._end + len(self._waiting)

    def flush(self) -> None:
        """Nothing: `commit` writes."""

    def commit(self, tail: bytes = _TAIL) -> None:
        """Write what waits, and the end of a whole file behind it.

        Raises:
            OSError: a full disk; the file ends where it ended before, whose room it keeps.
        """
        if not self._waiting:
            return
        data, at = bytes(self._waiting) + tail, self._end
        try:
            while data:
                done = os.pwrite(self._file, data, at)
                data, at = data[done:], at + done
        except OSError:
            if self._end:
                os.pwrite(self._file, _TAIL, self._end)
                os.ftruncate(self._file, self._end + len(_TAIL))
            raise
        self._end += len(self._waiting)
        self._waiting.clear()

    def finish(self) -> None:
        """Write what waits as the end of the file, and close it."""
        try:
            end = self.tell()
            self.commit(b"")
            os.ftruncate(self._file, end)
        finally:
            os.close(self._file)


class Recorder(Sink):
    """Writes a session.

    Args:
        path: of the file, which is replaced.
        joints: names of the robot's joints. sensor: frame of the wrench.
        provenance: what is to be known of the session: source, model, rig, …; plain types.

    Raises:
        MissingDependencyError: no library for MCAP. InputError: a file that can't be written.
    """

    def __init__(self, path: Path, joints: Sequence[str], sensor: str, provenance: Mapping[str, object]) -> None:
        try:
            from mcap.writer import IndexType, Writer
        except ImportError:
            raise MissingDependencyError("mcap", "live") from None
        super().__init__("recorder")
        self._coder = Coder(joints, sensor)
        try:
            self._file = _Growing(path)
        except OSError as error:
            raise _unwritable(path, error) from None
        self.path, self._seq = path, 0
        stream: Any = self._file
        self._writer = Writer(stream, use_chunking=False, index_types=IndexType.METADATA)
        self._writer.start(profile="ros2", library="kinid")
        self._channels = {}
        for topic, encoding, schema, language, text in self._coder.channels:
            number = self._writer.register_schema(schema, language, text)
            self._channels[topic] = self._writer.register_channel(topic, encoding, number)
        self._writer.add_metadata("kinid", {key: _plain(value) for key, value in provenance.items()})
        try:
            self._file.commit()
        except OSError as error:  # nothing of it is there yet
            path.unlink(missing_ok=True)
            raise _unwritable(path, error) from None
        self._thread.start()

    def close(self) -> None:
        """Write what waits, and the summary."""
        super().close()
        if not self.error:
            try:
                self._writer.finish()
                self._file.finish()
            except OSError as error:  # without its summary the file is whole
                self.error = str(error)

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        self._seq += 1
        data = self._coder(stamp, what)
        self._writer.add_message(self._channels[topic], received, data, stamp, self._seq & 0xFFFFFFFF)

    def _commit(self) -> None:
        self._file.commit()


def _unwritable(path: Path, error: OSError) -> InputError:
    expected, mend = "a folder with room that can be written", "choose another --record"
    return InputError(f"no way to write {path} ({error.strerror})", expected, mend)


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
