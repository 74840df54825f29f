"""An MCAP file that is whole at any moment, and indexed once it is closed (mcap.dev, specification 0).

Messages are appended behind the header of a chunk that says it is empty, so that they stand outside of it as single
messages, each at its final place. Once the chunk is full, its index is appended and its header written anew: from then
on they stand within it. So nothing but a header is ever written twice, whatever becomes of the program between two
writes, and readers that seek find their way in the closed file.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kinid.data.readers.mcap import LIBRARY
from kinid.live.encoding import Channel

_MAGIC = b"\x89MCAP0\r\n"
#: the end of a file without a summary: DataEnd, Footer, magic
_TAIL = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + _MAGIC
#: a chunk's header: opcode, length; times, size, CRC of its records, no compression, size
_HEAD = struct.Struct("<BQQQQIIQ")
#: a message's: opcode, length; channel, running number, times of reception and of the message
_MESSAGE = struct.Struct("<BQHIQQ")
#: a chunk is full with so many bytes of messages
_FULL = 1 << 20


class GrowingFile:
    """A file that is whole after each `commit`: what is written waits for it. Args: path: of the file, replaced.

    Raises:
        OSError: no way to open it.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o644)
        self._end, self._waiting = 0, bytearray()
        self._anew: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> None:
        """Let it wait."""
        self._waiting += data

    def write_anew(self, at: int, data: bytes) -> None:
        """Replace what was written in one go at a place, once all that waits is there."""
        if at >= self._end:
            self._waiting[at - self._end : at - self._end + len(data)] = data
        else:
            self._anew.append((at, data))

    def tell(self) -> int:
        """Where the next byte goes."""
        return self._end + len(self._waiting)

    def commit(self, tail: bytes = _TAIL) -> None:
        """Write what waits, and the end of a whole file behind it.

        Raises:
            OSError: a full disk; the file ends where it ended before, whose room it keeps.
        """
        if not self._waiting:
            return
        try:
            self._put(self._end, bytes(self._waiting) + tail)
        except OSError:
            if self._end:
                os.pwrite(self._file, _TAIL, self._end)
                os.ftruncate(self._file, self._end + len(_TAIL))
            raise
        self._end += len(self._waiting)
        self._waiting.clear()
        while self._anew:
            self._put(*self._anew[0])
            del self._anew[0]

    def finish(self) -> None:
        """Write what waits as the end of the file, and close it.

        Raises:
            OSError: as `commit`.
        """
        try:
            end = self.tell()
            self.commit(b"")
            os.ftruncate(self._file, end)
        finally:
            os.close(self._file)

    def _put(self, at: int, data: bytes) -> None:
        while data:
            done = os.pwrite(self._file, data, at)
            data, at = data[done:], at + done


class Container:
    """Channels and their messages in a file. Args: channels: all of them; metadata: of the session, by key.

    Raises:
        ImportError: no library for MCAP.
    """

    def __init__(self, file: GrowingFile, channels: Sequence[Channel], metadata: Mapping[str, str]) -> None:
        from mcap import records as r
        from mcap.data_stream import RecordBuilder

        self._file, self._r, self._builder = file, r, RecordBuilder
        self._schemas = [
            r.Schema(id=k, name=c.schema, encoding=c.language, data=c.text) for k, c in enumerate(channels, 1)
        ]
        self._channels = [
            r.Channel(id=k, topic=c.topic, message_encoding=c.encoding, schema_id=k, metadata={})
            for k, c in enumerate(channels, 1)
        ]
        self._numbers = {c.topic: k for k, c in enumerate(channels, 1)}
        file.write(_MAGIC)
        file.write(self._bytes([r.Header(profile="ros2", library=LIBRARY), *self._schemas, *self._channels]))
        known = self._bytes([r.Metadata(name=LIBRARY, metadata=dict(metadata))])
        self._metadata = r.MetadataIndex(offset=file.tell(), length=len(known), name=LIBRARY)
        file.write(known)
        self._count, self._counts = 0, dict.fromkeys(self._numbers.values(), 0)
        self._chunks: list[Any] = []
        self._at, self._crc, self._span = 0, 0, (0, 0)
        self._index: dict[int, list[tuple[int, int]]] = {}

    def add(self, topic: str, received: int, stamp: int, data: bytes) -> None:
        """A message. Args: received, stamp: its times [ns]."""
        if not self._index:
            self._at, self._crc, self._span = self._file.tell(), 0, (received, received)
            self._file.write(_HEAD.pack(0x06, _HEAD.size - 9, 0, 0, 0, 0, 0, 0))
        number = self._numbers[topic]
        self._count += 1
        running = self._count & 0xFFFFFFFF
        record = _MESSAGE.pack(0x05, _MESSAGE.size - 9 + len(data), number, running, received, stamp) + data
        offset = self._file.tell() - self._at - _HEAD.size
        self._index.setdefault(number, []).append((received, offset))
        self._file.write(record)
        self._crc = zlib.crc32(record, self._crc)
        self._span = min(self._span[0], received), max(self._span[1], received)
        self._counts[number] += 1
        if offset + len(record) >= _FULL:
            self._close_chunk()

    def finish(self) -> None:
        """Write the summary and close the file.

        Raises:
            OSError: a full disk; the file is whole without its summary.
        """
        if self._index:
            self._close_chunk()
            self._file.commit()  # its header, before anything points at it
        r, file = self._r, self._file
        file.write(self._bytes([r.DataEnd(data_section_crc=0)]))
        start, summary, offsets = file.tell(), b"", []
        for group in (self._schemas, self._channels, [self._statistics()], self._chunks, [self._metadata]):
            if group:
                data = self._bytes(group)
                offsets.append(
                    r.SummaryOffset(group_opcode=data[0], group_start=start + len(summary), group_length=len(data))
                )
                summary += data
        at = start + len(summary)
        summary += self._bytes(offsets)
        footer = struct.pack("<BQQQ", 0x02, 20, start, at)
        file.write(summary + footer + struct.pack("<I", zlib.crc32(summary + footer)) + _MAGIC)
        file.finish()

    def _close_chunk(self) -> None:
        """The messages since its header become the chunk's, and their index stands behind them."""
        file, (first, last) = self._file, self._span
        end = file.tell()
        size = end - self._at - _HEAD.size
        file.write_anew(self._at, _HEAD.pack(0x06, _HEAD.size - 9 + size, first, last, size, self._crc, 0, size))
        offsets = {}
        for number, entries in self._index.items():
            offsets[number] = file.tell()
            file.write(self._bytes([self._r.MessageIndex(channel_id=number, records=entries)]))
        self._chunks.append(
            self._r.ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=self._at,
                chunk_length=end - self._at,
                message_index_offsets=offsets,
                message_index_length=file.tell() - end,
                compression="",
                compressed_size=size,
                uncompressed_size=size,
            )
        )
        self._index = {}

    def _statistics(self) -> Any:
        starts, ends = [c.message_start_time for c in self._chunks], [c.message_end_time for c in self._chunks]
        return self._r.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts={number: count for number, count in self._counts.items() if count},
            chunk_count=len(self._chunks),
            message_count=self._count,
            message_end_time=max(ends, default=0),
            message_start_time=min(starts, default=0),
            metadata_count=1,
            schema_count=len(self._schemas),
        )

    def _bytes(self, records: Sequence[Any]) -> bytes:
        builder = self._builder()
        for record in records:
            record.write(builder)
        return bytes(builder.end())
