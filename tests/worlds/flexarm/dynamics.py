"""Rigid-body algebra of a serial chain of revolute joints in numba: kinematics, Jacobian, mass matrix, inverse dynamics (Newton-Euler in the
world frame, Featherstone 2008 ch. 5-6 in 3-vectors), damped least-squares inverse kinematics. selfcheck.py holds it against Pinocchio."""
from __future__ import annotations

import numpy as np
from numba import njit

jit = njit(cache=True, fastmath=False)


@jit
def _cross(a0, a1, a2, b0, b1, b2):
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@jit
def fk(q, Rp, pp, ax, R, p, z):
    """World rotation R, origin p and axis z of every joint."""
    n = q.shape[0]
    Rc = np.eye(3)
    pc = np.zeros(3)
    A = np.empty((3, 3))
    for i in range(n):
        for a in range(3):
            s = pc[a]
            for b in range(3):
                s += Rc[a, b] * pp[i, b]
            p[i, a] = s
        c, s = np.cos(q[i]), np.sin(q[i])
        x, y, w = ax[i, 0], ax[i, 1], ax[i, 2]
        C = 1 - c
        A[0, 0] = c + x * x * C
        A[0, 1] = x * y * C - w * s
        A[0, 2] = x * w * C + y * s
        A[1, 0] = y * x * C + w * s
        A[1, 1] = c + y * y * C
        A[1, 2] = y * w * C - x * s
        A[2, 0] = w * x * C - y * s
        A[2, 1] = w * y * C + x * s
        A[2, 2] = c + w * w * C
        T = np.zeros((3, 3))
        for a in range(3):
            for b in range(3):
                for k in range(3):
                    T[a, b] += Rc[a, k] * Rp[i, k, b]
        for a in range(3):
            for b in range(3):
                R[i, a, b] = T[a, 0] * A[0, b] + T[a, 1] * A[1, b] + T[a, 2] * A[2, b]
        for a in range(3):
            z[i, a] = R[i, a, 0] * x + R[i, a, 1] * y + R[i, a, 2] * w
            pc[a] = p[i, a]
        for a in range(3):
            for b in range(3):
                Rc[a, b] = R[i, a, b]


@jit
def crba(m, c, I, R, p, z, M):
    """Joint-space mass matrix."""
    n = m.shape[0]
    mm = 0.0
    h = np.zeros(3)             # first moment about the world's origin
    J = np.zeros((3, 3))        # inertia about the world's origin
    x = np.empty(3)
    for j in range(n - 1, -1, -1):
        for a in range(3):
            x[a] = p[j, a] + R[j, a, 0] * c[j, 0] + R[j, a, 1] * c[j, 1] + R[j, a, 2] * c[j, 2]
        mm += m[j]
        xx = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
        for a in range(3):
            h[a] += m[j] * x[a]
        for a in range(3):
            for b in range(3):
                s = 0.0
                for k in range(3):
                    for l in range(3):
                        s += R[j, a, k] * I[j, k, l] * R[j, b, l]
                s -= m[j] * x[a] * x[b]
                if a == b:
                    s += m[j] * xx
                J[a, b] += s
        # unit acceleration of joint j: alpha = z, velocity field z x (r - p_j)
        z0, z1, z2 = z[j, 0], z[j, 1], z[j, 2]
        o0, o1, o2 = _cross(p[j, 0], p[j, 1], p[j, 2], z0, z1, z2)     # acceleration of the point at the world's origin
        f0, f1, f2 = _cross(z0, z1, z2, h[0], h[1], h[2])
        f0 += mm * o0
        f1 += mm * o1
        f2 += mm * o2
        g0, g1, g2 = _cross(h[0], h[1], h[2], o0, o1, o2)
        t0 = J[0, 0] * z0 + J[0, 1] * z1 + J[0, 2] * z2 + g0
        t1 = J[1, 0] * z0 + J[1, 1] * z1 + J[1, 2] * z2 + g1
        t2 = J[2, 0] * z0 + J[2, 1] * z1 + J[2, 2] * z2 + g2
        for i in range(j + 1):
            k0, k1, k2 = _cross(p[i, 0], p[i, 1], p[i, 2], f0, f1, f2)
            v = z[i, 0] * (t0 - k0) + z[i, 1] * (t1 - k1) + z[i, 2] * (t2 - k2)
            M[i, j] = v
            M[j, i] = v


@jit
def rnea(dq, ddq, g, m, c, I, R, p, z, tau, last):
    """Inverse dynamics; last <- omega, alpha, acceleration (without gravity) of the last joint's origin."""
    n = m.shape[0]
    F = np.empty((n, 3))
    N = np.empty((n, 3))        # about the world's origin
    w = np.zeros(3)
    al = np.zeros(3)
    a = np.zeros(3)
    pr = np.zeros(3)
    x = np.empty(3)
    for i in range(n):
        r0, r1, r2 = p[i, 0] - pr[0], p[i, 1] - pr[1], p[i, 2] - pr[2]
        u0, u1, u2 = _cross(al[0], al[1], al[2], r0, r1, r2)
        v0, v1, v2 = _cross(w[0], w[1], w[2], r0, r1, r2)
        y0, y1, y2 = _cross(w[0], w[1], w[2], v0, v1, v2)
        a[0] += u0 + y0
        a[1] += u1 + y1
        a[2] += u2 + y2
        s0, s1, s2 = _cross(w[0], w[1], w[2], z[i, 0], z[i, 1], z[i, 2])
        al[0] += z[i, 0] * ddq[i] + s0 * dq[i]
        al[1] += z[i, 1] * ddq[i] + s1 * dq[i]
        al[2] += z[i, 2] * ddq[i] + s2 * dq[i]
        for k in range(3):
            w[k] += z[i, k] * dq[i]
            pr[k] = p[i, k]
            x[k] = R[i, k, 0] * c[i, 0] + R[i, k, 1] * c[i, 1] + R[i, k, 2] * c[i, 2]
        u0, u1, u2 = _cross(al[0], al[1], al[2], x[0], x[1], x[2])
        v0, v1, v2 = _cross(w[0], w[1], w[2], x[0], x[1], x[2])
        y0, y1, y2 = _cross(w[0], w[1], w[2], v0, v1, v2)
        F[i, 0] = m[i] * (a[0] + u0 + y0 - g[0])
        F[i, 1] = m[i] * (a[1] + u1 + y1 - g[1])
        F[i, 2] = m[i] * (a[2] + u2 + y2 - g[2])
        wl0 = R[i, 0, 0] * w[0] + R[i, 1, 0] * w[1] + R[i, 2, 0] * w[2]
        wl1 = R[i, 0, 1] * w[0] + R[i, 1, 1] * w[1] + R[i, 2, 1] * w[2]
        wl2 = R[i, 0, 2] * w[0] + R[i, 1, 2] * w[1] + R[i, 2, 2] * w[2]
        b0 = R[i, 0, 0] * al[0] + R[i, 1, 0] * al[1] + R[i, 2, 0] * al[2]
        b1 = R[i, 0, 1] * al[0] + R[i, 1, 1] * al[1] + R[i, 2, 1] * al[2]
        b2 = R[i, 0, 2] * al[0] + R[i, 1, 2] * al[1] + R[i, 2, 2] * al[2]
        h0 = I[i, 0, 0] * wl0 + I[i, 0, 1] * wl1 + I[i, 0, 2] * wl2
        h1 = I[i, 1, 0] * wl0 + I[i, 1, 1] * wl1 + I[i, 1, 2] * wl2
        h2 = I[i, 2, 0] * wl0 + I[i, 2, 1] * wl1 + I[i, 2, 2] * wl2
        e0, e1, e2 = _cross(wl0, wl1, wl2, h0, h1, h2)
        e0 += I[i, 0, 0] * b0 + I[i, 0, 1] * b1 + I[i, 0, 2] * b2
        e1 += I[i, 1, 0] * b0 + I[i, 1, 1] * b1 + I[i, 1, 2] * b2
        e2 += I[i, 2, 0] * b0 + I[i, 2, 1] * b1 + I[i, 2, 2] * b2
        k0, k1, k2 = _cross(p[i, 0] + x[0], p[i, 1] + x[1], p[i, 2] + x[2], F[i, 0], F[i, 1], F[i, 2])
        N[i, 0] = R[i, 0, 0] * e0 + R[i, 0, 1] * e1 + R[i, 0, 2] * e2 + k0
        N[i, 1] = R[i, 1, 0] * e0 + R[i, 1, 1] * e1 + R[i, 1, 2] * e2 + k1
        N[i, 2] = R[i, 2, 0] * e0 + R[i, 2, 1] * e1 + R[i, 2, 2] * e2 + k2
    for k in range(3):
        last[0, k] = w[k]
        last[1, k] = al[k]
        last[2, k] = a[k]
    f = np.zeros(3)
    t = np.zeros(3)
    for i in range(n - 1, -1, -1):
        for k in range(3):
            f[k] += F[i, k]
            t[k] += N[i, k]
        k0, k1, k2 = _cross(p[i, 0], p[i, 1], p[i, 2], f[0], f[1], f[2])
        tau[i] = z[i, 0] * (t[0] - k0) + z[i, 1] * (t[1] - k1) + z[i, 2] * (t[2] - k2)


@jit
def _motion(dq, ddq, p, z, last):
    """last <- omega, alpha, acceleration (without gravity) of the last joint's origin: the outward half of rnea."""
    n = dq.shape[0]
    w0 = w1 = w2 = b0 = b1 = b2 = a0 = a1 = a2 = 0.0
    q0 = q1 = q2 = 0.0
    for i in range(n):
        r0, r1, r2 = p[i, 0] - q0, p[i, 1] - q1, p[i, 2] - q2
        u0, u1, u2 = _cross(b0, b1, b2, r0, r1, r2)
        v0, v1, v2 = _cross(w0, w1, w2, r0, r1, r2)
        y0, y1, y2 = _cross(w0, w1, w2, v0, v1, v2)
        a0, a1, a2 = a0 + u0 + y0, a1 + u1 + y1, a2 + u2 + y2
        s0, s1, s2 = _cross(w0, w1, w2, z[i, 0], z[i, 1], z[i, 2])
        b0 += z[i, 0] * ddq[i] + s0 * dq[i]
        b1 += z[i, 1] * ddq[i] + s1 * dq[i]
        b2 += z[i, 2] * ddq[i] + s2 * dq[i]
        w0 += z[i, 0] * dq[i]
        w1 += z[i, 1] * dq[i]
        w2 += z[i, 2] * dq[i]
        q0, q1, q2 = p[i, 0], p[i, 1], p[i, 2]
    last[0, 0], last[0, 1], last[0, 2] = w0, w1, w2
    last[1, 0], last[1, 1], last[1, 2] = b0, b1, b2
    last[2, 0], last[2, 1], last[2, 2] = a0, a1, a2


@jit
def frames(q, dq, ddq, Rp, pp, ax, Rs, ps, tip):
    """For every row: sensor rotation, sensor origin, tip, and omega, alpha, acceleration of the sensor's origin (world axes, no gravity)."""
    N, n = q.shape
    R = np.empty((n, 3, 3))
    p = np.empty((n, 3))
    z = np.empty((n, 3))
    RS = np.empty((N, 3, 3))
    P = np.empty((N, 3))
    X = np.empty((N, 3))
    K = np.empty((N, 3, 3))
    last = np.empty((3, 3))
    for i in range(N):
        fk(q[i], Rp, pp, ax, R, p, z)
        _motion(dq[i], ddq[i], p, z, last)
        for a in range(3):
            for b in range(3):
                RS[i, a, b] = R[n - 1, a, 0] * Rs[0, b] + R[n - 1, a, 1] * Rs[1, b] + R[n - 1, a, 2] * Rs[2, b]
            P[i, a] = p[n - 1, a] + R[n - 1, a, 0] * ps[0] + R[n - 1, a, 1] * ps[1] + R[n - 1, a, 2] * ps[2]
            X[i, a] = P[i, a] + RS[i, a, 0] * tip[0] + RS[i, a, 1] * tip[1] + RS[i, a, 2] * tip[2]
            K[i, 0, a] = last[0, a]
            K[i, 1, a] = last[1, a]
        r0, r1, r2 = P[i, 0] - p[n - 1, 0], P[i, 1] - p[n - 1, 1], P[i, 2] - p[n - 1, 2]
        u0, u1, u2 = _cross(last[1, 0], last[1, 1], last[1, 2], r0, r1, r2)
        v0, v1, v2 = _cross(last[0, 0], last[0, 1], last[0, 2], r0, r1, r2)
        y0, y1, y2 = _cross(last[0, 0], last[0, 1], last[0, 2], v0, v1, v2)
        K[i, 2, 0] = last[2, 0] + u0 + y0
        K[i, 2, 1] = last[2, 1] + u1 + y1
        K[i, 2, 2] = last[2, 2] + u2 + y2
    return RS, P, X, K


@jit
def torques(q, dq, ddq, g, Rp, pp, ax, m, c, I):
    """Inverse dynamics of every row."""
    N, n = q.shape
    R = np.empty((n, 3, 3))
    p = np.empty((n, 3))
    z = np.empty((n, 3))
    last = np.empty((3, 3))
    out = np.empty((N, n))
    for i in range(N):
        fk(q[i], Rp, pp, ax, R, p, z)
        rnea(dq[i], ddq[i], g, m, c, I, R, p, z, out[i], last)
    return out


@jit
def jacobian(p, z, x, J):
    """Columns z x (x - p) over z."""
    for i in range(p.shape[0]):
        J[0, i], J[1, i], J[2, i] = _cross(z[i, 0], z[i, 1], z[i, 2], x[0] - p[i, 0], x[1] - p[i, 1], x[2] - p[i, 2])
        J[3, i], J[4, i], J[5, i] = z[i, 0], z[i, 1], z[i, 2]


@jit
def ik(Rd, Xd, q0, qn, Rp, pp, ax, Rs, ps, tip, iters, pull):
    """Follow tip positions Xd and sensor rotations Rd; redundant joints drawn towards qn. Returns angles and the final errors."""
    N = Xd.shape[0]
    n = q0.shape[0]
    R = np.empty((n, 3, 3))
    p = np.empty((n, 3))
    z = np.empty((n, 3))
    J = np.empty((6, n))
    B = np.empty((6, 2))
    q = q0.copy()
    Q = np.empty((N, n))
    err = np.empty(N)
    for k in range(N):
        for it in range(iters):
            fk(q, Rp, pp, ax, R, p, z)
            Rc = R[n - 1] @ Rs
            x = p[n - 1] + R[n - 1] @ ps + Rc @ tip
            E = Rd[k] @ Rc.T
            B[:3, 0] = Xd[k] - x
            B[3, 0] = 0.5 * (E[2, 1] - E[1, 2])
            B[4, 0] = 0.5 * (E[0, 2] - E[2, 0])
            B[5, 0] = 0.5 * (E[1, 0] - E[0, 1])
            s = np.sum(B[:, 0] ** 2)
            err[k] = np.sqrt(s)
            if s < 1e-15 and it > 0:
                break
            jacobian(p, z, x, J)
            A = J @ J.T
            for a in range(6):
                A[a, a] += 1e-9
            h = pull * (qn - q)
            B[:, 1] = J @ h
            Y = np.linalg.solve(A, B)
            dq = J.T @ np.ascontiguousarray(Y[:, 0])
            if n > 6 and it == 0:
                dq = dq + h - J.T @ np.ascontiguousarray(Y[:, 1])
            mx = np.max(np.abs(dq))
            if mx > 0.3:
                dq = dq * (0.3 / mx)
            q = q + dq
        Q[k] = q
    return Q, err


@jit
def tip_torque(Q, F, Rp, pp, ax, Rs, ps, tip):
    """J' F of a world force at the tip, row by row."""
    N, n = Q.shape
    R = np.empty((n, 3, 3))
    p = np.empty((n, 3))
    z = np.empty((n, 3))
    J = np.empty((6, n))
    out = np.empty((N, n))
    r = ps + Rs @ tip
    for k in range(N):
        if F[k, 0] == 0.0 and F[k, 1] == 0.0 and F[k, 2] == 0.0:
            out[k] = 0.0
            continue
        fk(Q[k], Rp, pp, ax, R, p, z)
        x = p[n - 1] + R[n - 1] @ r
        jacobian(p, z, x, J)
        for i in range(n):
            out[k, i] = F[k, 0] * J[0, i] + F[k, 1] * J[1, i] + F[k, 2] * J[2, i]
    return out
