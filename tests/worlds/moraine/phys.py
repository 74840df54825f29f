"""Engine of the world 'moraine': own chain dynamics (recursive Newton-Euler form of the Lagrange equations, semi-implicit
integration with the mass matrix refreshed every few steps), own contact law with memory, own drives and presses."""
import numpy as np
from numba import njit

# ---------- parameters of the contact law (one float array) ----------
NAMES = ["k", "n", "c", "lam", "K2", "db", "z0", "alpha", "soft_r", "soft_l", "adh", "adh_l", "hyA", "hyL", "C",
         "mu", "cv", "dmu", "vs", "L", "p", "N0", "an", "wear", "wear_l", "wall_k", "wall_x", "wall_mu",
         "inh_a", "inh_x", "inh_w", "inh_g", "n2", "disk",
         "b1", "t1", "b2", "t2", "b3", "t3", "b4", "t4", "b5", "t5", "b6", "t6", "b7", "t7"]
IX = {n: i for i, n in enumerate(NAMES)}
NB = 7
B0 = IX["b1"]
(K, NN, CC, LAM, K2, DB, Z0, ALPHA, SR, SL, ADH, ADHL, HYA, HYL, COMP, MU, CV, DMU, VS, LL, PP, N0, AN, WEAR, WEARL,
 WK, WX, WMU, IA, IXX, IW, IG, NN2, DISK) = range(34)
# states: 0..6 maxwell forces, 7 dmax, 8 attached, 9 hyst z, 10 z1, 11 z2, 12 last Fe, 13 slid distance, 14 last elastic depth
NS = 16


def law(**kw):
    p = np.zeros(len(NAMES))
    p[NN] = 1.0; p[SL] = 1e-3; p[ADHL] = 1e-4; p[HYL] = 1e-3; p[VS] = 1.0; p[LL] = 1e-4; p[N0] = 1.0; p[WEARL] = 1.0; p[IW] = 1.0
    for i in range(NB):
        p[B0 + 2 * i + 1] = 1.0
    for a, b in kw.items():
        p[IX[a]] = b
    return p


@njit(cache=True)
def elastic(p, d, t, x):
    if d <= 0:
        return 0.0
    f = p[K] * d ** p[NN]
    if p[K2] > 0 and d > p[DB]:
        f += p[K2] * (d - p[DB])
    f *= 1 + p[ALPHA] * t / 60.0
    if p[IA] != 0 or p[IG] != 0:
        u = (x - p[IXX]) / p[IW]
        f *= 1 + p[IA] * np.exp(-0.5 * u * u) + p[IG] * x
    return f


@njit(cache=True)
def law_step(p, st, dt, t, d0, dd0, x, y, vx, vy):
    """force of the material on the tool: N, T1, T2; depth d0 and its rate, slips and slip rates"""
    d = d0 + p[Z0]
    dd = dd0
    if p[COMP] > 0 and d > 0:          # series spring: Newton on F = Fe(d - C F)
        F = elastic(p, d, t, x)
        lo = 0.0
        hi = F
        for _ in range(40):
            m = 0.5 * (lo + hi)
            if elastic(p, d - p[COMP] * m, t, x) > m:
                lo = m
            else:
                hi = m
        d = d - p[COMP] * 0.5 * (lo + hi)
        dd = (d - st[14]) / dt if st[14] > 0 else 0.0
        st[14] = d
    else:
        st[14] = 0.0
    Fe = elastic(p, d, t, x)
    if d > st[7]:
        st[7] = d
    if p[SR] > 0 and d > 0:
        Fe *= 1 - p[SR] * (1 - np.exp(-(st[7] - d) / p[SL]))
    dF = Fe - st[12]
    st[12] = Fe
    N = Fe
    for i in range(NB):
        b = p[B0 + 2 * i]
        if b != 0:
            tau = p[B0 + 2 * i + 1]
            st[i] = (st[i] + b * dF) / (1 + dt / tau)
            N += st[i]
    if p[HYA] > 0:
        if d > 0:
            st[9] = (st[9] + dd * dt / p[HYL]) / (1 + abs(dd) * dt / p[HYL])
            N += p[HYA] * st[9]
        else:
            st[9] = 0.0
    if d > 0:
        N += p[CC] * dd + p[LAM] * Fe * dd
    if p[ADH] > 0:
        if d > 0:
            st[8] = 1.0
            N = max(N, 0.0) - p[ADH]
        elif st[8] > 0:
            if d < -p[ADHL]:
                st[8] = 0.0
                N = 0.0
            else:
                N = -p[ADH] * (1 + d / p[ADHL])
        else:
            N = 0.0
    elif N < 0 or d <= 0:
        N = 0.0
    # friction: Dahl bristle of length L, level by speed, load, direction, wear
    v = np.sqrt(vx * vx + vy * vy)
    T1 = 0.0
    T2 = 0.0
    if N > 0:
        h = v * dt / p[LL]
        st[10] = (st[10] + vx * dt / p[LL]) / (1 + h)
        st[11] = (st[11] + vy * dt / p[LL]) / (1 + h)
        st[13] += v * dt
        mu = p[MU] + p[DMU] * np.exp(-(v / p[VS]) ** 2)
        if p[WEAR] != 0:
            mu += p[WEAR] * np.exp(-st[13] / p[WEARL])
        if p[PP] != 0:
            mu *= (N / p[N0]) ** p[PP]
        T1 = -mu * N * st[10] * (1 + p[AN]) - p[CV] * vx
        T2 = -mu * N * st[11] * (1 - p[AN]) - p[CV] * vy
        if p[WK] > 0 and x > p[WX]:
            T1 -= p[WK] * (x - p[WX])
            T2 -= p[WMU] * p[WK] * (x - p[WX]) * st[11]
    else:
        st[10] = 0.0
        st[11] = 0.0
    return N, T1, T2


@njit(cache=True)
def drive_law(p, t, d, dd, x, y, vx, vy):
    n = len(t)
    st = np.zeros(NS)
    out = np.zeros((n, 3))
    for i in range(n):
        dt = t[i] - t[i - 1] if i else t[1] - t[0]
        a, b, c = law_step(p, st, dt, t[i], d[i], dd[i], x[i], y[i], vx[i], vy[i])
        out[i, 0] = a; out[i, 1] = b; out[i, 2] = c
    return out


# ---------- chain ----------
def rpy(r, p, y):
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]])


@njit(cache=True)
def axrot(a, q, R):
    c = np.cos(q); s = np.sin(q); v = 1 - c
    x, y, z = a[0], a[1], a[2]
    R[0, 0] = c + x * x * v; R[0, 1] = x * y * v - z * s; R[0, 2] = x * z * v + y * s
    R[1, 0] = y * x * v + z * s; R[1, 1] = c + y * y * v; R[1, 2] = y * z * v - x * s
    R[2, 0] = z * x * v - y * s; R[2, 1] = z * y * v + x * s; R[2, 2] = c + z * z * v


@njit(cache=True)
def mm(A, B, C):
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@njit(cache=True)
def mtv(A, b, c):
    for i in range(3):
        c[i] = A[0, i] * b[0] + A[1, i] * b[1] + A[2, i] * b[2]


@njit(cache=True)
def mv(A, b, c):
    for i in range(3):
        c[i] = A[i, 0] * b[0] + A[i, 1] * b[1] + A[i, 2] * b[2]


@njit(cache=True)
def crs(a, b, c):
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def rnea(Rf, pf, ax, m, com, I, q, dq, ddq, g, fe, ne, tau, R, w, al, a, f, nn):
    """tau for motion; fe, ne: external force and moment on the last link, in its frame at its origin"""
    n = len(q)
    Rq = np.empty((3, 3))
    u = np.empty(3); u2 = np.empty(3); u3 = np.empty(3)
    wp = np.zeros(3); alp = np.zeros(3); ap = np.empty(3)
    for k in range(3):
        ap[k] = -g[k]
    for i in range(n):
        axrot(ax[i], q[i], Rq)
        mm(Rf[i], Rq, R[i])
        crs(alp, pf[i], u); crs(wp, pf[i], u2); crs(wp, u2, u3)
        for k in range(3):
            u[k] += ap[k] + u3[k]
        mtv(R[i], u, a[i])
        mtv(R[i], wp, u)
        mtv(R[i], alp, u2)
        crs(u, ax[i], u3)
        for k in range(3):
            w[i, k] = u[k] + ax[i, k] * dq[i]
            al[i, k] = u2[k] + u3[k] * dq[i] + ax[i, k] * ddq[i]
        wp = w[i]; alp = al[i]; ap = a[i]
        crs(al[i], com[i], u); crs(w[i], com[i], u2); crs(w[i], u2, u3)
        for k in range(3):
            f[i, k] = m[i] * (a[i, k] + u[k] + u3[k])
        mv(I[i], al[i], u); mv(I[i], w[i], u2); crs(w[i], u2, u3)
        crs(com[i], f[i], u2)
        for k in range(3):
            nn[i, k] = u[k] + u3[k] + u2[k]
    for k in range(3):
        f[n - 1, k] -= fe[k]
        nn[n - 1, k] -= ne[k]
    for i in range(n - 1, -1, -1):
        tau[i] = ax[i, 0] * nn[i, 0] + ax[i, 1] * nn[i, 1] + ax[i, 2] * nn[i, 2]
        if i:
            mv(R[i], f[i], u); mv(R[i], nn[i], u2); crs(pf[i], u, u3)
            for k in range(3):
                f[i - 1, k] += u[k]
                nn[i - 1, k] += u2[k] + u3[k]


@njit(cache=True)
def fk(Rf, pf, ax, q, pt, R, p, J, Jr, O, A):
    """pose of the point pt on the last link and its jacobians (world)"""
    n = len(q)
    Rq = np.empty((3, 3)); S = np.empty((3, 3)); u = np.empty(3)
    for i in range(3):
        for j in range(3):
            R[i, j] = 1.0 if i == j else 0.0
        p[i] = 0.0
    for i in range(n):
        mv(R, pf[i], u)
        for k in range(3):
            p[k] += u[k]
            O[i, k] = p[k]
        mm(R, Rf[i], S)
        axrot(ax[i], q[i], Rq)
        mm(S, Rq, R)
        mv(R, ax[i], u)
        for k in range(3):
            A[i, k] = u[k]
    mv(R, pt, u)
    for k in range(3):
        p[k] += u[k]
    for i in range(n):
        dx = p[0] - O[i, 0]; dy = p[1] - O[i, 1]; dz = p[2] - O[i, 2]
        J[0, i] = A[i, 1] * dz - A[i, 2] * dy
        J[1, i] = A[i, 2] * dx - A[i, 0] * dz
        J[2, i] = A[i, 0] * dy - A[i, 1] * dx
        for k in range(3):
            Jr[k, i] = A[i, k]


@njit(cache=True)
def solve_spd(A, b, n):
    L = A.copy()
    x = b.copy()
    for j in range(n):
        for k in range(j):
            L[j, j] -= L[j, k] * L[j, k]
        L[j, j] = np.sqrt(L[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] /= L[j, j]
    for i in range(n):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return x


@njit(cache=True)
def simulate(Rf, pf, ax, m, com, I, rotor, g, pt, qd, dqd, ddqd, dt, Kp, Kd, Ki, fric, contact, P, spt, sn, s1, s2, keep):
    """closed loop; fric (n,6): coulomb, viscous, load share, stribeck height, stribeck speed, bristle [rad].
    returns q, dq, ddq, tau(actuator), N T1 T2 at every keep-th step"""
    ns, n = qd.shape
    no = ns // keep
    oq = np.zeros((no, n)); od = np.zeros((no, n)); oa = np.zeros((no, n)); ot = np.zeros((no, n)); of = np.zeros((no, 3))
    q = qd[0].copy(); dq = dqd[0].copy(); ddq = np.zeros(n)
    R = np.zeros((n, 3, 3)); w = np.zeros((n, 3)); al = np.zeros((n, 3)); a = np.zeros((n, 3)); f = np.zeros((n, 3)); nn = np.zeros((n, 3))
    h = np.zeros(n); col = np.zeros(n); M = np.zeros((n, n)); e = np.zeros(n); z0 = np.zeros(n); z3 = np.zeros(3)
    Rt = np.zeros((3, 3)); p = np.zeros(3); J = np.zeros((3, n)); Jr = np.zeros((3, n)); O = np.zeros((n, 3)); A = np.zeros((n, 3))
    zb = np.zeros(n); ie = np.zeros(n); st = np.zeros(NS); load = np.zeros(n); rhs = np.zeros(n); tau = np.zeros(n); ff = np.zeros(n)
    fc = np.zeros(3)
    for s in range(ns):
        t = s * dt
        if s % 10 == 0:
            for j in range(n):
                for k in range(n):
                    e[k] = 0.0
                e[j] = 1.0
                rnea(Rf, pf, ax, m, com, I, q, z0, e, z3, z3, z3, col, R, w, al, a, f, nn)
                for k in range(n):
                    M[k, j] = col[k]
                M[j, j] += rotor[j]
        rnea(Rf, pf, ax, m, com, I, q, dq, z0, g, z3, z3, h, R, w, al, a, f, nn)
        N = 0.0; T1 = 0.0; T2 = 0.0
        if contact:
            fk(Rf, pf, ax, q, pt, Rt, p, J, Jr, O, A)
            v0 = 0.0; v1 = 0.0; v2 = 0.0; d = 0.0; x = 0.0; y = 0.0
            for k in range(3):
                vk = 0.0
                for i in range(n):
                    vk += J[k, i] * dq[i]
                r = p[k] - spt[k]
                d -= r * sn[k]; x += r * s1[k]; y += r * s2[k]
                v0 -= vk * sn[k]; v1 += vk * s1[k]; v2 += vk * s2[k]
            N, T1, T2 = law_step(P, st, dt, t, d, v0, x, y, v1, v2)
            for k in range(3):
                fc[k] = N * sn[k] + T1 * s1[k] + T2 * s2[k]
        for i in range(n):
            er = qd[s, i] - q[i]
            ie[i] += er * dt
            acc = 0.0
            for k in range(n):
                acc += M[i, k] * ddqd[s, k]
            tau[i] = Kp[i] * er + Kd[i] * (dqd[s, i] - dq[i]) + Ki[i] * ie[i] + h[i] + acc + fric[i, 1] * dqd[s, i] + fric[i, 6] * np.tanh(dqd[s, i] / 0.02)
            hh = abs(dq[i]) * dt / fric[i, 5]
            zb[i] = (zb[i] + dq[i] * dt / fric[i, 5]) / (1 + hh)
            fr = (fric[i, 0] + fric[i, 2] * abs(load[i]) + fric[i, 3] * np.exp(-(dq[i] / fric[i, 4]) ** 2)) * zb[i] + fric[i, 1] * dq[i]
            x = 0.0
            if contact:
                for k in range(3):
                    x += J[k, i] * fc[k]
            rhs[i] = tau[i] - fr - h[i] + x
            ff[i] = fr
        ddq = solve_spd(M, rhs, n)
        for i in range(n):
            load[i] = tau[i] - ff[i] - rotor[i] * ddq[i]        # what is transmitted to the links
        if s % keep == 0 and s // keep < no:
            o = s // keep
            for i in range(n):
                oq[o, i] = q[i]; od[o, i] = dq[i]; oa[o, i] = ddq[i]; ot[o, i] = tau[i]
            of[o, 0] = N; of[o, 1] = T1; of[o, 2] = T2
        for i in range(n):
            dq[i] += dt * ddq[i]
            q[i] += dt * dq[i]
    return oq, od, oa, ot, of


@njit(cache=True)
def frames(Rf, pf, ax, q, dq, ddq, g, Rs, ps, com):
    """sensor rotation, sensor origin, angular velocity and acceleration and (g - a_com), the last three in sensor axes"""
    N, n = q.shape
    R = np.zeros((n, 3, 3)); w = np.zeros((n, 3)); al = np.zeros((n, 3)); a = np.zeros((n, 3)); f = np.zeros((n, 3)); nn = np.zeros((n, 3))
    tau = np.zeros(n); m = np.zeros(n); c = np.zeros((n, 3)); I = np.zeros((n, 3, 3)); z3 = np.zeros(3)
    Rt = np.zeros((3, 3)); p = np.zeros(3); J = np.zeros((3, n)); Jr = np.zeros((3, n)); O = np.zeros((n, 3)); A = np.zeros((n, 3))
    oR = np.zeros((N, 3, 3)); op = np.zeros((N, 3)); ow = np.zeros((N, 3)); oal = np.zeros((N, 3)); og = np.zeros((N, 3))
    u = np.zeros(3); u2 = np.zeros(3); u3 = np.zeros(3); cl = np.zeros(3)
    mv(Rs, com, cl)
    for k in range(3):
        cl[k] += ps[k]
    for i in range(N):
        rnea(Rf, pf, ax, m, c, I, q[i], dq[i], ddq[i], g, z3, z3, tau, R, w, al, a, f, nn)
        fk(Rf, pf, ax, q[i], ps, Rt, p, J, Jr, O, A)
        mm(Rt, Rs, oR[i])
        for k in range(3):
            op[i, k] = p[k]
        crs(al[n - 1], cl, u); crs(w[n - 1], cl, u2); crs(w[n - 1], u2, u3)
        for k in range(3):
            u[k] = -(a[n - 1, k] + u[k] + u3[k])      # a already holds -g
        mtv(Rs, u, og[i])
        mtv(Rs, w[n - 1], ow[i])
        mtv(Rs, al[n - 1], oal[i])
    return oR, op, ow, oal, og


@njit(cache=True)
def ik_path(Rf, pf, ax, pt, Rtl, q0, P, Rd, wr):
    """follow poses: tip position P and tool rotation Rd (columns of tip axes; Rtl: tool rotation in the last link)"""
    N = len(P); n = len(q0)
    out = np.zeros((N, n)); q = q0.copy()
    R = np.zeros((3, 3)); p = np.zeros(3); J = np.zeros((3, n)); Jr = np.zeros((3, n)); O = np.zeros((n, 3)); A = np.zeros((n, 3))
    S = np.zeros((3, 3)); worst = 0.0
    for i in range(N):
        its = 300 if i == 0 else 4
        for it in range(its):
            fk(Rf, pf, ax, q, pt, R, p, J, Jr, O, A)
            mm(R, Rtl, S)
            e = np.zeros(6)
            for k in range(3):
                e[k] = P[i, k] - p[k]
            for c in range(3):
                e[3] += 0.5 * (S[1, c] * Rd[i, 2, c] - S[2, c] * Rd[i, 1, c]) * wr
                e[4] += 0.5 * (S[2, c] * Rd[i, 0, c] - S[0, c] * Rd[i, 2, c]) * wr
                e[5] += 0.5 * (S[0, c] * Rd[i, 1, c] - S[1, c] * Rd[i, 0, c]) * wr
            JJ = np.zeros((6, n))
            for a in range(n):
                for k in range(3):
                    JJ[k, a] = J[k, a]
                    JJ[3 + k, a] = Jr[k, a] * wr
            H = np.zeros((n, n)); b = np.zeros(n)
            for a in range(n):
                for c in range(n):
                    for k in range(6):
                        H[a, c] += JJ[k, a] * JJ[k, c]
                H[a, a] += 1e-6
                for k in range(6):
                    b[a] += JJ[k, a] * e[k]
            q = q + solve_spd(H, b, n)
        er = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
        if er > worst:
            worst = er
        out[i] = q
    return out, worst


# ---------- robots ----------
class Arm:
    def __init__(self, name, joints, links, sensor, tip, home):
        self.name, self.joints, self.links = name, joints, links
        self.n = len(joints)
        self.Rf = np.array([rpy(*j[1]) for j in joints]); self.pf = np.array([j[0] for j in joints], float)
        self.ax = np.array([j[2] for j in joints], float)
        self.m = np.array([l[0] for l in links], float); self.com = np.array([l[1] for l in links], float)
        self.I = np.array([l[2] for l in links], float)
        self.sensor_xyz, self.sensor_rpy = np.array(sensor[0], float), sensor[1]
        self.Rs = rpy(*sensor[1]); self.tip = np.array(tip, float); self.home = np.array(home, float)

    def chain(self):
        return self.Rf, self.pf, self.ax

    def body(self, tool=None):
        """inertias with the tool (mass, com in the sensor frame, 3x3 inertia) merged into the last link"""
        m, c, I = self.m.copy(), self.com.copy(), self.I.copy()
        if tool is not None:
            mt, ct, It = tool
            ct = self.sensor_xyz + self.Rs @ ct
            It = self.Rs @ It @ self.Rs.T
            M = m[-1] + mt
            cn = (m[-1] * c[-1] + mt * ct) / M
            St = lambda a: (a @ a) * np.eye(3) - np.outer(a, a)
            I[-1] = I[-1] + m[-1] * St(c[-1] - cn) + It + mt * St(ct - cn)
            m[-1], c[-1] = M, cn
        return m, c, I

    def tip_on_link(self, off=np.zeros(3)):
        return self.sensor_xyz + self.Rs @ (self.tip + off)

    def urdf(self, body=None):
        m, c, I = body if body is not None else (self.m, self.com, self.I)
        s = [f'<?xml version="1.0"?>', f'<robot name="{self.name}">', '  <link name="base_link"/>']
        v = lambda a: " ".join("%.9g" % x for x in a)
        for i, j in enumerate(self.joints):
            J = I[i]
            s += [f'  <link name="link_{i+1}"><inertial><origin xyz="{v(c[i])}" rpy="0 0 0"/><mass value="{m[i]:.9g}"/>'
                  f'<inertia ixx="{J[0,0]:.9g}" ixy="{J[0,1]:.9g}" ixz="{J[0,2]:.9g}" iyy="{J[1,1]:.9g}" iyz="{J[1,2]:.9g}" izz="{J[2,2]:.9g}"/></inertial></link>']
            par = "base_link" if i == 0 else f"link_{i}"
            s += [f'  <joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{v(j[0])}" rpy="{v(j[1])}"/>'
                  f'<axis xyz="{v(j[2])}"/><limit lower="-6.2832" upper="6.2832" effort="400" velocity="6"/></joint>']
        s += ['  <link name="ft_sensor"/>', f'  <joint name="ft_mount" type="fixed"><parent link="link_{self.n}"/><child link="ft_sensor"/>'
              f'<origin xyz="{v(self.sensor_xyz)}" rpy="{v(self.sensor_rpy)}"/></joint>',
              '  <link name="tool_tip"/>', f'  <joint name="tool_mount" type="fixed"><parent link="ft_sensor"/><child link="tool_tip"/>'
              f'<origin xyz="{v(self.tip)}" rpy="0 0 0"/></joint>', '</robot>', '']
        return "\n".join(s)


def rod(m, a, r=0.05):
    """inertia of a cylinder along vector a about its centre"""
    a = np.asarray(a, float); l = np.linalg.norm(a); u = a / l
    return m * r * r / 2 * np.outer(u, u) + m * (l * l / 12 + r * r / 4) * (np.eye(3) - np.outer(u, u))


def heron6(tip=0.12, mount=0.35):
    J = [((0, 0, 0.18), (0, 0, 0), (0, 0, 1)), ((0.03, 0, 0.22), (0, 0, 0), (0, 1, 0)), ((0, 0, 0.42), (0, 0, 0), (0, 1, 0)),
         ((0.20, 0, 0.02), (0, 0, 0), (1, 0, 0)), ((0.18, 0, 0), (0, 0, 0), (0, 1, 0)), ((0.06, 0, 0), (0, 0, 0), (1, 0, 0))]
    L = [(5.5, (0, -.01, .12), rod(5.5, (0, 0, .25), .08)), (6.8, (.005, .06, .19), rod(6.8, (0, 0, .42), .06)), (3.6, (.07, -.01, .015), rod(3.6, (.22, 0, 0), .05)),
         (2.1, (.08, .004, 0), rod(2.1, (.2, 0, 0), .04)), (1.3, (.02, 0, .003), rod(1.3, (.08, 0, 0), .035)), (.45, (.012, .001, 0), rod(.45, (.03, 0, 0), .03))]
    return Arm("heron6", J, L, ((.03, 0, 0), (mount, np.pi / 2, 0)), (0, 0, tip), (0, .25, .2, 0, np.pi / 2 - .45, 0))


def loon7(tip=0.11, mount=0.0):
    """seven axes, offsets and inertias of lwr4plus.md"""
    import json
    import os
    D = json.load(open(os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "foundry", "lwr4plus_inertia.json")))
    off = [.11, .2005, .2, .2, .2, .19, .078]
    axs = [(0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1)]
    J = [((0, 0, o), (0, 0, 0), a) for o, a in zip(off, axs)]
    L = []
    for d in D:
        a, b, c, e, f, g = d["I"]
        L.append((d["m"], d["com"], np.array([[a, e, f], [e, b, g], [f, g, c]])))
    return Arm("loon7", J, L, ((0, 0, .0122), (0, 0, mount)), (0, 0, tip), (0, -.5, 0, 1.5, 0, -1.14, 0))


def crane3(tip=0.09):
    """three vertical axes: a SCARA without its lift, pressing against a wall"""
    J = [((0, 0, .30), (0, 0, 0), (0, 0, 1)), ((.35, 0, .05), (0, 0, 0), (0, 0, 1)), ((.30, 0, -.03), (0, 0, 0), (0, 0, 1))]
    L = [(7.0, (.17, 0, .02), rod(7., (.35, 0, 0), .06)), (4.2, (.14, .005, 0), rod(4.2, (.3, 0, 0), .05)), (1.1, (.03, 0, 0), rod(1.1, (.06, 0, 0), .04))]
    return Arm("crane3", J, L, ((.06, 0, 0), (np.pi / 2, 0, np.pi / 2)), (0, 0, tip), (.9, -1.5, .6))


# ---------- single drive and sled ----------
@njit(cache=True)
def sim_drive(qd, dqd, ddqd, dt, I, Ihat, fc, fv, fst, vst, L, rA, rk, rph, warm, tw, spring, Kp, Kd, keep):
    """one axis on a vertical shaft: torque of the actuator at every keep-th step"""
    ns = len(qd); no = ns // keep
    o = np.zeros((no, 4))
    q = qd[0]; v = dqd[0]; z = 0.0
    for s in range(ns):
        w = 1 - warm * (1 - np.exp(-s * dt / tw))
        h = abs(v) * dt / L
        z = (z + v * dt / L) / (1 + h)
        fr = w * ((fc + fst * np.exp(-(v / vst) ** 2)) * z + fv * v)
        ld = rA * np.sin(rk * q + rph) + spring * q
        tau = Kp * (qd[s] - q) + Kd * (dqd[s] - v) + Ihat * ddqd[s] + 0.9 * fc * np.tanh(dqd[s] / 0.05)
        a = (tau - fr - ld) / I
        if s % keep == 0 and s // keep < no:
            k = s // keep
            o[k, 0] = q; o[k, 1] = v; o[k, 2] = a; o[k, 3] = tau
        v += dt * a
        q += dt * v
    return o


@njit(cache=True)
def sim_sled(P, t, dt, d, dd, xs, vs, mass, ks, cs, keep):
    """a sled dragged over the material by a spring: stick-slip where it wants to"""
    ns = len(d); no = ns // keep
    o = np.zeros((no, 6)); st = np.zeros(NS)
    x = xs[0]; v = 0.0
    for s in range(ns):
        N, T, _ = law_step(P, st, dt, t[s], d[s], dd[s], x, 0.0, v, 0.0)
        a = (ks * (xs[s] - x) + cs * (vs[s] - v) + T) / mass
        if s % keep == 0 and s // keep < no:
            k = s // keep
            o[k, 0] = d[s]; o[k, 1] = dd[s]; o[k, 2] = x; o[k, 3] = v; o[k, 4] = N; o[k, 5] = T
        v += dt * a
        x += dt * v
    return o


@njit(cache=True)
def lattice(t, dt, d, nm, mass, ks, kg, cs, keep):
    """a chain of masses under the indenter (first node moves with it while it presses), each on its own ground spring"""
    ns = len(d); no = ns // keep
    o = np.zeros(no); u = np.zeros(nm); w = np.zeros(nm)
    for s in range(ns):
        top = max(d[s], 0.0)
        F = ks * (top - u[0])
        if s % keep == 0 and s // keep < no:
            o[s // keep] = F
        for i in range(nm):
            f = -kg * u[i] - cs * w[i]
            f += ks * ((top if i == 0 else u[i - 1]) - u[i])
            if i + 1 < nm:
                f += ks * (u[i + 1] - u[i])
            w[i] += dt * f / mass
        for i in range(nm):
            u[i] += dt * w[i]
    return o


@njit(cache=True)
def lowpass(x, dt, tau):
    y = np.empty_like(x)
    y[0] = x[0]
    a = 1 - np.exp(-dt / tau)
    for i in range(1, len(x)):
        y[i] = y[i - 1] + a * (x[i] - y[i - 1])
    return y
