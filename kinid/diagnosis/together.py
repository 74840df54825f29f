"""Parameters that are moved together, because each of them changes another channel.

What each did is read off its channel, so that one prediction does for many (A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst.
Maths. Applics. 13, 1974).
"""

from __future__ import annotations

from collections.abc import Iterable

from kinid.effects import Layout

#: in place of a channel's number: all of them
ALL = -1


def together(names: Iterable[tuple[int, str]], layout: Layout) -> list[dict[int, int]]:
    """Groups of parameters, each as channel → number; one that may change every channel is alone, at `ALL`.

    Of joint torques, a parameter with a joint or a channel in brackets changes that one alone. Contact forces share the motion of
    one tip.

    Args:
        names: numbers and names of parameters. layout: of the log.
    """
    alone: list[dict[int, int]] = []
    groups: list[dict[int, int]] = []
    rows = {f"[{name}]": row for own in (layout.channels, layout.joints) for row, name in enumerate(own)}
    for number, name in names:
        row = rows.get(name[name.find("[") :], ALL) if layout.kind == "joints" and "[" in name else ALL
        if row == ALL:
            alone.append({ALL: number})
            continue
        free = next((group for group in groups if row not in group), None)
        if free is None:
            groups.append({row: number})
        else:
            free[row] = number
    return alone + groups
