"""A source that hands over what a test has prepared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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
