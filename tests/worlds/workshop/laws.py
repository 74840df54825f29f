"""Contact and friction laws with memory, compiled; SI units.

Normal: power law F = k d^n with Fung QLV branches (Fung 1981), Kelvin/Hunt-Crossley damping, Ogden-Roxburgh softening (1999), rate-free Dahl
loop, cohesive tip (Dugdale/Maugis-like traction that decays over a length), elastoplastic imprint (Prandtl-Reuss), Herschel-Bulkley damping.
Tangential: Dahl (1968), LuGre (Canudas 1995), Dupont elastoplastic (2002), rounded, Prandtl elements (1928); Dieterich ageing (1979); oblique grooves.
"""
from __future__ import annotations

from math import erf, exp, log, sqrt

import numpy as np
from numba import njit

NAMES = ("k n c lam r1 t1 r2 t2 r3 t3 hA hL mR mL aF aL sK sD z0 al iA iX iY iW iT C yF yH cs cm pD pW "
         "mu ft ell sg dmu vs cv p an vr age dc gx fu "
         "dm cx cy cz ox oy oz bx by bz btx bty btz dfx dfy dfz dtx dty dtz m1 m2 m3 g1 g2 g3 x12 x13 x21 x23 x31 x32 lag toff sat ref").split()
(K, EXPO, CDAMP, LAM, R1, T1, R2, T2, R3, T3, HA, HL, MR, ML, AF, AL, SK, SD, Z0, ALPHA, IA, IX, IY, IW, IT, COMP, YF, YH, CS, CM, PD, PW,
 MU, FT, ELL, SG, DMU, VS, CV, PL, AN, VR, AGE, DC, GX, FU) = range(46)
INDEX = {name: i for i, name in enumerate(NAMES)}
NEUTRAL = dict(n=1.0, t1=1.0, t2=1.0, t3=1.0, hL=1e-3, mL=1e-3, aL=3e-4, sD=1.0, iW=0.02, yF=1e9, yH=1e9, cm=0.4, pD=1.0, pW=1e-3, ell=1e-4, vs=0.01,
               vr=1e-4, dc=1e-4, sat=1e9, ref=5.0)
NSTATE = 20


def params(**values: float) -> np.ndarray:
    """Parameter vector with neutral defaults; see NAMES."""
    out = np.zeros(len(NAMES))
    for name, value in {**NEUTRAL, **values}.items():
        out[INDEX[name]] = value
    return out


@njit(cache=True)
def bristle(st: np.ndarray, o: int, kind: int, ell: float, vr: float, v1: float, v2: float, h: float):
    """Advance friction direction states st[o:o+8] by h; returns (z1, z2), a vector of length <= 1 along the slip."""
    d1, d2 = v1 * h, v2 * h
    if kind == 3:
        s = sqrt(v1 * v1 + v2 * v2 + vr * vr)
        return v1 / s, v2 / s
    if kind == 4:
        z1 = z2 = 0.0
        for i in range(4):
            li = ell * (0.4 + 0.4 * i)
            a, b = st[o + 2 * i] + d1, st[o + 2 * i + 1] + d2
            m = sqrt(a * a + b * b)
            if m > li:
                a, b = a * li / m, b * li / m
            st[o + 2 * i], st[o + 2 * i + 1] = a, b
            z1 += 0.25 * a / li
            z2 += 0.25 * b / li
        return z1, z2
    z1, z2 = st[o], st[o + 1]
    w = 1.0
    if kind == 2:
        m = sqrt(z1 * z1 + z2 * z2)
        w = 0.0 if (m < 0.4 or z1 * d1 + z2 * d2 < 0) else min(1.0, (m - 0.4) / 0.5)
    q = 1.0 + w * sqrt(d1 * d1 + d2 * d2) / ell
    z1, z2 = (z1 + d1 / ell) / q, (z2 + d2 / ell) / q
    m = sqrt(z1 * z1 + z2 * z2)
    if m > 1.0:
        z1, z2 = z1 / m, z2 / m
    st[o], st[o + 1] = z1, z2
    return z1, z2


@njit(cache=True)
def kmap(P: np.ndarray, x: float, y: float) -> float:
    """Local stiffness factor: iT 0 inclusion (Gaussian), 1 edge (tanh along x), 2 gradient along x."""
    if P[IA] == 0.0:
        return 1.0
    if P[IT] == 0:
        return 1.0 + P[IA] * exp(-((x - P[IX]) ** 2 + (y - P[IY]) ** 2) / (2 * P[IW] ** 2))
    if P[IT] == 1:
        return 1.0 + P[IA] * np.tanh((x - P[IX]) / P[IW])
    return 1.0 + P[IA] * (x - P[IX]) / P[IW]


@njit(cache=True)
def step(st: np.ndarray, P: np.ndarray, d: float, dr: float, x: float, y: float, v1: float, v2: float, t: float, h: float):
    """One step of length h [s] at depth d [m], rate dr; returns normal force and both tangential forces [N]."""
    de = d + P[Z0] - P[COMP] * st[8] - st[7]
    if de <= 0.0:
        gap = -de
        st[0] = st[1] = st[2] = st[3] = st[5] = 0.0
        for i in range(9, 17):
            st[i] = 0.0
        st[17] = 0.0
        n = 0.0
        if st[6] > 0.0:
            n = -P[AF] * (1.0 + gap / P[AL]) * exp(-gap / P[AL])
            if gap > 6.0 * P[AL]:
                st[6] = 0.0
        st[8] = n
        return n, 0.0, 0.0
    st[6] = 1.0
    if P[FU] > 0.0:
        de = (exp(P[FU] * de) - 1.0) / P[FU]
    fe = P[K] * (1.0 + P[ALPHA] * t / 60.0) * kmap(P, x, y) * de ** P[EXPO]
    if de > P[SD] - 2e-3:
        w = 6e-5
        u = (de - P[SD]) / w
        fe += P[SK] * w * (u if u > 30 else np.log1p(np.exp(u)))
    if P[PD] < 1.0:
        if de > P[PD]:
            st[18] = min(1.0, max(st[18], (de - P[PD]) / 1e-4))
        fe *= 1.0 - P[PW] * st[18]
    if fe > P[YF] + P[YH] * st[7]:
        st[7] += (fe - P[YF] - P[YH] * st[7]) / (P[K] * P[EXPO] * de ** (P[EXPO] - 1.0) + P[YH])
    if de > st[4]:
        st[4] = de
    elif P[MR] > 0.0:
        fe *= 1.0 - P[MR] * erf((st[4] - de) / P[ML])
    df = fe - st[0]
    st[0] = fe
    n = fe
    for i in range(3):
        r = P[R1 + 2 * i]
        if r != 0.0:
            a = h / P[T1 + 2 * i]
            e = exp(-a)
            st[1 + i] = e * st[1 + i] + r * df * (1.0 - e) / a
            n += st[1 + i] - r * fe
    ramp = min(1.0, de / 3e-5)
    n += ramp * P[CDAMP] * dr + P[LAM] * fe * dr
    if P[CS] != 0.0:
        n += ramp * P[CS] * dr / sqrt(dr * dr + 2.5e-7) * abs(dr) ** P[CM]
    if P[HA] != 0.0:
        dd = dr * h
        st[5] = (st[5] + dd / P[HL]) / (1.0 + abs(dd) / P[HL])
        n += P[HA] * st[5] * ramp
    if n < 0.0:
        n = 0.0
    z1, z2 = bristle(st, 9, int(P[FT]), P[ELL], P[VR], v1, v2, h)
    v = sqrt(v1 * v1 + v2 * v2)
    mu = P[MU]
    if P[PL] != 0.0 and n > 1e-3:
        mu *= (n / P[len(P) - 1]) ** P[PL]
    mu += P[DMU] * exp(-(v / P[VS]) ** 2)
    if P[AGE] != 0.0:
        st[17] = (st[17] + h) / (1.0 + v * h / P[DC])
        mu *= 1.0 + P[AGE] * log(1.0 + st[17] / 0.02)
    g1, g2 = z1 + P[GX] * z2, z2 + P[GX] * z1
    zd1, zd2 = 0.0, 0.0
    if P[SG] != 0.0 and v < 2e-3:
        zd1, zd2 = v1, v2
    f1 = -n * (mu * (1.0 + P[AN]) * g1 + P[SG] * zd1) - P[CV] * v1
    f2 = -n * (mu * (1.0 - P[AN]) * g2 + P[SG] * zd2) - P[CV] * v2
    n -= P[AF] * ramp
    st[8] = n
    return n, f1, f2


@njit(cache=True)
def run(P: np.ndarray, t: np.ndarray, d: np.ndarray, dr: np.ndarray, x: np.ndarray, y: np.ndarray, v1: np.ndarray, v2: np.ndarray, sub: int) -> np.ndarray:
    """Forces (len, 3) [N] along a sampled motion, `sub` linear substeps a sample."""
    out = np.zeros((len(t), 3))
    st = np.zeros(NSTATE)
    for i in range(len(t)):
        j = max(i - 1, 0)
        h = (t[i] - t[j]) / sub if i else 1e-3
        for s in range(sub):
            w = (s + 1) / sub
            u = 1.0 - w
            a, b, c = step(st, P, u * d[j] + w * d[i], u * dr[j] + w * dr[i], u * x[j] + w * x[i], u * y[j] + w * y[i],
                           u * v1[j] + w * v1[i], u * v2[j] + w * v2[i], u * t[j] + w * t[i], h)
        out[i, 0], out[i, 1], out[i, 2] = a, b, c
    return out


@njit(cache=True)
def play(t: np.ndarray, x: np.ndarray, y: np.ndarray, w: float) -> tuple[np.ndarray, np.ndarray]:
    """Slip rates [m/s] of positions x, y behind a play of radius w [m]: encoder noise at rest makes no slip."""
    v1, v2 = np.zeros(len(t)), np.zeros(len(t))
    a, b = x[0], y[0]
    for i in range(1, len(t)):
        e1, e2 = x[i] - a, y[i] - b
        m = sqrt(e1 * e1 + e2 * e2)
        if m > w:
            s = (m - w) / m
            a, b = a + e1 * s, b + e2 * s
            v1[i], v2[i] = e1 * s / (t[i] - t[i - 1]), e2 * s / (t[i] - t[i - 1])
    return v1, v2


@njit(cache=True)
def axis_direction(kind: int, ell: float, vr: float, v: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Friction direction of one axis along speed v [rad/s], steps dt [s]."""
    out = np.zeros(len(v))
    st = np.zeros(8)
    for i in range(len(v)):
        for _ in range(4):
            z, _z = bristle(st, 0, kind, ell, vr, v[i], 0.0, dt[i] / 4)
        out[i] = z
    return out
