"""Dynamics of a serial chain, one state at a time: mass matrix, bias and gravity torques, pose and Jacobian of its tip.

Everything is expressed in base axes about the base's origin. There spatial inertias of a composite body simply add, and
neither recursion needs a transformation from link to link: composite rigid bodies for the mass matrix, Newton-Euler for
the bias (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5 and 6, with all quantities in one frame).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.kernel import kernel

Array = NDArray[np.float64]

# columns of the scratch, one row a joint: subspace (angular, linear), velocity, acceleration, inertia about the origin
# (xx yy zz xy xz yz), first moment, mass, axis, origin
_S, _V, _A, _I, _H, _MASS, _Z, _P = 0, 6, 12, 18, 24, 27, 28, 31
WORK_COLUMNS = 34


# one long function: a state goes through both recursions in scalars, which a call would put into memory
@kernel
def dynamics(  # noqa: PLR0915
    q: Array,
    dq: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
    work: Array,
    mass_matrix: Array,
    bias: Array,
    gravity_torque: Array,
    rotation: Array,
    position: Array,
    jacobian: Array,
) -> None:
    """Fill the last six arrays for one state; M q̈ + bias = τ + Jᵀ f, nothing is allocated.

    Args:
        q, dq: positions and velocities, in the chain's order, (N,).
        turns, shifts, prismatic: the chain, see `kinid.robotics.robot.Chain`.
        mass: of each link [kg], (N,). com: (N, 3) [m]. inertia: about the com, row-major (N, 9) [kg·m²]; both in the
            axes that turn with the joint, whose third is the joint's own.
        gravity: in base axes [m/s²], (3,). work: scratch, (N, WORK_COLUMNS).
        mass_matrix: M, (N, N). bias: Coriolis, centrifugal and gravity torque, (N,). gravity_torque: its part, (N,).
        rotation: of the tip, (3, 3). position: of the tip [m], (3,).
        jacobian: of the tip, linear above angular, base axes, (6, N).
    """
    n = q.shape[0]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, -gravity[0], -gravity[1], -gravity[2]
    for j in range(n + 1):
        tx, ty, tz = shifts[j, 0], shifts[j, 1], shifts[j, 2]
        px += r00 * tx + r01 * ty + r02 * tz
        py += r10 * tx + r11 * ty + r12 * tz
        pz += r20 * tx + r21 * ty + r22 * tz
        f = turns[j]
        c0, c1, c2 = r00, r01, r02
        r00, r01, r02 = (
            c0 * f[0] + c1 * f[3] + c2 * f[6],
            c0 * f[1] + c1 * f[4] + c2 * f[7],
            c0 * f[2] + c1 * f[5] + c2 * f[8],
        )
        c0, c1, c2 = r10, r11, r12
        r10, r11, r12 = (
            c0 * f[0] + c1 * f[3] + c2 * f[6],
            c0 * f[1] + c1 * f[4] + c2 * f[7],
            c0 * f[2] + c1 * f[5] + c2 * f[8],
        )
        c0, c1, c2 = r20, r21, r22
        r20, r21, r22 = (
            c0 * f[0] + c1 * f[3] + c2 * f[6],
            c0 * f[1] + c1 * f[4] + c2 * f[7],
            c0 * f[2] + c1 * f[5] + c2 * f[8],
        )
        if j == n:
            break
        # the joint: its subspace about the origin, then its motion
        row = work[j]
        zx, zy, zz, speed = r02, r12, r22, dq[j]
        if prismatic[j]:
            sx, sy, sz, ux, uy, uz = 0.0, 0.0, 0.0, zx, zy, zz
            px, py, pz = px + zx * q[j], py + zy * q[j], pz + zz * q[j]
        else:
            sx, sy, sz = zx, zy, zz
            ux, uy, uz = py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx
            sine, cosine = np.sin(q[j]), np.cos(q[j])
            r00, r01 = cosine * r00 + sine * r01, cosine * r01 - sine * r00
            r10, r11 = cosine * r10 + sine * r11, cosine * r11 - sine * r10
            r20, r21 = cosine * r20 + sine * r21, cosine * r21 - sine * r20
        # acceleration first: the rate of the subspace is the velocity before the joint crossed with it
        ax += (wy * sz - wz * sy) * speed
        ay += (wz * sx - wx * sz) * speed
        az += (wx * sy - wy * sx) * speed
        bx += (wy * uz - wz * uy + vy * sz - vz * sy) * speed
        by += (wz * ux - wx * uz + vz * sx - vx * sz) * speed
        bz += (wx * uy - wy * ux + vx * sy - vy * sx) * speed
        wx, wy, wz = wx + sx * speed, wy + sy * speed, wz + sz * speed
        vx, vy, vz = vx + ux * speed, vy + uy * speed, vz + uz * speed
        row[0], row[1], row[2], row[3], row[4], row[5] = sx, sy, sz, ux, uy, uz
        row[6], row[7], row[8], row[9], row[10], row[11] = wx, wy, wz, vx, vy, vz
        row[12], row[13], row[14], row[15], row[16], row[17] = ax, ay, az, bx, by, bz
        row[28], row[29], row[30], row[31], row[32], row[33] = zx, zy, zz, px, py, pz
        # the link's inertia about the origin, in base axes
        m, e = mass[j], inertia[j]
        kx, ky, kz = com[j, 0], com[j, 1], com[j, 2]
        cx = px + r00 * kx + r01 * ky + r02 * kz
        cy = py + r10 * kx + r11 * ky + r12 * kz
        cz = pz + r20 * kx + r21 * ky + r22 * kz
        i00 = r00 * e[0] + r01 * e[3] + r02 * e[6]
        i01 = r00 * e[1] + r01 * e[4] + r02 * e[7]
        i02 = r00 * e[2] + r01 * e[5] + r02 * e[8]
        i10 = r10 * e[0] + r11 * e[3] + r12 * e[6]
        i11 = r10 * e[1] + r11 * e[4] + r12 * e[7]
        i12 = r10 * e[2] + r11 * e[5] + r12 * e[8]
        i20 = r20 * e[0] + r21 * e[3] + r22 * e[6]
        i21 = r20 * e[1] + r21 * e[4] + r22 * e[7]
        i22 = r20 * e[2] + r21 * e[5] + r22 * e[8]
        row[18] = i00 * r00 + i01 * r01 + i02 * r02 + m * (cy * cy + cz * cz)
        row[19] = i10 * r10 + i11 * r11 + i12 * r12 + m * (cx * cx + cz * cz)
        row[20] = i20 * r20 + i21 * r21 + i22 * r22 + m * (cx * cx + cy * cy)
        row[21] = i00 * r10 + i01 * r11 + i02 * r12 - m * cx * cy
        row[22] = i00 * r20 + i01 * r21 + i02 * r22 - m * cx * cz
        row[23] = i10 * r20 + i11 * r21 + i12 * r22 - m * cy * cz
        row[24], row[25], row[26], row[27] = m * cx, m * cy, m * cz, m
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = r00, r01, r02
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = r10, r11, r12
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = r20, r21, r22
    position[0], position[1], position[2] = px, py, pz
    # inward: composite inertia, and the force that each link's motion takes (angular, linear about the origin)
    jxx, jyy, jzz, jxy, jxz, jyz, hx, hy, hz, mc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    nx, ny, nz, fx, fy, fz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n - 1, -1, -1):
        row = work[j]
        ixx, iyy, izz, ixy, ixz, iyz = row[18], row[19], row[20], row[21], row[22], row[23]
        gx, gy, gz, m = row[24], row[25], row[26], row[27]
        wx, wy, wz, vx, vy, vz = row[6], row[7], row[8], row[9], row[10], row[11]
        ax, ay, az, bx, by, bz = row[12], row[13], row[14], row[15], row[16], row[17]
        # momentum about the origin, then f = I a + v ×* (I v)
        lx, ly, lz = m * vx + wy * gz - wz * gy, m * vy + wz * gx - wx * gz, m * vz + wx * gy - wy * gx
        ox = ixx * wx + ixy * wy + ixz * wz + gy * vz - gz * vy
        oy = ixy * wx + iyy * wy + iyz * wz + gz * vx - gx * vz
        oz = ixz * wx + iyz * wy + izz * wz + gx * vy - gy * vx
        fx += m * bx + ay * gz - az * gy + wy * lz - wz * ly
        fy += m * by + az * gx - ax * gz + wz * lx - wx * lz
        fz += m * bz + ax * gy - ay * gx + wx * ly - wy * lx
        nx += ixx * ax + ixy * ay + ixz * az + gy * bz - gz * by + wy * oz - wz * oy + vy * lz - vz * ly
        ny += ixy * ax + iyy * ay + iyz * az + gz * bx - gx * bz + wz * ox - wx * oz + vz * lx - vx * lz
        nz += ixz * ax + iyz * ay + izz * az + gx * by - gy * bx + wx * oy - wy * ox + vx * ly - vy * lx
        jxx, jyy, jzz, jxy, jxz, jyz = jxx + ixx, jyy + iyy, jzz + izz, jxy + ixy, jxz + ixz, jyz + iyz
        hx, hy, hz, mc = hx + gx, hy + gy, hz + gz, mc + m
        sx, sy, sz, ux, uy, uz = row[0], row[1], row[2], row[3], row[4], row[5]
        bias[j] = sx * nx + sy * ny + sz * nz + ux * fx + uy * fy + uz * fz
        wgx, wgy, wgz = gravity[0], gravity[1], gravity[2]
        gravity_torque[j] = -(
            mc * (ux * wgx + uy * wgy + uz * wgz)
            + sx * (hy * wgz - hz * wgy)
            + sy * (hz * wgx - hx * wgz)
            + sz * (hx * wgy - hy * wgx)
        )
        lx, ly, lz = mc * ux + sy * hz - sz * hy, mc * uy + sz * hx - sx * hz, mc * uz + sx * hy - sy * hx
        ox = jxx * sx + jxy * sy + jxz * sz + hy * uz - hz * uy
        oy = jxy * sx + jyy * sy + jyz * sz + hz * ux - hx * uz
        oz = jxz * sx + jyz * sy + jzz * sz + hx * uy - hy * ux
        for i in range(j + 1):
            s = work[i]
            entry = s[0] * ox + s[1] * oy + s[2] * oz + s[3] * lx + s[4] * ly + s[5] * lz
            mass_matrix[i, j] = entry
            mass_matrix[j, i] = entry
        dx, dy, dz = px - row[31], py - row[32], pz - row[33]
        zx, zy, zz = row[28], row[29], row[30]
        if prismatic[j]:
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = zx, zy, zz
        else:
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = zy * dz - zz * dy, zz * dx - zx * dz, zx * dy - zy * dx
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = sx, sy, sz


@kernel
def factorise(matrix: Array, n: int) -> None:
    """Cholesky factor of a symmetric positive definite matrix, in place of its lower triangle."""
    for j in range(n):
        total = matrix[j, j]
        for k in range(j):
            total -= matrix[j, k] * matrix[j, k]
        root = np.sqrt(total)
        matrix[j, j] = root
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / root


@kernel
def substitute(factor: Array, x: Array, n: int) -> None:
    """Solve L Lᵀ x = b for a factor of `factorise`; b is in x, and x takes its place."""
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= factor[i, k] * x[k]
        x[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * x[k]
        x[i] = total / factor[i, i]


@kernel
def energy(
    q: Array,
    dq: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
) -> float:
    """Kinetic and potential energy [J] of one state; arguments as in `dynamics`."""
    n = q.shape[0]
    work, matrix = np.empty((n, WORK_COLUMNS)), np.empty((n, n))
    rest = (np.empty(n), np.empty(n), np.empty((3, 3)), np.empty(3), np.empty((6, n)))
    dynamics(q, dq, turns, shifts, prismatic, mass, com, inertia, gravity, work, matrix, *rest)
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += 0.5 * dq[i] * matrix[i, j] * dq[j]
        total -= gravity[0] * work[i, 24] + gravity[1] * work[i, 25] + gravity[2] * work[i, 26]
    return total


# one long function: both recursions share their room, which is taken once for all states
@kernel
def newton_euler(
    q: Array,
    dq: Array,
    ddq: Array,
    parents: Array,
    turns: Array,
    shifts: Array,
    prismatic: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    gravity: Array,
    carrier: int,
    load: Array,
    out: Array,
) -> None:
    """Joint torques of a tree of bodies by recursive Newton-Euler, in the axes of each body (Featherstone 2008, ch. 5).

    Args:
        q, dq, ddq: positions and derivatives, (n, N), each joint behind its parent.
        parents: of each joint, −1 for the base, (N,) int64.
        turns, shifts, prismatic: placement of each joint in its parent's axes at zero, (N, 3, 3), (N, 3), (N,); each
            joint acts along its third axis.
        mass: of each body [kg], (N,). com: (N, 3) [m]. inertia: about the com, (N, 3, 3) [kg·m²].
        gravity: in base axes [m/s²], (3,).
        carrier: the body that carries a load. load: that load, force above moment about that body's origin, in its axes
            [N, N·m], (n, 6), or (0, 6) for none.
        out: gets the torques, (n, N).
    """
    joints = q.shape[1]
    rotation, place = np.empty((joints, 3, 3)), np.empty((joints, 3))
    spin, turn, pull = np.empty((joints, 3)), np.empty((joints, 3)), np.empty((joints, 3))
    force, moment = np.empty((joints, 3)), np.empty((joints, 3))
    base, w, al, a = -gravity, np.empty(3), np.empty(3), np.empty(3)
    still, step, moved = np.zeros(3), np.empty(3), np.empty(3)
    for row in range(q.shape[0]):
        for j in range(joints):
            parent = parents[j]
            position, speed, rise = q[row, j], dq[row, j], ddq[row, j]
            w0, al0, a0 = (spin[parent], turn[parent], pull[parent]) if parent >= 0 else (still, still, base)
            cosine, sine = (1.0, 0.0) if prismatic[j] else (np.cos(position), np.sin(position))
            for i in range(3):
                x, y = turns[j, i, 0], turns[j, i, 1]
                rotation[j, i, 0], rotation[j, i, 1] = x * cosine + y * sine, y * cosine - x * sine
                rotation[j, i, 2] = turns[j, i, 2]
                place[j, i] = shifts[j, i] + (turns[j, i, 2] * position if prismatic[j] else 0.0)
            _accelerate(w0, al0, place[j], step)
            for i in range(3):
                moved[i] = a0[i] + step[i]
            _into(rotation[j], w0, w)
            _into(rotation[j], al0, al)
            _into(rotation[j], moved, a)
            if prismatic[j]:
                a[0] += 2.0 * w[1] * speed
                a[1] -= 2.0 * w[0] * speed
                a[2] += rise
            else:
                al[0] += w[1] * speed
                al[1] -= w[0] * speed
                al[2] += rise
                w[2] += speed
            _accelerate(w, al, com[j], step)
            f, m = force[j], moment[j]
            for i in range(3):
                f[i] = mass[j] * (a[i] + step[i])
                spin[j, i], turn[j, i], pull[j, i] = w[i], al[i], a[i]
                moved[i] = inertia[j, i, 0] * w[0] + inertia[j, i, 1] * w[1] + inertia[j, i, 2] * w[2]
                m[i] = inertia[j, i, 0] * al[0] + inertia[j, i, 1] * al[1] + inertia[j, i, 2] * al[2]
            _add_cross(w, moved, m)
            _add_cross(com[j], f, m)
        if len(load) > 0:
            for i in range(3):
                force[carrier, i] -= load[row, i]
                moment[carrier, i] -= load[row, 3 + i]
        for j in range(joints - 1, -1, -1):
            out[row, j] = force[j, 2] if prismatic[j] else moment[j, 2]
            parent = parents[j]
            if parent < 0:
                continue
            for i in range(3):
                r0, r1, r2 = rotation[j, i, 0], rotation[j, i, 1], rotation[j, i, 2]
                moved[i] = r0 * force[j, 0] + r1 * force[j, 1] + r2 * force[j, 2]
                force[parent, i] += moved[i]
                moment[parent, i] += r0 * moment[j, 0] + r1 * moment[j, 1] + r2 * moment[j, 2]
            _add_cross(place[j], moved, moment[parent])


@kernel
def _add_cross(a: Array, b: Array, out: Array) -> None:
    """Add a × b."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@kernel
def _into(rotation: Array, vector: Array, out: Array) -> None:
    """A parent's vector in the axes of a body that stands in it with this rotation."""
    for i in range(3):
        out[i] = rotation[0, i] * vector[0] + rotation[1, i] * vector[1] + rotation[2, i] * vector[2]


@kernel
def _accelerate(w: Array, al: Array, arm: Array, out: Array) -> None:
    """Acceleration of a point of a body beyond that of its origin: α × r + ω × (ω × r)."""
    along = w[0] * arm[0] + w[1] * arm[1] + w[2] * arm[2]
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    for i in range(3):
        out[i] = w[i] * along - square * arm[i]
    _add_cross(al, arm, out)
