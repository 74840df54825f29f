"""One item after the other, here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import final

from kinid.batch.runners._runner import In, Lost, Out, Runner, attempt


@final
class Serial(Runner):
    """Nothing but this process."""

    apart = False

    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> Iterator[tuple[int, Out | Lost]]:
        """See `Runner`."""
        for place, item in enumerate(items):
            yield place, attempt(do, item)


def begin(address: str, workers: int | None) -> Serial:
    """The runner; both arguments mean nothing to it."""
    return Serial()
