"""How packets cross a line: delayed, jittered, lost; and how a receiver makes waves of what arrives.

A sender counts packets, one a control period. Where a receiver wants the newest reading it takes that of the greatest
count that has arrived. Waves are wanted all, in order, once: a packet carries the wave's integral and energy up to now,
so that a later one stands for those that were lost, and a buffer holds packets back until the slowest would have come
(G. Niemeyer, J.-J. E. Slotine, Towards force-reflecting teleoperation over the Internet, ICRA 1998).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers._given import is_number
from kinid.errors import InputError

Counts = NDArray[np.int64]
#: count of a packet that there isn't
NONE = -1
#: share of the bursts of lost packets that outlast a buffer
OUTLAST = 1e-3


class Schedule(NamedTuple):
    """What a receiver has at each of its periods, counts of packets, (n,).

    newest: the greatest that has arrived, `NONE` before the first. due: the smallest at or after that which the buffer
    plays out now that has arrived, `NONE` without any. buffer: periods after which a packet is played out.
    """

    newest: Counts
    due: Counts
    buffer: int


@dataclass(frozen=True)
class Network:
    """What a line does to packets beside its delay.

    Args:
        jitter: greatest delay beyond the line's [s]; each packet's is uniform from 0. loss: share of packets that never
            arrive. burst: how many are lost in a row on average (E. N. Gilbert, Bell System Technical J. 39, 1960).
        seed: of both.

    Raises:
        InputError: a jitter that is negative, a loss that isn't below 1/2, a burst below 1, or a negative seed.
    """

    jitter: float = 0.0
    loss: float = 0.0
    burst: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (("jitter", 0.0, 10.0), ("loss", 0.0, 0.5), ("burst", 1.0, 1e6)):
            value = getattr(self, name)
            if not (is_number(value) and low <= value <= high):
                raise InputError(
                    f"{name} {value!r}", f"a number from {low:g} to {high:g}", "see the docstring of Network"
                )
        if not (isinstance(self.seed, int) and self.seed >= 0):
            raise InputError(f"seed {self.seed!r}", "a whole number, 0 or more", "choose another")

    def schedule(self, n: int, delay: float, period: float, way: int) -> Schedule:
        """What a receiver has at each of n periods [s] behind a delay [s].

        Args:
            way: 0 forth, 1 back: a mean over a period, which is known at its end, so that it is never there at once.
        """
        rng = np.random.default_rng([self.seed, way])
        late = np.floor(rng.uniform(0.0, self.jitter / period + 1e-9, n)).astype(np.int64)
        after = max(way, round(delay / period))
        arrival = np.arange(n) + after + late
        arrival[self._lost(rng, n)] = n
        return Schedule(*_received(arrival, after, after + self.wait(period)))

    def wait(self, period: float) -> int:
        """Periods [s] that a buffer holds a packet back: for the slowest, and for all but `OUTLAST` of the bursts."""
        ends = 1.0 - 1.0 / self.burst
        burst = math.ceil(math.log(OUTLAST) / math.log(ends)) if ends > 0.0 else 1
        return round(self.jitter / period) + (burst if self.loss > 0.0 else 0)

    def _lost(self, rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
        """Which packets are lost, by Gilbert's chain of two states."""
        begins = self.loss / (self.burst * (1.0 - self.loss))
        return np.asarray(_chain(rng.random(n), begins, 1.0 / self.burst))


@njit(cache=True)
def _chain(chance: NDArray[np.float64], begins: float, ends: float) -> NDArray[np.bool_]:
    out, losing = np.zeros(len(chance), np.bool_), False
    for i in range(len(chance)):
        losing = chance[i] >= ends if losing else chance[i] < begins
        out[i] = losing
    return out


@njit(cache=True)
def _received(arrival: Counts, after: int, buffer: int) -> tuple[Counts, Counts, int]:
    n = len(arrival)
    newest, due, best = np.full(n, -1), np.full(n, -1), np.full(n + 1, -1)
    for k in range(n):
        if arrival[k] < n:
            best[arrival[k]] = max(best[arrival[k]], k)
    last = -1
    for i in range(n):
        last = max(last, best[i])
        newest[i] = last
        for k in range(max(0, i - buffer), i - after + 1):
            if arrival[k] <= i:
                due[i] = k
                break
    return newest, due, buffer
