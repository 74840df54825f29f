"""A session on a terminal: rates, times, estimates and the last events; plain lines where the output is piped."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from kinid.live.events import OF_STREAMS

if TYPE_CHECKING:
    from kinid.live.events import Event
    from kinid.live.session import Session

#: pictures a second; events, and what streams have to say, that are shown; time of a kind of the latter per line [s]
REFRESH, SHOWN, NOTICED, EACH = 2.0, 8, 4, 1.0


class Digest:
    """Events as lines of text: each of what was touched and estimated, and of faulty streams one a second and kind.

    Args:
        clock: time [s] by which seconds pass.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._told = clock, dict[str, float]()
        self._left: dict[str, tuple[int, Event]] = {}

    def __call__(self, event: Event) -> list[str]:
        """Lines to show now that an event has come; the last is its own, but where it is summed."""
        now, kind = self._clock(), event.kind
        if kind in OF_STREAMS and (kind in self._left or now - self._told.get(kind, -math.inf) < EACH):
            count, _ = self._left.get(kind, (0, event))
            self._left[kind] = count + 1, event
            return self.sums()
        self._told[kind] = now
        return [*self.sums(), str(event)]

    def sums(self, least: float = EACH) -> list[str]:
        """Lines of the kinds that have been summed for so long [s]."""
        now, lines = self._clock(), []
        for kind in [kind for kind in self._left if now - self._told[kind] >= least]:
            count, last = self._left.pop(kind)
            more = f"{last.t:9.3f} s  {kind}: {count} more in {now - self._told[kind]:.1f} s, the last: {last.says}"
            lines.append(str(last) if count == 1 else more)
            self._told[kind] = now
        return lines


class Lines:
    """Events as lines on a console, as `Digest` has them. Args: console."""

    def __init__(self, console: Console) -> None:
        self._console, self._digest = console, Digest()

    def __call__(self, event: Event) -> None:
        """Print an event."""
        self._print(self._digest(event))

    def close(self) -> None:
        """Print what is summed and not shown yet."""
        self._print(self._digest.sums(0.0))

    def _print(self, lines: Sequence[str]) -> None:
        for line in lines:
            self._console.print(line, soft_wrap=True)


class Screen:
    """What a session is at, drawn now and then. Args: session. console."""

    def __init__(self, session: Session, console: Console) -> None:
        self._session, self._digest = session, Digest()
        self._events, self._notices = deque[str](maxlen=SHOWN), deque[str](maxlen=NOTICED)
        self.live = Live(get_renderable=self.draw, console=console, refresh_per_second=REFRESH, transient=True)

    def __call__(self, event: Event) -> None:
        """Take an event, which the next picture shows: those of streams have lines of their own."""
        lines = self._digest(event)
        if event.kind not in OF_STREAMS:
            self._events.append(lines.pop())
        self._notices.extend(lines)

    def draw(self) -> Group:
        """The picture as of now."""
        session = self._session
        facts = session.summary()
        rates = ", ".join(f"{name} {rate:.0f} Hz" for name, rate in facts["rates_hz"].items() if rate)
        head = f"{facts['source']}   {facts['duration_s']:.1f} s   {facts['samples']} samples   {rates}"
        depth, force = float(session.pipeline.quantities[0]), float(session.pipeline.quantities[6])
        state = "touching" if session.pipeline.touching else "in the air"
        now = f"{state}: depth {1e3 * depth:.2f} mm, normal force {force:.2f} N"
        events = Text("\n".join((*self._events.copy(), *self._notices.copy())))
        doubts = Text("\n".join(f"doubt: {doubt}" for doubt in facts["doubts"]))
        times = [
            f"{name} {facts[key]['median']:.0f} µs, 99.9 % {facts[key]['p99.9']:.0f}"
            for name, key in (("processing", "processing_us"), ("from reception to estimate", "latency_us"))
            if facts[key] and facts["samples"]
        ]
        return Group(
            Text(head),
            Text("   ".join(times)),
            Text(now if math.isfinite(depth) else state),
            estimates(session),
            doubts,
            events,
        )


def estimates(session: Session) -> Table:
    """Values with the half width of their 95 % intervals, and what to think of them."""
    table = Table("parameter", box=None, pad_edge=False)
    table.add_column("estimate", justify="right")
    table.add_column("± (95 %)", justify="right")
    table.add_column("unit")
    table.add_column("")
    for estimate in session.pipeline.estimates.values():
        half = estimate.interval[:, 1] - estimate.values
        for name, value, width in zip(estimate.names, estimate.values.tolist(), half.tolist()):
            table.add_row(name, f"{value:.5g}", f"{width:.2g}", session.trust.units[name], estimate.status.remedy)
    return table


def show(session: Session, console: Console) -> None:
    """What a session was, when it is over."""
    facts = session.summary()
    rates = ", ".join(f"{name} at {rate:.4g} Hz" for name, rate in facts["rates_hz"].items() if rate)
    console.print(
        f"{facts['samples']} samples over {facts['duration_s']:.4g} s: {rates or 'nothing came'}", soft_wrap=True
    )
    for name, key in (("processing", "processing_us"), ("from reception to estimate", "latency_us")):
        if facts[key] and facts["samples"]:
            times = ", ".join(f"{k} {v:.1f}" for k, v in facts[key].items())
            console.print(f"{name} [µs]: {times}", soft_wrap=True)
    if facts["events"]:
        console.print("events: " + ", ".join(f"{n} {kind}" for kind, n in facts["events"].items()), soft_wrap=True)
    console.print(estimates(session))
    for doubt in facts["doubts"]:
        console.print(f"doubt: {doubt}", soft_wrap=True)
