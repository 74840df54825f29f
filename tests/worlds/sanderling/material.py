"""One step of the sample's force: a foundation of springs, Maxwell branches, a Dahl loop, memory of the deepest past depth, adhesion, friction laws."""
import numpy as np
from numba import njit

NAMES = ("k n c lam r1 tau1 r2 tau2 hy_ratio hy_len mu_ratio mu_len fa fa_len K db z0 drift comp mu fkind flen vr cv dmu vs p N0 aniso hy_amp").split()
I = {n: i for i, n in enumerate(NAMES)}
NP, NS = len(NAMES), 12
DEFAULT = dict(k=0., n=1., c=0., lam=0., r1=0., tau1=1., r2=0., tau2=.1, hy_ratio=0., hy_len=1e-3, mu_ratio=0., mu_len=2e-3, fa=0., fa_len=1e-3,
               K=0., db=1., z0=0., drift=0., comp=0., mu=0., fkind=0., flen=1e-4, vr=1e-3, cv=0., dmu=0., vs=.01, p=0., N0=5., aniso=0., hy_amp=0.)


def vector(**kw):
    d = dict(DEFAULT); d.update(kw)
    return np.array([float(d[n]) for n in NAMES])


@njit(cache=True, fastmath=False)
def mat_step(P, gaps, S, dt, t, dep, dd, v1, v2, ks):
    """force (N, T1, T2) of the material on the tool; ks: local factor of the stiffness"""
    (k, n, c, lam, r1, tau1, r2, tau2, hyr, hyl, mr, ml, fa, fal, K, db, z0, drift, comp, mu, fk, fl, vr, cv, dmu, vs, p, N0, an, hya) = (
        P[0], P[1], P[2], P[3], P[4], P[5], P[6], P[7], P[8], P[9], P[10], P[11], P[12], P[13], P[14], P[15], P[16], P[17], P[18], P[19],
        P[20], P[21], P[22], P[23], P[24], P[25], P[26], P[27], P[28], P[29])
    x = dep + z0
    if comp > 0:
        x -= comp * S[8]
    e = 0.0
    for h in gaps:
        if x > h:
            if n == 1.0:
                e += x - h
            else:
                e += (x - h) ** n
    e *= k / gaps.size * ks * (1 + drift * t / 60)
    if x > db:
        e += K * (x - db)
    if x > S[4]:
        S[4] = x
    if mr != 0.0 and S[4] > 0 and x > 0:
        e *= 1 - mr * (1 - np.exp(-(S[4] - x) / ml))
    de = e - S[0]
    S[0] = e
    S[1] = (S[1] + r1 * de) / (1 + dt / tau1)
    S[2] = (S[2] + r2 * de) / (1 + dt / tau2)
    N = e + S[1] + S[2]
    if x > 0:
        a = dd * dt
        S[3] = (S[3] + a / hyl) / (1 + abs(a) / hyl)
        ramp = x / (x + 2e-5)
        N += c * dd * ramp + lam * e * dd + (hyr * e + hya * min(1.0, x / 2e-4)) * S[3]
    if N < 0.0:
        N = 0.0
    Nf = N
    if fa > 0:
        if x > 0:
            S[5] = min(1.0, S[5] + x / 2e-4 * 0.05 + dt / .05)
        elif x < -fal:
            S[5] = 0.0
        if S[5] > 0:
            N -= fa * S[5] * min(1.0, 1 + x / fal) if x < 0 else fa * S[5]
    if comp > 0:
        S[8] += (N - S[8]) * min(1.0, dt / 2e-3)
    # friction
    v = np.sqrt(v1 * v1 + v2 * v2)
    m = mu
    if dmu != 0.0:
        m += dmu * np.exp(-(v / vs) ** 2)
    if p != 0.0:
        m *= (max(Nf, 1e-3) / N0) ** p
    a1, a2 = v1 * dt, v2 * dt
    if fk == 2:                                   # rounded
        q = np.sqrt(v * v + vr * vr)
        d1, d2 = v1 / q, v2 / q
    elif fk == 1:                                 # Prandtl
        S[6] += a1 / fl; S[7] += a2 / fl
        r = np.sqrt(S[6] ** 2 + S[7] ** 2)
        if r > 1:
            S[6] /= r; S[7] /= r
        d1, d2 = S[6], S[7]
    elif fk == 3:                                 # elasto-plastic (stick zone 0.6)
        r = np.sqrt(S[6] ** 2 + S[7] ** 2)
        g = 0.0
        if r > .6:
            g = min(1.0, (r - .6) / .4)
        b = np.sqrt(a1 * a1 + a2 * a2) / fl * g
        S[6] = (S[6] + a1 / fl) / (1 + b); S[7] = (S[7] + a2 / fl) / (1 + b)
        d1, d2 = S[6], S[7]
    else:                                         # Dahl; 4: LuGre with micro damping
        b = np.sqrt(a1 * a1 + a2 * a2) / fl
        S[6] = (S[6] + a1 / fl) / (1 + b); S[7] = (S[7] + a2 / fl) / (1 + b)
        d1, d2 = S[6], S[7]
        if fk == 4:
            w = 0.002 / (1 + v / .01)
            d1 += w * v1 / fl * 0.02; d2 += w * v2 / fl * 0.02
    T1 = -m * (1 + an) * Nf * d1
    T2 = -m * (1 - an) * Nf * d2
    if x > 0:
        T1 -= cv * v1; T2 -= cv * v2
    elif Nf <= 0:
        S[6] = 0.0; S[7] = 0.0
    return N, T1, T2


@njit(cache=True)
def predict(P, gaps, t, dep, dd, v1, v2, ks):
    n = t.size
    out = np.zeros((n, 3))
    S = np.zeros(12)
    for i in range(n):
        dt = t[i] - t[i - 1] if i else 1e-3
        a, b, c = mat_step(P, gaps, S, dt, t[i], dep[i], dd[i], v1[i], v2[i], ks[i])
        out[i, 0] = a; out[i, 1] = b; out[i, 2] = c
    return out


@njit(cache=True)
def lag1(t, x, tau):
    y = x.copy()
    for i in range(1, t.size):
        a = 1 - np.exp(-(t[i] - t[i - 1]) / tau) if tau > 1e-9 else 1.0
        y[i] = y[i - 1] + a * (x[i] - y[i - 1])
    return y


@njit(cache=True)
def tester(P, gaps, dt, cmd, wn, extz, extk, slip_v, kmach):
    """a testing machine: drive of second order behind a spring (frame), crosshead against the sample"""
    n = cmd.size
    out = np.zeros((n, 5))
    S = np.zeros(12)
    x, v, N = cmd[0], 0.0, 0.0
    for i in range(n):
        acc = wn * wn * (cmd[i] - x) - 1.8 * wn * v - N / kmach * wn * wn
        v += acc * dt
        x += v * dt
        N, T1, T2 = mat_step(P, gaps, S, dt, i * dt, x + extz[i], v + (extz[i] - extz[max(i - 1, 0)]) / dt, slip_v[i], 0.0, extk[i])
        out[i, 0] = x; out[i, 1] = v; out[i, 2] = N; out[i, 3] = T1; out[i, 4] = T2
    return out


@njit(cache=True)
def drive(dt, ref, dref, Jm, fc, fv, asym, offs, dmu, vs, spring, ripple, kr, ph, grav, kp, kd, ext, L):
    n = ref.size
    out = np.zeros((n, 4))
    q, v, z = ref[0], dref[0], 0.0
    sub = 2
    h = dt / sub
    for i in range(n):
        tau = kp * (ref[i] - q) + kd * (dref[i] - v)
        a = 0.0
        for _ in range(sub):
            b = v * h / L
            z = (z + b) / (1 + abs(b))
            f = (fc + dmu * np.exp(-(v / vs) ** 2)) * z + fv * v + asym * abs(z) + offs + spring * q + ripple * np.sin(kr * q + ph) + grav * np.sin(q) + ext[i]
            a = (tau - f) / Jm
            v += a * h
            q += v * h
        out[i, 0] = q; out[i, 1] = v; out[i, 2] = a; out[i, 3] = tau
    return out


@njit(cache=True)
def play(s, w):
    """backlash of half-width w: noise of the encoders makes no path of slip"""
    y = s.copy()
    for i in range(1, s.shape[0]):
        a = s[i, 0] - y[i - 1, 0]; b = s[i, 1] - y[i - 1, 1]
        r = np.sqrt(a * a + b * b)
        y[i, 0] = y[i - 1, 0]; y[i, 1] = y[i - 1, 1]
        if r > w:
            y[i, 0] += a * (1 - w / r); y[i, 1] += b * (1 - w / r)
    return y
