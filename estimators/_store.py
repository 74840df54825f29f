"""Where a running estimator keeps its numbers: one float64 array, so that a control loop hands compiled code one thing.

Arguments are what a call of compiled code costs: some 20 ns for an array, 100 ns and more for a tuple of them.

    record | state | conditions | inputs | settings | limit | gram | scale | cursor | scratch | head

`record` of p parameters: values (p) | variances (p) | innovation | noise variance | excitation | status | updates |
skipped. Record and state are what an `Estimate` is made of, and so stand first. `head` says how long the parts are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.types import Compiled

Array = NDArray[np.float64]

#: places of a record behind its values and variances, counted from its end
INNOVATION, NOISE, EXCITATION, STATUS, UPDATES, SKIPPED = range(-6, 0)
PLACES = 6

#: places of the head, counted from the end of the store
LENGTH, THRESHOLD, FACTOR, TIME, STATES, CONDITIONS, INPUTS, SETTINGS, BLOCKS = range(-9, 0)

#: places of a considered offset in a state: its variance, what that gains in a second, time between samples [s], time
#: of the last; then the covariances of the estimates' errors with it (p), and those errors' part of it (p·p)
VARIANCE, GAIN, PERIOD, CLOCK, SHARED = range(5)

#: numbers of the tally, with which a state ends
TALLY = 4


def offset_place(p: int) -> int:
    """Where the offset begins in a state of p parameters, which has no such part where it considers none."""
    return 3 * p + p * p


class Store(NamedTuple):
    """Views of the parts, as the kernels take them; `out` is that of one sample."""

    record: Compiled  # (2 p + 6,)
    state: Compiled
    inputs: Compiled  # of one sample
    settings: Compiled
    limit: Compiled  # (p,)
    factor: Compiled  # (1,), of forgetting
    time: Compiled  # (1,) of the sample [s], NaN where none is known
    window: Compiled  # gram (blocks, p, p), scale (p,), cursor (5,)
    length: Compiled  # samples of a block; 0 measures no excitation
    threshold: Compiled
    scratch: Compiled  # (p + 3, p)
    out: Compiled


def build(
    p: int,
    state: Array,
    limit: Array,
    window: tuple[Array, Array, Array],
    length: int,
    threshold: float,
    factor: float,
    inputs: int,
    settings: tuple[float, ...],
    conditions: int,
) -> Array:
    """A store with its parts filled in."""
    blocks = len(window[0])
    head = (length, threshold, factor, math.nan, len(state), conditions, inputs, len(settings), blocks)
    return np.concatenate(
        [
            np.zeros(2 * p + PLACES),
            state,
            np.zeros(conditions + inputs),
            settings,
            limit,
            *map(np.ravel, window),
            np.zeros((p + 3) * p),
            head,
        ]
    )


def carve(shape: Compiled, store: Compiled) -> Store:
    """The parts of a store; `shape` is any tuple of p floats. Python and compiled code both cut with this."""
    p = len(shape)
    blocks, conditions = int(store[BLOCKS]), int(store[CONDITIONS])
    end_record = 2 * p + PLACES
    end_state = end_record + int(store[STATES])
    end_conditions = end_state + conditions
    end_inputs = end_conditions + int(store[INPUTS])
    end_settings = end_inputs + int(store[SETTINGS])
    end_limit = end_settings + p
    end_gram = end_limit + blocks * p * p
    end_scale = end_gram + p
    end_cursor = end_scale + 5
    end_scratch = end_cursor + (p + 3) * p
    factor = len(store) + FACTOR
    record = store[:end_record]
    out = (
        record[:p].reshape(1, p),
        record[p : 2 * p].reshape(1, p),
        record[2 * p : 2 * p + 1],
        record[2 * p + 1 : 2 * p + 2],
        record[2 * p + 2 : 2 * p + 3],
        record[2 * p + 3 : 2 * p + 4],
        store[end_state:end_conditions].reshape(1, conditions),
    )
    window = (
        store[end_limit:end_gram].reshape(blocks, p, p),
        store[end_gram:end_scale],
        store[end_scale:end_cursor],
    )
    return Store(
        record,
        store[end_record:end_state],
        store[end_conditions:end_inputs],
        store[end_inputs:end_settings],
        store[end_settings:end_limit],
        store[factor : factor + 1],
        store[factor + 1 : factor + 2],
        window,
        int(store[LENGTH]),
        store[THRESHOLD],
        store[end_cursor:end_scratch].reshape(p + 3, p),
        out,
    )
