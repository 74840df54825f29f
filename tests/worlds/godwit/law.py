"""The touch: one compiled step of a soft contact with memory, used by the world (a bed of columns, coupled to a moving mass)
and, with a single column and the measured motion, by our own fits."""
import numpy as np
from numba import njit

# names and defaults of a law's numbers; the order is the array's
LAW = dict(k=0., n=1., el=1., c=0., B=0., nB=1., lam=0., rho=0., tau=1., rho2=0., tau2=1., hy_r=0., hy_l=1e-3, ss_r=0., ss_l=1e-3,
           ad_F=0., ad_l=1e-3, st_K=0., st_d=1., z0=0., drift=0., ih_kind=0., ih_a=0., ih_x=0., ih_w=.01, ih_dir=0.,
           mu=0., ell=1e-4, cv=0., st_mu=0., st_v=.01, vr=0., p=1., an=0., fkind=0., lg_s=0.,
           # outside the catalogue
           dent_r=0., dent_F=0., age_b=0., age_t=1., pl_c=0., snap_F=0., snap_d=1., snap_w=1e-3, poro=0.,
           punct_F=0., punct_r=0., cs_k=0.)
IX = {n: i for i, n in enumerate(LAW)}
for _n, _i in IX.items():
    globals()['I_' + _n] = _i
NS = 16


def pack(d):
    return np.array([float(d.get(n, v)) for n, v in LAW.items()])


@njit(cache=True)
def kscale(P, t, s1, s2):
    x = s1 * np.cos(P[I_ih_dir]) + s2 * np.sin(P[I_ih_dir])
    u = (x - P[I_ih_x]) / P[I_ih_w]
    g = 0.0
    if P[I_ih_kind] == 1:
        g = np.tanh(u)
    elif P[I_ih_kind] == 2:
        g = np.exp(-u * u)
    elif P[I_ih_kind] == 3:
        g = u
    return (1 + P[I_drift] * t / 60.0) * (1 + P[I_ih_a] * g)


@njit(cache=True)
def step(P, S, Y, h, ks, t, dt, delta, dd, v1, v2, out):
    """S: 0 z hysteresis, 1 delta max, 2 bonded, 3 4 bristle, 5 dent, 6 rest time, 7 aged gain, 8 snapped, 9 punctured, 10 poro.
    Y[col, 2]: branch states. h: column heights. out: N, T1, T2."""
    m = h.shape[0]
    d0 = delta + P[I_z0] - S[5]
    touching = d0 > h.min()
    dm = max(d0, 0.0)
    # memory of depth
    if dm > S[1]:
        S[1] = dm
    soft = 1.0
    if P[I_ss_r] != 0:
        soft = 1 - P[I_ss_r] * (1 - np.exp(-(S[1] - dm) / P[I_ss_l]))
    if S[9] > 0:
        soft *= 1 - P[I_punct_r]
    if touching:
        x = dd * dt / P[I_hy_l]
        e = np.exp(-abs(x))
        S[0] = np.sign(x) + (S[0] - np.sign(x)) * e
    else:
        S[0] = 0.0
    N = 0.0
    a1 = 1 - np.exp(-dt / P[I_tau])
    a2 = 1 - np.exp(-dt / P[I_tau2])
    for j in range(m):
        d = d0 - h[j]
        Fe, f = 0.0, 0.0
        if d > 0:
            g = d if P[I_n] == 1.0 else d ** P[I_n]
            Fe = P[I_k] * ks * g * soft
            f = P[I_el] * Fe + P[I_hy_r] * Fe * S[0] + P[I_c] * dd + P[I_lam] * Fe * dd
            if P[I_B] != 0:
                f += P[I_B] * d ** P[I_nB] * dd
            if d > P[I_st_d]:
                f += P[I_st_K] * (d - P[I_st_d])
        r = P[I_rho] * (Fe - Y[j, 0]) + P[I_rho2] * (Fe - Y[j, 1])
        f += max(r, -Fe) if P[I_el] > 0 else r
        Y[j, 0] += a1 * (Fe - Y[j, 0])
        Y[j, 1] += a2 * (Fe - Y[j, 1])
        if d > 0 and f > 0:
            N += f / m
    if P[I_poro] > 0:                       # pore water: a memory like t^(-1/2), three spread branches
        for q in range(3):
            tq = 0.15 * 6.0 ** q
            S[10 + q] += (1 - np.exp(-dt / tq)) * (N - S[10 + q])
        N = max(N + P[I_poro] * (N - (S[10] + S[11] + S[12]) / 3), 0.0)
    if P[I_snap_F] > 0:                     # a dome that snaps through and back with its own hysteresis
        if S[8] == 0 and dm > P[I_snap_d] + 0.1 * P[I_snap_w]:
            S[8] = 1.0
        if S[8] == 1 and dm < P[I_snap_d] - P[I_snap_w]:
            S[8] = 0.0
        S[13] += (1 - np.exp(-dt / 0.004)) * (S[8] - S[13])
        N = max(N - P[I_snap_F] * S[13] * min(dm / P[I_snap_d], 1.0), 0.0)
    if P[I_punct_F] > 0 and N > P[I_punct_F]:
        S[9] = 1.0
    if P[I_dent_r] > 0 and N > P[I_dent_F]:  # plastic dent: the surface itself yields above a load, and stays
        S[5] += P[I_dent_r] * (N - P[I_dent_F]) * dt
    Nc = N                                  # pressing load that friction sees
    if P[I_ad_F] > 0:
        if touching:
            S[2] = 1.0
        if S[2] > 0:
            gap = -d0
            if gap > P[I_ad_l]:
                S[2] = 0.0
            else:
                N -= P[I_ad_F] * min(1.0, 1 - gap / P[I_ad_l])
    # along the surface
    v = np.sqrt(v1 * v1 + v2 * v2)
    if P[I_age_b] > 0:
        if touching and v < 2e-4:
            S[6] += dt
        else:
            S[7] = max(S[7] * np.exp(-v * dt / 2e-3), P[I_age_b] * np.log(1 + S[6] / P[I_age_t]) if S[6] > 0.05 else 0.0)
            S[6] = 0.0
    if not touching and S[2] == 0:
        S[3] = 0.0
        S[4] = 0.0
        out[0] = N
        out[1] = 0.0
        out[2] = 0.0
        return
    mu = P[I_mu]
    if P[I_st_mu] != 0:
        mu += P[I_st_mu] * np.exp(-(v / P[I_st_v]) ** 2)
    if P[I_age_b] > 0:
        mu *= 1 + S[7]
    load = Nc
    if P[I_p] != 1.0:
        load = Nc * max(Nc / 5.0, 1e-4) ** (P[I_p] - 1)
    if P[I_vr] > 0:
        w = np.sqrt(v * v + P[I_vr] ** 2)
        u1, u2 = v1 / w, v2 / w
    else:
        x1, x2 = v1 * dt / P[I_ell], v2 * dt / P[I_ell]
        if P[I_fkind] == 1:                 # Prandtl: elastic, then perfectly slipping
            S[3] += x1
            S[4] += x2
            w = np.sqrt(S[3] ** 2 + S[4] ** 2)
            if w > 1:
                S[3] /= w
                S[4] /= w
        else:                               # Dahl
            x = np.sqrt(x1 * x1 + x2 * x2)
            if x > 0:
                e = np.exp(-x)
                S[3] = x1 / x + (S[3] - x1 / x) * e
                S[4] = x2 / x + (S[4] - x2 / x) * e
        u1, u2 = S[3], S[4]
        if P[I_lg_s] > 0:                   # LuGre's micro-damping
            u1 += P[I_lg_s] * (v1 - v * S[3])
            u2 += P[I_lg_s] * (v2 - v * S[4])
    T = mu * load
    out[0] = N
    out[1] = -T * (1 + P[I_an]) * u1 - P[I_cv] * v1 - P[I_pl_c] * dm * np.tanh(v1 / 2e-3)
    out[2] = -T * (1 - P[I_an]) * u2 - P[I_cv] * v2 - P[I_pl_c] * dm * np.tanh(v2 / 2e-3)


@njit(cache=True)
def run_law(P, t, delta, dd, s1, s2, v1, v2, ksx):
    """The law on a given motion (our fits)."""
    n = t.shape[0]
    out = np.zeros((n, 3))
    S, Y, h, o = np.zeros(NS), np.zeros((1, 2)), np.zeros(1), np.zeros(3)
    for i in range(n):
        dt = t[i] - t[i-1] if i else 1e-3
        step(P, S, Y, h, kscale(P, t[i], s1[i], s2[i]) * ksx[i], t[i], dt, delta[i], dd[i], v1[i], v2[i], o)
        out[i] = o
    return out


@njit(cache=True)
def simulate(P, h, dt, pc, vc, off, doff, dth, pt0, nrm, t1, t2, mass, K, D, C, jig):
    """A tip mass on an impedance controller (pc, vc: command), pressing the bed of columns. Returns the encoders' tip position,
    its acceleration and the contact force in the base frame, with N, T and the true depth. nrm, t1, t2: the real surface."""
    n = pc.shape[0]
    p, v = pc[0].copy(), vc[0].copy()
    S, Y, o = np.zeros(NS), np.zeros((h.shape[0], 2)), np.zeros(3)
    X, A, F, W = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4))
    flex = 0.0
    for i in range(n):
        c = p + off[i] - pt0
        vv = v + doff[i]
        dflex = (C * o[0] - flex) / 0.002 if C > 0 else 0.0
        flex += dflex * dt
        delta = -(c[0]*nrm[0] + c[1]*nrm[1] + c[2]*nrm[2]) - flex
        dd = -(vv[0]*nrm[0] + vv[1]*nrm[1] + vv[2]*nrm[2]) - dflex
        s1 = c[0]*t1[0] + c[1]*t1[1] + c[2]*t1[2]
        s2 = c[0]*t2[0] + c[1]*t2[1] + c[2]*t2[2]
        v1 = vv[0]*t1[0] + vv[1]*t1[1] + vv[2]*t1[2]
        v2 = vv[0]*t2[0] + vv[1]*t2[1] + vv[2]*t2[2]
        delta += dth[i]
        step(P, S, Y, h, kscale(P, i * dt, s1, s2), i * dt, dt, delta, dd, v1, v2, o)
        for a in range(3):
            F[i, a] = o[0] * nrm[a] + o[1] * t1[a] + o[2] * t2[a]
            A[i, a] = (K * (pc[i, a] - p[a]) + D * (vc[i, a] - v[a]) + F[i, a] + jig[i, a]) / mass
            X[i, a] = p[a]
        W[i, 0] = delta
        W[i, 1] = o[0]
        W[i, 2] = o[1]
        W[i, 3] = o[2]
        for a in range(3):
            v[a] += A[i, a] * dt
            p[a] += v[a] * dt
    return X, A, F, W
