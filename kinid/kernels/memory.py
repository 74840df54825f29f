"""Laws with memory, sample by sample: relaxation, bristles, loops over depth, softening, and bonds that tear.

Steps of time may be uneven. `dt` is the time since the sample before [s], (n,); where it is 0 memory begins anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

#: share of a bristle's length over which it is purely elastic before it slips. Dahl's bristles creep back under any
#: dither, and every measured position at rest dithers by its noise; elastic ones don't (Dupont et al., IEEE Trans.
#: Autom. Control 47, 2002)
ELASTIC = 0.02
#: a step in which slip turns by more than this [rad] is taken in pieces, so many at most: bristles that are short
#: beside it follow the direction at its end, not that of its middle; where it is a small share m of them, they end
#: m²/12 of the turn off
STRAIGHT, MOST_PIECES = 0.002, 8
#: length of the bristles of a joint's dry friction, of one that turns [rad] and one that slides [m]: shorter than what
#: reversals of real drives show
JOINT_BRISTLES = (1e-4, 1e-5)


@kernel
def lowpass(x: Array, dt: Array, tau: float, out: Array) -> None:
    """First-order low-pass τ ẏ = x − y, exact for an input that runs straight between samples; y begins at 0.

    Args:
        x: input, (n,). dt: see above. tau: time constant [s]. out: y, (n,).
    """
    y = 0.0
    for i in range(x.shape[0]):
        if i == 0 or dt[i] <= 0.0:
            y = 0.0
        else:
            h = dt[i] / tau
            gone = -np.expm1(-h)
            # ∫ of the straight line against the kernel; a series where the difference would cancel
            g = 1.0 - gone / h if h > 1e-3 else h * (0.5 - h * (1.0 / 6.0 - h / 24.0))
            y = (1.0 - gone) * y + (gone - g) * x[i - 1] + g * x[i]
        out[i] = y


@kernel
def bristles(
    v1: Array,
    v2: Array,
    dt: Array,
    depth: Array,
    length: float,
    out: Array,
    elastic: float = ELASTIC,
    tremor: float = 0.0,
) -> None:
    """Deflection of bristles relative to their greatest, a vector of length ≤ 1 along the slip (Dahl 1968, in 2-D).

    u̇ = (v − |v| u) / ℓ, exact where the direction of slip is constant between samples (a step in which the slip turns
    back is taken in two, one along a curve in several), behind an element that is elastic over a small share ε of ℓ:
    (1 − ε) u + w/ℓ comes out, where w, |w| ≤ ε ℓ, is how far the slip is ahead of what moves u. Under a constant load
    this never gives energy. Bristles begin undeflected at each touch.

    Args:
        v1, v2: slip rates [m/s], (n,). dt: see above. depth: > 0 in contact, (n,); a flag does, too, but then a touch
            begins at the sample before.
        length: ℓ [m]. out: (2, n). elastic: ε; 0 is Dahl's own. tremor: mean speed of what goes to and fro too fast to
            be seen [m/s]: bristles creep back under it, u̇ = (v − √(v² + v_t²) u) / ℓ.
    """
    u1, u2 = 0.0, 0.0
    w1, w2 = 0.0, 0.0
    follows = (
        elastic * length if elastic > 0.0 else length
    )  # on such a way w takes the direction of the slip, or else u does
    for i in range(v1.shape[0]):
        if i == 0 or dt[i] <= 0.0 or not depth[i] > 0:
            u1, u2, w1, w2 = 0.0, 0.0, 0.0, 0.0
        else:
            step = dt[i] * _touching(1.0 * depth[i - 1], 1.0 * depth[i])
            turn = _turn(v1[i - 1], v2[i - 1], v1[i], v2[i])
            many = 2 if turn < 1.0 else _pieces(v1[i - 1], v2[i - 1], v1[i], v2[i], step / follows)
            begin = 0.0
            for piece in range(1, many + 1):
                end = turn if turn < 1.0 and piece == 1 else piece / many
                middle, part = 0.5 * (begin + end), (end - begin) * step
                w1 += (v1[i - 1] + middle * (v1[i] - v1[i - 1])) * part
                w2 += (v2[i - 1] + middle * (v2[i] - v2[i - 1])) * part
                far = np.sqrt(w1 * w1 + w2 * w2)
                moved = far - elastic * length
                if moved > 0.0:
                    a, b = w1 / far, w2 / far
                    w1, w2 = w1 - moved * a, w2 - moved * b
                    e = np.exp(-moved / length)
                    u1 = e * u1 + (1.0 - e) * a
                    u2 = e * u2 + (1.0 - e) * b
                begin = end
            if tremor > 0.0:
                speed = 0.5 * np.hypot(v1[i - 1] + v1[i], v2[i - 1] + v2[i])
                e = np.exp(-(np.hypot(speed, tremor) - speed) * step / length)
                u1, u2, w1, w2 = e * u1, e * u2, e * w1, e * w2
        out[0, i] = (1.0 - elastic) * u1 + w1 / length
        out[1, i] = (1.0 - elastic) * u2 + w2 / length


@kernel
def _turn(a1: float, a2: float, b1: float, b2: float) -> float:
    """Share of a step at which a velocity that goes straight from a to b is least, where it turns back; 1 where it
    doesn't.
    """
    if a1 * b1 + a2 * b2 >= 0.0:
        return 1.0
    c1, c2 = b1 - a1, b2 - a2
    return -(a1 * c1 + a2 * c2) / (c1 * c1 + c2 * c2)


@kernel
def _pieces(a1: float, a2: float, b1: float, b2: float, scale: float) -> int:
    """Into how many pieces to take a step in which a velocity goes from a to b, `scale` being its time over what
    follows it.
    """
    across, along = abs(a1 * b2 - a2 * b1), a1 * b1 + a2 * b2
    if across <= STRAIGHT * along:
        return 1
    far = 0.25 * ((a1 + b1) ** 2 + (a2 + b2) ** 2) * scale * scale
    felt = min(1.0, far / 6.0)
    if across * felt <= STRAIGHT * along:
        return 1
    return min(MOST_PIECES, 1 + int(np.arctan2(across, along) * felt / STRAIGHT))


@kernel
def _touching(before: float, now: float) -> float:
    """Share of the step to a sample in contact that the tip was in contact."""
    return now / (now - before) if before <= 0.0 else 1.0


@kernel
def deepest(depth: Array, dt: Array, out: Array) -> None:
    """The deepest that the tip has been up to each sample, 0 at least [m], (n,)."""
    most = 0.0
    for i in range(depth.shape[0]):
        if i == 0 or dt[i] <= 0.0:
            most = 0.0
        most = max(most, depth[i])
        out[i] = most


@kernel
def bond(depth: Array, dt: Array, length: float, out: Array) -> None:
    """How much of its greatest pull a bond exerts, 0…1, that forms at contact and tears at depth −ℓ.

    On the way out it is stretched within ℓ, 1 − exp(−(δ_m − δ)/ℓ), with δ_m the deepest of this contact; outside the
    material it tears, (1 − (δ/ℓ)²)².

    Args:
        depth: δ [m], (n,). dt: see above. length: ℓ [m]. out: (n,).
    """
    most = -1.0  # negative: no bond
    for i in range(depth.shape[0]):
        if i == 0 or dt[i] <= 0.0 or depth[i] <= -length:
            most = -1.0
        if depth[i] > 0.0:
            most = max(most, depth[i])
        if most > 0.0:
            pull = -np.expm1(-(most - depth[i]) / length)
            if depth[i] < 0.0:
                pull *= (1.0 - (depth[i] / length) ** 2) ** 2
            out[i] = pull
        else:
            out[i] = 0.0


def joint_directions(speed: Array, dt: Array, length: Sequence[float] | Array) -> Array:
    """Which way each joint last moved, from −1 to 1, (N, n): `bristles` in one dimension, of Dahl's own form.

    Args:
        speed: [rad/s or m/s], (N, n). dt: see `bristles`. length: of each joint's bristles [rad or m], N.
    """
    n = speed.shape[1]
    out, row = np.empty_like(speed, order="C"), np.empty((2, n))
    still, always = np.zeros(n), np.ones(n, dtype=np.bool_)
    for j, own in enumerate(length):
        bristles(np.ascontiguousarray(speed[j]), still, dt, always, own, row, 0.0)
        out[j] = row[0]
    return out
