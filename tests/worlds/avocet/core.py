"""Numeric kernels: arm kinematics/dynamics (world-frame Newton-Euler) and the contact law."""
import numpy as np
from numba import njit


@njit(cache=True)
def rot(ax, a):
    c, s = np.cos(a), np.sin(a)
    x, y, z = ax
    C = 1 - c
    return np.array([[c + x * x * C, x * y * C - z * s, x * z * C + y * s],
                     [y * x * C + z * s, c + y * y * C, y * z * C - x * s],
                     [z * x * C - y * s, z * y * C + x * s, c + z * z * C]])


@njit(cache=True)
def cr(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def arm(q, dq, ddq, RP, pP, AX, M, COM, INE, Rs, ps, tip, g, tm, tcom, tI, fc):
    """RP,pP: joint placements; Rs,ps: sensor in the last joint; tip: in the sensor frame; fc: contact force at the tip (world).
    Returns tau, R(sensor), tip position, omega, alpha, acceleration of the sensor's origin (world, without gravity)."""
    n, J = q.shape
    tau = np.zeros((n, J))
    R_o = np.zeros((n, 3, 3)); p_o = np.zeros((n, 3)); w_o = np.zeros((n, 3)); al_o = np.zeros((n, 3)); a_o = np.zeros((n, 3))
    z = np.zeros((J, 3)); P = np.zeros((J, 3)); F = np.zeros((J, 3)); T = np.zeros((J, 3)); C = np.zeros((J, 3))
    for i in range(n):
        R = np.eye(3); p = np.zeros(3); w = np.zeros(3); al = np.zeros(3); a = np.zeros(3)
        for j in range(J):
            d = R @ pP[j]
            a = a + cr(al, d) + cr(w, cr(w, d))
            p = p + d
            R = R @ RP[j]
            zj = R @ AX[j]
            al = al + zj * ddq[i, j] + cr(w, zj) * dq[i, j]
            w = w + zj * dq[i, j]
            R = R @ rot(AX[j], q[i, j])
            c = R @ COM[j]
            ac = a + cr(al, c) + cr(w, cr(w, c))
            Iw = R @ INE[j] @ R.T
            z[j] = zj; P[j] = p; C[j] = p + c
            F[j] = M[j] * (ac - g)
            T[j] = Iw @ al + cr(w, Iw @ w)
        d = R @ ps
        a = a + cr(al, d) + cr(w, cr(w, d))
        p = p + d
        R = R @ Rs
        pt = p + R @ tip
        R_o[i] = R; p_o[i] = pt; w_o[i] = w; al_o[i] = al; a_o[i] = a
        c = R @ tcom
        ac = a + cr(al, c) + cr(w, cr(w, c))
        Iw = R @ tI @ R.T
        f = tm * (ac - g)
        t = Iw @ al + cr(w, Iw @ w) + cr(p + c, f) + cr(pt, -fc[i])    # about the base's origin
        f = f - fc[i]
        for jj in range(J):
            j = J - 1 - jj
            f = f + F[j]
            t = t + T[j] + cr(C[j], F[j])
            tau[i, j] = z[j] @ (t - cr(P[j], f))
    return tau, R_o, p_o, w_o, al_o, a_o


# names of the contact law's parameters, in the order of the kernel's vector
CP = ["k", "n", "e", "c", "lam", "rho1", "tau1", "rho2", "tau2", "K2", "db", "sr", "sl", "drift", "g1", "g2", "ba", "bx", "by", "bw",
      "hr", "ha", "hl", "Fa", "Fl", "C", "mu", "pl", "vs", "dmu", "cv", "vr", "p", "an", "kind", "wid", "K1n", "K2n",
      "plast", "fat", "ktime", "plough", "addm", "buck", "dbuck", "age", "agetau"]
CD = dict(k=1000., n=1., e=1., c=0., lam=0., rho1=0., tau1=1., rho2=0., tau2=1., K2=0., db=1., sr=0., sl=1e-3, drift=0., g1=0., g2=0.,
          ba=0., bx=0., by=0., bw=.005, hr=0., ha=0., hl=1e-3, Fa=0., Fl=1e-3, C=0., mu=0., pl=1e-4, vs=.005, dmu=0., cv=0., vr=0., p=0.,
          an=0., kind=0., wid=0., K1n=0., K2n=0., plast=0., fat=0., ktime=1., plough=0., addm=0., buck=0., dbuck=1., age=0., agetau=1.)


@njit(cache=True)
def law(t, de, dd, s1, s2, v1, v2, acc, P):
    k, n, e, c, lam, rho1, tau1, rho2, tau2 = P[0], P[1], P[2], P[3], P[4], P[5], P[6], P[7], P[8]
    K2, db, sr, sl, drift, g1, g2, ba, bx, by, bw = P[9], P[10], P[11], P[12], P[13], P[14], P[15], P[16], P[17], P[18], P[19]
    hr, ha, hl, Fa, Fl, C, mu, pl, vs, dmu, cv, vr, p, an = P[20], P[21], P[22], P[23], P[24], P[25], P[26], P[27], P[28], P[29], P[30], P[31], P[32], P[33]
    kind, wid, K1n, K2n, plast, plough, addm, buck, dbuck, age, agetau = P[34], P[35], P[36], P[37], P[38], P[41], P[42], P[43], P[44], P[45], P[46]
    m = len(t)
    N = np.zeros(m); T1 = np.zeros(m); T2 = np.zeros(m)
    y1 = 0.; y2 = 0.; dm = 0.; zh = 0.; u1 = 0.; u2 = 0.; bond = False; Np = 0.; dprev = de[0]; dp = 0.; rest = 0.
    for i in range(m):
        dt = t[i] - t[i - 1] if i > 0 else 0.
        it = 1
        if C > 0: it = 12
        Nn = Np
        d = de[i]
        for kk in range(it):
            d = de[i] - C * Nn - dp
            Fe = 0.
            if d > 0:
                Fe = k * d ** n
                if d > db: Fe += K2 * (d - db)
                if buck > 0 and d > dbuck: Fe -= buck * k * (d - dbuck) / (1 + 400 * (d - dbuck))
                if sr > 0: Fe *= 1 - sr * (1 - np.exp(-(max(dm, d) - d) / sl))
                Fe *= 1 + drift * t[i] / 60
                sx, sy = s1[i], s2[i]
                if ba != 0: Fe *= 1 + ba * np.exp(-((sx - bx) ** 2 + (sy - by) ** 2) / (2 * bw * bw))
                Fe *= 1 + g1 * sx + g2 * sy
            Ni = e * Fe
            rx = 0.
            if rho1 > 0: rx += rho1 * (Fe - (y1 + (Fe - y1) * (1 - np.exp(-dt / tau1))))
            if rho2 > 0: rx += rho2 * (Fe - (y2 + (Fe - y2) * (1 - np.exp(-dt / tau2))))
            Ni += max(rx, -Fe)
            if d > 0: Ni += c * dd[i] + lam * Fe * dd[i] + addm * acc[i]
            zz = zh
            if hr > 0 or ha > 0:
                x = d - dprev
                if x > 0: zz = 1 - (1 - zh) * np.exp(-x / hl)
                else: zz = -1 + (1 + zh) * np.exp(x / hl)
                Ni += min(hr * Fe + ha, Fe) * zz
            if Ni < 0: Ni = 0.
            if it > 1: Nn = 0.5 * Nn + 0.5 * Ni if kk < it - 1 else Ni
            else: Nn = Ni
        zh = zz if d > 0 else 0.
        y1 += (Fe - y1) * (1 - np.exp(-dt / tau1)); y2 += (Fe - y2) * (1 - np.exp(-dt / tau2))
        if d > dm: dm = d
        if plast > 0 and d > 0:      # yield: a dent that grows with plastic flow
            r = plast * (dm + dp) - dp
            if r > 0: dp += r
        dprev = d; Np = Nn
        Na = Nn
        if Fa > 0:                   # linear cohesive zone
            if d > 0: bond = True
            if bond:
                if d > 0: Na = Nn - Fa
                elif d > -Fl: Na = -Fa * (1 + d / Fl)
                else: bond = False
        N[i] = Na
        touch = d > 0
        sp = np.sqrt(v1[i] ** 2 + v2[i] ** 2)
        if touch:
            if vr > 0:
                u1 = v1[i] / np.sqrt(sp * sp + vr * vr); u2 = v2[i] / np.sqrt(sp * sp + vr * vr)
            elif kind == 0:          # Dahl, exact along a step
                if sp > 1e-12:
                    g = np.exp(-sp * dt / pl)
                    u1 = u1 * g + v1[i] / sp * (1 - g); u2 = u2 * g + v2[i] / sp * (1 - g)
            else:                    # Prandtl: elastic, then slip
                u1 += v1[i] * dt / pl; u2 += v2[i] * dt / pl
                a = np.sqrt(u1 * u1 + u2 * u2)
                if a > 1: u1 /= a; u2 /= a
            m_ = mu
            if dmu > 0: m_ += dmu * np.exp(-(sp / vs) ** 2)
            if age > 0:
                if sp < 2e-4: rest = min(rest + dt, 30.)
                else: rest *= np.exp(-sp * dt / 1.5e-3)
                m_ += age * np.log(1 + rest / agetau)
            if p != 0: m_ *= max(Nn, 1e-6) ** p
            T1[i] = -m_ * (1 + an) * Nn * u1 - cv * v1[i] + K1n * d - plough * d * d * u1
            T2[i] = -m_ * (1 - an) * Nn * u2 - cv * v2[i] + K2n * d - plough * d * d * u2
        else:
            u1 = 0.; u2 = 0.
    return N, T1, T2


def pvec(**kw):
    d = dict(CD); d.update(kw)
    return np.array([float(d[x]) for x in CP])
