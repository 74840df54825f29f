"""Drawing cases: streams of random numbers that depend on names, and sizes at which an effect matters by so much."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence

import numpy as np

#: multiples of the noise that a hidden effect leaves in the residual of the starting model: weak to strong
WEAK, STRONG = 0.2, 12.0


class Stream:
    """Random numbers that belong to a seed, names and numbers: the same in every run and on every machine."""

    def __init__(self, seed: int, *names: str | int) -> None:
        self._entropy = [seed, *(zlib.crc32(n.encode()) if isinstance(n, str) else n for n in names)]

    def generator(self, name: str = "") -> np.random.Generator:
        """A fresh generator of this name; the same numbers each time it is asked for."""
        return np.random.default_rng([*self._entropy, zlib.crc32(name.encode())])

    @property
    def number(self) -> int:
        """One number for it."""
        return int(np.random.SeedSequence(self._entropy).generate_state(1)[0])


def choose(names: Sequence[str], number: int, seed: int, salt: str) -> str:
    """Each of the names once before any comes again, in an order of the seed's."""
    turn, place = divmod(number, len(names))
    return names[int(Stream(seed, salt, turn).generator().permutation(len(names))[place])]


def wanted(rng: np.random.Generator, weak: float = WEAK) -> float:
    """How much an effect is to matter, weak and strong ones alike often."""
    return float(np.exp(rng.uniform(np.log(weak), np.log(STRONG))))


def tuned(matters: Callable[[float], float], start: float, low: float, high: float, aim: float) -> tuple[float, float]:
    """Size between two bounds at which an effect matters as much as is aimed for, and how much it then does.

    How much it matters is about proportional to the size: two steps come near enough.
    """
    size = start
    found = matters(size)
    for _ in range(2):
        if found <= 0 or abs(np.log(found / aim)) < 0.25:
            break
        size = float(np.clip(size * aim / found, low, high))
        found = matters(size)
    return size, found
