"""When a tool touches: from the normal force with hysteresis, else from the depth."""

from __future__ import annotations

import numpy as np

from kinid.data.log import Array, Log, Mask, Step
from kinid.data.rig import Rig
from kinid.kernels import chain as kernel
from kinid.kernels.hysteresis import contact_flag, steady_flag
from kinid.robotics.motion import STATIC_PERIOD
from kinid.robotics.wrench import FEWEST_FREE
from kinid.signal.noise import ROBUST, white_noise

#: contact is not sought further outside the material than this [m]: a force there is not the surface's
REACH = 5e-3
#: contact is where the force is above OFF times its noise and, somewhere on the way, above ON times
ON, OFF = 6.0, 3.0
#: the force is averaged over so many samples on each side, so that noise alone never crosses from ON to OFF
SETTLE = 4
#: a touch that is interrupted for less is one touch [s]
JOINED = 0.1
#: a shorter touch is a knock [s]
SHORTEST = 0.2


def touching(table: Array, log: Log, rig: Rig, forces: bool, valid: Mask) -> tuple[Mask, Step]:
    """The contact flag of a contact table, (n,), from the normal force where there is one, and how it was found."""
    flag = np.zeros(len(log), dtype=np.bool_)
    depth = table[kernel.DEPTH]
    if not forces:
        contact_flag(depth, depth, 0.0, 0.0, REACH, flag)
        return flag, Step("contact flag", {"from": "depth", "on_m": 0.0})
    normal = table[kernel.NORMAL]
    poses = log.q is not None and log.dq is None and log.period >= STATIC_PERIOD  # neighbours have nothing in common
    noise = 1e-9 if poses else force_noise(normal[valid])
    with np.errstate(invalid="ignore"):
        quiet = normal[valid & (depth < -REACH)]
    if len(quiet) >= FEWEST_FREE:  # out of reach, a tool that is not quite known leaves more than white noise
        noise = max(noise, ROBUST * float(np.median(np.abs(quiet))))
    if rig.sensor.noise is not None:
        noise = max(noise, float(max(rig.sensor.noise[:3])))
    steady_flag(normal, depth, ON * noise, OFF * noise, REACH, 0 if poses else SETTLE, flag)
    facts = {"from": "normal force", "on_n": ON * noise, "off_n": OFF * noise, "within_m": REACH}
    return flag, Step("contact flag", facts)


def force_noise(signal: Array) -> float:
    """Standard deviation of white noise on a slow force (n,) [N]; at least 1 nN."""
    return max(1e-9, white_noise(signal))


def touches(t: Array, flag: Mask, valid: Mask) -> list[tuple[int, int]]:
    """Rows [begin, end) of each touch: short gaps are bridged, and an invalid sample within a touch doesn't end it.

    Args:
        t: [s], (n,). flag: whether the tool touches, (n,). valid: (n,).
    """
    rows = np.flatnonzero(valid)
    edges = np.diff(flag[rows].astype(np.int8), prepend=0, append=0)
    spans: list[tuple[int, int]] = []
    for a, b in zip(rows[np.flatnonzero(edges == 1)].tolist(), rows[np.flatnonzero(edges == -1) - 1].tolist()):
        joined = spans and t[a] - t[spans[-1][1] - 1] < JOINED
        spans[-1:] = [(spans[-1][0], b + 1)] if joined else [*spans[-1:], (a, b + 1)]
    return spans
