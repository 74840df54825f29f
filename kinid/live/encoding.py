"""What a session says, as bytes of its channels: joints and wrench as messages of ROS 2 in CDR, its own as JSON."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import NamedTuple

from kinid.errors import MissingDependencyError
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
_NUMBER, _TEXT = {"type": "number"}, {"type": "string"}
#: null where it isn't known; Foxglove's reader takes one type alone
_OPEN = {"type": "number"}
_VALUE = {"type": "object", "properties": {"value": _OPEN, "std": _OPEN}}
#: parameters that a model may have live
PARAMETERS = ("stiffness", "damping", "exponent", "friction", "viscous")
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}


class Channel(NamedTuple):
    """A topic: how its messages are encoded, and what they hold (name of the schema, its language, its text)."""

    topic: str
    encoding: str
    schema: str
    language: str
    text: bytes


class Coder:
    """Bytes of what a session says. Args: joints: names of the robot's joints; sensor: frame of the wrench.

    Attributes:
        channels: all of them.

    Raises:
        MissingDependencyError: no library that knows the definitions of ROS 2.
    """

    def __init__(self, joints: Sequence[str], sensor: str) -> None:
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingDependencyError("rosbags", "live") from None
        self._joints, self._head = _JointCoder(joints), _wrench_head(sensor)
        store, self.channels = get_typestore(Stores.ROS2_HUMBLE), list[Channel]()
        for topic, kind in ((JOINTS, "sensor_msgs/msg/JointState"), (WRENCH, "geometry_msgs/msg/WrenchStamped")):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            self.channels.append(Channel(topic, "cdr", kind, "ros2msg", text.encode()))
        for topic, name, fields in _OWN:
            text = json.dumps({"type": "object", "title": name, "properties": fields})
            self.channels.append(Channel(topic, "json", name, "jsonschema", text.encode()))

    def __call__(self, stamp: int, what: Joints | Wrench | Json) -> bytes:
        """One message; stamp: on the continuous clock [ns]."""
        if isinstance(what, Joints):
            return self._joints(stamp, what)
        if isinstance(what, Wrench):
            data = self._head + struct.pack("<6d", *what.wrench)
            return data[:4] + struct.pack("<iI", *divmod(stamp, 1_000_000_000)) + data[12:]
        sec, nsec = divmod(stamp, 1_000_000_000)
        return json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **what}).encode()


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
        {
            "timestamp": _TIME,
            "t": _NUMBER,
            "values": {"type": "object", "properties": dict.fromkeys(PARAMETERS, _VALUE)},
            "status": {"type": "object", "properties": dict.fromkeys(PARAMETERS, _TEXT)},
        },
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
            "values": {"type": "object", "properties": dict.fromkeys(PARAMETERS, _NUMBER)},
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
