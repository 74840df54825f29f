"""A log as a stream, at its own or any other speed: `log.parquet`, `poke.csv`, `out.mcap`, `file:log.npz`.

MCAP is replayed message by message, as it was received; of tables each row is a sample of joints and wrench.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError
from kinid.live.messages import Item, Joints, Source, Wrench
from kinid.live.sources import Asked, Pace

SCHEME = "file"
HELP = "PATH replays a log"


def open_source(address: str, asked: Asked) -> Source:
    """Open a log.

    Raises:
        InputError: a log that can't be read, or that has no joints or no wrench.
    """
    path = Path(address)
    if path.suffix.lower() == ".mcap" and path.is_file():
        return Recording(path, asked)
    return Table(path, asked)


class Table:
    """Rows of a log on one clock. Arguments as `open_source`."""

    live = False

    def __init__(self, path: Path, asked: Asked) -> None:
        from kinid.data.readers import read

        self.name, self.live = str(path), asked.speed > 0.0
        self._log = log = read(path, asked.rig, asked.joints)
        for missing, what in ((log.q, "joint positions"), (log.wrench, "wrench")):
            if missing is None:
                raise InputError(f"no {what} in {path}", "joints and wrench", "replay a log that has both")
        self._speed = asked.speed
        # the reader has put both onto one clock; whoever takes the samples adds what the rig says of the wrench's
        streams = None if asked.rig is None else asked.rig.streams
        self._ahead = round(1e9 * ((streams.wrench_clock_offset if streams else None) or 0.0))

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        log = self._log
        assert log.q is not None
        assert log.wrench is not None
        pace = Pace(self._speed)
        stamps = [round(1e9 * (t - log.t[0])) + 1_000_000_000 for t in log.t.tolist()]
        for i, stamp in enumerate(stamps):
            received = pace.wait(stamp)
            dq = () if log.dq is None else log.dq[i]
            tau = () if log.tau is None else log.tau[i]
            yield Joints(received, stamp, log.q[i], dq, tau)
            yield Wrench(received, stamp - self._ahead, log.wrench[i])

    def close(self) -> None:
        """See `Source`."""


class Recording:
    """Messages of an MCAP file, in the order and at the times of their reception. Arguments as `open_source`."""

    live = False

    def __init__(self, path: Path, asked: Asked) -> None:
        try:
            import mcap.reader
        except ImportError:
            raise MissingDependencyError("mcap", "bags") from None
        from kinid.data.readers import _bag
        from kinid.data.readers._guard import readable
        from kinid.data.readers.mcap import _DAMAGED, _Bag

        self.name, self.live = str(path), asked.speed > 0.0
        self._file = path.open("rb")
        with readable(path, "MCAP", _DAMAGED):
            reader = mcap.reader.make_reader(self._file)
        self._bag = _Bag(path, reader)
        roles = _bag._topics(self._bag, asked.rig or Rig())
        for role in ("joints", "wrench"):
            if role not in roles:
                raise InputError(
                    f"no topic for the {role} in {path}", "joints and wrench", "replay a log that has both"
                )
        self._roles = {topic: role for role, topic in roles.items() if role in ("joints", "wrench")}
        self._speed = asked.speed

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        from kinid.data.readers import _bag

        pace = Pace(self._speed)
        for topic, logged, message in self._bag.messages(list(self._roles)):
            received = pace.wait(logged)
            stamp = _bag._stamp(message) or None
            if self._roles[topic] == "wrench":
                yield Wrench(received, stamp, _bag._wrench_row(message))
            else:
                names, values = _bag._joint_values(message)
                q, dq, tau = ([math.nan if x is None else x for x in value] for value in values)
                yield Joints(received, stamp, q, dq, tau, names)

    def close(self) -> None:
        """See `Source`."""
        self._file.close()
