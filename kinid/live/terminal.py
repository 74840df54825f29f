"""A session on a terminal: rates, times, estimates and the last events; plain lines where the output is piped."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from kinid.live.events import Event
    from kinid.live.session import Session

#: pictures a second; lines a second where the output is piped; events that are shown
REFRESH, LINES, SHOWN = 2.0, 20, 8


class Lines:
    """Events as lines, of which a burst is cut short. Args: console."""

    def __init__(self, console: Console) -> None:
        self._console, self._second, self._printed, self._left = console, 0, 0, 0

    def __call__(self, event: Event) -> None:
        """Print an event."""
        second = int(time.monotonic())
        if second != self._second:
            if self._left:
                self._console.print(f"… and {self._left} more events", soft_wrap=True)
            self._second, self._printed, self._left = second, 0, 0
        if self._printed >= LINES:
            self._left += 1
            return
        self._printed += 1
        self._console.print(str(event), soft_wrap=True)


class Screen:
    """What a session is at, drawn now and then. Args: session. console."""

    def __init__(self, session: Session, console: Console) -> None:
        self._session = session
        self.live = Live(get_renderable=self.draw, console=console, refresh_per_second=REFRESH, transient=True)

    def draw(self) -> Group:
        """The picture as of now."""
        session = self._session
        facts = session.summary()
        rates = ", ".join(f"{name} {rate:.0f} Hz" for name, rate in facts["rates_hz"].items() if rate)
        head = f"{facts['source']}   {facts['duration_s']:.1f} s   {facts['samples']} samples   {rates}"
        depth, force = float(session.pipeline.quantities[0]), float(session.pipeline.quantities[6])
        state = "touching" if session.pipeline.touching else "in the air"
        now = f"{state}: depth {1e3 * depth:.2f} mm, normal force {force:.2f} N"
        events = Text("\n".join(str(event) for event in list(session.events)[-SHOWN:]))
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
