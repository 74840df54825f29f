"""MCAP: JointState and WrenchStamped messages as ROS 1, ROS 2 (CDR) or JSON."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, BinaryIO

from kinid.data.log import Log
from kinid.data.readers._bag import KINDS, Bag, Message, Topic, to_log
from kinid.data.readers._guard import readable
from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    from mcap.reader import McapReader
    from mcap.records import Channel, Schema

SUFFIXES: tuple[str, ...] = (".mcap",)

#: how files that this project writes name their library, and the metadata of a session
LIBRARY = "kinid"
_DAMAGED = "repair or copy it again: 'mcap recover' rescues what a cut-off file still holds"
_MAGIC = b"\x89MCAP0\r\n"
_TYPES = {
    "joints": "sensor_msgs/msg/JointState",
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "text": "std_msgs/msg/String",
}


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read the JointState and WrenchStamped topics of an MCAP file; JSON messages have the same fields."""
    with opened(path, rig) as (bag, rig_of_bag):
        return to_log(bag, rig_of_bag, joints)


@contextmanager
def opened(path: Path, rig: Rig) -> Iterator[tuple[Bag, Rig]]:
    """An open file, and the rig that its messages are read with.

    A recording of `kinid live` holds SI units on topics of its own, whatever units and topics its source had: of it,
    those that the rig names for the source don't count.

    Raises:
        MissingDependencyError: no library for MCAP. InputError: a damaged file.
    """
    try:
        import mcap.reader
    except ImportError:
        raise MissingDependencyError("mcap", "bags") from None
    with path.open("rb") as stream:
        _refuse_cut(path, stream)
        with readable(path, "MCAP", _DAMAGED):
            reader = mcap.reader.make_reader(stream, validate_crcs=True)
            session = _session(reader)
        if session is not None:
            streams = rig.streams.model_copy(update={"joints": None, "wrench": None, "joint_commands": None})
            rig = rig.model_copy(update={"columns": {}, "streams": streams})
        yield _Bag(path, reader), rig


def recorded_rig(path: Path) -> Rig | None:
    """The rig that `kinid live --record` wrote into its recording; None where there is none.

    Raises:
        InputError: a damaged file, or a rig in it that can't be one.
    """
    try:
        import mcap.reader
    except ImportError:
        return None
    with path.open("rb") as stream, readable(path, "MCAP", _DAMAGED):
        _refuse_cut(path, stream)
        text = (_session(mcap.reader.make_reader(stream)) or {}).get("rig")
        if text is None:
            return None
        tables = json.loads(text)
    return Rig.parse(tables, folder=path.parent, where=f"the rig in {path}")


def _refuse_cut(path: Path, stream: BinaryIO) -> None:
    """Refuse a file that begins as MCAP and doesn't end so; the library takes what stands there for sizes.

    Raises:
        InputError: it is cut off.
    """
    begin, size = stream.read(len(_MAGIC)), stream.seek(0, os.SEEK_END)
    stream.seek(max(size - len(_MAGIC), 0))
    end = stream.read()
    stream.seek(0)
    if begin == _MAGIC != end:
        raise InputError(f"{path}, which is cut off: it doesn't end as MCAP", "all of the recording", _DAMAGED)


def _session(reader: McapReader) -> dict[str, str] | None:
    """What `kinid live --record` wrote of its session; None for a file of anybody else."""
    if reader.get_header().library != LIBRARY:
        return None
    return next((dict(m.metadata) for m in reader.iter_metadata() if m.name == LIBRARY), None)


class _Bag:
    """An open file as `_bag` wants it."""

    def __init__(self, path: Path, reader: McapReader) -> None:
        self.source, self._path, self._reader = str(path), path, reader
        with readable(path, "MCAP", _DAMAGED):
            channels, schemas, counts = self._contents()
            samples = self._first_json(channels)
        self._decoders: dict[int, Callable[[bytes], Message]] = {}
        found: dict[str, Topic] = {}
        for key, channel in channels.items():
            schema = schemas.get(channel.schema_id)
            name = schema.name if schema else ""
            kind = KINDS.get(name.replace(".", "/").split("/")[-1]) or _kind_of(samples.get(channel.topic))
            decoder = _decoder(channel.message_encoding, kind) if kind else None
            if decoder is None:
                kind = None
            else:
                self._decoders[key] = decoder
            shown = name or channel.message_encoding
            before = found.get(channel.topic, Topic(channel.topic, shown, None, 0))
            count = before.count + counts[key]
            found[channel.topic] = Topic(channel.topic, shown, kind or before.kind, count)
        self.topics = list(found.values())

    def _contents(self) -> tuple[dict[int, Channel], dict[int, Schema], Counter[int]]:
        """Channels, schemas and numbers of messages, from the summary, or from all messages without one."""
        summary = self._reader.get_summary()
        if summary is not None and summary.statistics is not None and summary.channels:
            counts = Counter(dict(summary.statistics.channel_message_counts))
            return dict(summary.channels), dict(summary.schemas), counts
        channels, schemas, counts = {}, {}, Counter()
        for schema, channel, _ in self._reader.iter_messages():
            channels[channel.id] = channel
            counts[channel.id] += 1
            if schema is not None:
                schemas[schema.id] = schema
        return channels, schemas, counts

    def _first_json(self, channels: dict[int, Channel]) -> dict[str, Message]:
        """The first message of each JSON topic: its fields tell what it is when its schema's name doesn't."""
        topics = {c.topic for c in channels.values() if c.message_encoding == "json"}
        first: dict[str, Message] = {}
        for topic in topics:
            for _, channel, message in self._reader.iter_messages(topics=[topic]):
                if channel.message_encoding == "json":
                    first[topic] = _parse(message.data)
                break
        return first

    def messages(self, names: Sequence[str]) -> Iterator[tuple[str, int, Message]]:
        with readable(self._path, "MCAP", _DAMAGED):
            for _, channel, message in self._reader.iter_messages(topics=list(names)):
                decode = self._decoders.get(channel.id)
                if decode is not None:
                    yield channel.topic, message.log_time, decode(message.data)


def _parse(data: bytes) -> Message:
    return json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))


def _kind_of(message: Message) -> str | None:
    """What a JSON message is by its fields."""
    if message is None:
        return None
    wrench = getattr(message, "wrench", message)
    if hasattr(wrench, "force") and hasattr(wrench, "torque"):
        return "wrench"
    return "joints" if hasattr(message, "name") and hasattr(message, "position") else None


def _decoder(encoding: str, kind: str) -> Callable[[bytes], Message] | None:
    """From bytes to a message; None for an encoding that is not read."""
    if encoding == "json":
        return _parse
    if encoding not in ("cdr", "ros1") or kind not in _TYPES:
        return None
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingDependencyError("rosbags", "bags") from None
    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    decode = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
    return lambda data: decode(data, _TYPES[kind])
