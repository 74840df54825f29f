"""tern: kinematics, dynamics, contact law and simulation (own code; numpy + numba only)."""
import numpy as np, os
os.environ.setdefault("NUMBA_CACHE_DIR", os.path.join(os.path.dirname(os.path.abspath(__file__)), "__nbcache__"))
import numba as nb, json
from scipy.interpolate import CubicSpline
HERE = os.path.dirname(os.path.abspath(__file__))

# ---------------------------------------------------------------- rotations
def rotv(axis, a):
    """batch rotation about constant unit axis, a (N,)"""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.]])
    a = np.asarray(a, float)[..., None, None]
    return np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * (K @ K)
def rpy(r, p, y):
    return rotv((0, 0, 1), y) @ rotv((0, 1, 0), p) @ rotv((1, 0, 0), r)
def logm(R):
    c = np.clip((np.trace(R, axis1=-2, axis2=-1) - 1) / 2, -1, 1); th = np.arccos(c)
    w = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    s = np.where(th > 1e-6, th / (2 * np.sin(np.maximum(th, 1e-6))), 0.5)
    return w * s[..., None]

# ---------------------------------------------------------------- robots
class Robot:
    def __init__(s, name, off, rot, axes, m, com, I, flange=(np.zeros(3), np.eye(3)), q0=None, urdf=None):
        s.name, s.off, s.axes = name, [np.array(o, float) for o in off], [np.array(a, float) for a in axes]
        s.n = len(off); s.m, s.com, s.I = list(m), [np.array(c, float) for c in com], [np.array(i, float) for i in I]
        s.fl = (np.array(flange[0], float), flange[1]); s.q0 = np.array(q0, float)
        s.ft = (np.array([0, 0, 0.03]), np.eye(3)); s.tip = np.array([0, 0, 0.1]); s.flrpy = (0, 0, 0)
        s.tau_max = None
    def fk(s, q):
        N = len(q); R = np.broadcast_to(np.eye(3), (N, 3, 3)); p = np.zeros((N, 3)); Rs, ps = [], []
        for i in range(s.n):
            p = p + R @ s.off[i]; R = R @ rotv(s.axes[i], q[:, i]); Rs.append(R); ps.append(p)
        return Rs, ps
    def sensor(s, q, full=False):
        Rs, ps = s.fk(q); p = ps[-1] + Rs[-1] @ s.fl[0]; R = Rs[-1] @ s.fl[1]
        p = p + R @ s.ft[0]; R = R @ s.ft[1]
        return (R, p, Rs, ps) if full else (R, p)
    def ik(s, Rd, pd, it=14):
        """sensor frame to (Rd, pd), batch Newton from q0 (min-norm: smooth)"""
        N = len(pd); q = np.tile(s.q0, (N, 1))
        for k in range(it):
            R, p, Rs, ps = s.sensor(q, True)
            ep = pd - p; eo = np.einsum('nij,nj->ni', R, logm(np.swapaxes(R, 1, 2) @ Rd))
            e = np.concatenate([ep, eo], 1)
            mx = np.abs(e).max()
            if mx < 1e-11: break
            J = np.empty((N, 6, s.n))
            for i in range(s.n):
                z = Rs[i] @ s.axes[i]; J[:, :3, i] = np.cross(z, p - ps[i]); J[:, 3:, i] = z
            JT = np.swapaxes(J, 1, 2)
            dq = (JT @ np.linalg.solve(J @ JT + 1e-12 * np.eye(6), e[..., None]))[..., 0]
            big = np.abs(dq).max(1, keepdims=True); q = q + dq * np.minimum(1, 0.4 / np.maximum(big, 1e-12))
        return q, mx
    def rnea(s, q, v, a, g=np.array([0, 0, -9.81]), payload=None):
        """payload (mass, pos in last link frame)"""
        N = len(q); w = np.zeros((N, 3)); al = np.zeros((N, 3)); acc = np.tile(-np.asarray(g, float), (N, 1))
        Rs, ps = s.fk(q); pp = np.zeros((N, 3)); W, A, AC, Z = [], [], [], []
        for i in range(s.n):
            r = ps[i] - pp; acc = acc + np.cross(al, r) + np.cross(w, np.cross(w, r)); pp = ps[i]
            z = Rs[i] @ s.axes[i]; al = al + z * a[:, i:i + 1] + np.cross(w, z * v[:, i:i + 1]); w = w + z * v[:, i:i + 1]
            W.append(w); A.append(al); AC.append(acc); Z.append(z)
        f = np.zeros((N, 3)); n = np.zeros((N, 3)); tau = np.empty((N, s.n)); pn = ps[-1]
        for i in range(s.n - 1, -1, -1):
            bodies = [(s.m[i], s.com[i], s.I[i])]
            if payload is not None and i == s.n - 1: bodies.append((payload[0], np.asarray(payload[1], float), np.zeros((3, 3))))
            n = n + np.cross(pn - ps[i], f); pn = ps[i]
            for (m, c, I) in bodies:
                rc = Rs[i] @ c; ac = AC[i] + np.cross(A[i], rc) + np.cross(W[i], np.cross(W[i], rc)); F = m * ac
                Iw = Rs[i] @ I @ np.swapaxes(Rs[i], 1, 2)
                h = np.einsum('nij,nj->ni', Iw, W[i])
                n = n + np.einsum('nij,nj->ni', Iw, A[i]) + np.cross(W[i], h) + np.cross(rc, F); f = f + F
            tau[:, i] = (n * Z[i]).sum(1)
        return tau
    def urdf(s):
        def inert(m, c, I):
            return (f'<inertial><origin xyz="{c[0]:.8g} {c[1]:.8g} {c[2]:.8g}"/><mass value="{m:.8g}"/><inertia ixx="{I[0,0]:.8g}" iyy="{I[1,1]:.8g}" '
                    f'izz="{I[2,2]:.8g}" ixy="{I[0,1]:.8g}" ixz="{I[0,2]:.8g}" iyz="{I[1,2]:.8g}"/></inertial>')
        o = [f'<?xml version="1.0"?>\n<robot name="{s.name}">', '<link name="base_link"/>']
        for i in range(s.n):
            x, a = s.off[i], s.axes[i]
            o.append(f'<link name="link_{i+1}">{inert(s.m[i], s.com[i], s.I[i])}</link>')
            par = "base_link" if i == 0 else f"link_{i}"
            o.append(f'<joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{x[0]:.8g} {x[1]:.8g} {x[2]:.8g}" rpy="0 0 0"/>'
                     f'<axis xyz="{a[0]:.0f} {a[1]:.0f} {a[2]:.0f}"/><limit lower="-6.28" upper="6.28" effort="300" velocity="6"/></joint>')
        def fix(nm, par, x, r):
            o.append(f'<link name="{nm}"/><joint name="{nm}_fix" type="fixed"><parent link="{par}"/><child link="{nm}"/><origin xyz="{x[0]:.9g} {x[1]:.9g} {x[2]:.9g}" rpy="{r[0]:.12g} {r[1]:.12g} {r[2]:.12g}"/></joint>')
        fix("flange", f"link_{s.n}", s.fl[0], s.flrpy); fix("ft_sensor", "flange", s.ft[0], (0, 0, s.ftyaw if hasattr(s, 'ftyaw') else 0))
        fix("tool_tip", "ft_sensor", s.tip, (0, 0, 0)); o.append('</robot>\n')
        return "\n".join(o)
    def set_ft(s, z, yaw, tip):
        s.ftyaw = yaw; s.ft = (np.array([0, 0, z]), rotv((0, 0, 1), yaw)); s.tip = np.array(tip, float)

def lwr(rng):
    T = json.load(open(os.path.join(HERE, "..", "given", "lwr4plus_inertia.json"))) if os.path.exists(os.path.join(HERE, "..", "given", "lwr4plus_inertia.json")) else json.load(open(os.path.join(HERE, "lwr4plus_inertia.json")))
    def mat(v): return np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    q2, q4 = rng.uniform(.35, .7), rng.uniform(-1.7, -1.2)
    q0 = [rng.uniform(-1, 1), q2, rng.uniform(-.3, .3), q4, rng.uniform(-.2, .2), np.pi - q2 + q4, rng.uniform(-1, 1)]
    r = Robot("lwr4plus_copy", [(0, 0, z) for z in (.11, .2005, .2, .2, .2, .19, .078)], None,
              [(0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1)],
              [t["m"] for t in T], [t["com"] for t in T], [mat(t["I"]) for t in T], q0=q0)
    r.tau_noise = np.array([.07, .07, .04, .04, .04, .015, .015]); r.KJ = np.array([1e4] * 5 + [7.5e3] * 2)
    r.Fc = np.array([.8, .8, .6, .6, .5, .3, .3]); r.Fv = np.array([.8, .8, .6, .6, .4, .25, .2]); r.rotor = np.array([.9, .9, .51, .51, .2, .13, .13])
    r.amp = np.array([.9, .5, .8, .6, .9, .8, 1.2]); r.mid = np.array([0, .5, 0, -1.1, 0, .6, 0.])
    return r
def arm6(rng):
    s = rng.uniform(.7, 1.35); L = np.array([.33, .06, .38, .18, .20, .09]) * s * rng.uniform(.9, 1.1, 6)
    off = [(0, 0, L[0]), (L[1], 0, .1 * s), (0, 0, L[2]), (L[3], 0, .03 * s), (L[4], 0, 0), (L[5], 0, 0)]
    m = np.array([6, 7, 4.5, 2.5, 1.4, .4]) * s**2.2 * rng.uniform(.85, 1.15, 6)
    com = [(0.02 * s, .01 * s, .05 * s), (0.01, .02 * s, L[2] * .45), (L[3] * .4, .01, .02 * s), (L[4] * .45, 0, .005), (L[5] * .4, .003, 0), (.01, 0, .002)]
    I = []
    for i, ll in enumerate([.15 * s, L[2], L[3], L[4], L[5], .04]):
        r = .05 * s if i < 4 else .03; t = m[i] * (3 * r * r + ll * ll) / 12; z = m[i] * r * r / 2
        d = [t, t, z] if i < 2 else [z, t, t]
        I.append(np.diag(d) * rng.uniform(1, 1.15))
    q2, q3 = rng.uniform(0, .4), rng.uniform(.2, .6)
    r = Robot("tern_arm", off, None, [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], m, com, I,
              flange=(np.zeros(3), rotv((0, 1, 0), np.pi / 2)), q0=[rng.uniform(-.8, .8), q2, q3, rng.uniform(-.1, .1), np.pi / 2 - q2 - q3, rng.uniform(-.5, .5)])
    r.flrpy = (0, np.pi / 2, 0)
    r.tau_noise = np.array([.15, .2, .12, .05, .04, .02]) * s; r.KJ = np.array([1.2e4, 1.2e4, 8e3, 4e3, 3e3, 2e3]) * s
    r.Fc = np.array([5, 6, 4, 2, 1.5, .8]) * s; r.Fv = np.array([6, 7, 4, 1.5, 1, .5]) * s; r.rotor = np.array([1.5, 1.5, .8, .25, .15, .06]) * s
    r.amp = np.array([1.2, .6, .7, 1.2, .9, 1.3]); r.mid = np.array([0, .2, .3, 0, .5, 0.])
    return r

# ---------------------------------------------------------------- contact law
NAMES = ("k n c lam rx tau hA hL mr mL Fa La Kl db z0 al it ia ix iw mu bl cv dmu vs vr p N0 an r2 tau2 fk o_type o1 o2 o3 kgx adir").split()
IX = {k: i for i, k in enumerate(NAMES)}
DEF = dict(k=2000., n=1., tau=1., hL=1e-3, mL=1e-3, La=2e-4, db=1., iw=.01, bl=1e-4, vs=.01, N0=5., tau2=.1)
def pvec(**kw):
    P = np.zeros(len(NAMES))
    for d in (DEF, kw):
        for k, v in d.items(): P[IX[k]] = v
    return P
NST = 16
@nb.njit(cache=True, fastmath=False)
def step(S, P, t, dt, d, dd, s1, s2, ds1, ds2, v1, v2, out):
    k = P[0] * (1 + P[15] * t)
    if P[16] == 1: k *= 1 + P[17] * 0.5 * (1 + np.tanh((s1 - P[18]) / P[19]))          # edge
    elif P[16] == 2: k *= 1 + P[17] * np.exp(-((s1 - P[18])**2 + s2 * s2) / (2 * P[19]**2))  # inclusion
    elif P[16] == 3: k *= 1 + P[17] * (s1 - P[18]) / P[19]                              # gradient
    o = P[32]
    de = d + P[14]
    if o == 1:                      # outside: plastic dent: surface yields beyond a pressure o1 [N], dent grows
        de -= S[10]
    Fe = 0.0
    if de > 0:
        Fe = k * de**P[1]
        if de > P[13]: Fe += P[12] * (de - P[13])
        if o == 2:                  # outside: a shell that snaps through: force dips after depth o1 by share o2, width o3
            Fe *= 1 - P[33] * 0.5 * (1 + np.tanh((de - P[34]) / P[35]))
    if o == 1 and Fe > P[33] + P[34] * S[10]:
        S[10] += (Fe - P[33] - P[34] * S[10]) / (P[34] + k) * min(1.0, dt / 0.01)
    # Mullins
    if de > S[0]: S[0] = de
    if P[8] > 0 and de > 0: Fe *= 1 - P[8] * (1 - np.exp(-(S[0] - de) / P[9]))
    # hysteresis
    dde = de - S[1]; S[1] = de
    F = Fe
    if P[6] != 0:
        if de <= 0: S[2] = 0.0
        else:
            x = dde / P[7]; S[2] = (S[2] + x) / (1 + abs(x)); F += P[6] * S[2] * (1 - np.exp(-de / P[7]))
    # relaxation
    if P[4] > 0 or P[29] > 0:
        e = np.exp(-dt / P[5]); S[3] = S[3] * e + (F - S[4]) * np.exp(-dt / 2 / P[5])
        e2 = np.exp(-dt / P[30]); S[9] = S[9] * e2 + (F - S[4]) * np.exp(-dt / 2 / P[30])
        S[4] = F; F = F * (1 - P[4] - P[29]) + P[4] * S[3] + P[29] * S[9]
    N = 0.0
    if de > 0:
        N = F + P[2] * dd + P[3] * Fe * dd
        if o == 3: N += P[33] * np.sign(dd) * np.sqrt(abs(dd)) * de / 0.005    # outside: squeeze of a pore fluid through holes, ~ sqrt(rate)
        if N < 0: N = 0.0
        S[5] = max(S[5], de)
    if P[10] > 0 and S[5] > 0:
        g = min(1.0, S[5] / P[11])
        if de > 0: N -= P[10] * g
        elif de > -P[11]: N -= P[10] * g * (1 + de / P[11])
        else: S[5] = 0.0
    # friction
    T1 = 0.0; T2 = 0.0
    if P[20] > 0 and N > 1e-9:
        v = np.sqrt(v1 * v1 + v2 * v2)
        mu = P[20]
        if P[26] != 0: mu *= (max(N, 1e-3) / P[27])**P[26]
        if P[23] != 0: mu += P[23] * np.exp(-(v / P[24])**2)
        a1 = 1 + P[28]; a2 = 1 - P[28]
        if P[25] > 0:
            w = np.sqrt(v * v + P[25]**2); T1 = -mu * a1 * N * v1 / w; T2 = -mu * a2 * N * v2 / w
        else:
            L = P[21]
            if P[31] == 1:
                x = np.sqrt(ds1 * ds1 + ds2 * ds2) / L
                S[6] = (S[6] + ds1 / L) / (1 + x); S[7] = (S[7] + ds2 / L) / (1 + x)
            else:
                S[6] += ds1 / L; S[7] += ds2 / L; z = np.sqrt(S[6]**2 + S[7]**2)
                if z > 1: S[6] /= z; S[7] /= z
            T1 = -mu * a1 * N * S[6]; T2 = -mu * a2 * N * S[7]
        T1 -= P[22] * v1; T2 -= P[22] * v2
        if o == 4:                   # outside: tread ribs: tangential force waves with place (period o2), share o1 of N
            w_ = 2 * np.pi * s1 / P[34]
            T1 += P[33] * N * np.sin(w_) ; N *= 1 + 0.5 * P[33] * np.cos(w_)
    else:
        S[6] = 0.0; S[7] = 0.0
    out[0] = N; out[1] = T1; out[2] = T2

@nb.njit(cache=True)
def simulate(P, xc, vc, dt, K, ze, m, prescribed, every):
    """xc (n,3): s1, s2, height commanded. returns state (x3, v3, N, T1, T2) each `every` steps"""
    n = xc.shape[0]; S = np.zeros(NST); out = np.zeros(3); x = xc[0].copy(); v = np.zeros(3)
    r = np.zeros(((n - 1) // every + 1, 9)); D = 2 * ze * np.sqrt(K * m); f = np.zeros(3)
    for i in range(n):
        o1, o2 = x[0], x[1]
        if prescribed:
            for j in range(3): x[j] = xc[i, j]; v[j] = vc[i, j]
        else:
            for j in range(3):
                v[j] += dt / m * (K * (xc[i, j] - x[j]) + D * (vc[i, j] - v[j]) + f[j]); x[j] += dt * v[j]
        step(S, P, i * dt, dt, -x[2], -v[2], x[0], x[1], x[0] - o1, x[1] - o2, v[0], v[1], out)
        f[0] = out[1]; f[1] = out[2]; f[2] = out[0]
        if i % every == 0:
            a = i // every
            for j in range(3): r[a, j] = x[j]; r[a, 3 + j] = v[j]; r[a, 6 + j] = out[j]
    return r
@nb.njit(cache=True)
def drive_law(P, t, d, dd, s1, s2, v1, v2):
    n = len(t); S = np.zeros(NST); out = np.zeros(3); r = np.zeros((n, 3))
    for i in range(n):
        dt = t[i] - t[i - 1] if i > 0 else 1e-3
        d1 = s1[i] - s1[i - 1] if i > 0 else 0.0; d2 = s2[i] - s2[i - 1] if i > 0 else 0.0
        step(S, P, t[i] - t[0], max(dt, 1e-5), d[i], dd[i], s1[i], s2[i], d1, d2, v1[i], v2[i], out)
        for j in range(3): r[i, j] = out[j]
    return r
@nb.njit(cache=True)
def bristle(ds, L, kind):
    n = len(ds); z = 0.0; r = np.zeros(n)
    for i in range(n):
        x = ds[i] / L
        if kind == 1: z = (z + x) / (1 + abs(x))
        else: z = min(1.0, max(-1.0, z + x))
        r[i] = z
    return r
def lowpass(x, dt, tau):
    from scipy.signal import lfilter
    a = np.exp(-dt / tau); x = np.asarray(x, float)
    return lfilter([1 - a], [1, -a], x, axis=0, zi=np.atleast_2d(a * x[0]) if x.ndim > 1 else np.array([a * x[0]]))[0]

# ---------------------------------------------------------------- paths
class Path:
    """min-jerk way points of (s1, s2, h, tilt1, tilt2, yaw) with phases"""
    def __init__(s, x0): s.x = np.array(x0, float); s.seg = [(0.05, s.x.copy(), s.x.copy(), "rest", None)]
    def go(s, dur, ph, **kw):
        y = s.x.copy(); nm = dict(s1=0, s2=1, h=2, a=3, b=4, y=5)
        for k, v in kw.items(): y[nm[k]] = v
        s.seg.append((max(dur, .02), s.x.copy(), y, ph, None)); s.x = y; return s
    def lin(s, dur, ph, **kw):
        s.go(dur, ph, **kw); q = s.seg[-1]; s.seg[-1] = q[:4] + ("lin",); return s
    def osc(s, dur, ph, fun):
        """fun(t) -> dict of arrays, added, must start and end near 0 (a window is put on)"""
        s.seg.append((dur, s.x.copy(), s.x.copy(), ph, fun)); return s
    @property
    def T(s): return sum(q[0] for q in s.seg)
    def sample(s, dt):
        n = int(round(s.T / dt)); t = np.arange(n) * dt; x = np.empty((n, 6)); ph = np.empty(n, dtype=np.int16); t0 = 0.; names = []
        nm = dict(s1=0, s2=1, h=2, a=3, b=4, y=5)
        for (D, a, b, p, fun) in s.seg:
            i0, i1 = np.searchsorted(t, t0 - 1e-9), np.searchsorted(t, t0 + D - 1e-9)
            u = (t[i0:i1] - t0) / D
            if fun == "lin":
                r = min(.25, .06 / D if D > .24 else .25)   # trapezoid with short smooth ramps
                w = np.clip(np.minimum(u, 1 - u) / r, 0, 1); w = w * w * (3 - 2 * w); c = np.cumsum(w); sg = c / c[-1] if len(c) else u
            else: sg = u**3 * (10 - 15 * u + 6 * u * u)
            x[i0:i1] = a + (b - a) * sg[:, None]
            if callable(fun):
                w = np.clip(np.minimum(u, 1 - u) * D / .4, 0, 1); w = w**3 * (10 - 15 * w + 6 * w * w)
                for k, f in fun(t[i0:i1] - t0).items(): x[i0:i1, nm[k]] += f * w
            if p not in names: names.append(p)
            ph[i0:i1] = names.index(p); t0 += D
        return t, x, ph, names
