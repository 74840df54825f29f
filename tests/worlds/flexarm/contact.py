"""What the tip touches. Normal: a Winkler foundation of springs, each of which meets the tip at its own depth (method of dimensionality
reduction, Popov & Hess 2015: one row of springs gives F = k d^n of an axisymmetric tip exactly) and follows its own viscoelastic law
(two Maxwell branches, Kelvin or Hunt-Crossley dashpot, Ogden-Roxburgh softening, Dugdale adhesion). Tangential: one of Dahl, Prandtl, LuGre,
elasto-plastic (Dupont 2002), Iwan (eight sliders) or rounded friction in two dimensions."""
from __future__ import annotations

import numpy as np
from numba import njit

jit = njit(cache=True)

NAMES = ("k eta lam r1 tau1 r2 tau2 ha hl hexp mr ml fa al lk ld lr drift mu dmu vs cv p n0 ani bl fmode vr sig zba pg1 pg2 pe pe0 pew pea "
         "pi pi1 pi2 pir wa wl wph fb cs").split()
IX = {n: i for i, n in enumerate(NAMES)}
(K, ETA, LAM, R1, TAU1, R2, TAU2, HA, HL, HEXP, MR, ML, FA, AL, LK, LD, LR, DRIFT, MU, DMU, VS, CV, P, N0, ANI, BL, FMODE, VR, SIG, ZBA,
 PG1, PG2, PE, PE0, PEW, PEA, PI_, PI1, PI2, PIR, WA, WL, WPH, FB, CS) = range(len(NAMES))
DEFAULTS = dict(tau1=1.0, tau2=0.1, hl=1e-3, hexp=1.0, ml=1e-3, al=1e-3, ld=1.0, vs=0.01, n0=5.0, bl=1e-4, vr=0.01, zba=0.6, fb=1.0, pew=1e-3, pir=0.01, wl=0.01)
FRICTION = {"dahl": 0, "prandtl": 1, "lugre": 2, "elasto-plastic": 3, "iwan": 4, "rounded": 5}
NSL = 8                                              # Iwan sliders
NST = 7                                              # states of a spring
NF = 10 + 2 * NSL                                    # states of the tip


def pack(d):
    out = np.zeros(len(NAMES))
    for k, v in {**DEFAULTS, **d}.items():
        out[IX[k]] = FRICTION[v] if k == "fmode" and isinstance(v, str) else v
    return out


def foundation(n=1.0, dmax=6e-3, edge=0.0, edge_depth=3e-4, springs=36):
    """Depths g at which springs meet the tip and their weights w, so that sum w (d - g)+ = d^n up to dmax; a share `edge` of a flat tip
    meets late (a rounded rim, or a face not quite parallel)."""
    if abs(n - 1) < 1e-9:
        if edge <= 0:
            return np.zeros(1), np.ones(1)
        g = (np.arange(6) + 0.5) / 6 * edge_depth
        return np.r_[0.0, g], np.r_[1 - edge, np.full(6, edge / 6)]
    b = np.linspace(0, 1, springs + 1) ** 1.5 * dmax * 1.15       # knots of a piecewise linear force
    f = b ** n
    s = np.diff(f) / np.diff(b)
    w = np.r_[s[0], np.diff(s)]
    return b[:-1].copy(), w


@jit
def profile(c, s1, s2):
    """Stiffness over the place, relative to the point of the rig."""
    v = 1.0 + c[PG1] * s1 + c[PG2] * s2
    if c[PE] != 0.0:
        x = np.cos(c[PEA]) * s1 + np.sin(c[PEA]) * s2 - c[PE0]
        v += 0.5 * c[PE] * (1.0 + np.tanh(x / c[PEW]))
    if c[PI_] != 0.0:
        r2 = ((s1 - c[PI1]) ** 2 + (s2 - c[PI2]) ** 2) / (c[PIR] * c[PIR])
        v += c[PI_] * np.exp(-r2)
    return v


@jit
def touch(dt, t, dep, rate, s1, s2, v1, v2, c, g, w, st, fs, out):
    """One step of the foundation and of the friction; out <- normal force, two tangential forces."""
    if c[WA] != 0.0:
        ph = 2 * np.pi * (s1 + 0.37 * s2) / c[WL] + c[WPH]
        dep += c[WA] * np.sin(ph)
        rate += c[WA] * 2 * np.pi / c[WL] * np.cos(ph) * (v1 + 0.37 * v2)
    if c[CS] > 0.0:                                   # a damped flexure behind the tip gives way by cs x force
        tf = max(2e-3, 3.0 * c[CS] * (c[ETA] + c[LAM] * fs[NF - 1]))
        yr = (c[CS] * fs[NF - 1] - fs[NF - 2]) / tf
        fs[NF - 2] += dt * yr
        dep -= fs[NF - 2]
        rate -= yr
    dmax = fs[0]
    if dep > dmax:
        dmax = dep
        fs[0] = dmax
    out[1] = 0.0
    out[2] = 0.0
    if dep <= 0.0 and fs[1] == 0.0:
        out[0] = 0.0
        fs[NF - 1] = 0.0
        for k in range(3, NF - 2):
            fs[k] = 0.0
        fs[2] = 0.0
        for j in range(g.shape[0]):                                # relaxation goes on in the air
            st[j, 0] *= 1.0 - dt / c[TAU1]
            st[j, 1] *= 1.0 - dt / c[TAU2]
            st[j, 2] = 0.0
        return
    kk = c[K] * (1.0 + c[DRIFT] * t / 60.0) * profile(c, s1, s2)
    e1, e2 = np.exp(-dt / c[TAU1]), np.exp(-dt / c[TAU2])
    soft = 1.0
    if c[MR] != 0.0:
        soft = 1.0 - c[MR] * (1.0 - np.exp(-max(dmax - max(dep, 0.0), 0.0) / c[ML]))
    F = 0.0
    for j in range(g.shape[0]):
        u = dep - g[j]
        if u < 0.0:
            u = 0.0
        du = u - st[j, 2]
        st[j, 2] = u
        st[j, 0] = (st[j, 0] + du) * e1
        st[j, 1] = (st[j, 1] + du) * e2
        if u > 0.0:
            f = (1.0 - c[R1] - c[R2]) * u + c[R1] * st[j, 0] + c[R2] * st[j, 1]
            f = f * soft * (1.0 + c[LAM] * rate) * kk + c[ETA] * rate
            if f > 0.0:
                F += w[j] * f
    if c[LK] > 0.0:
        x = dep - c[LD]
        if c[LR] > 0.0:
            F += c[LK] * 0.5 * (x + np.sqrt(x * x + c[LR] * c[LR])) if dep > 0.0 else 0.0
        elif x > 0.0:
            F += c[LK] * x
    if c[HA] != 0.0 and dep > 0.0:
        dd = dep - fs[2]
        sg = 1.0 if dd > 0 else -1.0
        b = 1.0 - sg * fs[3]
        if b > 0.0:
            fs[3] += dd / c[HL] * b ** c[HEXP]
        fs[3] = min(1.0, max(-1.0, fs[3]))
        F += c[HA] * fs[3]
    fs[2] = max(dep, 0.0)
    if F < 0.0:
        F = 0.0
    Nn = F
    if c[FA] > 0.0:
        if dep > 0.0:
            fs[1] = 1.0
        a = 0.0
        for j in range(12):
            if dep > -c[AL] * (j + 0.5) / 12.0:
                a += 1.0 / 12.0
        if a == 0.0:
            fs[1] = 0.0
        F -= c[FA] * a * fs[1]
    out[0] = F
    fs[NF - 1] = F
    if dep <= 0.0:
        for k in range(3, NF - 2):
            fs[k] = 0.0
        return
    # friction
    v = np.sqrt(v1 * v1 + v2 * v2)
    mu = c[MU]
    if c[DMU] != 0.0:
        mu += c[DMU] * np.exp(-(v / c[VS]) ** 2)
    if c[P] != 0.0 and Nn > 0.0:
        mu *= (Nn / c[N0]) ** c[P]
    L = c[BL]
    m = int(c[FMODE])
    z1, z2 = fs[4], fs[5]
    d1, d2 = v1 * dt / L, v2 * dt / L
    y1, y2 = 0.0, 0.0
    h1, h2 = fs[6], fs[7]                             # Dahl's bristles, always there
    if v > 1e-12:
        e = np.exp(-v * dt / L)
        x1, x2 = v1 / v, v2 / v
        h1, h2 = x1 + (h1 - x1) * e, x2 + (h2 - x2) * e
    if m == 5:
        r = np.sqrt(v * v + c[VR] * c[VR])
        y1, y2 = v1 / r, v2 / r
    elif m == 2:
        y1, y2 = h1 + c[SIG] * (h1 - fs[6]) / dt, h2 + c[SIG] * (h2 - fs[7]) / dt
    elif m == 0:
        y1, y2 = h1, h2
    elif m == 1:
        n1, n2 = z1 + d1, z2 + d2
        r = np.sqrt(n1 * n1 + n2 * n2)
        if r > 1.0:
            n1, n2 = n1 / r, n2 / r
        fs[4], fs[5] = n1, n2
        y1, y2 = n1, n2
    elif m == 3:
        r = np.sqrt(z1 * z1 + z2 * z2)
        al = 0.0
        if z1 * v1 + z2 * v2 > 0.0 and r > c[ZBA]:
            al = 1.0 if r >= 1.0 else 0.5 - 0.5 * np.cos(np.pi * (r - c[ZBA]) / (1.0 - c[ZBA]))
        dv = v * dt / L
        if al > 0.0:
            e = np.exp(-al * dv)
            x1, x2 = v1 / v / al, v2 / v / al
            n1, n2 = x1 + (z1 - x1) * e, x2 + (z2 - x2) * e
        else:
            n1, n2 = z1 + d1, z2 + d2
        r = np.sqrt(n1 * n1 + n2 * n2)
        if r > 1.0:
            n1, n2 = n1 / r, n2 / r
        fs[4], fs[5] = n1, n2
        y1, y2 = n1, n2
    else:
        for k in range(NSL):
            lk = 0.3 + 1.4 * (k + 0.5) / NSL
            n1, n2 = fs[8 + 2 * k] + d1 / lk, fs[9 + 2 * k] + d2 / lk
            r = np.sqrt(n1 * n1 + n2 * n2)
            if r > 1.0:
                n1, n2 = n1 / r, n2 / r
            fs[8 + 2 * k], fs[9 + 2 * k] = n1, n2
            y1 += n1 / NSL
            y2 += n2 / NSL
    fs[6], fs[7] = h1, h2
    b = c[FB] if m != 5 else 1.0                      # a share b of the bristles is of the other kind
    y1, y2 = b * y1 + (1.0 - b) * h1, b * y2 + (1.0 - b) * h2
    out[1] = -mu * (1.0 + c[ANI]) * Nn * y1 - c[CV] * v1
    out[2] = -mu * (1.0 - c[ANI]) * Nn * y2 - c[CV] * v2


@jit
def press(t, dep, rate, s1, s2, v1, v2, c, g, w):
    """A prescribed motion through the foundation (material testers)."""
    n = t.shape[0]
    st = np.zeros((g.shape[0], NST))
    fs = np.zeros(NF)
    out = np.empty(3)
    F = np.empty((n, 3))
    for i in range(n):
        dt = t[i] - t[i - 1] if i > 0 else t[1] - t[0]
        touch(dt, t[i], dep[i], rate[i], s1[i], s2[i], v1[i], v2[i], c, g, w, st, fs, out)
        F[i, 0] = out[0]
        F[i, 1] = out[1]
        F[i, 2] = out[2]
    return F
