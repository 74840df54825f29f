"""Contact laws (numba) and the chain of the wrench sensor; one flat set of parameters by name."""
from __future__ import annotations

from math import erf, exp, log1p, sqrt

import numba
import numpy as np

from fem import Law
from motion import Kin

LAW = ("F0 dn c lam r1 tau1 r2 tau2 A LA rho Lm Fa La K db wk z0 alpha C mu ell dmu vs cv p aniso vr inh N0 "
       "snap d1 d2 run S0 patch px nap Fm g0 fric").split()
DEFAULT = dict(F0=8.0, tau1=0.5, tau2=4.0, LA=2e-4, Lm=1e-3, La=4e-4, db=3e-3, wk=1e-4, ell=1e-4, vs=8e-3, N0=5.0,
               d1=3e-3, d2=2e-3, S0=0.1, px=0.0, g0=1e-3)
F0, DN, C_, LAM, R1, TAU1, R2, TAU2, A, LA, RHO, LM, FA, LA_, K, DB, WK, Z0, ALPHA, COMP, MU, ELL, DMU, VS, CV, P_, ANI, \
    VR, INH, N0, SNAP, D1, D2, RUN, S0, PATCH, PX, NAP, FM, G0, FRIC = range(len(LAW))

@numba.njit(cache=True)
def _elastic(x, p, tab, dmax, d0):
    """Elastic force [N] at depth x [m]: finite-element table, free change of exponent, smooth kink of a collar."""
    if x <= 0: return 0.0
    u = x / dmax * (len(tab) - 1)
    i = min(int(u), len(tab) - 2)
    f = p[F0] * (tab[i] + (u - i) * (tab[i + 1] - tab[i]))
    if p[DN] != 0.0: f *= (x / d0) ** p[DN]
    if p[K] != 0.0:
        y = (x - p[DB]) / p[WK]
        f += p[K] * p[WK] * (y if y > 30 else log1p(exp(y)))
    return f

@numba.njit(cache=True)
def _contact(t, d, dd, s1, s2, v1, v2, g, p, tab, dmax, d0, n0):
    """Normal and tangential force of the material on the tool [N] (n x 3) along a motion."""
    out = np.zeros((len(t), 3))
    h1 = h2 = fe0 = zh = wmax = snap = 0.0
    deepest = x0 = -1.0
    z1 = z2 = run = N = rate0 = 0.0
    on = False
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i else 1e-3
        scale, x, rate = (1 + p[ALPHA] * t[i] / 60) * (1 + p[INH] * g[i]), d[i] + p[Z0], dd[i]
        if p[COMP] > 0:                                   # series spring of arm and sensor: implicit in the force
            y = max(x, 0.0)
            xk = y - p[COMP] * N
            for _ in range(12):
                f = _elastic(xk, p, tab, dmax, d0) * scale
                slope = (_elastic(xk + 1e-6, p, tab, dmax, d0) * scale - f) / 1e-6
                r = rate / (1 + p[COMP] * slope)
                q = 1 + p[LAM] * r
                xk -= (xk + p[COMP] * (f * q + p[C_] * r) - y) / (1 + p[COMP] * slope * q)
            if x > 0: x, rate = max(xk, 0.0), r
        e1, e2 = exp(-dt / p[TAU1]), exp(-dt / p[TAU2])
        N = 0.0
        if x > 0:
            fe = _elastic(x, p, tab, dmax, d0) * scale
            if p[SNAP] != 0.0:                            # buckling of a shell: down at d1, back up at d2
                on = x > p[D1] or (on and x > p[D2])
                snap += ((1.0 if on else 0.0) - snap) * (1 - exp(-dt / 0.02))
                fe *= 1 - p[SNAP] * snap
            if p[RHO] > 0:                                # Ogden & Roxburgh 1999, energy of the virgin path
                w = fe * x / (n0 + 1)
                wmax, fm = max(wmax, w), _elastic(d0, p, tab, dmax, d0)
                m, beta = 0.5 * p[LM] * fm, p[LM] / d0
                fe *= 1 - p[RHO] * erf((wmax - w) / (m + beta * wmax))
            h1, h2 = e1 * h1 + p[R1] * p[TAU1] / dt * (1 - e1) * (fe - fe0), e2 * h2 + p[R2] * p[TAU2] / dt * (1 - e2) * (fe - fe0)
            if p[A] != 0.0:
                move = 0.5 * (rate + rate0) * dt if x0 > 0 else x
                sg = 1.0 if move > 0 else -1.0
                zh = sg * p[A] + (zh - sg * p[A]) * exp(-abs(move) / p[LA])
            N, floor = fe * (1 + p[LAM] * rate) + p[C_] * rate + h1 + h2 + zh, 0.0
            if p[FA] > 0:
                deepest = max(deepest, x)
                pull = p[FA] * min(1.0, deepest / 2e-5)
                N -= pull
                floor = -pull
            N = max(N, floor)
            fe0, x0 = fe, x
        else:
            h1, h2 = e1 * h1 - p[R1] * p[TAU1] / dt * (1 - e1) * fe0, e2 * h2 - p[R2] * p[TAU2] / dt * (1 - e2) * fe0
            fe0 = zh = 0.0
            x0 = -1.0
            if deepest > 0 and x > -p[LA_]:               # linear cohesive zone until pull-off
                N = -p[FA] * (1 + x / p[LA_])
            else: deepest = -1.0
        load, rate0 = max(N, 0.0), rate
        if p[FM] != 0.0: N -= p[FM] / (1 + max(-x, 0.0) / p[G0]) ** 2
        if load <= 0: z1 = z2 = 0.0
        else:
            v = sqrt(v1[i] ** 2 + v2[i] ** 2)
            run += v * dt
            mu = p[MU]
            if p[P_] != 0.0: mu *= (max(load, 1e-3) / p[N0]) ** p[P_]
            if p[RUN] != 0.0: mu *= 1 + p[RUN] * (1 - exp(-run / p[S0]))
            if p[PATCH] != 0.0: mu *= 1 + p[PATCH] * 0.5 * (np.tanh((s1[i] - p[PX]) / 2e-3) + 1)
            st = 1 + p[DMU] / p[MU] * exp(-((v / p[VS]) ** 2)) if p[DMU] != 0.0 else 1.0
            if p[VR] > 0: c1, c2 = v1[i] / sqrt(v * v + p[VR] ** 2), v2[i] / sqrt(v * v + p[VR] ** 2)
            elif v < 1e-12: c1, c2 = z1 / p[ELL], z2 / p[ELL]
            else:
                m1, m2 = 0.5 * (v1[i] + v1[max(i - 1, 0)]), 0.5 * (v2[i] + v2[max(i - 1, 0)])
                v = sqrt(m1 * m1 + m2 * m2) + 1e-15
                u1, u2, law, ell = m1 / v, m2 / v, int(p[FRIC]), p[ELL]
                o1, o2 = z1, z2
                if law == 1 or law == 2:                  # Dahl 1968; LuGre (Canudas de Wit 1995), exact over a step
                    le = ell * st if law == 2 else ell
                    e = exp(-v * dt / le)
                    z1, z2 = le * u1 + (z1 - le * u1) * e, le * u2 + (z2 - le * u2) * e
                else:                                     # Prandtl; elasto-plastic (Dupont 2002)
                    steps = int(v * dt / (0.2 * ell)) + 1
                    for _ in range(min(steps, 40)):
                        h, al = v * dt / min(steps, 40), 0.0
                        if law == 3 and z1 * u1 + z2 * u2 > 0:
                            rel = sqrt(z1 * z1 + z2 * z2) / ell
                            al = 0.0 if rel < 0.7 else 0.5 * np.sin(np.pi * (min(rel, 1.0) - 0.85) / 0.3) + 0.5
                        z1 += h * (u1 - al * z1 / ell)
                        z2 += h * (u2 - al * z2 / ell)
                        r = sqrt(z1 * z1 + z2 * z2) / ell
                        if r > 1: z1, z2 = z1 / r, z2 / r
                c1, c2 = z1 / ell, z2 / ell
                if law == 2: c1, c2 = c1 + 5e-4 / ell * (z1 - o1) / dt, c2 + 5e-4 / ell * (z2 - o2) / dt
                else: c1, c2 = c1 * st, c2 * st
            out[i, 1] = -mu * load * (1 + p[ANI]) * c1 - p[CV] * v1[i]
            out[i, 2] = -mu * load * (1 - p[ANI]) * c2 - p[CV] * v2[i]
            if p[NAP] != 0.0: N *= 1 + p[NAP] * c1
        out[i, 0] = N
    return out

def contact(kin: Kin, par: dict, law: Law, profile) -> np.ndarray:
    """Contact forces n x 3 (normal, tangential 1, 2) [N]; `profile` (places, relative stiffness) lies along slip 1."""
    p = np.array([par.get(k, DEFAULT.get(k, 0.0)) for k in LAW], float)
    g = np.interp(kin.s[:, 0], profile[0], profile[1]) if p[INH] else np.zeros(len(kin.t))
    d, dd, s, v = kin.d, kin.dd, kin.s, kin.v
    if kin.rot is not None and any(par.get(f"o{k}", 0.0) for k in "xyz"):      # tip displaced in the tool frame
        o = kin.rot @ np.array([par.get(f"o{k}", 0.0) for k in "xyz"])
        w = np.cross(kin.om, o)
        d, dd, s, v = d - o[:, 2], dd - w[:, 2], s + o[:, :2], v + w[:, :2]
    if par.get("breath"):
        ph = 2 * np.pi * par["bf"] * kin.t + par["bph"]
        d, dd = d + par["breath"] * np.sin(ph), dd + par["breath"] * 2 * np.pi * par["bf"] * np.cos(ph)
    return _contact(kin.t, d, dd, np.ascontiguousarray(s[:, 0]), np.ascontiguousarray(s[:, 1]),
                    np.ascontiguousarray(v[:, 0]), np.ascontiguousarray(v[:, 1]), g, p, law.table, law.dmax, law.d0, law.n)

@numba.njit(cache=True)
def low_pass(t, y, tau, out):
    """First-order low-pass over uneven steps, input linear within a step."""
    for j in range(y.shape[1]):
        z = y[0, j]
        out[0, j] = z
        for i in range(1, len(t)):
            a = (t[i] - t[i - 1]) / tau
            e, k = exp(-a), (y[i, j] - y[i - 1, j]) / a
            z = y[i, j] - k + (z - y[i - 1, j] + k) * e
            out[i, j] = z

@numba.njit(cache=True)
def _ring(t, y, w, zeta, out):
    """Second-order resonance w [rad/s] between contact and sensor (semi-implicit steps)."""
    for j in range(y.shape[1]):
        x, v = y[0, j], 0.0
        out[0, j] = x
        for i in range(1, len(t)):
            n = max(1, int((t[i] - t[i - 1]) * w / 0.05) + 1)
            h = (t[i] - t[i - 1]) / n
            for k in range(n):
                u = y[i - 1, j] + (y[i, j] - y[i - 1, j]) * (k + 1) / n
                v = (v + h * w * w * (u - x)) / (1 + 2 * zeta * w * h)
                x += h * v
            out[i, j] = x

def skew(r: np.ndarray) -> np.ndarray:
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])

def readings(kin: Kin, par: dict, law: Law, profile) -> np.ndarray:
    """What the sensor writes: wrench n x 6 in the sensor frame [N, N·m], or n x 3 (normal, tangential) for a tester."""
    f, arm = contact(kin, par, law, profile), kin.rot is not None
    if par.get("T0"):
        y = np.empty_like(f)
        _ring(kin.t, f, 2 * np.pi / par["T0"], par.get("zeta", 0.03), y)
        f = y
    if arm:
        rt = np.swapaxes(kin.rot, 1, 2)
        base = np.stack([f[:, 1], f[:, 2], f[:, 0]], 1)                      # t1 = x, t2 = y, n = z of the base
        com = np.array([par.get(f"c{k}", 0.0) for k in "xyz"])
        tip, rc = np.array([par.get(f"o{k}", 0.0) for k in "xyz"]) + [0, 0, 0.1], kin.rot @ com
        a = kin.acc + np.cross(kin.al, rc) + np.cross(kin.om, np.cross(kin.om, rc))
        grav = 9.81 * np.array([par.get("lx", 0.0), par.get("ly", 0.0), -1.0])
        ft, fc = par.get("m", 0.0) * np.einsum("nij,nj->ni", rt, grav - a), np.einsum("nij,nj->ni", rt, base)
        tq = np.cross(com, ft) + np.cross(tip, fc)
        if par.get("hose"):                                                   # spring of a hose, fixed above the bench
            pull = -par["hose"] * (np.stack([kin.s[:, 0], kin.s[:, 1], -kin.d], 1) - np.array([0.02, -0.01, 0.04]))
            fh = np.einsum("nij,nj->ni", rt, pull)
            ft, tq = ft + fh, tq + np.cross([0, 0, 0.03], fh)
        if par.get("spin"):                                                   # torsional friction of a patch, Dahl over angle
            sp, z = kin.om[:, 2], np.zeros(len(kin.t))
            for i in range(1, len(z)):
                dq = sp[i] * (kin.t[i] - kin.t[i - 1])
                z[i] = 0.0 if f[i, 0] <= 0 else np.sign(dq) + (z[i - 1] - np.sign(dq)) * np.exp(-abs(dq) / 0.03)
            tq = tq - np.einsum("nij,j->ni", rt, [0, 0, 1.0]) * (par["spin"] * np.maximum(f[:, 0], 0) * z)[:, None]
        w, rv = np.hstack([ft + fc, tq]), np.array([par.get(f"e{k}", 0.0) for k in "xyz"])
        if rv.any():
            th = np.linalg.norm(rv)
            k = skew(rv / th)
            M = np.eye(3) + np.sin(th) * k + (1 - np.cos(th)) * k @ k
            w = np.hstack([w[:, :3] @ M, w[:, 3:] @ M])                      # readings in turned sensor axes
        X = np.array([[1.0 if i == j else par.get(f"x{i}{j}", 0.0) for j in range(6)] for i in range(6)])
        w = w @ X.T * (1 + par.get("gain", 0.0))
    else: w = f
    if par.get("lag"):
        y = np.empty_like(w)
        low_pass(kin.t, np.ascontiguousarray(w), par["lag"], y)
        w = y
    if par.get("toff"): w = np.stack([np.interp(kin.t - par["toff"], kin.t, w[:, j]) for j in range(w.shape[1])], 1)
    n = w.shape[1]
    w = w + np.array([par.get(f"b{j}", 0.0) for j in range(n)])
    w = w + np.array([par.get(f"k{j}", 0.0) for j in range(n)]) * kin.t[:, None] / 60
    return w

def finish(t: np.ndarray, w: np.ndarray, par: dict, noise: np.ndarray | float = 0.0, clip_noise: bool = True) -> np.ndarray:
    """Hum, nonlinearity, noise, clip and steps of the electronics, at the sampling times t."""
    n = w.shape[1]
    arm = n == 6
    if par.get("hum"):
        sin = lambda h: np.sin(2 * np.pi * h * par["hf"] * t + par["hph"] + h)
        hum = par["hum"] * (sin(1) + 0.25 * sin(3))
        w = w + hum[:, None] * (np.array([1, 0.8, 1.2, 0.02, 0.02, 0.01]) if arm else np.array([1, 0.7, 0.7]))
    if par.get("nl"): w = w + par["nl"] * w * np.abs(w) / (np.array([40, 40, 40, 2, 2, 2]) if arm else 30.0)
    w = w + noise * clip_noise
    if par.get("sat"): w[:, 2 if arm else 0] = np.clip(w[:, 2 if arm else 0], -par["sat"], par["sat"])
    w = w + noise * (not clip_noise)
    if par.get("step"):
        st = par["step"] * (np.array([1, 1, 1, 0.02, 0.02, 0.02]) if arm else np.ones(3))
        w = np.round(w / st) * st
    return w
