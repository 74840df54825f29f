"""A source that hands over what a test has prepared, and what this process listens to."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from kinid.live.messages import Item

NAMES = tuple(f"joint_{i}" for i in range(1, 8))


class Prepared:
    """Items that are known beforehand; `at` is the number of the one that is worked on."""

    live = False
    name = "prepared"

    def __init__(self, items: Sequence[Item]) -> None:
        self._items, self.at = items, -1

    def items(self) -> Iterator[Item]:
        for number, item in enumerate(self._items):
            self.at = number
            yield item

    def close(self) -> None:
        pass


def listening() -> set[str]:
    """Sockets of this process that listen."""
    lines = (line.split() for line in Path("/proc/net/tcp").read_text().splitlines())
    inodes = {f"socket:[{words[9]}]" for words in lines if words[3] == "0A"}
    links = (f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd"))
    return inodes & {os.readlink(link) for link in links if os.path.lexists(link)}
