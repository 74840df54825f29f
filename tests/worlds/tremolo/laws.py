"""The contact law, one sample at a time (numba), for the closed loop and for the refits.

Normal: elastic power law (Hertz 1882; Hunt & Crossley 1975 for the damping), quasi-linear viscoelastic branches (Fung 1993),
Mullins softening (exponential in the distance to the deepest depth, after Ogden & Roxburgh 1999), Dahl-type rate-independent loop,
Dugdale/Maugis-like adhesion (1992), bilinear layer. Tangential: Dahl 1968, Prandtl 1928, LuGre (Canudas de Wit et al. 1995),
elasto-plastic (Dupont et al. 2002) bristles in two dimensions, Stribeck (Armstrong-Helouvry et al. 1994), Bowden-Tabor load exponent."""
import numpy as np
from numba import njit

NAMES = ("F0 D0 n c lam r1 tau1 r2 tau2 hA hL mR mL aF aL aform sK sB z0 alpha ikind i1 i2 i3 i4 i5 C mu cv dmu vs L vr p N0 a "
         "bristle s1 eps wobA wobF wobP punD punR rough roughL").split()
IX = {k: i for i, k in enumerate(NAMES)}
DEFAULT = dict(D0=1e-3, n=1.0, tau1=1.0, tau2=1.0, hL=1e-3, mL=1e-3, aL=1e-3, sB=1.0, vs=0.01, L=1e-4, N0=5.0, wobF=0.25, punD=1.0, roughL=3e-3)
NS = 16

(F0, D0, n_, c_, lam, r1, tau1, r2, tau2, hA, hL, mR, mL, aF, aL, aform, sK, sB, z0, alpha, ikind, i1, i2, i3, i4, i5, C, mu, cv, dmu,
 vs, L, vr, p_, N0, a_, bristle, s1_, eps, wobA, wobF, wobP, punD, punR, rough, roughL) = range(len(NAMES))


def pack(d):
    P = np.zeros(len(NAMES))
    for k, v in {**DEFAULT, **d}.items():
        P[IX[k]] = v
    return P


@njit(cache=True)
def place(P, x, y):
    """Relative stiffness at a place: 1 gradient (i1, i2 per metre), 2 edge (step i1 at i2 along direction i3, width i4), 3 inclusion."""
    k = P[ikind]
    if k == 1:
        return P[i1] * x + P[i2] * y
    if k == 2:
        return P[i1] * np.tanh((x * np.cos(P[i3]) + y * np.sin(P[i3]) - P[i2]) / P[i4])
    if k == 3:
        return P[i1] * np.exp(-((x - P[i2]) ** 2 + (y - P[i3]) ** 2) / (2 * P[i4] ** 2))
    return 0.0


@njit(cache=True)
def contact(P, S, dt, t, d, dd, x, y, vx, vy):
    """S: 0,1 bristle; 2 loop; 3 deepest depth; 4,5 Maxwell forces; 6 last elastic force; 7 bond; 8 last depth; 9,10 last place; 11 inside; 12 holes."""
    if P[wobA] != 0.0:      # the surface itself moves (outside the catalogue)
        ph = 2 * np.pi * P[wobF] * t + P[wobP]
        d = d + P[wobA] * (np.sin(ph) + 0.25 * np.sin(2 * ph + 1.0))
        dd = dd + P[wobA] * 2 * np.pi * P[wobF] * (np.cos(ph) + 0.5 * np.cos(2 * ph + 1.0))
    if P[rough] != 0.0:
        d = d + P[rough] * np.sin(2 * np.pi * x / P[roughL])
    d = d + P[z0]
    step = d - S[8]
    sx, sy = x - S[9], y - S[10]
    S[8] = d; S[9] = x; S[10] = y
    fe = 0.0
    if d > 0:
        if d > S[3]:
            S[3] = d
        fe = P[F0] * (d / P[D0]) ** P[n_]
        if P[eps] != 0.0:
            fe *= 1 + P[eps] * (d / P[D0] - 0.7)
        if P[mR] != 0.0:
            fe *= 1 - P[mR] * (1 - np.exp(-(S[3] - d) / P[mL]))
        if P[sK] != 0.0 and d > P[sB]:
            fe += P[sK] * (d - P[sB])
        if P[punR] != 0.0:      # the skin breaks at a depth, once and for all (outside the catalogue)
            if d > P[punD] and S[12] < 1:
                S[12] = 1.0
            fe *= 1 - P[punR] * S[12]
        fe *= (1 + P[alpha] * t / 60) * (1 + place(P, x, y))
    f = fe * (1 - P[r1] - P[r2])
    dfe = fe - S[6]
    S[6] = fe
    if P[r1] != 0.0:
        u = dt / P[tau1]; e = np.exp(-u)
        S[4] = S[4] * e + P[r1] * dfe * ((1 - e) / u if u > 1e-12 else 1.0)
        f += S[4]
    if P[r2] != 0.0:
        u = dt / P[tau2]; e = np.exp(-u)
        S[5] = S[5] * e + P[r2] * dfe * ((1 - e) / u if u > 1e-12 else 1.0)
        f += S[5]
    if d > 0:
        if S[11] == 0.0:
            S[11] = 1.0; S[2] = 0.0; S[0] = 0.0; S[1] = 0.0
        f += P[c_] * dd + P[lam] * fe * dd
        if P[hA] != 0.0:
            s = 1.0 if step > 0 else -1.0
            S[2] = s + (S[2] - s) * np.exp(-abs(step) / P[hL])
            f += P[hA] * S[2]
        if f < 0:
            f = 0.0
        if P[aF] != 0.0:
            S[7] = max(S[7], min(1.0, d / 5e-5))
            f -= P[aF] * S[7]
    else:
        S[11] = 0.0
        f = 0.0
        if S[7] > 0:
            u = -d / P[aL]
            if u < 1:
                f = -P[aF] * S[7] * (1.0 if P[aform] == 0 else 1 - u * u)
            else:
                S[7] = 0.0
    N = f
    if d <= 0:
        return N, 0.0, 0.0
    load = max(N, 0.0)
    v = np.sqrt(vx * vx + vy * vy)
    m = P[mu]
    if P[dmu] != 0.0:
        m += P[dmu] * np.exp(-(v / P[vs]) ** 2)
    if P[p_] != 0.0:
        m *= (max(load, 1e-3) / P[N0]) ** P[p_]
    if P[vr] > 0:
        w = np.sqrt(v * v + P[vr] ** 2)
        zx, zy = vx / w, vy / w
    else:
        ds = np.sqrt(sx * sx + sy * sy)
        ox, oy = S[0], S[1]
        if ds > 0:
            k = P[bristle]
            if k == 0 or k == 2:
                e = np.exp(-ds / P[L])
                S[0] = sx / ds + (ox - sx / ds) * e
                S[1] = sy / ds + (oy - sy / ds) * e
            else:
                if k == 3:      # elasto-plastic: no creep below 0.6 of break-away
                    r = np.sqrt(ox * ox + oy * oy)
                    al = min(1.0, max(0.0, (r - 0.6) / 0.4))
                    if ox * sx + oy * sy < 0:
                        al = 0.0
                    S[0] = ox + (sx - al * ds * ox) / P[L]
                    S[1] = oy + (sy - al * ds * oy) / P[L]
                else:
                    S[0] = ox + sx / P[L]
                    S[1] = oy + sy / P[L]
                r = np.sqrt(S[0] ** 2 + S[1] ** 2)
                if r > 1:
                    S[0] /= r; S[1] /= r
        zx, zy = S[0], S[1]
        if P[s1_] != 0.0 and dt > 0:
            b = P[s1_] / dt * np.exp(-(v / 0.005) ** 2)
            zx += b * (S[0] - ox); zy += b * (S[1] - oy)
    return N, -m * (1 + P[a_]) * load * zx - P[cv] * vx, -m * (1 - P[a_]) * load * zy - P[cv] * vy


@njit(cache=True)
def run(P, t, d, dd, x, y, vx, vy):
    n = len(t)
    out = np.zeros((n, 3))
    S = np.zeros(16)
    if n:
        S[8] = d[0]; S[9] = x[0]; S[10] = y[0]
    for k in range(n):
        dt = t[k] - t[k - 1] if k else 0.0
        a, b, c = contact(P, S, dt, t[k], d[k], dd[k], x[k], y[k], vx[k], vy[k])
        out[k, 0] = a; out[k, 1] = b; out[k, 2] = c
    return out
