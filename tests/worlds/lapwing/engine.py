"""Physics of the lapwing world: serial arm (own recursions), bed-of-columns material, linearly implicit stepping."""
import numpy as np
from numba import njit

NC = 48          # columns under the tip
NI = 8           # Iwan elements (rate-independent loops)
# material vector
(K, N_, C, LAM, R1, T1, R2, T2, R3, T3, HA, HL, SR, SL, FA, AL, LK, LD, LW, DR, IK, IA, IX, IW, IY, GM,
 MU, BK, ZL, CT, DM, VS, LP, N0, AN, VR, LIFT, COMP, LV0) = range(39)
NP = 39
NS = NC * 4 + NI + 8
ST_D, ST_STUCK, ST_Z1, ST_Z2, ST_U, ST_U1, ST_U2, ST_S = (NC * 4 + NI + i for i in range(8))

def material(**kw):
    P = np.zeros(NP)
    P[N_], P[LW], P[ZL], P[N0], P[VS], P[VR], P[HL], P[SL], P[AL], P[IW], P[GM] = 1, 1e-4, 1e-4, 5, 1, 1e-3, 1e-3, 1e-3, 1e-3, 1, 0.012
    P[T1] = P[T2] = P[T3] = 1.0
    P[LV0] = 0.05
    for k, v in kw.items():
        P[globals()[k]] = v
    return P

@njit(cache=True)
def columns(P):
    """Gaps and weights whose columns together give depth^n (one column for n = 1)."""
    g, w = np.zeros(NC), np.zeros(NC)
    n = P[N_]
    if n <= 1.0:
        w[0] = 1.0
        return g, w, 1
    for i in range(NC):
        a, b = P[GM] * (i / NC) ** 1.5, P[GM] * ((i + 1) / NC) ** 1.5
        w[i] = n * (b ** (n - 1) - a ** (n - 1))
        g[i] = n * (n - 1) * (b ** n - a ** n) / n / w[i]
    return g, w, NC

@njit(cache=True)
def inhom(P, x, y):
    k = int(P[IK])
    if k == 1:
        return 1 + P[IA] * (x - P[IX]) + P[IY] * y
    if k == 2:
        return 1 + P[IA] * 0.5 * (1 + np.tanh((x - P[IX]) / P[IW]))
    if k == 3:
        return 1 + P[IA] * np.exp(-0.5 * ((x - P[IX]) ** 2 + (y - P[IY]) ** 2) / P[IW] ** 2)
    return 1.0

@njit(cache=True)
def normal_law(P, g, w, nc, st, t, d, v, x, y, h):
    """Normal force after a step h that ends at depth d; states are advanced. Returns force, stiffness, damping."""
    kk = P[K] * (1 + P[DR] * t) * inhom(P, x, y)
    F, Kt, Ct = 0.0, 0.0, 0.0
    dold = st[ST_D]
    e1, e2, e3 = np.exp(-h / P[T1]), np.exp(-h / P[T2]), np.exp(-h / P[T3])
    q1 = P[R1] * P[T1] * (1 - e1) / h
    q2 = P[R2] * P[T2] * (1 - e2) / h
    q3 = P[R3] * P[T3] * (1 - e3) / h
    for i in range(nc):
        di, do = d - g[i], dold - g[i]
        b = i * 4
        if di <= 0:
            st[b] *= e1; st[b + 1] *= e2; st[b + 2] *= e3
            continue
        inc = di - max(do, 0.0)
        st[b] = st[b] * e1 + inc * q1
        st[b + 1] = st[b + 1] * e2 + inc * q2
        st[b + 2] = st[b + 2] * e3 + inc * q3
        soft = 1.0
        if P[SR] > 0:
            if di > st[b + 3]:
                st[b + 3] = di
            soft = 1 - P[SR] * (1 - np.exp(-(st[b + 3] - di) / P[SL]))
        kw = kk * w[i]
        f = kw * (di * soft * (1 + P[LAM] * v) + st[b] + st[b + 1] + st[b + 2])
        if f > 0:
            F += f
            Kt += kw * (1 + P[R1] + P[R2] + P[R3])
            Ct += kw * di * P[LAM]
    if d > 0:
        F += P[C] * v
        Ct += P[C]
        if P[HA] > 0:
            for j in range(NI):
                l = P[HL] * (0.3 + 1.7 * (j + 0.5) / NI)
                z = st[NC * 4 + j] + d - max(dold, 0.0)
                z = min(max(z, -l), l)
                st[NC * 4 + j] = z
                F += P[HA] / NI * z / l
                Kt += P[HA] / NI / l
        if P[LK] != 0:
            s = (d - P[LD]) / P[LW]
            F += P[LK] * P[LW] * (s if s > 30 else np.log1p(np.exp(s)))
            Kt += P[LK] / (1 + np.exp(-s))
        if F < 0 and P[FA] <= 0:
            F = 0.0
    else:
        for j in range(NI):
            st[NC * 4 + j] = 0.0
    if P[FA] > 0:
        if d > 0:
            st[ST_STUCK] = max(st[ST_STUCK], 1 - np.exp(-d / (0.25 * P[AL])))
            F -= P[FA] * st[ST_STUCK]
        elif st[ST_STUCK] > 0:
            if d < -4 * P[AL]:
                st[ST_STUCK] = 0.0
            F -= P[FA] * st[ST_STUCK] * np.exp(d / P[AL])
    st[ST_D] = d
    return F, Kt, Ct

@njit(cache=True)
def friction_scale(P, N, v):
    mu = P[MU]
    if P[DM] != 0:
        mu += P[DM] * np.exp(-(v / P[VS]) ** 2)
    if P[LP] != 0:
        mu *= (max(N, 1e-9) / P[N0]) ** P[LP]
    return mu * max(N, 0.0)

@njit(cache=True)
def tangential_law(P, st, N, s1, s2, h, write):
    """Force on the tool along the tangents, N >= 0; s = slip velocity. Also the secant damping."""
    v = np.sqrt(s1 * s1 + s2 * s2)
    fm = friction_scale(P, N, v)
    kind = int(P[BK])
    f1, f2, c = 0.0, 0.0, 0.0
    if kind == 3:
        c = fm / np.sqrt(v * v + P[VR] ** 2)
        f1, f2 = -c * s1, -c * s2
        st1, st2 = 0.0, 0.0
    else:
        z1, z2 = st[ST_Z1], st[ST_Z2]
        if kind == 1:
            a1, a2 = z1 + h * s1, z2 + h * s2
            r = np.sqrt(a1 * a1 + a2 * a2)
            q = 1.0 if r < P[ZL] else P[ZL] / r
        else:
            q = 1.0 / (1 + h * v / P[ZL])
        st1, st2 = q * (z1 + h * s1), q * (z2 + h * s2)
        f1, f2, c = -fm * st1 / P[ZL], -fm * st2 / P[ZL], fm * h * q / P[ZL]
        if kind == 2:                       # LuGre: a dashpot beside the bristle, fading with speed
            sg = fm / P[ZL] * 2e-3 * np.exp(-(v / 0.005) ** 2)
            f1 -= sg * (s1 - v * st1 / P[ZL]); f2 -= sg * (s2 - v * st2 / P[ZL]); c += sg
    f1 *= 1 + P[AN]; f2 *= 1 - P[AN]
    if N > 0:
        f1 -= P[CT] * s1; f2 -= P[CT] * s2; c += P[CT]
    else:
        st1, st2 = 0.0, 0.0
    if write:
        st[ST_Z1], st[ST_Z2] = st1, st2
    return f1, f2, c

@njit(cache=True)
def lift(P, v):
    return P[LIFT] * v * v / (v * v + P[LV0] ** 2)

@njit(cache=True)
def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

@njit(cache=True, inline="always")
def cr(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

@njit(cache=True, inline="always")
def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])

@njit(cache=True, inline="always")
def mul(s, a):
    return (s * a[0], s * a[1], s * a[2])

@njit(cache=True, inline="always")
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

@njit(cache=True, inline="always")
def mv(R, a):
    return (R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2], R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2], R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2])

@njit(cache=True, inline="always")
def mtv(R, a):
    return (R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2], R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2], R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2])

@njit(cache=True, inline="always")
def vec(a):
    return (a[0], a[1], a[2])

@njit(cache=True)
def fk(ch, q):
    R0, p0, ax, m, c, I, g = ch
    n = len(q)
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    A, B, W = np.empty((3, 3)), np.empty((3, 3)), np.eye(3)
    x = (0.0, 0.0, 0.0)
    for i in range(n):
        x = add(x, mv(W, p0[i]))
        p[i, 0], p[i, 1], p[i, 2] = x
        a = ax[i]
        co, si = np.cos(q[i]), np.sin(q[i])
        k = 1 - co
        A[0, 0] = co + k * a[0] * a[0]; A[0, 1] = k * a[0] * a[1] - si * a[2]; A[0, 2] = k * a[0] * a[2] + si * a[1]
        A[1, 0] = k * a[0] * a[1] + si * a[2]; A[1, 1] = co + k * a[1] * a[1]; A[1, 2] = k * a[1] * a[2] - si * a[0]
        A[2, 0] = k * a[0] * a[2] - si * a[1]; A[2, 1] = k * a[1] * a[2] + si * a[0]; A[2, 2] = co + k * a[2] * a[2]
        for r in range(3):
            for s in range(3):
                B[r, s] = W[r, 0] * R0[i, 0, s] + W[r, 1] * R0[i, 1, s] + W[r, 2] * R0[i, 2, s]
        for r in range(3):
            for s in range(3):
                R[i, r, s] = B[r, 0] * A[0, s] + B[r, 1] * A[1, s] + B[r, 2] * A[2, s]
        W = R[i]
    return R, p

@njit(cache=True)
def rnea_at(ch, R, p, dq, ddq, grav):
    """Joint torques, in world axes, at poses R, p."""
    R0, p0, ax, m, c, I, g = ch
    n = len(dq)
    f, mo = np.empty((n, 3)), np.empty((n, 3))
    w, al, a, pp = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-g[0] * grav, -g[1] * grav, -g[2] * grav), (0.0, 0.0, 0.0)
    for i in range(n):
        z = mv(R[i], ax[i])
        pi = vec(p[i])
        d = (pi[0] - pp[0], pi[1] - pp[1], pi[2] - pp[2])
        a = add(a, add(cr(al, d), cr(w, cr(w, d))))
        al = add(al, add(mul(ddq[i], z), cr(w, mul(dq[i], z))))
        w = add(w, mul(dq[i], z))
        r = mv(R[i], c[i])
        fi = mul(m[i], add(a, add(cr(al, r), cr(w, cr(w, r)))))
        wl, all_ = mtv(R[i], w), mtv(R[i], al)
        h = add(mv(I[i], all_), cr(wl, mv(I[i], wl)))
        mi = add(mv(R[i], h), cr(r, fi))
        for k in range(3):
            f[i, k] = fi[k]; mo[i, k] = mi[k]
        pp = pi
    tau = np.empty(n)
    F, M, last = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), vec(p[n - 1])
    for i in range(n - 1, -1, -1):
        pi = vec(p[i])
        M = add(add(M, cr((last[0] - pi[0], last[1] - pi[1], last[2] - pi[2]), F)), vec(mo[i]))
        F = add(F, vec(f[i]))
        last = pi
        tau[i] = dot(mv(R[i], ax[i]), M)
    return tau

@njit(cache=True)
def rnea(ch, q, dq, ddq, grav):
    R, p = fk(ch, q)
    return rnea_at(ch, R, p, dq, ddq, grav)

@njit(cache=True)
def mass_matrix(ch, q, R, p):
    R0, p0, ax, m, c, I, g = ch
    n = len(q)
    M, z = np.zeros((n, n)), np.empty((n, 3))
    for i in range(n):
        z[i, 0], z[i, 1], z[i, 2] = mv(R[i], ax[i])
    mc, s, J, B = 0.0, (0.0, 0.0, 0.0), np.zeros((3, 3)), np.empty((3, 3))   # composite mass, first moment, inertia about the world origin
    for k in range(n - 1, -1, -1):
        r = add(vec(p[k]), mv(R[k], c[k]))
        mc += m[k]
        s = add(s, mul(m[k], r))
        for a in range(3):
            for b in range(3):
                B[a, b] = R[k, a, 0] * I[k, 0, b] + R[k, a, 1] * I[k, 1, b] + R[k, a, 2] * I[k, 2, b]
        rr = dot(r, r)
        for a in range(3):
            for b in range(3):
                J[a, b] += B[a, 0] * R[k, b, 0] + B[a, 1] * R[k, b, 1] + B[a, 2] * R[k, b, 2] - m[k] * r[a] * r[b]
            J[a, a] += m[k] * rr
        zk = vec(z[k])
        vo = cr(vec(p[k]), zk)                          # velocity of the world origin moving with link k
        lin = add(mul(mc, vo), cr(zk, s))
        ang = add(mv(J, zk), cr(s, vo))
        for i in range(k + 1):
            zi = vec(z[i])
            M[i, k] = dot(zi, ang) + dot(cr(vec(p[i]), zi), lin)
            M[k, i] = M[i, k]
    return M, z

@njit(cache=True)
def tip_jacobian(z, p, pt):
    n = len(z)
    J = np.empty((3, n))
    for i in range(n):
        J[0, i], J[1, i], J[2, i] = cr(vec(z[i]), (pt[0] - p[i, 0], pt[1] - p[i, 1], pt[2] - p[i, 2]))
    return J

@njit(cache=True)
def motion(ch, q, dq, ddq):
    """Pose, angular velocity and acceleration, and acceleration of the last joint's frame, for all rows."""
    n, nj = q.shape
    Ro, po, wo, alo, ao = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        R, p = fk(ch, q[k])
        w, al, a, pp = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(nj):
            z, pi = mv(R[i], ch[2][i]), vec(p[i])
            d = (pi[0] - pp[0], pi[1] - pp[1], pi[2] - pp[2])
            a = add(a, add(cr(al, d), cr(w, cr(w, d))))
            al = add(al, add(mul(ddq[k, i], z), cr(w, mul(dq[k, i], z))))
            w = add(w, mul(dq[k, i], z))
            pp = pi
        Ro[k], po[k] = R[nj - 1], p[nj - 1]
        for j in range(3):
            wo[k, j], alo[k, j], ao[k, j] = w[j], al[j], a[j]
    return Ro, po, wo, alo, ao

@njit(cache=True)
def ik(ch, tipp, Rt, q, pd, Rd, it):
    n = len(q)
    for _ in range(it):
        R, p = fk(ch, q)
        pt = p[n - 1] + R[n - 1] @ tipp
        E = Rd @ (R[n - 1] @ Rt).T
        e = np.empty(6)
        e[:3] = pd - pt
        e[3] = 0.5 * (E[2, 1] - E[1, 2]); e[4] = 0.5 * (E[0, 2] - E[2, 0]); e[5] = 0.5 * (E[1, 0] - E[0, 1])
        J = np.empty((6, n))
        for i in range(n):
            z = R[i] @ ch[2][i]
            J[:3, i] = cross(z, pt - p[i])
            J[3:, i] = z
        q = q + J.T @ np.linalg.solve(J @ J.T + 1e-7 * np.eye(6), e)
        if np.abs(e).max() < 1e-10:
            break
    return q

@njit(cache=True)
def ik_path(ch, tipp, Rt, q0, P, R):
    out = np.empty((len(P), len(q0)))
    q = q0.copy()
    for k in range(len(P)):
        q = ik(ch, tipp, Rt, q, P[k], R[k], 60 if k == 0 else 6)
        out[k] = q
    return out

@njit(cache=True)
def sim_contact(ch, tipp, qc, dqc, h, Kp, Kd, rot, Fc, Fv, jz, P, pt0, nrm, t1, t2, zs):
    """Impedance-controlled arm against the material. zs: motion of the surface along its normal [m]."""
    nt, n = qc.shape
    g, w, nc = columns(P)
    st, stc = np.zeros(NS), np.zeros(NS)
    Q, DQ, DDQ, F, TAU = np.empty((nt, n)), np.empty((nt, n)), np.empty((nt, n)), np.empty((nt, 3)), np.empty((nt, n))
    D3 = np.empty((nt, 3))
    q, v, zj = qc[0].copy(), np.zeros(n), np.zeros(n)
    R, p = fk(ch, q)
    for k in range(nt):
        t = k * h
        M, z = mass_matrix(ch, q, R, p)
        pt = p[n - 1] + R[n - 1] @ tipp
        J = tip_jacobian(z, p, pt)
        vt = J @ v
        x = pt - pt0
        dzs = (zs[k] - zs[k - 1]) / h if k > 0 else 0.0
        d, s1, s2 = -(x @ nrm) + zs[k] - st[ST_U], x @ t1 - st[ST_U1], x @ t2 - st[ST_U2]
        dv, v1, v2 = -(vt @ nrm) + dzs, vt @ t1, vt @ t2
        stc[:] = st
        fn, Kn, Cn = normal_law(P, g, w, nc, stc, t, d, dv, s1, s2, h)
        N = max(fn, 0.0)
        f1, f2, c = tangential_law(P, stc, N, v1, v2, h, False)
        # f at the end of the step: normal stiffness and damping, tangential secant, taken implicitly
        ft = (fn + lift(P, np.sqrt(v1 * v1 + v2 * v2)) * (1 if N > 0 else 0)) * nrm + (f1 + c * v1) * t1 + (f2 + c * v2) * t2
        A = M + np.diag(rot + h * (Kd + Fv) + h * h * Kp)
        nn, tt = nrm @ J, J.T @ J
        cn = h * (Cn + h * Kn)
        for i in range(n):
            for j in range(n):
                tt[i, j] -= nn[i] * nn[j]
                A[i, j] += cn * nn[i] * nn[j] + h * c * tt[i, j]
        rhs = J.T @ ft - h * Kn * (vt @ nrm) * nn - c * (tt @ v)
        tc = Kp * (qc[k] - q - h * v) + Kd * (dqc[k] - v)
        fj = np.empty(n)
        for i in range(n):
            qq = 1.0 / (1 + h * abs(v[i]) / jz)
            A[i, i] += h * h * Fc[i] / jz * qq
            fj[i] = Fc[i] / jz * qq * (zj[i] + h * v[i])
        a = np.linalg.solve(A, tc + rhs - fj - Fv * v)
        v = v + h * a
        for i in range(n):
            zj[i] = (zj[i] + h * v[i]) / (1 + h * abs(v[i]) / jz)
        q = q + h * v
        # the law along the motion that was really made: this is what the sensor feels
        R, p = fk(ch, q)
        pt = p[n - 1] + R[n - 1] @ tipp
        x = pt - pt0
        vt = J @ v
        d, s1, s2 = -(x @ nrm) + zs[k] - st[ST_U], x @ t1 - st[ST_U1], x @ t2 - st[ST_U2]
        dv, v1, v2 = (d - st[ST_D]) / h if k > 0 else 0.0, vt @ t1, vt @ t2
        fn, Kn, Cn = normal_law(P, g, w, nc, st, t, d, dv, s1, s2, h)
        f1, f2, c = tangential_law(P, st, max(fn, 0.0), v1, v2, h, True)
        if fn > 0:
            fn += lift(P, np.sqrt(v1 * v1 + v2 * v2))
        if P[COMP] > 0:
            b = h / 0.004
            st[ST_U] += b * (P[COMP] * fn - st[ST_U])
            st[ST_U1] += b * (-P[COMP] * f1 - st[ST_U1])
            st[ST_U2] += b * (-P[COMP] * f2 - st[ST_U2])
        F[k] = fn * nrm + f1 * t1 + f2 * t2
        Q[k], DQ[k], DDQ[k], TAU[k] = q, v, a, tc
        D3[k, 0], D3[k, 1], D3[k, 2] = d, s1, s2
    return Q, DQ, DDQ, F, TAU, D3

@njit(cache=True)
def sim_joints(ch, qc, dqc, ddqc, h, ct, Kp, Kd, rot, Fc, Fv, jz, jkind, As, Ad, Ex, Vs, Ld, ro, rs, rc, rs2, rc2, sk, sq, brake, slosh, patt):
    """Arm in free motion under PD or computed torque; returns the motion and the torque that made it (link side)."""
    nt, n = qc.shape
    Q, DQ, DDQ, TAU = np.empty((nt, n)), np.empty((nt, n)), np.empty((nt, n)), np.empty((nt, n))
    q, v, zj = qc[0].copy(), np.zeros(n), np.zeros(n)
    ds, vs = np.zeros(3), np.zeros(3)                    # sloshing mass, relative to its vessel, horizontal
    last = rnea(ch, q, v, np.zeros(n), 1.0)
    a = np.zeros(n)
    for k in range(nt):
        R, p = fk(ch, q)
        M, z = mass_matrix(ch, q, R, p)
        b0 = rnea_at(ch, R, p, v, np.zeros(n), 1.0)
        D = M + np.diag(rot)
        if ct:
            Kpm, Kdm, ff = D @ np.diag(Kp), D @ np.diag(Kd), D @ ddqc[k] + b0
        else:
            Kpm, Kdm, ff = np.diag(Kp), np.diag(Kd), b0
        load = np.zeros(n)
        A = D + h * Kdm + h * h * Kpm
        for i in range(n):
            s = v[i]
            fc = Fc[i] + Ld[i] * abs(last[i]) + Ex[i] * np.exp(-(s / Vs[i]) ** 2) + brake[k, i]
            if Ad[i] != 0:
                fc += Ad[i] * (1 if (zj[i] if jkind == 0 else s) > 0 else -1)
            if jkind == 1:
                cc = fc / np.sqrt(s * s + jz * jz)
                A[i, i] += h * cc
                load[i] += cc * s
            else:
                qq = 1.0 / (1 + h * abs(s) / jz)
                A[i, i] += h * h * fc / jz * qq
                load[i] += fc / jz * qq * (zj[i] + h * s)
            fv = Fv[i] + (As[i] if s > 0 else -As[i])
            A[i, i] += h * fv
            load[i] += fv * s + sk[i] * q[i] + sq[i]
            th = ro[i] * q[i]
            load[i] += rs[i] * np.sin(th) + rc[i] * np.cos(th) + rs2[i] * np.sin(2 * th) + rc2[i] * np.cos(2 * th)
        if slosh[0] > 0:
            pt = p[n - 1] + R[n - 1] @ patt
            fs = slosh[1] * ds + slosh[2] * vs - np.array([0, 0, 9.81]) * slosh[0]
            J = tip_jacobian(z, p, pt)
            load -= J.T @ fs
        e, de = qc[k] - q, dqc[k] - v
        a = np.linalg.solve(A, Kpm @ (e - h * v) + Kdm @ de + ff - b0 - load)
        v = v + h * a
        tau = Kpm @ (e - h * v) + Kdm @ (dqc[k] - v) + ff
        last = tau
        for i in range(n):
            zj[i] = (zj[i] + h * v[i]) / (1 + h * abs(v[i]) / jz)
        q = q + h * v
        if slosh[0] > 0:
            ap = J @ a
            for i in range(2):
                vs[i] += h * (-ap[i] - (slosh[1] * ds[i] + slosh[2] * vs[i]) / slosh[0])
                ds[i] += h * vs[i]
        Q[k], DQ[k], DDQ[k], TAU[k] = q, v, a, tau
    return Q, DQ, DDQ, TAU

@njit(cache=True)
def sim_tester(P, t, d, s, h, floor):
    """Material under a given crosshead motion; floor = (mass, stiffness, damping) of a resonating base, or zeros."""
    n = len(t)
    g, w, nc = columns(P)
    st = np.zeros(NS)
    F, T = np.empty(n), np.empty(n)
    zf, vf, do, so = 0.0, 0.0, d[0], s[0]
    st[ST_D] = d[0]
    for k in range(n):
        dt = d[k] - zf - st[ST_U]
        v = (dt - do) / h
        do = dt
        vs = (s[k] - so) / h
        so = s[k]
        fn, Kn, Cn = normal_law(P, g, w, nc, st, t[k], dt, v, s[k], 0.0, h)
        f1, f2, c = tangential_law(P, st, max(fn, 0.0), vs, 0.0, h, True)
        if floor[0] > 0:
            vf += h * (fn - floor[1] * zf - floor[2] * vf) / floor[0]
            zf += h * vf
        if P[COMP] > 0:
            st[ST_U] += h / 0.004 * (P[COMP] * fn - st[ST_U])
        F[k], T[k] = fn, f1
    return F, T
