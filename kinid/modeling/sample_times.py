"""Times of the samples of an experiment: steps, gaps, and what is forgotten over a gap in contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.robotics.motion import STATIC_PERIOD
from kinid.signal.derivative import Differentiator
from kinid.signal.pieces import GAP_FACTOR

Array = NDArray[np.float64]

#: samples that are missing for less than this lose no memory: a period of the fastest motion that the differentiator
#: passes; slower ones run nearly straight meanwhile [s]
BRIDGED = 1.0 / Differentiator().bandwidth
#: what bristles and a material remember over a gap in contact isn't known: until the tool leaves, or for so long [s],
#: readings don't count, unless that would leave out more than this share of those in contact
FORGETS, LOSSY = (np.inf, 1.0), 0.5

#: length of a block [s]: longer than readings' noise remembers; and the fewest blocks that a log is cut into
BLOCK_LENGTH, MIN_BLOCKS = 0.5, 16


def block_length(span: float) -> float:
    """Length of a block [s] of a log of this length [s], half of which are held out in turn."""
    return BLOCK_LENGTH if span >= MIN_BLOCKS * BLOCK_LENGTH else max(span / MIN_BLOCKS, 1e-9)


def time_steps(t: Array, starts: NDArray[np.bool_]) -> Array:
    """Time since the sample before [s], 0 where memory begins anew, (n,)."""
    dt = np.diff(t, prepend=t[0])
    dt[starts] = 0.0
    return dt


def gaps_in_contact(t: Array, in_contact: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First sample after each gap that ended in contact, of a log that isn't one of poses at rest: how it was reached
    is lost.

    The first of all where the log begins in contact: what was before it is a gap, too.
    """
    step = np.diff(t)
    if not len(step) or np.median(step) >= STATIC_PERIOD:
        return np.zeros(0, np.int64)
    gap = step > max(GAP_FACTOR * float(np.median(step)), BRIDGED)
    return np.flatnonzero(np.r_[True, gap] & in_contact)


def forgotten(t: Array, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Samples after a gap in contact, until the tool leaves or for a while, (n,)."""
    for lasts in FORGETS:
        out = np.zeros(len(t), np.bool_)
        for first in gaps_in_contact(t, in_contact):
            last = np.searchsorted(t, t[first] + lasts)
            gone = np.flatnonzero(~in_contact[first:last])
            out[first : first + gone[0] if len(gone) else last] = True
        if out.sum() <= LOSSY * in_contact.sum():
            return out
    return np.zeros(len(t), np.bool_)


def clock(t: Array, rows: NDArray[np.int64], what: str, where: str) -> tuple[Array, Array]:
    """Times of these rows from the first of them, and steps of time: memory bridges rows left out, but not gaps."""
    if not len(rows):
        raise InputError(f"no sample with {what} in {where}", "finite positions and rates", "check the log's columns")
    period = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    starts = np.concatenate([[True], np.diff(t[rows]) > max(GAP_FACTOR * period, BRIDGED)])
    return t[rows] - t[rows[0]], time_steps(t[rows], starts)
