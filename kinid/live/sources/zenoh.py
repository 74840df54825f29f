"""ROS 2 over Zenoh, as rmw_zenoh sends it: `zenoh://127.0.0.1:7447`, or with a domain `zenoh://127.0.0.1:7447/3`.

A topic is the key DOMAIN/TOPIC/TYPE/HASH, its payload CDR, and its attachment the publisher's running number, a time
and the publisher's name (github.com/ros2/rmw_zenoh, docs/design.md). This is a client of a router, or of any one peer:
it listens to no port, finds nobody by multicast, and publishes nothing. The rig's [streams] names the topics of joints
and wrench; without, the first that comes of each type is taken, and others are told once.
"""

from __future__ import annotations

import json
import queue
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError
from kinid.live.cdr import TYPES, Decoder
from kinid.live.messages import Item, Joints, Notice, Source
from kinid.live.sources import IDLE, Asked

if TYPE_CHECKING:
    from zenoh import Sample

SCHEME = "zenoh"
HELP = "zenoh://127.0.0.1:7447[/DOMAIN] takes topics of ROS 2 (rmw_zenoh)"

#: where rmw_zenoh's router listens; an answer is waited for so long [s]; a lost one is sought again so often [ms]
ADDRESS, ANSWERS, AGAIN = "127.0.0.1:7447", 3.0, 500
#: messages that wait at most; what comes then is left out, and told
WAITING = 20_000
#: of an attachment: running number, time of sending [ns]; the rest is the publisher's name
_ATTACHMENT = struct.Struct("<qq")
#: topics that are told not to be taken; of those that are there instead of one that is named
MOST_TOPICS, SHOWN_TOPICS = 64, 8
#: a topic that the rig names has so long to begin before others of its type are looked for [ns]; ROS 2 knows domains to
BEGIN_NS, LAST_DOMAIN = 1_000_000_000, 232
#: a publisher is another one's successor where that has been silent for so long [ns]
SILENT_NS = 200_000_000


def open_source(address: str, asked: Asked) -> Source:
    """Join a Zenoh network at HOST:PORT[/DOMAIN].

    Raises:
        InputError: no such address, or nobody who answers there. MissingDependencyError: no Zenoh, or no rosbags.
    """
    return Client(address, asked.rig, asked.joints)


class Client:
    """A Zenoh client that takes two topics, of each topic one publisher.

    Args:
        address: HOST:PORT[/DOMAIN]. rig: may name the topics. joints: of the robot: a publisher of none of them is of
            another device.
    """

    live = True

    def __init__(self, address: str, rig: Rig | None = None, joints: Sequence[str] | None = None) -> None:
        where, _, domain = address.partition("/")
        host, colon, port = (where or ADDRESS).rpartition(":")
        domain = domain or "0"
        if not host or not colon or not (port.isdigit() and 0 < int(port) < 65536) or not domain.isdigit():
            raise InputError(f"address '{address}'", "HOST:PORT, or HOST:PORT/DOMAIN", f"name it as zenoh://{ADDRESS}")
        if int(domain) > LAST_DOMAIN:
            raise InputError(f"domain {domain[:9]}", f"0 to {LAST_DOMAIN}, as ROS 2 has them", "correct ROS_DOMAIN_ID")
        self.name = f"zenoh://{host}:{port}/{domain}"
        self._decode = Decoder()
        streams = (rig or Rig()).streams
        named = {"joints": streams.joints, "wrench": streams.wrench}
        self._taken = {role: name.strip("/") for role, name in named.items() if name}
        self._others, self._joints = set[str](), tuple(joints or ())
        self._publishers: dict[str, tuple[bytes, int, int]] = {}
        self._beside: set[bytes] = set()
        self._queue: queue.SimpleQueue[tuple[str, int, Sample] | None] = queue.SimpleQueue()
        self._missed, self._open = 0, True
        self._keys = {
            role: f"{domain}/{self._taken.get(role, '**')}/{_mangled(kind)}/*" for role, kind in TYPES.items()
        }
        self._any = {role: f"{domain}/**/{_mangled(TYPES[role])}/*" for role in self._taken}
        self._offered, self._listeners = dict[str, set[str]](), dict[str, Any]()
        self._subscribers: list[object] = []  # kept: one that is forgotten ends
        self._session = _connect(f"tcp/{host}:{port}", self.name, self._keys)

    def items(self) -> Iterator[Item]:
        """See `Source`; it begins with what comes from now on."""
        while self._subscribers and not self._queue.empty():
            self._queue.get()
            self._publishers.clear()
        if not self._subscribers and self._open:
            declare = self._session.declare_subscriber
            self._subscribers = [declare(key, self._taker(role)) for role, key in self._keys.items()]
        look = time.monotonic_ns() + BEGIN_NS
        while self._open:
            if self._any and time.monotonic_ns() > look:
                look += BEGIN_NS
                yield from self._others_of_type()
            try:
                came = self._queue.get(timeout=IDLE)
            except queue.Empty:
                yield None
                continue
            if came is None:  # closed
                return
            role, received, sample = came
            if role in self._any:  # it has begun
                del self._any[role]
                if role in self._listeners:
                    self._listeners.pop(role).undeclare()
            if self._missed:
                missed, self._missed = self._missed, 0
                yield Notice(received, "overrun", f"{missed} messages were missed")
            yield from self._items(role, received, sample)

    def close(self) -> None:
        """See `Source`."""
        if self._open:
            self._open = False
            self._session.close()
            self._queue.put(None)

    def _taker(self, role: str) -> Callable[[Sample], None]:
        """Takes the messages of a role, in Zenoh's thread."""
        waiting, put, now = self._queue.qsize, self._queue.put, time.monotonic_ns

        def take(sample: Sample) -> None:
            if waiting() < WAITING:
                put((role, now(), sample))
            else:
                self._missed += 1

        return take

    def _others_of_type(self) -> Iterator[Notice]:
        """Listen for topics of the type of those that are named and don't come, and tell of them once."""
        for role, key in list(self._any.items()):
            if role not in self._offered:
                offered = self._offered[role] = set[str]()
                self._listeners[role] = self._session.declare_subscriber(key, partial(_note_topic, offered))
            elif self._offered[role]:
                del self._any[role]
                self._listeners.pop(role).undeclare()
                seen = ", ".join(f"/{topic}" for topic in sorted(self._offered[role].copy()))
                says = f"/{self._taken[role]}, as [streams] {role} names it, doesn't come; of its type there is {seen}"
                yield Notice(time.monotonic_ns(), "topic", says)

    def _items(self, role: str, received: int, sample: Sample) -> Iterator[Item]:
        """What a message says."""
        topic = _topic(sample)
        if self._taken.setdefault(role, topic) != topic:
            if topic not in self._others and len(self._others) < MOST_TOPICS:
                self._others.add(topic)
                yield Notice(received, "topic", f"/{topic} beside /{self._taken[role]}: [streams] {role} chooses")
            return
        attachment = b"" if sample.attachment is None else bytes(sample.attachment)
        publisher = attachment[_ATTACHMENT.size :]
        if publisher:
            if not self._is_taken(topic, publisher, received):
                if publisher not in self._beside and len(self._beside) < MOST_TOPICS:
                    self._beside.add(publisher)
                    yield Notice(received, "topic", f"two publishers of /{topic}: one is taken, the other left out")
                return
            yield from self._followed(topic, publisher, received, _ATTACHMENT.unpack_from(attachment)[0])
        payload = bytes(sample.payload)
        try:
            item = self._decode(role, received, payload)
            if isinstance(item, Joints) and self._beside and not self._knows(item.names):
                # of another device, and there is a second publisher: that one is taken from now on
                self._publishers.pop(topic, None)
                self._beside = {publisher}
            yield item
        except Exception as error:  # whatever a decoder makes of bytes that are no message
            yield Notice(received, "malformed", f"/{topic}, {len(payload)} bytes: {type(error).__name__} {error}"[:200])

    def _knows(self, names: Sequence[str] | None) -> bool:
        """Whether any of a message's joints is the robot's."""
        return names is None or not self._joints or bool(set(self._joints) & set(names))

    def _is_taken(self, topic: str, publisher: bytes, received: int) -> bool:
        """Whether messages of this publisher are taken: of two that speak at once the first is."""
        if topic not in self._publishers:
            return publisher not in self._beside
        taken, _, heard = self._publishers[topic]
        return taken == publisher or received - heard > SILENT_NS

    def _followed(self, topic: str, publisher: bytes, received: int, number: int) -> Iterator[Notice]:
        """What the publisher's running number says: of messages that never came, of another publisher."""
        before, last, _ = self._publishers.get(topic, (publisher, number - 1, received))
        if before != publisher:
            self._beside.discard(publisher)
            yield Notice(received, "source-restarted", f"another publisher of /{topic}")
        elif number > last + 1:
            lost = number - last - 1
            yield Notice(received, "gap", f"{lost} messages of /{topic} never came", lost)
        self._publishers[topic] = (publisher, number if before != publisher else max(number, last), received)


def _topic(sample: Sample) -> str:
    """A message's topic, of its key DOMAIN/TOPIC/TYPE/HASH."""
    return str(sample.key_expr).split("/", 1)[-1].rsplit("/", 2)[0]


def _note_topic(topics: set[str], sample: Sample) -> None:
    """In Zenoh's thread."""
    if len(topics) < SHOWN_TOPICS:
        topics.add(_topic(sample))


def _mangled(kind: str) -> str:
    """A type's name in a key: geometry_msgs::msg::dds_::WrenchStamped_."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


def _connect(endpoint: str, name: str, keys: Mapping[str, str]) -> Any:
    """A session as a client.

    Raises:
        InputError: keys, by role, that are none; nobody answers.
    """
    try:
        import zenoh
    except ImportError:
        raise MissingDependencyError("eclipse-zenoh", "live") from None
    for role, key in keys.items():
        try:
            zenoh.KeyExpr(key)
        except zenoh.ZError:
            raise InputError(
                f"a topic for the {role} that no key of Zenoh can be made of: {key}",
                "a name as /joint_states",
                f"correct [streams] {role}",
            ) from None
    settings = {
        "mode": "client",
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": round(1e3 * ANSWERS),
            "exit_on_failure": True,
            "retry": {"period_init_ms": 100, "period_max_ms": AGAIN, "period_increase_factor": 2},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        raise InputError(
            f"nobody who answers at {name} ({str(error).split(' at /')[0][:80]})",
            "a Zenoh router or peer",
            "start it first: ros2 run rmw_zenoh_cpp rmw_zenohd",
        ) from None
