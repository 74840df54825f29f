"""One-axis geared drives: motor and load inertia, elastic gear, friction, ripple, backlash, gear hysteresis, warming; all at the gear's output side.

J_m θ̈_m = u − F(ω_m, τ_g, z, T) − r(θ_m) − τ_g,  J_l θ̈_l = τ_g − k_s θ_l,  τ_g = K dz(θ_m − θ_l) + D ω_rel + h,
F = g(ω, τ_g) z + F_v(T) ω + asymmetry + offset, g = F_c + F_s exp(−(ω/ω_s)²) + f_l |τ_g| (Waiboer 2007; Hamon 2010), ż = ω/ℓ (1 − z sgn ω) (Dahl 1968),
F_v(T) = F_v exp(−β (T − T_0)), C Ṫ = (F ω) − H (T − T_0) (Bittencourt 2010/2014), ḣ = A ω_rel/x_h (1 − h sgn(ω_rel)/A)-type Bouc-Wen (Dhaouadi 2003),
r = Σ A_i sin(i k θ + φ_i) (gear mesh, harmonic drive), load cogging κ |τ_g| sin(n θ) (torque-constant ripple).
"""
from __future__ import annotations

import numpy as np
from numba import njit

(JM, JL, KG, DG, FC, FS, WS, FV, FL, ASYM, ELL, VRD, OFF, KSPR, A1, A2, PH1, PH2, KR, COG, NCOG, PHC, BETA, CTH, HTH, BACK, HA, HX, T0D, KAP, XC, COMP) = range(32)
TERMS = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "joint-stribeck-friction",
         "joint-load-friction", "joint-torque-ripple", "joint-spring", "warming", "load-cogging", "cable"]


@njit(cache=True)
def dahl(z, dx, ell):
    """Exact step of ż = v/ℓ (1 − z sgn v) over a travel dx."""
    s = 1.0 if dx >= 0 else -1.0
    return s + (z - s) * np.exp(-abs(dx) / ell)


@njit(cache=True)
def simulate(r, vr, ar, dt, sub, P, kp, kd, dist):
    """Forward integration (semi-implicit, dt/sub). Returns N×6: θ_m, ω_m, α_m, τ_g, u, θ_l, and N×11 torque terms (order TERMS)."""
    n = len(r)
    out = np.zeros((n, 6))
    terms = np.zeros((n, 11))
    h = dt / sub
    q, w, ql, wl, z, hy, T, cab = r[0], vr[0], r[0], vr[0], 0.0, 0.0, 0.0, 0.0
    J = P[JM] + P[JL]
    for i in range(n):
        for s in range(sub):
            x = s / sub
            k = min(i + 1, n - 1)
            rr, rv, ra = r[i] + x * (r[k] - r[i]), vr[i] + x * (vr[k] - vr[i]), ar[i] + x * (ar[k] - ar[i])
            fr = rv / np.sqrt(rv * rv + (P[VRD] + P[WS] * 0.03) ** 2)
            ff = P[COMP] * ((P[FC] + P[FS] * np.exp(-(rv / P[WS]) ** 2) + P[FL] * abs(J * ra)) * fr + P[FV] * rv + P[ASYM] * abs(fr) + P[OFF] + P[KSPR] * rr)
            u = ff + J * ra + kp * (rr - q) + kd * (rv - w) + dist[i]
            phi = q - ql
            gap = P[BACK] / 2
            el = phi - gap if phi > gap else (phi + gap if phi < -gap else 0.0)
            contact = 1.0 if gap == 0.0 or el != 0.0 else 0.0
            tg = P[KG] * el + P[DG] * (w - wl) * contact + P[HA] * hy
            spring = P[KSPR] * ql
            rough = w / np.sqrt(w * w + P[VRD] ** 2) if P[VRD] > 0 else z
            c1 = P[FC] * rough
            c2 = P[FV] * w
            c3 = P[ASYM] * abs(rough)
            c5 = P[FS] * np.exp(-(w / P[WS]) ** 2) * rough
            c6 = P[FL] * abs(tg) * rough
            c7 = P[A1] * np.sin(P[KR] * q + P[PH1]) + P[A2] * np.sin(2 * P[KR] * q + P[PH2])
            c9 = P[FV] * w * (np.exp(-P[BETA] * T) - 1)
            c10 = P[COG] * abs(tg) * np.sin(P[NCOG] * q + P[PHC])
            c11 = P[KAP] * cab
            F = c1 + c2 + c3 + P[OFF] + c5 + c6 + c7 + c9 + c10 + c11
            al = (u - F - tg) / P[JM]
            if s == 0:
                out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5] = q, w, al, tg, u, ql
                terms[i, :] = np.array([c1, c2, c3, P[OFF], c5, c6, c7, spring, c9, c10, c11])
            T += h * (P[CTH] * abs((c1 + c2 + c3 + c5 + c6 + c9) * w) - P[HTH] * T)
            w += h * al
            wl += h * (tg - spring) / P[JL]
            q += h * w
            ql += h * wl
            z = dahl(z, h * w, P[ELL])
            hy = dahl(hy, h * (w - wl), P[HX])
            cab = dahl(cab, h * w, P[XC])
    return out, terms


def motion(rng: np.random.Generator, T: float, dt: float, vmax: float, span: float, slow: bool, rests: bool, fmax: float, chirp: float) -> tuple:
    """A reference: strokes back and forth at several constant speeds, then a multi-sine up to fmax [Hz]; units rad or m. Returns r, v, a."""
    n = int(T / dt)
    v = np.zeros(n)
    i, dirn = int(0.4 / dt), 1
    half = int(n * (0.6 if not chirp else 0.45))
    speeds = [1, 0.3, 0.1, 0.05, 0.025] if slow else [1, 0.6, 0.3, 0.15]
    k = 0
    while i < half:
        s = speeds[k % len(speeds)] * rng.uniform(0.8, 1.1)
        d = min(max(span / (s * vmax), 0.6), 2.4)
        for _ in range(2):
            m = int(d / dt)
            v[i:min(i + m, half)] = dirn * s * vmax
            i += m
            dirn = -dirn
            if rests:
                i += int(0.5 / dt)
        k += 1
    w = int(0.22 / dt)
    for _ in range(2):
        v = np.convolve(v, np.ones(w) / w, "same")
    t = np.arange(n) * dt
    env = np.clip((t - half * dt - 0.3) / 0.5, 0, 1) * np.clip((T - 0.4 - t) / 0.5, 0, 1)
    env = env * env * (3 - 2 * env)
    f = np.sort(rng.uniform(0.15, fmax, 5))
    ms = sum(np.sin(2 * np.pi * x * t + rng.uniform(0, 6.28)) for x in f) * vmax * 0.32
    if chirp:
        m = t - half * dt
        span_t = T - half * dt
        ms = 0.6 * ms + 0.45 * vmax * np.sin(2 * np.pi * (0.3 * m + (chirp - 0.3) * m * m / (2 * span_t)))
    v = v + env * ms
    r = np.cumsum(v) * dt
    r = r - np.mean(r) if not rests else r
    return r, v, np.gradient(v, dt)
