"""Spring bed (Winkler foundation, viscoelastic springs) with friction and a Cartesian impedance controller; catalogue replay.

World law (step): rings of the tip press springs p = s w^m; each spring carries Maxwell branches, Mullins softening (Dorfmann &
Ogden 2003 in spirit), a bottom layer, rupture. On the whole tip act dashpot, Hunt-Crossley damping (1975), Dahl-like hysteresis with exponent
(Dahl 1976), adhesion with constant traction over a gap (Maugis 1992). Friction: rounded, Dahl, Prandtl, LuGre (Canudas 1995),
elasto-plastic (Dupont 2002), rate-and-state limit (Dieterich 1979) on an elastic asperity.
Frame of the bed: x, y tangents, z out of the material; SI units throughout.
"""
from __future__ import annotations

import numpy as np
from numba import njit

NAMES = ["K", "N", "C", "LAM", "R1", "T1", "R2", "T2", "HA", "HL", "SR", "SL", "FA", "AL", "KB", "DB", "Z0", "ALPHA", "MU", "LB", "CV", "DMU",
         "VS", "VR", "PEXP", "N0", "ANI", "CC", "PT", "PA", "PX", "PW", "MODE", "RSA", "RSB", "DC", "WAVE", "WLEN", "LIFT", "PUNCT", "PLEFT",
         "OFFN", "NLS", "PLOUGH", "PLL"]
IX = {n: i for i, n in enumerate(NAMES)}
(K, N, C, LAM, R1, T1, R2, T2, HA, HL, SR, SL, FA, AL, KB, DB, Z0, ALPHA, MU, LB, CV, DMU, VS, VR, PEXP, N0, ANI, CC, PT, PA, PX, PW, MODE, RSA,
 RSB, DC, WAVE, WLEN, LIFT, PUNCT, PLEFT, OFFN, NLS, PLOUGH, PLL) = range(len(NAMES))
NS = 16   # scalar states: 0 zx, 1 zy, 2 theta, 3 hyst, 4 compliance, 5 bonded, 6 F_prev, 7 last sliding sign x, 8 y


def params(**kw: float) -> np.ndarray:
    """Parameter vector with neutral defaults."""
    p = np.zeros(len(NAMES))
    for k, v in dict(K=1000, N=1, T1=1, T2=1, HL=3e-4, SL=1e-3, AL=1e-4, DB=1, LB=1e-4, VS=0.01, N0=5, PW=0.01, MODE=1, DC=1e-5, WLEN=0.03, PUNCT=1,
                     PLEFT=1, PLL=0.01, VR=2e-3).items():
        p[IX[k]] = v
    for k, v in kw.items():
        p[IX[k]] = v
    return p


def rings(p: np.ndarray, kind: str, depth: float, n: int = 24, fillet: float = 2.5e-4) -> tuple[np.ndarray, np.ndarray]:
    """Ring heights h [m] and weights (sum calibrated so that the bed gives K depth^N at `depth`) of a flat or paraboloid tip."""
    if kind == "flat":
        a = 0.008
        r = (np.arange(n) + 0.5) / n * (a + fillet)
        h, w, m = np.where(r > a, (r - a) ** 2 / (2 * fillet), 0.0), r, p[N]
    else:
        h, w, m = (np.arange(n) + 0.5) / n * 1.02 * depth, np.ones(n), p[N] - 1
    tot = np.sum(w * np.maximum(depth - h, 0) ** m)
    return h, np.stack([w * p[K] * depth ** p[N] / tot, w / w.sum()])


@njit(cache=True)
def prof(P, x, y):
    """Stiffness factor over the place: 1 inclusion, 2 edge, 3 gradient along the first tangent."""
    if P[PT] == 1:
        return 1 + P[PA] * np.exp(-((x - P[PX]) ** 2 + y ** 2) / (2 * P[PW] ** 2))
    if P[PT] == 2:
        return 1 + P[PA] * 0.5 * (1 + np.tanh((x - P[PX]) / P[PW]))
    if P[PT] == 3:
        return 1 + P[PA] * (x - P[PX]) / P[PW]
    return 1.0


@njit(cache=True)
def friction(P, S, Nf, vx, vy, dx, dy, dt):
    """Tangential force of the material on the tool for load Nf [N], slip velocity [m/s] and slip increment [m]."""
    v = np.sqrt(vx * vx + vy * vy)
    Np = max(Nf, 0.0)
    mu = P[MU] + P[DMU] * np.exp(-(v / P[VS]) ** 2)
    if P[PEXP] != 0 and Np > 0:
        mu *= (Np / P[N0]) ** P[PEXP]
    if P[MODE] == 0:
        s = 1.0 / np.sqrt(v * v + P[VR] ** 2)
        ux, uy = vx * s, vy * s
    else:
        L = P[LB]
        d = np.sqrt(dx * dx + dy * dy)
        zx, zy = S[0], S[1]
        nz = np.sqrt(zx * zx + zy * zy)
        mode = int(P[MODE])
        if mode == 2:                                   # Prandtl: elastic, then sliding
            zx, zy = zx + dx / L, zy + dy / L
            nz = np.sqrt(zx * zx + zy * zy)
            if nz > 1:
                zx, zy = zx / nz, zy / nz
        else:
            al = 1.0
            if mode == 4:                               # Dupont: no plastic part below 60 % of break-away or when unloading
                al = 0.0 if zx * dx + zy * dy < 0 else min(max((nz - 0.6) / 0.4, 0.0), 1.0)
            f = d / L * al
            if mode == 4:
                zx, zy = (zx + dx / L) / (1 + f), (zy + dy / L) / (1 + f)
            else:
                e = np.exp(-f)
                tx, ty = (dx / d, dy / d) if d > 0 else (0.0, 0.0)
                zx, zy = zx * e + tx * (1 - e), zy * e + ty * (1 - e)
        S[0], S[1] = zx, zy
        ux, uy = zx, zy
        if mode == 5:                                   # rate and state: limit mu + a ln(1+v/v0) + b ln(1+theta v0/Dc)
            v0 = 1e-3
            S[2] += dt * (1 - v * S[2] / P[DC]) if v * dt < P[DC] * 0.5 else P[DC] / v - S[2]
            mu += P[RSA] * np.log(1 + v / v0) + P[RSB] * np.log(1 + S[2] * v0 / P[DC]) - (P[RSA] + P[RSB]) * 0.6931
    a = P[ANI]
    on = 1.0 if Np > 0 else 0.0
    s1 = 2e-4 * mu * Np / P[LB] * 1e-3 if P[MODE] == 3 else 0.0   # LuGre micro-damping, small
    return -mu * Np * ux * (1 + a) - (P[CV] * on + s1) * vx, -mu * Np * uy * (1 - a) - (P[CV] * on + s1) * vy


@njit(cache=True)
def step(P, S, h, W, H, pw, x, y, z, vx, vy, vz, dx, dy, dd, t, dt, first):
    """One step of the world's law: forces (Fx, Fy, Fn) of the material on the tool [N]. H: (4,nr) ring states."""
    dep = -z + P[OFFN] + P[Z0]
    if P[WAVE] != 0:
        dep += P[WAVE] * (np.sin(2 * np.pi * x / P[WLEN]) + np.sin(2 * np.pi * (0.8 * y + 0.3 * x) / P[WLEN] + 1))
    rate = -vz
    if P[CC] > 0:
        S[4] += (P[CC] * S[6] - S[4]) * min(dt / 1e-3, 1.0)
        dep -= S[4]
    fac = prof(P, x, y) * (1 + P[ALPHA] * t / 60)
    F, Fe = 0.0, 0.0
    e1, e2 = np.exp(-dt / P[T1]), np.exp(-dt / P[T2])
    for i in range(h.size):
        w = dep - h[i]
        p = 0.0
        if w > 0:
            p = W[0, i] * w ** pw * fac * (1 + P[NLS] * w)
            if P[SR] > 0:
                if w > H[2, i]:
                    H[2, i] = w
                p *= 1 - P[SR] * (1 - np.exp(-((H[2, i] - w) / P[SL]) ** 1.08))
            if P[KB] > 0:
                q = (w - P[DB]) / 3e-5
                p += W[1, i] * P[KB] * 3e-5 * (q if q > 30 else np.log(1 + np.exp(q)))
            if w > P[PUNCT]:
                H[3, i] = 1
            if H[3, i] > 0:
                p *= P[PLEFT]
        dp = p - H[1, i] if not first else 0.0
        tot = p
        if P[R1] > 0:
            H[0, i] = H[0, i] * e1 + P[R1] * dp * (1 + e1) / 2
            tot += H[0, i]
        if P[R2] > 0:
            H[4, i] = H[4, i] * e2 + P[R2] * dp * (1 + e2) / 2
            tot += H[4, i]
        H[1, i] = p
        if w > 0:
            Fe += p
            F += max(tot, 0.0)
    Fn = F
    if dep > 0:
        on = min(dep / 2e-5, 1.0)
        Fn += on * (P[C] * rate + P[LAM] * Fe * rate)
        if P[HA] > 0:
            u = dd / P[HL]
            g = max(1 - S[3] * np.sign(u), 0.0)
            S[3] += u * g ** 1.05
            Fn += on * P[HA] * S[3]
        Fn += on * P[LIFT] * np.sqrt(vx * vx + vy * vy)
        Fn = max(Fn, 0.0)
    else:
        Fn = 0.0
    Nl = Fn
    if P[FA] > 0:
        if dep > 0:
            S[5] = 1
        elif dep < -P[AL]:
            S[5] = 0
        if S[5] > 0:
            Fn -= P[FA] * (1.0 if dep > 0 else max(1 - 0.1 * (dep / P[AL]) ** 2, 0.0))
    S[6] = Fn
    fx, fy = friction(P, S, Nl, vx, vy, dx, dy, dt)
    if P[PLOUGH] != 0:                                   # groove wall: a sideways spring that grows with depth and place (outside)
        d = max(dep, 0.0)
        fx -= P[PLOUGH] * d * np.sin(2 * np.pi * x / P[PLL])
        fy -= P[PLOUGH] * d * np.sin(2 * np.pi * y / P[PLL])
    return fx, fy, Fn


@njit(cache=True)
def simulate(P, h, W, pw, cmd, dt, sub, M, Kc, Dc):
    """Tip held by a mass-spring-damper (per axis M, Kc, Dc) to cmd (n,3). Returns positions, velocities, accelerations, forces on the tool."""
    n = cmd.shape[0]
    X, V, A, F = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    S = np.zeros(NS)
    H = np.zeros((5, h.size))
    x, v = cmd[0].copy(), np.zeros(3)
    hs = dt / sub
    f = np.zeros(3)
    a = np.zeros(3)
    xl = x.copy()
    for i in range(n):
        X[i], V[i], A[i], F[i] = x, v, a, f
        if i == n - 1:
            break
        cv = (cmd[i + 1] - cmd[i]) / dt
        for s in range(sub):
            c = cmd[i] + (cmd[i + 1] - cmd[i]) * (s / sub)
            for k in range(3):
                a[k] = (Kc[k] * (c[k] - x[k]) + Dc[k] * (cv[k] - v[k]) + f[k]) / M[k]
                v[k] += hs * a[k]
                xl[k] = x[k]
                x[k] += hs * v[k]
            f[0], f[1], f[2] = step(P, S, h, W, H, pw, x[0], x[1], x[2], v[0], v[1], v[2], x[0] - xl[0], x[1] - xl[1], -(x[2] - xl[2]),
                                    (i + (s + 1) / sub) * dt, hs, i == 0 and s == 0)
    return X, V, A, F


@njit(cache=True)
def replay(P, t, X, V):
    """The catalogue's plain laws along a measured motion (bed frame): forces on the tool [N] (n,3). Used for checks only."""
    n = t.size
    F = np.zeros((n, 3))
    S = np.zeros(NS)
    h1, h2, fe0, wm, hy = 0.0, 0.0, 0.0, 0.0, 0.0
    bond = False
    for i in range(n):
        dt = t[i] - t[i - 1] if i else 1e-3
        j = max(i - 1, 0)
        dep0 = -X[i, 2] + P[Z0]
        dep, rate = dep0, -V[i, 2]
        fac = prof(P, X[i, 0], X[i, 1]) * (1 + P[ALPHA] * t[i] / 60)
        Fe, Fn = 0.0, 0.0
        for it in range(15 if P[CC] > 0 else 1):
            if P[CC] > 0:
                dep = dep0 - P[CC] * (0.6 * Fn + 0.4 * (dep0 - dep) / P[CC])
            if dep > 0:
                Fe = P[K] * dep ** P[N] * fac
                m = max(wm, dep)
                if P[SR] > 0:
                    Fe *= 1 - P[SR] * (1 - np.exp(-(m - dep) / P[SL]))
                Fe += P[KB] * max(dep - P[DB], 0.0)
            else:
                Fe = 0.0
            a1, a2 = h1, h2
            if P[R1] > 0:
                e = np.exp(-dt / P[T1])
                a1 = h1 * e + P[R1] * (Fe - fe0) * (1 + e) / 2
            if P[R2] > 0:
                e = np.exp(-dt / P[T2])
                a2 = h2 * e + P[R2] * (Fe - fe0) * (1 + e) / 2
            Fn = 0.0
            if dep > 0:
                Fn = Fe + a1 + a2 + (P[C] + P[LAM] * Fe) * rate
                if P[HA] != 0:
                    u = -(X[i, 2] - X[j, 2]) / P[HL]
                    e = np.exp(-abs(u))
                    hn = hy * e + np.sign(u) * (1 - e)
                    Fn += P[HA] * hn
                Fn = max(Fn, 0.0)
        if dep > 0 and P[HA] != 0:
            hy = hn
        wm = max(wm, dep)
        h1, h2, fe0 = a1, a2, Fe
        Nl = Fn
        if P[FA] != 0:
            if dep > 0:
                bond = True
            elif dep < -P[AL]:
                bond = False
            if bond:
                Fn -= P[FA]
        F[i, 0], F[i, 1] = friction(P, S, Nl, V[i, 0], V[i, 1], X[i, 0] - X[j, 0], X[i, 1] - X[j, 1], dt)
        F[i, 2] = Fn
    return F
