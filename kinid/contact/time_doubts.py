"""Whether the clock of a log with joints can be in seconds, and its stamps those of when a row was measured."""

from __future__ import annotations

import numpy as np

from kinid.contact.tool_doubts import FEWEST
from kinid.data.guess import unit_of_steps
from kinid.data.log import Log
from kinid.robotics.motion import STATIC_PERIOD

#: time between samples [s]: no robot logs faster than the first, and a touch is not logged slower than the second
FASTEST, SLOWEST = 5e-5, 0.2
#: a pause of more than this [s], and of more than all the rest, lies between two recordings
PAUSE = 60.0
#: poses that an arm stood still at are further apart in time than this [s]
SETTLED = 1.0
#: a motion goes on from sample to sample where its steps change by no more than this share, of those that are more
#: than the second share of the largest
SMOOTH, MOVES = 0.1, 0.1
#: rows come in bursts where this share of the steps are so many times the usual one, and the joints go no further in
#: these than in others, within a factor
PAUSES, LONG, AS_FAR = 0.05, 4.0, 2.0


def time_doubts(log: Log, touched: bool) -> list[str]:
    """At most one sentence.

    Args:
        log: with joints. touched: whether it holds a touch.
    """
    if len(log) <= FEWEST:
        return []
    say = "Say so in [columns] of the rig: t = { unit = "
    if log.period < FASTEST:
        return [f'{log.period:.3g} s between samples: is the time in another unit? {say}"s" }}, or "ms", …']
    if log.period > SLOWEST and touched:
        unit = unit_of_steps(log.period) or "ms"
        return [f'{log.period:.3g} s between samples of a touch: is the time in another unit? {say}"{unit}" }}']
    if said := _bursts(log) or _pause(log):
        return [said]
    if log.dq is None and STATIC_PERIOD <= log.period < SETTLED and _goes_on(log):
        return [
            f"{log.period:.3g} s between samples, which is taken for poses at rest, and the joints go on from one to "
            f'the next: is the time in another unit? {say}"s" }}; or log the joints\' velocities'
        ]
    return []


def _pause(log: Log) -> str:
    """A pause that is longer than all that was recorded, in words; "" without one."""
    steps = np.diff(log.t)
    row = int(np.argmax(steps))
    pause, rest = float(steps[row]), float(log.t[-1] - log.t[0] - steps[row])
    if pause <= max(PAUSE, rest):
        return ""
    return (
        f"nothing was recorded for {pause:.4g} s from {log.t[row]:.4g} s on, and {rest:.4g} s in all beside that: two "
        "recordings, or a clock that was set; pass the rows before and behind it as two logs"
    )


def _bursts(log: Log) -> str:
    """Many steps of time that are far longer than the usual one, where the joints' are not, in words; "" without."""
    assert log.q is not None
    pause = np.diff(log.t) > LONG * log.period
    gone = np.nansum(np.abs(np.diff(log.q, axis=0)), axis=1)
    if not (np.mean(pause) > PAUSES and 0.0 < np.mean(gone[pause]) < AS_FAR * np.mean(gone[~pause])):
        return ""
    rate = (len(log) - 1) / (log.t[-1] - log.t[0])
    return (
        f"rows come in bursts, {1e3 * log.period:.3g} ms apart and then a pause, in which the joints go no further: "
        "the stamps are of when rows arrived; state the sampler's rate in [columns] of the rig: "
        f"t = {{ rate = {rate:.4g} }}"
    )


def _goes_on(log: Log) -> bool:
    """Whether the joint that moves most does so smoothly from sample to sample."""
    assert log.q is not None
    q = log.q[log.valid]
    one = q[:, int(np.argmax(np.ptp(q, axis=0)))] if len(q) > FEWEST else np.zeros(FEWEST)
    step, change = np.abs(np.diff(one))[1:], np.abs(np.diff(one, 2))
    moves = step > MOVES * step.max()
    return int(moves.sum()) >= FEWEST and bool(np.median(change[moves] / step[moves]) < SMOOTH)
