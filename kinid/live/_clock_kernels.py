"""Compiled: a stream's clock, and wrench samples brought together with the joints around them.

Times are whole nanoseconds: stamps since 1970 have no room for them in a float64.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64, njit

from kinid.kernels.kernel import kernel
from kinid.kernels.types import Compiled

#: places of a clock (int64): the last stamp that was accepted, when it came; the smallest delay between stamp and
#: reception; what is added to stamps; usual step; steps seen; samples behind the last one, in a row, and the last of
#: them; whether samples are delayed; what is said of the last sample: a step of time; mean of the steps; how many
#: samples before the next one never came, at most; then a ring of steps
LAST, RECEIVED, LAG, SHIFT, PERIOD, COUNT, BEHIND, BEHIND_LAST, DELAYED, STEP, MEAN, MISSING, RING = range(13)
#: steps that the median is of; share by which the mean follows, and how many times itself a step counts for at most
STEPS, SLOW, OUTLIER = 15, 64, 8
#: places of a clock
PLACES = RING + 2 * STEPS

#: what became of a sample: accepted; accepted behind a gap, behind a jump of its clock, or late but in order; left out
#: because it is late, there already, or no number that a sensor gives
FINE, GAP, JUMP, DELAY, LATE, REPEATED, NOT_FINITE = range(7)

#: longer than so many median steps is a gap, as for logs
GAP_PERIODS = 3.5
#: a clock has jumped where stamps and reception come apart by more [ns]; so many samples in a row, with growing stamps,
#: tell a jump back from late samples
JUMP_NS, BACK_NS, BACK = 250_000_000, 100_000_000, 3
#: what is missing takes so many of its usual steps at most: a stall, behind which stamps go on where reception doesn't
HOLE = 1.1
#: samples are delayed that come so much later than the quickest [ns], until they are within the second
DELAY_NS, PROMPT_NS = 50_000_000, 20_000_000
#: the smallest delay may rise so slowly: clocks that run apart by 200 ppm are none that jump
DRIFT = 5000

#: no joint and no sensor gives a number beyond it [rad, rad/s, N, N·m]
FAR = 1e6

#: samples of joints that are kept; wrench samples that can wait for them
JOINT_SLOTS, WRENCH_SLOTS = 64, 256
#: two times are the same when they differ by less than this part of a step, as for logs
SAME = 1e-6
#: places of the pairing's state, behind both clocks: joint samples written, wrench samples written, and read; what
#: became of the last pair that was asked for, until it is handed out: its time, minus `UNPAIRED`, or 0
JOINTS, WRITTEN, READ, READY = range(2 * PLACES, 2 * PLACES + 4)
#: both streams' stamps, behind that
STAMPS = READY + 1
#: how many whole numbers that is
WHOLE = STAMPS + JOINT_SLOTS + WRENCH_SLOTS
#: what came of asking for a pair, where none came
WAITING, UNPAIRED = 1, 2


@kernel
def admit(clock: Compiled, stamp: int, received: int) -> int:
    """What becomes of a sample by its time; where it is accepted, `clock[LAST]` is its stamp on the continuous clock.

    Args:
        clock: (PLACES,) int64. stamp: as sent [ns]. received: [ns].
    """
    now = stamp + clock[SHIFT]
    if clock[COUNT] < 0:  # the first one
        clock[LAST], clock[RECEIVED], clock[LAG], clock[COUNT] = now, received, received - now, 0
        clock[STEP] = 0
        return FINE
    waited, lag = received - clock[RECEIVED], received - now
    code = FINE
    if now <= clock[LAST]:
        if now == clock[LAST]:
            return REPEATED
        if clock[LAST] - now > BACK_NS:
            growing = clock[BEHIND] > 0 and now > clock[BEHIND_LAST]
            clock[BEHIND] = clock[BEHIND] + 1 if growing else 1
            clock[BEHIND_LAST] = now
            if clock[BEHIND] >= BACK:
                code = JUMP
        if code != JUMP:
            return LATE
    elif lag < clock[LAG] - JUMP_NS and now - clock[LAST] > (clock[MISSING] + 1) * HOLE * clock[PERIOD]:
        code = JUMP
    if code == JUMP:
        # time goes on by what passed for the receiver
        step = max(waited, clock[PERIOD], 1)
        clock[STEP] = now - clock[LAST]
        clock[SHIFT] += clock[LAST] + step - now
        now = clock[LAST] + step
        lag = received - now
        clock[LAG] = lag
    else:
        step = now - clock[LAST]
        clock[STEP] = step
        clock[LAG] = min(lag, clock[LAG] + max(waited, 0) // DRIFT)
        if clock[PERIOD] > 0 and step > GAP_PERIODS * clock[PERIOD]:
            code = GAP
        elif lag > clock[LAG] + DELAY_NS and clock[DELAYED] == 0:
            clock[DELAYED], code = 1, DELAY
            clock[STEP] = lag - clock[LAG]
        _remember(clock, step)
    if lag < clock[LAG] + PROMPT_NS:
        clock[DELAYED] = 0
    clock[LAST], clock[RECEIVED], clock[BEHIND], clock[MISSING] = now, received, 0, 0
    return code


@kernel
def _remember(clock: Compiled, step: int) -> None:
    """One more step of time: the median of the last ones is the period, or their mean where that is longer."""
    at = clock[COUNT] % STEPS
    clock[RING + at] = step
    clock[COUNT] += 1
    n = min(clock[COUNT], STEPS)
    ordered = clock[RING + STEPS :]
    for i in range(n):
        value, j = clock[RING + i], i
        while j > 0 and ordered[j - 1] > value:
            ordered[j] = ordered[j - 1]
            j -= 1
        ordered[j] = value
    # a sender that catches up in bursts has a small median, and a mean as ever
    clock[MEAN] = step if n == 1 else clock[MEAN] + (min(step, OUTLIER * clock[MEAN] + 1) - clock[MEAN]) // SLOW
    clock[PERIOD] = max(ordered[n // 2], clock[MEAN])


@kernel
def _take_pair(whole: Compiled, real: Compiled, width: int, longest: int, offset: int) -> int:
    """The oldest wrench that waits, with joints between their neighbours in time; arguments as `put`.

    Returns:
        Time of the wrench, with the offset [ns]; 0 where none waits or its joints haven't come; minus `UNPAIRED` where
        they never will.
    """
    if whole[WRITTEN] - whole[READ] > WRENCH_SLOTS:
        whole[READ] = whole[WRITTEN] - WRENCH_SLOTS
        return -UNPAIRED
    if whole[READ] >= whole[WRITTEN] or whole[JOINTS] == 0:
        return 0
    joint_stamps, wrench_stamps = whole[STAMPS : STAMPS + JOINT_SLOTS], whole[STAMPS + JOINT_SLOTS :]
    slot = whole[READ] % WRENCH_SLOTS
    at: int = wrench_stamps[slot] + offset
    newest = whole[JOINTS] - 1
    if joint_stamps[newest % JOINT_SLOTS] < at:
        return 0
    oldest = max(0, whole[JOINTS] - JOINT_SLOTS)
    right = newest
    while right > oldest and joint_stamps[(right - 1) % JOINT_SLOTS] >= at:
        right -= 1
    whole[READ] += 1
    out = real[len(real) - 2 * (width + 6) :]
    b = width * (right % JOINT_SLOTS)
    if joint_stamps[right % JOINT_SLOTS] == at:
        out[:width] = real[b : b + width]
    elif right == oldest:
        return -UNPAIRED
    else:
        a = width * ((right - 1) % JOINT_SLOTS)
        before = joint_stamps[(right - 1) % JOINT_SLOTS]
        span = joint_stamps[right % JOINT_SLOTS] - before
        share = (at - before) / span
        near = np.round(share)
        if abs(share - near) < SAME:
            share = near
        elif span > (longest if longest > 0 else GAP_PERIODS * whole[PERIOD]):
            return -UNPAIRED
        for i in range(width):
            out[i] = real[a + i] + share * (real[b + i] - real[a + i])
    w = JOINT_SLOTS * width + 6 * slot
    out[width : width + 6] = real[w : w + 6]
    return at


# both are compiled when this is imported: no sample waits for it
@njit((int64[::1], float64[::1], int64, int64, int64), cache=True, error_model="numpy")
def take_pair(whole: Compiled, real: Compiled, width: int, longest: int, offset: int) -> int:
    """`_take_pair` as Python calls it."""
    time: int = _take_pair(whole, real, width, longest, offset)
    return time


@njit(
    (int64[::1], float64[::1], int64, int64, int64, int64, int64, int64, int64),
    cache=True,
    error_model="numpy",
)
def put(
    whole: Compiled,
    real: Compiled,
    width: int,
    longest: int,
    offset: int,
    stream: int,
    stamp: int,
    received: int,
    n: int,
) -> int:
    """Ask the clock for a sample, keep it where it is accepted, and look for a pair where none is ready.

    All that is known is two arrays, because what a call of compiled code costs is its arguments.

    Args:
        whole: (WHOLE,) int64: the clocks of joints and wrench, the pairing's state, and the stamps of both rings.
        real: rows of the joints' ring, (JOINT_SLOTS, width), and the wrench's, (WRENCH_SLOTS, 6); the last pair,
            (width + 6); the sample itself: joints (width) and wrench (6).
        width: numbers of a joint sample. longest: between two joint samples that may be bridged [ns]; 0: so many median
            steps as for logs. offset: added to the wrench's stamps [ns].
        stream: 0: joints, 1: wrench. n: so many numbers of the sample have to be below `FAR`.

    Returns:
        The stamp on the continuous clock; for anything but `FINE` minus the code, with the stamp in the clock's `LAST`.
    """
    clock = whole[stream * PLACES : (stream + 1) * PLACES]
    first = len(real) - 6 if stream == 1 else len(real) - 6 - width
    for i in range(n):
        if not abs(real[first + i]) < FAR:
            return -NOT_FINITE
    code = admit(clock, stamp, received)
    if code < LATE:
        count = JOINTS + stream
        ring, slots, size = (JOINT_SLOTS, WRENCH_SLOTS, 6) if stream == 1 else (0, JOINT_SLOTS, width)
        at = whole[count] % slots
        whole[STAMPS + ring + at] = clock[LAST]
        to = ring * width + size * at
        real[to : to + size] = real[first : first + size]
        whole[count] += 1
        if whole[READY] == 0:
            whole[READY] = _take_pair(whole, real, width, longest, offset)
    stamped: int = clock[LAST]
    return stamped if code == FINE else -code
