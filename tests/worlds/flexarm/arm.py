"""Forward dynamics of a flexible-joint arm in closed loop (Spong 1987; De Luca & Book, Springer Handbook of Robotics ch. 11):

    M(q) q" + h(q, q') = K (th - q) + D (th' - q') + J' F        B th" + K (th - q) + D (th' - q') + friction(th) = tau_m

Both lines are stepped together, springs, dampers and viscous friction implicitly (the motor's line is eliminated, one Cholesky factor a
control tick), contact and Coulomb friction explicitly, 4 kHz; control, M, h and J at 1 kHz. Gear friction is LuGre-like on the motor
side with Stribeck, load and direction terms, torque ripple and a balancing spring."""
from __future__ import annotations

import numpy as np
from numba import njit

from contact import NF, NST, touch
from dynamics import crba, fk, rnea

jit = njit(cache=True)
FP = "fc fv df vs asym lf bl ra rk rp ra2 rp2 ks k0".split()


def friction_array(n, **kw):
    a = np.zeros((n, len(FP)))
    a[:, FP.index("vs")] = 0.1
    a[:, FP.index("bl")] = 4e-4
    a[:, FP.index("rk")] = 1.0
    for k, v in kw.items():
        a[:, FP.index(k)] = v
    return a


@jit
def gear(th, dth, z, ts, f):
    """Friction, ripple and spring of one joint (without viscous), for the bristle z in -1..1."""
    v = dth / f[3]
    s = f[0] + f[2] * np.exp(-v * v) + f[5] * abs(ts)
    fr = s * z * (1.0 + f[4] * z)
    x = f[8] * th
    return fr + f[1] * f[4] * z * dth + f[7] * np.sin(x + f[9]) + f[10] * np.sin(2 * x + f[11]) + f[12] * (th - f[13])


@jit
def gear_along(th, dth, ts, fp, dt):
    """Gear torque with viscous friction along a known motion of the motors."""
    T, n = th.shape
    out = np.empty((T, n))
    for i in range(n):
        z = 0.0
        for k in range(T):
            sg = 1.0 if dth[k, i] > 0 else -1.0
            z = sg + (z - sg) * np.exp(-abs(dth[k, i]) * dt / fp[i, 6])
            out[k, i] = gear(th[k, i], dth[k, i], z, ts[k, i], fp[i]) + fp[i, 1] * dth[k, i]
    return out


@jit
def simulate(thd, dthd, tff, sub, dt, stride, kp, kd, Kx, Dx, Rp, pp, ax, Rs, ps, tip, m, c, I, g, K, B, D, fp, noise,
             on, sp, sn, s1v, s2v, Rt, cp, gg, ww):
    """Ticks of thd (motor reference), dthd, tff (feed-forward torque); records every `stride` substeps.
    rec rows: t, q, dq, ddq, th, dth, ddth, spring torque, gear torque (friction+ripple+spring), N, T1, T2, contact point (3)."""
    T, n = thd.shape
    q = thd[0].copy()
    th = thd[0].copy()
    R = np.empty((n, 3, 3))
    p = np.empty((n, 3))
    z = np.empty((n, 3))
    M = np.empty((n, n))
    Lc = np.zeros((n, n))
    h = np.empty(n)
    last = np.empty((3, 3))
    fk(q, Rp, pp, ax, R, p, z)
    zero = np.zeros(n)
    rnea(zero, zero, g, m, c, I, R, p, z, h, last)
    for i in range(n):                        # start at rest: springs carry the weight
        th[i] = q[i] + h[i] / K[i]
    off = th - thd[0]
    th -= off
    q -= off
    dq = np.zeros(n)
    dth = np.zeros(n)
    zb = np.zeros(n)
    J = np.zeros((6, n))
    Jc = np.zeros((3, n))
    st = np.zeros((gg.shape[0], NST))
    fs = np.zeros(NF)
    F = np.zeros(3)
    W = 8 * n + 7
    rec = np.empty((T * sub // stride, W))
    tm = np.empty(n)
    rhs = np.empty(n)
    gf = np.empty(n)
    dqn = np.empty(n)
    e6 = np.empty(6)
    q0 = np.empty(n)
    Fv = fp[:, 1].copy()
    ir = 0
    cnt = 0
    pc = np.zeros(3)
    for k in range(T):
        fk(q, Rp, pp, ax, R, p, z)
        crba(m, c, I, R, p, z, M)
        rnea(dq, zero, g, m, c, I, R, p, z, h, last)
        Rn = R[n - 1] @ Rs
        x = p[n - 1] + R[n - 1] @ ps + Rn @ tip
        cen = x - Rt * Rn[:, 2]
        pc = cen - Rt * sn
        for i in range(n):
            Jc[:, i] = np.cross(z[i], pc - p[i])
        # control
        if Kx[0] > 0.0:
            for i in range(n):
                J[:3, i] = np.cross(z[i], x - p[i])
                J[3:, i] = z[i]
            for a in range(6):
                s = 0.0
                d = 0.0
                for i in range(n):
                    s += J[a, i] * (thd[k, i] - th[i])
                    d += J[a, i] * (dthd[k, i] - dth[i])
                e6[a] = Kx[a] * s + Dx[a] * d
        for i in range(n):
            tm[i] = kp[i] * (thd[k, i] - th[i]) + kd[i] * (dthd[k, i] - dth[i]) + tff[k, i] + noise[k, i]
            if Kx[0] > 0.0:
                for a in range(6):
                    tm[i] += J[a, i] * e6[a]
        # factor M + e
        for i in range(n):
            Kd = dt * K[i] + D[i]
            Bp = B[i] + dt * (Kd + Fv[i])
            e = dt * Kd - (dt * Kd) ** 2 / Bp
            for j in range(i + 1):
                s = M[i, j]
                if i == j:
                    s += e
                for l in range(j):
                    s -= Lc[i, l] * Lc[j, l]
                if i == j:
                    Lc[i, i] = np.sqrt(s)
                else:
                    Lc[i, j] = s / Lc[j, j]
        for i in range(n):
            q0[i] = q[i]
        dep0 = -(sn[0] * (pc[0] - sp[0]) + sn[1] * (pc[1] - sp[1]) + sn[2] * (pc[2] - sp[2]))
        a10 = s1v[0] * (x[0] - sp[0]) + s1v[1] * (x[1] - sp[1]) + s1v[2] * (x[2] - sp[2])
        a20 = s2v[0] * (x[0] - sp[0]) + s2v[1] * (x[1] - sp[1]) + s2v[2] * (x[2] - sp[2])
        for b in range(sub):
            if on:
                d0, d1, d2, v0, v1, v2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(n):
                    jn = sn[0] * Jc[0, i] + sn[1] * Jc[1, i] + sn[2] * Jc[2, i]
                    j1 = s1v[0] * Jc[0, i] + s1v[1] * Jc[1, i] + s1v[2] * Jc[2, i]
                    j2 = s2v[0] * Jc[0, i] + s2v[1] * Jc[1, i] + s2v[2] * Jc[2, i]
                    dqi = q[i] - q0[i]
                    d0 -= jn * dqi
                    d1 += j1 * dqi
                    d2 += j2 * dqi
                    v0 -= jn * dq[i]
                    v1 += j1 * dq[i]
                    v2 += j2 * dq[i]
                touch(dt, (k * sub + b) * dt, dep0 + d0, v0, a10 + d1, a20 + d2, v1, v2, cp, gg, ww, st, fs, F)
            for i in range(n):
                s = -h[i]
                if on:
                    for a in range(3):
                        s += Jc[a, i] * (F[0] * sn[a] + F[1] * s1v[a] + F[2] * s2v[a])
                sp0 = K[i] * (th[i] - q[i])
                ts = sp0 + D[i] * (dth[i] - dq[i])
                adv = abs(dth[i]) * dt / fp[i, 6]
                sg = 1.0 if dth[i] > 0 else -1.0
                zb[i] = sg + (zb[i] - sg) * np.exp(-adv)
                gf[i] = gear(th[i], dth[i], zb[i], ts, fp[i])
                Kd = dt * K[i] + D[i]
                Bp = B[i] + dt * (Kd + Fv[i])
                rm = B[i] * dth[i] + dt * (tm[i] - gf[i] - sp0)
                mm = 0.0
                for j in range(n):
                    mm += M[i, j] * dq[j]
                dqn[i] = mm + dt * (s + sp0) + dt * Kd * rm / Bp
                rhs[i] = rm
            for i in range(n):
                s = dqn[i]
                for l in range(i):
                    s -= Lc[i, l] * dqn[l]
                dqn[i] = s / Lc[i, i]
            for i in range(n - 1, -1, -1):
                s = dqn[i]
                for l in range(i + 1, n):
                    s -= Lc[l, i] * dqn[l]
                dqn[i] = s / Lc[i, i]
            w = cnt % stride == 0
            for i in range(n):
                Kd = dt * K[i] + D[i]
                dn = (rhs[i] + dt * Kd * dqn[i]) / (B[i] + dt * (Kd + Fv[i]))
                if w:
                    rec[ir, 1 + i] = q[i]
                    rec[ir, 1 + n + i] = dq[i]
                    rec[ir, 1 + 2 * n + i] = (dqn[i] - dq[i]) / dt
                    rec[ir, 1 + 3 * n + i] = th[i]
                    rec[ir, 1 + 4 * n + i] = dth[i]
                    rec[ir, 1 + 5 * n + i] = (dn - dth[i]) / dt
                    rec[ir, 1 + 6 * n + i] = K[i] * (th[i] - q[i]) + D[i] * (dth[i] - dq[i])
                    rec[ir, 1 + 7 * n + i] = gf[i] + Fv[i] * dth[i]
                dth[i] = dn
            if w:
                rec[ir, 0] = (k * sub + b) * dt
                rec[ir, W - 6] = F[0]
                rec[ir, W - 5] = F[1]
                rec[ir, W - 4] = F[2]
                for a in range(3):
                    rec[ir, W - 3 + a] = pc[a]
                ir += 1
            cnt += 1
            for i in range(n):
                q[i] += dt * dqn[i]
                th[i] += dt * dth[i]
                dq[i] = dqn[i]
    return rec
