"""Who is told of all that a session does: a recorder, a server. A thread of its own works, so that no sample waits."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque

from kinid.errors import KinidError
from kinid.live.encoding import EVENTS, JOINTS, WRENCH
from kinid.live.events import Event
from kinid.live.messages import Joints, Wrench
from kinid.writers import Json

#: between two goes of the thread [s]
FLUSH = 0.02


class Sink(ABC):
    """Takes everything at once, and works it off every `FLUSH` seconds.

    Attributes:
        error: why it has given up; empty while it works.
    """

    def __init__(self, name: str) -> None:
        self.error = ""
        self._queue: deque[tuple[str, int, int, Joints | Wrench | Json]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"kinid {name}", daemon=True)

    def sample(self, message: Joints | Wrench, stamp: int) -> None:
        """A sample that was used; stamp: on the continuous clock [ns]."""
        self._queue.append((JOINTS if type(message) is Joints else WRENCH, message.received, stamp, message))

    def event(self, event: Event, received: int, stamp: int) -> None:
        """An event."""
        self._queue.append((EVENTS, received, stamp, event.to_dict()))

    def state(self, topic: str, received: int, stamp: int, values: Json) -> None:
        """Contact quantities or estimates."""
        self._queue.append((topic, received, stamp, values))

    def close(self) -> None:
        """Work off what waits, and end."""
        self._stop.set()
        self._thread.join()

    def _work(self) -> None:
        """The thread: write what waits, again and again."""
        while True:
            last = self._stop.wait(FLUSH)
            try:
                while self._queue:
                    self._write(*self._queue.popleft())
                self._commit()
            except (OSError, ValueError, KinidError) as error:  # a full disk: the session goes on, and says so
                self.error = str(error)
                self._queue = deque(maxlen=1)
                return
            if last:
                return

    @abstractmethod
    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        """One message, in the thread."""

    def _commit(self) -> None:
        """What waited is written."""
