"""A log as a stream, at its own or any other speed: `log.parquet`, `poke.csv`, `out.mcap`, `file:log.npz`.

MCAP and ROS bags are replayed message by message, as they were received; of tables each row is a sample of joints and
wrench.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from kinid.data.readers import messages, read
from kinid.data.readers._bag import Bag, Message, in_si, joint_values, stamp_of, topics_of, wrench_row
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live.encoding import EVENTS
from kinid.live.messages import Item, Joints, Source, Start, Wrench
from kinid.live.sources import Asked, Pace

SCHEME = "file"
HELP = "PATH replays a log"


def open_source(address: str, asked: Asked) -> Source:
    """Open a log.

    Raises:
        InputError: a log that can't be read, or that has no joints or no wrench.
    """
    path = Path(address)
    bag = messages(path, asked.rig or Rig())
    return Table(path, asked) if bag is None else Recording(path, bag, asked)


class Table:
    """Rows of a log on one clock. Arguments as `open_source`."""

    live = False

    def __init__(self, path: Path, asked: Asked) -> None:
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
    """Messages of a bag, in the order and at the times of their reception.

    Args:
        path: of the bag, for people. bag: it, and the rig that its messages are read with. asked: as in `open_source`.
    """

    live = False

    def __init__(self, path: Path, bag: AbstractContextManager[tuple[Bag, Rig]], asked: Asked) -> None:
        self.name, self.live = str(path), asked.speed > 0.0
        self._speed, self._open = asked.speed, ExitStack()
        self._bag, rig = self._open.enter_context(bag)
        try:
            roles = topics_of(self._bag, rig)
            for role in ("joints", "wrench"):
                if role not in roles:
                    raise InputError(
                        f"no topic for the {role} in {path}", "joints and wrench", "replay a log that has both"
                    )
        except InputError:
            self._open.close()
            raise
        self._roles = {topic: role for role, topic in roles.items() if role in ("joints", "wrench")}
        self._scales = {quantity: in_si(rig, quantity) for quantity in ("q", "dq", "tau", "wrench")}

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        events = [topic.name for topic in self._bag.topics if topic.kind == "event" and topic.name == EVENTS]
        pace, sample = Pace(self._speed), None
        # a sample may complete several pairs, and estimators start in the midst of them: what is recorded behind it
        # comes first
        for topic, received, message in self._bag.messages([*self._roles, *events]):
            if topic in self._roles:
                if sample is not None:
                    yield self._sample(pace, *sample)
                sample = (topic, received, message)
            elif message.kind == "warm-start":
                yield Start(received, stamp_of(message), vars(message.values))
        if sample is not None:
            yield self._sample(pace, *sample)

    def _sample(self, pace: Pace, topic: str, recorded: int, message: Message) -> Item:
        """A message as a sample, when it is due."""
        received, stamp = pace.wait(recorded), stamp_of(message) or None
        if self._roles[topic] == "wrench":
            return Wrench(received, stamp, self._si("wrench", wrench_row(message)))
        names, values = joint_values(message)
        q, dq, tau = (self._si(quantity, value) for quantity, value in zip(("q", "dq", "tau"), values))
        return Joints(received, stamp, q, dq, tau, names)

    def _si(self, quantity: str, values: Sequence[float | None]) -> list[float]:
        scale, offset = self._scales[quantity]
        return [math.nan if x is None else x * scale + offset for x in values]

    def close(self) -> None:
        """See `Source`."""
        self._open.close()
