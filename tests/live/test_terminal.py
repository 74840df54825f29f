"""What people read of a session: what is touched stands out from what faulty streams bring by the thousand."""

from __future__ import annotations

import io
import itertools

from live.prepared import NAMES, Prepared
from rich.console import Console

from kinid.data.rig import Rig
from kinid.live import Event, Pipeline, Session
from kinid.live.events import KINDS, OF_STREAMS
from kinid.live.messages import Item, Wrench
from kinid.live.terminal import EACH, Digest, Lines, Screen


def test_a_kind_of_notice_has_one_line_a_second_and_all_are_counted() -> None:
    clock, lines = itertools.count(), list[str]()
    digest = Digest(lambda: 1e-3 * next(clock))  # each event asks for the time two or three times
    for k in range(3000):
        lines += digest(Event("gap", 1e-3 * k, f"no. {k}"))
        if k % 1000 == 500:
            lines += digest(Event("touch", 1e-3 * k, "0.2 N"))
    seconds = 1e-3 * next(clock) / EACH
    lines += digest.sums(0.0)
    assert sum("touch: 0.2 N" in line for line in lines) == 3
    assert lines[0].endswith("gap: no. 0")
    sums = [line.split("gap: ")[1].split(" more in ") for line in lines if " more in " in line]
    full = sum("gap: no." in line for line in lines)  # the first, and sums of one
    assert sum(int(count) for count, _ in sums) + full == 3000
    assert 2 <= len(sums) <= seconds + 1
    # sums of one event are that event
    assert [digest(Event("late", 4.0, says)) for says in ("one", "two")][1] == []
    assert digest.sums(0.0) == ["    4.000 s  late: two"]
    assert set(KINDS) > OF_STREAMS


def test_a_touch_is_seen_in_a_flood(rig: Rig, rows: list[Item]) -> None:
    """Wrenches that come twice bring thousands of notices, the touch among them is shown, and all are counted."""
    flooded: list[Item] = []
    for row in rows[:10_000]:
        flooded += [row, row] if isinstance(row, Wrench) else [row]
    text = io.StringIO()
    console = Console(file=text, width=200)
    lines, screens = Lines(console), list[Screen]()

    def tell(event: Event) -> None:
        lines(event)
        screens[0](event)

    session = Session(Prepared(flooded), Pipeline(rig, ("kelvin-voigt",)), NAMES, tell=tell)
    screens.append(Screen(session, console))
    session.run()
    lines.close()
    assert session.counts["repeated"] == 5000
    shown = text.getvalue()
    assert session.counts["touch"] >= 1
    assert shown.count("touch at") == session.counts["touch"]
    assert shown.count("repeated") < 100
    console.print(screens[0].draw())
    assert "touch at" in text.getvalue()[len(shown) :]
