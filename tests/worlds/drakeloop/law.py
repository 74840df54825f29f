"""Contact law of the tip on a soft flat body: numba, with memory. Units: m, N, s; SI throughout.

Sources: Hunt & Crossley 1975; Fung 1981 (quasi-linear viscoelasticity: branches driven by the elastic force);
Dahl 1968 and Canudas de Wit 1995 (bristles); Jenkins / Prandtl (spring-slider); Ogden & Roxburgh 1999 (softening);
Maugis 1992 (pulling tail); Winkler patch with a small tilt (rounded onset over +-`found`)."""
from __future__ import annotations
import math
import numpy as np
from numba import njit

D0 = 3e-3   # depth at which k is the secant stiffness [m]
N0 = 5.0    # load at which mu holds [N]
NAMES = ("k n c lam r1 tau1 r2 tau2 keq hyA hyL ssR ssL adF adL slK slB z0 drift inA inX inY inW found mu ell fmode vr "
         "dmu vs p aniso cv C lift paA paX paY paW wearA wearL wavA wavL vibA vibF puD puR zr c2").split()
IX = {n: i for i, n in enumerate(NAMES)}
DEFAULT = dict(n=1.0, keq=1.0, tau1=1.0, tau2=1.0, hyL=5e-4, ssL=1e-3, adL=1e-3, slB=1.0, inW=0.01, ell=1e-4, vr=1e-3, vs=0.01,
               paW=0.01, wearL=0.2, wavL=0.04, vibF=5.0, puD=1.0)
NS = 14     # states: q1 q2 Fe de z dmax bond s1 s2 path N x1 x2 d


def pvec(d: dict[str, float]) -> np.ndarray:
    """Parameter vector from names; absent ones are neutral."""
    p = np.zeros(len(NAMES))
    for k, v in {**DEFAULT, **d}.items():
        p[IX[k]] = v
    return p


(K, NX, CC, LAM, R1, T1, R2, T2, KEQ, HYA, HYL, SSR, SSL, ADF, ADL, SLK, SLB, Z0, DRIFT, INA, INX, INY, INW, FOUND, MU, ELL, FM, VR,
 DMU, VS, PP, AN, CV, CO, LIFT, PAA, PAX, PAY, PAW, WEA, WEL, WAA, WAL, VIA, VIF, PUD, PUR, ZR, C2) = range(len(NAMES))


@njit(cache=True)
def normal(P, S, O, t, dt, d, dd, x1, x2, sp):
    """Normal force [N] at geometric depth d [m], rate dd [m/s]; next states into O (S is left alone)."""
    d = d + P[Z0] + P[ZR] * t
    if P[WAA] != 0.0:
        d += P[WAA] * math.sin(2 * math.pi * x1 / P[WAL]) * math.cos(2 * math.pi * x2 / P[WAL])
    if P[VIA] != 0.0:
        d += P[VIA] * math.sin(2 * math.pi * P[VIF] * t)
    w = P[FOUND]
    ramp = 0.0
    if d <= -w:
        de = 0.0
    elif d < w:
        de = (d + w) ** 2 / (4 * w)
        ramp = (d + w) / (2 * w)
    else:
        de = d
        ramp = 1.0
    fe = 0.0
    dmax = max(S[5], de)
    if de > 0.0:
        fe = P[K] * D0 * (de / D0) ** P[NX] * (1 + P[DRIFT] * t / 60.0)
        if P[INA] != 0.0:
            fe *= 1 + P[INA] * math.exp(-((x1 - P[INX]) ** 2 + (x2 - P[INY]) ** 2) / (2 * P[INW] ** 2))
        if P[SSR] != 0.0:
            fe *= 1 - P[SSR] * (1 - math.exp(-(dmax - de) / P[SSL]))
        if dmax > P[PUD]:
            fe *= 1 - P[PUR] * (1 - math.exp(-(dmax - P[PUD]) / 3e-4))
        if P[LIFT] != 0.0:
            fe *= 1 + P[LIFT] * sp / (sp + 0.02)
    dfe = fe - S[2]
    f = P[KEQ] * fe
    if P[R1] != 0.0:
        e = math.exp(-dt / P[T1])
        O[0] = S[0] * e + dfe * (1 - e) * P[T1] / dt
        f += P[R1] * O[0]
    if P[R2] != 0.0:
        e = math.exp(-dt / P[T2])
        O[1] = S[1] * e + dfe * (1 - e) * P[T2] / dt
        f += P[R2] * O[1]
    O[2] = fe
    O[3] = de
    z = 0.0
    if de > 0.0:
        f += P[LAM] * fe * dd + P[CC] * dd * ramp + P[C2] * dd * abs(dd) * ramp
        if P[HYA] != 0.0:
            x = de - S[3]
            sg = 1.0 if x > 0 else -1.0
            z = sg + (S[4] - sg) * math.exp(-abs(x) / P[HYL])
            f += P[HYA] * z
        if d > P[SLB]:
            f += P[SLK] * (d - P[SLB])
        f = max(f, 0.0)
    else:
        f = 0.0
    O[4] = z
    O[5] = dmax
    b = S[6]
    if P[ADF] != 0.0:
        if d > 0:
            b = max(b, min(1.0, d / 5e-5))
        elif d < -P[ADL]:
            b = 0.0
        g = max(0.0, -d) / P[ADL]
        f -= P[ADF] * b * max(0.0, 1 - g * g)
    O[6] = b
    return f


@njit(cache=True)
def step(P, S, O, t, dt, d, dd, x1, x2, v1, v2, out):
    """One step of the law: depth d, rate dd, slip x, slip rate v -> out = (N, T1, T2) [N]; S is advanced."""
    O[:] = S
    sp = math.hypot(v1, v2)
    n = normal(P, S, O, t, dt, d, dd, x1, x2, sp)
    if P[CO] > 0.0 and n > 0.0:          # series compliance: n = law(d - C n), rate too; bisection
        lo, hi = 0.0, n + P[CO] * 1e3
        for _ in range(34):
            m = 0.5 * (lo + hi)
            if normal(P, S, O, t, dt, d - P[CO] * m, dd - P[CO] * (m - S[10]) / dt, x1, x2, sp) > m:
                lo = m
            else:
                hi = m
        n = 0.5 * (lo + hi)
    O[10] = n
    t1 = t2 = 0.0
    dx, dy = x1 - S[11], x2 - S[12]
    if n > 0.0:
        if S[10] < 0.0:                  # friction sets in where the force turns to pressing
            a = n / (n - S[10])
            dx, dy = a * dx, a * dy
        elif S[10] == 0.0 and d > S[13]:   # touched within this step: the bristles bend from there on
            a = min(1.0, max(0.0, (d + P[Z0]) / (d - S[13])))
            dx, dy = a * dx, a * dy
        o = math.hypot(dx, dy)
        l = P[ELL]
        s1, s2 = S[7], S[8]
        if P[FM] == 0.0:                 # Dahl, exact over a straight step
            if o > 0:
                e = math.exp(-o / l)
                s1 = l * dx / o + (s1 - l * dx / o) * e
                s2 = l * dy / o + (s2 - l * dy / o) * e
        elif P[FM] == 1.0:               # Jenkins: spring that slips
            s1 += dx
            s2 += dy
            r = math.hypot(s1, s2)
            if r > l:
                s1 *= l / r
                s2 *= l / r
        else:                            # rounded
            r = math.sqrt(sp * sp + P[VR] ** 2)
            s1, s2 = l * v1 / r, l * v2 / r
        O[7], O[8] = s1, s2
        O[9] = S[9] + o
        mu = P[MU]
        if P[DMU] != 0.0:
            mu += P[DMU] * math.exp(-(sp / P[VS]) ** 2)
        if P[PP] != 0.0:
            mu *= (max(n, 0.05) / N0) ** P[PP]
        if P[PAA] != 0.0:
            mu *= 1 + P[PAA] * math.exp(-((x1 - P[PAX]) ** 2 + (x2 - P[PAY]) ** 2) / (2 * P[PAW] ** 2))
        if P[WEA] != 0.0:
            mu *= 1 + P[WEA] * (1 - math.exp(-O[9] / P[WEL]))
        t1 = -mu * (1 + P[AN]) * n * s1 / l - P[CV] * v1
        t2 = -mu * (1 - P[AN]) * n * s2 / l - P[CV] * v2
    else:
        O[7] = O[8] = 0.0
    O[11], O[12], O[13] = x1, x2, d
    S[:] = O
    out[0], out[1], out[2] = n, t1, t2


@njit(cache=True)
def series(P, t, d, dd, x, v):
    """The law along a motion given by samples: t (n,), d, dd (n,), x, v (n,2) -> forces (n,3) [N]."""
    S, O, o = np.zeros(NS), np.zeros(NS), np.zeros(3)
    F = np.zeros((len(t), 3))
    S[11], S[12] = x[0, 0], x[0, 1]
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i else t[1] - t[0]
        step(P, S, O, t[i], dt, d[i], dd[i], x[i, 0], x[i, 1], v[i, 0], v[i, 1], o)
        F[i] = o
    return F


@njit(cache=True)
def stage(P, xc, vc, dt, m, kp, kd, rec):
    """Material tester: a carriage of mass m [kg] held to the set-point xc, vc by a PD servo, pressed into the law.
    Returns rows (x, v, N) every `rec` steps; x is depth [m]."""
    S, O, o = np.zeros(NS), np.zeros(NS), np.zeros(3)
    n = len(xc)
    out = np.zeros((n // rec, 3))
    x, v = xc[0], 0.0
    for i in range(n):
        step(P, S, O, i * dt, dt, x, v, 0.0, 0.0, 0.0, 0.0, o)
        if i % rec == 0 and i // rec < len(out):
            out[i // rec, 0], out[i // rec, 1], out[i // rec, 2] = x, v, o[0]
        v += dt * (kp * (xc[i] - x) + kd * (vc[i] - v) - o[0]) / m
        x += dt * v
    return out
