"""The contact: a row of springs (method of dimensionality reduction), each with Prony memory, and bristle/Jenkin friction."""
import math
import numpy as np
from numba import njit

NAMES = ("c lam rho1 tau1 rho2 tau2 hys_r hys_a hys_l mul_r mul_l adh_F adh_s adh_l adh_r adh_p lay_K lay_d z0 drift g1 g2 "
         "mu visc dmu vs len vr p a ftype C K n aK rate_out tex_a tex_l thix plast mu_t mu_f jump_a jump_d").split()
I = {k: i for i, k in enumerate(NAMES)}
for _k, _v in I.items():
    globals()["P_" + _k] = _v
NP = len(NAMES)
NE = 24          # elements of the foundation
NS = 16 + 2 * NE + 16
# state: 0 hysteresis z, 1 deepest depth, 2 last depth, 3,4 bristle, 5 Nfilt, 6 touched, 7 thix, 8 plastic, 9 jump, 16.. y1, 16+NE.. y2, tail: Jenkin elements


def params(**kw):
    p = np.zeros(NP)
    d = dict(K=1000.0, n=1.0, len=1e-4, mul_l=1e-3, hys_l=1e-3, adh_l=1e-3, adh_r=1e-3, adh_p=1.0, vs=0.01, tau1=1.0, tau2=1.0, tex_l=0.01,
             mu_f=1.0)
    d.update(kw)
    for k, v in d.items():
        p[I[k]] = v
    return p


def foundation(K, n, dmax, kind="exact", rng=None):
    """Heights g_i and stiffnesses k_i with sum k_i max(0, d-g_i) ~ K d^n up to dmax."""
    if n <= 1.0001:
        g = np.zeros(NE)
        k = np.full(NE, K / NE)
        if kind == "rounded":           # rounded rim of a flat punch: the outermost springs touch a little later
            m = NE // 4
            g[-m:] = np.linspace(0, 0.03 * dmax, m)
        return g, k
    # d^n = integral of n(n-1) g^(n-2) (d-g) dg + (point mass at 0 if n=1); graded nodes, weights by least squares
    g = dmax * np.linspace(0, 1, NE + 1)[:-1] ** 2.0
    d = dmax * np.linspace(0.002, 1, 400)
    A = np.maximum(0, d[:, None] - g[None, :])
    from scipy.optimize import nnls
    w = 1 / np.maximum((d / dmax) ** n, 0.02)
    k, _ = nnls(A * w[:, None], w * K * d ** n)
    if kind == "rounded":
        k = k * (1 + 0.01 * np.cos(np.arange(NE)))
    return g, k


@njit(cache=True)
def step(P, g, k, S, depth, rate, s1, s2, v1, v2, t, dt, inh, out):
    """One step: out[0..2] = N, T1, T2 on the tool along normal and tangents. S is changed in place."""
    d = depth + P[P_z0] - P[P_C] * S[5]
    if P[P_tex_a] != 0:
        d += P[P_tex_a] * math.sin(2 * math.pi * (s1 + 0.37 * s2) / P[P_tex_l]) * (1 + 0.6 * math.sin(6.1 * v1 / 0.01))
    if P[P_plast] > 0 and d > 0:        # crushing: what was pressed beyond a share stays down
        if d * P[P_plast] > S[8]:
            S[8] = d * P[P_plast]
    de = d - S[8] if P[P_plast] > 0 else d
    dd = de - S[2]
    S[2] = de
    ne = k.shape[0]
    fe = 0.0
    ft1 = 0.0
    ft2 = 0.0
    e1 = math.exp(-dt / P[P_tau1])
    e2 = math.exp(-dt / P[P_tau2])
    if de > S[1]:
        S[1] = de
    soft = 1.0
    if P[P_mul_r] > 0 and de > 0:
        soft = 1 - P[P_mul_r] * (1 - math.exp(-(S[1] - de) / P[P_mul_l]))
    place = (1 + P[P_drift] * t / 60.0) * inh * soft
    if P[P_thix] > 0:                   # thixotropy: rubbing softens, rest heals
        S[7] += dt * ((1 - S[7]) * 60.0 * math.sqrt(v1 * v1 + v2 * v2 + rate * rate) - S[7] / 4.0)
        place *= 1 - P[P_thix] * S[7]
    visc = 0.0
    for i in range(ne):
        u = de - g[i]
        f = k[i] * u * place if u > 0 else 0.0
        if P[P_lay_K] > 0 and u > P[P_lay_d]:
            f += P[P_lay_K] / ne * (u - P[P_lay_d]) * place
        fe += f
        if P[P_rho1] > 0:
            S[16 + i] = f + (S[16 + i] - f) * e1
            S[16 + ne + i] = f + (S[16 + ne + i] - f) * e2
            visc += P[P_rho1] * (f - S[16 + i]) + P[P_rho2] * (f - S[16 + ne + i])
    N = fe
    if de > 0:
        if visc < -fe:
            visc = -fe
        N += visc + fe * P[P_lam] * rate + P[P_c] * rate * min(1.0, de / 2e-5)
    if P[P_hys_l] > 0 and (P[P_hys_r] > 0 or P[P_hys_a] > 0):
        if de > 0:
            sg = 1.0 if dd > 0 else -1.0
            S[0] = sg + (S[0] - sg) * math.exp(-abs(dd) / P[P_hys_l])
            N += min(P[P_hys_r] * fe + P[P_hys_a], fe) * S[0]
        else:
            S[0] = 0.0
    if P[P_jump_a] > 0 and de > 0:      # snap-through: a shell that buckles at one depth and pops back at another
        if S[9] < 0.5 and de > P[P_jump_d]:
            S[9] = 1.0
        elif S[9] > 0.5 and de < 0.45 * P[P_jump_d]:
            S[9] = 0.0
        S[10] += (S[9] - S[10]) * min(1.0, dt / 0.01)
        N -= P[P_jump_a] * fe * S[10]
    if N < 0:
        N = 0.0
    if P[P_adh_F] > 0:
        if de > 0:
            S[6] = 1.0
            N -= P[P_adh_F] * (1 - (1 - P[P_adh_s]) * math.exp(-(S[1] - de) / P[P_adh_r]))
        elif S[6] > 0.5 and de > -P[P_adh_l]:
            N -= P[P_adh_F] * (1 - (1 - P[P_adh_s]) * math.exp(-(S[1] - de) / P[P_adh_r])) * (1 - (-de / P[P_adh_l]) ** P[P_adh_p])
        elif S[6] > 0.5:
            S[6] = 0.0
            S[1] = 0.0
    S[5] += (N - S[5]) * min(1.0, dt / 0.0015)
    # friction
    out[0] = N
    out[1] = 0.0
    out[2] = 0.0
    load = N + (P[P_adh_F] if P[P_adh_F] > 0 and de > 0 else 0.0) * 0.0
    if load <= 0 or de <= 0:
        for j in range(16 + 2 * ne, S.shape[0]):
            S[j] = 0.0
        S[3] = 0.0
        S[4] = 0.0
        return
    mu = P[P_mu]
    v = math.sqrt(v1 * v1 + v2 * v2)
    if P[P_dmu] != 0:
        mu += P[P_dmu] * math.exp(-(v / P[P_vs]) ** 2)
    if P[P_p] != 0:
        mu *= max(load, 0.02) ** P[P_p]
    if P[P_mu_t] != 0:
        mu *= 1 + P[P_mu_t] * math.sin(2 * math.pi * P[P_mu_f] * t + 2.0 * math.sin(0.9 * t))
    x1 = v1 * dt
    x2 = v2 * dt
    L = P[P_len]
    if P[P_vr] > 0:
        q = math.sqrt(v * v + P[P_vr] ** 2)
        u1 = v1 / q
        u2 = v2 / q
    else:
        x = math.sqrt(x1 * x1 + x2 * x2)
        if x > 0:                       # Dahl / LuGre
            e = math.exp(-x / L)
            S[3] = x1 / x + (S[3] - x1 / x) * e
            S[4] = x2 / x + (S[4] - x2 / x) * e
        u1 = 0.0
        u2 = 0.0
        b = 16 + 2 * ne
        for j in range(4):
            Lj = L * (0.55 + 0.3 * j)
            a1 = S[b + 2 * j] + x1 / Lj
            a2 = S[b + 2 * j + 1] + x2 / Lj
            m = math.sqrt(a1 * a1 + a2 * a2)
            if m > 1:
                a1 /= m
                a2 /= m
            S[b + 2 * j] = a1
            S[b + 2 * j + 1] = a2
            u1 += a1 / 4
            u2 += a2 / 4
        w = P[P_aK]                     # share of Prandtl: four Jenkin elements in parallel
        u1 = w * u1 + (1 - w) * S[3]
        u2 = w * u2 + (1 - w) * S[4]
    fade = min(1.0, de / 1e-4) if P[P_visc] > 0 else 0.0
    out[1] = -mu * (1 + P[P_a]) * load * u1 - P[P_visc] * v1 * fade
    out[2] = -mu * (1 - P[P_a]) * load * u2 - P[P_visc] * v2 * fade


@njit(cache=True)
def place_factor(P, inh, s1, s2):
    """inh: gradient g1 g2, then rows (kind 1 edge/2 inclusion, x, y, width, amount)."""
    f = 1 + P[P_g1] * s1 + P[P_g2] * s2
    for r in range(inh.shape[0]):
        if inh[r, 0] == 1:
            f += inh[r, 4] * 0.5 * (1 + math.tanh((s1 - inh[r, 1]) / inh[r, 3]))
        elif inh[r, 0] == 2:
            f += inh[r, 4] * math.exp(-((s1 - inh[r, 1]) ** 2 + (s2 - inh[r, 2]) ** 2) / (2 * inh[r, 3] ** 2))
    return f if f > 0.1 else 0.1


@njit(cache=True)
def run_tester(P, g, k, t, depth, s1, inh, slip_on):
    n = t.shape[0]
    S = np.zeros(NS)
    out = np.zeros(3)
    F = np.zeros((n, 3))
    for i in range(1, n):
        dt = t[i] - t[i - 1]
        r = (depth[i] - depth[i - 1]) / dt
        v = (s1[i] - s1[i - 1]) / dt
        step(P, g, k, S, depth[i], r, s1[i], 0.0, v, 0.0, t[i], dt, place_factor(P, inh, s1[i], 0.0), out)
        F[i, 0] = out[0]
        F[i, 1] = out[1]
        F[i, 2] = out[2]
    return F
