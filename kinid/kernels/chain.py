"""Pose, twist and acceleration of a serial chain, and the contact quantities of a plane, for many samples at once.

Samples are worked on in blocks of `BLOCK`. Inside a block each scalar of the recursion is a run of numbers in one flat
scratch array that stays in the first-level cache, so that the innermost loop runs over samples and compiles to SIMD
instructions; a last or single block uses only `width` of each run. Sine and cosine are computed in the same way, by
range reduction and polynomials, because a call to the C library would hold the loop to one sample at a time.

The recursion is the outward half of Newton-Euler (Luh, Walker, Paul 1980; Featherstone 2008, table 5.1), in base axes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., object])

BLOCK = 64  # samples in a block: 50 scratch rows of 64 doubles are 25 kB, within a first-level cache

# scratch rows: rotation (row-major) 0–8, origin 9–11, angular velocity 12–14, velocity 15–17, angular acceleration
# 18–20, acceleration 21–23
# columns of the pose table
POSE_COLUMNS = 24
# columns of the contact table
(DEPTH, DEPTH_RATE, SLIP1, SLIP2, SLIP_RATE1, SLIP_RATE2, NORMAL, TANGENT1, TANGENT2, MOMENT1, MOMENT2, MOMENT3) = (
    range(12)
)
CONTACT_COLUMNS = 12

_FAST = {"contract", "nsz"}  # fused multiply-add and no signed zeros; nothing that reorders a sum or drops NaN
_MAGIC = 6755399441055744.0  # 1.5·2⁵²: adding and taking it away rounds to the nearest integer
_TWO_OVER_PI = 0.6366197723675814
# π/2 in three parts whose leading ones have trailing zeros (Cody & Waite 1980), good to |q| of 10⁵ rad
_PIO2_1, _PIO2_2, _PIO2_3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21


def _part(function: F) -> F:
    """A part of kernels: inlined by LLVM, so that for a block of one sample, a constant width, no loop is left."""
    return njit(fastmath=_FAST, forceinline=True)(function)  # type: ignore[no-any-return]


@kernel(fastmath=_FAST, inline="always")
def _sincos(x: float) -> tuple[float, float]:
    """Sine and cosine to about 1 ulp (minimax polynomials on |r| ≤ π/4, FreeBSD msun k_sin, k_cos)."""
    k = (x * _TWO_OVER_PI + _MAGIC) - _MAGIC
    r = ((x - k * _PIO2_1) - k * _PIO2_2) - k * _PIO2_3
    z = r * r
    p = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    p = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * p)
    s = r + r * z * (-1.66666666666666324348e-01 + z * p)
    p = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
    p = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * p)
    c = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * p)
    half = (k * 0.5 - 0.25 + _MAGIC) - _MAGIC  # floor(k / 2)
    odd = k - 2.0 * half
    flip = 1.0 - 2.0 * (half - 2.0 * ((half * 0.5 - 0.25 + _MAGIC) - _MAGIC))  # −1 in the second half turn
    sine = s if odd == 0.0 else c
    cosine = c if odd == 0.0 else -s
    return flip * sine, flip * cosine


@_part
def _load(source: Array, start: int, count: int, x: Array, row: int) -> None:
    """Rows of the log, transposed into the scratch."""
    for j in range(source.shape[1]):
        base = (row + j) * BLOCK
        for s in range(count):
            x[base + s] = source[start + s, j]


@_part
def _shift(width: int, w: Array, tx: float, ty: float, tz: float) -> None:
    """Move the reference point by (tx, ty, tz) in the axes of the current frame, rigidly."""
    for s in range(width):
        dx = w[s] * tx + w[BLOCK + s] * ty + w[2 * BLOCK + s] * tz
        dy = w[3 * BLOCK + s] * tx + w[4 * BLOCK + s] * ty + w[5 * BLOCK + s] * tz
        dz = w[6 * BLOCK + s] * tx + w[7 * BLOCK + s] * ty + w[8 * BLOCK + s] * tz
        wx, wy, wz = w[12 * BLOCK + s], w[13 * BLOCK + s], w[14 * BLOCK + s]
        lx, ly, lz = w[18 * BLOCK + s], w[19 * BLOCK + s], w[20 * BLOCK + s]
        cx, cy, cz = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx
        w[9 * BLOCK + s] += dx
        w[10 * BLOCK + s] += dy
        w[11 * BLOCK + s] += dz
        w[15 * BLOCK + s] += cx
        w[16 * BLOCK + s] += cy
        w[17 * BLOCK + s] += cz
        w[21 * BLOCK + s] += ly * dz - lz * dy + wy * cz - wz * cy
        w[22 * BLOCK + s] += lz * dx - lx * dz + wz * cx - wx * cz
        w[23 * BLOCK + s] += lx * dy - ly * dx + wx * cy - wy * cx


@_part
def _turn(width: int, w: Array, f: Array) -> None:
    """Turn the axes of the current frame by a constant rotation f (row-major, 9)."""
    for i in range(3):
        a = 3 * i * BLOCK
        for s in range(width):
            r0, r1, r2 = w[a + s], w[a + BLOCK + s], w[a + 2 * BLOCK + s]
            w[a + s] = r0 * f[0] + r1 * f[3] + r2 * f[6]
            w[a + BLOCK + s] = r0 * f[1] + r1 * f[4] + r2 * f[7]
            w[a + 2 * BLOCK + s] = r0 * f[2] + r1 * f[5] + r2 * f[8]


@_part
def _revolve(width: int, w: Array, x: Array, iq: int, iv: int, ia: int) -> None:
    """Pass a revolute joint about the current z axis."""
    for s in range(width):
        dq, ddq = x[iv + s], x[ia + s]
        zx, zy, zz = w[2 * BLOCK + s], w[5 * BLOCK + s], w[8 * BLOCK + s]
        wx, wy, wz = w[12 * BLOCK + s], w[13 * BLOCK + s], w[14 * BLOCK + s]
        w[18 * BLOCK + s] += zx * ddq + (wy * zz - wz * zy) * dq
        w[19 * BLOCK + s] += zy * ddq + (wz * zx - wx * zz) * dq
        w[20 * BLOCK + s] += zz * ddq + (wx * zy - wy * zx) * dq
        w[12 * BLOCK + s] = wx + zx * dq
        w[13 * BLOCK + s] = wy + zy * dq
        w[14 * BLOCK + s] = wz + zz * dq
    for s in range(width):
        sine, cosine = _sincos(x[iq + s])
        x0, y0 = w[s], w[BLOCK + s]
        x1, y1 = w[3 * BLOCK + s], w[4 * BLOCK + s]
        x2, y2 = w[6 * BLOCK + s], w[7 * BLOCK + s]
        w[s] = cosine * x0 + sine * y0
        w[BLOCK + s] = cosine * y0 - sine * x0
        w[3 * BLOCK + s] = cosine * x1 + sine * y1
        w[4 * BLOCK + s] = cosine * y1 - sine * x1
        w[6 * BLOCK + s] = cosine * x2 + sine * y2
        w[7 * BLOCK + s] = cosine * y2 - sine * x2


@_part
def _slide(width: int, w: Array, x: Array, iq: int, iv: int, ia: int) -> None:
    """Pass a prismatic joint along the current z axis."""
    for s in range(width):
        q, dq, ddq = x[iq + s], x[iv + s], x[ia + s]
        zx, zy, zz = w[2 * BLOCK + s], w[5 * BLOCK + s], w[8 * BLOCK + s]
        wx, wy, wz = w[12 * BLOCK + s], w[13 * BLOCK + s], w[14 * BLOCK + s]
        lx, ly, lz = w[18 * BLOCK + s], w[19 * BLOCK + s], w[20 * BLOCK + s]
        cx, cy, cz = wy * zz - wz * zy, wz * zx - wx * zz, wx * zy - wy * zx
        w[9 * BLOCK + s] += zx * q
        w[10 * BLOCK + s] += zy * q
        w[11 * BLOCK + s] += zz * q
        w[15 * BLOCK + s] += zx * dq + cx * q
        w[16 * BLOCK + s] += zy * dq + cy * q
        w[17 * BLOCK + s] += zz * dq + cz * q
        w[21 * BLOCK + s] += zx * ddq + 2.0 * cx * dq + (ly * zz - lz * zy + wy * cz - wz * cy) * q
        w[22 * BLOCK + s] += zy * ddq + 2.0 * cy * dq + (lz * zx - lx * zz + wz * cx - wx * cz) * q
        w[23 * BLOCK + s] += zz * ddq + 2.0 * cz * dq + (lx * zy - ly * zx + wx * cy - wy * cx) * q


@_part
def _advance(width: int, w: Array, x: Array, turns: Array, shifts: Array, prismatic: Array) -> None:
    """Carry a block from the base to the last frame: at rest in the base, joint by joint, then the last constant
    part.
    """
    joints = prismatic.shape[0]
    for k in range(24):
        for s in range(width):
            w[k * BLOCK + s] = 0.0
    for s in range(width):
        w[s] = 1.0
        w[4 * BLOCK + s] = 1.0
        w[8 * BLOCK + s] = 1.0
    for j in range(joints + 1):
        _shift(width, w, shifts[j, 0], shifts[j, 1], shifts[j, 2])
        _turn(width, w, turns[j])
        if j < joints:
            iq, iv, ia = j * BLOCK, (joints + j) * BLOCK, (2 * joints + j) * BLOCK
            if prismatic[j]:
                _slide(width, w, x, iq, iv, ia)
            else:
                _revolve(width, w, x, iq, iv, ia)


@kernel(fastmath=_FAST)
def poses(q: Array, dq: Array, ddq: Array, turns: Array, shifts: Array, prismatic: Array, out: Array) -> None:
    """Fill `out` (n, 24): rotation (row-major), position, ω, v, α, a of the last frame's origin, in the base frame.

    Args:
        q: joint positions (n, N) [rad or m]; `dq`, `ddq` their derivatives.
        turns: constant rotations (N + 1, 9), before each joint and after the last; joints act along z after them.
        shifts: constant translations (N + 1, 3) [m], each in the axes before its rotation.
        prismatic: whether each joint slides, (N,) bool.
        out: (n, 24).
    """
    n, joints = q.shape
    x, w = np.empty(3 * joints * BLOCK), np.empty(24 * BLOCK)
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        _load(q, start, count, x, 0)
        _load(dq, start, count, x, joints)
        _load(ddq, start, count, x, 2 * joints)
        _advance(count, w, x, turns, shifts, prismatic)
        for s in range(count):
            for k in range(24):
                out[start + s, k] = w[k * BLOCK + s]


@_part
def _force(width: int, w: Array, f: Array, o: Array, tool: Array) -> None:
    """Contact force (rows 0–2) and moment about the sensor's origin (3–5) in base axes, from a block of wrenches.

    Newton-Euler of the tool about the sensor's origin: what the sensor reads, less weight and inertia of the tool.
    `tool`: mass, com (3), inertia about the com (row-major 9) in sensor axes, gravity in base axes (3).
    """
    m, cx, cy, cz = tool[0], tool[1], tool[2], tool[3]
    for s in range(width):
        r00, r01, r02 = w[s], w[BLOCK + s], w[2 * BLOCK + s]
        r10, r11, r12 = w[3 * BLOCK + s], w[4 * BLOCK + s], w[5 * BLOCK + s]
        r20, r21, r22 = w[6 * BLOCK + s], w[7 * BLOCK + s], w[8 * BLOCK + s]
        # all in sensor axes: there the inertia and the com are constant
        wx, wy, wz = w[12 * BLOCK + s], w[13 * BLOCK + s], w[14 * BLOCK + s]
        lx, ly, lz = w[18 * BLOCK + s], w[19 * BLOCK + s], w[20 * BLOCK + s]
        gx, gy, gz = tool[13] - w[21 * BLOCK + s], tool[14] - w[22 * BLOCK + s], tool[15] - w[23 * BLOCK + s]
        ox, oy, oz = r00 * wx + r10 * wy + r20 * wz, r01 * wx + r11 * wy + r21 * wz, r02 * wx + r12 * wy + r22 * wz
        ax, ay, az = r00 * lx + r10 * ly + r20 * lz, r01 * lx + r11 * ly + r21 * lz, r02 * lx + r12 * ly + r22 * lz
        hx, hy, hz = r00 * gx + r10 * gy + r20 * gz, r01 * gx + r11 * gy + r21 * gz, r02 * gx + r12 * gy + r22 * gz
        vx, vy, vz = oy * cz - oz * cy, oz * cx - ox * cz, ox * cy - oy * cx
        tx = m * (hx - (ay * cz - az * cy) - (oy * vz - oz * vy))
        ty = m * (hy - (az * cx - ax * cz) - (oz * vx - ox * vz))
        tz = m * (hz - (ax * cy - ay * cx) - (ox * vy - oy * vx))
        ix = tool[4] * ox + tool[5] * oy + tool[6] * oz
        iy = tool[7] * ox + tool[8] * oy + tool[9] * oz
        iz = tool[10] * ox + tool[11] * oy + tool[12] * oz
        fx, fy, fz = f[s] - tx, f[BLOCK + s] - ty, f[2 * BLOCK + s] - tz
        nx = f[3 * BLOCK + s] - (cy * tz - cz * ty) + tool[4] * ax + tool[5] * ay + tool[6] * az + oy * iz - oz * iy
        ny = f[4 * BLOCK + s] - (cz * tx - cx * tz) + tool[7] * ax + tool[8] * ay + tool[9] * az + oz * ix - ox * iz
        nz = f[5 * BLOCK + s] - (cx * ty - cy * tx) + tool[10] * ax + tool[11] * ay + tool[12] * az + ox * iy - oy * ix
        o[s] = r00 * fx + r01 * fy + r02 * fz
        o[BLOCK + s] = r10 * fx + r11 * fy + r12 * fz
        o[2 * BLOCK + s] = r20 * fx + r21 * fy + r22 * fz
        o[3 * BLOCK + s] = r00 * nx + r01 * ny + r02 * nz
        o[4 * BLOCK + s] = r10 * nx + r11 * ny + r12 * nz
        o[5 * BLOCK + s] = r20 * nx + r21 * ny + r22 * nz


@_part
def _clean(width: int, f: Array, reader: Array) -> None:
    """Undo the sensor's bias and cross-talk: f ← M (f − b); `reader` holds M row-major (36), then b (6)."""
    for s in range(width):
        a0, a1, a2 = f[s] - reader[36], f[BLOCK + s] - reader[37], f[2 * BLOCK + s] - reader[38]
        a3, a4, a5 = f[3 * BLOCK + s] - reader[39], f[4 * BLOCK + s] - reader[40], f[5 * BLOCK + s] - reader[41]
        for i in range(6):
            k = 6 * i
            f[i * BLOCK + s] = (
                reader[k] * a0
                + reader[k + 1] * a1
                + reader[k + 2] * a2
                + reader[k + 3] * a3
                + reader[k + 4] * a4
                + reader[k + 5] * a5
            )


@_part
def needed(reader: Array, compliance: Array) -> tuple[bool, bool]:
    """Whether the tip gives way under a force, and whether the sensor has faults to undo."""
    bends, cleans = False, False
    for i in range(9):
        bends = bends or compliance[i] != 0.0
    for i in range(42):
        cleans = cleans or reader[i] != (1.0 if i < 36 and i % 7 == 0 else 0.0)
    return bends, cleans


class Frame(NamedTuple):
    """What turns joints and a wrench into contact quantities; see `contacts`."""

    turns: Array
    shifts: Array
    prismatic: Array
    tip: Array
    reader: Array
    tool: Array
    plane: Array
    compliance: Array


class Scratch(NamedTuple):
    """Of a block: positions, velocities, accelerations of all joints, a frame's 24 runs, wrench, and contact load."""

    x: Array
    w: Array
    f: Array
    o: Array


@_part
def contact_block(
    start: int,
    count: int,
    forces: bool,
    bends: bool,
    cleans: bool,
    scratch: Scratch,
    frame: Frame,
    columns: int,
    out: Array,
) -> None:
    """Contact quantities of one block, into `out` from column `start` on; arguments otherwise as `contacts`.

    Args:
        count: samples in it. forces: whether there is a wrench. bends, cleans: see `needed`.
        scratch: joints and wrench are loaded. frame: or whatever else has its attributes.
    """
    (x, w, f, o), tip, plane, compliance = scratch, frame.tip, frame.plane, frame.compliance
    t00, t01, t02, t10, t11, t12 = plane[3], plane[4], plane[5], plane[6], plane[7], plane[8]
    n0, n1, n2 = plane[9], plane[10], plane[11]
    _advance(count, w, x, frame.turns, frame.shifts, frame.prismatic)
    if forces:
        if cleans:
            _clean(count, f, frame.reader)
        _force(count, w, f, o, frame.tool)
    for s in range(count):
        dx = w[s] * tip[0] + w[BLOCK + s] * tip[1] + w[2 * BLOCK + s] * tip[2]
        dy = w[3 * BLOCK + s] * tip[0] + w[4 * BLOCK + s] * tip[1] + w[5 * BLOCK + s] * tip[2]
        dz = w[6 * BLOCK + s] * tip[0] + w[7 * BLOCK + s] * tip[1] + w[8 * BLOCK + s] * tip[2]
        wx, wy, wz = w[12 * BLOCK + s], w[13 * BLOCK + s], w[14 * BLOCK + s]
        px = w[9 * BLOCK + s] + dx - plane[0]
        py = w[10 * BLOCK + s] + dy - plane[1]
        pz = w[11 * BLOCK + s] + dz - plane[2]
        vx = w[15 * BLOCK + s] + wy * dz - wz * dy
        vy = w[16 * BLOCK + s] + wz * dx - wx * dz
        vz = w[17 * BLOCK + s] + wx * dy - wy * dx
        fx, fy, fz = o[s], o[BLOCK + s], o[2 * BLOCK + s]
        if bends:
            px += compliance[0] * fx + compliance[1] * fy + compliance[2] * fz
            py += compliance[3] * fx + compliance[4] * fy + compliance[5] * fz
            pz += compliance[6] * fx + compliance[7] * fy + compliance[8] * fz
        i = start + s
        out[0, i] = -(n0 * px + n1 * py + n2 * pz)
        out[1, i] = -(n0 * vx + n1 * vy + n2 * vz)
        out[2, i] = t00 * px + t01 * py + t02 * pz
        out[3, i] = t10 * px + t11 * py + t12 * pz
        out[4, i] = t00 * vx + t01 * vy + t02 * vz
        out[5, i] = t10 * vx + t11 * vy + t12 * vz
        if columns >= 9:
            out[6, i] = n0 * fx + n1 * fy + n2 * fz
            out[7, i] = t00 * fx + t01 * fy + t02 * fz
            out[8, i] = t10 * fx + t11 * fy + t12 * fz
        if columns >= 12:
            mx = o[3 * BLOCK + s] - (dy * fz - dz * fy)
            my = o[4 * BLOCK + s] - (dz * fx - dx * fz)
            mz = o[5 * BLOCK + s] - (dx * fy - dy * fx)
            out[9, i] = t00 * mx + t01 * my + t02 * mz
            out[10, i] = t10 * mx + t11 * my + t12 * mz
            out[11, i] = n0 * mx + n1 * my + n2 * mz


@kernel(fastmath=_FAST)
def contacts(
    q: Array,
    dq: Array,
    ddq: Array,
    wrench: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    tip: Array,
    reader: Array,
    tool: Array,
    plane: Array,
    compliance: Array,
    columns: int,
    out: Array,
) -> None:
    """Fill `out` (columns, n) with contact-frame quantities of a plane, from joints and wrench.

    Args:
        q: joint positions (n, N) [rad or m], with `dq`, `ddq`.
        wrench: raw sensor wrench (n, 6) in sensor axes [N, N·m]; (0, 6) where there is none.
        turns: constant part of the chain to the sensor frame, with `shifts`, `prismatic`: as in `poses`.
        tip: the tip's position in the sensor frame [m], (3,).
        reader: inverse cross-talk (36), then bias (6).
        tool: mass, com, inertia about the com, gravity in base axes: (16,), see `_force`.
        plane: point (3), then rows tangent1, tangent2, normal (9), base frame.
        compliance: tip displacement per contact force [m/N], row-major (9), base frame.
        columns: how many of the contact columns to write (6 without moment, 9 with forces, 12 with moments).
        out: (columns, n), rows `DEPTH` … `MOMENT3`.
    """
    n, joints = q.shape
    x, f = np.empty(3 * joints * BLOCK), np.zeros(6 * BLOCK)
    scratch = Scratch(x, np.empty(24 * BLOCK), f, np.zeros(6 * BLOCK))
    frame = Frame(turns, shifts, prismatic, tip, reader, tool, plane, compliance)
    forces = wrench.shape[0] == n
    bends, cleans = needed(reader, compliance)
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        _load(q, start, count, x, 0)
        _load(dq, start, count, x, joints)
        _load(ddq, start, count, x, 2 * joints)
        if forces:
            _load(wrench, start, count, f, 0)
        contact_block(start, count, forces, bends, cleans, scratch, frame, columns, out)
