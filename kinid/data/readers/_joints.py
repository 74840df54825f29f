"""Joints of a bag by name: sources may publish different ones, in any order, with a prefix or without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from kinid.errors import InputError, near

Names = tuple[str, ...]


@dataclass(frozen=True)
class Arrangement:
    """Where each joint of the log comes from.

    Attributes:
        names: of q1..qN, as the bag has them.
        sources: by the names of a source: the place of a joint among them -> its place in the log, both from
            0.
        ignored: joints of the bag that the log doesn't hold.
    """

    names: Names
    sources: Mapping[Names, Mapping[int, int]]
    ignored: Names


def arrange(counts: Mapping[Names, int], wanted: Sequence[str] | None, source: str) -> Arrangement:
    """Find the wanted joints among the sources, in as few sources as possible.

    Args:
        counts: number of messages by the joints that they name.
        wanted: names of q1..qN; None: all joints of the source with the most.
        source: path, for messages.

    Raises:
        InputError: a joint is missing or its name fits several, or nothing says which of several sources is
            the robot.
    """
    everything = tuple(dict.fromkeys(name for names in counts for name in names))
    if wanted is None:
        most = max(len(names) for names in counts)
        largest = [names for names in counts if len(names) == most]
        if len(largest) > 1:
            shown = "; ".join(", ".join(names) for names in largest)
            raise InputError(
                f"several sources of as many joints in {source}: {shown}",
                "one robot",
                "name its joints in their order: [robot] joints = […]",
            )
        wanted = largest[0]
    names = tuple(_match(name, everything, source) for name in wanted)
    if len(set(names)) < len(names):
        double = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"joint '{double}' in {source} for several joints of the robot",
            "one for each",
            "correct [robot] joints of the rig",
        )
    sources: dict[Names, dict[int, int]] = {}
    left = dict(zip(names, range(len(names))))
    while left:
        # the source with most of the joints still wanted; of equal ones that with most messages
        best = max(counts, key=lambda s: (len(left.keys() & set(s)), counts[s]))
        sources[best] = {place: left.pop(name) for place, name in enumerate(best) if name in left}
    return Arrangement(names, sources, tuple(n for n in everything if n not in names))


def _match(name: str, found: Sequence[str], source: str) -> str:
    """The joint of the bag that a name means: the same, else the only one that differs by a prefix."""
    if name in found:
        return name
    close = [other for other in found if _ends(other, name) or _ends(name, other)]
    if len(close) == 1:
        return close[0]
    if close:
        raise InputError(
            f"joints {', '.join(close)} in {source} for '{name}'",
            "one joint of that name",
            "give full names: [robot] joints = […]",
        )
    raise InputError(f"no joint '{name}' in {source}", "every joint of the robot", near(name, found))


def _ends(long: str, short: str) -> bool:
    """Whether `long` is `short` behind a prefix."""
    return long.endswith(short) and len(long) > len(short) and long[-len(short) - 1] in "_/-.:"
