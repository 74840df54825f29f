"""Samples as lines of JSON in UDP datagrams: `udp://127.0.0.1:5005`.

A line is one object with the names of the log format:

    {"n": 0, "t": 12.345, "q": [...], "dq": [...], "tau": [...], "names": [...], "wrench": [fx, fy, fz, tx, ty, tz]}

`t` is the sender's clock [s]; `t_ns` a whole number of nanoseconds instead, for clocks that count from 1970; neither
where the time of reception is to be used. `n` counts a sender's lines, by which each that is lost is known; where it
begins anew, the sender did. `q` or `wrench` or both; all else may be left out. A datagram may hold several lines. It
listens on this machine alone unless the address says otherwise, and never answers.
"""

from __future__ import annotations

import json
import operator
import select
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from kinid.errors import InputError
from kinid.live.messages import Item, Joints, Notice, Source, Wrench
from kinid.live.sources import IDLE, Asked
from kinid.writers import Json

SCHEME = "udp"
HELP = "udp://127.0.0.1:5005 takes lines of JSON"

#: room for datagrams that wait while something else is done [bytes]; and of one datagram
BUFFER, LARGEST = 4 << 20, 65536
#: senders whose running numbers are kept; how far lines may overtake each other
MOST_SENDERS, ORDERED = 64, 100


def open_source(address: str, asked: Asked) -> Source:
    """Listen at HOST:PORT.

    Raises:
        InputError: no such address, or one that is taken.
    """
    return Socket(address)


class Socket:
    """A UDP socket.

    Args:
        address: HOST:PORT; port 0 takes a free one.
    """

    live = True

    def __init__(self, address: str) -> None:
        host, colon, port = address.rpartition(":")
        host = host.strip("[]") or "127.0.0.1"
        if not colon or not port.isdigit() or int(port) > 65535:
            raise InputError(f"address '{address}'", "HOST:PORT", "name it as udp://127.0.0.1:5005")
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self._socket.bind((host, int(port)))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"no way to listen at {address} ({error.strerror})", "a free port of this machine", "choose another"
            ) from None
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self.name = f"udp://{host}:{self.port}"
        self._open = True
        self._numbers: dict[tuple[object, ...], int] = {}

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        while self._open:
            try:
                data, sender = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                if not select.select([self._socket], [], [], IDLE)[0]:
                    yield None
                continue
            except OSError:  # closed
                return
            received = time.monotonic_ns()
            if not data.strip():
                yield Notice(received, "malformed", "an empty datagram")
            for line in data.splitlines():
                yield from parse(line, received, partial(self._follow, sender, received))

    def _follow(self, sender: tuple[object, ...], received: int, number: int) -> Iterator[Notice]:
        """What a sender's running number says: of lines that never came, of a sender that began anew."""
        last = self._numbers.pop(sender, number - 1)
        if number > last + 1:
            lost = number - last - 1
            yield Notice(received, "gap", f"{lost} lines of {sender[0]}:{sender[1]} never came", lost)
        elif number < last - ORDERED:
            yield Notice(received, "source-restarted", f"{sender[0]}:{sender[1]} counts from {number} after {last}")
            last = number
        self._numbers[sender] = max(number, last)
        if len(self._numbers) > MOST_SENDERS:  # whoever sends, memory stays as it is; the one heard longest ago goes
            del self._numbers[next(iter(self._numbers))]

    def close(self) -> None:
        """See `Source`."""
        self._open = False
        self._socket.close()


def parse(line: bytes, received: int, follow: Callable[[int], Iterable[Notice]] = lambda number: ()) -> Iterator[Item]:
    """Samples of one line; a notice of what isn't one. `follow` gives what its running number says."""
    try:
        sample: Json = json.loads(line)
        out: list[Item] = [] if sample.get("n") is None else [*follow(operator.index(sample["n"]))]
        stamp = int(sample["t_ns"]) if "t_ns" in sample else round(1e9 * sample["t"]) if "t" in sample else None
        wrench, q = sample.get("wrench"), sample.get("q")
        if q is None and wrench is None:
            raise ValueError("neither q nor wrench")
        if q is not None:
            names = sample.get("names")
            known = None if names is None else tuple(map(str, names))
            out.append(
                Joints(received, stamp, _numbers(q), _numbers(sample.get("dq")), _numbers(sample.get("tau")), known)
            )
        if wrench is not None:
            out.append(Wrench(received, stamp, _numbers(wrench)))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        yield Notice(received, "malformed", f"{line[:60]!r} ({error})")
        return
    yield from out


def _numbers(values: Iterable[float | None] | None) -> list[float]:
    """A list of numbers, as sent; null is no number, and so not finite.

    Raises:
        TypeError: something else is in it.
    """
    out = []
    for value in values or ():
        if isinstance(value, bool | str):
            raise TypeError(f"{value!r} is no number")
        out.append(float("nan") if value is None else float(value))
    return out
