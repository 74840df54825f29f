"""Contact engine: a bed of springs (method of dimensionality reduction) under a tip that a servo with mass drives."""
import math
import numpy as np
from numba import njit

_N = ("KINF R1 T1 R2 T2 TD LAM HY1 HL1 HY2 HL2 HY3 HL3 MR MM ADH KL DB ALPHA G1 G2 INA INX INY INW EDA EDX EDW Z0 "
      "FT MU LS KT STD STV CV VR TAUR ANIS RUNA RUNL AGEB AGET AGED VIBA VIBF TXA TXL PLY PLR FOP FOS FOD SIG1 NRM NP").split()
globals().update({n: i for i, n in enumerate(_N)})


def params(**kw):
    P = np.zeros(len(_N))
    P[_N.index("KINF")] = 1.0
    for k, v in kw.items():
        P[_N.index(k)] = v
    return P


def bed(k, n, dmax, N=24, spread=0.0, rng=None):
    """stiffnesses w and heights g of springs such that F = k d^n (flat punch for n = 1; its rim rounded over `spread`)"""
    if n <= 1.0 + 1e-9:
        g = spread * np.linspace(0, 1, 8) ** 2
        return np.full(8, k / 8), g
    e = dmax * np.linspace(0, 1, N + 1) ** 2
    W = k * n * (e[1:] ** (n - 1) - e[:-1] ** (n - 1))
    c = (n - 1) / n * (e[1:] ** n - e[:-1] ** n) / (e[1:] ** (n - 1) - e[:-1] ** (n - 1))
    return W, c


@njit(cache=True)
def run(cmd, dt, sub, dyn, M, K, D, w, g, P):
    N = cmd.shape[0]; n = w.size
    X = np.zeros((N, 3)); A = np.zeros((N, 3)); F = np.zeros((N, 3))
    x = cmd[0].copy(); xp = x.copy(); v = np.zeros(3); a = np.zeros(3); f = np.zeros(3); c = np.zeros(3); cv = np.zeros(3)
    y1 = np.zeros(n); y2 = np.zeros(n); H = np.zeros((n, 3)); um = np.zeros(n); att = np.zeros(n); pl = np.zeros(n)
    up = np.zeros(n); s1 = np.zeros(n); s2 = np.zeros(n); fi = np.zeros(n)
    z1 = 0.0; z2 = 0.0; S = 0.0; th = 0.0; t = 0.0
    h = dt / sub
    e1 = 1 - math.exp(-h / P[T1]) if P[T1] > 0 else 0.0
    e2 = 1 - math.exp(-h / P[T2]) if P[T2] > 0 else 0.0
    glast = g[n - 1] if g[n - 1] > 0 else 1.0
    for k in range(N):
        k0 = k - 1 if k > 0 else 0
        for q in range(sub):
            b = (q + 1.0) / sub
            t = (k - 1 + b) * dt
            for j in range(3):
                c[j] = cmd[k0, j] * (1 - b) + cmd[k, j] * b
                cv[j] = (cmd[k, j] - cmd[k0, j]) / dt
                xp[j] = x[j]
                if dyn:
                    a[j] = (K * (c[j] - x[j]) + D * (cv[j] - v[j]) + f[j]) / M
                    v[j] += h * a[j]; x[j] += h * v[j]
                else:
                    nv = (c[j] - x[j]) / h
                    a[j] = 0.0; v[j] = nv; x[j] = c[j]
            d = -x[2] + P[Z0]
            if P[VIBA] != 0: d += P[VIBA] * math.sin(2 * math.pi * P[VIBF] * t)
            if P[TXA] != 0: d += P[TXA] * math.sin(2 * math.pi * x[0] / P[TXL])
            kf = 1 + P[ALPHA] * t / 60 + P[G1] * x[0] + P[G2] * x[1]
            if P[INA] != 0:
                kf *= 1 + P[INA] * math.exp(-((x[0] - P[INX]) ** 2 + (x[1] - P[INY]) ** 2) / (2 * P[INW] ** 2))
            if P[EDA] != 0:
                kf *= 1 + P[EDA] * 0.5 * (1 + math.tanh((x[0] - P[EDX]) / P[EDW]))
            Nf = 0.0; area = 0.0
            for i in range(n):
                u = d - g[i]
                if att[i] == 0 and u > 0: att[i] = 1.0
                ell = P[ADH] * (g[i] / glast) ** 0.25 if g[n - 1] > 1e-4 else P[ADH]
                if att[i] == 1 and u < -ell: att[i] = 0.0
                ff = 0.0
                if att[i] == 0:
                    u = 0.0
                    H[i, 0] = 0; H[i, 1] = 0; H[i, 2] = 0
                y1[i] += e1 * (u - y1[i]); y2[i] += e2 * (u - y2[i])
                du = u - up[i]; up[i] = u
                if att[i] == 1:
                    ue = u
                    if P[PLY] > 0:
                        pn = P[PLR] * (u - P[PLY])
                        if pn > pl[i]: pl[i] = pn
                        ue = u - pl[i]
                        if ue < 0: ue = 0.0
                    el = ue
                    if P[FOP] > 0 and ue > P[FOP]:
                        el = P[FOP] + P[FOS] * (ue - P[FOP])
                        if ue > P[FOD]: el += 1.5 * (ue - P[FOD])
                    if P[NRM] != 0: el *= 1 + P[NRM] * el
                    if P[DB] > 0 and u > P[DB]: el += P[KL] * (u - P[DB])
                    ff = P[KINF] * el
                    if P[MR] > 0:
                        W = 0.5 * u * u
                        if W > um[i]: um[i] = W
                        ff *= 1 - P[MR] * math.erf((um[i] - W) / P[MM])
                    ud = du / h
                    if P[LAM] != 0: ff *= 1 + P[LAM] * ud
                    ff += P[TD] * ud + P[R1] * (u - y1[i]) + P[R2] * (u - y2[i])
                    if P[HY1] > 0:
                        for j in range(3):
                            l = P[HL1 + 2 * j]
                            H[i, j] = min(max(H[i, j] + du, -l), l)
                            ff += P[HY1 + 2 * j] * H[i, j]
                    ff *= w[i] * kf
                    if P[ADH] == 0 and ff < 0: ff = 0.0
                    area = max(area, u)
                fi[i] = ff
                Nf += ff
            # tangential
            dx = x[0] - xp[0]; dy = x[1] - xp[1]; vs = math.sqrt(dx * dx + dy * dy) / h
            m = P[MU]; T1_ = 0.0; T2_ = 0.0
            Np = max(Nf, 0.0)
            if Np > 0: S += vs * h
            th += h * (1 - vs * th / P[AGED]) if P[AGED] > 0 else 0.0
            if Np > 1e-9 and m > 0:
                if P[STV] > 0: m += P[STD] / (1 + (vs / P[STV]) ** 2)
                if P[TAUR] > 0: m = P[TAUR] * area / Np
                if P[RUNA] != 0: m *= 1 + P[RUNA] * math.exp(-S / P[RUNL])
                if P[AGEB] != 0: m *= 1 + P[AGEB] * math.log(1 + max(th, 0.0) / P[AGET])
                m1 = m * (1 + P[ANIS]); m2 = m * (1 - P[ANIS])
                ft = int(P[FT])
                if ft == 0:                                       # each spring sticks and slips (Cattaneo-Mindlin / Prandtl)
                    for i in range(n):
                        fl = max(fi[i], 0.0)
                        if fl <= 0:
                            s1[i] = 0; s2[i] = 0
                        else:
                            kt = P[KT] * w[i]
                            s1[i] += dx; s2[i] += dy
                            r = math.sqrt((kt * s1[i] / (m1 * fl)) ** 2 + (kt * s2[i] / (m2 * fl)) ** 2)
                            if r > 1: s1[i] /= r; s2[i] /= r
                            T1_ -= kt * s1[i]; T2_ -= kt * s2[i]
                elif ft == 3:                                     # no bristle
                    if vs > 0:
                        q3 = math.tanh(vs / P[VR]) / vs
                        T1_ = -m1 * Np * q3 * dx / h; T2_ = -m2 * Np * q3 * dy / h
                else:                                             # Dahl (1), LuGre (2)
                    dec = math.exp(-vs * h / P[LS])
                    if vs > 0:
                        z1 = z1 * dec + (1 - dec) * dx / (vs * h); z2 = z2 * dec + (1 - dec) * dy / (vs * h)
                    T1_ = -m1 * Np * z1; T2_ = -m2 * Np * z2
                    if ft == 2:
                        T1_ -= P[SIG1] * Np * dx / h * math.exp(-(vs / 0.005) ** 2); T2_ -= P[SIG1] * Np * dy / h * math.exp(-(vs / 0.005) ** 2)
            else:
                z1 = 0.0; z2 = 0.0
                for i in range(n): s1[i] = 0; s2[i] = 0
            if Np > 0:
                T1_ -= P[CV] * dx / h; T2_ -= P[CV] * dy / h
            f[0] = T1_; f[1] = T2_; f[2] = Nf
        for j in range(3):
            X[k, j] = x[j]; A[k, j] = a[j]; F[k, j] = f[j]
    return X, A, F


@njit(cache=True)
def lowpass(x, dt, tau):
    y = x.copy(); e = 1 - math.exp(-dt / tau)
    for k in range(1, x.shape[0]):
        for j in range(x.shape[1]):
            y[k, j] = y[k - 1, j] + e * (0.5 * (x[k, j] + x[k - 1, j]) - y[k - 1, j])
    return y


@njit(cache=True)
def joint_friction(q, dt, Fc, ls, st, vs, load, dry, asym, visc, tl):
    """LuGre-type bristle along a joint's motion; friction limit with Stribeck excess and share of the transmitted load"""
    n = q.size; z = 0.0; o = np.zeros(n)
    for k in range(1, n):
        d = q[k] - q[k - 1]; v = d / dt; a = abs(d)
        lim = Fc + st / (1 + (v / vs) ** 2) + load * abs(tl[k])
        if a > 0:
            e = math.exp(-a / ls); z = z * e + (1 - e) * (1.0 if d > 0 else -1.0)
        o[k] = lim * z + dry * abs(z) + visc * v + asym * abs(v)
    return o


class Prog:
    """commands in the surface frame: [s1, s2, height, rx, ry, rz], 2 kHz"""
    def __init__(s, dt, start):
        s.dt = dt; s.c = [np.array(start, float)[None]]; s.p = [np.array(["free"])]

    @property
    def cur(s): return s.c[-1][-1]

    def _add(s, a, ph): s.c.append(a); s.p.append(np.full(len(a), ph))

    def hold(s, T, ph="hold"): s._add(np.repeat(s.cur[None], max(int(T / s.dt), 1), 0), ph)

    def move(s, T, ph, **k):
        b = s.cur.copy()
        for a, v in k.items(): b["s1 s2 h rx ry rz".split().index(a)] = v
        n = max(int(T / s.dt), 2); u = np.linspace(0, 1, n + 1)[1:, None]
        s._add(s.cur + (b - s.cur) * (10 * u**3 - 15 * u**4 + 6 * u**5), ph)

    def line(s, v, ph, ramp=0.05, **k):
        b = s.cur.copy()
        for a, val in k.items(): b["s1 s2 h rx ry rz".split().index(a)] = val
        L = np.linalg.norm((b - s.cur)[:3]); T = L / v + ramp
        n = max(int(T / s.dt), 3); t = np.linspace(0, T, n + 1)[1:]
        r = min(ramp, T / 2)
        sp = np.where(t < r, t * t / 2 / r, np.where(t < T - r, t - r / 2, (T - r) - (T - t) ** 2 / 2 / r)) / (T - r)
        s._add(s.cur + (b - s.cur) * sp[:, None], ph)

    def circle(s, R, v, turns, ph):
        T = 2 * np.pi * R * turns / v; n = int(T / s.dt); u = np.linspace(0, 1, n + 1)[1:]
        u = u - np.sin(2 * np.pi * u) / (2 * np.pi) * 0.3
        a = 2 * np.pi * turns * u; b = np.repeat(s.cur[None], n, 0)
        b[:, 0] += R * np.sin(a); b[:, 1] += R * (1 - np.cos(a)); s._add(b, ph)

    def done(s): return np.concatenate(s.c), np.concatenate(s.p)
