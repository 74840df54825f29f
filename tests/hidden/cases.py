"""Cases with hidden effects, one after another: deterministic in kind, seed and world."""

from __future__ import annotations

from collections.abc import Iterator

from hidden import drive_cases, limited, making, tester_cases, wrist_cases
from hidden.case import Case

__all__ = ["KINDS", "WORLDS", "Case", "case", "cases"]

KINDS = ("single", "pair", "none", "outside", "not-excited")
WORLDS = ("force-depth", "wrench", "joints")


def cases(kind: str, count: int, seed: int, world: str | None = None) -> Iterator[Case]:
    """So many cases of a kind, from one world or from all in turn.

    Args:
        kind: one of `KINDS`. count: how many. seed: another one, other cases. world: one of `WORLDS`, or all.
    """
    names = WORLDS if world is None else (world,)
    for number in range(count):
        yield case(kind, number // len(names), seed, names[number % len(names)])


def case(kind: str, number: int, seed: int, world: str) -> Case:
    """The case of this number alone, the same as in the run of `cases` in that world."""
    if kind not in KINDS or world not in WORLDS:
        raise ValueError(f"'{kind}' cases of '{world}'; kinds are {', '.join(KINDS)}, worlds {', '.join(WORLDS)}")
    if kind == "not-excited":
        return limited.make(world, number, seed)
    if world == "joints":
        return drive_cases.make(kind, number, seed)
    place = {"force-depth": tester_cases.PLACE, "wrench": wrist_cases.PLACE}[world]
    if kind in ("single", "pair"):
        return making.hidden(place, 1 + (kind == "pair"), number, seed)
    return {"none": making.nothing, "outside": making.outside}[kind](place, number, seed)
