"""How well the regressors of a window of samples span the parameters: its smallest singular value.

`window`: gram (blocks, p, p), scale (p), cursor (5) = block, samples in it, full blocks, value, fixed scale.
"""

from __future__ import annotations

import math

from kinid.estimators._jit import inlined, jit
from kinid.kernels.types import Compiled


@inlined
def rotate(p: int, a: Compiled, i: int, j: int) -> None:
    """The Jacobi rotation that zeroes a[i, j] of a symmetric matrix."""
    theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(p):
        aki, akj = a[k, i], a[k, j]
        a[k, i], a[k, j] = c * aki - s * akj, s * aki + c * akj
    for k in range(p):
        aik, ajk = a[i, k], a[j, k]
        a[i, k], a[j, k] = c * aik - s * ajk, s * aik + c * ajk


@jit
def smallest_eigenvalue(shape: Compiled, a: Compiled) -> float:
    """Smallest eigenvalue of a symmetric matrix (p, p), which is overwritten: cyclic Jacobi rotations."""
    p = len(shape)
    for _ in range(30):
        settled = True
        for i in range(p):
            for j in range(i + 1, p):
                if a[i, j] * a[i, j] > 1e-20 * abs(a[i, i] * a[j, j]) + 1e-40:  # converges quadratically: 1e-20 left
                    settled = False
                    rotate(p, a, i, j)
        if settled:
            break
    least = math.inf
    for i in range(p):
        least = min(least, float(a[i, i]))
    return least


@jit
def window_value(
    shape: Compiled,
    gram: Compiled,
    scale: Compiled,
    fixed: bool,
    full: bool,
    samples: float,
    size: Compiled,
    a: Compiled,
) -> float:
    """Smallest singular value of the window's rows, each column over its scale, divided by √samples."""
    blocks, p = gram.shape[0], len(shape)
    for i in range(p):
        for j in range(i, p):
            total = 0.0
            for b in range(blocks):
                total += gram[b, i, j]
            a[i, j] = a[j, i] = total / samples
    for i in range(p):
        size[i] = scale[i] if fixed else max(scale[i], math.sqrt(a[i, i]))
        if full:
            scale[i] = size[i]
    for i in range(p):
        for j in range(p):
            both = size[i] * size[j]
            a[i, j] = a[i, j] / both if both > 0.0 else 0.0
    return math.sqrt(max(smallest_eigenvalue(shape, a), 0.0))


@inlined
def excite(
    p: int,
    shape: Compiled,
    gram: Compiled,
    scale: Compiled,
    cursor: Compiled,
    length: int,
    phi: Compiled,
    size: Compiled,
    a: Compiled,
) -> None:
    """One row more in the window. The value is renewed when a block is full, and at 2, 4, 8 … samples of the first."""
    block = int(cursor[0])
    for i in range(p):
        for j in range(i, p):
            gram[block, i, j] += phi[i] * phi[j]
    cursor[1] += 1.0
    count = int(cursor[1])
    if count == length:
        blocks = gram.shape[0]
        cursor[2] = min(cursor[2] + 1.0, float(blocks))
        full = cursor[2] == blocks
        cursor[3] = window_value(shape, gram, scale, cursor[4] > 0.0, full, cursor[2] * length, size, a)
        block = (block + 1) % blocks
        cursor[0], cursor[1] = float(block), 0.0
        for i in range(p):
            for j in range(i, p):
                gram[block, i, j] = 0.0
    elif cursor[2] == 0.0 and count >= p and count & (count - 1) == 0:
        cursor[3] = window_value(shape, gram, scale, cursor[4] > 0.0, False, float(count), size, a)


@jit
def excitation(
    shape: Compiled, rows: Compiled, window: Compiled, length: int, scratch: Compiled, values: Compiled
) -> None:
    """The window's value after each row."""
    gram, scale, cursor = window
    for k in range(rows.shape[0]):
        excite(len(shape), shape, gram, scale, cursor, length, rows[k], scratch[0], scratch[1:])
        values[k] = cursor[3]
