"""An own least-squares refit of catalogue models, from the written files alone (position columns, stated rig): contact, air and tester."""
import json
import math
import os
import tomllib
import numpy as np
import pyarrow.parquet as pq
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt
import scene

SPEC = {  # effect: [(parameter, start, low, high)]
 "hooke": [("k", 1500., 1., 1e6)], "kelvin-voigt": [("k", 1500., 1., 1e6), ("c", 5., -50., 2000.)], "hertz": [("k", 2e4, 1., 1e8)],
 "hunt-crossley": [("k", 1e4, 1., 1e9), ("lam", .5, -2., 50.), ("n", 1.4, .6, 3.)],
 "zener": [("k", 1500., 1., 1e6), ("rho", .4, 0., 5.), ("tau", 1., .01, 60.)], "maxwell": [("k", 1500., 1., 1e6), ("tau", 1., .01, 100.)],
 "hertz-exponent": [("n", 1.2, .5, 3.5)], "viscous-damping": [("c", 5., -50., 3000.)], "hunt-crossley-damping": [("lam", .5, -2., 50.)],
 "relaxation": [("r1", .2, 0., 5.), ("lt1", -1., -4., 2.), ("r2", .2, 0., 5.), ("lt2", 1., -2., 5.)],
 "hysteresis": [("r", .1, 0., 1.), ("a", .1, 0., 20.), ("ll", -7.5, -11., -4.)],
 "stress-softening": [("r", .2, 0., .95), ("ll", -7., -10., -4.)],
 "adhesion": [("F", .5, 0., 20.), ("s", .5, 0., 1.), ("ll", -7., -10., -4.), ("lr", -7., -10., -4.), ("p", 1., .2, 4.)],
 "stiffening-layer": [("K", 1000., 0., 1e6), ("d", .5, .02, 1.2)], "surface-offset": [("z", 0., -.005, .005)],
 "stiffness-drift": [("a", 0., -3., 3.)], "stiffness-inhomogeneity": [(f"w{i}", 0., -8., 8.) for i in range(18)],
 "coulomb-friction": [("mu", .4, 0., 3.)], "viscous-friction": [("c", 5., -20., 2000.)],
 "stribeck-friction": [("d", .2, -1., 2.), ("lv", -4.6, -8., -1.5)], "presliding": [("ll", -8., -10.5, -4.)],
 "friction-rounding": [("lv", -6., -10., -2.)], "load-dependent-friction": [("p", -.1, -1., 1.)], "friction-anisotropy": [("a", .05, -.9, .9)],
 "tool-mass": [("m", 0., -2., 2.)], "tool-com": [("x", 0., -.2, .2), ("y", 0., -.2, .2), ("z", 0., -.2, .2)],
 "tool-inertia": [(f"i{j}", 0., -.1, .1) for j in range(6)], "structural-compliance": [("C", 2e-5, 0., 5e-3)],
 "tip-offset": [("x", 0., -.02, .02), ("y", 0., -.02, .02), ("z", 0., -.02, .02)],
 "sensor-bias": [(f"b{j}", 0., -20., 20.) for j in range(6)], "sensor-drift": [(f"d{j}", 0., -20., 20.) for j in range(6)],
 "sensor-crosstalk": [(f"c{j}", 0., -.6, .6) for j in range(10)], "sensor-misalignment": [(f"p{j}", 0., -.6, .6) for j in range(3)],
 "sensor-lag": [("lT", -4., -8., 0.)], "time-offset": [("d", 0., -.15, .15)], "saturation": [("L", 1., .05, 1.2)],
 "mains-hum": [(f"h{j}", 0., -5., 5.) for j in range(8)],
}
BASES = ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener", "maxwell")


@njit(cache=True)
def mem(f, t, tau):
    y = np.zeros_like(f)
    for i in range(1, len(f)):
        e = math.exp(-(t[i] - t[i - 1]) / tau)
        y[i] = f[i] + (y[i - 1] - f[i]) * e
    return y


@njit(cache=True)
def loopz(d, l):
    z = np.zeros_like(d)
    for i in range(1, len(d)):
        if d[i] <= 0:
            z[i] = 0
        else:
            x = d[i] - d[i - 1]
            s = 1.0 if x > 0 else -1.0
            z[i] = s + (z[i - 1] - s) * math.exp(-abs(x) / l)
    return z


@njit(cache=True)
def deepest(d, reset):
    m = np.zeros_like(d)
    c = 0.0
    for i in range(len(d)):
        if reset > 0 and d[i] < -reset:
            c = 0.0
        if d[i] > c:
            c = d[i]
        m[i] = c
    return m


@njit(cache=True)
def touched(d, l):
    on = np.zeros_like(d)
    c = 0.0
    for i in range(len(d)):
        if d[i] > 0:
            c = 1.0
        elif d[i] < -l:
            c = 0.0
        on[i] = c
    return on


@njit(cache=True)
def bristle(s1, s2, d, l):
    u = np.zeros((len(d), 2))
    for i in range(1, len(d)):
        if d[i] <= 0:
            continue
        a = s1[i] - s1[i - 1]
        b = s2[i] - s2[i - 1]
        x = math.sqrt(a * a + b * b)
        u[i] = u[i - 1]
        if x > 0:
            e = math.exp(-x / l)
            u[i, 0] = a / x + (u[i - 1, 0] - a / x) * e
            u[i, 1] = b / x + (u[i - 1, 1] - b / x) * e
    return u


class Data:
    pass


def read_dir(d, arm=None, rows=2600):
    tab = pq.read_table(os.path.join(d, "log.parquet"))
    L = {c: tab[c].to_numpy(zero_copy_only=False) for c in tab.column_names}
    rig = tomllib.load(open(os.path.join(d, "rig.toml"), "rb"))
    D = Data()
    t = L["t"].astype(float)
    if arm is None:      # tester
        st = max(1, len(t) // rows)
        D.kind = "T"
        dt = np.median(np.diff(t)); tg = np.arange(t[0], t[-1], dt)
        dg = np.interp(tg, t, L["depth"]); fs = 1 / dt
        if fs > 60:
            dg = sosfiltfilt(butter(2, min(.8, 2 * 25 / fs), output="sos"), dg)
        D.t = t[::st]; D.d = np.interp(D.t, tg, dg); D.v = np.interp(D.t, tg, np.gradient(dg, dt))
        D.s1 = D.s2 = D.v1 = D.v2 = np.zeros(len(D.t))
        D.Y = L["normal_force"][::st, None].astype(float); D.W = np.ones(1); D.dm = max(D.d.max(), 1e-9)
        D.rms = rms_contact(D)
        return D
    D.kind = "C" if "surface" in rig else "F"
    n = arm.n
    Q = np.stack([L[f"q{i+1}"] for i in range(n)], 1)
    dt = np.median(np.diff(t)); tg = np.arange(t[0], t[-1], dt); fs = 1 / dt
    Qg = np.stack([np.interp(tg, t, Q[:, j]) for j in range(n)], 1)
    if fs > 60:
        Qg = sosfiltfilt(butter(2, min(.8, 2 * 22 / fs), output="sos"), Qg, axis=0)
    R6, p6 = arm.fk(Qg)
    Rs = R6 @ arm.sR
    tl = rig.get("tool", {})
    com = np.array(tl.get("com", [0, 0, 0]), float)
    D.mass, D.com = tl.get("mass", 0.0), com
    iv = tl.get("inertia", [0] * 6)
    D.I = np.array([[iv[0], iv[3], iv[4]], [iv[3], iv[1], iv[5]], [iv[4], iv[5], iv[2]]])
    g = np.array(rig["robot"].get("gravity", [0, 0, -9.81]))
    org = p6 + R6 @ arm.sp
    sm = (lambda x: sosfiltfilt(butter(2, min(.8, 2 * 12 / fs), output="sos"), x, axis=0)) if fs > 40 else (lambda x: x)
    aorg = np.gradient(np.gradient(sm(org), dt, axis=0), dt, axis=0)
    Wm = np.einsum("nji,njk->nik", Rs, np.gradient(Rs, dt, axis=0))
    w = sm(np.stack([Wm[:, 2, 1], Wm[:, 0, 2], Wm[:, 1, 0]], 1))
    al = np.gradient(w, dt, axis=0)
    st = max(1, len(t) // rows)
    D.t = t[::st]
    ip = lambda x: np.stack([np.interp(D.t, tg, x[:, j]) for j in range(x.shape[1])], 1)
    gr = np.einsum("nji,nj->ni", Rs, g - aorg)                      # g - a of the sensor's origin, sensor axes
    D.gr, D.w, D.al = ip(gr), ip(w), ip(al)
    D.Rs = ip(Rs.reshape(-1, 9)).reshape(-1, 3, 3)
    D.tip = arm.tip_s
    D.Y = np.stack([L[c] for c in ("fx", "fy", "fz", "tx", "ty", "tz")], 1)[::st].astype(float)
    D.W = np.r_[1, 1, 1, np.full(3, 1 / max(.08, np.linalg.norm(arm.tip_s)))]
    if D.kind == "C":
        s = rig["surface"]
        nn = np.array(s["normal"], float); t1 = np.array(s["tangent"], float); t2 = np.cross(nn, t1)
        e = ip(p6 + R6 @ arm.tp) - np.array(s["point"])
        ve = ip(np.gradient(p6 + R6 @ arm.tp, dt, axis=0))
        D.d, D.s1, D.s2 = -e @ nn, e @ t1, e @ t2
        D.v, D.v1, D.v2 = -ve @ nn, ve @ t1, ve @ t2
        D.n = np.einsum("nji,j->ni", D.Rs, nn); D.t1 = np.einsum("nji,j->ni", D.Rs, t1); D.t2 = np.einsum("nji,j->ni", D.Rs, t2)
        D.dm = max(D.d.max(), 1e-6)
        ft = D.Y[:, :3] - tool(D, D.mass, D.com, D.I)[:, :3]
        D.Nm = np.maximum(0, np.einsum("ni,ni->n", ft, D.n))
        c = D.d > 0
        D.cen = []
        if c.sum() > 50:
            x = D.s1[c], D.s2[c]
            sp = [max(np.ptp(x[0]), 1e-3), max(np.ptp(x[1]), 1e-3)]
            D.wd = max(sp) / 4
            if sp[1] < .3 * sp[0]:
                D.cen = [(u, x[1].mean()) for u in np.linspace(x[0].min(), x[0].max(), 16)]
                D.wd = max(sp[0] / 12, 1e-3)
            else:
                D.cen = [(u, v) for u in np.linspace(x[0].min(), x[0].max(), 4) for v in np.linspace(x[1].min(), x[1].max(), 4)]
                D.wd = max(sp) / 4
            D.phi = np.stack([D.s1 / sp[0], D.s2 / sp[1]] + [np.exp(-((D.s1 - a) ** 2 + (D.s2 - b) ** 2) / (2 * D.wd ** 2)) for a, b in D.cen], 1)
    D.rms = rms_contact(D)
    return D


def rms_contact(D):
    k = D.d > 0 if D.kind in "CT" else np.ones(len(D.t), bool)
    return float(np.sqrt(np.mean((D.Y[k, :3]) ** 2)))


def tool(D, mass, com, I):
    acc = D.gr - np.cross(D.al, com) - np.cross(D.w, np.cross(D.w, com))
    f = mass * acc
    tq = np.cross(com, f) - D.al @ I.T - np.cross(D.w, D.w @ I.T)
    return np.hstack([f, tq])


def predict(D, names, th):
    """th: {effect: array}"""
    E = th
    N_ = len(D.t)
    contact = D.kind in "CT"
    if contact:
        d = D.d
        if "tip-offset" in E:
            d = d - np.einsum("ni,i->n", D.n, E["tip-offset"])
        if "surface-offset" in E:
            d = d + E["surface-offset"][0]
        if "structural-compliance" in E:
            d = d - E["structural-compliance"][0] * (D.Nm if D.kind == "C" else np.maximum(D.Y[:, 0], 0))
        base = next((b for b in BASES if b in E), None)
        dp = np.maximum(d, 0)
        c = d > 0
        tt = D.t
        n = 1.5 if base == "hertz" else 1.0
        if base == "hunt-crossley":
            n = E[base][2]
        if "hertz-exponent" in E:
            n = E["hertz-exponent"][0]
        k = E[base][0]
        S = D.dm
        fe = k * (dp / S) ** n * S ** (1.5 if base == "hertz" else 1.0)      # k scaled at the deepest depth
        if "stiffening-layer" in E:
            K, b = E["stiffening-layer"]
            fe = fe + K * np.maximum(0, dp - b * S)
        if "stiffness-drift" in E:
            fe = fe * (1 + E["stiffness-drift"][0] * tt / 60)
        if "stiffness-inhomogeneity" in E and D.kind == "C":
            w = E["stiffness-inhomogeneity"]
            fe = fe * np.maximum(.05, 1 + D.phi @ w)
        if "stress-softening" in E:
            r, ll = E["stress-softening"]
            fe = fe * (1 - r * (1 - np.exp(-(deepest(d, 0.0) - dp) / math.exp(ll))))
        N = fe.copy()
        if base == "zener":
            N += E[base][1] * (fe - mem(fe, tt, E[base][2]))
        if base == "maxwell":
            N = fe - mem(fe, tt, E[base][1])
        if "relaxation" in E:
            r1, l1, r2, l2 = E["relaxation"]
            N += np.maximum(r1 * (fe - mem(fe, tt, math.exp(l1))) + r2 * (fe - mem(fe, tt, math.exp(l2))), -fe)
        if base == "kelvin-voigt":
            N += E[base][1] * D.v * c
        if base == "hunt-crossley":
            N += E[base][1] * fe * D.v
        if "viscous-damping" in E:
            N += E["viscous-damping"][0] * D.v * c
        if "hunt-crossley-damping" in E:
            N += E["hunt-crossley-damping"][0] * fe * D.v
        if "hysteresis" in E:
            r, a, ll = E["hysteresis"]
            N += np.minimum(r * fe + a, fe) * loopz(d, math.exp(ll))
        N = np.maximum(N, 0)
        if "adhesion" in E:
            F, s, ll, lr, p = E["adhesion"]
            l = math.exp(ll)
            pull = F * (1 - (1 - s) * np.exp(-(deepest(d, l) - d) / math.exp(lr)))
            out = np.clip(1 - np.clip(-d / l, 0, 1) ** p, 0, 1)
            N -= np.where(c, pull, pull * out * touched(d, l))
        if D.kind == "T":
            y = N[:, None]
        else:
            T1 = np.zeros(N_); T2 = np.zeros(N_)
            Np = np.maximum(N, 0)
            if "coulomb-friction" in E:
                mu = E["coulomb-friction"][0] * np.ones(N_)
                vv = np.sqrt(D.v1 ** 2 + D.v2 ** 2)
                if "stribeck-friction" in E:
                    a, lv = E["stribeck-friction"]
                    mu = mu + a * np.exp(-(vv / math.exp(lv)) ** 2)
                if "load-dependent-friction" in E:
                    mu = mu * np.maximum(Np, .02) ** E["load-dependent-friction"][0]
                a = E["friction-anisotropy"][0] if "friction-anisotropy" in E else 0.0
                if "friction-rounding" in E:
                    q = np.sqrt(vv ** 2 + math.exp(2 * E["friction-rounding"][0]))
                    u = np.stack([D.v1 / q, D.v2 / q], 1)
                else:
                    u = bristle(D.s1, D.s2, d, math.exp(E["presliding"][0]) if "presliding" in E else 1e-4)
                T1 -= mu * (1 + a) * Np * u[:, 0]; T2 -= mu * (1 - a) * Np * u[:, 1]
            if "viscous-friction" in E:
                T1 -= E["viscous-friction"][0] * D.v1 * c; T2 -= E["viscous-friction"][0] * D.v2 * c
            fc = N[:, None] * D.n + T1[:, None] * D.t1 + T2[:, None] * D.t2
            r = D.tip + (E["tip-offset"] if "tip-offset" in E else 0)
            y = np.hstack([fc, np.cross(r, fc)])
    if D.kind in "CF":
        m = D.mass + (E["tool-mass"][0] if "tool-mass" in E else 0)
        cm = D.com + (E["tool-com"] if "tool-com" in E else 0)
        I = D.I
        if "tool-inertia" in E:
            v = E["tool-inertia"]
            I = I + np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
        tw = tool(D, m, cm, I)
        y = tw if D.kind == "F" else y + tw
        if "sensor-misalignment" in E:
            R = scene.rotvec(-np.asarray(E["sensor-misalignment"]))
            y = np.hstack([y[:, :3] @ R.T, y[:, 3:] @ R.T])
        if "sensor-crosstalk" in E:
            C = np.zeros(36); C[[1, 2, 6, 8, 12, 13, 18, 19, 24, 25]] = E["sensor-crosstalk"]
            y = y + (y * D.W) @ C.reshape(6, 6).T / D.W
    nc = y.shape[1]
    if "sensor-bias" in E:
        y = y + E["sensor-bias"][:nc] / D.W
    if "sensor-drift" in E:
        y = y + D.t[:, None] / 60 * E["sensor-drift"][:nc] / D.W
    if "sensor-lag" in E:
        y = np.stack([mem(np.ascontiguousarray(y[:, j]) - y[0, j], D.t, math.exp(E["sensor-lag"][0])) + y[0, j] for j in range(nc)], 1)
    if "time-offset" in E:
        y = np.stack([np.interp(D.t - E["time-offset"][0], D.t, y[:, j]) for j in range(nc)], 1)
    if "mains-hum" in E:
        best = E["mains-hum"]
        ph = 2 * np.pi * D.hum * D.t
        if nc == 1:
            y = y + (best[0] * np.sin(ph) + best[1] * np.cos(ph) + best[2] * np.sin(2 * ph) + best[3] * np.cos(2 * ph))[:, None]
        else:
            for j in range(3):
                y[:, j] = y[:, j] + best[2 * j] * np.sin(ph) + best[2 * j + 1] * np.cos(ph)
    if "saturation" in E:
        j, M = D.sat
        y = y.copy()
        y[:, j] = np.clip(y[:, j], -E["saturation"][0] * M, E["saturation"][0] * M)
    return y


START2 = {"sensor-lag": [[-4.], [-2.5]], "presliding": [[-8.], [-6.8]], "stribeck-friction": [[.2, -4.6], [.1, -6.]], "friction-rounding": [[-6.], [-4.5]],
          "relaxation": [[.2, -1., .2, 1.5], [.3, 1., .2, 3.]], "hysteresis": [[.1, .1, -7.5], [.2, .02, -8.5]],
          "stiffening-layer": [[500., .5], [3000., .75]]}


def fit(D, names, warm=None, maxn=20):
    """least squares; returns (error rms in N over weighted channels, theta)"""
    names = [x for x in names if x in SPEC]
    if D.kind == "C" and not D.cen:
        names = [x for x in names if x != "stiffness-inhomogeneity"]
    if "saturation" in names:
        sat_channel(D)
    if "mains-hum" in names:
        D.hum = 50.0
        if hum_line(D, 60.0) > hum_line(D, 50.0):
            D.hum = 60.0
    sp = {x: SPEC[x] for x in names}
    off, x0, lo, hi = {}, [], [], []
    for x in names:
        off[x] = (len(x0), len(x0) + len(sp[x]))
        w = warm.get(x) if warm else None
        if x in BASES and w is None:
            S = D.dm * np.sqrt(D.dm) if x == "hertz" else D.dm
            y = D.Nm if D.kind == "C" else D.Y[:, 0]
            pk = np.percentile(np.maximum(y, 0), 98)
            a = [pk / S] + [q[1] for q in sp[x][1:]]
        else:
            a = list(w) if w is not None else [q[1] for q in sp[x]]
        x0 += a
        lo += [q[2] for q in sp[x]]; hi += [q[3] for q in sp[x]]
        if x in BASES:
            hi[off[x][0]] = 1e12
    if not x0:
        r = (D.Y - predict(D, names, {})) * D.W
        return math.sqrt(np.mean(r ** 2)), {}
    x0, lo, hi = map(np.array, (x0, lo, hi))
    un = lambda v: {x: v[a:b] for x, (a, b) in off.items()}
    def res(v):
        r = ((D.Y - predict(D, names, un(v))) * D.W).ravel()
        if "stiffness-inhomogeneity" in off:
            a, b = off["stiffness-inhomogeneity"]
            r = np.r_[r, .02 * D.rms * v[a:b]]
        return np.nan_to_num(r, nan=1e3)
    starts = [x0]
    for x in names:
        if maxn > 10 and (warm is None or x not in warm) and x in START2:
            for s in START2[x][1:]:
                y = x0.copy(); y[off[x][0]:off[x][1]] = s; starts.append(y)
    best = None
    xs = np.maximum(np.abs(x0), np.array([1e-3 if abs(a) < 1e-12 else 1e-9 for a in x0]))
    for x in ("sensor-bias", "sensor-drift", "mains-hum"):
        if x in off:
            xs[off[x][0]:off[x][1]] = .1
    for s in starts[:2]:
        s = np.clip(s, lo + 1e-9 * np.abs(lo) + 1e-12, hi - 1e-9 * np.abs(hi) - 1e-12)
        try:
            r = least_squares(res, s, bounds=(lo, hi), x_scale=xs, max_nfev=maxn, ftol=1e-5, xtol=1e-6)
        except Exception:
            continue
        if best is None or r.cost < best.cost:
            best = r
    return math.sqrt(2 * best.cost / D.Y.size), un(best.x)


def sat_channel(D):
    M = np.abs(D.Y).max(0)
    share = [np.mean(np.abs(D.Y[:, j]) > .985 * M[j]) * (M[j] * D.W[j]) for j in range(D.Y.shape[1])]
    j = int(np.argmax(share)); D.sat = (j, M[j])


def hum_line(D, f):
    return sum(abs(np.mean((D.Y[:, j] - D.Y[:, j].mean()) * np.exp(2j * np.pi * f * D.t))) * D.W[j] for j in range(D.Y.shape[1]))


def fit_more(D, names, warm, add):
    """start from a fitted model"""
    w = {k: v for k, v in warm.items() if k in names}
    return fit(D, names + [add], w)


CAND = {"C": ["viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer", "surface-offset",
              "stiffness-drift", "stiffness-inhomogeneity", "hertz-exponent", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding",
              "load-dependent-friction", "friction-anisotropy", "coulomb-friction", "tool-mass", "structural-compliance", "tip-offset", "sensor-bias", "sensor-drift",
              "sensor-misalignment", "sensor-crosstalk", "sensor-lag", "time-offset", "saturation"],
        "T": ["viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer", "surface-offset", "stiffness-drift",
              "hertz-exponent", "structural-compliance", "sensor-bias", "sensor-drift", "sensor-lag", "time-offset", "saturation"],
        "F": ["tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-misalignment", "sensor-crosstalk", "sensor-lag", "time-offset", "saturation"]}
