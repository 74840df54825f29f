"""What sensors and clocks make of forces: faults on a stream at the fine rate, then samples with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from hidden.world.path import FINE

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """Faults of a sensor of k channels, and its clock; what is 0, or None, is not there.

    Attributes:
        gain: relative error of all channels.
        mix: matrix that the reading is multiplied with, (k, k).
        turned: rotation vector of the sensor in its mount [rad], (3,): true components are those along its own axes.
        bias: (k,). drift: change in the first minute, (k,), of a body that warms up.
        poles: two time constants of an amplifier's filter [s].
        late [s]: how much later than the motion's the readings' clock is.
        hum: amplitude of the mains, (k,), and of the third harmonic.
        limit: range of the converter, (k,). step: of the converter, (k,).
    """

    gain: float = 0.0
    mix: Array | None = None
    turned: Array | None = None
    bias: Array | None = None
    drift: Array | None = None
    poles: tuple[float, float] = (0.0, 0.0)
    late: float = 0.0
    hum: Array | None = None
    limit: Array | None = None
    step: Array | None = None


def read(
    c: Chain, load: Array, at: Array, noise: Array, rng: np.random.Generator, triples: tuple[int, ...] = (0,)
) -> Array:
    """What is logged, (len(at), k).

    Args:
        c: the faults. load: true load at the fine rate, (n, k). at: times of the log [s].
        noise: rms of each channel, (k,). rng: of noise and mains.
        triples: where vectors begin among the channels, which a turned sensor sees turned.
    """
    if c.turned is not None:
        x, y, z = c.turned
        frame = expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))  # columns: the sensor's axes
        load = load.copy()
        for i in triples:
            load[:, i : i + 3] = load[:, i : i + 3] @ frame
    if c.mix is not None:
        load = load @ c.mix.T
    load = (1.0 + c.gain) * load
    for tau in c.poles:
        if tau > 0:
            decay = np.exp(-1.0 / (FINE * tau))
            start = load[:1] * decay
            load = lfilter([1 - decay], [1, -decay], load, axis=0, zi=start)[0]
    # the readings' clock is late: what is stamped t was there at t − late
    out = _between(load, at * FINE - c.late * FINE)
    if c.drift is not None:
        out = out + np.outer(-np.expm1(-at / 240.0) / -np.expm1(-60.0 / 240.0), c.drift)
    if c.bias is not None:
        out = out + c.bias
    out = out + colour(rng, len(at), noise)
    if c.hum is not None:
        out = out + _mains(rng, at)[:, None] * c.hum
    if c.limit is not None:
        out = np.clip(out, -c.limit, c.limit)
    if c.step is not None:
        out = c.step * np.round(out / c.step)
    return out


def _between(x: Array, place: Array) -> Array:
    """Rows of a stream between its rows, by a cubic through four neighbours; its ends go on as they are, (len(place),
    k).
    """
    first = np.floor(place).astype(int)
    u = (place - first)[:, None]
    rows = [x[np.clip(first + k, 0, len(x) - 1)] for k in (-1, 0, 1, 2)]
    weights = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    out: Array = sum(w * row for w, row in zip(weights, rows))
    return out


def colour(rng: np.random.Generator, n: int, rms: Array) -> Array:
    """White noise with a little that stays for 0.1 s, as amplifiers have, (n, k)."""
    k = len(rms)
    stays = np.exp(-1.0 / 50.0)
    slow = lfilter([np.sqrt(1 - stays**2)], [1, -stays], rng.standard_normal((n, k)), axis=0)
    out: Array = (0.98 * rng.standard_normal((n, k)) + 0.2 * slow) * rms
    return out


def _mains(rng: np.random.Generator, t: Array) -> Array:
    """50 Hz and its third harmonic; the grid wanders by some hundredths of a turn."""
    wander = 0.04 * np.sin(2 * np.pi * (0.011 * t + rng.uniform()))
    turn = 2 * np.pi * (50.0 * t + wander + rng.uniform())
    out: Array = np.sin(turn) + 0.3 * np.sin(3 * turn + rng.uniform(0, 6))
    return out
