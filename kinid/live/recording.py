"""A session on disk as MCAP, which holds all but the last moments whatever becomes of the program.

Everything that waits is written, with the end that makes a file whole, in one go every `FLUSH` seconds; the next go
writes over that end. So the file can be read at any moment, and a program that is killed has lost no more than that
time. What is read again is what was used: samples that were left out stand on a topic of their own, with the reason.
"""

from __future__ import annotations

import json
import os
import struct
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kinid.errors import InputError, MissingDependencyError
from kinid.live.events import Event
from kinid.live.messages import Joints, Wrench
from kinid.writers import Json

#: topics of joints, wrench, contact quantities, estimates and events
JOINTS, WRENCH, CONTACT, ESTIMATES, EVENTS = (
    "/joint_states",
    "/ft_sensor/wrench",
    "/kinid/contact",
    "/kinid/estimates",
    "/kinid/events",
)
#: between two goes [s]
FLUSH = 0.02

#: the end of a file without a summary: DataEnd, Footer, magic (mcap.dev, specification 0)
_TAIL = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + b"\x89MCAP0\r\n"
_NUMBER, _TEXT = {"type": "number"}, {"type": "string"}
_OPEN = {"type": ["number", "null"]}
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}


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

    def commit(self, tail: bytes) -> None:
        """Write what waits, and the end of a whole file behind it."""
        if not self._waiting:
            return
        data, at = bytes(self._waiting) + tail, self._end
        self._end += len(self._waiting)
        self._waiting.clear()
        while data:
            done = os.pwrite(self._file, data, at)
            data, at = data[done:], at + done

    def finish(self) -> None:
        """Write what waits as the end of the file, and close it."""
        end = self.tell()
        self.commit(b"")
        os.ftruncate(self._file, end)
        os.close(self._file)


class Recorder:
    """Writes a session; everything it is given is taken at once and written by a thread of its own.

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
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingDependencyError("mcap and rosbags", "bags") from None
        try:
            self._file = _Growing(path)
        except OSError as error:
            raise InputError(
                f"no way to write {path} ({error.strerror})", "a folder that can be written", "choose another --record"
            ) from None
        self.path, self._joints, self.error = path, _JointCoder(joints), ""
        self._head, self._seq = _wrench_head(sensor), 0
        stream: Any = self._file
        self._writer = Writer(stream, use_chunking=False, index_types=IndexType.METADATA)
        self._writer.start(profile="ros2", library="kinid")
        store = get_typestore(Stores.ROS2_HUMBLE)
        self._channels = {}
        for topic, kind in ((JOINTS, "sensor_msgs/msg/JointState"), (WRENCH, "geometry_msgs/msg/WrenchStamped")):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        for topic, name, fields in _OWN:
            text = json.dumps({"type": "object", "title": name, "properties": fields})
            schema = self._writer.register_schema(name, "jsonschema", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "json", schema)
        self._writer.add_metadata("kinid", {key: _plain(value) for key, value in provenance.items()})
        self._file.commit(_TAIL)
        self._queue: deque[tuple[str, int, int, Joints | Wrench | Json]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="kinid recorder", daemon=True)
        self._thread.start()

    def sample(self, message: Joints | Wrench, stamp: int) -> None:
        """Keep a sample that was used; stamp: on the continuous clock [ns]."""
        self._queue.append((JOINTS if type(message) is Joints else WRENCH, message.received, stamp, message))

    def event(self, event: Event, received: int, stamp: int) -> None:
        """Keep an event."""
        self._queue.append((EVENTS, received, stamp, event.to_dict()))

    def state(self, topic: str, received: int, stamp: int, values: Json) -> None:
        """Keep contact quantities or estimates."""
        self._queue.append((topic, received, stamp, values))

    def close(self) -> None:
        """Write what waits, and the summary."""
        self._stop.set()
        self._thread.join()
        if not self.error:
            self._writer.finish()
            self._file.finish()

    def _work(self) -> None:
        """The thread: write what waits, again and again."""
        while True:
            last = self._stop.wait(FLUSH)
            try:
                while self._queue:
                    self._write(*self._queue.popleft())
                self._file.commit(_TAIL)
            except (OSError, ValueError) as error:  # a full disk: the session goes on, and says so
                self.error = str(error)
                self._queue = deque(maxlen=1)
                return
            if last:
                return

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        if isinstance(what, Joints):
            data = self._joints(stamp, what)
        elif isinstance(what, Wrench):
            data = self._head + struct.pack("<6d", *what.wrench)
            data = data[:4] + struct.pack("<iI", *divmod(stamp, 1_000_000_000)) + data[12:]
        else:
            sec, nsec = divmod(stamp, 1_000_000_000)
            data = json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **what}).encode()
        self._seq += 1
        self._writer.add_message(self._channels[topic], received, data, stamp, self._seq & 0xFFFFFFFF)


#: topic, name of the schema, fields
_OWN: tuple[tuple[str, str, Json], ...] = (
    (
        CONTACT,
        "kinid.Contact",
        {
            "timestamp": _TIME,
            "t": _NUMBER,
            **dict.fromkeys(
                (
                    *("depth", "depth_rate", "slip1", "slip2", "slip_rate1", "slip_rate2"),
                    *("normal_force", "tangential_force1", "tangential_force2", "predicted_normal_force"),
                ),
                _OPEN,
            ),
            "in_contact": {"type": "boolean"},
        },
    ),
    (
        ESTIMATES,
        "kinid.Estimates",
        {"timestamp": _TIME, "t": _NUMBER, "values": {"type": "object"}, "status": {"type": "object"}},
    ),
    (
        EVENTS,
        "kinid.Event",
        {
            "timestamp": _TIME,
            "t": _NUMBER,
            "kind": _TEXT,
            "says": _TEXT,
            **dict.fromkeys(("slip1", "slip2", "depth", "normal_force"), _OPEN),
        },
    ),
)


class _JointCoder:
    """sensor_msgs/JointState in CDR (OMG DDSI-RTPS 2.5, section 10): little-endian, numbers aligned to their size."""

    def __init__(self, names: Sequence[str]) -> None:
        body = struct.pack("<I", 1) + b"\0"  # frame_id, empty
        body += bytes(-len(body) % 4) + struct.pack("<I", len(names))
        for name in names:
            text = name.encode() + b"\0"
            body += struct.pack("<I", len(text)) + text
            body += bytes(-len(body) % 4)
        self._names, self._body = tuple(names), body  # behind a stamp of 8 bytes, which shifts nothing
        self._others: dict[tuple[str, ...], _JointCoder] = {}

    def __call__(self, stamp: int, message: Joints) -> bytes:
        """The bytes of one sample."""
        if message.names is not None and message.names != self._names:
            if message.names not in self._others:
                self._others[message.names] = _JointCoder(message.names)
            return self._others[message.names](stamp, message._replace(names=None))
        out = bytearray(struct.pack("<iI", *divmod(stamp, 1_000_000_000)) + self._body)
        for values in (message.q, message.dq, message.tau):
            out += struct.pack("<I", len(values))
            if len(values):
                out += bytes(-len(out) % 8)
                out += struct.pack(f"<{len(values)}d", *values)
        return b"\x00\x01\x00\x00" + bytes(out)


def _wrench_head(frame: str) -> bytes:
    """What stands before the six numbers of geometry_msgs/WrenchStamped in CDR, with room for the stamp."""
    text = frame.encode() + b"\0"
    body = bytes(8) + struct.pack("<I", len(text)) + text
    return b"\x00\x01\x00\x00" + body + bytes(-len(body) % 8)


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
