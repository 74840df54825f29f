"""ROS 1 bags, and ROS 2 bags as a folder with metadata.yaml or as one .db3 file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from kinid.data.log import Log
from kinid.data.readers._bag import KINDS, Bag, Message, Topic, to_log
from kinid.data.readers._guard import readable
from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

SUFFIXES: tuple[str, ...] = (".bag", ".db3")
MARKER = "metadata.yaml"

_DAMAGED = "repair or copy it again: 'rosbag reindex' for a ROS 1 bag, 'ros2 bag reindex' for a ROS 2 bag"


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read the JointState and WrenchStamped topics of a bag, by their standard definitions."""
    with opened(path, rig) as (bag, rig_of_bag):
        return to_log(bag, rig_of_bag, joints)


@contextmanager
def opened(path: Path, rig: Rig) -> Iterator[tuple[Bag, Rig]]:
    """An open bag, and the rig that its messages are read with.

    Raises:
        MissingDependencyError: no library for bags. InputError: a damaged bag.
    """
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError:
        raise MissingDependencyError("rosbags", "bags") from None
    ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
    with readable(path, "a ROS bag", _DAMAGED):
        reader = Reader1(path) if ros1 else Reader2(path)
        reader.open()
    try:
        yield _Bag(str(path), reader, ros1), rig
    finally:
        reader.close()


class _Bag:
    """An open bag as `_bag` wants it."""

    def __init__(self, source: str, reader: Reader1 | Reader2, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.source, self._reader = source, reader
        # only standard messages are read: the bag's own definitions, some of which may be odd, are not needed
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self._decode = store.deserialize_ros1 if ros1 else store.deserialize_cdr
        found: dict[str, Topic] = {}
        for connection in reader.connections:
            before = found[connection.topic].count if connection.topic in found else 0
            kind = KINDS.get(connection.msgtype.split("/")[-1])
            found[connection.topic] = Topic(connection.topic, connection.msgtype, kind, connection.msgcount + before)
        self.topics = list(found.values())

    def messages(self, names: Sequence[str]) -> Iterator[tuple[str, int, Message]]:
        wanted = [c for c in self._reader.connections if c.topic in names]
        if not wanted:
            raise InputError(f"no messages in {self.source}", "at least one", "record again")
        with readable(Path(self.source), "a ROS bag", _DAMAGED):
            for connection, received, raw in self._reader.messages(connections=wanted):
                yield connection.topic, received, self._decode(raw, connection.msgtype)
