"""A wrench that comes late or early: free motion, in which a turning tool's weight is known, tells by how much."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: times by which a wrench may be late or early: up to this, in so many steps to either side [s]
LATEST, STEPS = 0.25, 50
#: no less than this is doubted [s], and only where so small a share of the squares is left
LEAST, LEFT = 0.012, 0.3
#: samples that are looked at, at least and at most
FEWEST, MOST = 100, 20_000


def late_wrench(log: Log, clear: Mask, rows: NDArray[np.int64], pull: Array) -> tuple[str, float] | None:
    """A time that explains the force in free motion far better, in words, and the mean square that it leaves [N²].

    Args:
        log: with a wrench in the sensor's axes. clear: samples of free motion, (n,). rows: some of them, (m,).
        pull: load of 1 kg of the tool at these, (m, 3).
    """
    t, force = np.asarray(log.t), np.asarray(log.wrench)[:, :3]
    # what is free for so long before and after is free at every time that is tried
    ends = np.r_[t[0], t[~clear], t[-1]]
    after = np.clip(np.searchsorted(ends, t[rows]), 1, len(ends) - 1)
    inside = (t[rows] - ends[after - 1] > LATEST) & (ends[after] - t[rows] > LATEST)
    if inside.sum() < FEWEST:
        return None
    some = np.flatnonzero(inside)[:: 1 + inside.sum() // MOST]
    at, turning = t[rows[some]], pull[some] - pull[some].mean(axis=0)
    size = float(np.sum(turning**2))
    if not size > 0.0:
        return None

    def left(shift: float) -> Array:
        read = np.stack([np.interp(at + shift, t, channel) for channel in force.T], axis=1)
        read -= read.mean(axis=0)
        mass = max(float(np.sum(read * turning)) / size, 0.0)
        return np.asarray(np.sum((read - mass * turning) ** 2, axis=1))

    shifts = np.linspace(-LATEST, LATEST, 2 * STEPS + 1)
    squares = np.stack([left(shift) for shift in shifts])
    found = squares.mean(axis=1)
    best = int(np.argmin(found))
    if not 0 < best < len(found) - 1 or abs(shifts[best]) < LEAST or found[best] > LEFT * found[STEPS]:
        return None
    if np.median(squares[best]) > LEFT * np.median(squares[STEPS]):  # a few spikes that another time misses
        return None
    word = "after" if shifts[best] > 0.0 else "before"
    return (
        f"the wrench comes {1e3 * abs(shifts[best]):.0f} ms {word} the joints: moved by that, it is the tool's weight "
        f"in free motion {found[STEPS] / max(found[best], 1e-300):.3g} times better; mend the stamps, or add "
        "time-offset to the model",
        float(found[best]),
    )
