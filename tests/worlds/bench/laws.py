"""The material under the tip, as state equations stepped at a fixed or varying rate.

One law serves the truth (with its off-form terms: foundation toe, several Maxwell branches, LuGre ...) and the
refits (off-form terms zero: the plain catalogue form). Parameters live in one vector p (see P), memory in x.
"""
import math
import numpy as np
from numba import njit

NAMES = ("k n c lam r0 r1 r2 r3 r4 tau0 tau1 tau2 tau3 tau4 hyA hyL hyB soR soL soB adF adL adB laK laD laW alpha z0 "
         "toe ikind iA icx icy iw iang comp mu cv dmu vs vlag ell ftype vr pN N0 aniso lug loadB").split()
P = {n: i for i, n in enumerate(NAMES)}
(K, N, C, LAM, R0, R1, R2, R3, R4, T0, T1, T2, T3, T4, HA, HL, HB, SR, SL, SB, AF, AL, AB, LK, LD, LW, ALPHA, Z0,
 TOE, IK, IA, ICX, ICY, IW, IANG, COMP, MU, CV, DMU, VS, VLAG, ELL, FT, VR, PN, NN0, ANISO, LUG, LOADB) = range(len(NAMES))
NX = 20   # state: 0 dmax 1 bonded 2,3 hysteresis 4..8 branches 9,10 bristle 11 w 12 remainder 13 lagged speed 14 dp 15 started

DEFAULT = dict(k=1000., n=1., tau0=1., tau1=1., tau2=1., tau3=1., tau4=1., hyL=1e-3, soL=1e-3, adL=1e-3, laD=1.,
               iw=1., vs=1e-2, ell=1e-4, N0=10., vr=1e-3)


def params(**kw):
    p = np.zeros(len(NAMES))
    for n, v in {**DEFAULT, **kw}.items():
        p[P[n]] = v
    return p


def state():
    return np.zeros(NX)


@njit(cache=True, nogil=True)
def place_gain(p, s1, s2):
    """Relative stiffness over the place: 1 gradient, 2 edge, 3 inclusion."""
    kind = p[IK]
    if kind == 0.0:
        return 0.0
    a, b = s1 - p[ICX], s2 - p[ICY]
    u = a * math.cos(p[IANG]) + b * math.sin(p[IANG])
    if kind == 1.0:
        return p[IA] * u / (p[IW] + abs(u) * 0.15)
    if kind == 2.0:
        return p[IA] * 0.5 * (1.0 + math.tanh(u / p[IW]))
    return p[IA] * math.exp(-(a * a + b * b) / (2 * p[IW] ** 2))


@njit(cache=True, nogil=True)
def elastic(p, g, dp):
    """k dp^n with the toe of a foundation of springs of unequal height, and the second layer."""
    if dp <= 0.0:
        return 0.0
    h = p[TOE]
    de = dp
    if h > 0.0:
        de = dp * dp / (2 * h) if dp < h else dp - 0.5 * h
    f = g * p[K] * de ** p[N]
    if p[LK] > 0.0:
        b = dp - p[LD]
        if p[LW] > 0.0:
            f += p[LK] * 0.5 * (b + math.sqrt(b * b + p[LW] ** 2)) - p[LK] * 0.5 * (-p[LD] + math.sqrt(p[LD] ** 2 + p[LW] ** 2))
        elif b > 0.0:
            f += p[LK] * b
    return f


@njit(cache=True, nogil=True)
def mat_step(p, x, t, dt, d, dd, s1, s2, v1, v2, kap, o):
    """Advance memory x by dt to time t; o[0] normal force, o[1..2] tangential forces, o[3] depth of the material."""
    g = (1.0 + p[ALPHA] * t / 60.0) * (1.0 + kap)
    d = d + p[Z0]
    w_old = x[11]
    if p[COMP] > 0.0:
        w = w_old
        for _ in range(12):                        # depth lost in the sensor and the flange: w = C F(d - w)
            f = elastic(p, g, d - w) + (x[12] if d - w > 0 else 0.0)
            w += 0.6 * (p[COMP] * max(f, 0.0) - w)
        x[11] = w
        d = d - w
        if dt > 0.0:
            dd = dd - (w - w_old) / dt
    dp = max(d, 0.0)
    fe = elastic(p, g, dp)
    if dp > x[0]:
        x[0] = dp
    if p[SR] != 0.0 and dp > 0.0:                  # softening below the deepest past depth (exp; SB: Ogden-Roxburgh erf)
        u = (x[0] - dp) / p[SL]
        fe *= 1.0 - p[SR] * ((1 - p[SB]) * (1 - math.exp(-u)) + p[SB] * math.erf(u))
    f = fe
    for i in range(5):
        if p[R0 + i] != 0.0:
            a = math.exp(-dt / p[T0 + i])
            x[4 + i] = a * x[4 + i] + (1 - a) * fe
            f -= p[R0 + i] * x[4 + i]
    if p[HA] != 0.0:
        if dp > 0.0:
            inc = dp - x[14]
            sg = 1.0 if inc > 0 else (-1.0 if inc < 0 else 0.0)
            e = math.exp(-abs(inc) / p[HL])
            x[2] = sg * (1 - e) + x[2] * e
            e = math.exp(-abs(inc) / (3 * p[HL]))
            x[3] = sg * (1 - e) + x[3] * e
        else:
            x[2] = 0.0
            x[3] = 0.0
        f += p[HA] * ((1 - p[HB]) * x[2] + p[HB] * x[3])
    if dp > 0.0:
        ramp = 1.0 if p[TOE] <= 0.0 else min(1.0, dp / p[TOE])
        f += p[C] * dd * ramp + p[LAM] * fe * dd
        nc = max(f, 0.0)
    else:
        nc = 0.0
    x[12] += (1.0 - math.exp(-dt / 0.02)) * (f - fe - x[12])
    x[14] = dp
    pull = 0.0
    if p[AF] != 0.0:
        if dp > 0.0:
            x[1] = 1.0
            pull = p[AF]
        elif x[1] > 0.0:
            u = -d / p[AL]
            if u > 1.0:
                x[1] = 0.0
            else:
                pull = p[AF] * (1.0 - p[AB] * u * u)
    o[0] = nc - pull
    o[3] = dp
    # ---- tangential
    if nc <= 0.0:
        x[9] = 0.0
        x[10] = 0.0
        x[13] = 0.0
        o[1] = 0.0
        o[2] = 0.0
        return
    v = math.sqrt(v1 * v1 + v2 * v2)
    if p[VLAG] > 0.0:
        x[13] += (1 - math.exp(-dt / p[VLAG])) * (v - x[13])
        vst = x[13]
    else:
        vst = v
    mu = p[MU] + p[DMU] * math.exp(-(vst / p[VS]) ** 2)
    if p[PN] != 0.0:
        mu *= (max(nc, 1e-3 * p[NN0]) / p[NN0]) ** p[PN]
    ell = p[ELL]
    ft = p[FT]
    z1, z2 = x[9], x[10]
    if ft == 4.0:
        q = math.sqrt(v * v + p[VR] ** 2)
        b1, b2 = v1 / q, v2 / q
    elif ft == 1.0:                                # Prandtl: elastic, then sliding
        z1 += v1 * dt
        z2 += v2 * dt
        a = math.sqrt(z1 * z1 + z2 * z2)
        if a > ell:
            z1 *= ell / a
            z2 *= ell / a
        b1, b2 = z1 / ell, z2 / ell
    else:
        al = 1.0
        if ft == 3.0:                              # elasto-plastic: no creep below break-away
            a = math.sqrt(z1 * z1 + z2 * z2) / ell
            if z1 * v1 + z2 * v2 > 0.0:
                al = 0.0 if a < 0.6 else 0.5 - 0.5 * math.cos(math.pi * min((a - 0.6) / 0.4, 1.0))
        if v > 0.0:
            u = v * dt / ell * al
            if u > 1e-9:
                e = math.exp(-u)
                c1 = (1 - e) / (al * v) * ell
                z1 = v1 * c1 + z1 * e
                z2 = v2 * c1 + z2 * e
            else:
                z1 += v1 * dt
                z2 += v2 * dt
            a = math.sqrt(z1 * z1 + z2 * z2)
            if a > ell:
                z1 *= ell / a
                z2 *= ell / a
        b1, b2 = z1 / ell, z2 / ell
        if ft == 2.0 and dt > 0.0:                 # LuGre's micro-damping
            b1 += p[LUG] * (z1 - x[9]) / dt / ell
            b2 += p[LUG] * (z2 - x[10]) / dt / ell
    x[9] = z1
    x[10] = z2
    o[1] = -mu * (1 + p[ANISO]) * nc * b1 - p[CV] * v1
    o[2] = -mu * (1 - p[ANISO]) * nc * b2 - p[CV] * v2


@njit(cache=True, nogil=True)
def mat_run(p, t, d, dd, s1, s2, v1, v2, kap, use_kap, out):
    """The law over recorded motion."""
    x = np.zeros(NX)
    o = np.zeros(4)
    for i in range(t.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        kp = kap[i] if use_kap else place_gain(p, s1[i], s2[i])
        mat_step(p, x, t[i], dt, d[i], dd[i], s1[i], s2[i], v1[i], v2[i], kp, o)
        out[i, 0] = o[0]
        out[i, 1] = o[1]
        out[i, 2] = o[2]
