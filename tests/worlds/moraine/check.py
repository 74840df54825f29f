"""check.py OUT [--scan] [--only substr]: consistency of a generated world, from the files alone (pinocchio for the kinematics,
its own discretisation of the laws), and fits of base, base + truth (and, with --scan, base + every other effect)."""
import argparse, json, os, sys, time, tomllib, warnings
import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import butter, filtfilt
warnings.filterwarnings("ignore")
G9 = 9.81


def read(path):
    if path.endswith(".parquet"):
        t = pq.read_table(path)
        return {c: np.array(t[c].to_pylist()) if c == "phase" else t[c].to_numpy() for c in t.column_names}
    with open(path) as f: head = f.readline().strip().split(",")
    num = [i for i, h in enumerate(head) if h != "phase"]
    A = np.loadtxt(path, delimiter=",", skiprows=1, usecols=num, ndmin=2)
    return {head[i]: A[:, k] for k, i in enumerate(num)} | ({"phase": np.array([0])} if "phase" in head else {})


def smooth(x, fs, fc):
    if fc >= .45 * fs: return x
    b, a = butter(2, fc / (fs / 2))
    return filtfilt(b, a, x, axis=0, padlen=min(len(x) - 1, int(3 * fs / fc)))


V = ["k", "n", "c", "lam", "K2", "db", "z0", "alpha", "r1", "t1", "r2", "t2", "hA", "hL", "sr", "sl", "adh", "adl", "C", "mu", "cv", "dmu", "vs", "L", "p", "an", "vr", "r3", "t3"]
I = {v: i for i, v in enumerate(V)}
NC = 14


@njit(cache=True)
def el(P, W, cen, wid, d, t, x, y):
    if d <= 0: return 0.0
    f = P[0] * d ** P[1]
    if d > P[5]: f += P[4] * (d - P[5])
    g = 1.0 + P[7] * t / 60
    for i in range(len(W)):
        u = (x - cen[i]) / wid
        g += W[i] * np.exp(-.5 * u * u)
    return f * g


@njit(cache=True)
def predict(P, W, cen, wid, t, d0, dd0, x, y, vx, vy, ref):
    n = len(t); out = np.zeros((n, 3))
    m1 = 0.; m2 = 0.; m3 = 0.; dm = 0.; hz = 0.; z1 = 0.; z2 = 0.; Fl = 0.; att = False; dl = 0.
    for i in range(n):
        dt = t[i] - t[i - 1] if i else 1e-3
        d = d0[i] + P[6]; dd = dd0[i]
        if P[18] > 0 and d > 0:
            lo = 0.; hi = el(P, W, cen, wid, d, t[i], x[i], y[i])
            for _ in range(45):
                m = .5 * (lo + hi)
                if el(P, W, cen, wid, d - P[18] * m, t[i], x[i], y[i]) > m: lo = m
                else: hi = m
            d -= P[18] * .5 * (lo + hi)
        F = el(P, W, cen, wid, d, t[i], x[i], y[i])
        if d > dm: dm = d
        if P[14] != 0 and d > 0: F *= 1 - P[14] * (1 - np.exp(-(dm - d) / P[15]))
        dF = F - Fl; Fl = F
        N = F
        e = np.exp(-dt / P[9]); m1 = m1 * e + P[8] * dF * P[9] / dt * (1 - e)
        e = np.exp(-dt / P[11]); m2 = m2 * e + P[10] * dF * P[11] / dt * (1 - e)
        e = np.exp(-dt / P[28]); m3 = m3 * e + P[27] * dF * P[28] / dt * (1 - e)
        N += m1 + m2 + m3
        if d > 0:
            if P[12] != 0:
                s = d - dl; e = np.exp(-abs(s) / P[13]); sg = 1. if s > 0 else -1.
                hz = sg + (hz - sg) * e
                N += P[12] * hz
            N += P[2] * dd + P[3] * F * dd
        else: hz = 0.
        dl = d
        if P[16] > 0:
            if d > 0: att = True; N = max(N, 0.) - P[16]
            elif att:
                if d < -P[17]: att = False; N = 0.
                else: N = -P[16] * (1 + d / P[17])
            else: N = 0.
        elif N < 0 or d <= 0: N = 0.
        out[i, 0] = N
        if N > 0:
            sx = x[i] - x[i - 1] if i else 0.; sy = y[i] - y[i - 1] if i else 0.
            s = np.sqrt(sx * sx + sy * sy); v = np.sqrt(vx[i]**2 + vy[i]**2)
            if s > 0:
                e = np.exp(-s / P[23]); z1 = sx / s + (z1 - sx / s) * e; z2 = sy / s + (z2 - sy / s) * e
            mu = P[19] + P[21] * np.exp(-(v / P[22])**2)
            if P[24] != 0: mu *= (N / ref) ** P[24]
            if P[26] > 0:
                h = np.sqrt(v * v + P[26]**2); a = vx[i] / h; b = vy[i] / h
            else: a = z1; b = z2
            out[i, 1] = -mu * N * a * (1 + P[25]) - P[20] * vx[i]
            out[i, 2] = -mu * N * b * (1 - P[25]) - P[20] * vy[i]
        else: z1 = 0.; z2 = 0.
    return out


# effect -> [(parameter, [starts], log?)]
EFF = {
    "hertz-exponent": [("n", [1.2, 1.5], 0)], "viscous-damping": [("c", [10.], 0)], "hunt-crossley-damping": [("lam", [1.], 0)],
    "relaxation": [("r1", [.3, .3, .3], 0), ("t1", [.3, 2., .05], 1), ("r2", [.1, .2, .2], 0), ("t2", [4., 15., .6], 1), ("r3", [.1, .1, .1], 0), ("t3", [.08, .2, 8.], 1)], "hysteresis": [("hA", [.5], 0), ("hL", [5e-4], 1)],
    "stress-softening": [("sr", [.2], 0), ("sl", [1e-3], 1)], "adhesion": [("adh", [.6], 1), ("adl", [5e-4], 1)],
    "stiffening-layer": [("K2", [300., 300.], 0), ("db", [3e-3, 4.5e-3], 0)], "surface-offset": [("z0", [1e-4], 0)], "stiffness-drift": [("alpha", [.01], 0)],
    "stiffness-inhomogeneity": [("W%d" % i, [0.], 0) for i in range(NC)],
    "coulomb-friction": [("mu", [.4], 0)], "viscous-friction": [("cv", [5.], 0)], "stribeck-friction": [("dmu", [.1, .1], 0), ("vs", [.01, .03], 1)],
    "presliding": [("L", [3e-4], 1)], "friction-rounding": [("vr", [.003], 1)], "load-dependent-friction": [("p", [-.05], 0)], "friction-anisotropy": [("an", [.05], 0)],
    "structural-compliance": [("C", [2e-5], 1)],
    "tool-mass": [("dm", [.0], 0)], "tool-com": [("cx", [0.], 0), ("cy", [0.], 0), ("cz", [0.], 0)], "tool-inertia": [("ixx", [0.], 0), ("iyy", [0.], 0), ("izz", [0.], 0)],
    "tip-offset": [("ox", [0.], 0), ("oy", [0.], 0), ("oz", [0.], 0)],
    "sensor-bias": [("b%d" % i, [0.], 0) for i in range(6)], "sensor-drift": [("d%d" % i, [0.], 0) for i in range(6)],
    "sensor-crosstalk": [("m%d%d" % (i, j), [0.], 0) for i in range(3) for j in range(3) if i != j] , "sensor-misalignment": [("w%d" % i, [0.], 0) for i in range(3)],
    "sensor-gain": [("g%d" % i, [0.], 0) for i in range(6)], "sensor-lag": [("lag", [.01], 1)], "time-offset": [("to", [.003], 0)], "saturation": [("sat", ["s"], 0)],
    "mains-hum": [("h%d%s%d" % (f, s, c), [0.], 0) for f in (50, 150) for s in "sc" for c in range(6)],
}
BASES = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "n", "lam"], "zener": ["k", "r1", "t1"], "none": []}
INIT = {"k": 1500., "c": 5., "n": 1.4, "lam": 1., "r1": .3, "t1": 1.}
SCALE = {"cx": .005, "cy": .005, "cz": .005, "ox": .003, "oy": .003, "oz": .003, "dm": .02, "ixx": .001, "iyy": .001, "izz": .001, "z0": 3e-4, "db": 1e-3, "K2": 500., "c": 10., "cv": 10., "lam": 1., "to": .005,
         "alpha": .1, "n": .1, "L": 1, "sat": 1., "hA": .5}


class Contact:
    """one log with forces: press, sled, or robot with a wrench"""

    def __init__(s, log, rig, folder, row, fsmax):
        t = log["t"]; fs = min(fsmax, 1 / np.median(np.diff(t)))
        s.t = T = np.arange(t[0], t[-1], 1 / fs); s.fs = fs
        ip = lambda y: np.interp(T, t, y)
        s.robot = "fx" in log
        s.free = "none" in row["base"]
        z = np.zeros(len(T))
        if s.robot:
            near = np.clip(np.searchsorted(t, T), 0, len(t) - 1)
            m = pin.buildModelFromUrdf(os.path.join(folder, rig["robot"]["model"])); D = m.createData()
            names = rig["robot"].get("joints") or [x for x in m.names if x != "universe"]
            n = m.nq; order = [m.joints[m.getJointId(x)].idx_q for x in names]
            q0 = np.column_stack([log[f"q{i+1}"] for i in range(n)])
            q = np.column_stack([ip(q0[:, i]) for i in range(n)]); q = smooth(q, fs, 30.)
            qq = np.empty_like(q); qq[:, order] = q; q = qq
            fs_, ft_ = m.getFrameId(rig["robot"]["sensor_frame"]), m.getFrameId(rig["robot"]["tip_frame"])
            N = len(T); R = np.empty((N, 3, 3)); ps = np.empty((N, 3)); tip = np.empty((N, 3))
            for i in range(N):
                pin.framesForwardKinematics(m, D, q[i])
                R[i] = D.oMf[fs_].rotation; ps[i] = D.oMf[fs_].translation; tip[i] = D.oMf[ft_].translation
            s.R = R; s.rt = R[0].T @ (tip[0] - ps[0])
            g = np.array(rig["robot"].get("gravity", [0, 0, -G9]))
            tool = rig.get("tool", {"mass": 0., "com": [0, 0, 0]})
            s.m, s.com = tool["mass"], np.array(tool["com"])
            h = 1 / fs
            pc = ps + R @ s.com
            acc = smooth(np.gradient(np.gradient(pc, h, axis=0), h, axis=0), fs, 12.)
            s.gm = np.einsum("tji,tj->ti", R, g - acc)
            dR = np.gradient(R, h, axis=0); Wx = np.einsum("tji,tjk->tik", R, dR)
            s.w = smooth(np.column_stack([Wx[:, 2, 1], Wx[:, 0, 2], Wx[:, 1, 0]]), fs, 12.)
            s.al = np.gradient(s.w, h, axis=0)
            ii = tool.get("inertia", [0] * 6)
            s.I = np.array([[ii[0], ii[3], ii[4]], [ii[3], ii[1], ii[5]], [ii[4], ii[5], ii[2]]])
            s.y = np.column_stack([np.interp(T, t, log[c]) for c in ("fx", "fy", "fz", "tx", "ty", "tz")])
            if not s.free:
                S = rig["surface"]; n_, t1 = np.array(S["normal"], float), np.array(S["tangent"], float); n_ /= np.linalg.norm(n_); t2 = np.cross(n_, t1); r = tip - S["point"]
                s.d, s.x, s.yy = -r @ n_, r @ t1, r @ t2
                s.Rn, s.R1, s.R2 = (np.einsum("tji,j->ti", R, v) for v in (n_, t1, t2))
            else: s.d = s.x = s.yy = z - 1.; s.Rn = s.R1 = s.R2 = np.zeros((N, 3))
        else:
            s.d = smooth(ip(log["depth"]), fs, 40.); s.x = smooth(ip(log.get("slip1", np.zeros(len(t)))), fs, 60.); s.yy = z
            cols = ["normal_force"] + (["tangential_force1"] if "tangential_force1" in log else [])
            s.y = np.column_stack([ip(log[c]) for c in cols])
        gr = lambda u: smooth(np.gradient(u, 1 / fs), fs, 25.)
        s.gr = gr
        s.dd, s.vx, s.vy = gr(s.d), gr(s.x), gr(s.yy)
        s.nch = s.y.shape[1]
        raw = np.column_stack([log[c] for c in (("fx", "fy", "fz", "tx", "ty", "tz") if s.robot else cols)])
        s.noise = np.std(raw[2:] - 2 * raw[1:-1] + raw[:-2], axis=0) / np.sqrt(6)
        grp = [0, 0, 0, 1, 1, 1] if s.robot else [0] * s.nch
        s.grp = np.array(grp)
        s.rms = np.array([np.sqrt(np.mean(s.y[:, s.grp == g]**2)) for g in grp])
        s.wt = 1 / np.maximum(np.array([np.sqrt(np.mean(s.noise[s.grp == g]**2)) for g in grp]), .005 * s.rms)
        lo, hi = np.percentile(s.x[s.d > 0], [0, 100]) if (s.d > 0).any() else (0, 1)
        s.cen = np.linspace(lo, hi + 1e-9, NC); s.wid = max((hi - lo) / (NC - 1) * 1.2, 1e-4)
        s.ref = max(np.sqrt(np.mean(s.y**2)), 1.)

    def model(s, names, x):
        p = dict(zip(names, x)); g = p.get
        P = np.zeros(len(V)); P[I["n"]] = s.n0; P[I["L"]] = 1e-4; P[I["t1"]] = P[I["t2"]] = P[I["t3"]] = 1.; P[I["hL"]] = P[I["sl"]] = P[I["adl"]] = 1e-3; P[I["db"]] = 1.; P[I["vs"]] = 1.
        W = np.zeros(NC)
        for k, v in p.items():
            if k in I: P[I[k]] = v
            elif k[0] == "W": W[int(k[1:])] = v
        d, xx, yy, dd, vx, vy = s.d, s.x, s.yy, s.dd, s.vx, s.vy
        o = np.array([g("ox", 0.), g("oy", 0.), g("oz", 0.)]) if "ox" in p else None
        if o is not None and s.robot and not s.free:
            d = d - s.Rn @ o; xx = xx + s.R1 @ o; yy = yy + s.R2 @ o; dd, vx, vy = s.gr(d), s.gr(xx), s.gr(yy)
        F = predict(P, W if "W0" in p else np.zeros(0), s.cen, s.wid, s.t, d, dd, xx, yy, vx, vy, s.ref)
        if not s.robot: Y = F[:, :s.nch].copy()
        else:
            fc = F[:, :1] * s.Rn + F[:, 1:2] * s.R1 + F[:, 2:3] * s.R2
            m = s.m + g("dm", 0.); com = s.com + [g("cx", 0.), g("cy", 0.), g("cz", 0.)]
            ft = m * s.gm
            tt = np.cross(com, ft) + np.cross(s.rt + (o if o is not None else 0), fc)
            J = s.I + np.diag([g("ixx", 0.), g("iyy", 0.), g("izz", 0.)])
            tt = tt - (s.al @ J.T + np.cross(s.w, s.w @ J.T))
            Y = np.column_stack([fc + ft, tt])
            if "m01" in p:
                M = np.eye(6)
                for i in range(3):
                    for j in range(3):
                        if i != j: M[i, j] = p[f"m{i}{j}"]
                Y = Y @ M.T
            if "w0" in p:
                Rm = pin.exp3(np.array([p["w0"], p["w1"], p["w2"]])); Y = np.column_stack([Y[:, :3] @ Rm.T, Y[:, 3:] @ Rm.T])
        if "g0" in p: Y = Y * (1 + np.array([p[f"g{i}"] for i in range(s.nch)]))
        if "lag" in p: Y = lag(Y, 1 / s.fs, p["lag"])
        if "to" in p: Y = np.column_stack([np.interp(s.t - p["to"], s.t, Y[:, i]) for i in range(s.nch)])
        if "b0" in p: Y = Y + [p[f"b{i}"] for i in range(s.nch)]
        if "d0" in p: Y = Y + np.outer((s.t) / 60, [p[f"d{i}"] for i in range(s.nch)])
        if "h50s0" in p:
            for f in (50, 150):
                Y = Y + np.outer(np.sin(2 * np.pi * f * s.t), [p[f"h{f}s{i}"] for i in range(s.nch)]) + np.outer(np.cos(2 * np.pi * f * s.t), [p[f"h{f}c{i}"] for i in range(s.nch)])
        if "sat" in p: c = 2 if s.robot else 0; Y[:, c] = np.clip(Y[:, c], -p["sat"], p["sat"])
        return Y

    def fit(s, base, extra, starts=None):
        s.n0 = 1.5 if "hertz" in base else 1.0
        names, logs, sets = [], [], [[]]
        for b in base:
            for k in BASES.get(b) or []:
                names.append(k); logs.append(k in ("k", "t1"))
                v = INIT[k]
                if k == "k":
                    i = s.d > np.percentile(s.d, 90); nn = 1.5 if b == "hertz" else 1.4 if b == "hunt-crossley" else 1.
                    v = np.median(np.abs(s.y[i, 2 if s.robot else 0])) / np.median(np.maximum(s.d[i], 1e-5))**nn
                sets = [a + [v] for a in sets]
        es = [b for b in base if b in EFF] + list(extra)
        for e in es:
            ps = [p for p in EFF[e] if not (s.nch < 6 and p[0][-1].isdigit() and e in ("sensor-bias", "sensor-drift", "sensor-gain", "mains-hum") and int(p[0][-1]) >= s.nch)]
            ns = max(len(p[1]) for p in ps); new = []
            for a in sets:
                for j in range(ns):
                    b = list(a)
                    for p in ps:
                        v = p[1][min(j, len(p[1]) - 1)]
                        if v == "s": v = .999 * np.percentile(np.abs(s.y[:, 2 if s.robot else 0]), 99.7)
                        b.append(v)
                    new.append(b)
            sets = new
            for p in ps:
                if p[0] in names: raise KeyError(p[0])
                names.append(p[0]); logs.append(bool(p[2]))
        if not names:
            r = s.y - s.model([], []); return s.report(r, {})
        L = np.array(logs, bool)
        best = None
        sc = np.array([SCALE.get(k, 1. if k[0] in "bd" else .1) for k in names]); sc[L] = 1.
        up = lambda u: np.where(L, np.exp(np.clip(u, -30, 20)), u * sc)
        for x0 in sets[:6]:
            x0 = np.array(x0, float); u0 = np.where(L, np.log(np.maximum(x0, 1e-12)), x0 / sc)
            f = lambda u: np.nan_to_num(((s.model(names, up(u)) - s.y) * s.wt).ravel(), nan=1e6, posinf=1e6, neginf=-1e6)
            try: r = least_squares(f, u0, x_scale="jac" if len(u0) < 20 else 1., max_nfev=60, diff_step=1e-5, ftol=1e-7, xtol=1e-8)
            except Exception as ex: continue
            if best is None or r.cost < best[0]: best = (r.cost, up(r.x))
        return s.report(s.y - s.model(names, best[1]), dict(zip(names, best[1])))

    def report(s, r, p):
        f = s.grp == 0
        o = {"w": float(np.sqrt(np.mean((r * s.wt)**2))), "f": float(np.sqrt(np.mean(r[:, f]**2))), "frel": float(np.sqrt(np.mean(r[:, f]**2)) / s.rms[0]), "noise": float(np.sqrt(np.mean(s.noise[f]**2)))}
        if (~f).any(): o["trel"] = float(np.sqrt(np.mean(r[:, ~f]**2)) / s.rms[-1]); o["tq"] = float(np.sqrt(np.mean(r[:, ~f]**2))); o["tnoise"] = float(np.sqrt(np.mean(s.noise[~f]**2)))
        o["p"] = {k: float(v) for k, v in p.items()}
        return o


@njit(cache=True)
def lag(Y, h, tau):
    o = Y.copy(); e = np.exp(-h / tau)
    for i in range(1, len(Y)):
        for c in range(Y.shape[1]):
            x0 = Y[i - 1, c]; x1 = Y[i, c]; s = (x1 - x0) / h
            o[i, c] = x1 - s * tau + (o[i - 1, c] - x0 + s * tau) * e
    return o


@njit(cache=True)
def bristle(q, L):
    z = np.zeros_like(q)
    for i in range(1, len(q)):
        for c in range(q.shape[1]):
            s = q[i, c] - q[i - 1, c]; e = np.exp(-abs(s) / L); g = 1. if s > 0 else -1.
            z[i, c] = g + (z[i - 1, c] - g) * e
    return z


class Joints:
    def __init__(s, log, rig, folder, row, fsmax):
        t = log["t"]; fs = min(200., 1 / np.median(np.diff(t))); T = np.arange(t[0], t[-1], 1 / fs); s.fs = fs
        n = sum(k[0] == "q" and k[1:].isdigit() for k in log)
        ip = lambda k: np.interp(T, t, log[k])
        raw = np.column_stack([ip(f"q{i+1}") for i in range(n)]); y = np.column_stack([ip(f"tau{i+1}") for i in range(n)])
        enc = min(np.min(np.abs(d[np.abs(d) > 1e-9])) for d in np.diff(raw, axis=0).T)
        fc = 8. if "robot" in rig else 12.
        s.q = q = smooth(raw, fs, 10. if "robot" in rig else 20.); h = 1 / fs
        s.v = np.gradient(q, h, axis=0); a = np.gradient(s.v, h, axis=0)
        qz = smooth(raw, fs, 40.) if enc < 3e-4 else q
        s.Z = [bristle(qz, L) for L in (5e-5, 1e-4, 2e-4, 4e-4)] + [np.tanh(s.v / .01)]
        s.drive = "robot" not in rig
        N = len(T)
        if s.drive: s.rb = np.zeros((N, 1)); s.g = np.zeros((N, 1))
        else:
            m = pin.buildModelFromUrdf(os.path.join(folder, rig["robot"]["model"])); m.gravity.linear = np.array(rig["robot"].get("gravity", [0, 0, -G9])); D = m.createData()
            s.rb = np.array([pin.rnea(m, D, q[i], s.v[i], a[i]) for i in range(N)]); s.g = np.array([pin.computeGeneralizedGravity(m, D, q[i]) for i in range(N)])
            s.pay = np.array([pin.computeJointTorqueRegressor(m, D, q[i], s.v[i], a[i])[:, -10:] for i in range(N)])
        s.a = a; s.n = n; s.fc = fc
        s.flt = lambda x: smooth(x, fs, fc)
        s.y = y; s.yf = s.flt(y); s.rms = np.sqrt(np.mean(y**2)); s.crms = np.sqrt(np.mean(y**2, axis=0))
        s.noise = float(np.sqrt(np.mean((np.std(np.diff(y, 2, axis=0), axis=0) / np.sqrt(6))**2)))
        s.wt = 1 / np.maximum(.005 * s.crms, 1e-3 * s.rms)

    def fit(s, base, extra):
        best = None; grid = [None]
        if "joint-stribeck-friction" in extra: grid = np.geomspace(.03, 3, 14)
        if "joint-torque-ripple" in extra: grid = [float(k) for k in range(1, 41)]
        for gpar in grid:
          for s.z in (s.Z if len(grid) < 20 else s.Z[1:3]):
              r = np.zeros_like(s.y); par = {}
              tgt = s.yf - s.flt(s.rb)
              pay = None
              for it in range(3 if "payload" in extra else 1):
                  for j in range(s.n):
                      C = [s.z[:, j], s.v[:, j]] if "joint-coulomb-friction" in base else []
                      nm = ["fc", "fv"]
                      if s.drive: C.append(s.a[:, j]); nm.append("I")
                      for e in extra:
                          if e == "rotor-inertia": C.append(s.a[:, j]); nm.append("rotor")
                          if e == "joint-load-friction": C.append(np.abs(s.rb[:, j]) * s.z[:, j]); nm.append("load")
                          if e == "joint-torque-offset": C.append(np.ones(len(s.y))); nm.append("off")
                          if e == "joint-torque-gain": C.append(s.rb[:, j]); nm.append("gain")
                          if e == "gravity-error": C.append(s.g[:, j]); nm.append("grav")
                          if e == "joint-spring": C += [s.q[:, j], np.ones(len(s.y))]; nm += ["spring", "off"]
                          if e == "joint-friction-asymmetry": C.append(np.abs(s.z[:, j])); nm.append("asym")
                          if e == "joint-stribeck-friction": C.append(s.z[:, j] * np.exp(-(s.v[:, j] / gpar)**2)); nm.append("fst")
                          if e == "joint-torque-ripple":
                              for k in (1, 2): C += [np.sin(k * gpar * s.q[:, j]), np.cos(k * gpar * s.q[:, j])]; nm += [f"s{k}", f"c{k}"]
                      A = s.flt(np.column_stack(C))
                      if "payload" in extra:
                          pass
                      th, *_ = np.linalg.lstsq(A, tgt[:, j], rcond=None)
                      r[:, j] = tgt[:, j] - A @ th
                      par.update({f"{k}{j+1}": float(v) for k, v in zip(nm, th)})
                  if "payload" in extra:        # joint least squares: project friction out of the payload columns too
                      Bs, bs = [], []
                      for j in range(s.n):
                          A = s.flt(np.column_stack([s.z[:, j], s.v[:, j]])); Q, _ = np.linalg.qr(A)
                          B = s.flt(s.pay[:, j, :4]); Bs.append((B - Q @ (Q.T @ B)) * s.wt[j]); b = tgt[:, j]; bs.append((b - Q @ (Q.T @ b)) * s.wt[j])
                      th, *_ = np.linalg.lstsq(np.vstack(Bs), np.concatenate(bs), rcond=None)
                      par["payload"] = float(th[0])
                      r = np.column_stack([(bs[j] - Bs[j] @ th) / s.wt[j] for j in range(s.n)]); break
              w = np.sqrt(np.mean((r * s.wt)**2))
              if best is None or w < best[0]: best = (w, r, dict(par, grid=gpar))
        w, r, par = best
        return {"w": float(w), "f": float(np.sqrt(np.mean(r**2))), "frel": float(np.sqrt(np.mean(r**2)) / s.rms), "by": [round(float(x), 4) for x in np.sqrt(np.mean(r**2, axis=0)) / s.crms], "p": par, "noise": s.noise}


JALT = ["rotor-inertia", "joint-load-friction", "joint-torque-offset", "joint-torque-gain", "gravity-error", "joint-spring", "joint-friction-asymmetry", "joint-stribeck-friction", "joint-torque-ripple", "payload"]


def main():
    ap = argparse.ArgumentParser(); ap.add_argument("out"); ap.add_argument("--scan", action="store_true"); ap.add_argument("--only", default=""); ap.add_argument("--json", default=""); ap.add_argument("-v", action="store_true")
    a = ap.parse_args()
    rows = json.load(open(f"{a.out}/truth.json")); B = json.load(open(f"{a.out}/builder.json"))
    bad = 0; ratios = []; res = {}
    from collections import Counter
    print(Counter(r["kind"] for r in rows))
    for row in rows:
        name = row["log"].split("/")[0]; key = B[name]["key"]
        if a.only and not any(x in key for x in a.only.split(",")): continue
        t0 = time.time()
        folder = os.path.join(a.out, name)
        log = read(os.path.join(a.out, row["log"])); rig = tomllib.load(open(os.path.join(a.out, row["rig"]), "rb"))
        msg = []
        for k, v in log.items():
            if k != "phase" and not np.all(np.isfinite(v)): msg.append(f"{k} not finite")
        if np.any(np.diff(log["t"]) <= 0): msg.append("time runs back")
        known = {"t", "depth", "normal_force", "depth_rate", "slip1", "slip2", "slip_rate1", "slip_rate2", "tangential_force1", "tangential_force2", "fx", "fy", "fz", "tx", "ty", "tz", "phase"}
        for k in log:
            if k not in known and not (k.rstrip("0123456789") in ("q", "dq", "tau")): msg.append(f"column {k}")
        joints = "tau1" in log
        C = (Joints if joints else Contact)(log, rig, folder, row, 1000. if "mains-hum" in row["truth"] or "depth" in log else 200.)
        fb = C.fit(row["base"], []); ft = C.fit(row["base"], row["truth"]) if row["truth"] else fb
        ratio = fb["w"] / ft["w"]
        tol = lambda f: max(f["frel"], f.get("trel", 0.) if not joints else 0)
        off = lambda f: (f["frel"] > .02 and f["f"] > 1.3 * f["noise"]) or (f.get("trel", 0) > .02 and f["tq"] > 1.3 * f["tnoise"])
        if row["kind"] in ("one", "pair"):
            ratios.append(ratio)
            if ratio < 2: msg.append(f"RATIO {ratio:.2f}")
            if tol(fb) < .04: msg.append("SMALL")
            if off(ft): msg.append("TRUE MODEL OFF")
        if row["kind"] == "pair":
            for e in row["truth"]:
                f1 = C.fit(row["base"], [x for x in row["truth"] if x != e]); q = f1["w"] / ft["w"]
                msg.append(f"without {e}: x{q:.2f} ({tol(f1)*100:.1f}%)"); bad += q < 2
        if row["kind"] in ("none", "not-excited") and off(fb): msg.append("BASE OFF")
        if row["kind"] == "not-excited" and ratio > 1.1: msg.append(f"EXCITED {ratio:.2f}")
        if row["kind"] == "outside" and tol(fb) < .05: msg.append("SMALL")
        bad += any(m.isupper() or m.split()[0].isupper() for m in msg)
        T = log["t"][-1] - log["t"][0]
        vals = {k: f"{v:.3g}" for k, v in ft["p"].items() if not isinstance(v, type(None)) and (k in I or k in ("dm", "lag", "to", "ox", "oy", "cx", "cy", "cz", "sat", "payload", "d0", "d1", "d2", "b0", "b1", "b2", "grid") )}
        print(f"{name} {key:27s}{row['kind']:12s} {T:5.0f}s {len(log['t']):6d} | base {fb['f']:.3g} ({fb['frel']*100:.1f}%{', t %.1f%%' % (fb['trel']*100) if 'trel' in fb else ''}) true {ft['f']:.3g} ({ft['frel']*100:.2f}%{', t %.2f%%' % (ft['trel']*100) if 'trel' in ft else ''}) noise {ft['noise']:.3g} stated {row['error_true_model']:.3g} x{ratio:.2f} {'; '.join(msg)} [{time.time()-t0:.0f}s]", flush=True)
        if a.v: print("     ", vals, "| truth", {k: f"{v:.3g}" for k, v in row["values"].items()}, ft.get("by", ""))
        res[key] = dict(kind=row["kind"], truth=row["truth"], base=fb, true=ft, ratio=ratio)
        if a.scan and (row["kind"] in ("one", "pair", "outside")):
            alts = JALT if joints else [e for e in EFF if e not in row["base"] and not (e == "hertz-exponent" and "hunt-crossley" in row["base"]) and not (not "coulomb-friction" in row["base"] and e in ("coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy", "stiffness-inhomogeneity"))
                                        and not (e == "viscous-damping" and "kelvin-voigt" in row["base"]) and not (not C.robot and (e.startswith("tool") or e in ("tip-offset", "sensor-crosstalk", "sensor-misalignment")))
                                        and not (C.free and e not in ("tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation"))]
            out = []
            C2 = C if joints else Contact(log, rig, folder, row, 200. if not C.robot else 100.)
            ref = C2.fit(row["base"], row["truth"])["w"]; b0 = C2.fit(row["base"], [])["w"]
            for e in alts:
                if e in row["truth"]: continue
                try: f = C2.fit(row["base"], [e])
                except Exception as ex: continue
                out.append((f["w"], e, tol(f), f["frel"]))
            out.sort()
            print("      scan: base %.2f truth %.2f | " % (b0, ref) + ", ".join(f"{e} {w:.2f} ({r*100:.1f}%, f {fr*100:.1f}%)" for w, e, r, fr in out[:5]), flush=True)
            res[key]["scan"] = [(e, w / ref, r) for w, e, r, fr in out]
    if ratios: print("median ratio %.2f, least %.2f" % (np.median(ratios), min(ratios)))
    if a.json: json.dump(res, open(a.json, "w"), indent=1, default=str)
    print("bad:", bad); sys.exit(bool(bad))


if __name__ == "__main__":
    main()
