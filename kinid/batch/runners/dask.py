"""A cluster of dask: one of this machine's own, or the scheduler at an address."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any, final

from kinid.batch.runners._runner import TRIES, In, Lost, Out, Runner, cores, died, packed, unpacked
from kinid.errors import InputError

#: tasks on their way for each worker: the scheduler sees no more of a folder than that
WINDOW = 4
#: of another's scheduler no fewer: it may begin workers for what it sees
FEWEST = 256
#: how long a scheduler is waited for [s]
PATIENCE = 20


@final
class Dask(Runner):
    """A client of a scheduler; a task whose worker dies is given to another one by the scheduler itself."""

    def __init__(self, address: str, workers: int | None) -> None:
        import dask
        from distributed import Client, LocalCluster

        # a worker holds what it works at and no queue: who dies takes no neighbours along
        dask.config.set(
            {"distributed.scheduler.allowed-failures": TRIES - 1, "distributed.scheduler.worker-saturation": 1.0}
        )
        self.workers, self._cluster, self.here = workers or cores(), None, not address
        if not address:
            self._cluster = LocalCluster(
                n_workers=self.workers,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
                security=_secret(),
                preload=["kinid.batch.runners._quiet"],
            )
        try:
            self._client = Client(self._cluster or address, timeout=PATIENCE)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"no scheduler at {address} ({str(error)[:120]})", "the address of a running one", "correct --on"
            ) from None
        self.dashboard = self._client.dashboard_link
        if address:
            self._count()

    def _count(self) -> int:
        """Tasks to have on their way, for as many workers as there are now."""
        if self._cluster is not None:
            return WINDOW * self.workers
        self.workers = len(self._client.nthreads())
        return max(FEWEST, WINDOW * self.workers)

    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> Iterator[tuple[int, Out | Lost]]:
        """See `Runner`; the scheduler is given a few tasks at a time, however many there are."""
        suspects: list[int] = []
        for place, result in self._windowed(do, items, range(len(items))):
            if isinstance(result, Lost) and result.why == _DIED.why:
                suspects.append(place)
            else:
                yield place, result
        if len(suspects) == 1:
            yield suspects[0], _DIED
            return
        # each by itself: one that shared a worker with a poisoned one is none
        yield from self._windowed(do, items, suspects, single=True)

    def _windowed(
        self, do: Callable[[In], Out], items: Sequence[In], places: Sequence[int], single: bool = False
    ) -> Iterator[tuple[int, Out | Lost]]:
        from distributed import as_completed

        todo, under_way = iter(places), dict[Any, int]()
        done = as_completed()

        def submit() -> None:
            for place in todo:
                future = self._client.submit(unpacked, packed(do, items[place]), pure=False)
                under_way[future] = place
                done.add(future)
                return

        try:
            window, counted = 1 if single else self._count(), time.monotonic()
            for _ in range(window):
                submit()
            for future in done:
                place = under_way.pop(future)
                yield place, _result(future)
                if not single and time.monotonic() - counted > 1.0:
                    window, counted = self._count(), time.monotonic()
                for _ in range(window - len(under_way)):
                    submit()
        finally:
            self._client.cancel(list(under_way))

    def pids(self) -> list[int]:
        """Of the workers."""
        import os

        return list(self._client.run(os.getpid).values())

    def close(self) -> None:
        """Leave the scheduler, and end what this runner has begun."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


_DIED = died("killed, or out of memory")


def _result(future: Any) -> Any:
    """What became of a task."""
    from distributed import KilledWorker

    error = future.exception()
    if error is None:
        return future.result()
    return _DIED if isinstance(error, KilledWorker) else Lost(f"{type(error).__name__}: {str(error)[:300]}")


def _secret() -> Any:
    """Keys that nobody else on this machine has, where there is a library to make them: who may speak to a scheduler
    may run what he likes.
    """
    from distributed.security import Security

    return Security.temporary() if find_spec("cryptography") is not None else None


def begin(address: str, workers: int | None) -> Dask:
    """The runner, on a cluster of this machine where there is no address."""
    if find_spec("distributed") is None:
        raise InputError("--on dask without dask", "dask and distributed", "pip install 'kinid[batch]'")
    return Dask(address, workers)
