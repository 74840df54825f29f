"""Processes of this machine, each with a pipe of its own: which item a worker died of is no guess."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, final

from kinid.batch.runners._runner import TRIES, In, Lost, Out, Runner, cores, died, packed, unpacked

#: a forked process would inherit locks that nobody lets go of
CONTEXT = multiprocessing.get_context("spawn")


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Ctrl-C waits until the block ends; a process that begins within it never hears of one, though it still loads."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection) -> None:
    """A worker: takes tasks until its pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the first process' affair
    try:
        while True:
            pipe.send_bytes(pickle.dumps(unpacked(pipe.recv_bytes())))
    except (EOFError, OSError):
        return


class _Worker:
    """One process and this end of its pipe."""

    def __init__(self) -> None:
        self.pipe, far = CONTEXT.Pipe()
        self.process = CONTEXT.Process(target=_serve, args=(far,), daemon=True)
        with _without_interrupts():
            self.process.start()
        far.close()

    def end(self) -> str:
        """Stop it; how it ended, in words."""
        self.pipe.close()
        self.process.join(0.2)
        code = self.process.exitcode
        if code is None:
            self.process.kill()
            self.process.join()
        return f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"


@final
class Processes(Runner):
    """So many processes; one that dies is replaced, and its item is tried again."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._all: list[_Worker] = []

    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> Iterator[tuple[int, Out | Lost]]:
        """See `Runner`; an item goes to the same worker each time where that is free: it may remember the log."""
        while len(self._all) < min(self.workers, len(items)):
            self._all.append(_Worker())
        queues = [deque(range(i, len(items), len(self._all))) for i in range(len(self._all))]
        deaths: Counter[int] = Counter()
        busy: dict[int, int] = {}
        try:
            while any(queues) or busy:
                for i in [i for i in range(len(queues)) if i not in busy and any(queues)]:
                    queue = queues[i] or max(queues, key=len)
                    if queue:
                        busy[i] = queue.popleft() if queue is queues[i] else queue.pop()
                        self._hand(i, packed(do, items[busy[i]]))
                ready = wait([self._all[i].pipe for i in busy])
                for i in [i for i in busy if self._all[i].pipe in ready]:
                    place = busy.pop(i)
                    try:
                        result: Any = pickle.loads(self._all[i].pipe.recv_bytes())
                    except (EOFError, OSError):
                        how = self._all[i].end()
                        self._all[i] = _Worker()
                        deaths[place] += 1
                        if deaths[place] < TRIES:
                            queues[i].appendleft(place)
                            continue
                        result = died(how)
                    yield place, result
        finally:
            if busy:  # whoever took the results has gone: what is on its way belongs to nobody
                self.close()

    def _hand(self, number: int, task: bytes) -> None:
        """Give a worker its task; one that died while it was idle is replaced."""
        try:
            self._all[number].pipe.send_bytes(task)
        except OSError:
            self._all[number].end()
            self._all[number] = _Worker()
            self._all[number].pipe.send_bytes(task)

    def pids(self) -> list[int]:
        """Of the workers."""
        return [worker.process.pid or 0 for worker in self._all]

    def close(self) -> None:
        """End all workers."""
        for worker in self._all:
            worker.process.terminate()
            worker.end()
        self._all = []


def begin(address: str, workers: int | None) -> Processes:
    """The runner; an address means nothing to it."""
    return Processes(workers or cores())
